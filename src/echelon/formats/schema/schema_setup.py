"""Drives and effects of a machine, as data models of the description format."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING, Annotated, Literal

from echelon.algebra import parse
from echelon.formats.schema.schema_types import (
    Direction,
    Expression,
    Flag,
    Frame,
    Model,
    Name,
)
from echelon.robot import CONSTANTS, KINDS, POSITIVE_CONSTANTS
from echelon.shared import (
    Discriminator,
    Tag,
    UnfitError,
    model_check,
    optional,
    required,
)

Side = Literal["joint", "actuator", "output"]


class FileJoint(Model):
    """Actual type of a joint whose robot file cannot state it."""

    type: Literal["spherical", "universal", "fixed"] = required(
        "Type of the joint.", "spherical"
    )
    axis: Direction | None = optional(
        None,
        "First axis of a universal joint, in the frame of the joint's origin.",
        "x",
    )
    axis2: Direction | None = optional(
        None, "Its second axis, perpendicular to the first.", "y"
    )

    @model_check
    def _check_axes(self) -> None:
        axes = [axis for axis in (self.axis, self.axis2) if axis is not None]
        if self.type != "universal" and axes:
            raise UnfitError(f"a {self.type} joint has no axis")
        if self.type == "universal" and len({axis[-1] for axis in axes}) != len(
            ("axis", "axis2")
        ):
            raise UnfitError(
                "a universal joint has an axis and an axis2, perpendicular to each other"
            )


class RobotFileEntry(Model):
    """A robot file of another format that this description adds to."""

    file: Name = required("URDF, SDF or MJCF file, relative to this one.", "arm.urdf")
    joints: dict[str, FileJoint] = optional(
        {},
        "Joints whose type is not the one that the file states: URDF has no spherical joints.",
        {"ankle_rod": {"type": "spherical"}},
    )
    driven: tuple[Name, ...] = optional(
        (),
        "With loops, coordinates or joints that motors move: where the choice is free, they are independent.",
        ["hip", "knee"],
    )
    ignore: tuple[str, ...] = optional(
        (),
        "Elements and attributes of the file, such as gazebo/joint or origin@quat, to ignore, although they may "
        "change how the robot moves.",
        ["gazebo/joint"],
    )


class LinearTerms(Model):
    """A combination of joint coordinates term by term, for names that cannot stand in an expression."""

    terms: dict[str, Expression] = required(
        "Ratio to each coordinate.", {"left-knee": "50"}
    )


# -- effects --------------------------------------------------------------------------------------------------------


if TYPE_CHECKING:
    Ready = str
else:
    Ready = Literal[*KINDS]


class ReadyEffect(Model):
    """A ready-made effect at one or several coordinates, each with parameters of its own."""

    type: Ready = required("Type of the effect.", "viscous")
    at: tuple[Name, ...] | Name = required(
        "Coordinates or actuators, or all; of an offset also sensors and their outputs, or outputs for all of them.",
        "all",
        ["j1", "j2"],
        "ft",
        "ft.fx",
    )
    side: Side | None = optional(
        None,
        "In the drive, where only the actuator's torque sees it (default), at the joint itself, or in the output of a "
        "sensor.",
        "joint",
    )
    label: Name | None = optional(
        None, "Ends the names of its parameters, which all places share.", "5"
    )
    width: Expression | None = optional(
        None,
        "Width of smooth Coulomb friction, rad/s or m/s: its force is proportional to tanh(qd/width).",
        "0.01",
    )
    velocity: Expression | None = optional(
        None, "Stribeck velocity, rad/s or m/s.", "0.05"
    )
    stiffness: Expression | None = optional(
        None,
        "Stiffness of LuGre bristles by the force of Coulomb friction, 1/rad or 1/m.",
        "2000",
    )
    ratio: Expression | None = optional(
        None, "Ratio of static to Coulomb friction in LuGre's law; default: 1.", "1.4"
    )
    exponent: Expression | None = optional(
        None, "Exponent of a Stribeck term; default: 2.", "2"
    )
    phase: Expression | None = optional(
        None,
        "Phase of a counterbalance: its force is proportional to sin(q + phase).",
        "0.0872665",
    )
    lower: Expression | None = optional(
        None, "Position below which a stop is touched.", "-2.9"
    )
    upper: Expression | None = optional(
        None, "Position beyond which a stop is touched.", "2.9"
    )
    harmonic: Expression | None = optional(
        None, "Number of repetitions of a ripple in a turn.", "6", "101"
    )

    @property
    def constants(self) -> dict[str, str]:
        """Constants of the effect, defaults included."""
        needed = CONSTANTS.get(self.type, {})
        return {
            name: str(getattr(self, name) or default)
            for name, default in needed.items()
        }

    @model_check
    def _check_constants(self) -> None:
        needed = CONSTANTS.get(self.type, {})
        for name in dict.fromkeys(chain.from_iterable(CONSTANTS.values())):
            if getattr(self, name) is not None and name not in needed:
                raise UnfitError(f"a {self.type} effect has no '{name}'")
        for name, default in needed.items():
            if getattr(self, name) is None and default is None:
                example = (type(self).model_fields[name].examples or [""])[0]
                raise UnfitError(
                    f"a {self.type} effect needs '{name}', such as {name}: {example}"
                )
        for name, text in self.constants.items():
            number = parse(text).number if name in POSITIVE_CONSTANTS else None
            if number is not None and float(number) <= 0:
                problem = (
                    f"'{name}' of a {self.type} effect is more than 0, found {text}"
                )
                raise UnfitError(problem)


class ActionEntry(Model):
    """Where a parameter acts, and the function that multiplies it."""

    at: Name = required("Coordinate, actuator or output of a sensor.", "m5")
    side: Side | None = optional(
        None,
        "Side of the drive or output of a sensor; default: actuator, then joint.",
        "joint",
    )
    term: Expression = required(
        "q, qd, qdd of the place itself, qd[j5] of another one, i for its measured input; sin cos tan exp "
        "log sinh cosh tanh asin acos atan atan2 sqrt abs sign max min.",
        "sign(qd[m5] + qd[m6])",
    )


class BristlesEntry(Model):
    """Constants of the state of LuGre friction, which is the input of its terms."""

    stiffness: Expression = required("By the force of Coulomb friction, 1/rad.", "2000")
    velocity: Expression = required("Stribeck velocity, rad/s.", "0.05")
    ratio: Expression = optional("1", "Ratio of static to Coulomb friction.", "1.4")


class OwnEffect(Model):
    """A parameter with terms of the user's own."""

    parameter: Name = required("Name of the parameter.", "Fvm6")
    unit: str = optional("", "Its SI unit.", "N·m·s/rad")
    value: Expression | None = optional(None, "Its value, if known.", "0.2")
    acts: tuple[ActionEntry, ...] = required(
        "Where it acts.", [{"at": "m5", "term": "qd[m6]"}]
    )
    bristles: BristlesEntry | None = optional(
        None,
        "Makes the input i the state of LuGre friction.",
        {"stiffness": "2000", "velocity": "0.05"},
    )


