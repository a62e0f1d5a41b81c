"""The rank of the rows of a motion that was driven, beside what rounding of its numbers explains.

Rank is exact for all motions of a robot, and for families of them (:func:`echelon.motion_ranks`).  The rows of one
motion are numbers with a last decimal.  So they are computed twice, at the stated states and at states that are rounded
otherwise: W and W + E.  No singular value of the exact rows is further than ‖E‖ from one of W (H. Weyl, 1912): what is
larger is seen, and what is smaller may be rounding.  Columns are divided by those of E, so that each counts by how far
it stands above rounding, whatever its unit.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.base import BaseModel, base_of
from echelon.dynamics import STATE
from echelon.excite.files.samples import (
    PREFIXES,
    TIME,
    MotionSamples,
    interpolated,
    position_columns,
)
from echelon.identification import (
    Channel,
    Locked,
    check_locked,
    open_log,
    read_table,
)
from echelon.robot import (
    Experiment,
    Mechanism,
    Readable,
    characteristic_length,
    joined,
    mechanism_of,
)
from echelon.shared import Floats, InputError, listed, pivoted_qr, public

BLOCK = 4096
"""Samples whose rows are factored together, so that memory does not grow with the length of a log."""
DRAWS = 3
"""Random roundings: the size of one alone may be small by chance where samples are few."""
MARGIN = 2.0
"""Ratio to the largest drawn rounding from which a singular value is seen for certain: a log has another draw of
that size."""
MOST_DECIMALS = 14
"""Decimals up to which numbers of a file count as rounded: doubles near 1 have not many more."""
_TERMS, _WEAKEST = 4, 3
"""Terms of a combination that texts show, the largest first, and combinations that they call weakest."""
_EPS = float(np.finfo(float).eps)


@public
@dataclass(frozen=True, repr=False)
class SampledRank:
    """Combinations of base parameters that driven motions show.

    Made by :func:`echelon.sampled_rank`.

    Attributes
    ----------
    base : BaseModel
    samples : int
    rank : int
        Combinations of base parameters that the motions show for certain.
    most : int
        Combinations that they may show: more than ``rank`` where some are as small as rounding.
    shown : array of shape (r,)
        Singular values of W, descending, as multiples of what rounding explains.
    combinations : array of shape (r, r)
        For each singular value the combination of base parameters that it shows, a row of weights.
    unseen : array of shape (r - rank, r)
        Changes of base parameters that no row shows, a row each.
    resolution : array of shape (r,)
        For each base parameter the change that alone shows as much as rounding does.
    """

    base: BaseModel
    samples: int
    rank: int
    most: int
    shown: Floats
    combinations: Floats
    unseen: Floats
    resolution: Floats

    @property
    def gap(self) -> float:
        """The last singular value that is seen by the next, or by what rounding explains if that is more."""
        if self.rank == 0:
            return 0.0
        below = self.shown[self.rank :].max(initial=1.0)
        return float(self.shown[self.rank - 1] / below)

    @property
    def doubt(self) -> str:
        """Reason to doubt the rank; empty if it is clear."""
        if self.most == self.rank:
            return ""
        return (
            f"the motion shows {self.rank} to {self.most} combinations: {self.most - self.rank} of them are hardly "
            "larger than rounding of its numbers; record more decimals, or move faster and further"
        )

    def to_text(self) -> str:
        """Rank, gap, what is not seen and what is seen least, a line each."""
        lines = [
            f"{self.samples} samples show {self.rank} of {self.base.rank} base parameters, by a gap of {self.gap:.2g}"
        ]
        changes = [self._sum(change, self.resolution) for change in self.unseen]
        lines += [f"not seen: a change of {change}" for change in changes]
        for k in reversed(range(max(self.rank - _WEAKEST, 0), self.rank)):
            combination = self._sum(self.combinations[k], 1 / self.resolution)
            lines.append(f"{self.shown[k]:.2g} times above rounding: {combination}")
        if self.doubt:
            lines.append(f"doubt: {self.doubt}")
        return "\n".join(lines)

    def _sum(self, weights: Floats, sizes: Floats) -> str:
        """A sum of base parameters by its largest terms, as parts of some sizes."""
        order = np.argsort(-np.abs(weights) / sizes)
        terms = [
            f"{weights[k]:+.3g}·[{self.base.pivots[k]}]" for k in order if weights[k]
        ]
        more = [f"and {len(terms) - _TERMS} more"] if len(terms) > _TERMS else []
        return " ".join([*terms[:_TERMS], *more])

    def to_dict(self) -> dict[str, Any]:
        """JSON-able data."""
        numbers = {
            name: getattr(self, name).tolist()
            for name in ("shown", "resolution", "combinations", "unseen")
        }
        return {
            "samples": self.samples,
            "rank": self.rank,
            "most": self.most,
            "gap": self.gap,
            "doubt": self.doubt,
            "parameters": list(self.base.pivots),
            **numbers,
        }

    def __repr__(self) -> str:
        return f"SampledRank({self.rank} of {self.base.rank} base parameters, gap {self.gap:.2g})"


Motion = Mapping[str, npt.ArrayLike] | str | os.PathLike[str]


@public
def sampled_rank(
    robot: BaseModel | Mechanism | Readable | list[Experiment] | tuple[Experiment, ...],
    motion: Motion | None = None,
    *,
    seed: int = DEFAULT_SEED,
) -> SampledRank:
    """The rank of the rows of a motion that was driven, over the base parameters of the robot.

    Parameters
    ----------
    robot : BaseModel, Mechanism, path-like, or list of Experiment
    motion : mapping of str to array, or path-like, optional
        ``q``, ``qd`` and ``qdd`` of shape (N, coordinates), rad or m; or a table of them with the columns ``q_<name>``,
        ``qd_<name>`` and ``qdd_<name>``, as of :func:`echelon.write_trajectory` or of a log.  Without velocities and
        accelerations a spline through the positions gives them at times ``t``.  If omitted, the motions that
        experiments state, of which the rows are stacked.
    seed : int
        Seed of the roundings that are drawn.

    Returns
    -------
    SampledRank

    Raises
    ------
    InputError
        If no motion is stated, or it does not fit the robot.

    Notes
    -----
    Numbers of a file are rounded to their last decimal, those of arrays to doubles.  Noise of sensors counts as motion:
    filter a log before.

    Examples
    --------
    >>> import numpy as np
    >>> import echelon as ec
    >>> t = np.linspace(0, 6, 200)[:, None]
    >>> w = np.array([1.0, 2.0])
    >>> still = {"q": 0.3 + 0 * t * w, "qd": 0 * t * w, "qdd": 0 * t * w}
    >>> moving = {"q": np.sin(w * t), "qd": w * np.cos(w * t), "qdd": -(w**2) * np.sin(w * t)}
    >>> robot = ec.base_parameters("examples/double_pendulum.yaml")
    >>> ec.sampled_rank(robot, still).rank, ec.sampled_rank(robot, moving).rank
    (2, 6)
    """
    if isinstance(robot, BaseModel):
        base, driven_robot = robot, robot.mechanism
    else:
        if isinstance(robot, list | tuple):
            robot = joined(robot)
        driven_robot = mechanism_of(robot)
        base = base_of(driven_robot)
    rng = random_generator(seed)
    R, errors, samples = np.zeros((0, base.rank)), [np.zeros((0, base.rank))] * DRAWS, 0
    for name, stated in _motions(driven_robot, motion).items():
        model = base.experiment(name) if name in base.mechanism.experiments else base
        driven = _driven(model.mechanism, stated)
        for kind, part in zip(STATE, driven.states, strict=True):
            if not np.isfinite(part).all():
                row = int(np.argmin(np.isfinite(part).all(axis=1)))
                raise InputError(f"{kind} of sample {row} is no number: leave it out")
        count = len(driven.states[0])
        samples += count
        others = [driven.rounded(rng) for _ in range(DRAWS)]
        for start in range(0, count, BLOCK):
            block = slice(start, start + BLOCK)
            rows = _rows(model, driven.states, block)
            R = _factor(R, rows)
            moved = [_rows(model, other, block) - rows for other in others]
            errors = [_factor(E, more) for E, more in zip(errors, moved, strict=True)]
    return _judged(base, samples, R, errors)


def _judged(
    base: BaseModel, samples: int, R: Floats, errors: Sequence[Floats]
) -> SampledRank:
    """The rank by R-factors of W and of errors by rounding."""
    resolution = 1 / _noise_of_columns(base, R, errors)
    scaled = R * resolution
    _, found, axes = np.linalg.svd(scaled)
    sizes = np.concatenate([found, np.zeros(base.rank - len(found))])
    # what rounding explains, with that of the decomposition itself
    floor = max(np.linalg.norm(E * resolution, 2) for E in errors)
    floor += _EPS * max(samples, base.rank) * sizes.max(initial=0.0)
    shown = sizes / floor
    rank, most = (int((shown > limit).sum()) for limit in (MARGIN, 1.0))
    accuracy = 1 / shown[rank - 1] if rank else 1.0
    unseen = _sparse(axes[rank:], accuracy) * resolution
    unseen /= np.abs(unseen).max(axis=1, keepdims=True, initial=_EPS)
    combinations = axes / resolution
    combinations /= np.abs(combinations).max(axis=1, keepdims=True, initial=_EPS)
    return SampledRank(
        base, samples, rank, most, shown, combinations, unseen, resolution
    )


def _noise_of_columns(base: BaseModel, R: Floats, errors: Sequence[Floats]) -> Floats:
    """Sizes of the columns of E: at least the rounding of the largest column of W, in units of the robot's size."""
    columns = [base.mechanism.columns[k] for k in base.matrix.pivots]
    length = characteristic_length(base.mechanism)
    units = np.array(
        [0.0 if c.kind is None else length**-c.length_degree for c in columns]
    )
    sizes = np.linalg.norm(R, axis=0)
    own = np.max([np.linalg.norm(E, axis=0) for E in errors], axis=0)
    computed = _EPS * np.where(
        units, (sizes * units).max() / np.where(units, units, 1.0), sizes
    )
    noise = np.maximum(own, computed)
    return np.where(noise > 0, noise, 1.0)


