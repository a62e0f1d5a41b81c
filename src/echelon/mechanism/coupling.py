"""Couplings: coordinates that depend on others."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.mechanism.spline import Spline


@dataclass(frozen=True)
class Coupling:
    """A dependent coordinate as a sum of functions of independent ones: q = Σ f_k(q_k), with f_k(0) = 0.

    A constant offset belongs into the geometry (a placement), not here.
    """

    coordinate: str
    terms: tuple[tuple[str, Spline], ...]

    @property
    def is_linear(self) -> bool:
        """Whether the coordinate is a linear combination of others."""
        return all(function.ratio is not None for _, function in self.terms)
