"""Rows of recorded forms in ball arithmetic, at stated values of the symbols and random exact states.

The columns of B that are numbers are checked at the stated values of the symbols.  Exact numbers are checked modulo
random primes, others in ball arithmetic: what X = X̄ B leaves is bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from math import inf, log10
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.errors import CertificateError, DegenerateSampleError, InputError
from echelon.exact.expressions import PI, parse
from echelon.exact.field import ARRAY_BITS, CERTIFICATE_BITS, PrimeField
from echelon.exact.numbers import Number
from echelon.exact.polynomial import is_trigonometric, multiple_of, symbol_of
from echelon.program.balls import BallArithmetic, ball
from echelon.program.sampling import FieldSampler
from echelon.program.schedule import Schedule
from echelon.regressor.linear import LinearForms
from echelon.regressor.loops.closed_balls import ClosedBalls

Balls = npt.NDArray[Any]
"""Array of ``arb``."""

_STEPS = 256


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """FLINT's precision for a while."""
    before = flint.ctx.prec
    flint.ctx.prec = bits
    try:
        yield
    finally:
        flint.ctx.prec = before


def stated_ball(text: str) -> Any:
    """The ball of a stated value, at the precision of FLINT's context."""
    return parse(text).evaluate({PI: flint.arb.pi()}, ball)


def stated_generators(generators: Iterable[str], at: Mapping[str, str]) -> dict[str, Any]:
    """Balls of symbols, and of sines and cosines of angles, at stated values."""
    found = {}
    for generator in generators:
        value = stated_ball(at[symbol_of(generator)])
        if is_trigonometric(generator):
            value = value * multiple_of(generator)[0]
            value = value.cos() if generator.startswith("cos(") else value.sin()
        found[generator] = value
    return found


