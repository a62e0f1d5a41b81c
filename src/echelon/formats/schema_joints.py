"""Frames and joints of the description format."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from echelon.formats.schema_types import (
    AS_LIST,
    Expression,
    Matrix,
    Name,
    Triple,
    check_keys,
    list_or_text,
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
