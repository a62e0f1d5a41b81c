"""Functions that are known by their values modulo primes, and the work that finding their closed forms may take.

Work is counted in operations, so that no result depends on the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from echelon.algebra.exact.field import MOST_ATTEMPTS, Geometry, PrimeField, Residues
from echelon.shared import ClosedFormError, DegenerateSampleError

OPERATIONS = 5e8
"""Operations on residues of a budget of 1: a few seconds."""
TERMS = 500
"""Terms of a coefficient for a budget of 1: they fill a screen."""
SOLVING = 0.05
"""Cost of an operation of FLINT's linear algebra, relative to one of an evaluation in NumPy."""


@dataclass
class Work:
    """Remaining work of a budget."""

    operations: float  # operations on residues that are left
    terms: float  # the most terms that one coefficient may have

    @staticmethod
    def of(budget: float) -> Work:
        """The work of a budget: 1 for a few seconds, 0 for none."""
        return Work(budget * OPERATIONS, budget * TERMS)

    def take(self, operations: float) -> bool:
        """Take some operations if as many are left."""
        if operations > self.operations:
            return False
        self.operations -= operations
        return True

    def spend(self, operations: float) -> None:
        """Take some operations."""
        if not self.take(operations):
            raise ClosedFormError("the budget for closed forms is used up")

    def share(self, part: float) -> Work:
        """A part of it, taken out; what is not used is given back by :meth:`give_back`."""
        taken = self.operations * part
        self.operations -= taken
        return Work(taken, self.terms)

    def give_back(self, rest: Work) -> None:
        """Take back what is left of a share."""
        self.operations += rest.operations


Found = TypeVar("Found")
CHUNK = 512
"""Geometries that are evaluated at once."""


@dataclass(frozen=True)
class UnknownFunctions:
    """Functions of geometry symbols that can be evaluated modulo primes."""

    # geometry maps every symbol to an array of values (for an angle: of the tangent of its half); without symbols there
    # is one geometry
    evaluate: Callable[[PrimeField, Geometry], Residues]
    symbols: Sequence[str]  # all symbols that may matter
    angles: frozenset[str]  # those of them that are angles
    lengths: frozenset[str]  # symbols with the dimension of a length
    degrees: Sequence[
        int
    ]  # homogeneous degree of each function in the symbols that are lengths
    irrational: tuple[bool, bool]  # whether √2 and √3 can occur in coefficients
    cost: float = 1.0  # operations of one evaluation

    def values(self, field: PrimeField, geometry: Geometry, count: int) -> Residues:
        """Values at some geometries: array of shape (functions, count)."""
        if not self.symbols:  # there is one geometry only
            return np.repeat(self.evaluate(field, geometry), count, axis=1)
        parts = []
        for first in range(0, count, CHUNK):
            some = {s: value[first : first + CHUNK] for s, value in geometry.items()}
            parts.append(self.evaluate(field, some))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def sample(
        self, field: PrimeField, rng: np.random.Generator, count: int
    ) -> tuple[Geometry, Residues]:
        """Random geometries and the values there."""

        def attempt() -> tuple[Geometry, Residues]:
            geometry = {s: field.draw(rng, (count,)) for s in self.symbols}
            return geometry, self.values(field, geometry, count)

        return persistent(attempt)


def persistent(attempt: Callable[[], Found]) -> Found:
    """The result of an attempt that depends on random points, several times if they are singular."""
    for _ in range(MOST_ATTEMPTS):
        try:
            return attempt()
        except DegenerateSampleError:
            continue
    raise ClosedFormError(f"{MOST_ATTEMPTS} random geometries in a row were singular")
