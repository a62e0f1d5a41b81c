"""Minors: proofs that columns are independent, block triangular as far as possible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.elimination import rank
from echelon.exact.field import ARRAY_BITS, PrimeField
from echelon.mechanism.stated import StatedValues
from echelon.regressor.linear import LinearForms

_ATTEMPTS = 64
_MOST_STATES = 4096


@dataclass(frozen=True)
class Minor:
    """The largest non-zero minor of some columns that was found."""

    rank: int  # its size
    prime: int  # modulo which it is not zero
    states: int  # number of random states whose rows contain it


def find_minor(
    regressor: LinearForms, columns: tuple[int, ...], values: StatedValues, rng: np.random.Generator
) -> Minor:
    """A non-zero minor of some columns, all of them if they are independent; as block triangular as it can be."""
    doubled, best = 1, Minor(-1, 0, 0)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, ARRAY_BITS)
        try:
            settled = regressor.blocks.independent(columns, field, rng, values) if regressor.blocks else set()
            rest = tuple(p for p in columns if p not in settled)
            sampler = regressor.columns(rest).sampler()
            regions = sampler.regions
            states = doubled * max(2 + len(rest) // max(1, regressor.shape[0]), regions)
            residues = sampler.evaluate(field, rng, states, values.draw(sampler.symbols, field, rng))
        except DegenerateSampleError:
            continue
        found = Minor(len(settled) + rank(regressor.columns(rest).stacked(residues)[0], field), field.p, states)
        # once twice the states add nothing and rows abound, also in every region, more will not either
        enough = found.rank <= best.rank and states * regressor.shape[0] > 4 * len(rest) + 64
        best = max(best, found, key=lambda minor: minor.rank)
        if best.rank == len(columns) or (enough and states > regions) or 2 * states > max(_MOST_STATES, 4 * regions):
            break
        doubled *= 2
    return best
