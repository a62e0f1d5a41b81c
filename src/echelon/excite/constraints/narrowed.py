"""A constraint whose limits are drawn in: what was exceeded between samples is kept free."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.arrays import Floats
from echelon.excite.constraints.state import Slopes, StateConstraint


@dataclass(frozen=True, eq=False)
class Narrowed:
    """A constraint between other bounds.

    Attributes
    ----------
    constraint : StateConstraint
    low, high : array of shape (m,)
    """

    constraint: StateConstraint
    low: Floats
    high: Floats

    @property
    def labels(self) -> tuple[str, ...]:
        """Those of the constraint."""
        return self.constraint.labels

    @property
    def units(self) -> tuple[str, ...]:
        """Those of the constraint."""
        return self.constraint.units

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Those of the constraint."""
        return self.constraint.values(q, qd, qdd)

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Those of the constraint."""
        return self.constraint.slopes(q, qd, qdd)


def narrowed(constraint: StateConstraint, below: Floats, above: Floats) -> Narrowed:
    """A constraint with its limits drawn in.

    Parameters
    ----------
    constraint : StateConstraint
    below, above : array of shape (m,)
        By how much the least values rise and the largest ones fall.
    """
    inner = constraint.constraint if isinstance(constraint, Narrowed) else constraint
    return Narrowed(inner, constraint.low + below, constraint.high - above)
