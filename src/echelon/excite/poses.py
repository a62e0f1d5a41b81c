"""Poses that keep all limits: where motions can start, and which limits are in each other's way where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.constraints.state import StateConstraint
from echelon.excite.limits import ResolvedLimits

_TRIED = 512  # poses
_REFINED = 24  # the best of them, from which broken limits are minimised
_KEPT = 1e-9  # what rounding may leave of a broken limit, relative to its size
_NEARBY = 0.1  # share of a coordinate's range to either side within which poses are nearby
_AROUND = 32  # poses nearby that are looked at
_NARROW = 0.1  # share of them that may break a limit before more room is looked for
_STEPS, _SWEEPS = 9, 3  # places that are tried for a coordinate, and how often


def start_pose(wanted: Floats, limits: ResolvedLimits, constraints: Sequence[StateConstraint], seed: int) -> Floats:
    """A pose at rest that keeps all limits: the middle of the ranges if that is one with room to move about it.

    Parameters
    ----------
    wanted : array of shape (n,)
        The pose that the set-up states; NaN for what it leaves open.
    limits : ResolvedLimits
    constraints : sequence of StateConstraint
    seed : int
        Of the poses that are tried.

    Raises
    ------
    InputError
        If there is none; names the limits that are broken.
    """
    low, high = limits.low, limits.high
    pose: Floats = np.where(np.isnan(wanted), limits.middle, wanted)
    outside = np.flatnonzero((pose < low) | (pose > high))
    if len(outside):
        name = next(limit.name for limit in limits.motion if limit.order == 0 and limit.weights[outside[0]])
        raise InputError(f"the centre of '{name}' is outside of its position limits", element="centre")
    free, over = np.isnan(wanted), broken(pose[None], constraints)[0]
    if over.any() and not free.any():
        names = _names(constraints, over)
        raise InputError(f"the pose at which motions start breaks the limits of {names}", element="centre")
    low, high = np.where(np.isfinite(low), low, pose - np.pi), np.where(np.isfinite(high), high, pose + np.pi)
    if over.any():
        pose = _searched(pose, free, low, high, constraints, seed)
    return _roomier(pose, free, low, high, constraints, seed)


def broken(poses: Floats, constraints: Sequence[StateConstraint]) -> Floats:
    """How far each function is beyond its limits at rest, 0 if it is not: shape (poses, functions)."""
    still = np.zeros_like(poses)
    parts = [np.zeros((len(poses), 0))]
    for constraint in constraints:
        values = constraint.values(poses, still, still)
        over = np.maximum(np.maximum(constraint.low - values, values - constraint.high), 0.0)
        size = np.where(np.isfinite(constraint.high), np.abs(constraint.high), np.abs(constraint.low))
        parts.append(np.where(over > _KEPT * np.maximum(size, 1.0), over, 0.0))
    return np.hstack(parts)


def _searched(
    pose: Floats,
    free: npt.NDArray[np.bool_],
    low: Floats,
    high: Floats,
    constraints: Sequence[StateConstraint],
    seed: int,
) -> Floats:
    unit = np.random.default_rng(seed).random((_TRIED, len(pose)))
    poses = np.where(free, low + (high - low) * unit, pose)
    over = broken(poses, constraints)
    # of the poses that keep everything the one nearest to the middle
    good = np.flatnonzero(~over.any(axis=1))
    if len(good):
        away = np.linalg.norm((poses[good] - pose) / np.maximum(high - low, 1e-300), axis=1)
        return np.asarray(poses[good[int(np.argmin(away))]])
    scale = np.maximum(over.max(axis=0), 1e-300)
    for k in np.argsort(np.sum(over / scale, axis=1))[:_REFINED]:
        found = _refined(poses[k], free, low, high, constraints, scale)
        if not broken(found[None], constraints)[0].any():
            return found
    raise InputError(_conflict(over > 0, constraints), element="limits")


def _refined(
    pose: Floats,
    free: npt.NDArray[np.bool_],
    low: Floats,
    high: Floats,
    constraints: Sequence[StateConstraint],
    scale: Floats,
) -> Floats:
    """The pose moved to where less is broken."""

    def residuals(x: Floats) -> Floats:
        full = pose.copy()
        full[free] = x
        found: Floats = broken(full[None], constraints)[0] / scale
        return found

    found = least_squares(residuals, np.clip(pose[free], low[free], high[free]), bounds=(low[free], high[free]))
    result = pose.copy()
    result[free] = found.x
    return result


def _roomier(
    pose: Floats,
    free: npt.NDArray[np.bool_],
    low: Floats,
    high: Floats,
    constraints: Sequence[StateConstraint],
    seed: int,
) -> Floats:
    """The pose, or if it is in a narrow place another: coordinates one by one where fewer poses nearby break limits.

    A motion about a pose beside a limit can hardly be drawn back, nor that limit drawn in.
    """
    near = _NEARBY * (high - low)
    around = near * np.random.default_rng(seed).uniform(-1, 1, (_AROUND, len(pose)))

    def crowded(poses: Floats) -> npt.NDArray[np.intp]:
        """How many poses nearby break each limit, shape (poses, functions)."""
        found = broken((poses[:, None] + around).reshape(-1, len(pose)), constraints) > 0
        return np.asarray(found.reshape(len(poses), _AROUND, -1).sum(axis=1))

    if crowded(pose[None]).max(initial=0) <= _NARROW * _AROUND:
        return pose
    for _ in range(_SWEEPS):
        before = pose
        for j in np.flatnonzero(free):
            tried = np.tile(pose, (_STEPS + 1, 1))
            tried[1:, j] = np.linspace(low[j] + near[j], high[j] - near[j], _STEPS)
            good = tried[~broken(tried, constraints).any(axis=1)]
            pose = good[np.lexsort((np.abs(good - pose)[:, j], crowded(good).sum(axis=1)))[0]]
        if np.array_equal(pose, before):
            break
    return pose


def _conflict(over: npt.NDArray[np.bool_], constraints: Sequence[StateConstraint]) -> str:
    """Which limits no pose keeps, alone or in pairs."""
    labels = _labels(constraints)
    start = f"none of {len(over)} poses within the position limits keeps"
    never = [labels[k] for k in np.flatnonzero(over.all(axis=0))]
    if never:
        return f"{start} the limits of {', '.join(never[:6])}"
    for i, j in combinations(np.flatnonzero(over.any(axis=0)).tolist(), 2):
        if np.all(over[:, i] | over[:, j]):
            return f"{start} the limits of {labels[i]} and of {labels[j]} together"
    some = [labels[k] for k in np.flatnonzero(over.any(axis=0))]
    return f"{start} all limits together: {', '.join(some[:8])}"


def _labels(constraints: Sequence[StateConstraint]) -> list[str]:
    return [label for constraint in constraints for label in constraint.labels]


def _names(constraints: Sequence[StateConstraint], over: Floats) -> str:
    return ", ".join(label for label, value in zip(_labels(constraints), over, strict=True) if value > 0)
