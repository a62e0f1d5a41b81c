"""The versioned JSON schema of an identified model."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Field

from echelon.results.preparation_record import ColumnMapRecord, PreparationRecord
from echelon.results.record import BaseModelRecord

Value = Annotated[float, Field(ge=-1e100, le=1e100)]
"""A parameter whose products still have doubles."""


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ParameterRecord(_Strict):
    """One estimated base parameter."""

    name: str
    unit: str = Field(description="SI unit.")
    expression: str = Field(description="Closed form for people.")
    value: float
    std: float | None = Field(description="Standard deviation; null where the data do not show the parameter.")
    low: float | None = Field(description="Lower end of the confidence interval.")
    high: float | None = Field(description="Upper end.")


class EstimateRecord(_Strict):
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


class ExcitationRecord(_Strict):
    """What the data show."""

    condition: float | None
    scaled_condition: float | None
    rank: int
    singular_values: list[float]
    visibility: list[float]
    weak: list[dict[str, Any]]


class FeasibilityRecord(_Strict):
    """Whether a physical robot has the estimated base parameters."""

    feasible: bool | None
    evidence: str
    distance: float | None
    nearest: list[float] | None


class PhysicalRecord(_Strict):
    """Standard parameters of a robot that can exist."""

    standard: dict[str, float] = Field(description="Standard parameters, SI units.")
    base: list[float] = Field(description="Their base parameters.")
    misfit: float | None
    least_misfit: float | None
    margins: dict[str, float | None]
    prior: str
    prior_weight: float | None
    status: str
    diagnostics: dict[str, Any]


class ScoreRecord(_Strict):
    """How well predictions fit one output; null where undefined."""

    output: str
    unit: str
    rows: int
    rms: float | None
    percent: float | None
    r2: float | None
    bias: float | None
    correlation_time: float | None
    whiteness: float | None


class ValidationRecord(_Strict):
    """Predictions of one log."""

    source: str
    role: Literal["identification", "validation"]
    scores: list[ScoreRecord]
    prior_scores: list[ScoreRecord]
    verdict: str


class LogRecord(_Strict):
    """A log that was used."""

    source: str
    role: Literal["identification", "validation"]
    bytes: int | None = Field(description="Size of the file.")
    sha256: str | None = Field(description="Of its content.")


class IdentifiedRecord(_Strict):
    """An identified model with everything needed to use it and to repeat the run."""

    format: Literal["echelon.identified/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    versions: dict[str, str] = Field(description="Versions of Python and of the packages that computed.")
    verdict: str
    findings: list[dict[str, str]]
    chosen: Literal["estimate", "essential", "physical"]
    values: dict[str, Value] = Field(description="Base parameters that predictions use, SI units.")
    estimate: EstimateRecord
    essential: EstimateRecord | None
    excitation: ExcitationRecord
    feasibility: FeasibilityRecord | None
    physical: PhysicalRecord | None
    validations: list[ValidationRecord]
    logs: list[LogRecord]
    columns: list[ColumnMapRecord] = Field(description="What the columns of logs mean.")
    preparation: PreparationRecord = Field(description="How logs were prepared, every choice filled in.")
    settings: dict[str, Any] = Field(description="What was fitted, and how; with the seed.")
    base: BaseModelRecord = Field(description="The base parameters and the mechanism.")


def json_schema() -> dict[str, Any]:
    """The JSON schema of the file."""
    return IdentifiedRecord.model_json_schema(by_alias=True)
