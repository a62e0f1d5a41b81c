"""Residuals: how they are distributed, how long they remember, and at which frequencies they lie."""

from __future__ import annotations

from typing import Any

from echelon.identification.result import Identification
from echelon.report.payload import outputs_of

_OPEN = 12


def context(run: Identification) -> dict[str, Any]:
    """What the section on residuals shows."""
    return {
        "outputs": [{"name": name, "unit": unit} for name, unit in outputs_of(run.validations)],
        "open": _OPEN,
    }
