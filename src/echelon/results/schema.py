"""The saved forms of base models and of identified models, declared once: JSON schema, writing and checking follow.

:func:`record_of` fills a record from a result; :func:`made` makes the result's dataclass from a record.  A dataclass
that is saved as it is needs no record.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from echelon.base.reading_report import ReadingReport
from echelon.base.stated_values import SpecialValues
from echelon.choices import Values
from echelon.errors import InputError
from echelon.inputs import published_schema
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.preparation.prepare import Preparation

SCHEMA_NAME: Literal["echelon.base-model/1"] = "echelon.base-model/1"

Value = Annotated[
    float, Field(ge=-1e100, le=1e100)
]  # a parameter whose products still have doubles
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]

Record = TypeVar("Record", bound=Schema)
Made = TypeVar("Made")


def record_of(kind: type[Schema], found: object, **given: Any) -> dict[str, Any]:
    """Data of a record: each field as given, or the attribute of its name, as a record where that is one."""
    return {
        field.alias or name: given[name]
        if name in given
        else _inside(field.annotation, getattr(found, name))
        for name, field in kind.model_fields.items()
    }


def _inside(kind: Any, value: Any) -> Any:
    inner = next(
        (
            k
            for k in (kind, *get_args(kind))
            if isinstance(k, type) and issubclass(k, Schema)
        ),
        None,
    )
    if inner is None or value is None:
        return value
    return (
        [record_of(inner, one) for one in value]
        if isinstance(value, tuple)
        else record_of(inner, value)
    )


def checked(kind: type[Record], data: Any, source: str, what: str) -> Record:
    """Data as a record; an InputError names the element that is not as the schema says."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        problem = "needs a mapping" if first["type"] == "model_type" else first["msg"]
        raise InputError(
            f"not {what}: {problem}", source=source, element=where or None
        ) from None


def made(kind: type[Made], record: Schema) -> Made:
    """A dataclass, with those inside it, from the record of its fields."""
    return TypeAdapter(kind).validate_python(record.model_dump())


def json_schema(kind: type[Schema]) -> dict[str, Any]:
    """The JSON schema of a record."""
    names = {IdentifiedRecord: "identified", LinearBaseRecord: "linear-base"}
    name = names.get(kind, "base-model")
    return published_schema(name, kind.model_json_schema(by_alias=True))


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Finite(_Strict):
    model_config = ConfigDict(allow_inf_nan=False)


# -- base models -------------------------------------------------------------------------------------------------------


class TermRecord(_Strict):
    """One standard parameter in a base parameter."""

    parameter: str = Field(description="Name of the standard parameter.")
    coefficient: str = Field(
        description="Exact coefficient: an expression in the geometry symbols, or its numerator."
    )
    denominator: str = Field("1", description="Exact denominator, where there is one.")
    value: float | None = Field(
        None, description="Numeric coefficient, if all symbols have values."
    )


class BaseParameterRecord(_Strict):
    """One base parameter, a row of B."""

    name: str = Field(description="The representative; its coefficient is 1.")
    unit: str = Field(description="SI unit.")
    expression: str = Field(description="Closed form for people.")
    terms: list[TermRecord] = Field(
        description="All terms, the representative included."
    )


class CertificateRecord(_Strict):
    """Evidence; see the documentation of the certificate."""

    rank: int
    seed: int = Field(ge=0)
    minor_prime: int = Field(description="0 for a minor in ball arithmetic.")
    minor_states: int
    identity_primes: list[str] = Field(description="81-bit primes as decimal text.")
    degree: int
    log10_error: float
    at_values: bool = Field(
        False,
        description="Whether the minor was taken at the stated values of the symbols.",
    )
    regions: int = Field(
        0, description="Regions of signs that were visited; 0 without signs."
    )
    regions_note: str = ""
    rounding: float = Field(
        0,
        ge=0,
        description="With loops, the last decimal of the file to which the set holds.",
    )
    other_values: int = Field(
        0,
        ge=0,
        description="In ball arithmetic, other values at which formulas were checked.",
    )
    closed: bool = Field(
        False,
        description="Whether states are closed ones of loops, near the assembly pose.",
    )
    numbers: int = Field(
        0,
        description="Columns of B that are numbers, checked at the stated values only.",
    )
    log10_residual: float | None = Field(
        None,
        description="Bound on what is left at real states in ball arithmetic, beside the largest of a column.",
    )
    ball_states: int = Field(
        0,
        description="Real states at which coefficients were solved for in ball arithmetic.",
    )
    columns: dict[str, int] = Field(
        {}, description="Number of columns that each kind of check reached."
    )
    unchecked: list[str] = Field(
        [],
        description="Claims that no check reached; empty if the set is valid as a whole.",
    )


class NumbersRecord(_Strict):
    """Columns of B whose coefficients are numbers in place of closed forms."""

    parameters: list[str] = Field(
        description="Standard parameters whose coefficients are numbers."
    )
    at: dict[str, str] = Field(
        description="Values of the symbols that they are true at; radians for angles."
    )
    radius: float = Field(
        ge=0, description="Largest error of a coefficient; 0 where they are exact."
    )
    rounded: bool = Field(
        False, description="Whether they hold to the last decimals of a file only."
    )


