"""Joints that close loops, as data models of the description format.

A loop may be as short as the names of two frames that are held together, as other programs list them.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from echelon.formats.schema_joints import Axis, Frame, Model
from echelon.formats.schema_types import Name, PairOfParts, list_or_mapping, refusal

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
