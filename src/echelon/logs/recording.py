"""A log in the robot's terms: joint side, SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from echelon.arrays import Floats


@dataclass(frozen=True)
class Recording:
    """Channels against time stamps, as they were logged.

    Attributes
    ----------
    source : str
        Name of the file, for messages.
    time : array of shape (N,)
        Time stamps, s; they may jitter and leave gaps.
    signals : mapping of str to array of shape (N, columns)
        ``q`` (``mechanism.positions``); where logged ``qd``, ``qdd`` (``mechanism.velocities``), ``y``
        (``mechanism.outputs``) and ``reference`` (as ``q``).
    inputs : mapping of str to array of shape (N,)
        Measured inputs that effects use.
    """

    source: str
    time: Floats
    signals: Mapping[str, Floats]
    inputs: Mapping[str, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class Segment:
    """An uninterrupted stretch of a recording on a uniform clock.

    Attributes
    ----------
    source : str
    start : float
        Time of the first sample, s.
    rate : float
        Samples per second.
    signals, inputs : mappings
        As of :class:`Recording`; row k belongs to the time ``start + k / rate``.
    """

    source: str
    start: float
    rate: float
    signals: Mapping[str, Floats]
    inputs: Mapping[str, Floats] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.signals["q"])

    @property
    def time(self) -> Floats:
        """Times of the samples, s, shape (N,)."""
        times: Floats = self.start + np.arange(len(self)) / self.rate
        return times
