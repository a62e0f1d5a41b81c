"""Couplings in the description format."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag

from echelon.formats.schema_joints import Model
from echelon.formats.schema_types import AS_LIST, Expression, Name, mapping_or_expression

Pair = Annotated[tuple[Expression, Expression], AS_LIST]


class SplineFunction(Model):
    """A function of one coordinate that is zero at zero: a polynomial, with cubic terms beyond knots."""

    coefficients: Annotated[tuple[Expression, ...], AS_LIST] = Field(
        description="Of the coordinate, its square, its cube and so on.", examples=[["1/2", "0", "0.1"]]
    )
    knots: Annotated[tuple[Pair, ...], AS_LIST] = Field(
        (),
        description="Pairs x, c: c times the cube of the distance from x is added beyond x, seen from zero.",
        examples=[[["0.5", "0.2"]]],
    )


TermEntry = Annotated[
    Annotated[Expression, Tag("text")] | Annotated[SplineFunction, Tag("mapping")],
    Discriminator(mapping_or_expression),
]


class CouplingTerms(Model):
    """A dependent coordinate term by term, for coordinates whose names cannot stand in an expression."""

    terms: dict[str, TermEntry] = Field(
        description="Ratio to each independent coordinate, or another function of it.", examples=[{"left-knee": "1/2"}]
    )
    offset: Expression = Field("0", description="Constant part, rad or m.", examples=["pi/2"])


class SplineThrough(Model):
    """A natural cubic spline of one coordinate, straight beyond its first and last point."""

    of: Name = Field(description="The independent coordinate.", examples=["knee"])
    points: Annotated[tuple[Pair, ...], AS_LIST] = Field(
        description="Pairs: the independent coordinate, and the dependent one there; rad or m.",
        examples=[[["-2", "0.01"], ["-1", "0.004"], ["0", "0"]]],
    )


class CouplingSpline(Model):
    """A dependent coordinate as a spline of another one, as muscle models have it at the knee."""

    spline: SplineThrough


def _kind(value: object) -> str:
    kind = mapping_or_expression(value)
    return "spline" if isinstance(value, dict) and "spline" in value else kind


CouplingEntry = Annotated[
    Annotated[Expression, Tag("text")]
    | Annotated[CouplingTerms, Tag("mapping")]
    | Annotated[CouplingSpline, Tag("spline")],
    Discriminator(_kind),
]
