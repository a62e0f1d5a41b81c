"""Loops that are closed together: their equations as polynomials, and the coordinates that solve them.

A turning coordinate enters by the cosine and sine of its angle.  The equations are linear in these and in sliding
coordinates, because each coordinate occurs once in every chain.  So their values at corners, where the variables of a
coordinate are zero but for at most one, which is one, give all coefficients.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from echelon.exact.field import Residues
from echelon.exact.zero_dimensional import Solutions, Solver
from echelon.regressor.moving import Pose
from echelon.regressor.positions import Positions, Recorded


class ClosureBlock:
    """Equations, and the coordinates that no earlier block fixes.

    Parameters
    ----------
    recorded : Recorded
    rows : sequence of int
        The equations.
    drawn, unknown : sequence of int
        Coordinates to draw, and to solve for.
    """

    def __init__(
        self, recorded: Recorded, rows: tuple[int, ...], drawn: tuple[int, ...], unknown: tuple[int, ...]
    ) -> None:
        self.recorded, self.rows, self.drawn, self.unknown = recorded, rows, drawn, unknown
        layout = recorded.layout
        turn = {int(column): place for place, column in enumerate(layout.turn_places)}
        slide = {int(column): place for place, column in enumerate(layout.slide_places)}
        # for every unknown, whether it turns and its place among those that do or do not
        self._places = [(c in turn, turn[c] if c in turn else slide[c]) for c in unknown]
        widths = [2 if turns else 1 for turns, _ in self._places]
        self._offsets = [sum(widths[:k]) for k in range(len(widths))]
        self._variables = sum(widths)
        self._solver = Solver(self._variables)
        self._equations = recorded.some_equations(rows)

    def fewer(self) -> ClosureBlock:
        """The block with one of the unknown coordinates drawn."""
        return ClosureBlock(self.recorded, self.rows, (*self.drawn, self.unknown[0]), self.unknown[1:])

    def solve(self, positions: Positions, pose: Pose) -> Solutions:
        """Values of the unknown coordinates at which the equations hold.

        Raises
        ------
        UnsolvedSystemError
            If they are infinitely many, or too many.
        """
        return self._solver.solve(self._polynomials(positions, pose), positions.field)

    def put(self, pose: Pose, sample: int, point: Residues) -> None:
        """Write a solution into a pose."""
        for (turns, place), offset in zip(self._places, self._offsets, strict=True):
            if turns:
                pose.turns[sample, place] = point[offset : offset + 2]
            else:
                pose.slides[sample, place] = point[offset]

    def _polynomials(self, positions: Positions, pose: Pose) -> list[dict[tuple[int, ...], Residues]]:
        """The equations by the coefficients of their monomials; turning coordinates stay on the unit circle."""
        coefficients = self._coefficients(positions, pose)
        corners = list(self._corners())
        equations: list[dict[tuple[int, ...], Residues]] = []
        for row in range(len(self.rows)):
            terms = {}
            for corner in corners:
                index: tuple[Any, ...] = (slice(None), *corner, row)
                if coefficients[index].any():
                    terms[self._monomial(corner)] = coefficients[index]
            if terms:
                equations.append(terms)
        one = np.ones(len(pose.turns), dtype=np.int64)
        for (turns, _), offset in zip(self._places, self._offsets, strict=True):
            if turns:
                squares = [tuple(2 * int(k == offset + part) for k in range(self._variables)) for part in (0, 1)]
                equations.append({squares[0]: one, squares[1]: one, (0,) * self._variables: -one % positions.field.p})
        return equations

    def _coefficients(self, positions: Positions, pose: Pose) -> Residues:
        """Coefficients, (samples, 3 for 1, c, s or 2 for 1, d of every unknown …, equations)."""
        corners, samples = list(self._corners()), len(pose.turns)
        probes = pose.repeated(len(corners))
        for number, corner in enumerate(corners):
            for (turns, place), part in zip(self._places, corner, strict=True):
                if turns:
                    probes.turns[number :: len(corners), place] = (int(part == 1), int(part == 2))
                else:
                    probes.slides[number :: len(corners), place] = part
        repeated = positions.at(np.repeat(np.arange(samples), len(corners)))
        sizes = [3 if turns else 2 for turns, _ in self._places]
        values = repeated.equations(probes, self._equations).reshape(samples, *sizes, len(self.rows))
        for axis, size in enumerate(sizes, 1):
            start = np.take(values, [0], axis=axis)
            rest = np.take(values, range(1, size), axis=axis)
            values = np.concatenate([start, (rest - start) % positions.field.p], axis=axis)
        return values

    def _corners(self) -> product[tuple[int, ...]]:
        return product(*(range(3 if turns else 2) for turns, _ in self._places))

    def _monomial(self, corner: tuple[int, ...]) -> tuple[int, ...]:
        exponents = [0] * self._variables
        for offset, part in zip(self._offsets, corner, strict=True):
            if part:
                exponents[offset + part - 1] = 1
        return tuple(exponents)
