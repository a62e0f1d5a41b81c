"""Identified models as JSON: everything that was found, and enough to use it and to repeat the run."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.files import write_atomically
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.result import Identification
from echelon.identification.rows.plan import Plan
from echelon.logs.column_map import Channel, ColumnMap
from echelon.logs.preparation import Preparation
from echelon.results.saved import from_json, to_dict
from echelon.version import __version__

if TYPE_CHECKING:
    from echelon.results.identified_record import IdentifiedRecord

Floats = npt.NDArray[np.float64]

_COMPUTED_WITH = ("numpy", "scipy", "sympy", "python-flint", "llvmlite", "cvxpy", "clarabel", "pyarrow")
_BLOCK = 1 << 20


@dataclass(frozen=True, repr=False)
class IdentifiedModel:
    """A saved model, ready to predict.

    Attributes
    ----------
    base : BaseModel
    values : array of shape (r,)
        Base parameters, SI units.
    columns : tuple of ColumnMap
    preparation : Preparation
    document : mapping
        All that the file says.
    """

    base: BaseModel
    values: Floats
    columns: tuple[ColumnMap, ...]
    preparation: Preparation
    document: Mapping[str, Any]

    @property
    def plan(self) -> Plan:
        """How logs become rows, as when the model was fitted."""
        return Plan(self.base, self.columns, self.preparation)

    def __repr__(self) -> str:
        return f"IdentifiedModel({self.base.mechanism.name}: {self.base.rank} base parameters)"


def save_identification(identification: Identification, path: str | os.PathLike[str]) -> None:
    """Write an identification to a JSON file of schema ``echelon.identified/1``, whole or not at all.

    Parameters
    ----------
    identification : Identification
    path : path-like

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write_atomically(path, identification_to_json(identification))


def identification_to_json(identification: Identification) -> str:
    """An identification as JSON text; equal runs give equal text."""
    return json.dumps(_finite(_document(identification)), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def load_identified(path: str | os.PathLike[str]) -> IdentifiedModel:
    """Read an identified model.

    Parameters
    ----------
    path : path-like
        Written by :func:`save_identification` or ``echelon identify``.

    Returns
    -------
    IdentifiedModel

    Raises
    ------
    InputError
        If the file cannot be read or is not an identified model; names the element.
    """
    from pydantic import ValidationError

    from echelon.results.identified_record import IdentifiedRecord

    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(path)) from None
    try:
        record = IdentifiedRecord.model_validate_json(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        problem = f"not an identified model: {first['msg']}"
        raise InputError(problem, source=str(path), element=where or None) from None
    return _from_record(record, json.loads(data), str(path))


def _from_record(record: IdentifiedRecord, document: Mapping[str, Any], source: str) -> IdentifiedModel:
    base = from_json(json.dumps(document["base"]), source)
    names = [expression.name for expression in base.expressions]
    if list(record.values) != names:
        raise InputError("the values are not those of the base parameters", source=source, element="values")
    try:
        columns = tuple(_column_map(entry) for entry in record.columns)
        known = {field.name for field in fields(Preparation)}
        stated = {key: value for key, value in record.preparation.items() if key in known}
        if isinstance(stated.get("decimation"), list):
            stated["decimation"] = tuple(stated["decimation"])
        stated |= {key: math.inf for key in ("cutoff", "output_cutoff") if stated.get(key) == "inf"}
        preparation = Preparation(**stated)
    except (TypeError, ValueError) as error:
        raise InputError(f"columns or preparation cannot be read: {error}", source=source) from None
    return IdentifiedModel(base, np.array(list(record.values.values())), columns, preparation, document)


def _column_map(entry: Mapping[str, Any]) -> ColumnMap:
    channels = {
        key: {name: Channel(**channel) for name, channel in value.items()}
        for key, value in entry.items()
        if isinstance(value, dict) and key != "time"
    }
    time = entry.get("time")
    return ColumnMap(None if time is None else Channel(**time), entry.get("rate"), **channels)


# -- writing -------------------------------------------------------------------------------------------------------


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
        "proof": found.proof,
        "distance": found.distance,
        "nearest": None if found.nearest is None else found.nearest.tolist(),
        "separator": None if found.separator is None else found.separator.tolist(),
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
