"""Values of the errors: Gauss–Newton steps with exact derivatives, and what they leave of the measurements.

Errors move within the combinations that measurements show, z = B e, and e = S Bᵀ (B S Bᵀ)⁻¹ z is the smallest change of
the geometry that explains them, where S holds usual variances of errors.  These are a weak prior of z as well: what a
log hardly shows stays near the nominal geometry, and frames that nobody knows have none.  Robust fits find outliers;
the values are those of a plain fit without them, so that intervals are those of least squares.

Frames of tools and trackers may be turned by any angle.  They are found first, with the nominal geometry, from random
rotations until the best fit was found several times.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, sqrt
from typing import Literal

import numpy as np

from echelon.base import LinearBase
from echelon.calibration.frames import error_frame
from echelon.calibration.model import ErrorModel
from echelon.calibration.sights import Sight
from echelon.robot import rotation_of
from echelon.shared import Flags, Floats, InputError, extra, one_thread, symbol_stem

Loss = Literal["linear", "soft_l1"]

LOOSE = 10.0
"""Standard deviation of frames that nobody knows, m and rad: more than any cell is wide."""
FIRST_SHIFT, FIRST_TURN = 1e-2, 3e-2
"""Noise from which its estimation begins, m and rad: what a nominal geometry leaves."""
SMALLEST_NOISE = 1e-9
"""Noise at least, m or rad, so that exact data have finite weights."""
STARTS, AGREEING = 30, 3
"""Random rotations of unknown frames at most, and how often the best fit must be found."""
SAME_COST = 1e-3
"""Relative difference of fits that count as one."""
START_ROWS = 25
"""Rows by which starts are compared."""
MOST_STEPS = 30
"""Evaluations of one fit at most: those that come near take ten."""
ROUNDS = 3
"""Estimates of the noise, each with the weights of the one before."""
GROSS = 8.0
"""Size of a residual, beside the usual one, at which a row is left out; smaller ones are named and kept."""
OUTLYING = 1e-3
"""Probability that any of all rows would be taken for an outlier if noise were normal."""
MOST_OUTLIERS = 0.2
"""Share of rows beyond which they are the rule and no outliers."""
LEVEL = 0.95
"""Probability of the intervals."""


@dataclass(frozen=True)
class Observed:
    """Positions of the joints and measured values in a log.

    Attributes
    ----------
    source : str
    q : array of shape (N, n)
        Positions of the free coordinates.
    values : tuple of arrays of shape (N, rows of the sight)
        What each sight should see; zeros where a row vanishes.
    present : array of shape (N, sights)
        Which rows measure what.
    rows : array of shape (N,)
        Numbers of the rows in their log, from 1.
    """

    source: str
    q: Floats
    values: tuple[Floats, ...]
    present: Flags
    rows: Floats

    def __len__(self) -> int:
        return len(self.q)

    def part(self, chosen: Flags) -> Observed:
        """Some rows."""
        values = tuple(value[chosen] for value in self.values)
        return replace(
            self,
            q=self.q[chosen],
            values=values,
            present=self.present[chosen],
            rows=self.rows[chosen],
        )


@dataclass(frozen=True)
class NoiseChannel:
    """Rows with one noise: positions or rotations of one measurement."""

    name: str
    unit: str
    columns: slice  # among the rows of all sights
    sight: int
    per_row: int  # independent numbers in each row: 3 of the nine of a rotation
    stated: float | None  # standard deviation that the set-up states


@dataclass(frozen=True)
class State:
    """Frames, errors and noise."""

    frames: Mapping[str, Floats]  # of tools and outer frames, shape (4, 4)
    errors: Floats  # shape (p,)
    noise: Floats  # standard deviation of each channel


@dataclass(frozen=True)
class Fitted:
    """A fit."""

    state: State
    z: Floats  # shape (r,); combinations of errors
    covariance: Floats  # shape (r, r)
    spread: Floats  # shape (r, r); covariance before anything was measured
    used: Flags  # shape (N, sights); rows of the fit
    outlying: Flags  # shape (N, sights)
    left_out: Flags  # those of them that are no part of the fit
    crowded: tuple[int, ...] = ()  # sights with too many far rows to call them outliers

    @property
    def deviations(self) -> Floats:
        """Standard deviations of the combinations, shape (r,)."""
        found: Floats = np.sqrt(np.diag(self.covariance))
        return found


class GeometryFit:
    """Fits an error model to a log."""

    def __init__(self, model: ErrorModel, data: Observed, seed: int) -> None:
        self.model, self.data, self.seed = model, data, seed
        usual = np.array([error.usual for error in model.errors])
        self.unknown = ~np.isfinite(usual)
        self.usual = np.where(self.unknown, LOOSE, usual)

    @classmethod
    def without_data(cls, model: ErrorModel, seed: int) -> GeometryFit:
        """A fit to nothing, for designs."""
        count, rows = len(model.mechanism.positions), len(model.sights)
        nothing = Observed(
            "", np.zeros((0, count)), (), np.zeros((0, rows), bool), np.zeros(0)
        )
        return cls(model, nothing, seed)

    @cached_property
    def channels(self) -> tuple[NoiseChannel, ...]:
        """Positions and rotations of each sight."""
        return tuple(_channels(self.model))

    # -- residuals ---------------------------------------------------------------------------------------------------

    def residuals(self, state: State, data: Observed | None = None) -> Floats:
        """Differences of seen and measured values, shape (N, rows); zero where nothing is measured."""
        data = self.data if data is None else data
        seen = self.model.seen(data.q, state.errors, state.frames)
        left = seen - np.hstack(data.values)
        for place, rows in zip(data.present.T, self.model.rows, strict=True):
            left[~place, rows] = 0.0
        return left

    def scales(self, noise: Floats) -> Floats:
        """Weight of each row: 1/σ, of the nine numbers of a rotation 1/(√2 σ)."""
        found = np.zeros(self.model.rows[-1].stop)
        for channel, sigma in zip(self.channels, noise, strict=True):
            many = channel.columns.stop - channel.columns.start
            found[channel.columns] = sqrt(channel.per_row / many) / sigma
            if many == 9:
                found[channel.columns] = 1 / (sqrt(2) * sigma)
        return found

    def sizes(self, left: Floats) -> Iterator[tuple[NoiseChannel, Floats]]:
        """Size of what is left of each channel, m or rad, shape (N,)."""
        for channel in self.channels:
            size = np.linalg.norm(left[:, channel.columns], axis=1)
            if channel.unit == "rad":
                size = 2 * np.arcsin(np.clip(size / sqrt(8), 0, 1))
            yield channel, size

    def solve(
        self,
        state: State,
        basis: Floats,
        prior: Floats,
        used: Flags,
        loss: Loss,
        start: Floats | None = None,
        columns: Sequence[int] | None = None,
    ) -> tuple[Floats, Floats]:
        """Coordinates of the errors along some directions, and the Jacobian of all weighted rows there."""
        with extra("identify"):
            from scipy.optimize import least_squares

        scales = self.scales(state.noise)
        weights = np.zeros((len(self.data), len(scales)))
        for place, rows in zip(used.T, self.model.rows, strict=True):
            weights[place, rows] = scales[rows]
        keep = weights.ravel() > 0

        def value(z: Floats) -> Floats:
            at = replace(state, errors=state.errors + basis @ z)
            left = self.residuals(at) * weights
            return np.concatenate([left.ravel()[keep], prior @ z])

        def slope(z: Floats) -> Floats:
            errors = state.errors + basis @ z
            found = self.model.slopes(self.data.q, errors, state.frames, columns)
            found = found @ (basis if columns is None else basis[list(columns)])
            found = (found * weights[..., None]).reshape(-1, basis.shape[1])
            return np.vstack([found[keep], prior])

        start = np.zeros(basis.shape[1]) if start is None else start
        found = least_squares(
            value, start, slope, loss=loss, x_scale="jac", max_nfev=MOST_STEPS
        )
        jacobian = np.asarray(found.jac, dtype=float)
        return found.x, jacobian

    # -- frames that nobody knows ------------------------------------------------------------------------------------

    def start(self) -> State:
        """Frames of tools and trackers with the nominal geometry."""
        few = np.linspace(0, len(self.data) - 1, min(len(self.data), START_ROWS))
        chosen = np.zeros(len(self.data), dtype=bool)
        chosen[few.astype(int)] = True
        small = GeometryFit(self.model, self.data.part(chosen), self.seed)
        noise = self.first_noise()
        rng = np.random.default_rng(self.seed)
        best, lowest, often = None, inf, 0
        for count in range(STARTS):
            state = replace(self.nominal(rng if count else None), noise=noise)
            for _ in range(2):
                state = small.framed(state)
            cost = small.cost(state)
            if cost < lowest * (1 - SAME_COST):
                often = 0
            if cost <= lowest * (1 + SAME_COST):
                often += 1
            if cost < lowest:
                best, lowest = state, cost
            if often >= AGREEING:
                break
        assert best is not None
        return self.framed(best)

    def nominal(self, rng: np.random.Generator | None = None) -> State:
        """No errors, and frames where the description has them, or turned at random."""
        return State(self._frames(rng), np.zeros(len(self.usual)), self.first_noise())

    def first_noise(self) -> Floats:
        """Noise from which its estimation begins."""
        usual = {"m": FIRST_SHIFT, "rad": FIRST_TURN}
        return np.array([c.stated or usual[c.unit] for c in self.channels])

    def cost(self, state: State) -> float:
        """Sum of squares of weighted rows."""
        return float(((self.residuals(state) * self.scales(state.noise)) ** 2).sum())

    def framed(self, state: State) -> State:
        """A state with frames nearer to the best ones, and no errors of them."""
        columns = np.flatnonzero(self.unknown)
        basis = np.eye(len(self.usual))[:, columns]
        prior = np.eye(len(columns)) / LOOSE
        z, _ = self.solve(
            state,
            basis,
            prior,
            self.data.present,
            "soft_l1",
            columns=columns.tolist(),
        )
        return self.absorbed(replace(state, errors=state.errors + basis @ z))

    def absorbed(self, state: State) -> State:
        """A state with the errors of unknown frames in the frames."""
        values = {
            e.name: v for e, v in zip(self.model.errors, state.errors, strict=True)
        }
        unknown = {
            e.name
            for e, free in zip(self.model.errors, self.unknown, strict=True)
            if free
        }
        ends = [
            name
            for name in self.model.ends
            if any(f"{part}{symbol_stem(name)}" in unknown for part in ("px", "pz"))
        ]
        frames = dict(state.frames)
        for name in ends:
            frames[name] = error_frame(values, symbol_stem(name)) @ frames[name]
        kept = [
            0.0 if free and not e.name.startswith("radius") else v
            for e, v, free in zip(
                self.model.errors, state.errors, self.unknown, strict=True
            )
        ]
        return replace(state, frames=frames, errors=np.array(kept))

    def _frames(self, rng: np.random.Generator | None) -> dict[str, Floats]:
        """Frames at their stated places, turned at random."""
        found = dict[str, Floats]()
        for sight in self.model.sights:
            for name in (sight.tool, sight.frame):
                turned = np.eye(4)
                if rng is not None and sight.closure is None:
                    quaternion = rng.normal(size=4)
                    quaternion /= np.linalg.norm(quaternion)
                    turned[:3, :3] = rotation_of(quaternion)
                at = sight.place @ turned if name == sight.tool else turned
                found.setdefault(name, at)
        return found

    # -- all errors --------------------------------------------------------------------------------------------------

    @one_thread()
    def fitted(self, state: State, base: LinearBase) -> Fitted:
        """Values of all combinations that measurements show."""
        b = base.B_float()
        spread, lift, prior = lift_of(b, self.usual)
        used = self.data.present
        state = replace(state, noise=self.first_noise())
        z, named = np.zeros(len(b)), np.zeros_like(used)
        at = state
        loss: Loss = "soft_l1"
        crowded: tuple[int, ...] = ()
        for count in range(2 * ROUNDS):
            if count == ROUNDS:
                used, loss = self.data.present & ~self.outlying(at, GROSS), "linear"
                named = self.outlying(at)
                far = self.outlying(at, GROSS, most=1.0).sum(axis=0)
                many = far > MOST_OUTLIERS * self.data.present.sum(axis=0)
                crowded = tuple(np.flatnonzero(many).tolist())
            z, jacobian = self.solve(state, lift, prior, used, loss, z)
            at = replace(state, errors=state.errors + lift @ z)
            state = replace(
                state, noise=self.noise(at, used, len(z), robust=loss != "linear")
            )
            at = replace(at, noise=state.noise)
        covariance = _covariance(jacobian)
        return Fitted(
            at, z, covariance, spread, used, named, self.data.present & ~used, crowded
        )

    def intervals(self, found: Fitted) -> Floats:
        """Intervals of the combinations, shape (r, 2)."""
        with extra("identify"):
            from scipy.special import stdtrit

        free = self.numbers(found.used) - len(found.z)
        half = stdtrit(max(free, 1), (1 + LEVEL) / 2) * found.deviations
        return np.column_stack([found.z - half, found.z + half])

    def numbers(self, used: Flags) -> int:
        """How many independent numbers some rows hold."""
        return sum(int(used[:, c.sight].sum()) * c.per_row for c in self.channels)

    def noise(
        self, state: State, used: Flags, parameters: int, *, robust: bool
    ) -> Floats:
        """Standard deviation of each channel, by what is left."""
        numbers = self.numbers(used)
        if numbers <= parameters and any(c.stated is None for c in self.channels):
            raise InputError(
                f"{numbers} measured numbers cannot determine {parameters} combinations of errors and the noise: "
                "measure more poses, or state deviation"
            )
        lost = sqrt(numbers / max(numbers - parameters, 1))
        found: list[float] = []
        for channel, size in self.sizes(self.residuals(state)):
            left = size[used[:, channel.sight]] / sqrt(channel.per_row)
            if robust:
                typical = np.median(left) / sqrt(
                    chi_squared(channel.per_row, 0.5) / channel.per_row
                )
            else:
                typical = np.sqrt(np.mean(left**2))
            found.append(channel.stated or max(typical * lost, SMALLEST_NOISE))
        return np.array(found)

    def outlying(
        self, state: State, least: float = 0.0, most: float = MOST_OUTLIERS
    ) -> Flags:
        """Rows that normal noise does not explain, and of some size beside the usual one, shape (N, sights)."""
        left = (self.residuals(state) * self.scales(state.noise)) ** 2
        found = np.zeros_like(self.data.present)
        for k, rows in enumerate(self.model.rows):
            many = sum(c.per_row for c in self.channels if c.sight == k)
            present = self.data.present[:, k]
            limit = chi_squared(many, OUTLYING / max(present.sum(), 1))
            limit = max(limit, least**2 * chi_squared(many, 0.5))
            far = present & (left[:, rows].sum(axis=1) > limit)
            if far.sum() <= most * present.sum():
                found[:, k] = far
        return found


def _covariance(jacobian: Floats) -> Floats:
    """Inverse of Jᵀ J by singular values, whose variances are positive however exact a log is."""
    sizes = np.linalg.norm(jacobian, axis=0)
    _, values, directions = np.linalg.svd(jacobian / sizes, full_matrices=False)
    values = np.maximum(values, np.finfo(float).eps * values[0])
    root = (directions.T / values) / sizes[:, None]
    found: Floats = root @ root.T
    return found


def chi_squared(numbers: int, beyond: float) -> float:
    """Value that the sum of squares of some normal numbers exceeds with a probability."""
    with extra("identify"):
        from scipy.special import chdtri

    return float(chdtri(numbers, beyond))


def lift_of(b: Floats, usual: Floats) -> tuple[Floats, Floats, Floats]:
    """Covariance of combinations before anything is measured, their smallest errors, and a root of the information."""
    spread = b * usual**2 @ b.T
    lift = usual[:, None] ** 2 * b.T @ np.linalg.inv(spread)
    return spread, lift, np.linalg.inv(np.linalg.cholesky(spread))


def _channels(model: ErrorModel) -> Iterator[NoiseChannel]:
    for k, (sight, rows) in enumerate(zip(model.sights, model.rows, strict=True)):
        shift, turn = _stated(sight)
        if sight.kind == "pose":
            middle = rows.start + 3
            yield NoiseChannel(sight.name, "m", slice(rows.start, middle), k, 3, shift)
            yield NoiseChannel(sight.name, "rad", slice(middle, rows.stop), k, 3, turn)
        elif sight.closure is not None:
            shifts, turns = len(sight.closure.kind.positions), rows.stop - rows.start
            turns -= shifts
            middle = rows.start + shifts
            if shifts:
                yield NoiseChannel(
                    sight.name, "m", slice(rows.start, middle), k, shifts, None
                )
            if turns:
                yield NoiseChannel(
                    sight.name, "rad", slice(middle, rows.stop), k, turns, None
                )
        else:
            yield NoiseChannel(sight.name, "m", rows, k, rows.stop - rows.start, shift)


def _stated(sight: Sight) -> tuple[float | None, float | None]:
    deviation = None if sight.entry is None else sight.entry.deviation
    if isinstance(deviation, tuple):
        return deviation
    return deviation, None
