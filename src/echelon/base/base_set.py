"""What every set of base parameters has, whatever model it belongs to."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any

from echelon.base.expression import Expression, collect
from echelon.base.matrix import BaseMatrix, Row

if TYPE_CHECKING:
    import sympy

    from echelon.base.pseudo_inverse import ExactMetric


class Identifiability(Enum):
    """What the outputs can say about one standard parameter."""

    UNIDENTIFIABLE = "unidentifiable"
    ALONE = "identifiable alone"
    COMBINATION = "identifiable in combination"


def classify(matrix: BaseMatrix) -> dict[str, Identifiability]:
    """Class of every standard parameter, in column order.

    A zero column of B is unidentifiable; a unit row whose parameter occurs in no other row is identifiable alone.
    """
    seen: dict[int, Identifiability] = {}
    for row in matrix.rows:
        kind = Identifiability.ALONE if len(row) == 1 else Identifiability.COMBINATION
        for column in row:
            seen[column] = kind
    return {name: seen.get(column, Identifiability.UNIDENTIFIABLE) for column, name in enumerate(matrix.parameters)}


class BaseSet(ABC):
    """Base parameters ζ̄ = B ζ."""

    matrix: BaseMatrix  # exact sparse B

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return self.matrix.rank

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the standard parameters, the columns of B."""
        return self.matrix.parameters

    @property
    def pivots(self) -> tuple[str, ...]:
        """Names of the representatives, one per row of B."""
        return tuple(self.parameters[p] for p in self.matrix.pivots)

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Unit of every base parameter."""

    @cached_property
    def expressions(self) -> tuple[Expression, ...]:
        """Every base parameter in closed form, terms with equal coefficients collected."""
        decimals = [self.parameters[c] for c in self.matrix.numbers.columns] if self.matrix.numbers else []
        return tuple(
            collect(name, unit, [(self.parameters[c], value) for c, value in sorted(row.items())], decimals)
            for name, unit, row in zip(self.pivots, self.units, self._shown_rows, strict=True)
        )

    @cached_property
    def classification(self) -> dict[str, Identifiability]:
        """For every standard parameter, whether it can be identified alone, in combination, or not at all."""
        return classify(self.matrix)

    @cached_property
    def B(self) -> sympy.ImmutableSparseMatrix:
        """B as a sympy matrix in the model's constants, shape (base parameters, standard parameters)."""
        return self.matrix.sympy(self._formulas({}))

    def pseudo_inverse(self, metric: ExactMetric = "identity") -> sympy.ImmutableMatrix:
        """B† = S Bᵀ (B S Bᵀ)⁻¹ in closed form, for a given metric S (Theorem 1 of the paper); B · B† = 1 is checked.

        >>> import echelon as ec
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> base.pseudo_inverse()[19, 1]
        l1/(l1**4 + l1**2 + 1)
        """
        from echelon.base.pseudo_inverse import pseudo_inverse

        return pseudo_inverse(self.matrix, metric, self._formulas({}))

    @property
    def _shown_rows(self) -> Sequence[Row]:
        """Rows of B with the coefficients that people read."""
        return self.matrix.rows

    def _formulas(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """What constants of B stand for, as sympy expressions, where they are not symbols; with values put in."""
        return dict(values)
