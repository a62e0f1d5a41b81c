"""Check of the columns of B that are numbers, at the stated values of the symbols.

Exact numbers are checked modulo random primes, others in ball arithmetic: what X = X̄ B leaves is bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf, log10
from typing import Any

import numpy as np

from echelon.base.ball_rows import ball_rows, precision
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.errors import CertificateError, DegenerateSampleError
from echelon.exact.field import ARRAY_BITS, CERTIFICATE_BITS, PrimeField
from echelon.exact.numbers import Number
from echelon.program.balls import ball
from echelon.program.sampling import FieldSampler
from echelon.regressor.linear import LinearForms

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
