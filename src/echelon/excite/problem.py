"""The optimisation problem: coefficients of a motion, a criterion, and constraints at samples.

Limits are drawn in by a share of their range, so that a motion that keeps them at the samples keeps them in between;
whether it does is found out afterwards (:mod:`echelon.excite.verification`), not believed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import sparse

from echelon.excite.constraints.motion import MotionLimit
from echelon.excite.constraints.narrowed import selected
from echelon.excite.constraints.state import StateConstraint
from echelon.excite.criteria import Criterion
from echelon.excite.families.basis import Basis
from echelon.excite.information import Information

Floats = npt.NDArray[np.float64]

_PER_PERIOD = 20
"""Constrained samples per period of the highest frequency: between them a sine rises by 1.2 % of its amplitude."""

_FAR = 1e6
"""Size of a motion, SI units, that is certainly beyond some limit."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise a criterion within limits.

    Attributes
    ----------
    basis : Basis
    count : int
        Coordinates that move, n.
    information : Information
    criterion : Criterion
    limits : tuple of MotionLimit
        Drawn in.
    constraints : tuple of StateConstraint
        Drawn in.
    centre : array of shape (n,)
        A pose that keeps all limits.
    """

    basis: Basis
    count: int
    information: Information
    criterion: Criterion
    limits: tuple[MotionLimit, ...]
    constraints: tuple[StateConstraint, ...]
    centre: Floats

    @property
    def shape(self) -> tuple[int, int]:
        """Of the coefficients."""
        return self.basis.size, self.count

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * self.count

    @cached_property
    def grid(self) -> Floats:
        """Samples at which constraints are asked for, s."""
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
        return self.criterion.evaluate(self.information(x.reshape(self.shape)).F)[0]

    def value_and_gradient(self, x: Floats) -> tuple[float, Floats]:
        """The criterion and its derivatives."""
        seen = self.information(x.reshape(self.shape))
        value, slope = self.criterion.evaluate(seen.F)
        return value, seen.gradient(slope).ravel()

    # -- limits of the motion --------------------------------------------------------------------------------------

    @cached_property
    def linear(self) -> tuple[sparse.csr_array, Floats, Floats]:
        """(A, low, high) with low ≤ A x ≤ high, for all samples of all limits."""
        blocks = [sparse.kron(self.phi[limit.order], limit.weights[None, :]) for limit in self.limits]
        rows = len(self.grid)
        low = np.repeat([limit.low for limit in self.limits], rows)
        high = np.repeat([limit.high for limit in self.limits], rows)
        matrix = sparse.csr_array(sparse.vstack(blocks)) if blocks else sparse.csr_array((0, self.size))
        matrix.eliminate_zeros()
        return matrix, low, high

    # -- constraints of the state ------------------------------------------------------------------------------------

    def state(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations at the grid."""
        C = x.reshape(self.shape)
        return self.phi[0] @ C, self.phi[1] @ C, self.phi[2] @ C

    def constrained(self, x: Floats) -> Floats:
        """Values of all constraints at all samples, one after another."""
        state = self.state(x)
        return np.concatenate([c.values(*state).ravel() for c in self.constraints]) if self.constraints else np.zeros(0)

    def slopes(self, x: Floats) -> Floats:
        """Their derivatives by the coefficients, shape (values, unknowns)."""
        state = self.state(x)
        found = []
        for constraint in self.constraints:
            parts = constraint.slopes(*state)  # of shape (N, m, n), by q, q̇ and q̈
            total = sum(
                np.einsum("ik,imj->imkj", self.phi[order], part) for order, part in enumerate(parts) if part is not None
            )
            found.append(np.asarray(total).reshape(-1, self.size))
        return np.concatenate(found)

    @cached_property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest values of the constraints."""
        rows = len(self.grid)
        low = [np.tile(c.low, rows) for c in self.constraints]
        high = [np.tile(c.high, rows) for c in self.constraints]
        return np.concatenate([np.zeros(0), *low]), np.concatenate([np.zeros(0), *high])

    # -- starting points -------------------------------------------------------------------------------------------

    def start(self, rng: np.random.Generator, share: float = 0.5) -> Floats:
        """A random motion about the centre, as large as limits let it be, times a share.

        Parameters
        ----------
        rng : Generator
        share : float
        """
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
        """The motion drawn towards resting at the centre until it keeps all limits, then by a share more."""
        rest = self.at_rest.ravel()
        A, low, high = self.linear
        at, step = A @ rest, A @ (x - rest)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0, (high - at) / step, np.where(step < 0, (low - at) / step, np.inf))
        largest = min(1.0, float(np.min(room, initial=np.inf)))
        return rest + share * max(largest, 0.0) * (x - rest)

    def violation(self, x: Floats) -> float:
        """The largest violation at the samples, relative to the range of what is limited."""
        A, low, high = self.linear
        found = _beyond(A @ x, low, high).max(initial=0.0)
        for broken in self.violations(x):
            found = max(found, broken.max(initial=0.0))
        return float(found)

    def violations(self, x: Floats) -> list[Floats]:
        """Of every constraint, the largest relative violation of each of its functions at the samples."""
        state = self.state(x)
        return [_beyond(c.values(*state), c.low, c.high).max(axis=0, initial=0.0) for c in self.constraints]

    # -- parts of the problem ----------------------------------------------------------------------------------------

    def first(self) -> Problem:
        """The problem with limits of positions and velocities only, which bind in every good motion."""
        return replace(self, limits=tuple(limit for limit in self.limits if limit.order < 2), constraints=())

    def extended(self, part: Problem, x: Floats) -> Problem | None:
        """A part of this problem with the limits that a motion breaks added to it; None if it breaks none.

        Parameters
        ----------
        part : Problem
        x : array of shape (size,)
        """
        A, low, high = self.linear
        over = _beyond(A @ x, low, high).reshape(len(self.limits), -1).max(axis=1, initial=0.0)
        limits = tuple(limit for limit, v in zip(self.limits, over, strict=True) if v > BROKEN or limit in part.limits)
        asked = {label for constraint in part.constraints for label in constraint.labels}
        chosen = [
            np.array([v > BROKEN or label in asked for label, v in zip(c.labels, broken, strict=True)])
            for c, broken in zip(self.constraints, self.violations(x), strict=True)
        ]
        constraints = tuple(selected(c, some) for c, some in zip(self.constraints, chosen, strict=True) if some.any())
        more = len(limits) > len(part.limits) or sum(map(int, (c.sum() for c in chosen))) > len(asked)
        return replace(self, limits=limits, constraints=constraints) if more else None


BROKEN = 1e-6
"""Violation at a sample, relative to a limit's range, that counts: limits are kept between samples with more room."""


def _beyond(values: Floats, low: Floats, high: Floats) -> Floats:
    span = np.where(np.isfinite(high - low), high - low, np.maximum(np.minimum(np.abs(low), np.abs(high)), 1.0))
    return np.maximum(np.maximum(low - values, values - high), 0.0) / np.maximum(span, 1e-300)
