"""Preparation: every setting with its reason, and what is needed to repeat the run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from math import isinf
from typing import Any

import numpy as np

from echelon.identification.result import Identification
from echelon.logs.preparation.settings import Preparation

_UNITS = {"cutoff": "Hz", "output_cutoff": "Hz", "rate": "Hz", "period": "s", "trim": "s", "delays": "s"}
_TITLES = {
    "cutoff": "low-pass over positions",
    "order": "order of that filter",
    "derivative": "derivatives",
    "measured": "taken from the log",
    "period": "period of the motion",
    "average": "averaged over periods",
    "output_cutoff": "low-pass over both sides",
    "output_filter": "kind of that filter",
    "decimation": "decimation",
    "still": "left out below the speed",
    "delays": "delays undone",
    "trim": "left out at both ends",
    "rate": "resampled to",
}


def context(run: Identification) -> dict[str, Any]:
    """What the last section shows."""
    return {
        "settings": _rows(run.preparation),
        "diagnostics": _json(run.estimate.diagnostics),
        "repeat": _json(run.settings),
        "certificate": str(run.base.certificate),
        "seed": run.base.seed,
    }


def _rows(preparation: Preparation) -> list[dict[str, str]]:
    return [
        {
            "key": field.name,
            "title": _TITLES.get(field.name, field.name.replace("_", " ")),
            "value": _text(getattr(preparation, field.name), _UNITS.get(field.name, "")),
            "reason": preparation.reasons.get(field.name, ""),
        }
        for field in fields(preparation)
        if field.name != "reasons"
    ]


def _text(value: Any, unit: str) -> str:
    """A setting in words."""
    if value is None or value in ((), "") or (isinstance(value, Mapping) and not value):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_text(part, unit)}" for name, part in value.items())
    if isinstance(value, tuple | list):
        return ", ".join(_text(part, unit) for part in value)
    if isinstance(value, float) and isinf(value):
        return "none"
    if isinstance(value, float):
        return f"{value:.6g} {unit}".strip()
    return f"{value}".replace("_", " ")


def _json(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    """What JSON does not know, in terms that it does."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value)
