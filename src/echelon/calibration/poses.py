"""Poses that show the most of a geometry: D-optimal ones, within the limits of joints and clear of collisions.

Random poses that keep all limits are the candidates.  Poses are taken one by one, each where the determinant of the
information grows most, and exchanged for better candidates while that helps (Fedorov).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from echelon.algebra import DEFAULT_SEED
from echelon.base import LinearBase
from echelon.calibration.calibrating import error_model, setup_for
from echelon.calibration.fit import GeometryFit, lift_of
from echelon.excite import task_of
from echelon.shared import (
    CalibrationErrors,
    Count,
    Floats,
    InputError,
    one_thread,
    public,
)

CANDIDATES = 2000
"""Random poses among which the best ones are chosen."""
EXCHANGES = 5
"""Rounds of exchanges at most."""
HAND, REACH = 0.1, 1.0
"""Distances along each axis, m, of markers at unknown places from their body's frame, and of centres of distances."""
NOISE = {"m": 1e-4, "rad": 1e-3}
"""Standard deviations of measurements that the set-up does not state: a good tracker's."""


@public
@dataclass(frozen=True, repr=False)
class CalibrationPoses:
    """Poses to measure at, made by :func:`echelon.calibration_poses`.

    Attributes
    ----------
    coordinates : tuple of str
    q : array of shape (N, n)
        Positions, rad or m.
    base : LinearBase
        The combinations of errors that the measurements can show.
    deviations : array of shape (r,)
        Standard deviations that its combinations will have.
    """

    coordinates: tuple[str, ...]
    q: Floats
    base: LinearBase
    deviations: Floats

    def to_csv(self) -> str:
        """A table with one row for each pose."""
        rows = (",".join(map(repr, row)) for row in self.q.tolist())
        return (
            "\n".join([",".join(f"q_{name}" for name in self.coordinates), *rows])
            + "\n"
        )

    def __repr__(self) -> str:
        return f"CalibrationPoses({len(self.q)} poses, {self.base.rank} combinations)"


@public
@one_thread()
def calibration_poses(
    robot: Any,
    count: Count = 30,
    *,
    measure: Sequence[Mapping[str, Any]] | None = None,
    errors: Sequence[CalibrationErrors] = ("frames",),
    seed: int = DEFAULT_SEED,
) -> CalibrationPoses:
    """Choose poses whose measurement shows the geometry best.

    Parameters
    ----------
    robot, measure, errors, seed
        As for :func:`echelon.calibrate`.  Limits and collisions are those of the section ``excitation`` and of the
        robot file, as for :func:`echelon.exciting_trajectory`.
    count : int
        Number of poses.

    Returns
    -------
    CalibrationPoses

    Raises
    ------
    InputError
        If no pose keeps the limits, the poses are too few, or surfaces are touched, which choose the poses themselves.

    Examples
    --------
    >>> import echelon as ec
    >>> poses = ec.calibration_poses("examples/calibration/arm.yaml", 20)
    >>> poses.q.shape
    (20, 6)
    """
    setup = setup_for(robot)
    model = error_model(setup, measure, errors)
    if any(sight.constrains for sight in model.sights):
        raise InputError(
            "touched surfaces and loops choose the poses: plan them by poses of another measurement"
        )
    q = _candidates(setup, model.mechanism.positions, seed)
    fit = GeometryFit.without_data(model, seed)
    state = fit.nominal()
    rng = np.random.default_rng(seed)
    for sight in model.sights:
        if sight.unplaced:
            far = HAND if sight.is_marker else REACH
            state.frames[sight.unplaced][:3, 3] += rng.uniform(-far, far, 3)
    base = model.base(state.frames, seed=seed)
    noise = np.array([c.stated or NOISE[c.unit] for c in fit.channels])
    _, lift, prior = lift_of(base.B_float(), fit.usual)
    slopes = model.slopes(q, state.errors, state.frames) @ lift
    rows = slopes * fit.scales(noise)[:, None]
    chosen = _d_optimal(rows, prior.T @ prior, int(count))
    information = prior.T @ prior + np.einsum("kri,krj->ij", rows[chosen], rows[chosen])
    deviations = np.sqrt(np.diag(np.linalg.inv(information)))
    return CalibrationPoses(model.mechanism.positions, q[chosen], base, deviations)


def _candidates(setup: Any, names: Sequence[str], seed: int) -> Floats:
    """Random poses that keep the limits of joints, points, distances and efforts at rest, shape (N, n)."""
    task = task_of(setup, setup.excitation)
    limits, rng = task.limits, np.random.default_rng(seed)
    low = np.where(np.isfinite(limits.low), limits.low, limits.middle - np.pi)
    high = np.where(np.isfinite(limits.high), limits.high, limits.middle + np.pi)
    moving = low + (high - low) * rng.random((CANDIDATES, len(low)))
    kept, still = np.ones(CANDIDATES, dtype=bool), np.zeros_like(moving)
    for constraint in task.constraints:
        values = constraint.values(moving, still, still)
        inside = (values >= constraint.low) & (values <= constraint.high)
        kept &= inside.all(axis=1)
    if not kept.any():
        raise InputError(f"none of {CANDIDATES} random poses keeps all limits")
    q = np.zeros((int(kept.sum()), len(names)))
    places = {name: k for k, name in enumerate(task.mechanism.positions)}
    for column, name in enumerate(names):
        q[:, column] = moving[kept, places[name]] if name in places else task.held[name]
    return q


def _d_optimal(rows: Floats, prior: Floats, count: int) -> Floats:
    """Candidates with the largest determinant of the information, by their rows (N, m, r)."""
    information, chosen = prior.copy(), list[int]()
    for _ in range(count):
        best = int(np.argmax(_gains(rows, information)))
        chosen.append(best)
        information += rows[best].T @ rows[best]
    for _ in range(EXCHANGES):
        changed = False
        for place, old in enumerate(chosen):
            without = information - rows[old].T @ rows[old]
            best = int(np.argmax(_gains(rows, without)))
            if best != old:
                chosen[place], changed = best, True
                information = without + rows[best].T @ rows[best]
        if not changed:
            break
    return np.array(chosen)


def _gains(rows: Floats, information: Floats) -> Floats:
    """Growth of the logarithm of the determinant by each candidate, shape (N,)."""
    root = np.linalg.inv(np.linalg.cholesky(information))
    reduced = rows @ root.T
    inner = np.eye(rows.shape[1]) + reduced @ reduced.transpose(0, 2, 1)
    found: Floats = np.linalg.slogdet(inner)[1]
    return found
