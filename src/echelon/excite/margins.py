"""Margins: how far a trajectory stays from each limit, at every time and not only at samples."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan

ACTIVE = 0.02
"""Share of a limit's range within which it counts as active."""


@dataclass(frozen=True)
class Margin:
    """One limit and how far a trajectory stays from it.

    Attributes
    ----------
    label : str
        ``"velocity of j3"``.
    unit : str
    low, high : float
        The limit, SI units; infinite for none.
    least, largest : float
        Bounds of what the trajectory reaches at any time: it goes neither below nor above.
    """

    label: str
    unit: str
    low: float
    high: float
    least: float
    largest: float

    @property
    def margin(self) -> float:
        """Distance to the nearer end, negative if the limit is broken."""
        if isnan(self.least) or isnan(self.largest):
            return -inf  # what nobody knows is not kept
        below = inf if self.low == -inf else self.least - self.low
        return min(below, inf if self.high == inf else self.high - self.largest)

    @property
    def relative(self) -> float:
        """The margin as a share of the limit's range, or of its size where it has one end only."""
        span = self.high - self.low
        size = span if abs(span) < inf else abs(self.low if abs(self.low) < inf else self.high)
        return self.margin / size if size else self.margin

    @property
    def kept(self) -> bool:
        """Whether the limit holds at every time."""
        return self.margin >= 0

    @property
    def active(self) -> bool:
        """Whether the trajectory comes near the limit."""
        return self.kept and self.relative < ACTIVE