def ball_rows(
    forms: LinearForms, at: Mapping[str, str], states: int, rng: np.random.Generator, motions: int = 1
) -> Balls:
    """Entries of forms at random states."""
    schedule = Schedule(forms.program, list(forms.entries.values()))
    if forms.loops is None:
        leaves = _free_states(forms, schedule, at, states, rng)
    else:
        leaves = _closed_states(forms, schedule, at, -(-states // motions), rng, motions)
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
            leaves[node] = np.array(_random(rng, states), dtype=object)
    for group in program.unit_groups:
        points = np.array([_sphere(rng, len(group)) for _ in range(states)], dtype=object).T
        leaves |= {node: point for node, point in zip(group, points, strict=True) if node in leaves}
    return leaves


def _closed_states(
    forms: LinearForms, schedule: Schedule, at: Mapping[str, str], poses: int, rng: np.random.Generator, motions: int
) -> dict[int, Balls]:
    loops, inputs = forms.loops, forms.program.inputs.values()
    if loops is None or loops.real is None:
        raise InputError("no real states are known on which the loops close")
    real = loops.real(rng, poses)
    names = [given.name for given in inputs if given.role == "symbol"]
    symbols = {name: stated_ball(at[name]) if name in at else ball(float(real[name][0])) for name in names}
    closed = ClosedBalls(forms.program, loops, symbols)
    near = [{name: float(x[k]) for name, x in real.items()} for k in range(poses)]
    found = [leaves for pose in near for leaves in closed.leaves(schedule, pose, rng, motions)]
    return {node: np.array([leaves[node] for leaves in found], dtype=object) for node in schedule.leaves}


def _random(rng: np.random.Generator, count: int) -> list[Any]:
    return [ball(Fraction(int(n), _STEPS)) for n in rng.integers(-2 * _STEPS, 2 * _STEPS, size=count)]


def _sphere(rng: np.random.Generator, size: int) -> list[Any]:
    """A rational point of the unit sphere by stereographic projection."""
    t = [Fraction(int(n), _STEPS) for n in rng.integers(-2 * _STEPS, 2 * _STEPS, size=size - 1)]
    scale = 1 / (1 + sum(x * x for x in t))
    return [ball((1 - sum(x * x for x in t)) * scale), *(ball(2 * x * scale) for x in t)]


_BITS = 512
_POINTS, _BALL_STATES = 2, 8
_ATTEMPTS = 64
_LOOSEST = 1e-30
"""The largest error of a coefficient, beside the largest coefficient, with which a check means anything."""


def check_stated(regressor: LinearForms, matrix: BaseMatrix, rng: np.random.Generator) -> float:
    """Check X = X̄ B in the columns that are numbers."""
    numbers = matrix.numbers
    if numbers is None or not numbers.columns:
        return -inf
    sizes = [abs(x) for column in _combinations(matrix, numbers, float).values() for _, x in column]
    if not numbers.radius <= _LOOSEST * max(1.0, *sizes):
        raise CertificateError(f"numbers with errors of {numbers.radius:.0e} prove nothing")
    sampler = regressor.sampler()
    if numbers.radius == 0:
        for _ in range(_POINTS):
            _check_exactly(regressor, matrix, numbers, sampler, rng)
        return -inf
    return _check_in_balls(regressor, matrix, numbers, rng)


def _check_exactly(
    regressor: LinearForms,
    matrix: BaseMatrix,
    numbers: StatedNumbers,
    sampler: FieldSampler,
    rng: np.random.Generator,
) -> None:
    values = numbers.exact(sampler.angles)
    if values is None:
        raise CertificateError("numbers at angles without exact sines cannot be exact")
    states = sampler.regions
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, CERTIFICATE_BITS if regressor.loops is None else ARRAY_BITS)
        try:
            # symbols that do not matter to these columns have any value
            symbols = {s: np.array([field.embed(v)], dtype=field.dtype) for s, v in values.items()}
            symbols |= {s: field.draw(rng, (1,)) for s in sampler.symbols if s not in symbols}
            sampled = sampler.evaluate(field, rng, states, symbols)[:, 0]
            combinations = _combinations(matrix, numbers, field.embed)
        except DegenerateSampleError:
            continue
        for k in range(states):
            known = _by_column((key, int(value[k])) for key, value in zip(regressor.entries, sampled, strict=True))
            for column in numbers.columns:
                if any(x % field.p for x in _left_over(column, known, combinations)):
                    raise _refuted(matrix, column)
        return
    raise CertificateError("every random point is singular at the stated values")


def _check_in_balls(
    regressor: LinearForms, matrix: BaseMatrix, numbers: StatedNumbers, rng: np.random.Generator
) -> float:
    with precision(_BITS):
        rows = ball_rows(regressor, numbers.at, _BALL_STATES, rng)
        combinations = _combinations(matrix, numbers, ball)
        largest = max(1.0, max(_size(x) for x in rows.ravel()))
        allowed = numbers.radius * largest * (matrix.rank + 1)
        worst = 0.0
        for row in rows:
            known = _by_column(((0, column), value) for column, value in enumerate(row))
            for column in numbers.columns:
                left = max(map(_size, _left_over(column, known, combinations)), default=0.0)
                if not left <= allowed:
                    raise _refuted(matrix, column)
                worst = max(worst, left / largest)
    return log10(worst) if worst else -inf


def _combinations(
    matrix: BaseMatrix, numbers: StatedNumbers, embed: Callable[[Number], Any]
) -> dict[int, list[tuple[int, Any]]]:
    """For every column that is numbers, its pivots and coefficients."""
    found: dict[int, list[tuple[int, Any]]] = {column: [] for column in numbers.columns}
    for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
        for column, coefficient in row.items():
            if column in found:
                value = coefficient.numerator.number if coefficient.is_polynomial else None
                if value is None:
                    raise CertificateError(f"the coefficient of {matrix.parameters[column]} is not a number")
                found[column].append((pivot, embed(value)))
    return found


def _by_column(entries: Iterable[tuple[tuple[int, int], Any]]) -> dict[int, dict[int, Any]]:
    found: dict[int, dict[int, Any]] = {}
    for (row, column), value in entries:
        found.setdefault(column, {})[row] = value
    return found


def _left_over(
    column: int, known: Mapping[int, Mapping[int, Any]], combinations: Mapping[int, Sequence[tuple[int, Any]]]
) -> list[Any]:
    """What X = X̄ B leaves of a column, row by row of X."""
    left = dict(known.get(column, {}))
    for pivot, factor in combinations[column]:
        for row, value in known.get(pivot, {}).items():
            left[row] = left.get(row, 0) - factor * value
    return list(left.values())


def _size(x: Any) -> float:
    return float(abs(x).upper())


def _refuted(matrix: BaseMatrix, column: int) -> CertificateError:
    name = matrix.parameters[column]
    return CertificateError(f"the set is wrong at the stated values: it does not reproduce the effect of {name}")
