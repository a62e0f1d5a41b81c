"""Samples: states and outputs ready for the regressor, and the filter that both sides still have to pass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from echelon.arrays import Flags, Floats

if TYPE_CHECKING:
    from echelon.signals.reduction import Reduction


@dataclass(frozen=True)
class Samples:
    """A prepared segment, or a window of one.

    Attributes
    ----------
    source : str
    start, rate : float
        Time of the first sample, s, and samples per second.
    q, qd, qdd : arrays of shape (N, …)
        States, as the regressor takes them.
    y : array of shape (N, outputs), optional
        Measured outputs, not yet reduced.
    inputs : mapping of str to array of shape (N,)
    reduction : Reduction, optional
        Low-pass and decimation that the regressor's columns and y still have to pass, both alike.
    first, stop : int
        Samples (before reduction) that count: what lies outside is there for filters only, or spoilt by them.
    moving : array of shape (N, outputs), optional
        Where rows of an output count; everywhere if None.
    """

    source: str
    start: float
    rate: float
    q: Floats
    qd: Floats
    qdd: Floats
    y: Floats | None
    inputs: Mapping[str, Floats] = field(default_factory=dict)
    reduction: Reduction | None = None
    first: int = 0
    stop: int | None = None
    moving: Flags | None = None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def state(self) -> dict[str, Any]:
        """The samples as a log that :meth:`echelon.BaseModel.accumulate` takes, without reduction."""
        found: dict[str, Any] = {"q": self.q, "qd": self.qd, "qdd": self.qdd, "inputs": dict(self.inputs)}
        return found if self.y is None else {**found, "y": self.y}
