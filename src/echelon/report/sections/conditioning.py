"""Conditioning: which combinations of parameters the data show well, and which hardly."""

from __future__ import annotations

from math import ceil, floor, log10
from typing import Any

import numpy as np

from echelon.identification.result import Identification
from echelon.report.closed_forms import ClosedForms
from echelon.report.environment import trusted

_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 900.0, 220.0, 64.0, 34.0, 12.0
_WIDEST = 36.0  # of a bar, px
_DECADES = 16  # that are drawn at most; smaller singular values stand at the bottom


def context(run: Identification) -> dict[str, Any]:
    """What the section on conditioning shows."""
    forms = ClosedForms(run.base)
    weak = [
        {
            "value": direction.singular_value,
            "terms": [(weight, trusted(forms.name(name))) for name, weight in direction.weights],
            "advice": direction.advice,
        }
        for direction in run.excitation.weak
    ]
    return {"excitation": run.excitation, "total": run.base.rank, "weak": weak, "plot": _plot(run)}


def _plot(run: Identification) -> dict[str, Any] | None:
    """Bars of the singular values on a logarithmic scale; None if there are none."""
    values = np.asarray(run.excitation.singular_values, dtype=float)
    positive = values[np.isfinite(values) & (values > 0)]
    if not len(positive):
        return None
    high = ceil(log10(positive.max()) - 1e-9)
    low = max(min(floor(log10(positive.min())), high - 1), high - _DECADES)
    room, right = _HEIGHT - _TOP - _BOTTOM, _WIDTH - 8
    step = (right - _LEFT) / len(values)

    def height(value: float) -> float:
        return room * min(max((log10(value) - low) / (high - low), 0.01), 1.0) if value > 0 else 0.0

    bars = [
        {"x": _LEFT + step * k, "y": _TOP + room - height(v), "height": height(v), "value": v, "seen": k < rank}
        for rank in (run.excitation.rank,)
        for k, v in enumerate(values.tolist())
    ]
    every = max(1, ceil((high - low) / 6))
    ticks = [{"y": _TOP + room * (high - k) / (high - low), "exponent": k} for k in range(high, low - 1, -every)]
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "left": _LEFT,
        "right": right,
        "floor": _TOP + room,
        "bar": min(max(0.7 * step, 0.5), _WIDEST),
        "bars": bars,
        "ticks": ticks,
        "count": len(values),
    }