def _sparse(axes: Floats, accuracy: float) -> Floats:
    """A basis of the span of some rows with as many zeros as it has rows, and more where entries are inaccurate."""
    if not len(axes):
        return axes
    _, order = pivoted_qr(axes)
    found = np.linalg.solve(axes[:, order[: len(axes)]], axes)
    return np.where(np.abs(found) > accuracy, found, 0.0)


def _factor(R: Floats, rows: Floats) -> Floats:
    """The R-factor of more rows."""
    return np.asarray(np.linalg.qr(np.vstack([R, rows]), mode="r"))


def _rows(model: BaseModel, states: Sequence[Floats], block: slice) -> Floats:
    """Rows of the reduced regressor at some samples, without those that unknown contact forces enter."""
    q, qd, qdd = (part[block] for part in states)
    X = model.regressor(q, qd, qdd)
    if model.mechanism.contacts:
        X = model.without_contact_forces(q) @ X
    return X.reshape(-1, model.rank)


# -- motions -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Driven:
    """A motion at its samples."""

    states: tuple[Floats, ...]  # q, q̇, q̈
    steps: tuple[float, ...]  # of their last decimals
    spline: MotionSamples | None = None  # positions whose spline gives the rates

    def rounded(self, rng: np.random.Generator) -> tuple[Floats, ...]:
        """States that differ by up to half a last decimal, as those that were rounded do."""
        moved = [
            part + rng.uniform(-step / 2, step / 2, part.shape)
            for part, step in zip(self.states, self.steps, strict=True)
        ]
        if self.spline is None:
            return tuple(moved)
        return _along_spline(replace(self.spline, states=(moved[0], None, None)))


