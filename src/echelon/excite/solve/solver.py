"""The solver: a primal-dual interior point method whose iterates keep all limits, with exact gradients.

A motion has some dozen to some hundred coefficients and thousands of limits at samples, most of which never bind.  The
limits' part of a Newton step is a sum over samples of small matrices (:meth:`Problem.curvature`), so thousands of
limits cost hardly more than a few, and the linear systems are as small as the motion.  The criterion's curvature is
learned from its gradients (damped BFGS; J. Nocedal, S. Wright, Numerical Optimization, 2006, chapters 18 and 19).

Steps end before the first limit, and a start keeps all of them.  So every iterate is a motion that keeps its limits at
the samples, and the search can end at any of them: out of work, or because somebody asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from echelon.excite.problem.optimisation import HALVINGS, Problem
from echelon.shared import Floats, one_thread


@dataclass(frozen=True)
class InteriorPoint:
    """Parameters of the method."""

    first_barrier: float = 0.1
    """Weight of the barrier at first, over the root of the number of limits at all samples."""
    barrier_fall: float = 0.15
    """Share of the mean complementarity that the next barrier has: a fall by a factor of 7 at most."""
    last_barrier: float = 1e-9
    """Weight below which the barrier does not fall: it no longer changes any digit that is shown."""
    short_step: float = 0.3
    """Share of a step below which the barrier does not fall yet: limits are in the way."""
    to_the_limit: float = 0.9
    """Share of the way to the first limit that a step goes at most; the rest of the room is left."""
    dual_spread: float = 5.0
    """Factor by which a multiplier may differ from the barrier's own, weight / room."""
    descent: float = 1e-4
    """Share of the promised decrease that a step has to keep (Armijo)."""
    damping: float = 0.2
    """Share of the old curvature along a step that the new one keeps (Powell)."""
    tolerance: float = 5e-3
    """Decrease of the criterion, a logarithm, that counts as none: deviations then differ by 0.25 %."""
    patience: int = 15
    """Steps within which the criterion has to fall by the tolerance."""
    resets: int = 3
    """Times that the learned curvature is forgotten, one after the other, until a search is at its end."""


METHOD = InteriorPoint()


