"""A log in the robot's terms (joint side, SI units): as it was logged, as uniform segments, and as prepared samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.shared import Flags, Floats

if TYPE_CHECKING:
    from echelon.identification.signals.filters import FirFilter


FEWEST = 20
"""Samples of the shortest stretch that is used; filters and derivatives make nothing of shorter ones."""


@dataclass(frozen=True)
class Recording:
    """Channels against time stamps, as they were logged."""

    source: str  # name of the file, for messages
    time: Floats  # s, shape (N,); they may jitter and leave gaps
    # shape (N, columns); ``q`` (``mechanism.positions``); where logged ``qd``, ``qdd`` (``mechanism.velocities``),
    # ``y`` (``mechanism.outputs``) and ``reference`` (as ``q``)
    signals: Mapping[str, Floats]
    inputs: Mapping[str, Floats] = field(
        default_factory=dict
    )  # shape (N,); measured inputs that effects use


@dataclass(frozen=True)
class Segment:
    """An uninterrupted stretch of a recording on a uniform clock."""

    source: str
    start: float  # time of the first sample, s
    rate: float  # samples per second
    signals: Mapping[str, Floats]
    inputs: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.signals["q"])

    @property
    def time(self) -> Floats:
        """Times of the samples, s, shape (N,)."""
        return self.start + np.arange(len(self)) / self.rate


@dataclass(frozen=True)
class Samples:
    """A prepared segment, or a window of one."""

    source: str
    start: float  # time of the first sample, s, and samples per second
    rate: float
    q: Floats  # shape (N, …); states, as the regressor takes them
    qd: Floats
    qdd: Floats
    y: Floats | None  # shape (N, outputs); measured outputs, not yet reduced
    inputs: Mapping[str, Floats] = field(default_factory=dict)  # shape (N,)
    # low-pass and decimation that the regressor's columns and y still have to pass, both alike
    reduction: FirFilter | None = None
    # samples (before reduction) that count: what lies outside is there for filters only, or spoilt by them
    first: int = 0
    stop: int | None = None
    moving: Flags | None = (
        None  # shape (N, outputs); where the direction of dry friction is known; everywhere if None
    )
    pinned: Flags | None = (
        None  # shape (N, outputs); where sensors are at a limit; nowhere if None
    )
    experiment: str = (
        ""  # that they are of; empty where there is one, or where contacts tell
    )

    def __len__(self) -> int:
        return len(self.q)

    @property
    def end(self) -> int:
        """The sample before which those that count end."""
        return len(self) if self.stop is None else self.stop

    @property
    def factor(self) -> int:
        """Samples of which one row remains."""
        return 1 if self.reduction is None else self.reduction.factor

    @property
    def reach(self) -> int:
        """Samples on either side that a row depends on."""
        return 0 if self.reduction is None else self.reduction.reach

    def reduced(self, values: Floats) -> Floats:
        """Values (N, …) of some samples in a row, as both sides are filtered, where rows stand."""
        return values if self.reduction is None else self.reduction.apply(values)

    @property
    def left_out(self) -> Flags | None:
        """Samples near standstill, or at a limit of a sensor, that make no row, shape (N, outputs); none if None."""
        if self.moving is None:
            return self.pinned
        return ~self.moving if self.pinned is None else ~self.moving | self.pinned

    @property
    def motion(self) -> tuple[Floats, Floats, Floats]:
        """Positions, velocities and accelerations."""
        return self.q, self.qd, self.qdd

    def cut(self, some: slice) -> Samples:
        """Some of the samples, with the clock and the ends still to be stated."""
        return replace(
            self,
            **{name: getattr(self, name)[some] for name in ("q", "qd", "qdd")},
            y=None if self.y is None else self.y[some],
            inputs={name: values[some] for name, values in self.inputs.items()},
            moving=None if self.moving is None else self.moving[some],
            pinned=None if self.pinned is None else self.pinned[some],
        )

    @property
    def state(self) -> dict[str, Any]:
        """The samples as a log that :meth:`echelon.BaseModel.accumulate` takes, without reduction."""
        found: dict[str, Any] = {
            "q": self.q,
            "qd": self.qd,
            "qdd": self.qdd,
            "inputs": dict(self.inputs),
        }
        return found if self.y is None else {**found, "y": self.y}
