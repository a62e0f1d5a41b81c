"""An identification as JSON-able data."""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from echelon.identification.estimators.estimate import Estimate
from echelon.identification.result import Identification
from echelon.results.saved import to_dict
from echelon.version import __version__

_COMPUTED_WITH = ("numpy", "scipy", "sympy", "python-flint", "llvmlite", "clarabel", "pyarrow")
_BLOCK = 1 << 20


def identification_document(result: Identification) -> dict[str, Any]:
    """All of it, without numbers that JSON cannot say."""
    found: dict[str, Any] = _finite(_document(result))
    return found


def _document(result: Identification) -> dict[str, Any]:
    names = [expression.name for expression in result.base.expressions]
    settings = dict(result.settings)
    return {
        "schema": "echelon.identified/1",
        "echelon": __version__,
        "versions": _versions(),
        "verdict": result.verdict,
        "findings": [{**asdict(finding), "severity": finding.severity.value} for finding in result.findings],
        "chosen": result.chosen,
        "values": dict(zip(names, map(float, result.values), strict=True)),
        "estimate": _estimate(result.estimate, result),
        "essential": None if result.essential is None else _estimate(result.essential, result),
        "excitation": _excitation(result),
        "feasibility": _feasibility(result),
        "physical": _physical(result),
        "validations": [_validation(validation) for validation in result.validations],
        "logs": _logs(result),
        "columns": settings.pop("columns", []),
        "preparation": {key: _number_or_text(value) for key, value in asdict(result.preparation).items()},
        "settings": settings,
        "base": to_dict(result.base),
    }


def _estimate(estimate: Estimate, result: Identification) -> dict[str, Any]:
    level = float(result.settings.get("level", 0.95))
    intervals = estimate.interval(level)
    rows = zip(result.base.expressions, estimate.units, estimate.values, estimate.std, intervals, strict=True)
    return {
        "method": estimate.method,
        "level": level,
        "parameters": [
            {
                "name": expression.name,
                "unit": unit,
                "expression": str(expression),
                "value": float(value),
                "std": float(std),
                "low": float(low),
                "high": float(high),
            }
            for expression, unit, value, std, (low, high) in rows
        ],
        "covariance": estimate.covariance.tolist(),
        "noise": dict(zip(estimate.outputs, map(float, estimate.noise), strict=True)),
        "rows": dict(zip(estimate.outputs, estimate.rows, strict=True)),
        "degrees": float(estimate.degrees),
        "diagnostics": dict(estimate.diagnostics),
    }


def _excitation(result: Identification) -> dict[str, Any]:
    found = result.excitation
    return {
        "condition": found.condition,
        "scaled_condition": found.scaled_condition,
        "rank": found.rank,
        "singular_values": found.singular_values.tolist(),
        "visibility": found.visibility.tolist(),
        "weak": [asdict(direction) for direction in found.weak],
    }


def _feasibility(result: Identification) -> dict[str, Any] | None:
    found = result.feasibility
    if found is None:
        return None
    return {
        "feasible": found.feasible,
        "evidence": found.evidence,
        "distance": found.distance,
        "nearest": None if found.nearest is None else found.nearest.tolist(),
    }


def _physical(result: Identification) -> dict[str, Any] | None:
    fit = result.physical
    if fit is None:
        return None
    return {
        "standard": dict(zip(fit.parameters, map(float, fit.standard), strict=True)),
        "base": fit.base.tolist(),
        "misfit": fit.misfit,
        "least_misfit": fit.least_misfit,
        "margins": dict(fit.margins),
        "prior": fit.prior,
        "prior_weight": fit.prior_weight,
        "status": fit.status,
        "diagnostics": dict(fit.diagnostics),
    }


def _validation(validation: Any) -> dict[str, Any]:
    return {
        "source": validation.source,
        "role": validation.role,
        "scores": [asdict(score) for score in validation.scores],
        "prior_scores": [asdict(score) for score in validation.prior_scores],
        "verdict": validation.verdict,
    }


def _logs(result: Identification) -> list[dict[str, Any]]:
    mine = [(source, "identification") for source in result.logs]
    others = [v.source for v in result.validations if v.role == "validation" and v.source not in result.logs]
    mine += [(source, "validation") for source in dict.fromkeys(others)]
    return [{"source": source, "role": role, **_digest(Path(source))} for source, role in mine]


def _number_or_text(value: Any) -> Any:
    """An infinite cut-off, which means no filter, as a word."""
    return "inf" if isinstance(value, float) and math.isinf(value) else value


def _digest(path: Path) -> dict[str, Any]:
    """Size and hash of a file; of a log that is not a file (a bag in a folder, samples in memory) nothing."""
    if not path.is_file():
        return {"bytes": None, "sha256": None}
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(_BLOCK):
            digest.update(block)
    return {"bytes": path.stat().st_size, "sha256": digest.hexdigest()}


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for package in _COMPUTED_WITH:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _finite(value: Any) -> Any:
    """The same data without what JSON cannot say: numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, np.generic):
        return _finite(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
