"""The optimisation problem: coefficients of a motion, a criterion, and constraints at samples.

:mod:`echelon.excite.verify` finds out whether a motion that keeps its limits at the samples keeps them in between;
where it does not, :mod:`echelon.excite.solve.design` tightens the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from echelon.algebra import Interval
from echelon.excite.problem.information import Information, OptimalityCriterion
from echelon.excite.problem.state_limits import MotionLimit, StateConstraint
from echelon.excite.problem.trajectory import Basis
from echelon.shared import Flags, Floats, extra

if TYPE_CHECKING:
    from scipy import sparse

_PER_PERIOD = 20
"""Constrained samples per period of the highest frequency: between them a sine rises by 1.2 % of its amplitude."""

_HALVINGS = 16
_BLIND = 1e6  # criterion of a motion that does not see some parameter at all, because loops cannot be closed
_FAR = 1e6  # size of a motion, SI units, that is certainly beyond some limit


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise a criterion within limits."""

    basis: Basis
    count: int  # coordinates that move, n
    information: Information
    criterion: OptimalityCriterion
    limits: tuple[MotionLimit, ...]
    constraints: tuple[StateConstraint, ...]
    centre: Floats  # shape (n,); a pose that keeps all limits
    ranges: tuple[
        Interval, ...
    ] = ()  # bounds of each constraint's functions, tighter than its own; its own if omitted
    # shape (grid, m); for each constraint, at which samples which of its functions are enforced; all of them if
    # omitted
    enforced: tuple[Flags, ...] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of the coefficients."""
        return self.basis.size, self.count

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * self.count

    @cached_property
    def grid(self) -> Floats:
        """Samples at which constraints are enforced, s."""
        count = int(np.ceil(_PER_PERIOD * self.basis.frequency * self.basis.duration))
        return np.linspace(0.0, self.basis.duration, count + 1)

    @cached_property
    def phi(self) -> tuple[Floats, ...]:
        """Derivatives of the basis at the grid, orders 0 to 3."""
        return tuple(self.basis.values(self.grid, order) for order in range(4))

    @cached_property
    def at_rest(self) -> Floats:
        """Coefficients of resting at the centre."""
        ones = np.linalg.lstsq(self.phi[0], np.ones(len(self.grid)), rcond=None)[0]
        return np.outer(ones, self.centre)

    # -- criterion -------------------------------------------------------------------------------------------------

    def value(self, x: Floats) -> float:
        """The criterion."""
        return self.value_and_gradient(x)[0]

    def value_and_gradient(self, x: Floats) -> tuple[float, Callable[[], Floats]]:
        """The criterion, and what gives its derivatives; where loops hide a parameter, large with none."""
        found = self.information(x.reshape(self.shape))
        if any(c.leading for c in self.constraints) and np.any(np.diag(found.F) <= 0):
            return _BLIND, lambda: np.zeros(self.size)
        value, slope = self.criterion.evaluate(found.F)
        return value, lambda: found.gradient(slope).ravel()

    # -- limits of the motion --------------------------------------------------------------------------------------

    @cached_property
    def linear(self) -> tuple[sparse.csr_array, Floats, Floats]:
        """(A, low, high) with low ≤ A x ≤ high, for all samples of all limits."""
        with extra("excite"):
            from scipy import sparse

        blocks = [
            sparse.kron(self.phi[limit.order], limit.weights[None, :])
            for limit in self.limits
        ]
        rows = len(self.grid)
        low = np.repeat([limit.low for limit in self.limits], rows)
        high = np.repeat([limit.high for limit in self.limits], rows)
        matrix = (
            sparse.csr_array(sparse.vstack(blocks))
            if blocks
            else sparse.csr_array((0, self.size))
        )
        matrix.eliminate_zeros()
        return matrix, low, high

    # -- constraints of the state ------------------------------------------------------------------------------------

    def state(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations at the grid."""
        C = x.reshape(self.shape)
        return self.phi[0] @ C, self.phi[1] @ C, self.phi[2] @ C

    @cached_property
    def _rows(self) -> list[tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
        """For each constraint, samples and functions that are enforced."""
        if self.enforced is None:
            masks = [
                np.ones((len(self.grid), len(c.labels)), dtype=bool)
                for c in self.constraints
            ]
        else:
            masks = list(self.enforced)
        return [(rows, columns) for rows, columns in map(np.nonzero, masks)]

    def constrained(self, x: Floats) -> Floats:
        """Values of all constraints that are enforced, one after another."""
        state, parts = self.state(x), [np.zeros(0)]
        for constraint, (rows, columns) in zip(
            self.constraints, self._rows, strict=True
        ):
            samples, back = np.unique(rows, return_inverse=True)
            parts.append(
                constraint.values(*(part[samples] for part in state))[back, columns]
            )
        return np.concatenate(parts)

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of :meth:`constrained` by the coefficients, shape (values, unknowns)."""
        state = self.state(x)
        found = [np.zeros((0, self.size))]
        for constraint, (rows, columns) in zip(
            self.constraints, self._rows, strict=True
        ):
            samples, back = np.unique(rows, return_inverse=True)
            total = np.zeros((len(rows), *self.shape))
            for order, part in enumerate(
                constraint.slopes(*(part[samples] for part in state))
            ):
                if part is not None:
                    total += (
                        self.phi[order][rows][:, :, None]
                        * part[back, columns][:, None, :]
                    )
            found.append(total.reshape(-1, self.size))
        return np.concatenate(found)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest values of the constraints that are enforced."""
        low = [
            low[columns]
            for (low, _), (_, columns) in zip(self._ranges, self._rows, strict=True)
        ]
        high = [
            high[columns]
            for (_, high), (_, columns) in zip(self._ranges, self._rows, strict=True)
        ]
        return np.concatenate([np.zeros(0), *low]), np.concatenate([np.zeros(0), *high])

    @property
    def _ranges(self) -> tuple[Interval, ...]:
        return self.ranges or tuple((c.low, c.high) for c in self.constraints)

    def tightened(self, below: Sequence[Floats], above: Sequence[Floats]) -> Problem:
        """The problem whose constraints' least values rise, and largest ones fall, by some amounts."""
        tight = [
            (low + b, high - a)
            for (low, high), b, a in zip(self._ranges, below, above, strict=True)
        ]
        return replace(self, ranges=tuple(tight))

    # -- starting points -------------------------------------------------------------------------------------------

    def start(self, rng: np.random.Generator, share: float = 0.5) -> Floats:
        """A random motion about the centre, as large as limits let it be, times a share."""
        rest, A = self.at_rest, self.linear[0]
        away = np.zeros(self.shape)
        for j in range(self.count):
            # each coordinate by itself first, so that the tightest limit does not keep all others small
            alone = np.zeros(self.shape)
            alone[:, j] = rng.normal(size=len(alone))
            size = np.abs(A @ alone.ravel()).max(initial=0.0)
            largest = self.shrunk((rest + alone * (_FAR / max(size, 1e-300))).ravel())
            away += largest.reshape(self.shape) - rest
        return self.shrunk((rest + away).ravel(), share)

    def shrunk(self, x: Floats, share: float = 1.0) -> Floats:
        """The motion scaled down about the centre until it keeps all limits of the motion, then by a share more."""
        rest = self.at_rest.ravel()
        A, low, high = self.linear
        at, step = A @ rest, A @ (x - rest)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(
                step > 0,
                (high - at) / step,
                np.where(step < 0, (low - at) / step, np.inf),
            )
        largest = min(1.0, float(np.min(room, initial=np.inf)))
        return rest + share * max(largest, 0.0) * (x - rest)

    def inside(self, x: Floats) -> Floats:
        """The motion, halved about the centre until it keeps all constraints at the samples."""
        rest = self.at_rest.ravel()
        for _ in range(_HALVINGS):
            if self.violation(x) <= BROKEN:
                break
            x = rest + 0.5 * (x - rest)
        return x

    def violation(self, x: Floats) -> float:
        """The largest violation of any limit at the samples, relative to its range; negative if there is room."""
        found = [self._beyond_limits(x), *(over.ravel() for over in self.violations(x))]
        return float(np.max(np.concatenate(found), initial=-np.inf))

    def _beyond_limits(self, x: Floats) -> Floats:
        """The largest violation of each limit of the motion."""
        A, low, high = self.linear
        rows = (
            beyond(A @ x, low, high).reshape(len(self.limits), -1)
            if self.limits
            else np.zeros((0, 0))
        )
        found: Floats = rows.max(axis=1, initial=-np.inf)
        return found

    def violations(self, x: Floats) -> list[Floats]:
        """For every constraint, the relative violation of each function at each sample, shape (grid, m)."""
        state = self.state(x)
        return [
            beyond(c.values(*state), *ends)
            for c, ends in zip(self.constraints, self._ranges, strict=True)
        ]

    # -- parts of the problem ----------------------------------------------------------------------------------------

    def relaxed(self) -> Problem:
        """The problem with limits of positions and velocities, which bind in every good motion, and closed loops."""
        rows = len(self.grid)
        few = tuple(
            np.tile(np.arange(len(c.labels)) < c.leading, (rows, 1))
            for c in self.constraints
        )
        return replace(
            self,
            limits=tuple(limit for limit in self.limits if limit.order < 2),
            enforced=few,
        )

    def enforcing(self, x: Floats) -> Problem:
        """The problem with limits of positions and velocities, and all that a motion breaks or nearly breaks."""
        over = zip(self.limits, self._beyond_limits(x), strict=True)
        limits = tuple(limit for limit, v in over if v > -_NEAR or limit.order < 2)
        near = [(v > -_NEAR).any(axis=0) for v in self.violations(x)]
        rows = len(self.grid)
        return replace(
            self,
            limits=limits,
            enforced=tuple(np.tile(functions, (rows, 1)) for functions in near),
        )

    def extended(self, part: Problem, x: Floats) -> Problem | None:
        """A part of this problem with what a motion breaks, or nearly breaks, added; None if it breaks nothing."""
        # a function that is broken at some samples after it was enforced at others is enforced at many more
        over = zip(self.limits, self._beyond_limits(x), strict=True)
        limits = tuple(limit for limit, v in over if v > BROKEN or limit in part.limits)
        assert part.enforced is not None
        violations = self.violations(x)
        broken = [v > BROKEN for v in violations]
        new = any(
            np.any(b & ~old) for b, old in zip(broken, part.enforced, strict=True)
        )
        if not new and len(limits) == len(part.limits):
            return None
        again = (old.any(axis=0) for old in part.enforced)
        near = (
            v > -np.where(a, _NEAR_AGAIN, _NEAR)
            for v, a in zip(violations, again, strict=True)
        )
        enforced = (
            old | (n & b.any(axis=0))
            for n, b, old in zip(near, broken, part.enforced, strict=True)
        )
        return replace(self, limits=limits, enforced=tuple(enforced))


_NEAR = 0.1
"""Room at a sample, relative to a limit's range, below which it is enforced together with those that are broken."""
_NEAR_AGAIN = 0.3  # the room for functions that were enforced before, where they were not broken then
BROKEN = 1e-6
"""Violation at a sample, relative to a limit's range, that counts: limits are kept between samples with more room."""


def beyond(values: Floats, low: Floats, high: Floats) -> Floats:
    """How far values are beyond their limits, relative to the limits' range; negative if there is room."""
    span = np.where(
        np.isfinite(high - low),
        high - low,
        np.maximum(np.minimum(np.abs(low), np.abs(high)), 1.0),
    )
    return np.maximum(low - values, values - high) / np.maximum(span, 1e-300)
