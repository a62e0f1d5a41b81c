"""One start with limits that are asked for when they are broken.

Most limits of accelerations, jerks and torques never bind, and every one costs the solver a row at every sample.  So
the first solution knows of positions and velocities only; what it breaks is added, and the search goes on from the best
motion that keeps everything.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from echelon.arrays import Floats
from echelon.excite.problem import BROKEN, Problem
from echelon.excite.solver import Best, SolverOptions, solve
from echelon.machine.threads import one_thread

_ROUNDS = 8
_DRAWN_BACK = (0.99, 0.97, 0.94, 0.9, 0.8, 0.65, 0.5)
"""Shares of a motion that breaks limits, of which the largest that keeps them is worth more than none."""


@dataclass(frozen=True, eq=False)
class Solution:
    """Where a start ended.

    Attributes
    ----------
    x : array, optional
        The best coefficients that kept all limits at the samples; None if none did.
    value : float
        Their criterion.
    status : str
        See :class:`echelon.excite.solver.Ended`.
    iterations : int
    history : tuple of float
        The criterion of the best motion so far, each time it became better: descending.
    """

    x: Floats | None
    value: float
    status: str
    iterations: int
    history: tuple[float, ...]


def solve_lazily(problem: Problem, start: Floats, options: SolverOptions, near: Floats | None = None) -> Solution:
    """Minimise from one starting point.

    Parameters
    ----------
    problem : Problem
    start : array of shape (problem.size,)
    options : SolverOptions
    near : array of shape (problem.size,), optional
        A motion next to the goal: limits that it comes near to are asked for from the beginning.

    Notes
    -----
    Linear algebra runs in one thread: matrices are small, threads that wait for each other cost more than they bring,
    and the order of additions is the same wherever it runs.
    """
    with one_thread():
        best = Best(problem)
        start = problem.inside(start)  # the centre keeps all limits, so that there is something to fall back on
        best.offer(start, problem.value(start))
        if near is not None:
            _draw_back(problem, near, best)
        part, iterations, status = problem.first() if near is None else problem.asking(near), 0, ""
        for _ in range(_ROUNDS):
            left = replace(options, iterations=max(options.iterations - iterations, 1))
            ended = solve(part, start, left, best)
            iterations, status = iterations + ended.iterations, ended.status
            _draw_back(problem, ended.x, best)
            more = problem.extended(part, ended.x)
            if more is None or iterations >= options.iterations:
                break
            part = more
            start = problem.shrunk(ended.x, 0.9) if best.x is None else best.x
    return Solution(best.x, best.value, status, iterations, tuple(best.history))


def _draw_back(problem: Problem, x: Floats, best: Best) -> None:
    """Offer the motion drawn towards its centre, if it breaks limits: little may be missing."""
    if problem.violation(x) <= BROKEN:
        return
    for share in _DRAWN_BACK:
        found = problem.shrunk(x, share)
        if problem.violation(found) <= BROKEN:
            best.offer(found, problem.value(found))
            return
