"""Some functions of a constraint, with limits of their own: those that are asked for, drawn in where need be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.excite.constraints.state import Slopes, StateConstraint

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Narrowed:
    """Functions of a constraint between other bounds.

    Attributes
    ----------
    constraint : StateConstraint
    indices : array of int, shape (k,)
        Which of its functions.
    low, high : array of shape (k,)
    """

    constraint: StateConstraint
    indices: Indices
    low: Floats
    high: Floats

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the functions."""
        return tuple(self.constraint.labels[k] for k in self.indices)

    @property
    def units(self) -> tuple[str, ...]:
        """Of the functions."""
        return tuple(self.constraint.units[k] for k in self.indices)

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, k)."""
        return self.constraint.values(q, qd, qdd)[:, self.indices]

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Their derivatives by q, q̇ and q̈, each of shape (N, k, n)."""
        q_, qd_, qdd_ = (None if s is None else s[:, self.indices] for s in self.constraint.slopes(q, qd, qdd))
        return q_, qd_, qdd_


def narrowed(constraint: StateConstraint, below: Floats, above: Floats) -> Narrowed:
    """All functions of a constraint with their limits drawn in.

    Parameters
    ----------
    constraint : StateConstraint
    below, above : array of shape (m,)
        By how much the least values rise and the largest ones fall.
    """
    return Narrowed(constraint, np.arange(len(constraint.labels)), constraint.low + below, constraint.high - above)


def selected(constraint: StateConstraint, chosen: npt.NDArray[np.bool_]) -> Narrowed:
    """Some functions of a constraint.

    Parameters
    ----------
    constraint : StateConstraint
    chosen : array of bool, shape (m,)
    """
    return Narrowed(constraint, np.flatnonzero(chosen), constraint.low[chosen], constraint.high[chosen])
