"""The description format as data models: the published schema of robots in YAML or JSON.

Every number is an *expression*, kept as the text that stands in the file, so that ``0.0825`` stays 825/10000 and
``pi/2`` stays exact.  These models check the shape of a document; what the expressions, names and references mean is
checked by :mod:`echelon.formats.robot_file`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator

from echelon.formats.schema.schema_excite import ExcitationEntry
from echelon.formats.schema.schema_geometry import CouplingEntry, Frame, Joint, Loop, Model
from echelon.formats.schema.schema_log import IdentificationEntry, LogEntry, PreparationEntry
from echelon.formats.schema.schema_setup import (
    EffectEntry,
    LinearTerms,
    OutputEntry,
    RobotFile,
    RotorEntry,
    effect_list,
    file_or_mapping,
)
from echelon.formats.schema.schema_types import (
    AS_LIST,
    AS_ROWS,
    Expression,
    Flag,
    Name,
    Ten,
    Triple,
    Version,
    list_or_mapping,
    list_or_text,
    mapping_or_text,
    refusal,
    standard_or_central,
)

FORMS = ("modified_dh", "standard_dh", "bodies", "robot")
"""The ways to describe the geometry; a document uses exactly one."""

Kind = Literal["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


class SymbolDetails(Model):
    """A geometry symbol with its value and meaning; ``{}`` only declares the name."""

    value: Expression | None = Field(
        None, description="Exact value, SI units: a number or an expression of numbers and pi.", examples=["0.0825"]
    )
    approximate: Expression | None = Field(
        None, description="Value of a symbol that has no exact one, to all digits of a float.", examples=["0.4487989"]
    )
    meaning: str = Field("", description="What the symbol stands for.", examples=["length of the upper arm"])


SymbolEntry = Annotated[
    Annotated[None, Tag("null")] | Annotated[Expression, Tag("text")] | Annotated[SymbolDetails, Tag("mapping")],
    Discriminator(mapping_or_text),
]


class CentralInertia(Model):
    """Inertia tensor about the centre of mass, along the body's axes, kg·m²."""

    xx: Expression = Field(description="Moment of inertia about x.", examples=["0.02"])
    xy: Expression = Field("0", description="Entry xy of the tensor, minus the product of inertia.", examples=["0"])
    xz: Expression = Field("0", description="Entry xz of the tensor.", examples=["0"])
    yy: Expression = Field(description="Moment of inertia about y.", examples=["0.02"])
    yz: Expression = Field("0", description="Entry yz of the tensor.", examples=["0"])
    zz: Expression = Field(description="Moment of inertia about z.", examples=["0.01"])


class CentralInertial(Model):
    """Inertial values as data sheets give them."""

    mass: Expression = Field(description="kg.", examples=["2.5"])
    com: Triple = Field(("0", "0", "0"), description="Centre of mass in the body's frame, m.", examples=[[0, 0, "0.1"]])
    inertia: CentralInertia = Field(
        description="Tensor about the centre of mass.", examples=[{"xx": "0.02", "yy": "0.02", "zz": "0.01"}]
    )


class StandardInertial(Model):
    """The ten standard parameters about the origin of the body's frame."""

    standard: Ten = Field(
        min_length=10,
        max_length=10,
        description="XX XY XZ YY YZ ZZ (kg·m²) MX MY MZ (kg·m) M (kg).",
        examples=[[0.02, 0, 0, 0.02, 0, 0.01, 0, 0, 0.25, 2.5]],
    )


Inertial = Annotated[
    Annotated[StandardInertial, Tag("standard")] | Annotated[CentralInertial, Tag("central")],
    Discriminator(standard_or_central),
]


class _Carrier(Model):
    """What a row of a table and a body have in common."""

    label: Name | None = Field(
        None,
        description="Short label of its parameters: 3 gives XX3 … M3. Default: its number. Bodies with one label share "
        "one set of parameters.",
        examples=["3"],
    )
    massless: Flag = Field(False, description="Carries no parameters.", examples=[True])
    parameters: Annotated[tuple[Kind, ...], AS_LIST] | None = Field(
        None, description="Which of the ten it carries, if not all.", examples=[["ZZ"]]
    )
    separate: Flag = Field(
        False,
        description="Keep a body that is fixed to its parent apart, with parameters of its own.",
        examples=[True],
    )
    inertial: Inertial | None = Field(
        None, description="Inertial values, if known.", examples=[{"standard": [0.1, 0, 0, 0.1, 0, 0.1, 0, 0, 0, 2.5]}]
    )


