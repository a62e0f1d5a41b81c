"""JSON schema of identified models."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from echelon.base import (
    BaseModelRecord,
    FiniteRecord,
    Value,
)
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.shared import Values


class ParameterRecord(FiniteRecord):
    """One estimated base parameter."""

    name: str
    unit: str = Field(description="SI unit.")
    expression: str = Field(description="Closed form for people.")
    value: float
    std: float | None = Field(
        description="Standard deviation; null where the data do not show the parameter."
    )
    low: float | None = Field(description="Lower end of the confidence interval.")
    high: float | None = Field(description="Upper end.")


class EstimateRecord(FiniteRecord):
    """An estimate of the base parameters."""

    method: str
    level: float = Field(description="Probability of the intervals.")
    parameters: list[ParameterRecord]
    covariance: list[list[float | None]]
    noise: dict[str, float | None] = Field(
        description="Standard deviation of each output's residual, unit of the output."
    )
    rows: dict[str, int] = Field(description="Rows of each output.")
    degrees: float = Field(description="Residual degrees of freedom.")
    diagnostics: dict[str, Any]


class HypothesisRecord(FiniteRecord):
    """A hypothesis about the model or the log, and its score."""

    kind: str = Field(
        description="Kind, such as an effect, a gain, gravity or another reading."
    )
    words: str
    places: list[str] = Field(
        description="Drives, joints, outputs or bodies concerned."
    )
    write: str = Field(
        description="Entry of a set-up that states it, with {at} for places."
    )
    shrinkage: float = Field(
        description="Per cent by which residuals of held-out blocks shrink, all outputs together."
    )
    error: float = Field(description="Standard error of that, from blocks of time.")
    taken: bool = Field(
        description="Whether it explains the residuals, or was only tried."
    )


class ConditioningRecord(FiniteRecord):
    """Conditioning of the observation matrix."""

    condition: float | None
    scaled_condition: float | None
    rank: int
    singular_values: list[float]
    independent_share: list[float]
    weak: list[dict[str, Any]]


class FeasibilityRecord(FiniteRecord):
    """Whether a physical robot has the estimated base parameters."""

    feasible: bool | None
    evidence: str
    distance: float | None
    nearest: list[float] | None


class PhysicalRecord(FiniteRecord):
    """Standard parameters of a robot that can exist."""

    standard: dict[str, float] = Field(description="Standard parameters, SI units.")
    base: list[float] = Field(description="Their base parameters.")
    misfit: float | None
    unconstrained_misfit: float | None
    margins: dict[str, float | None]
    prior: str
    prior_weight: float | None
    status: str
    diagnostics: dict[str, Any]


class FitRecord(FiniteRecord):
    """How well predictions fit some rows of an output; null where undefined."""

    rows: int
    rms: float | None = Field(
        description="Root mean square of measured − predicted, unit of the output."
    )
    percent: float | None = Field(
        description="The same in per cent of the range of the measured values."
    )
    r2: float | None = Field(description="Coefficient of determination.")
    bias: float | None = Field(description="Mean of measured − predicted.")


class ScoreRecord(FiniteRecord):
    """How well predictions fit one output; null where undefined."""

    output: str
    unit: str
    whole: FitRecord = Field(description="All rows, after the filter of both sides.")
    moving: FitRecord = Field(description="Those of them that move.")
    raw: FitRecord = Field(description="All samples, without a filter.")
    noise: float | None = Field(
        description="Standard deviation of white noise in the measured samples."
    )
    correlation_time: float | None
    whiteness: float | None
    fastest: float | None = Field(
        description="Largest speed of its joint or actuator, rad/s or m/s."
    )


class RangeRecord(FiniteRecord):
    """Range of the data that an output was fitted to; beyond it the model extrapolates."""

    output: str
    band: float | None = Field(description="Highest frequency, Hz.")
    slowest: float | None = Field(
        description="Least speed of its joint or actuator, in unit; rows below left the fit."
    )
    fastest: float | None = Field(description="Largest speed.")
    unit: str
    rows: int
    left_out: int = Field(description="Rows near standstill that left the fit.")


class ValidationRecord(FiniteRecord):
    """Predictions of one log."""

    source: str
    role: Literal["identification", "validation"]
    scores: list[ScoreRecord]
    prior_scores: list[ScoreRecord] = Field(description="Of the model before the fit.")
    plain_scores: list[ScoreRecord] = Field(
        description="Of a model that was fitted without friction."
    )
    verdict: str


class LogRecord(FiniteRecord):
    """A log that was used."""

    source: str
    role: Literal["identification", "validation"]
    bytes: int | None = Field(description="Size of the file.")
    sha256: str | None = Field(description="Of its content.")


class IdentifiedRecord(FiniteRecord):
    """An identified model with everything needed to use it and to repeat the run."""

    format: Literal["echelon.identified/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    versions: dict[str, str] = Field(
        description="Versions of Python and of the packages that computed."
    )
    verdict: str
    reasons: list[str] = Field(
        description="Reasons not to use the model; empty if there are none."
    )
    findings: list[dict[str, str]]
    hypotheses: list[HypothesisRecord] = Field(
        description="Possible errors of model and logs, best ones first."
    )
    predict_with: Values
    values: dict[str, Value] = Field(
        description="Base parameters that predictions use, SI units."
    )
    ranges: list[RangeRecord] = Field(
        description="Rows that every output was fitted to."
    )
    estimate: EstimateRecord
    essential: EstimateRecord | None
    conditioning: ConditioningRecord
    feasibility: FeasibilityRecord | None
    physical: PhysicalRecord | None
    validations: list[ValidationRecord]
    logs: list[LogRecord]
    columns: list[ColumnMap] = Field(description="Meaning of the columns of logs.")
    preparation: Preparation = Field(
        description="Preparation of the logs, with every choice."
    )
    settings: dict[str, Any] = Field(description="Settings of the fit, with the seed.")
    base: BaseModelRecord = Field(description="The base parameters and the mechanism.")
