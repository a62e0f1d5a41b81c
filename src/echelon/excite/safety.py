"""Making an optimised trajectory safe: what was asked for at samples is made to hold at every time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.excite.constraints.narrowed import narrowed
from echelon.excite.design import Design
from echelon.excite.lazy import Solution, solve_lazily
from echelon.excite.margins import Margin
from echelon.excite.problem import Problem
from echelon.excite.solver import SolverOptions
from echelon.excite.verification import margins_of, motion_margins

Floats = npt.NDArray[np.float64]

_ROUNDS = 5
_MORE = 1.5  # a limit is drawn in by so many times what it was broken by
_LITTLE = 1e-4  # of a motion that is given up to be on the safe side
_BACK = 0.98  # share of a motion that keeps tighter limits, from which the next one starts
_ITERATIONS = 100  # of a solver that starts next to its goal


def safe(design: Design, solutions: Sequence[Solution]) -> tuple[Floats, list[Margin]]:
    """The best solution, changed so that every limit holds at every time, and the margins.

    Parameters
    ----------
    design : Design
    solutions : sequence of Solution
        That keep the limits at samples.

    Raises
    ------
    InputError
        If no trajectory keeps all limits; names those that are broken.
    """
    problem, worst = design.problem, ""
    for solution in sorted(solutions, key=lambda s: s.value):
        x: Floats | None = solution.x
        for _ in range(_ROUNDS):
            if x is None:
                break
            x = _within(problem, x, design)
            margins = margins_of(design.trajectory(x), design.task)
            broken = [margin for margin in margins if not margin.kept]
            if not broken:
                return x, margins
            worst = ", ".join(margin.label for margin in broken[:6])
            problem = _drawn_in(problem, margins, design)
            x = solve_lazily(problem, problem.shrunk(x, _BACK), SolverOptions(iterations=_ITERATIONS), x).x
        problem = design.problem
    reason = f"the limits of {worst} are broken between samples" if worst else "no start found a motion that keeps them"
    raise InputError(f"no trajectory keeps all limits: {reason}", source=design.task.setup.source, element="excitation")


def _within(problem: Problem, x: Floats, design: Design) -> Floats:
    """The motion drawn towards its centre by the little that limits of the motion are exceeded between samples."""
    rest = problem.at_rest.ravel()
    still = motion_margins(design.trajectory(rest), design.task.limits.motion)
    for _ in range(_ROUNDS):  # bounds are wider than what is reached by less than what is added each time
        share = min(map(_share, still, motion_margins(design.trajectory(x), design.task.limits.motion)), default=1.0)
        if share >= 1:
            break
        x = rest + (share - _LITTLE) * (x - rest)
    return x


def _share(still: Margin, moving: Margin) -> float:
    """How much of a motion about a pose a limit leaves."""
    ends = (
        (still.high - still.largest, moving.largest - still.largest),
        (still.least - still.low, still.least - moving.least),
    )
    return min((max(room, 0.0) / reached for room, reached in ends if reached > room), default=1.0)


def _drawn_in(problem: Problem, margins: Sequence[Margin], design: Design) -> Problem:
    """The problem with tighter limits where they were broken."""
    states = list(margins[len(design.task.limits.motion) :])
    constraints = []
    for constraint in problem.constraints:
        own, states = states[: len(constraint.labels)], states[len(constraint.labels) :]
        below = _MORE * np.array([max(m.low - m.least, 0.0) if m.low > -inf else 0.0 for m in own])
        above = _MORE * np.array([max(m.largest - m.high, 0.0) if m.high < inf else 0.0 for m in own])
        constraints.append(narrowed(constraint, below, above))
    return replace(problem, constraints=tuple(constraints))
