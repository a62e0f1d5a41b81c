"""What is measured on a machine, and its drives and effects, as data models of the description format."""

from __future__ import annotations

from typing import Annotated, Literal, Self, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from echelon.formats.schema.schema_geometry import Direction, Frame, Model
from echelon.formats.schema.schema_types import AS_LIST, Expression, Name, refusal
from echelon.mechanism.effect import CONSTANTS

Side = Literal["joint", "actuator"]
Component = Literal["fx", "fy", "fz", "tx", "ty", "tz"]
COMPONENTS: tuple[Component, ...] = ("fx", "fy", "fz", "tx", "ty", "tz")


class FileJoint(Model):
    """What a joint of a robot file really is, where its format cannot say so."""

    type: Literal["spherical", "universal", "fixed"] = Field(description="Type of the joint.", examples=["spherical"])
    axis: Direction | None = Field(
        None, description="First axis of a universal joint, in the frame of the joint's origin.", examples=["x"]
    )
    axis2: Direction | None = Field(None, description="Its second axis, perpendicular to the first.", examples=["y"])

    @model_validator(mode="after")
    def _check_axes(self) -> Self:
        axes = [axis for axis in (self.axis, self.axis2) if axis is not None]
        if self.type != "universal" and axes:
            raise refusal(f"a {self.type} joint has no axis")
        if self.type == "universal" and len({axis[-1] for axis in axes}) != len(("axis", "axis2")):
            raise refusal("a universal joint has an axis and an axis2, perpendicular to each other")
        return self


class RobotFile(Model):
    """A robot file of another format that this description adds to."""

    file: Name = Field(description="URDF, SDF or MJCF file, relative to this one.", examples=["arm.urdf"])
    joints: dict[str, FileJoint] = Field(
        {},
        description="Joints whose type is not the one that the file states: URDF has no spherical joints.",
        examples=[{"ankle_rod": {"type": "spherical"}}],
    )
    driven: Annotated[tuple[Name, ...], AS_LIST] = Field(
        (),
        description="With loops, coordinates or joints that motors move: where the choice is free, they are "
        "independent.",
        examples=[["hip", "knee"]],
    )


def file_or_mapping(value: object) -> object:
    """A robot file that is given by its name alone."""
    return {"file": value} if isinstance(value, str) else value


class LinearTerms(Model):
    """A combination of joint coordinates term by term, for names that cannot stand in an expression."""

    terms: dict[str, Expression] = Field(description="Ratio to each coordinate.", examples=[{"left-knee": "50"}])


# -- effects --------------------------------------------------------------------------------------------------------


Ready = Literal[
    "viscous",
    "coulomb",
    "asymmetric_viscous",
    "asymmetric_coulomb",
    "offset",
    "stribeck",
    "load_friction",
    "temperature_friction",
    "rotor_inertia",
    "spring",
    "counterbalance",
    "cable",
    "stop",
    "ripple",
    "drive_gain",
    "servo",
]


class ReadyEffect(Model):
    """A ready-made effect at one or several coordinates, each with parameters of its own."""

    type: Ready = Field(description="Which effect.", examples=["viscous"])
    at: Annotated[tuple[Name, ...], AS_LIST] | Name = Field(
        description="Coordinates or actuators, or all.", examples=["all", ["j1", "j2"]]
    )
    side: Side | None = Field(
        None,
        description="In the drive, where only the actuator's torque sees it (default), or at the joint itself.",
        examples=["joint"],
    )
    label: Name | None = Field(
        None, description="Ends the names of its parameters, which all places share.", examples=["5"]
    )
    velocity: Expression | None = Field(None, description="Stribeck velocity, rad/s or m/s.", examples=["0.05"])
    exponent: Expression | None = Field(None, description="Exponent of a Stribeck term; default: 2.", examples=["2"])
    phase: Expression | None = Field(
        None, description="Of a counterbalance: its force is proportional to sin(q + phase).", examples=["0.0872665"]
    )
    lower: Expression | None = Field(None, description="Position below which a stop is touched.", examples=["-2.9"])
    upper: Expression | None = Field(None, description="Position beyond which a stop is touched.", examples=["2.9"])
    harmonic: Expression | None = Field(
        None, description="Of a ripple: how often it repeats in a turn.", examples=["6", "101"]
    )

    @property
    def constants(self) -> dict[str, str]:
        """Constants of the effect, defaults included."""
        needed = CONSTANTS.get(self.type, {})
        return {name: str(getattr(self, name) or default) for name, default in needed.items()}

    @model_validator(mode="after")
    def _check_constants(self) -> Self:
        needed = CONSTANTS.get(self.type, {})
        for name in {name for some in CONSTANTS.values() for name in some}:
            if getattr(self, name) is not None and name not in needed:
                raise refusal(f"a {self.type} effect has no '{name}'")
        for name, default in needed.items():
            if getattr(self, name) is None and default is None:
                raise refusal(f"a {self.type} effect needs '{name}'")
        return self


class ActionEntry(Model):
    """Where a parameter acts, and the function that multiplies it."""

    at: Name = Field(description="Coordinate or actuator.", examples=["m5"])
    side: Side | None = Field(None, description="Which of the two; by default the actuator.", examples=["joint"])
    term: Expression = Field(
        description="q, qd, qdd of the place itself, qd[j5] of another one, i for its measured input; sin cos tan exp "
        "log sinh cosh tanh asin acos atan atan2 sqrt abs sign max min.",
        examples=["sign(qd[m5] + qd[m6])"],
    )


