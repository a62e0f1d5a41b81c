"""Contacts and experiments, as data models of the description format."""

from __future__ import annotations

from typing import Annotated, Literal

from echelon.formats.schema.schema_types import (
    Expression,
    Flag,
    Frame,
    Model,
    Name,
    Number,
    by_form,
)
from echelon.shared import Tag, optional, required

Component = Literal["fx", "fy", "fz", "tx", "ty", "tz"]


class ContactEntry(Model):
    """A place where a body touches the ground or an object, by forces that nobody measures."""

    body: Name = required("Body or frame that touches.", "FL_foot")
    type: Literal["point", "line", "surface", "rolling"] = optional(
        "point",
        "Kind of contact: a point that cannot move; a line along x or a surface that cannot turn either; a wheel "
        "or ball that rolls.",
        "point",
    )
    name: Name | None = optional(
        None, "Name of the contact; default: the body.", "heel"
    )
    at: Frame = optional(
        Frame.model_construct(),
        "The contact in the body's frame; of what rolls its centre.",
        {"xyz": [0, 0, "-0.2"]},
    )
    radius: Expression = optional(
        "0", "Distance of the centre of a rolling body from the ground, m.", "0.05"
    )
    measured: tuple[Component, ...] = optional(
        (), "Components of the force that a plate measures.", ["fz"]
    )


class ExperimentEntry(Model):
    """One set-up in which the robot is measured."""

    name: Name = required("Name of the experiment.", "wall")
    gravity: tuple[Number, Number, Number] | None = optional(
        None,
        "Gravity in the base frame, which tells how the base is mounted; only its direction counts.",
        [9.81, 0, 0],
    )
    locked: dict[Name, Number] = optional(
        {},
        "Coordinates, or joints, that do not move, and where they stand, rad or m.",
        {"j4": 0.5},
    )
    sensors: tuple[Name, ...] | None = optional(
        None,
        "Outputs and sensors that are measured, base for the wrench under the robot; default: all outputs.",
        ["base"],
    )
    payloads: dict[Name, Name] = optional(
        {},
        "Loads with unknown inertias, by name: the body that carries each.",
        {"tool": "link7"},
    )
    contacts: tuple[Name, ...] | None = optional(
        None, "Contacts that touch; default: all.", ["FL_foot", "RR_foot"]
    )
    open_loops: Flag = optional(False, "The loops are open.", True)
    motion: str | None = optional(
        None,
        "Table of the motion that was driven, with columns t, q_<name> and perhaps qd_<name>, qdd_<name>.",
        "wall.csv",
    )


Experiments = tuple[
    Annotated[
        Annotated[Name, Tag("text")] | Annotated[ExperimentEntry, Tag("mapping")],
        by_form("text", "mapping"),
    ],
    ...,
]