class BaseModelRecord(_Strict):
    """A saved set of base parameters with everything needed to check it again."""

    format: Literal["echelon.base-model/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    name: str
    seed: int = Field(ge=0)
    rank: int
    outputs: list[str] = Field(
        description="Measured generalised forces, the rows of X."
    )
    parameters: list[str] = Field(
        description="Standard parameters, the columns of X and B."
    )
    order: list[str] = Field(
        description="Column order for which B is in reduced echelon form."
    )
    base: list[BaseParameterRecord]
    largest_coefficient: float | None = Field(
        None, description="Largest absolute value in B at the stated values."
    )
    numbers: NumbersRecord | None = Field(
        None, description="What has no closed form within the budget."
    )
    classification: dict[str, list[str]]
    reading: ReadingReport = Field(
        description="What was snapped when the file was read, and whether it mattered."
    )
    special: SpecialValues | None = Field(
        None, description="Present where the stated values change the answer."
    )
    generic: bool = Field(
        False, description="Whether the set is for general values of the symbols."
    )
    certificate: CertificateRecord
    model: dict[str, Any] = Field(
        description="The mechanism as an Echelon description."
    )


class LinearBaseRecord(_Strict):
    """A saved set of base parameters of a linear model."""

    format: Literal["echelon.linear-base/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    name: str
    seed: int = Field(ge=0)
    rank: int
    outputs: list[str] = Field(description="The rows of X.")
    order: list[str] = Field(
        description="Column order for which B is in reduced echelon form."
    )
    generic: bool = Field(
        False, description="Whether the set is for general values of the constants."
    )
    parameters: list[str] = Field(description="The columns of X and B.")
    base: list[BaseParameterRecord]
    numbers: NumbersRecord | None = Field(None, description="What has no closed form.")
    classification: dict[str, list[str]]
    special: SpecialValues | None = Field(
        None, description="Present where the stated values change the answer."
    )
    certificate: CertificateRecord
    model: dict[str, Any] = Field(description="The model as a document.")


# -- identified models -------------------------------------------------------------------------------------------------


class ParameterRecord(_Finite):
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


class EstimateRecord(_Finite):
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


class HypothesisRecord(_Finite):
    """What may be wrong or lacking, as it was judged."""

    kind: str = Field(
        description="What it is about, such as an effect, a gain, gravity or another reading."
    )
    words: str
    places: list[str] = Field(
        description="Drives, joints, outputs or bodies that it is about."
    )
    write: str = Field(description="What states it in a set-up, with {at} for places.")
    shrinkage: float = Field(
        description="Per cent by which residuals of held-out blocks shrink, all outputs together."
    )
    error: float = Field(description="Standard error of that, from blocks of time.")
    taken: bool = Field(
        description="Whether it explains what the model leaves, or was only tried."
    )


class ConditioningRecord(_Finite):
    """What the data show."""

    condition: float | None
    scaled_condition: float | None
    rank: int
    singular_values: list[float]
    independent_share: list[float]
    weak: list[dict[str, Any]]


class FeasibilityRecord(_Finite):
    """Whether a physical robot has the estimated base parameters."""

    feasible: bool | None
    evidence: str
    distance: float | None
    nearest: list[float] | None


class PhysicalRecord(_Finite):
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


class FitRecord(_Finite):
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


class ScoreRecord(_Finite):
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


class RangeRecord(_Finite):
    """What an output was fitted to; elsewhere the model extrapolates."""

    output: str
    band: float | None = Field(description="Highest frequency, Hz.")
    slowest: float | None = Field(
        description="Least speed of its joint or actuator, in unit; rows below left the fit."
    )
    fastest: float | None = Field(description="Largest speed.")
    unit: str
    rows: int
    left_out: int = Field(description="Rows near standstill that left the fit.")


class ValidationRecord(_Finite):
    """Predictions of one log."""

    source: str
    role: Literal["identification", "validation"]
    scores: list[ScoreRecord]
    prior_scores: list[ScoreRecord] = Field(description="Of the model one had before.")
    plain_scores: list[ScoreRecord] = Field(
        description="Of a model that was fitted without friction."
    )
    verdict: str


class LogRecord(_Finite):
    """A log that was used."""

    source: str
    role: Literal["identification", "validation"]
    bytes: int | None = Field(description="Size of the file.")
    sha256: str | None = Field(description="Of its content.")


class IdentifiedRecord(_Finite):
    """An identified model with everything needed to use it and to repeat the run."""

    format: Literal["echelon.identified/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    versions: dict[str, str] = Field(
        description="Versions of Python and of the packages that computed."
    )
    verdict: str
    reasons: list[str] = Field(
        description="Why the model should not be used; empty if nothing speaks against it."
    )
    findings: list[dict[str, str]]
    hypotheses: list[HypothesisRecord] = Field(
        description="What may be wrong or lacking, best ones first."
    )
    predict_with: Values
    values: dict[str, Value] = Field(
        description="Base parameters that predictions use, SI units."
    )
    ranges: list[RangeRecord] = Field(description="What every output was fitted to.")
    estimate: EstimateRecord
    essential: EstimateRecord | None
    conditioning: ConditioningRecord
    feasibility: FeasibilityRecord | None
    physical: PhysicalRecord | None
    validations: list[ValidationRecord]
    logs: list[LogRecord]
    columns: list[ColumnMap] = Field(description="What the columns of logs mean.")
    preparation: Preparation = Field(
        description="How logs were prepared, every choice filled in."
    )
    settings: dict[str, Any] = Field(
        description="What was fitted, and how; with the seed."
    )
    base: BaseModelRecord = Field(description="The base parameters and the mechanism.")
