"""Rows of recorded forms in ball arithmetic, at stated values of the symbols and random exact states."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from echelon.arrays import Floats
from echelon.base.ball_tables import Balls
from echelon.exact.polynomial import generator_values
from echelon.program.arithmetics import BallArithmetic, ball, stated_ball
from echelon.program.schedule import Schedule, StagedSchedule
from echelon.regressor.linear_forms import LinearForms
from echelon.regressor.loops.closed_balls import BALL_STEPS, closed_states, random_balls


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
    poses: Floats | None = None,
) -> Balls:
    """Entries of forms at random states, in all regions of signs.

    With loops these are some motions, perhaps from rest, through each of some random poses, or of the given ones in
    double precision.
    """
    if forms.loops is None:
        schedule = Schedule(forms.program, list(forms.entries.values()))
        return _table(forms, schedule, _free_states(forms, schedule, at, states, rng), states)
    poses = forms.loops.poses(rng, -(-states // motions)) if poses is None else poses
    leaves = closed_states(forms.loops, [at], poses).leaves(forms.schedule, rng, motions, at_rest=at_rest)
    return _table(forms, forms.schedule.moving, leaves, len(poses) * motions)


def rows_at_values(
    forms: LinearForms, at: Sequence[Mapping[str, str]], poses: Floats, rng: np.random.Generator, motions: int
) -> list[Balls]:
    """Entries of forms of mechanisms with loops at each of some values of the symbols: one table for each.

    They are those of some motions through closed poses next to the given ones, shape (poses, positions).
    """
    assert forms.loops is not None
    states = len(at) * len(poses) * motions
    leaves = closed_states(forms.loops, at, poses).leaves(forms.schedule, rng, motions)
    table = _table(forms, forms.schedule.moving, leaves, states)
    split = table.reshape(motions, len(at), len(poses) * forms.shape[0], forms.shape[1])
    return [split[:, k].reshape(-1, forms.shape[1]) for k in range(len(at))]


def _table(forms: LinearForms, schedule: Schedule, leaves: Mapping[int, Balls], states: int) -> Balls:
    """All entries at some states, (states · rows, columns)."""
    found = schedule.run(BallArithmetic(), leaves, states)
    table = np.full((states, *forms.shape), flint.arb(0), dtype=object)
    for (row, column), value in zip(forms.entries, found, strict=True):
        table[:, row, column] = value
    return _of_one_size(table.reshape(states * forms.shape[0], forms.shape[1]))


def _of_one_size(table: Balls) -> Balls:
    """Rows divided by powers of two, so that their largest entries are alike at all speeds."""
    for row in table:
        largest = max((x.abs_upper() for x in row), default=flint.arb(0))
        if largest > 0:
            mantissa, exponent = largest.mid().man_exp()
            row /= flint.arb(2) ** (int(exponent) + int(mantissa).bit_length())
    return table


def ball_values(forms: LinearForms, nodes: Sequence[int], at: Mapping[str, str], rng: np.random.Generator) -> Balls:
    """Values of nodes of the forms' program at one random state, shape (nodes,)."""
    if forms.loops is None:
        schedule = Schedule(forms.program, nodes)
        leaves = _free_states(forms, schedule, at, 1, rng)
    else:
        staged = StagedSchedule(forms.program, nodes)
        closed = closed_states(forms.loops, [at], forms.loops.poses(rng, 1))
        leaves, schedule = closed.leaves(staged, rng), staged.moving
    found: Balls = schedule.run(BallArithmetic(), leaves, 1)[:, 0]
    return found


def _free_states(
    forms: LinearForms, schedule: Schedule, at: Mapping[str, str], states: int, rng: np.random.Generator
) -> dict[int, Balls]:
    program = forms.program
    reals = forms.sampler().real_states(rng, states)
    leaves: dict[int, Balls] = {}
    for node in schedule.leaves:
        given = program.inputs[node]
        if given.role == "symbol" and given.name in at:
            leaves[node] = np.array([stated_ball(at[given.name])] * states, dtype=object)
        elif given.name in reals:
            leaves[node] = np.array([ball(float(x)) for x in reals[given.name]], dtype=object)
        elif given.role == "symbol":
            leaves[node] = np.array([ball(int(rng.integers(2, 1000)))] * states, dtype=object)
        else:
            leaves[node] = random_balls(rng, (states,))
    for group in program.unit_groups:
        if not reals.keys().isdisjoint(program.inputs[node].name for node in group):
            leaves |= _unit_length({node: leaves[node] for node in group if node in leaves})
            continue
        points = np.array([_sphere(rng, len(group)) for _ in range(states)], dtype=object).T
        leaves |= {node: point for node, point in zip(group, points, strict=True) if node in leaves}
    return leaves


def _unit_length(parts: Mapping[int, Balls]) -> dict[int, Balls]:
    """Components of quaternions, nearly of unit length, made exactly so."""
    squares = np.sum([part * part for part in parts.values()], axis=0)
    lengths = np.array([square.sqrt() for square in squares], dtype=object)
    return {node: part / lengths for node, part in parts.items()}


def _sphere(rng: np.random.Generator, size: int) -> list[Any]:
    """A rational point of the unit sphere by stereographic projection."""
    t = [Fraction(int(n), BALL_STEPS) for n in rng.integers(-2 * BALL_STEPS, 2 * BALL_STEPS, size=size - 1)]
    scale = 1 / (1 + sum(x * x for x in t))
    return [ball((1 - sum(x * x for x in t)) * scale), *(ball(2 * x * scale) for x in t)]