def usual_ready_or_own(value: object) -> str:
    """Tag of an effect."""
    if value == "usual":
        return "usual"
    return (
        "own"
        if isinstance(value, dict) and value.keys() & {"parameter", "acts", "term"}
        else "ready"
    )


EffectEntry = Annotated[
    Annotated[OwnEffect, Tag("own")]
    | Annotated[ReadyEffect, Tag("ready")]
    | Annotated[Literal["usual"], Tag("usual")],
    Discriminator(usual_ready_or_own),
]


def effect_list(value: object) -> object:
    """The list of effects that a shorter way of writing stands for.

    ``[viscous, coulomb]`` is at all places; ``{elbow: [viscous, {type: stribeck, velocity: 0.1}]}`` and
    ``{elbow: {viscous: null, stribeck: {velocity: 0.1}}}`` go by place, ``{viscous: all}`` by type; ``none`` is none.
    """
    if isinstance(value, str):
        value = [] if value == "none" else [value]
    if isinstance(value, dict):
        return [
            entry for key, some in value.items() for entry in _of_one(str(key), some)
        ]
    if isinstance(value, list | tuple):
        return [
            {"type": entry, "at": "all"}
            if isinstance(entry, str) and entry != "usual"
            else entry
            for entry in value
        ]
    return value


def _of_one(key: str, value: object) -> list[object]:
    """Effects of one type, or at one place."""
    if key in KINDS:
        return [
            {"type": key, **value}
            if isinstance(value, dict)
            else {"type": key, "at": value}
        ]
    if isinstance(value, dict) and not {"type", "parameter"} & value.keys():
        value = [
            {"type": kind, **(options if isinstance(options, dict) else {})}
            for kind, options in value.items()
        ]
    return [
        _placed(key, entry)
        for entry in (value if isinstance(value, list | tuple) else [value])
    ]


def _placed(place: str, entry: object) -> object:
    if isinstance(entry, str):
        return {"type": entry, "at": place}
    if isinstance(entry, dict) and isinstance(entry.get("acts"), list):
        return {
            **entry,
            "acts": [
                {"at": place, **act} if isinstance(act, dict) else act
                for act in entry["acts"]
            ],
        }
    return (
        {"at": place, **entry}
        if isinstance(entry, dict) and "parameter" not in entry
        else entry
    )


class RotorEntry(Model):
    """A rotor that spins on a body, geared to the joints: its spin inertia and gyroscopic torque."""

    name: Name = required("Name of the rotor.", "rotor3")
    on: Name = required("Body that carries it, or base.", "link2")
    drives: Expression | LinearTerms = required(
        "Angle of the rotor against its carrier as a combination of joint coordinates.",
        "100*j3",
        "m5",
    )
    axis: Direction = optional("z", "Axis in the rotor's frame.", "z")
    frame: Frame = optional(
        Frame.model_construct(),
        "The rotor's frame on its carrier.",
        {"rpy": ["pi/2", 0, 0]},
    )
    label: Name | None = optional(None, "Ends the names of its parameters.", "m3")
    elastic: Flag = optional(
        False,
        "Turns by itself: a spring with damping is between it and the one joint that it drives.",
        True,
    )
