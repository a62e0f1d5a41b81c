"""Regions whose products of signs are linearly independent: all that a row space can tell apart.

A row of a model is Σ s_T·A_T, with s_T the product T of signs in its region and A_T functions that know nothing of the
signs.  What vanishes in some regions vanishes in every region whose vector (s_T) is a combination of theirs.  So a
region adds something only if its vector is independent of those before, and as many regions as there are products
are enough, however many exist: 31 for the friction of 30 joints, whose signs make 2^30.

Vectors are compared modulo a prime; their entries are 0 and ±1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, SignArray

_PRIME = 1_048_573
"""The largest prime below 2^20: then products of matrices of a thousand columns are exact in double precision."""


class IndependentRegions:
    """The vectors of the regions so far, in reduced echelon form."""

    def __init__(self, products: Sequence[tuple[tuple[int, int], ...]] | None, relations: int = 0) -> None:
        self._every, self._relations = products is None, relations
        self.products = list(products or ())
        self._place = {product: k for k, product in enumerate(self.products)}
        self._basis: Floats = np.zeros((0, len(self.products)))
        self._pivots: list[int] = []

    @property
    def rank(self) -> int:
        """Number of independent regions so far."""
        return len(self._pivots)

    @property
    def complete(self) -> bool:
        """Whether no other region can add anything."""
        return not self._every and self.rank + self._relations == len(self.products)

    def rests(self, signs: SignArray) -> Floats:
        """What of the vectors of some regions is not a combination of those so far."""
        # shapes: signs (surfaces, regions); returns (regions, products)
        vectors = np.ones((signs.shape[1], len(self.products)))
        for k, product in enumerate(self.products):  # shorter ones come first
            if product:
                row, exponent = product[-1]
                shorter = vectors[:, self._place[product[:-1]]]
                vectors[:, k] = shorter * signs[row].astype(np.float64) ** exponent
        return (vectors - vectors[:, self._pivots] @ self._basis) % _PRIME

    def adds(self, signs: SignArray) -> npt.NDArray[np.bool_]:
        """Which regions add something, each by itself."""
        return np.asarray(self.rests(signs).any(axis=1) | self._every, dtype=bool)

    def include(self, signs: SignArray, accept: Callable[[int], bool]) -> list[int]:
        """Include those of some regions, in their order, that add something to the earlier ones."""
        # shapes: signs (surfaces, regions)
        if self._every:
            return [k for k in range(signs.shape[1]) if accept(k)]
        rests, included = self.rests(signs), []
        for k in range(len(rests)):
            places = np.flatnonzero(rests[k])
            if not len(places) or not accept(k):
                continue
            pivot = int(places[0])
            row = rests[k] * pow(int(rests[k, pivot]), -1, _PRIME) % _PRIME
            rests[k + 1 :] = (rests[k + 1 :] - np.outer(rests[k + 1 :, pivot], row)) % _PRIME
            self._basis = np.vstack([(self._basis - np.outer(self._basis[:, pivot], row)) % _PRIME, row])
            self._pivots.append(pivot)
            included.append(k)
        return included
