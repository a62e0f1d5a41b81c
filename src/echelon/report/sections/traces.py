"""Traces: measured against predicted, every output over time."""

from __future__ import annotations

from typing import Any

from echelon.identification.result import Identification
from echelon.report.payload import buckets_for, outputs_of

_OPEN = 12  # plots that are open when the page is


def context(run: Identification) -> dict[str, Any]:
    """What the section with plots over time shows."""
    first = next((i for i, v in enumerate(run.validations) if v.role == "validation" and v.traces), 0)
    return {
        "logs": [{"number": i, "source": v.source, "role": v.role} for i, v in enumerate(run.validations) if v.traces],
        "selected": first,
        "outputs": [{"name": name, "unit": unit} for name, unit in outputs_of(run.validations)],
        "open": _OPEN,
        "buckets": buckets_for(run.validations),
        "samples": max((len(t.time) for v in run.validations for t in v.traces), default=0),
        "prior": any(t.prior is not None for v in run.validations for t in v.traces),
    }