class OwnEffect(Model):
    """A parameter with terms of the user's own."""

    parameter: Name = Field(description="Name of the parameter.", examples=["Fvm6"])
    unit: str = Field("", description="Its SI unit.", examples=["N·m·s/rad"])
    value: Expression | None = Field(None, description="Its value, if known.", examples=["0.2"])
    acts: Annotated[tuple[ActionEntry, ...], AS_LIST] = Field(
        description="Where it acts.", examples=[[{"at": "m5", "term": "qd[m6]"}]]
    )


def usual_ready_or_own(value: object) -> str:
    """Tag of an effect."""
    if value == "usual":
        return "usual"
    return "own" if isinstance(value, dict) and "parameter" in value else "ready"


EffectEntry = Annotated[
    Annotated[OwnEffect, Tag("own")] | Annotated[ReadyEffect, Tag("ready")] | Annotated[Literal["usual"], Tag("usual")],
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
        return [entry for key, some in value.items() for entry in _of_one(str(key), some)]
    if isinstance(value, list | tuple):
        return [
            {"type": entry, "at": "all"} if isinstance(entry, str) and entry != "usual" else entry for entry in value
        ]
    return value


def _of_one(key: str, value: object) -> list[object]:
    """Effects of one type, or at one place."""
    if key in get_args(Ready):
        return [{"type": key, **value} if isinstance(value, dict) else {"type": key, "at": value}]
    if isinstance(value, dict) and not {"type", "parameter"} & value.keys():
        value = [{"type": kind, **(options if isinstance(options, dict) else {})} for kind, options in value.items()]
    return [_placed(key, entry) for entry in (value if isinstance(value, list | tuple) else [value])]


def _placed(place: str, entry: object) -> object:
    if isinstance(entry, str):
        return {"type": entry, "at": place}
    if isinstance(entry, dict) and isinstance(entry.get("acts"), list):
        return {**entry, "acts": [{"at": place, **act} if isinstance(act, dict) else act for act in entry["acts"]]}
    return {"at": place, **entry} if isinstance(entry, dict) and "parameter" not in entry else entry


class RotorEntry(Model):
    """A rotor that spins on a body, geared to the joints: its spin inertia and gyroscopic torque."""

    name: Name = Field(description="Name of the rotor.", examples=["rotor3"])
    on: Name = Field(description="Body that carries it, or base.", examples=["link2"])
    drives: Expression | LinearTerms = Field(
        description="Angle of the rotor against its carrier as a combination of joint coordinates.",
        examples=["100*j3", "m5"],
    )
    axis: Direction = Field("z", description="Axis in the rotor's frame.", examples=["z"])
    frame: Frame = Field(
        Frame.model_construct(), description="The rotor's frame on its carrier.", examples=[{"rpy": ["pi/2", 0, 0]}]
    )
    label: Name | None = Field(None, description="Ends the names of its parameters.", examples=["m3"])


# -- outputs --------------------------------------------------------------------------------------------------------


class WeightedForce(Model):
    """A joint's or an actuator's force with a weight."""

    joint: Name | None = Field(None, description="Joint coordinate.", examples=["j1"])
    actuator: Name | None = Field(None, description="Actuator.", examples=["m5"])
    weight: Expression = Field("1", description="Its weight.", examples=["1/2"])

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        if (self.joint is None) == (self.actuator is None):
            raise refusal("give joint or actuator")
        return self


class JointOutput(Model):
    """A torque or force sensor in a joint, on the joint's side of the drive."""

    joint: Name = Field(description="Joint coordinate, or all.", examples=["j1", "all"])
    name: Name | None = Field(None, description="Name of the output; default: the coordinate.", examples=["tau1"])


class ActuatorOutput(Model):
    """Torque, force or current of an actuator."""

    actuator: Name = Field(description="Actuator, or all.", examples=["m5", "all"])
    name: Name | None = Field(None, description="Name of the output; default: the actuator.", examples=["i5"])


class WrenchOutput(Model):
    """A force/torque sensor between a body and its parent, or under the base."""

    wrench: Name = Field(description="Body that is carried by the sensor; base for all of them.", examples=["hand"])
    name: Name | None = Field(None, description="Name of the sensor; default: the body.", examples=["ft"])
    frame: Frame = Field(Frame.model_construct(), description="The sensor's frame.", examples=[{"xyz": [0, 0, "0.05"]}])
    fixed_to: Literal["body", "parent"] = Field(
        "body", description="What the sensor's frame is fixed to.", examples=["parent"]
    )
    components: Annotated[tuple[Component, ...], AS_LIST] = Field(
        COMPONENTS, description="Forces and torques along the axes of the frame.", examples=[["tz"]]
    )


class SumOutput(Model):
    """A weighted sum of forces."""

    name: Name = Field(description="Name of the output.", examples=["differential"])
    unit: str = Field("N·m", description="Its SI unit.", examples=["N·m"])
    sum: Annotated[tuple[WeightedForce, ...], AS_LIST] = Field(
        description="What is added up.", examples=[[{"joint": "j5"}, {"joint": "j6", "weight": "-1"}]]
    )


def output_kind(value: object) -> str | None:
    """Tag of an output: the key that says what it measures."""
    kinds = [kind for kind in ("joint", "actuator", "wrench", "sum") if isinstance(value, dict) and kind in value]
    return kinds[0] if kinds else None


OutputEntry = Annotated[
    Annotated[JointOutput, Tag("joint")]
    | Annotated[ActuatorOutput, Tag("actuator")]
    | Annotated[WrenchOutput, Tag("wrench")]
    | Annotated[SumOutput, Tag("sum")],
    Discriminator(output_kind),
]
