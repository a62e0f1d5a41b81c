"""Frames, joints, couplings and loops in the description format.

A loop may be as short as the names of two frames that are held together, as other programs list them.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from echelon.formats.schema.schema_types import (
    AS_LIST,
    Expression,
    Matrix,
    Name,
    PairOfParts,
    Triple,
    check_keys,
    list_or_mapping,
    list_or_text,
    mapping_or_expression,
    motion_or_frame,
    refusal,
)

Direction = Literal["x", "y", "z", "-x", "-y", "-z"]
Axis = Annotated[Annotated[Direction, Tag("text")] | Annotated[Triple, Tag("list")], Discriminator(list_or_text)]


class Model(BaseModel):
    """Common behaviour: nothing is converted silently, unknown keys are refused, results are frozen."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, data: Any) -> Any:
        check_keys(data, list(cls.model_fields))
        return data


class Frame(Model):
    """Where a frame sits in another."""

    xyz: Triple = Field(("0", "0", "0"), description="Translation, m.", examples=[[0, 0, "l1"]])
    rpy: Triple | None = Field(
        None,
        description="Rotations about the fixed x, y, z axes, in this order, rad: Rz(yaw) Ry(pitch) Rx(roll).",
        examples=[["pi/2", 0, 0]],
    )
    rotation: Matrix | None = Field(
        None,
        description="Instead of rpy: the exact rotation matrix by rows; its columns are the axes of the placed frame.",
        examples=[[[1, 0, 0], [0, 0, -1], [0, 1, 0]]],
    )

    @model_validator(mode="after")
    def _check_rotation(self) -> Self:
        if self.rpy is not None and self.rotation is not None:
            raise refusal("give rpy or rotation, not both")
        return self


class MotionStep(Model):
    """One elementary motion of a custom joint."""

    motion: Literal["rotation", "translation", "screw", "ball"] = Field(
        description="Kind of the motion.", examples=["rotation"]
    )
    name: Name = Field(description="Name of the coordinate.", examples=["wrist.1"])
    axis: Direction = Field("z", description="Coordinate axis of the frame that it moves.", examples=["x"])
    pitch: Expression = Field("0", description="Travel of a screw, m/rad.", examples=["0.002"])


Step = Annotated[Annotated[MotionStep, Tag("motion")] | Annotated[Frame, Tag("frame")], Discriminator(motion_or_frame)]


class _Joint(Model):
    name: str | None = Field(
        None, description="Name of the joint and of its coordinate; default: the body's name.", examples=["elbow"]
    )
    origin: Frame = Field(
        Frame.model_construct(),
        description="Frame of the joint in the frame of the parent body.",
        examples=[{"xyz": [0, 0, "l1"]}],
    )


class AxisJoint(_Joint):
    """One axis: the body turns about it, slides along it, or both; the axis of a planar joint is the plane's normal."""

    type: Literal["revolute", "continuous", "prismatic", "cylindrical", "planar"] = Field(
        description="Type of the joint.", examples=["revolute"]
    )
    axis: Axis = Field(description="Axis in the joint's frame.", examples=["z", [0, "0.6", "0.8"]])


class HelicalJoint(_Joint):
    """A screw."""

    type: Literal["helical"] = Field(description="Type of the joint.", examples=["helical"])
    axis: Axis = Field(description="Axis in the joint's frame.", examples=["z"])
    pitch: Expression = Field(description="Travel along the axis, m/rad.", examples=["0.002", "h"])


class UniversalJoint(_Joint):
    """Two rotations about perpendicular axes that intersect; the first is fixed in the parent."""

    type: Literal["universal"] = Field(description="Type of the joint.", examples=["universal"])
    axis: Direction = Field(description="First axis.", examples=["x"])
    axis2: Direction = Field(description="Second axis, perpendicular to the first.", examples=["y"])

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        if self.axis[-1] == self.axis2[-1]:
            raise refusal(f"axis2 must be perpendicular to axis, so not along {self.axis[-1]}")
        return self


class PlainJoint(_Joint):
    """A joint without an axis."""

    type: Literal["spherical", "floating", "fixed"] = Field(description="Type of the joint.", examples=["spherical"])


class CustomJoint(Model):
    """Any sequence of frames and elementary motions."""

    type: Literal["custom"] = Field(description="Type of the joint.", examples=["custom"])
    kind: str = Field("custom", description="What the joint is called in results.", examples=["offset hinge"])
    name: str | None = Field(
        None, description="Name of the joint; default: the body's name. Motions have their own.", examples=["wrist"]
    )
    steps: Annotated[tuple[Step, ...], AS_LIST] = Field(
        description="From the parent's frame to the body's.",
        examples=[[{"motion": "rotation", "name": "wrist.1", "axis": "x"}, {"xyz": ["e", 0, 0]}]],
    )


Joint = Annotated[AxisJoint | HelicalJoint | UniversalJoint | PlainJoint | CustomJoint, Field(discriminator="type")]


_WITHOUT_AXIS = ("weld", "spherical", "points")


class LoopEntry(Model):
    """A joint that closes a loop: it holds a frame of one body against a frame of another."""

    name: Name | None = Field(None, description="Name of the loop; default loop1, loop2, …", examples=["rocker"])
    joint: Literal[
        "weld",
        "revolute",
        "prismatic",
        "cylindrical",
        "planar",
        "universal",
        "spherical",
        "point_on_axis",
        "point_on_plane",
        "points",
        "axes",
    ] = Field(
        description="Kind of the joint; points is another word for spherical, axes for cylindrical.",
        examples=["revolute"],
    )
    connects: PairOfParts = Field(
        description="Names of the first and the second body, or of frames on them; base for the base, null for the "
        "fixed world.",
        examples=[["coupler", "rocker"]],
    )
    at: Frame = Field(
        Frame.model_construct(),
        description="Frame on the first body; its z axis is that of the joint, its x axis the first of a universal.",
        examples=[{"xyz": ["l3", 0, 0]}],
    )
    on_second: Frame | None = Field(
        None,
        description="Frame on the second body; its y axis is the second of a universal. Default: its own, where two "
        "fixed frames are connected and at is left out; otherwise where the first frame is while all coordinates are "
        "zero.",
        examples=[{"xyz": ["l4", 0, 0]}],
    )
    axis: Axis | None = Field(
        None,
        description="Direction of the joint's axis, or of the normal of its plane, in at and on_second, if not z.",
        examples=["y"],
    )

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if self.axis is not None and self.joint in _WITHOUT_AXIS:
            raise refusal(f"a {self.joint} joint has no axis")
        if self.axis is not None and self.joint == "universal":
            raise refusal("a universal joint has two axes, x of at and y of on_second: turn these frames by rpy")
        return self


Loop = Annotated[
    Annotated[LoopEntry, Tag("mapping")] | Annotated[PairOfParts, Tag("list")], Discriminator(list_or_mapping)
]
"""A joint, or the names of two frames that are held together in all six directions."""


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