class _Row(_Carrier):
    name: Name | None = Field(
        None, description="Name of the joint and of the body that it moves; default j1, j2, …", examples=["elbow"]
    )
    joint: Literal["revolute", "prismatic", "fixed"] = Field(description="Type of the joint.", examples=["revolute"])
    alpha: Expression = Field("0", description="Angle between the z axes about x, rad.", examples=["-pi/2"])
    a: Expression = Field("0", description="Distance of the z axes along x, m (called d by Khalil).", examples=["D3"])
    theta: Expression = Field(
        "0", description="Angle about z, rad; added to the coordinate of a revolute joint.", examples=["pi/2"]
    )
    d: Expression = Field(
        "0",
        description="Distance along z, m (called r by Khalil); added to the coordinate of a prismatic joint.",
        examples=["0.333"],
    )


class ModifiedRow(_Row):
    """Rot z(gamma) Trans z(b) Rot x(alpha) Trans x(a) Rot z(theta) Trans z(d), with the motion last."""

    parent: Name | None = Field(
        None,
        description="Name or number of the antecedent; 0 or base is the base. Default: the row before.",
        examples=["2", "torso"],
    )
    gamma: Expression = Field("0", description="Angle about z of the antecedent, for trees, rad.", examples=["pi/2"])
    b: Expression = Field("0", description="Distance along z of the antecedent, for trees, m.", examples=["0.1"])


class StandardRow(_Row):
    """Rot z(theta) Trans z(d) with the motion, then Trans x(a) Rot x(alpha); the body's frame is at the far end."""


class BodyEntry(_Carrier):
    """A body and the joint that connects it to its parent."""

    name: Name = Field(description="Name of the body, unique.", examples=["forearm"])
    parent: Name | None = Field(
        None, description="Name of the parent body; default, or base: the base.", examples=["upper_arm"]
    )
    joint: Joint | None = Field(
        None,
        description="Connects the parent's frame to this body's. Only the first body may go without: it is the base.",
        examples=[{"type": "revolute", "axis": "z"}],
    )
    frame: Frame = Field(
        Frame.model_construct(),
        description="The body's frame in the frame that the joint moves.",
        examples=[{"xyz": ["l1", 0, 0]}],
    )


