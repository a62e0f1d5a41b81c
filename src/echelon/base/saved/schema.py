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
from echelon.shared import InputError, published_schema

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
    schema = kind.model_json_schema(by_alias=True)
    name, _, _ = schema["properties"]["schema"]["const"].partition("/")
    return published_schema(name.removeprefix("echelon."), schema)


class StrictRecord(Schema):
    """A part of a saved file that may hold no other keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FiniteRecord(StrictRecord):
    """A part of a saved file whose numbers are finite."""

    model_config = ConfigDict(allow_inf_nan=False)


# -- base models -------------------------------------------------------------------------------------------------------


class TermRecord(StrictRecord):
    """One standard parameter in a base parameter."""

    parameter: str = Field(description="Name of the standard parameter.")
    coefficient: str = Field(
        description="Exact coefficient: an expression in the geometry symbols, or its numerator."
    )
    denominator: str = Field("1", description="Exact denominator, where there is one.")
    value: float | None = Field(
        None, description="Numeric coefficient, if all symbols have values."
    )


class BaseParameterRecord(StrictRecord):
    """One base parameter, a row of B."""

    name: str = Field(description="The representative; its coefficient is 1.")
    unit: str = Field(description="SI unit.")
    expression: str = Field(description="Closed form for people.")
    terms: list[TermRecord] = Field(
        description="All terms, the representative included."
    )


class CertificateRecord(StrictRecord):
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


class NumbersRecord(StrictRecord):
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


class BaseModelRecord(StrictRecord):
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
        None, description="Coefficients without a closed form within the budget."
    )
    classification: dict[str, list[str]]
    reading: ReadingReport = Field(
        description="Rounded numbers taken as exact, and whether they mattered."
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


class LinearBaseRecord(StrictRecord):
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
