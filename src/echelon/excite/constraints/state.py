"""Constraints on the state: functions of q, q̇ and q̈ that stay between bounds."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Slopes = tuple[Floats | None, Floats | None, Floats | None]
"""Derivatives by q, q̇ and q̈, each of shape (N, m, n); None where there are none."""


class StateConstraint(Protocol):
    """Some functions of the state with bounds."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What each function is, for messages: ``"torque of j2"``."""

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the functions."""

    @property
    def low(self) -> Floats:
        """Least values, shape (m,); −∞ for none."""

    @property
    def high(self) -> Floats:
        """Largest values, shape (m,); ∞ for none."""

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, m)."""

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Their derivatives."""
