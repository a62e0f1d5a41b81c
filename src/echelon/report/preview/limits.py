"""Limits: what each allows, what the trajectory reaches, and the room between, the least room first."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, isnan
from typing import Any

from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.excite.verify.margins import ACTIVE, Margin

_ROOM = 0.1  # of the width of a picture, beside limits on both sides


@dataclass(frozen=True)
class Row:
    """One limit."""

    margin: Margin
    state: str  # ``"broken"``, ``"active"`` or ``"kept"``
    percent: float  # the margin in per cent of the limit's range
    # what is reached, in per cent of the width of a picture in which the limits stand at 10 and 90; the picture of a
    # limit without a second end takes zero, or what is reached, for it
    left: float
    width: float


def context(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the table of margins shows."""
    rows = sorted((_row(margin) for margin in found.margins), key=_urgency)
    counts = {state: sum(1 for row in rows if row.state == state) for state in ("broken", "active", "kept")}
    return {"rows": rows, "counts": counts, "near": f"{100 * ACTIVE:g}"}


def _row(margin: Margin) -> Row:
    state = "active" if margin.active else "kept" if margin.kept else "broken"
    left, right = (_place(margin, value) for value in (margin.least, margin.largest))
    return Row(margin, state, 100 * margin.relative, left, right - left)


def _urgency(row: Row) -> tuple[int, float]:
    """Broken ones before active ones before others, each by their share of the range; unknown shares first."""
    order = ("broken", "active", "kept").index(row.state)
    return order, -float("inf") if isnan(row.percent) else row.percent


def _place(margin: Margin, value: float) -> float:
    """Where a value stands between the limits, from 0 to 100."""
    low = margin.low if isfinite(margin.low) else min(margin.least, 0.0)
    high = margin.high if isfinite(margin.high) else max(margin.largest, 0.0)
    span = high - low
    if not (isfinite(value) and isfinite(span) and span > 0):
        return 50.0
    return 100 * min(max(_ROOM + (1 - 2 * _ROOM) * (value - low) / span, 0.0), 1.0)
