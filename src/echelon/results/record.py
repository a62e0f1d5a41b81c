"""The versioned JSON schema of a saved BaseModel."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Field

SCHEMA_NAME: Literal["echelon.base-model/1"] = "echelon.base-model/1"


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True)


class TermRecord(_Strict):
    """One standard parameter in a base parameter."""

    parameter: str = Field(description="Name of the standard parameter.")
    coefficient: str = Field(description="Exact coefficient: an expression in the geometry symbols, or its numerator.")
    denominator: str = Field("1", description="Exact denominator, where there is one.")
    value: float | None = Field(None, description="Numeric coefficient, if all symbols have values.")


class BaseParameterRecord(_Strict):
    """One base parameter, a row of B."""

    name: str = Field(description="The representative; its coefficient is 1.")
    unit: str = Field(description="SI unit.")
    expression: str = Field(description="Closed form for people.")
    terms: list[TermRecord] = Field(description="All terms, the representative included.")


class SnapRecord(_Strict):
    """A number that was read as a nearby exact one."""

    element: str
    literal: str
    intended: str
    difference: float


class MimicRecord(_Strict):
    """Ranks of a robot whose file couples joints."""

    coupled: int
    independent: int


class MovedRecord(_Strict):
    """How far a coordinate was moved to close the loops."""

    coordinate: str
    distance: float
    unit: str
    relative: float = Field(description="In rad or characteristic lengths.")
    stated: bool = Field(description="Whether the assembly pose says where the coordinate is.")


class AssembledRecord(_Strict):
    """What was moved because the stated assembly pose does not close the loops."""

    moved: list[MovedRecord] = Field(description="The largest move first.")
    closure: str = Field(description="The closure that was open most.")
    opening: float
    unit: str
    pose: dict[str, float] = Field(description="The closed pose that was taken.")


class ReadingRecord(_Strict):
    """How the file was read."""

    snaps: list[SnapRecord] = []
    notes: list[str] = []
    literal_rank: int | None = Field(None, description="Rank without snapping, where something was snapped.")
    decisive: list[SnapRecord] = Field([], description="Snaps that changed the rank.")
    doubt: str = Field("", description="Float ranks of the literal numbers, where none confirms the exact one.")
    mimics: MimicRecord | None = Field(None, description="Ranks with and without the couplings of the file's joints.")
    assembled: AssembledRecord | None = Field(None, description="What was moved to close the loops, beyond rounding.")


class CertificateRecord(_Strict):
    """Evidence; see the documentation of the certificate."""

    rank: int
    seed: int = Field(ge=0)
    minor_prime: int
    minor_states: int
    identity_primes: list[str] = Field(description="81-bit primes as decimal text.")
    degree: int
    log10_error: float
    order: int = 0
    at_values: bool = Field(False, description="Whether the minor was taken at the stated values of the symbols.")
    regions: int = Field(0, description="Regions of signs that were visited; 0 without signs.")
    regions_note: str = ""
    modes: list[int] = Field([], description="With loops, ranks of all assembly modes that were found.")
    numbers: int = Field(0, description="Columns of B that are numbers, checked at the stated values only.")
    log10_residual: float | None = Field(None, description="Bound on what is left there, where they are not exact.")


class SpecialRecord(_Strict):
    """What the stated values change against general symbols."""

    generic_rank: int = Field(description="Rank for general values of the symbols.")
    rank: int = Field(description="Rank at the stated values.")
    relations: list[str] = Field(description="Relations among the values that make the difference.")


class NumbersRecord(_Strict):
    """Columns of B whose coefficients are numbers in place of closed forms."""

    parameters: list[str] = Field(description="Standard parameters whose coefficients are numbers.")
    at: dict[str, str] = Field(description="Values of the symbols that they are true at; radians for angles.")
    radius: float = Field(ge=0, description="Largest error of a coefficient; 0 where they are exact.")


class BaseModelRecord(_Strict):
    """A saved set of base parameters with everything needed to check it again."""

    format: Literal["echelon.base-model/1"] = Field(alias="schema")
    echelon: str = Field(description="Version that wrote the file.")
    name: str
    seed: int = Field(ge=0)
    rank: int
    outputs: list[str] = Field(description="Measured generalised forces, the rows of X.")
    parameters: list[str] = Field(description="Standard parameters, the columns of X and B.")
    order: list[str] = Field(description="Column order for which B is in reduced echelon form.")
    base: list[BaseParameterRecord]
    numbers: NumbersRecord | None = Field(None, description="What has no closed form within the budget.")
    classification: dict[str, list[str]]
    reading: ReadingRecord
    special: SpecialRecord | None = Field(None, description="Present where the stated values change the answer.")
    generic: bool = Field(False, description="Whether the set is for general values of the symbols.")
    certificate: CertificateRecord
    model: dict[str, Any] = Field(description="The mechanism as an Echelon description.")


def json_schema() -> dict[str, Any]:
    """The JSON schema of the file."""
    return BaseModelRecord.model_json_schema(by_alias=True)
