"""Which claimed rows depend on others, and which base parameters none of them sees.

Both are questions about K, the claimed coefficients at the pivots of B: its row rank and its column rank.  They are
decided modulo a 61-bit prime at random geometry; where claims hold only at the robot's lengths and to their printed
digits, by elimination in floats with that precision.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.base.matrix import BaseMatrix, residue, residues_of_generators
from echelon.claims.compare import Geometry, Row
from echelon.errors import DegenerateSampleError, EchelonError
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField
from echelon.exact.polynomial import symbol_of
from echelon.exact.rational import RationalFunction

_PRIME_BITS = 61
_ATTEMPTS = 8
_NOISE = 1e-9
_ZERO = RationalFunction(0)


@dataclass(frozen=True)
class Span:
    """What claimed rows span of the row space of B."""

    redundant: tuple[int, ...]  # right rows that depend on the right rows before them
    missing: tuple[int, ...]  # rows of B that complete the claimed ones


def span_exactly(rows: Sequence[Row], right: Sequence[int], matrix: BaseMatrix, rng: np.random.Generator) -> Span:
    """The span for generic geometry."""
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, _PRIME_BITS)
        try:
            values = _residues(rows, matrix, field, rng)
        except DegenerateSampleError:
            continue
        independent = reduced_echelon(values[list(right)].T, field)[1]
        return _span(right, independent, reduced_echelon(values, field)[1], matrix)
    raise EchelonError("every random geometry is singular for the claimed coefficients")


def span_roughly(
    rows: Sequence[Row], right: Sequence[int], matrix: BaseMatrix, geometry: Geometry, tolerance: float
) -> Span:
    """The span at the robot's geometry for coefficients that are known to a tolerance."""
    values = np.array([[geometry.roughly(row.get(p, _ZERO)) or 0.0 for p in matrix.pivots] for row in rows])
    values = values.reshape(len(rows), matrix.rank)
    threshold = max(_NOISE, 4 * tolerance)
    independent = _independent(values[list(right)].T, threshold)
    return _span(right, independent, _independent(values, threshold), matrix)


def _span(right: Sequence[int], independent: Sequence[int], seen: Sequence[int], matrix: BaseMatrix) -> Span:
    redundant = set(right) - {right[k] for k in independent}
    return Span(tuple(sorted(redundant)), tuple(k for k in range(matrix.rank) if k not in set(seen)))


def _residues(
    rows: Sequence[Row], matrix: BaseMatrix, field: PrimeField, rng: np.random.Generator
) -> npt.NDArray[np.object_]:
    used = [row[p] for row in rows for p in matrix.pivots if p in row]
    generators = sorted({g for c in used for p in (c.numerator, c.denominator) for g in p.generators()})
    symbols = {name: field.draw(rng, (1,)) for name in sorted({symbol_of(g) for g in generators})}
    known = {g: int(v[0]) for g, v in residues_of_generators(generators, symbols, field).items()}
    values = np.zeros((len(rows), matrix.rank), dtype=object)
    for i, row in enumerate(rows):
        for k, pivot in enumerate(matrix.pivots):
            if pivot in row:
                values[i, k] = residue(row[pivot], known, field)
    return values


def _independent(values: npt.NDArray[np.float64], threshold: float) -> list[int]:
    """Columns that do not depend on the ones before, by modified Gram–Schmidt, applied twice for accuracy."""
    basis: list[npt.NDArray[np.float64]] = []
    chosen = []
    for index, column in enumerate(values.T):
        rest = column.astype(float)
        for direction in basis * 2:
            rest = rest - (direction @ rest) * direction
        size = float(np.linalg.norm(rest))
        if size > threshold * max(1.0, float(np.linalg.norm(column))):
            basis.append(rest / size)
            chosen.append(index)
    return chosen
