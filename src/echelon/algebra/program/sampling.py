"""Random points of a finite field for programs with signs: signs are those of real points, region by region."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.algebra.exact.field import PrimeField, Residues
from echelon.algebra.program.free_states import RealPoints
from echelon.algebra.program.operations import Op
from echelon.algebra.program.schedule import FieldSampler
from echelon.algebra.program.tape import Program


class SignSampler(FieldSampler):
    """Evaluates the outputs of real points modulo primes, in all regions of signs in turn."""

    def __init__(self, points: RealPoints) -> None:
        super().__init__(points.program, points.outputs)
        self._points = points

    @property
    def regions(self) -> int:
        """Number of regions into which signs cut the real points; this many states visit them all."""
        return self._points.count

    def _signs(
        self, field: PrimeField, states: int, geometries: int
    ) -> dict[int, Residues]:
        signs = self._points.signs(states)
        return {
            n: np.tile(x.astype(field.dtype) % field.p, geometries)
            for n, x in signs.items()
        }


def sampler_of(
    program: Program, outputs: Sequence[int], points: RealPoints | None = None
) -> FieldSampler:
    """Evaluates outputs at random points of a prime field, in regions of signs if there are any."""
    if any(program.ops[n] in (Op.SIGN, Op.ABS) for n in program.needed(outputs)):
        return SignSampler(points or RealPoints(program, outputs))
    return FieldSampler(program, outputs)
