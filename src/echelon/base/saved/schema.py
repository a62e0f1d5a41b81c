"""The saved forms of base models, declared once: JSON schema, writing and checking follow.

A dataclass that is saved as it is needs no record.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from echelon.base.reading_report import ReadingReport
from echelon.base.stated_values import SpecialValues
from echelon.shared import (
    PlainValidator,
    Record,
    UnfitError,
    Within,
    WithJsonSchema,
    optional,
    required,
)

SCHEMA_NAME: Literal["echelon.base-model/1"] = "echelon.base-model/1"

Value = Annotated[
    float, Within(ge=-1e100, le=1e100)
]  # a parameter whose products still have doubles


def _prime(value: object) -> int:
    if not isinstance(value, str) or not value.isdecimal():
        raise UnfitError("primes are decimal numbers")
    return int(value)


Prime = Annotated[int, PlainValidator(_prime), WithJsonSchema({"type": "string"})]

# -- base models -------------------------------------------------------------------------------------------------------


class TermRecord(Record):
    """One standard parameter in a base parameter."""

    parameter: str = required("Name of the standard parameter.")
    coefficient: str = required(
        "Exact coefficient: an expression in the geometry symbols, or its numerator."
    )
    denominator: str = optional("1", "Exact denominator, where there is one.")
    value: float | None = optional(
        None, "Numeric coefficient, if all symbols have values."
    )


class BaseParameterRecord(Record):
    """One base parameter, a row of B."""

    name: str = required("The representative; its coefficient is 1.")
    unit: str = required("SI unit.")
    expression: str = required("Closed form for people.")
    terms: list[TermRecord] = required("All terms, the representative included.")


class CertificateRecord(Record):
    """Evidence; see the documentation of the certificate."""

    rank: int
    seed: Annotated[int, Within(ge=0)]
    minor_prime: int = required("0 for a minor in ball arithmetic.")
    minor_states: int
    identity_primes: tuple[Prime, ...] = required("81-bit primes as decimal text.")
    degree: int
    log10_error: float
    at_values: bool = optional(
        False, "Whether the minor was taken at the stated values of the symbols."
    )
    regions: int = optional(0, "Regions of signs that were visited; 0 without signs.")
    regions_note: str = ""
    rounding: Annotated[float, Within(ge=0)] = optional(
        0, "With loops, the last decimal of the file to which the set holds."
    )
    other_values: Annotated[int, Within(ge=0)] = optional(
        0, "In ball arithmetic, other values at which formulas were checked."
    )
    closed: bool = optional(
        False, "Whether states are closed ones of loops, near the assembly pose."
    )
    numbers: int = optional(
        0, "Columns of B that are numbers, checked at the stated values only."
    )
    log10_residual: float | None = optional(
        None,
        "Bound on what is left at real states in ball arithmetic, beside the largest of a column.",
    )
    ball_states: int = optional(
        0, "Real states at which coefficients were solved for in ball arithmetic."
    )
    columns: dict[str, int] = optional(
        {}, "Number of columns that each kind of check reached."
    )
    unchecked: tuple[str, ...] = optional(
        (), "Claims that no check reached; empty if the set is valid as a whole."
    )


class NumbersRecord(Record):
    """Columns of B whose coefficients are numbers in place of closed forms."""

    parameters: list[str] = required(
        "Standard parameters whose coefficients are numbers."
    )
    at: dict[str, str] = required(
        "Values of the symbols that they are true at; radians for angles."
    )
    radius: Annotated[float, Within(ge=0)] = required(
        "Largest error of a coefficient; 0 where they are exact."
    )
    rounded: bool = optional(
        False, "Whether they hold to the last decimals of a file only."
    )


class BaseModelRecord(Record):
    """A saved set of base parameters with everything needed to check it again."""

    schema: Literal["echelon.base-model/1"]
    echelon: str = required("Version that wrote the file.")
    name: str
    seed: Annotated[int, Within(ge=0)]
    rank: int
    outputs: list[str] = required("Measured generalised forces, the rows of X.")
    parameters: list[str] = required("Standard parameters, the columns of X and B.")
    order: list[str] = required("Column order for which B is in reduced echelon form.")
    base: list[BaseParameterRecord]
    largest_coefficient: float | None = optional(
        None, "Largest absolute value in B at the stated values."
    )
    numbers: NumbersRecord | None = optional(
        None, "Coefficients without a closed form within the budget."
    )
    classification: dict[str, list[str]]
    reading: ReadingReport = required(
        "Rounded numbers taken as exact, and whether they mattered."
    )
    special: SpecialValues | None = optional(
        None, "Present where the stated values change the answer."
    )
    generic: bool = optional(
        False, "Whether the set is for general values of the symbols."
    )
    certificate: CertificateRecord
    model: dict[str, Any] = required("The mechanism as an Echelon description.")


class LinearBaseRecord(Record):
    """A saved set of base parameters of a linear model."""

    schema: Literal["echelon.linear-base/1"]
    echelon: str = required("Version that wrote the file.")
    name: str
    seed: Annotated[int, Within(ge=0)]
    rank: int
    outputs: list[str] = required("The rows of X.")
    order: list[str] = required("Column order for which B is in reduced echelon form.")
    generic: bool = optional(
        False, "Whether the set is for general values of the constants."
    )
    parameters: list[str] = required("The columns of X and B.")
    base: list[BaseParameterRecord]
    numbers: NumbersRecord | None = optional(
        None, "Coefficients without a closed form."
    )
    classification: dict[str, list[str]]
    special: SpecialValues | None = optional(
        None, "Present where the stated values change the answer."
    )
    certificate: CertificateRecord
    model: dict[str, Any] = required("The model as a document.")
