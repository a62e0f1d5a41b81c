"""Identified models, and fits of servos, as JSON: everything needed to use them and to repeat the run."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from echelon.base import BaseModel, from_json, to_dict
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.result import Identification
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.travels import Travel
from echelon.identification.saved.schema import (
    EstimateRecord,
    HypothesisRecord,
    IdentifiedRecord,
    ParameterRecord,
    PhysicalRecord,
    ScoreRecord,
    TravelRecord,
)
from echelon.identification.scores import Score
from echelon.identification.servos.servo_fit import ServoFit
from echelon.shared import (
    Floats,
    InputError,
    __version__,
    parse_json,
    plain_data,
    public,
    read_content,
    record_data,
    record_from,
    write_atomically,
)

_COMPUTED_WITH = (
    "numpy",
    "scipy",
    "sympy",
    "python-flint",
    "llvmlite",
    "clarabel",
    "pyarrow",
)
_BLOCK = 1 << 20  # bytes of a log that are hashed at once


@dataclass(frozen=True, repr=False)
class IdentifiedModel:
    """A saved model, ready to predict."""

    base: BaseModel
    values: Floats  # shape (r,): base parameters, SI units
    columns: tuple[ColumnMap, ...]
    preparation: Preparation
    document: Mapping[str, Any]  # all that the file says
    travels: tuple[Travel, ...]  # what it was fitted to

    @property
    def plan(self) -> LogPlan:
        """How logs become rows, as when the model was fitted."""
        return LogPlan(self.base, self.columns, self.preparation, travels=self.travels)

    def __repr__(self) -> str:
        return f"IdentifiedModel({self.base.mechanism.name}: {self.base.rank} base parameters)"


@public
def save_identification(
    identification: Identification, path: str | os.PathLike[str]
) -> None:
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


@public
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
    source = str(path)
    document = parse_json(read_content(path), source)
    record = record_from(IdentifiedRecord, document, source, "an identified model")
    base = from_json(json.dumps(document["base"]), source)
    if list(record.values) != list(base.pivots):
        raise InputError(
            "the values are not those of the base parameters",
            source=source,
            element="values",
        )
    values = np.array(list(record.values.values()))
    columns, travels = tuple(record.columns), _travels(record.travels)
    return IdentifiedModel(base, values, columns, record.preparation, document, travels)


def _travels(records: Sequence[TravelRecord]) -> tuple[Travel, ...]:
    return tuple(
        Travel(
            some.coordinate,
            *(
                math.nan if value is None else value
                for value in (some.low, some.high, some.speed, some.acceleration)
            ),
        )
        for some in records
    )


def identification_to_json(identification: Identification) -> str:
    """An identification as JSON text; equal runs give equal text."""
    document = identification_document(identification)
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def identification_document(result: Identification) -> dict[str, Any]:
    """All of an identification as JSON-able data of schema ``echelon.identified/1``; null where JSON has no number."""
    settings = dict(result.settings)
    document = record_data(
        IdentifiedRecord,
        result,
        schema="echelon.identified/1",
        echelon=__version__,
        versions=_versions(),
        findings=[asdict(finding) for finding in result.findings],
        hypotheses=[
            record_data(HypothesisRecord, some, error=100 * some.gain.error)
            for some in result.hypotheses
        ],
        values=dict(zip(result.base.pivots, result.values, strict=True)),
        estimate=_estimate(result.estimate, result),
        essential=None
        if result.essential is None
        else _estimate(result.essential, result),
        physical=None
        if (fit := result.physical) is None
        else record_data(
            PhysicalRecord,
            fit,
            standard=dict(zip(fit.parameters, fit.standard, strict=True)),
        ),
        logs=_logs(result),
        columns=settings.pop("columns", []),
        preparation=_preparation(result.preparation),
        settings=settings,
        base=to_dict(result.base),
    )
    found: dict[str, Any] = plain_data(document)
    return found


def _preparation(preparation: Preparation) -> dict[str, Any]:
    """A preparation with an infinite cut-off, which means no filter, as a word."""
    stated = preparation.model_dump().items()
    found = {key: "inf" if value == math.inf else value for key, value in stated}
    own = preparation.experiments.items()
    return {**found, "experiments": {name: _preparation(some) for name, some in own}}


def _estimate(estimate: Estimate, result: Identification) -> dict[str, Any]:
    columns = zip(
        estimate.units,
        estimate.values,
        estimate.std,
        *estimate.interval(result.level).T,
        strict=True,
    )
    rows = (
        dict(zip(("unit", "value", "std", "low", "high"), row, strict=True))
        for row in columns
    )
    expressions = result.base.expressions
    parameters = [
        record_data(ParameterRecord, expression, expression=str(expression), **row)
        for expression, row in zip(expressions, rows, strict=True)
    ]
    return record_data(
        EstimateRecord,
        estimate,
        level=result.level,
        parameters=parameters,
        noise=dict(zip(estimate.outputs, estimate.noise, strict=True)),
        rows=dict(zip(estimate.outputs, estimate.rows, strict=True)),
    )


def score_record(score: Score) -> dict[str, Any]:
    """A score as JSON-able data; null where JSON has no number."""
    found: dict[str, Any] = plain_data(record_data(ScoreRecord, score))
    return found


def _logs(result: Identification) -> list[dict[str, Any]]:
    mine = [(source, "identification") for source in result.logs]
    others = [
        v.source
        for v in result.validations
        if v.role == "validation" and v.source not in result.logs
    ]
    mine += [(source, "validation") for source in dict.fromkeys(others)]
    return [
        {"source": source, "role": role, **_digest(Path(source))}
        for source, role in mine
    ]


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


def servo_document(fit: ServoFit) -> dict[str, Any]:
    """All of a fit as JSON-able data of schema ``echelon.servos/1``; equal runs give equal data."""
    estimate, level = fit.estimate, 0.95
    rows = zip(
        estimate.parameters,
        estimate.units,
        estimate.values,
        estimate.std,
        estimate.interval(level),
        strict=True,
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
            {
                "name": name,
                "unit": unit,
                "value": float(value),
                "std": float(std),
                "interval": interval.tolist(),
            }
            for name, unit, value, std, interval in rows
        ],
        "delay": {"value": fit.delay, "std": fit.delay_std, "unit": "s"},
        "noise": dict(zip(estimate.outputs, map(float, estimate.noise), strict=True)),
        "limits": [asdict(limit) for limit in fit.limits],
        "hidden": list(fit.hidden),
        "fitted": [asdict(score) for score in fit.fitted],
        "held_out": [asdict(score) for score in fit.held_out],
        "findings": [str(finding) for finding in fit.findings],
        "base": to_dict(fit.base),
    }


def servo_to_json(fit: ServoFit) -> str:
    """Servo document as JSON text."""
    return (
        json.dumps(servo_document(fit), indent=1, ensure_ascii=False, allow_nan=False)
        + "\n"
    )
