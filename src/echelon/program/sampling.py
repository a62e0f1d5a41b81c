"""Random points of a finite field for programs with signs: signs are those of real points, region by region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.exact.field import PrimeField, Residues
from echelon.program.operations import Op
from echelon.program.free_states import RealPoints
from echelon.program.rewriting import without_absolutes
from echelon.program.schedule import FieldSampler
from echelon.program.tape import Program


class SignSampler(FieldSampler):
    """Evaluates outputs of a program with signs at random points of a prime field, in all regions of signs in turn."""

    def __init__(self, program: Program, outputs: Sequence[int], points: RealPoints) -> None:
        copy, nodes, places = without_absolutes(program, outputs)
        super().__init__(copy, nodes)
        self._points, self._places = points, places

    @property
    def regions(self) -> int:
        """Number of regions into which signs cut the real points; this many states visit them all."""
        return self._points.count

    def _signs(self, field: PrimeField, states: int, geometries: int) -> dict[int, Residues]:
        known = {self._places[n]: signs for n, signs in self._points.signs(states).items() if n in self._places}
        leaves = [n for n in self._schedule.leaves if self.program.ops[n] == Op.SIGN]
        return {n: np.tile(known[self.program.lhs[n]].astype(field.dtype) % field.p, geometries) for n in leaves}


def sampler_of(program: Program, outputs: Sequence[int], points: RealPoints | None = None) -> FieldSampler:
    """Evaluates outputs at random points of a prime field, in regions of signs if there are any."""
    if any(program.ops[n] in (Op.SIGN, Op.ABS) for n in program.needed(outputs)):
        return SignSampler(program, outputs, points or RealPoints(program, outputs))
    return FieldSampler(program, outputs)
