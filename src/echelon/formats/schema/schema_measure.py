"""Measurements of a robot's geometry, as data models of the description format.

Each entry measures the place of a tool against an outer frame: of a tracker or a board, a point, or a plane.  The tool
is fixed to a body and the outer frame to another one, usually the base; where exactly, nobody needs to know.
"""

from __future__ import annotations

from typing import Annotated, Literal

from echelon.formats.schema.schema_log import Corner, Positive
from echelon.formats.schema.schema_types import (
    Flag,
    Model,
    Name,
    Real,
    by_form,
    exactly_one,
)
from echelon.shared import Tag, optional

MeasureKind = Literal["pose", "position", "distance", "plane", "sphere", "contact"]
KINDS: tuple[MeasureKind, ...] = (
    "pose",
    "position",
    "distance",
    "plane",
    "sphere",
    "contact",
)


class MeasureEntry(Model):
    """One measurement of the geometry."""

    pose: Name | None = optional(
        None, "Body or link whose tool's pose is measured.", "flange"
    )
    position: Name | None = optional(
        None, "Body or link whose tool's position is measured.", "flange"
    )
    distance: Name | None = optional(
        None,
        "Body or link whose distance from a fixed point is measured, by a ball bar or a draw-wire.",
        "flange",
    )
    plane: Name | None = optional(
        None, "Body or link whose tool touches a plane.", "flange"
    )
    sphere: Name | None = optional(
        None, "Body or link whose tool touches a sphere.", "flange"
    )
    contact: Name | None = optional(
        None, "Body or link whose tool stays at a fixed point.", "flange"
    )
    name: Name | None = optional(
        None, "Name of the measurement; default: its kind and number.", "tracker"
    )
    tool: Name | None = optional(
        None,
        "Name of the tool's frame; measurements with one name share it. Default: one for each body.",
        "gripper",
    )
    frame: Name | None = optional(
        None,
        "Name of the outer frame; measurements with one name share it. Default: one for all poses and positions, "
        "and one for each other measurement.",
        "board",
    )
    on: Name | None = optional(
        None, "Body that carries the outer frame; default: the base.", "left_hand"
    )
    inverse: Flag = optional(
        False,
        "Whether the pose is that of the outer frame seen from the tool, as of a camera in the hand that sees a board.",
        True,
    )
    point: Corner = optional(
        (0.0, 0.0, 0.0), "Point of the tool, in the tool's frame, m.", [0, 0, 0.1]
    )
    points: dict[str, Corner | None] = optional(
        {},
        "Several markers of a position, each with its place in the tool's frame, m, or null if it is unknown.",
        {"m1": [0.1, 0, 0], "m2": None},
    )
    length: Positive | None = optional(
        None,
        "Known length of a distance or radius of a sphere, m, the same for all rows.",
        0.5,
    )
    columns: (
        Annotated[
            Annotated[Name, Tag("text")] | Annotated[tuple[Name, ...], Tag("list")],
            by_form("text", "list"),
        ]
        | None
    ) = optional(
        None,
        "Columns of the log, or what their names begin with: x y z, then qw qx qy qz, r11 … r33 or rx ry rz (a rotation "
        "vector); of a distance one column. Several markers: what each one's begin with. A unit stands in brackets.",
        "tcp_",
        ["x [mm]", "y [mm]", "z [mm]"],
    )
    where: dict[Name, Real] = optional(
        {},
        "Values that columns have in the rows that measure this; default: all rows.",
        {"plane": 2},
    )
    deviation: (
        Annotated[
            Annotated[Positive, Tag("number")]
            | Annotated[tuple[Positive, Positive], Tag("list")],
            by_form("number", "list"),
        ]
        | None
    ) = optional(
        None,
        "Standard deviation of the noise, m; of a pose also rad. Default: found from the data.",
        0.0001,
        [0.0001, 0.001],
    )

    _one_kind = exactly_one(*KINDS)

    @property
    def kind(self) -> MeasureKind:
        """Kind of the measurement."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def body(self) -> str:
        """Body or link that carries the tool."""
        return str(getattr(self, self.kind))