class RobotDescription(Model):
    """One robot."""

    model_config = ConfigDict(
        title="Echelon robot description",
        json_schema_extra={"$schema": _DIALECT, "oneOf": [{"required": [form]} for form in FORMS]},
    )

    echelon: Version = Field(description="Version of this format.", examples=[1])
    name: str = Field("robot", description="Name of the robot.", examples=["panda"])
    symbols: dict[str, SymbolEntry] = Field(
        {},
        description="Every symbol that expressions use, with its value or null: an exact number or an expression of "
        "numbers and pi. SI units, radians. pi, sin, cos and sqrt have a fixed meaning.",
        examples=[{"D3": "0.45", "RL4": None, "beta": "pi/7"}],
    )
    labels: dict[Name, Name] = Field(
        {},
        description="With a robot file, labels of bodies by name; bodies with one label share one set of parameters.",
        examples=[{"front_wheel": "wheel", "rear_wheel": "wheel"}],
    )
    gravity: Annotated[
        Annotated[Literal["generic", "none"], Tag("text")] | Annotated[Triple, Tag("list")],
        Discriminator(list_or_text),
    ] = Field(
        ("0", "0", "-9.81"),
        description="Gravity in the base frame, m/s²; generic for an unknown direction.",
        examples=[[0, "-g", 0], "generic", "none"],
    )
    floating_base: Flag = Field(False, description="The base moves freely.", examples=[True])
    couplings: Annotated[tuple[dict[str, CouplingEntry], ...], AS_LIST] = Field(
        (),
        description="Coordinates that depend linearly on others, each as an expression in coordinates and symbols.",
        examples=[[{"j3": "2*j2 - 0.5*j1"}]],
    )
    loops: Annotated[tuple[Loop, ...], AS_LIST] = Field(
        (),
        description="Joints that close loops; or pairs of frames that are welded together.",
        examples=[[{"joint": "revolute", "connects": ["coupler", "rocker"], "at": {"xyz": ["l3", 0, 0]}}]],
    )
    independent: Annotated[tuple[Name, ...], AS_LIST] | None = Field(
        None,
        description="With loops, the coordinates that the others depend on, as many as there are degrees of freedom; "
        "default: a choice, driven coordinates first.",
        examples=[["crank"]],
    )
    assembly: dict[str, Expression] = Field(
        {},
        description="With loops, positions near which they close, rad or m; zero where not stated.",
        examples=[{"coupler": "1.2", "rocker": "2*pi/3"}],
    )
    closed_at: dict[str, list[Expression]] = Field(
        {},
        description="With loops, exact positions at which the second frames are where the first ones are, whatever is "
        "stated of them: cosine and sine, a displacement, or a quaternion, by joint coordinate; as Echelon writes it.",
        examples=[{"crank": ["cos(crank_closed)", "sin(crank_closed)"]}],
    )
    actuators: dict[str, Expression | LinearTerms] = Field(
        {},
        description="Transmission: actuator coordinates as combinations of joint coordinates. A coordinate that none "
        "of them drives has a drive of its own name.",
        examples=[{"m5": "45*j5", "m6": "32*j5 + 32*j6"}],
    )
    rotors: Annotated[tuple[RotorEntry, ...], AS_LIST] = Field((), description="Spinning rotors.")
    effects: (
        Annotated[
            tuple[EffectEntry, ...],
            AS_LIST,
            BeforeValidator(effect_list, json_schema_input_type=tuple[EffectEntry | str, ...] | dict[str, Any] | str),
        ]
        | None
    ) = Field(
        None,
        description="Friction, springs, rotor inertia and other forces: a list, or by joint or type, or none. usual "
        "stands for friction and an offset in every drive, and rotors and springs where the robot file shows any; "
        "default: usual for logs, else none.",
        examples=[[{"type": "viscous", "at": "all"}], ["viscous", "coulomb"], {"elbow": ["viscous", "offset"]}],
    )
    outputs: Annotated[tuple[OutputEntry, ...], AS_LIST] | None = Field(
        None,
        description="What is measured; default: the forces of all actuators.",
        examples=[[{"joint": "all"}, {"wrench": "base"}]],
    )
    log: Annotated[
        Annotated[LogEntry, Tag("mapping")] | Annotated[tuple[LogEntry, ...], AS_LIST, Tag("list")],
        Discriminator(list_or_mapping),
    ] = Field(
        (),
        description="What the columns of logs mean; of several kinds of logs, a list. Default: guessed from names.",
        examples=[{"time": "t", "position": "q_{n}", "output": "tau_{n}"}],
    )
    preparation: PreparationEntry = Field(
        PreparationEntry.model_construct(), description="How logs are filtered, differentiated and decimated."
    )
    identification: IdentificationEntry = Field(
        IdentificationEntry.model_construct(), description="What is fitted to logs, and how."
    )
    excitation: ExcitationEntry = Field(
        ExcitationEntry.model_construct(), description="Exciting trajectory that is recorded for the identification."
    )
    robot: Annotated[
        RobotFile | None, BeforeValidator(file_or_mapping, json_schema_input_type=str | RobotFile | None)
    ] = Field(
        None,
        description="Instead of a geometry: a robot file that this adds to.",
        examples=["arm.urdf", {"file": "arm.urdf"}],
    )
    modified_dh: Annotated[tuple[ModifiedRow, ...], AS_ROWS] | None = Field(
        None,
        description="Modified Denavit–Hartenberg (Khalil–Kleinfinger, Craig): one row per joint.",
        examples=[[{"joint": "revolute", "d": "0.333"}, {"joint": "revolute", "alpha": "-pi/2"}]],
    )
    standard_dh: Annotated[tuple[StandardRow, ...], AS_ROWS] | None = Field(
        None,
        description="Standard Denavit–Hartenberg: one row per joint.",
        examples=[[{"joint": "revolute", "d": "0.1273", "alpha": "pi/2"}]],
    )
    bodies: Annotated[tuple[BodyEntry, ...], AS_LIST] | None = Field(
        None,
        description="Bodies and joints in general, in any order; none for a robot that is all base.",
        examples=[[{"name": "cart", "joint": {"type": "prismatic", "axis": "x"}}]],
    )

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        stated = [form for form in FORMS if getattr(self, form) is not None]
        if len(stated) != 1:
            raise refusal(f"give exactly one of {', '.join(FORMS)}; found {' and '.join(stated) or 'none of them'}")
        return self


def json_schema() -> dict[str, Any]:
    """The JSON schema of descriptions, for editors and other programs.

    ``schemas/robot.schema.json`` of the repository holds it; ``echelon schema description`` prints it.
    """
    return RobotDescription.model_json_schema()
