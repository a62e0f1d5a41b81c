"""JSON schema of identified models."""

from __future__ import annotations

from typing import Any, Literal

from echelon.base import BaseModelRecord, Value
from echelon.identification.logs.columns.column_map import ColumnMap
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.shared import Record, Values, required


class ParameterRecord(Record):
    """One estimated base parameter."""

    name: str
    unit: str = required("SI unit.")
    expression: str = required("Closed form for people.")
    value: float
    std: float | None = required(
        "Standard deviation; null where the data do not show the parameter."
    )
    low: float | None = required("Lower end of the confidence interval.")
    high: float | None = required("Upper end.")


class EstimateRecord(Record):
    """An estimate of the base parameters."""

    method: str
    level: float = required("Probability of the intervals.")
    parameters: list[ParameterRecord]
    covariance: list[list[float | None]]
    noise: dict[str, float | None] = required(
        "Standard deviation of each output's residual, unit of the output."
    )
    rows: dict[str, int] = required("Rows of each output.")
    degrees: float = required("Residual degrees of freedom.")
    diagnostics: dict[str, Any]


class HypothesisRecord(Record):
    """A hypothesis about the model or the log, and its score."""

    kind: str = required("Kind, such as an effect, a gain, gravity or another reading.")
    words: str
    places: list[str] = required("Drives, joints, outputs or bodies concerned.")
    write: str = required("Entry of a set-up that states it, with {at} for places.")
    shrinkage: float = required(
        "Per cent by which residuals of held-out blocks shrink, all outputs together."
    )
    error: float = required("Standard error of that, from blocks of time.")
    taken: bool = required("Whether it explains the residuals, or was only tried.")


class ConditioningRecord(Record):
    """Conditioning of the observation matrix."""

    condition: float | None
    scaled_condition: float | None
    rank: int
    singular_values: list[float]
    independent_share: list[float]
    weak: list[dict[str, Any]]


class FeasibilityRecord(Record):
    """Whether a physical robot has the estimated base parameters."""

    feasible: bool | None
    evidence: str
    distance: float | None
    nearest: list[float] | None


class PhysicalRecord(Record):
    """Standard parameters of a robot that can exist."""

    standard: dict[str, float] = required("Standard parameters, SI units.")
    base: list[float] = required("Their base parameters.")
    misfit: float | None
    unconstrained_misfit: float | None
    margins: dict[str, float | None]
    prior: str
    prior_weight: float | None
    status: str
    diagnostics: dict[str, Any]


class BodyMassRecord(Record):
    """Mass and centre of mass of a body that data tell alone, with confidence intervals."""

    body: str
    mass: float = required("Mass, kg.")
    mass_low: float
    mass_high: float
    centre: list[float] = required("Centre of mass in the frame of the body, m.")
    centre_low: list[float]
    centre_high: list[float]


class FitRecord(Record):
    """How well predictions fit some rows of an output; null where undefined."""

    rows: int
    rms: float | None = required(
        "Root mean square of measured − predicted, unit of the output."
    )
    percent: float | None = required(
        "Root mean square in per cent of the range of the measured values."
    )
    r2: float | None = required("Coefficient of determination.")
    bias: float | None = required("Mean of measured − predicted.")


class ScoreRecord(Record):
    """How well predictions fit one output; null where undefined."""

    output: str
    unit: str
    whole: FitRecord = required("All rows, after the filter of both sides.")
    moving: FitRecord = required("Those of them that move.")
    raw: FitRecord = required("All samples, without a filter.")
    noise: float | None = required(
        "Standard deviation of white noise in the measured samples."
    )
    correlation_time: float | None
    whiteness: float | None
    fastest: float | None = required(
        "Largest speed of its joint or actuator, rad/s or m/s."
    )


class RangeRecord(Record):
    """Range of the data that an output was fitted to; beyond it the model extrapolates."""

    output: str
    band: float | None = required("Highest frequency, Hz.")
    slowest: float | None = required(
        "Least speed of its joint or actuator, in unit; rows below left the fit."
    )
    fastest: float | None = required("Largest speed.")
    unit: str
    rows: int
    left_out: int = required("Rows near standstill that left the fit.")


class TravelRecord(Record):
    """Travel of a coordinate in the data that the model was fitted to; beyond it the model extrapolates."""

    coordinate: str
    low: float | None = required("Lowest position, rad or m; null for balls.")
    high: float | None = required("Highest position.")
    speed: float | None = required(
        "Largest speed, rad/s or m/s; null for components of quaternions."
    )
    acceleration: float | None = required(
        "Largest acceleration in the band, rad/s² or m/s²."
    )


class ValidationRecord(Record):
    """Predictions of one log."""

    source: str
    role: Literal["identification", "validation"]
    scores: list[ScoreRecord]
    prior_scores: list[ScoreRecord] = required("Scores of the model before the fit.")
    plain_scores: list[ScoreRecord] = required(
        "Scores of a model that was fitted without friction."
    )
    verdict: str


class LogRecord(Record):
    """A log that was used."""

    source: str
    role: Literal["identification", "validation"]
    bytes: int | None = required("Size of the file.")
    sha256: str | None = required("SHA-256 digest of its content.")


class IdentifiedRecord(Record):
    """An identified model with everything needed to use it and to repeat the run."""

    schema: Literal["echelon.identified/1"]
    echelon: str = required("Version that wrote the file.")
    versions: dict[str, str] = required(
        "Versions of Python and of the packages that computed."
    )
    verdict: str
    reasons: list[str] = required(
        "Reasons not to use the model; empty if there are none."
    )
    findings: list[dict[str, str]]
    hypotheses: list[HypothesisRecord] = required(
        "Possible errors of model and logs, best ones first."
    )
    untested: list[str] = required(
        "Possible errors that these data do not let be tested, and why."
    )
    predict_with: Values
    values: dict[str, Value] = required(
        "Base parameters that predictions use, SI units."
    )
    ranges: list[RangeRecord] = required("Rows that every output was fitted to.")
    travels: list[TravelRecord] = required(
        "How far and how fast coordinates went in the fitted data."
    )
    estimate: EstimateRecord
    essential: EstimateRecord | None
    masses: list[BodyMassRecord] = required(
        "Bodies whose mass and centre of mass the data tell alone."
    )
    conditioning: ConditioningRecord
    feasibility: FeasibilityRecord | None
    physical: PhysicalRecord | None
    validations: list[ValidationRecord]
    logs: list[LogRecord]
    columns: list[ColumnMap] = required("Meaning of the columns of logs.")
    preparation: Preparation = required("Preparation of the logs, with every choice.")
    settings: dict[str, Any] = required("Settings of the fit, with the seed.")
    base: BaseModelRecord = required("The base parameters and the mechanism.")
