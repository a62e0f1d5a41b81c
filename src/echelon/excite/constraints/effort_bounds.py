"""What drives can give, and what of it predictions of a model may ask for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.excite.constraints.effort_model import SIGNS, EffortModel


@dataclass(frozen=True)
class EffortLimit:
    """The largest torque or force of a drive or joint.

    Attributes
    ----------
    name : str
        Actuator, or joint coordinate on the joint's side of its drive.
    unit : str
    limit : float
        N·m or N, both directions.
    """

    name: str
    unit: str
    limit: float


@dataclass(frozen=True, eq=False)
class EffortBounds:
    """Bounds of predicted efforts: one function for each, or two where deviations are kept free.

    Attributes
    ----------
    labels, units : tuple of str
    low, high : array of shape (m,)
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    low: Floats
    high: Floats

    @staticmethod
    def of(limits: Sequence[EffortLimit], model: EffortModel, margin: float) -> EffortBounds:
        """Bounds of what a model predicts.

        Parameters
        ----------
        limits : sequence of EffortLimit
        model : EffortModel
        margin : float
            Share of each limit that is kept free beside deviations.
        """
        labels = tuple(f"{'force' if limit.unit == 'N' else 'torque'} of {limit.name}" for limit in limits)
        units = tuple(limit.unit for limit in limits)
        high = np.array([limit.limit for limit in limits]) * (1 - margin)
        if model.certain:
            return EffortBounds(labels, units, -high, high)
        labels = tuple(f"{label} {sign} {model.deviations:g} deviations" for label in labels for sign in SIGNS)
        none = np.full(len(high), np.inf)
        low, most = np.column_stack([-none, -high]).ravel(), np.column_stack([high, none]).ravel()
        return EffortBounds(labels, tuple(unit for unit in units for _ in SIGNS), low, most)
