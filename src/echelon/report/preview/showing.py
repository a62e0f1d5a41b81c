"""What the motion will show: how conditioning grows with time, and how exactly each base parameter will be known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from echelon.errors import InputError
from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.report.closed_forms import ClosedForm, ClosedForms
from echelon.report.digits import significant
from echelon.report.environment import trusted

_VAGUE = 30.0  # per cent of its value beyond which a deviation is remarked


@dataclass(frozen=True)
class Row:
    """One base parameter."""

    form: ClosedForm
    unit: str
    std: float  # SI units
    value: float | None  # that of the robot file
    percent: float | None  # the deviation in per cent of that value

    @property
    def vague(self) -> bool:
        """Whether the deviation is large against the value."""
        return self.percent is not None and not self.percent <= _VAGUE


def context(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the section shows beside its plot."""
    rows = _rows(found)
    singular = [time for time, condition in found.conditioning.over_time if not isfinite(condition)]
    return {
        "shown": found.conditioning,
        "rows": rows,
        "known": any(row.value is not None for row in rows),
        "vague": sum(row.vague for row in rows),
        "singular": max(singular, default=0.0),
        "noise": _noise(found),
        "html": lambda form: trusted(form.html),
        "start": lambda form: trusted(form.start),
    }


def payload(found: ExcitingTrajectory) -> dict[str, list[float]]:
    """Times and scaled condition numbers, where these are finite."""
    kept = [(time, condition) for time, condition in found.conditioning.over_time if isfinite(condition)]
    return {"time": [time for time, _ in kept], "condition": [condition for _, condition in kept]}


def _rows(found: ExcitingTrajectory) -> list[Row]:
    base = found.base
    try:
        values: list[float | None] = base.values().tolist()
    except InputError:  # the file states no inertia, or a length has no value
        values = [None] * base.rank
    return [
        Row(form, unit, std, value, None if value is None else 100 * std / abs(value) if value else inf)
        for form, unit, std, value in zip(
            ClosedForms(base).all(), base.units, found.conditioning.std, values, strict=True
        )
    ]


def _noise(found: ExcitingTrajectory) -> str:
    """Noise that the deviations are for, as the settings state it."""
    section = found.settings.get("excitation")
    noise = section.get("noise") if isinstance(section, Mapping) else None
    if not isinstance(noise, Mapping):
        return ""
    parts = [f"{significant(float(value), 3)} ({name})" for name, value in noise.items()]
    return ", ".join(part.removesuffix(" (all)") if len(parts) == 1 else part for part in parts)