def _along_spline(samples: MotionSamples) -> tuple[Floats, ...]:
    """Positions, and the rates of the spline through them."""
    units = [""] * len(samples.coordinates)
    motion = interpolated(samples, units, "motion")
    return motion.states(samples.t - samples.t[0])


def _motions(mechanism: Mechanism, motion: Motion | None) -> Mapping[str, Motion]:
    """Motions by the names of experiments."""
    if motion is not None and not mechanism.experiments:
        return {"": motion}
    stated = {} if mechanism.reading is None else mechanism.reading.file.motions
    if motion is not None or not stated:
        raise InputError(
            "no motion is stated: give one of a robot, and for experiments each its own, as motion",
            source=mechanism.name,
        )
    return stated


def _driven(mechanism: Mechanism, motion: Motion) -> _Driven:
    """A motion in arrays or in a file."""
    if not isinstance(motion, Mapping):
        return _logged(mechanism, motion)
    lacking = [name for name in STATE if name not in motion]
    if lacking:
        raise InputError(f"the motion lacks {listed(lacking)}: it has q, qd and qdd")
    states = [np.array(motion[name], dtype=float, ndmin=2) for name in STATE]
    return _Driven(tuple(states), tuple(_double_step(part) for part in states))


def _logged(mechanism: Mechanism, path: str | os.PathLike[str]) -> _Driven:
    """A motion in a table."""
    names = open_log(path).names
    coordinates, rates = mechanism.positions, mechanism.velocities
    columns = [position_columns(names, coordinates, os.fspath(path))]
    columns += [[f"{kind}_{name}" for name in rates] for kind in STATE[1:]]
    whole = all(column in names for column in (*columns[1], *columns[2]))
    if not whole and coordinates != rates:
        raise InputError(
            "a spline cannot give the rates of free rotations: add columns qd_<name> and qdd_<name>",
            source=os.fspath(path),
        )
    read = columns if whole else columns[:1]
    # one style of names holds for all positions
    prefix = "" if columns[0] == list(coordinates) else f"{PREFIXES[0]}_"
    locked = {
        name: Locked(Channel(prefix + name), at)
        for name, at in mechanism.locked.items()
        if prefix + name in names
    }
    resting = [name for one in locked.values() for name in one.columns]
    table = read_table(path, [TIME, *chain.from_iterable(read), *resting])
    check_locked(table, locked)
    found = [np.column_stack([table.columns[name] for name in some]) for some in read]
    steps = tuple(_last_step(part) for part in found)
    if whole:
        return _Driven(tuple(found), steps)
    samples = MotionSamples(coordinates, table.columns[TIME], (found[0], None, None))
    return _Driven(_along_spline(samples), (steps[0], 0.0, 0.0), samples)


def _double_step(values: Floats) -> float:
    """The rounding of doubles as large as the largest of some values, or 1."""
    return _EPS * max(1.0, float(np.abs(values).max(initial=0.0)))


def _last_step(values: Floats) -> float:
    """The step of the last decimal that all numbers of a file have; that of doubles where they are as precise."""
    double = _double_step(values)
    for decimals in range(1, MOST_DECIMALS):
        apart = np.abs(values - np.round(values, decimals))
        if apart.max(initial=0.0) <= double:
            return max(10.0**-decimals, double)
    return double
