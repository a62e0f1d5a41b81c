"""Making an optimised trajectory safe: limits that hold at samples are made to hold at every time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from math import isfinite

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.problem.optimisation import Problem
from echelon.excite.solve.design import Design
from echelon.excite.solve.solver import Solution, SolverOptions, constraint_generation
from echelon.excite.verify import margins_of
from echelon.excite.verify.margins import Margin, motion_margins

_ROUNDS = 5
_MORE = 1.5  # times what a limit was broken by, by which it is tightened
_LITTLE = 1e-4  # of a motion that is given up to be on the safe side
_LITTLE_LESS = (0.998, 0.99)
"""Shares of a motion that are as good as the whole."""
_MUCH_LESS = (0.97, 0.9, 0.75, 0.5)
"""Shares that are better than nothing."""
_BACK = 0.98  # share of a motion that keeps tighter limits, from which the next one starts
_ITERATIONS = 100  # of a solver that starts next to its goal


def safe(design: Design, solutions: Sequence[Solution]) -> tuple[Floats, list[Margin]]:
    """The best solution, changed so that every limit holds at every time, and the margins.

    A slightly smaller motion makes up for what is missing between samples.  Where that costs too much, the broken
    limits are tightened and the search goes on.
    """
    options = SolverOptions(iterations=min(_ITERATIONS, design.task.entry.iterations))
    worst = ""
    for solution in sorted((s for s in solutions if s.x is not None), key=lambda s: s.value):
        problem, x = design.problem, solution.x
        for _ in range(_ROUNDS):
            if x is None:
                break
            found, margins = _smaller(design, x, _LITTLE_LESS)
            broken = [margin for margin in margins if not margin.kept]
            if not broken:
                return found, margins
            worst = ", ".join(margin.label for margin in broken[:6])
            problem = _tightened(problem, margins, design)
            x = constraint_generation(problem, problem.shrunk(x, _BACK), options, x).x
        assert solution.x is not None
        found, margins = _smaller(design, solution.x, _MUCH_LESS)
        if all(margin.kept for margin in margins):
            return found, margins
    reason = f"the limits of {worst} are broken between samples" if worst else "no start found a motion that keeps them"
    raise InputError(f"no trajectory keeps all limits: {reason}", source=design.task.setup.source, element="excitation")


def _smaller(design: Design, x: Floats, shares: Sequence[float]) -> tuple[Floats, list[Margin]]:
    """The largest of some shares of a motion about its centre that keeps all limits, or the whole, and the margins."""
    rest = design.problem.at_rest.ravel()
    whole = _within(design.problem, x, design)
    first = margins_of(design.trajectory(whole), design.task)
    if all(margin.kept for margin in first):
        return whole, first
    for share in shares:
        found = rest + share * (whole - rest)
        margins = margins_of(design.trajectory(found), design.task)
        if all(margin.kept for margin in margins):
            return found, margins
    return whole, first


def _within(problem: Problem, x: Floats, design: Design) -> Floats:
    """The motion made smaller by the little that limits of the motion are exceeded between samples."""
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


def _tightened(problem: Problem, margins: Sequence[Margin], design: Design) -> Problem:
    """The problem with tighter limits where they were broken."""
    states = iter(margins[len(design.task.limits.motion) :])
    below, above = [], []
    for constraint in problem.constraints:
        own = list(islice(states, len(constraint.labels)))
        below.append(_MORE * np.array([_broken_by(m.low - m.least) for m in own]))
        above.append(_MORE * np.array([_broken_by(m.largest - m.high) for m in own]))
    return problem.tightened(below, above)


def _broken_by(beyond: float) -> float:
    """How far a limit is broken; nothing where there is no limit, or where that is not known."""
    return max(beyond, 0.0) if isfinite(beyond) else 0.0
