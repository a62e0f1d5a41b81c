"""A fit of servos as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from echelon.identification.servos.servo_fit import ServoFit
from echelon.results.saved import to_dict
from echelon.version import __version__


def servo_document(fit: ServoFit, level: float = 0.95) -> dict[str, Any]:
    """All of a fit as JSON-able data of schema ``echelon.servos/1``; equal runs give equal data."""
    estimate = fit.estimate
    rows = zip(
        estimate.parameters, estimate.units, estimate.values, estimate.std, estimate.interval(level), strict=True
    )
    return {
        "schema": "echelon.servos/1",
        "echelon": __version__,
        "robot": fit.base.mechanism.name,
        "logs": list(fit.logs),
        "seed": fit.base.seed,
        "converged": fit.converged,
        "reasons": list(fit.reasons),
        "level": level,
        "parameters": [
            {"name": name, "unit": unit, "value": float(value), "std": float(std), "interval": interval.tolist()}
            for name, unit, value, std, interval in rows
        ],
        "delay": {"value": fit.delay, "std": fit.delay_std, "unit": "s"},
        "noise": dict(zip(estimate.outputs, map(float, estimate.noise), strict=True)),
        "hidden": list(fit.hidden),
        "fitted": [asdict(score) for score in fit.fitted],
        "held_out": [asdict(score) for score in fit.held_out],
        "findings": [str(finding) for finding in fit.findings],
        "base": to_dict(fit.base),
    }


def servo_to_json(fit: ServoFit) -> str:
    """The same as text."""
    return json.dumps(servo_document(fit), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
