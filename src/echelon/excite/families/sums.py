"""Sums of families: a periodic motion with another one on top, which lets it start and stop at rest anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.excite.families.basis import Basis


@dataclass(frozen=True)
class Sum(Basis):
    """All functions of several bases of one duration.

    Attributes
    ----------
    parts : tuple of Basis
    """

    parts: tuple[Basis, ...]

    @property
    def duration(self) -> float:  # type: ignore[override]
        """That of the parts."""
        return self.parts[0].duration

    @property
    def size(self) -> int:
        """Of all parts."""
        return sum(part.size for part in self.parts)

    @property
    def frequency(self) -> float:
        """The highest of the parts, Hz."""
        return max(part.frequency for part in self.parts)

    @property
    def periodic(self) -> bool:
        """If all parts are."""
        return all(part.periodic for part in self.parts)

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        return np.hstack([part.values(t, order) for part in self.parts])

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Sum of the bounds of the parts, shape (n,)."""
        cuts = np.cumsum([part.size for part in self.parts])[:-1]
        total = np.zeros(coefficients.shape[1])
        for part, some in zip(self.parts, np.split(coefficients, cuts), strict=True):
            total += part.bounds(some, order)
        return total
