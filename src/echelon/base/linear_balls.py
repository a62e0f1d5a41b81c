"""Base parameters of a linear model by ball arithmetic, where relations between its functions are not known.

At random points of the domain, pivots that surely differ from zero prove the rank from below.  What is left is bounded:
that it is zero is not proved, but twice the precision must bound it as much better.  Coefficients are recognised as
rational numbers, or stay decimals with a name.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from echelon.base.matrix import BaseMatrix
from echelon.errors import ClosedFormError
from echelon.exact.elimination import BallEchelon, ball_echelon, recognised
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction
from echelon.models.linear_model import LinearModel
from echelon.program.balls import BallArithmetic, ball
from echelon.program.region import RealPoints
from echelon.program.schedule import Schedule

_BITS, _MOST_BITS, _SURPLUS_ROWS, _DIGITS = 512, 4096, 8, 40
_POINTS_PER_REGION, _DOUBLINGS = 2, 4


@dataclass(frozen=True)
class BallEvidence:
    """What ball arithmetic shows."""

    rank: int  # proved from below
    bits: int  # precision at which the result was confirmed
    rows: int  # rows of X that were eliminated
    log10_residual: float  # decimal logarithm of a bound on what was taken as zero
    regions: int = 0  # regions of signs that the rows visit; 0 without signs
    regions_note: str = ""  # whether other regions could matter
    reason: str = ""  # why exact algebra does not decide

    def __str__(self) -> str:
        return (
            f"rank {self.rank} proved from below in ball arithmetic of {self.bits} bits; completeness is not proven: "
            f"what is left of {self.rows} rows is below 1e{int(self.log10_residual)}"
            f"{f', {self.regions_note}' if self.regions_note else ''}"
            f"{f'; relations not known: {self.reason}' if self.reason else ''}"
        )


class BallStructure:
    """Elimination of a model's regressor in balls."""

    def __init__(self, model: LinearModel, order: tuple[int, ...], rng: np.random.Generator) -> None:
        self.model, self.order, self.rng = model, order, rng
        forms = model.regressor
        self._outputs = list(forms.entries.values())
        self._schedule = Schedule(forms.program, self._outputs)
        # where constants without a value matter, two sets of them show it
        self._real = [RealPoints(forms.program, self._outputs, forms.values, variant) for variant in range(2)]
        self.rows = max(len(order) + _SURPLUS_ROWS, _POINTS_PER_REGION * max(real.count for real in self._real))

    def solve(self) -> tuple[BaseMatrix, dict[str, str], BallEvidence]:
        """B, the decimals in it by name, and the evidence."""
        first, second = self._agreed()
        echelon, bits = second
        rows: list[dict[int, RationalFunction]] = []
        decimals: dict[str, str] = {}
        for mine, theirs in zip(echelon.rows, first[0].rows, strict=True):
            row = {}
            for k, (value, other) in enumerate(zip(mine, theirs, strict=True)):
                coefficient = self._coefficient(value, other, min(bits, first[1]), decimals)
                if coefficient:
                    row[self.order[k]] = coefficient
            rows.append(dict(sorted(row.items())))
        pivots = tuple(self.order[p] for p in echelon.pivots)
        matrix = BaseMatrix(self.model.parameters, pivots, tuple(rows), self.order)
        real = self._real[1]
        regions = (real.count, str(real.report)) if real.has_signs else (0, "")
        evidence = BallEvidence(len(pivots), bits, self.rows, echelon.residual * 0.30103, *regions)
        return matrix, decimals, evidence

    def _agreed(self) -> tuple[tuple[BallEchelon, int], tuple[BallEchelon, int]]:
        """Two echelon forms with the same pivots; where they differ, twice as many points may show more."""
        for _ in range(_DOUBLINGS):
            first, second = map(self._echelon, self._real)
            if first[0].pivots == second[0].pivots:
                return first, second
            self.rows *= 2
        if None in self.model.constants.values():
            raise ClosedFormError("the rank depends on the values of the constants: give them")
        raise ClosedFormError("random real points keep contradicting each other on the rank")

    def _coefficient(self, value: Any, other: Any, bits: int, decimals: dict[str, str]) -> RationalFunction:
        found = recognised(value, bits)
        if found is not None and found == recognised(other, bits):
            return RationalFunction(found.numerator if found.denominator == 1 else found)
        if not value.overlaps(other):
            raise ClosedFormError("a coefficient depends on constants: by ball arithmetic they need values")
        name = f"beta{len(decimals) + 1}"
        decimals[name] = value.mid().str(_DIGITS, radius=False)
        return RationalFunction(Polynomial.generator(name))

    def _echelon(self, real: RealPoints) -> tuple[BallEchelon, int]:
        """Echelon form at fresh points, confirmed at twice the precision."""
        points = real.draw(self.rng, self.rows)
        bits, previous = _BITS, None
        before = flint.ctx.prec
        try:
            while bits <= _MOST_BITS:
                flint.ctx.prec = bits
                current = ball_echelon(self._matrix(points), bits)
                if previous is not None and current is not None and current.pivots == previous.pivots:
                    return current, bits
                previous, bits = current, 2 * bits
        finally:
            flint.ctx.prec = before
        raise ClosedFormError(f"balls of {_MOST_BITS} bits do not decide the rank")

    def _matrix(self, points: dict[int, Any]) -> list[list[Any]]:
        """Rows of X at real points, which as floats are exact dyadic numbers."""
        program, forms = self.model.regressor.program, self.model.regressor
        leaves = {}
        for node in self._schedule.leaves:
            value = self.model.constants.get(program.inputs[node].name)
            numbers = [ball(float(x)) if value is None else ball(Fraction(value)) for x in points[node]]
            leaves[node] = np.array(numbers, dtype=object)
        values = self._schedule.run(BallArithmetic(), leaves, self.rows)
        table = [[flint.arb(0)] * forms.shape[1] for _ in range(self.rows * forms.shape[0])]
        for (row, column), value in zip(forms.entries, values, strict=True):
            for k in range(self.rows):
                table[k * forms.shape[0] + row][column] = value[k]
        return [[row[c] for c in self.order] for row in table]
