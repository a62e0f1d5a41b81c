"""A calibration as a versioned JSON document."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from echelon.calibration.calibrating import Calibration
from echelon.shared import Floats, Record, file_schema, record_data, required

SCHEMA: Literal["echelon.calibration/1"] = "echelon.calibration/1"


class CombinationRecord(Record):
    """A combination of errors that the measurements show."""

    combination: str
    unit: str
    value: float
    deviation: float
    low: float
    high: float
    shown: bool


class HeldOutRecord(Record):
    """Root mean squares of what is left in held-out rows, m or rad."""

    measurement: str
    unit: str
    rows: int
    before: float
    after: float
    median: float
    noise: float


class CalibrationRecord(Record):
    """A calibrated geometry; frames are 4 × 4 matrices by rows."""

    title = "Echelon calibration"

    schema: Literal["echelon.calibration/1"]
    robot: str
    rank: int
    certificate: str
    combinations: list[CombinationRecord]
    unidentifiable: list[str]
    errors: dict[str, float]
    scores: list[HeldOutRecord]
    outliers: list[str]
    left_out: int
    tools: dict[str, list[list[float]]]
    frames: dict[str, list[list[float]]]
    doubts: list[str] = required("Measurements that the result does not explain.")


def calibration_schema() -> dict[str, Any]:
    """The JSON schema of the document."""
    return file_schema(CalibrationRecord)


def calibration_document(found: Calibration) -> dict[str, Any]:
    """A calibration as JSON-able data."""
    base = found.base
    combinations = [
        {
            "combination": str(expression),
            "unit": expression.unit,
            "value": value,
            "deviation": deviation,
            "low": low,
            "high": high,
            "shown": pivot not in found.hidden,
        }
        for expression, pivot, value, deviation, (low, high) in zip(
            base.readable,
            base.pivots,
            found.values.tolist(),
            found.deviations.tolist(),
            found.intervals.tolist(),
            strict=True,
        )
    ]
    scores = [
        record_data(HeldOutRecord, score, measurement=score.name)
        for score in found.scores
    ]
    document = record_data(
        CalibrationRecord,
        found,
        schema=SCHEMA,
        robot=found.robot.mechanism.name,
        rank=base.rank,
        certificate=str(base.certificate),
        combinations=combinations,
        scores=scores,
        tools=_listed(found.tools),
        frames=_listed(found.frames),
    )
    return CalibrationRecord.model_validate(document).model_dump()


def _listed(frames: Mapping[str, Floats]) -> dict[str, list[list[float]]]:
    return {name: frame.tolist() for name, frame in frames.items()}
