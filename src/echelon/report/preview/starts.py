"""Starts of the optimisation, which tell whether another one would find more; and the settings that repeat it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from echelon.excite.exciting_trajectory import ExcitingTrajectory


def context(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the table of starts shows."""
    values = [start.value for start in found.starts if isfinite(start.value)]
    return {
        "starts": found.starts,
        "best": min(values, default=None),
        "failed": len(found.starts) - len(values),
        "curves": any(len(start.history) > 1 for start in found.starts),
        "criterion": found.criterion,
    }


def settings(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the last section shows."""
    return {"repeat": json.dumps(_plain(found.settings), indent=2, ensure_ascii=False, default=str)}


def payload(found: ExcitingTrajectory) -> list[dict[str, Any]]:
    """How the criterion became better in each start."""
    return [
        {"number": start.number, "history": [value for value in start.history if isfinite(value)]}
        for start in found.starts
    ]


def _plain(value: Any) -> Any:
    """What JSON knows; limits that do not exist are none, as in set-ups."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not isfinite(value):
        return "none"
    return value
