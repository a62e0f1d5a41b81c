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
    by_form,
    by_key,
    check_keys,
    optional,
    refusal,
    required,
)

Direction = Literal["x", "y", "z", "-x", "-y", "-z"]
Axis = Annotated[Annotated[Direction, Tag("text")] | Annotated[Triple, Tag("list")], by_form("text", "list")]


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

    xyz: Triple = optional(("0", "0", "0"), "Translation, m.", [0, 0, "l1"])
    rpy: Triple | None = optional(
        None, "Rotations about the fixed x, y, z axes, in this order, rad: Rz(yaw) Ry(pitch) Rx(roll).", ["pi/2", 0, 0]
    )
    rotation: Matrix | None = optional(
        None,
        "Instead of rpy: the exact rotation matrix by rows; its columns are the axes of the placed frame.",
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    )

    @model_validator(mode="after")
    def _check_rotation(self) -> Self:
        if self.rpy is not None and self.rotation is not None:
            raise refusal("give rpy or rotation, not both")
        return self


class MotionStep(Model):
    """One elementary motion of a custom joint."""

    motion: Literal["rotation", "translation", "screw", "ball"] = required("Kind of the motion.", "rotation")
    name: Name = required("Name of the coordinate.", "wrist.1")
    axis: Direction = optional("z", "Coordinate axis of the frame that it moves.", "x")
    pitch: Expression = optional("0", "Travel of a screw, m/rad.", "0.002")


Step = Annotated[Annotated[MotionStep, Tag("motion")] | Annotated[Frame, Tag("frame")], by_key("motion", "frame")]


class _Joint(Model):
    name: str | None = optional(None, "Name of the joint and of its coordinate; default: the body's name.", "elbow")
    origin: Frame = optional(
        Frame.model_construct(), "Frame of the joint in the frame of the parent body.", {"xyz": [0, 0, "l1"]}
    )


class AxisJoint(_Joint):
    """One axis: the body turns about it, slides along it, or both; the axis of a planar joint is the plane's normal."""

    type: Literal["revolute", "continuous", "prismatic", "cylindrical", "planar"] = required(
        "Type of the joint.", "revolute"
    )
    axis: Axis = required("Axis in the joint's frame.", "z", [0, "0.6", "0.8"])


class HelicalJoint(_Joint):
    """A screw."""

    type: Literal["helical"] = required("Type of the joint.", "helical")
    axis: Axis = required("Axis in the joint's frame.", "z")
    pitch: Expression = required("Travel along the axis, m/rad.", "0.002", "h")


class UniversalJoint(_Joint):
    """Two rotations about perpendicular axes that intersect; the first is fixed in the parent."""

    type: Literal["universal"] = required("Type of the joint.", "universal")
    axis: Direction = required("First axis.", "x")
    axis2: Direction = required("Second axis, perpendicular to the first.", "y")

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        if self.axis[-1] == self.axis2[-1]:
            raise refusal(f"axis2 must be perpendicular to axis, so not along {self.axis[-1]}")
        return self


class PlainJoint(_Joint):
    """A joint without an axis."""

    type: Literal["spherical", "floating", "fixed"] = required("Type of the joint.", "spherical")


class CustomJoint(Model):
    """Any sequence of frames and elementary motions."""

    type: Literal["custom"] = required("Type of the joint.", "custom")
    kind: str = optional("custom", "What the joint is called in results.", "offset hinge")
    name: str | None = optional(None, "Name of the joint; default: the body's name. Motions have their own.", "wrist")
    steps: Annotated[tuple[Step, ...], AS_LIST] = required(
        "From the parent's frame to the body's.",
        [{"motion": "rotation", "name": "wrist.1", "axis": "x"}, {"xyz": ["e", 0, 0]}],
    )


Joint = Annotated[AxisJoint | HelicalJoint | UniversalJoint | PlainJoint | CustomJoint, Field(discriminator="type")]


_WITHOUT_AXIS = ("weld", "spherical", "points")


class LoopEntry(Model):
    """A joint that closes a loop: it holds a frame of one body against a frame of another."""

    name: Name | None = optional(None, "Name of the loop; default loop1, loop2, …", "rocker")
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
    ] = required("Kind of the joint; points is another word for spherical, axes for cylindrical.", "revolute")
    connects: PairOfParts = required(
        "Names of the first and the second body, or of frames on them; base for the base, null for the fixed world.",
        ["coupler", "rocker"],
    )
    at: Frame = optional(
        Frame.model_construct(),
        "Frame on the first body; its z axis is that of the joint, its x axis the first of a universal.",
        {"xyz": ["l3", 0, 0]},
    )
    on_second: Frame | None = optional(
        None,
        "Frame on the second body; its y axis is the second of a universal. Default: its own, where two "
        "fixed frames are connected and at is left out; otherwise where the first frame is while all coordinates are "
        "zero.",
        {"xyz": ["l4", 0, 0]},
    )
    axis: Axis | None = optional(
        None, "Direction of the joint's axis, or of the normal of its plane, in at and on_second, if not z.", "y"
    )

    @model_validator(mode="after")
    def _check_axis(self) -> Self:
        if self.axis is not None and self.joint in _WITHOUT_AXIS:
            raise refusal(f"a {self.joint} joint has no axis")
        if self.axis is not None and self.joint == "universal":
            raise refusal("a universal joint has two axes, x of at and y of on_second: turn these frames by rpy")
        return self


Loop = Annotated[Annotated[LoopEntry, Tag("mapping")] | Annotated[PairOfParts, Tag("list")], by_form("mapping", "list")]
"""A joint, or the names of two frames that are held together in all six directions."""


Pair = Annotated[tuple[Expression, Expression], AS_LIST]


class SplineFunction(Model):
    """A function of one coordinate that is zero at zero: a polynomial, with cubic terms beyond knots."""

    coefficients: Annotated[tuple[Expression, ...], AS_LIST] = required(
        "Of the coordinate, its square, its cube and so on.", ["1/2", "0", "0.1"]
    )
    knots: Annotated[tuple[Pair, ...], AS_LIST] = optional(
        (), "Pairs x, c: c times the cube of the distance from x is added beyond x, seen from zero.", [["0.5", "0.2"]]
    )


TermEntry = Annotated[
    Annotated[Expression, Tag("text")] | Annotated[SplineFunction, Tag("mapping")], by_form("text", "mapping")
]


class CouplingTerms(Model):
    """A dependent coordinate term by term, for coordinates whose names cannot stand in an expression."""

    terms: dict[str, TermEntry] = required(
        "Ratio to each independent coordinate, or another function of it.", {"left-knee": "1/2"}
    )
    offset: Expression = optional("0", "Constant part, rad or m.", "pi/2")


class SplineThrough(Model):
    """A natural cubic spline of one coordinate, straight beyond its first and last point."""

    of: Name = required("The independent coordinate.", "knee")
    points: Annotated[tuple[Pair, ...], AS_LIST] = required(
        "Pairs: the independent coordinate, and the dependent one there; rad or m.",
        [["-2", "0.01"], ["-1", "0.004"], ["0", "0"]],
    )


class CouplingSpline(Model):
    """A dependent coordinate as a spline of another one, as muscle models have it at the knee."""

    spline: SplineThrough


CouplingEntry = Annotated[
    Annotated[Expression, Tag("text")]
    | Annotated[CouplingTerms, Tag("mapping")]
    | Annotated[CouplingSpline, Tag("spline")],
    Discriminator(
        lambda value: "text" if not isinstance(value, dict) else "spline" if "spline" in value else "mapping"
    ),
]
