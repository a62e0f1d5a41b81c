"""Rows of recorded forms in ball arithmetic, at stated values of the symbols and random exact states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.exact.polynomial import generator_values
from echelon.program.arithmetics import BallArithmetic, ball, stated_ball
from echelon.program.schedule import Schedule
from echelon.regressor.linear_forms import LinearForms
from echelon.regressor.loops.closed_balls import BALL_STEPS, ClosedBalls, random_balls

Balls = npt.NDArray[Any]
"""Array of ``arb``."""


def stated_generators(generators: Iterable[str], at: Mapping[str, str]) -> dict[str, Any]:
    """Balls of symbols, and of sines and cosines of angles, at stated values."""
    return generator_values(generators, lambda name: stated_ball(at[name]), lambda x, n: ((n * x).cos(), (n * x).sin()))


def ball_rows(
    forms: LinearForms,
    at: Mapping[str, str],
    states: int,
    rng: np.random.Generator,
    motions: int = 1,
    *,
    at_rest: bool = False,
) -> Balls:
    """Entries of forms at random states; with loops there are some motions at each pose, perhaps from rest."""
    schedule = Schedule(forms.program, list(forms.entries.values()))
    if forms.loops is None:
        leaves = _free_states(forms, schedule, at, states, rng)
    else:
        real = forms.loops.real(rng, -(-states // motions))
        leaves = ClosedBalls(forms.program, forms.loops, at, real).leaves(schedule, rng, motions, at_rest=at_rest)
        states = -(-states // motions) * motions
    found = schedule.run(BallArithmetic(), leaves, states)
    table = np.full((states, *forms.shape), flint.arb(0), dtype=object)
    for (row, column), value in zip(forms.entries, found, strict=True):
        table[:, row, column] = value
    return table.reshape(states * forms.shape[0], forms.shape[1])


def _free_states(
    forms: LinearForms, schedule: Schedule, at: Mapping[str, str], states: int, rng: np.random.Generator
) -> dict[int, Balls]:
    program = forms.program
    leaves: dict[int, Balls] = {}
    for node in schedule.leaves:
        given = program.inputs[node]
        if given.role == "symbol":
            text = at[given.name] if given.name in at else str(int(rng.integers(2, 1000)))
            leaves[node] = np.array([stated_ball(text)] * states, dtype=object)
        else:
            leaves[node] = random_balls(rng, (states,))
    for group in program.unit_groups:
        points = np.array([_sphere(rng, len(group)) for _ in range(states)], dtype=object).T
        leaves |= {node: point for node, point in zip(group, points, strict=True) if node in leaves}
    return leaves


def _sphere(rng: np.random.Generator, size: int) -> list[Any]:
    """A rational point of the unit sphere by stereographic projection."""
    t = [Fraction(int(n), BALL_STEPS) for n in rng.integers(-2 * BALL_STEPS, 2 * BALL_STEPS, size=size - 1)]
    scale = 1 / (1 + sum(x * x for x in t))
    return [ball((1 - sum(x * x for x in t)) * scale), *(ball(2 * x * scale) for x in t)]
