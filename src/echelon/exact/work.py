"""How much work closed forms may take, counted in operations, so that no result depends on the clock."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.errors import ClosedFormError

_OPERATIONS = 5e8  # a few seconds
_TERMS = 500
SOLVING = 0.05
"""What an operation of FLINT's linear algebra costs beside one of an evaluation in NumPy."""


@dataclass
class Work:
    """What is left of a budget."""

    operations: float  # operations on residues that are left
    terms: float  # the most terms that one coefficient may have

    @staticmethod
    def of(budget: float) -> Work:
        """The work of a budget: 1 for a few seconds, 0 for none."""
        return Work(budget * _OPERATIONS, budget * _TERMS)

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
