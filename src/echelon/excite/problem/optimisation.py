"""The optimisation problem: coefficients of a motion, a criterion, and limits at samples.

Every limit, of the motion or of the state, is a function of q and its first three derivatives at a sample.  So values
have shape (T, M) for T samples and M limits, their slopes (T, M, 4, n) by the derivatives of n coordinates, and what a
solver needs of the coefficients (gradients, curvatures) are sums over samples of products of small matrices.

:mod:`echelon.excite.verify` finds out whether a motion that keeps its limits at the samples keeps them in between;
where it does not, :mod:`echelon.excite.solve.design` tightens the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.algebra import Interval
from echelon.excite.problem.information import Information, OptimalityCriterion
from echelon.excite.problem.state_limits import (
    ORDERS,
    SECONDS,
    MotionLimit,
    StateConstraint,
)
from echelon.excite.problem.trajectory import Basis
from echelon.shared import Floats

GRID_PER_PERIOD = 20
"""Constrained samples per period of the highest frequency: between them a sine rises by 1.2 % of its amplitude."""

SMALLEST_SIZE = 0.1
"""Size, SI units, of a limit that has one end only and it next to zero: a tenth of a metre, a newton metre."""

HALVINGS = 16
"""Halvings of a step, or of a motion about its centre, after which nothing is left of it."""


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
    ends: Interval | None = (
        None  # least and largest values of all limits, tighter than their own; their own if omitted
    )

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
        """Samples at which limits are kept, s."""
        count = int(
            np.ceil(GRID_PER_PERIOD * self.basis.frequency * self.basis.duration)
        )
        return np.linspace(0.0, self.basis.duration, count + 1)

    @cached_property
    def phi(self) -> Floats:
        """Derivatives of the basis at the grid, orders 0 to 3, shape (T, 4, basis.size)."""
        return np.stack(
            [self.basis.values(self.grid, order) for order in range(len(ORDERS))],
            axis=1,
        )

    @cached_property
    def at_rest(self) -> Floats:
        """Coefficients of resting at the centre, shape (size,)."""
        ones = np.linalg.lstsq(self.phi[:, 0], np.ones(len(self.grid)), rcond=None)[0]
        return np.outer(ones, self.centre).ravel()

    def scaled(self, x: Floats, share: float) -> Floats:
        """The motion made smaller about the centre."""
        return self.at_rest + share * (x - self.at_rest)

    @cached_property
    def seconds_per_step(self) -> float:
        """Work of a step of a solver, about what a processor takes for it, s: the same on every machine."""
        samples, (functions, n), limits = len(self.grid), self.shape, len(self.low)
        products = samples * (
            limits * (len(ORDERS) * n) ** 2 + (len(ORDERS) * functions * n) ** 2
        )
        seen = self.information.size * SECONDS.information
        return (
            products * SECONDS.product
            + seen
            + samples * sum(c.seconds for c in self.constraints)
        )

    # -- criterion -------------------------------------------------------------------------------------------------

    def value(self, x: Floats) -> float:
        """The criterion."""
        return self.value_and_gradient(x)[0]

    def value_and_gradient(self, x: Floats) -> tuple[float, Callable[[], Floats]]:
        """The criterion, and what gives its derivatives, shape (size,)."""
        found = self.information(x.reshape(self.shape))
        value, slope = self.criterion.evaluate(found.F)
        return value, lambda: found.gradient(slope).ravel()

    # -- limits ----------------------------------------------------------------------------------------------------

    def states(self, x: Floats) -> Floats:
        """Positions and their derivatives at the grid, shape (T, 4, n)."""
        return self.phi @ x.reshape(self.shape)

    def values(self, x: Floats) -> Floats:
        """Values of all limits at the grid, shape (T, M)."""
        state = self.states(x)
        moved = np.tensordot(state, self._motion_slopes, axes=([1, 2], [1, 2]))
        return np.hstack(
            [
                moved,
                *(
                    c.values(state[:, 0], state[:, 1], state[:, 2])
                    for c in self.constraints
                ),
            ]
        )

    def slopes(self, x: Floats) -> Floats:
        """Derivatives of the values by the derivatives of the positions, shape (T, M, 4, n)."""
        state = self.states(x)
        found = np.zeros((len(state), len(self.low), len(ORDERS), self.count))
        first = len(self.limits)
        found[:, :first] = self._motion_slopes
        for constraint in self.constraints:
            last = first + len(constraint.labels)
            for order, part in enumerate(
                constraint.slopes(state[:, 0], state[:, 1], state[:, 2])
            ):
                if part is not None:
                    found[:, first:last, order] = part
            first = last
        return found

    def slacks(self, values: Floats) -> Floats:
        """Room below and above values of shape (T, M), relative to each limit's size, shape (2, T, M)."""
        return np.stack([values - self.low, self.high - values]) / self.sizes

    def room(self, x: Floats) -> float:
        """The smallest room that any limit leaves at the samples, relative to its size; negative if it is broken."""
        return float(self.slacks(self.values(x)).min(initial=np.inf))

    @property
    def low(self) -> Floats:
        """Least values of all limits, shape (M,)."""
        return self._ends[0]

    @property
    def high(self) -> Floats:
        """Largest values of all limits, shape (M,)."""
        return self._ends[1]

    @cached_property
    def sizes(self) -> Floats:
        """Ranges of the limits; sizes of those that have one end only, shape (M,)."""
        span = self.high - self.low
        ends = np.stack([self.low, self.high])
        one_end = np.abs(np.where(np.isfinite(ends), ends, 0.0)).max(axis=0)
        return np.where(np.isfinite(span), span, np.maximum(one_end, SMALLEST_SIZE))

    @cached_property
    def _ends(self) -> Interval:
        if self.ends is not None:
            return self.ends
        own = [
            np.array([limit.low for limit in self.limits]),
            np.array([limit.high for limit in self.limits]),
        ]
        low = np.concatenate([own[0], *(c.low for c in self.constraints)])
        return low, np.concatenate([own[1], *(c.high for c in self.constraints)])

    @cached_property
    def _motion_slopes(self) -> Floats:
        """Derivatives of the limits of the motion, shape (limits, 4, n)."""
        found = np.zeros((len(self.limits), len(ORDERS), self.count))
        for row, limit in enumerate(self.limits):
            found[row, limit.order] = limit.weights
        return found

    def tightened(self, below: Floats, above: Floats) -> Problem:
        """The problem whose limits' least values rise, and largest ones fall, by some amounts, each of shape (M,)."""
        return replace(self, ends=(self.low + below, self.high - above))

    # -- sums over samples -------------------------------------------------------------------------------------------

    def gathered(self, slopes: Floats, weights: Floats) -> Floats:
        """Derivatives of Σ weights · values by the coefficients, weights of shape (T, M)."""
        by_state = np.einsum("tm,tmoj->toj", weights, slopes)
        found: Floats = np.einsum("tob,toj->bj", self.phi, by_state)
        return found.ravel()

    def along(self, slopes: Floats, step: Floats) -> Floats:
        """Changes of the values with a step of the coefficients, shape (T, M)."""
        found: Floats = np.einsum("tmoj,toj->tm", slopes, self.states(step))
        return found

    def curvature(self, slopes: Floats, weights: Floats) -> Floats:
        """Σ weights · J Jᵀ with the derivatives J of the values by the coefficients, shape (size, size)."""
        samples, limits, orders, n = slopes.shape
        flat = slopes.reshape(samples, limits, -1)
        by_state = (flat * weights[..., None]).transpose(0, 2, 1) @ flat
        by_state = by_state.reshape(samples, orders, n, orders, n)
        b = self.basis.size
        total = np.zeros((b * b, n * n))
        for first in range(orders):
            for second in range(orders):
                functions = self.phi[:, first, :, None] * self.phi[:, second, None, :]
                total += functions.reshape(samples, -1).T @ by_state[
                    :, first, :, second
                ].reshape(samples, -1)
        return (
            total.reshape(b, b, n, n)
            .transpose(0, 2, 1, 3)
            .reshape(self.size, self.size)
        )

    # -- starting points -------------------------------------------------------------------------------------------

    def random(self, rng: np.random.Generator) -> Floats:
        """A random motion about the centre, as large as limits let it be."""
        away = np.zeros(self.shape)
        for j in range(self.count):
            # each coordinate by itself first, so that the tightest limit does not keep all others small
            alone = np.zeros(self.shape)
            alone[:, j] = rng.normal(size=len(alone))
            away += self._share_of_motion(alone.ravel()) * alone
        step = away.ravel()
        return self.inside(self.at_rest + min(self._share_of_motion(step), 1.0) * step)

    def _share_of_motion(self, step: Floats) -> float:
        """The largest multiple of a motion about the centre that the limits of the motion leave."""
        limits = slice(len(self.limits))
        still = np.tensordot(
            self.states(self.at_rest), self._motion_slopes, axes=([1, 2], [1, 2])
        )
        moved = np.tensordot(
            self.states(step), self._motion_slopes, axes=([1, 2], [1, 2])
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            below = (self.low[limits] - still) / moved
            above = (self.high[limits] - still) / moved
            room = np.where(moved > 0, above, np.where(moved < 0, below, np.inf))
        return max(float(room.min(initial=np.inf)), 0.0)

    def inside(self, x: Floats, room: float = 0.0) -> Floats:
        """The motion, halved about the centre until every limit leaves some room at the samples."""
        for _ in range(HALVINGS):
            if self.room(x) > room:
                break
            x = self.scaled(x, 0.5)
        return x