@dataclass
class Watch:
    """Work that is left to a search, whether it is to stop, and who is told how far it is."""

    seconds: (
        float  # of work, counted by :attr:`Problem.seconds_per_step` and not by a clock
    )
    stopped: Callable[[], bool] = bool
    tell: Callable[[str], object] = str

    @property
    def ended(self) -> str:
        """The reason to end, ``"stopped"`` or ``"budget"``; empty if there is none."""
        if self.stopped():
            return "stopped"
        return "" if self.seconds > 0 else "budget"

    def share(self, part: float) -> Watch:
        """A watch with a part of the work that is left."""
        return Watch(self.seconds * part, self.stopped, self.tell)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The result of one search."""

    x: Floats  # the best coefficients, which keep all limits at the samples
    value: float  # their criterion
    status: str  # ``"converged"``, ``"stalled"``, ``"iterations"``, ``"budget"`` or ``"stopped"``
    iterations: int
    history: tuple[
        float, ...
    ]  # the criterion of the best motion so far, each time it became better: descending


@dataclass(frozen=True, eq=False)
class _Iterate:
    """A motion with everything that a step needs."""

    problem: Problem
    x: Floats
    value: float
    gradient: Floats  # shape (size,)
    slopes: Floats  # shape (T, M, 4, n); see :meth:`Problem.slopes`
    slacks: Floats  # shape (2, T, M); see :meth:`Problem.slacks`

    @classmethod
    def at(cls, problem: Problem, x: Floats, slacks: Floats) -> _Iterate:
        """The iterate at coefficients whose slacks are known."""
        value, gradient = problem.value_and_gradient(x)
        return cls(problem, x, value, gradient(), problem.slopes(x), slacks)

    def pushed(self, weights: Floats) -> Floats:
        """Derivatives of −Σ weights · slacks by the coefficients, weights of shape (2, T, M)."""
        return self.problem.gathered(
            self.slopes, (weights[1] - weights[0]) / self.problem.sizes
        )

    def barrier(self, weight: float) -> float:
        """The criterion with −weight · log of all slacks."""
        return _barrier(self.value, self.slacks, weight)


def _barrier(value: float, slacks: Floats, weight: float) -> float:
    return value - weight * float(np.log(slacks[np.isfinite(slacks)]).sum())


@dataclass
class Search:
    """A search for the least criterion: where it is, its multipliers, and the curvature learned so far."""

    now: _Iterate
    weight: float  # of the barrier
    duals: Floats  # shape (2, T, M)
    curvature: Floats  # shape (size, size)
    resets: int = 0
    best: Floats = field(default_factory=lambda: np.zeros(0))
    status: str = ""  # see :attr:`SearchResult.status`; empty while it goes on
    history: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)  # of all steps

    @classmethod
    def from_start(cls, problem: Problem, start: Floats) -> Search | None:
        """The search from a motion that keeps all limits at the samples; None if it does not."""
        slacks = problem.slacks(problem.values(start))
        if not np.all(slacks > 0):
            return None
        now = _Iterate.at(problem, start, slacks)
        weight = METHOD.first_barrier / np.sqrt(max(slacks[0].size, 1))
        steepness = max(
            float(np.linalg.norm(now.gradient)) / np.sqrt(problem.size), 1e-3
        )
        search = cls(now, weight, weight / slacks, steepness * np.eye(problem.size))
        search._remember()
        return search

    @property
    def solution(self) -> SearchResult:
        """The best motion so far."""
        return SearchResult(
            self.best,
            self.history[-1],
            self.status,
            len(self.values) - 1,
            tuple(self.history),
        )

    def run(self, most: int, watch: Watch, name: str) -> Search:
        """Go on until a number of steps is reached, or something else ends the search."""
        # matrices are small: threads that wait for each other cost more than they bring, and the order of additions is
        # the same wherever it runs
        with one_thread():
            self.status = watch.ended or (
                "" if len(self.values) <= most else "iterations"
            )
            while not self.status:
                watch.seconds -= self.now.problem.seconds_per_step
                moved = self.advance()
                steps = len(self.values) - 1
                if self.converged:
                    self.status = "converged"
                elif not moved:
                    self.status = "stalled"
                else:
                    self.status = watch.ended or ("iterations" if steps >= most else "")
                room = float(self.now.slacks.min(initial=np.inf))
                watch.tell(
                    f"{name}: step {steps}, criterion {self.history[-1]:.4g}, smallest room {room:.2%}"
                )
        return self

    @property
    def converged(self) -> bool:
        """Whether the criterion falls no more."""
        patience = METHOD.patience
        return (
            len(self.values) > patience
            and self.values[-1 - patience] - self.values[-1] < METHOD.tolerance
        )

    def advance(self) -> bool:
        """Take a step; False if there is none."""
        step, changes = self._direction()
        reached = self._searched(step, changes)
        if reached is None:
            return self._reset()
        share, slacks = reached
        last, problem = self.now, self.now.problem
        self.now = _Iterate.at(problem, last.x + share * step, slacks)
        self._update_duals(last, changes)
        self._learn(last)
        self._remember()
        self.resets = 0
        if share > METHOD.short_step:
            finite = np.isfinite(slacks)
            mean = (
                float((self.duals[finite] * slacks[finite]).mean())
                if finite.any()
                else 0.0
            )
            self.weight = max(
                min(self.weight, METHOD.barrier_fall * mean), METHOD.last_barrier
            )
        return True

    def _direction(self) -> tuple[Floats, Floats]:
        """The Newton step of the barrier problem, and by how much it changes the slacks, shape (2, T, M)."""
        now, problem = self.now, self.now.problem
        weights = (self.duals / now.slacks).sum(axis=0) / problem.sizes**2
        curvature = self.curvature + problem.curvature(now.slopes, weights)
        slope = self._slope()
        step = np.asarray(-np.linalg.solve(curvature, slope), dtype=np.float64)
        change = problem.along(now.slopes, step) / problem.sizes
        return step, np.stack([change, -change])

    def _slope(self) -> Floats:
        return self.now.gradient + self.now.pushed(self.weight / self.now.slacks)

    def _searched(self, step: Floats, changes: Floats) -> tuple[float, Floats] | None:
        """The share of a step that keeps all limits and lowers the barrier function, and the slacks there."""
        now, problem = self.now, self.now.problem
        falling = changes < 0
        share = min(
            1.0,
            METHOD.to_the_limit
            * float((now.slacks[falling] / -changes[falling]).min(initial=np.inf)),
        )
        before, promised = now.barrier(self.weight), float(self._slope() @ step)
        for _ in range(HALVINGS):
            x = now.x + share * step
            slacks = problem.slacks(problem.values(x))
            if np.all(slacks >= (1 - METHOD.to_the_limit) * now.slacks):
                after = _barrier(problem.value(x), slacks, self.weight)
                if after <= before + METHOD.descent * share * promised:
                    return share, slacks
            share /= 2
        return None

    def _reset(self) -> bool:
        """Forget the curvature, and lower the barrier; False if that was done before."""
        self.resets += 1
        size = len(self.curvature)
        self.curvature = np.trace(self.curvature) / size * np.eye(size)
        self.weight = max(METHOD.barrier_fall * self.weight, METHOD.last_barrier)
        self.duals = self.weight / self.now.slacks
        return self.resets < METHOD.resets

    def _update_duals(self, last: _Iterate, changes: Floats) -> None:
        wanted = (self.weight - self.duals * changes) / last.slacks
        falls = self.duals - wanted
        falling = falls > 0
        share = min(
            1.0,
            METHOD.to_the_limit
            * float((self.duals[falling] / falls[falling]).min(initial=np.inf)),
        )
        own = self.weight / self.now.slacks
        self.duals = np.clip(
            self.duals - share * falls,
            own / METHOD.dual_spread,
            own * METHOD.dual_spread,
        )

    def _learn(self, last: _Iterate) -> None:
        """Update the curvature of the Lagrangian by the change of its gradient (damped BFGS)."""
        moved = self.now.x - last.x
        turned = (
            self.now.gradient
            - last.gradient
            + self.now.pushed(self.duals)
            - last.pushed(self.duals)
        )
        if len(self.values) == 1 and turned @ moved > 0:
            self.curvature = (turned @ turned) / (turned @ moved) * np.eye(len(moved))
        old = self.curvature @ moved
        along, bend = float(moved @ old), float(turned @ moved)
        if bend < METHOD.damping * along:
            mixed = (1 - METHOD.damping) * along / (along - bend)
            turned = mixed * turned + (1 - mixed) * old
        rise = np.outer(turned, turned) / float(turned @ moved)
        self.curvature = self.curvature - np.outer(old, old) / along + rise

    def _remember(self) -> None:
        self.values.append(self.now.value)
        if not self.history or self.now.value < self.history[-1]:
            self.best = self.now.x
            self.history.append(self.now.value)
