"""Limits of positions, velocities, accelerations and jerks: linear in the coefficients of every family."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.arrays import Floats

ORDERS = ("position", "velocity", "acceleration", "jerk")
"""What is limited, by the order of the derivative."""


@dataclass(frozen=True, eq=False)
class MotionLimit:
    """low ≤ weights · d^order q/dt^order ≤ high, for a coordinate or, through a transmission, for an actuator.

    Attributes
    ----------
    name : str
        Coordinate or actuator.
    unit : str
    order : int
        Of the derivative; see :data:`ORDERS`.
    weights : array of shape (n,)
        Over the coordinates that move.
    low, high : float
        SI units; infinite where there is no limit.
    """

    name: str
    unit: str
    order: int
    weights: Floats
    low: float
    high: float

    @property
    def kind(self) -> str:
        """What is limited."""
        return ORDERS[self.order]

    @property
    def label(self) -> str:
        """For messages, ``"velocity of j3"``."""
        return f"{self.kind} of {self.name}"
