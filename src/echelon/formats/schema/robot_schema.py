"""The description format as data models: the published schema of robots in YAML or JSON.

Every number is an *expression*, kept as the text that stands in the file, so that ``0.0825`` stays 825/10000 and
``pi/2`` stays exact.  These models check the shape of a document; what the expressions, names and references mean is
checked by :mod:`echelon.formats.robot_file`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from echelon.formats.schema.schema_excite import ExcitationEntry
from echelon.formats.schema.schema_experiments import ContactEntry, Experiments
from echelon.formats.schema.schema_log import (
    IdentificationEntry,
    LogEntry,
    PreparationEntry,
)
from echelon.formats.schema.schema_measure import MeasureEntry
from echelon.formats.schema.schema_outputs import OutputEntry
from echelon.formats.schema.schema_setup import (
    EffectEntry,
    LinearTerms,
    RobotFileEntry,
    RotorEntry,
    effect_list,
)
from echelon.formats.schema.schema_types import (
    AS_ROWS,
    CouplingEntry,
    Expression,
    Flag,
    Frame,
    Joint,
    Loop,
    Model,
    Name,
    Number,
    Real,
    Ten,
    Triple,
    Version,
    by_form,
    by_key,
    exactly_one,
)
from echelon.shared import (
    BeforeValidator,
    Tag,
    UnfitError,
    model_check,
    optional,
    published_schema,
    required,
    schema_of,
)

FORMS = ("modified_dh", "standard_dh", "bodies", "robot")
"""The ways to describe the geometry; a document uses exactly one."""

Kind = Literal["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]


class SymbolDetails(Model):
    """A geometry symbol with its value and meaning; ``{}`` only declares the name."""

    value: Expression | None = optional(
        None,
        "Exact value, SI units: a number or an expression of numbers and pi.",
        "0.0825",
    )
    approximate: Expression | None = optional(
        None,
        "Value of a symbol that has no exact one, to all digits of a float.",
        "0.4487989",
    )
    tangent_squared: Expression | None = optional(
        None,
        "Square of the tangent of such an angle, such as 4 in the direction (1, 2, 0).",
        "4",
    )
    meaning: str = optional("", "Meaning of the symbol.", "length of the upper arm")
    fit: tuple[Real, Real] | None = optional(
        None,
        "Range in which identify looks for the value, of a constant that only effects use.",
        [0.01, 0.5],
    )

    @model_check
    def _check_range(self) -> None:
        if self.fit is not None and (self.value or self.approximate):
            raise UnfitError("a symbol has a value or is fitted, not both")
        if self.fit is not None and not self.fit[0] < self.fit[1]:
            raise UnfitError("a range goes from a number to a larger one")


SymbolEntry = Annotated[
    Annotated[None, Tag("null")]
    | Annotated[Expression, Tag("text")]
    | Annotated[SymbolDetails, Tag("mapping")],
    by_form("text", "mapping", "null"),
]


class CentralInertia(Model):
    """Inertia tensor about the centre of mass, along the body's axes, kg·m²."""

    xx: Expression = required("Moment of inertia about x.", "0.02")
    xy: Expression = optional(
        "0", "Entry xy of the tensor, minus the product of inertia.", "0"
    )
    xz: Expression = optional("0", "Entry xz of the tensor.", "0")
    yy: Expression = required("Moment of inertia about y.", "0.02")
    yz: Expression = optional("0", "Entry yz of the tensor.", "0")
    zz: Expression = required("Moment of inertia about z.", "0.01")


class CentralInertial(Model):
    """Inertial values as data sheets give them."""

    mass: Expression = required("kg.", "2.5")
    com: Triple = optional(
        ("0", "0", "0"), "Centre of mass in the body's frame, m.", [0, 0, "0.1"]
    )
    inertia: CentralInertia = required(
        "Tensor about the centre of mass.", {"xx": "0.02", "yy": "0.02", "zz": "0.01"}
    )


class StandardInertial(Model):
    """The ten standard parameters about the origin of the body's frame."""

    standard: Ten = required(
        "XX XY XZ YY YZ ZZ (kg·m²) MX MY MZ (kg·m) M (kg).",
        [0.02, 0, 0, 0.02, 0, 0.01, 0, 0, 0.25, 2.5],
    )


Inertial = Annotated[
    Annotated[StandardInertial, Tag("standard")]
    | Annotated[CentralInertial, Tag("central")],
    by_key("standard", "central"),
]


class _Carrier(Model):
    """Fields that a row of a table and a body share."""

    label: Name | None = optional(
        None,
        "Short label of its parameters: 3 gives XX3 … M3. Default: its number. Bodies with one label share "
        "one set of parameters.",
        "3",
    )
    massless: Flag = optional(False, "Carries no parameters.", True)
    parameters: tuple[Kind, ...] | None = optional(
        None, "Its parameters, if it carries fewer than ten.", ["ZZ"]
    )
    separate: Flag = optional(
        False,
        "Keep a body that is fixed to its parent apart, with parameters of its own.",
        True,
    )
    inertial: Inertial | None = optional(
        None,
        "Inertial values, if known.",
        {"standard": [0.1, 0, 0, 0.1, 0, 0.1, 0, 0, 0, 2.5]},
    )


class _TableRow(_Carrier):
    name: Name | None = optional(
        None,
        "Name of the joint and of the body that it moves; default j1, j2, …",
        "elbow",
    )
    joint: Literal["revolute", "prismatic", "fixed"] = required(
        "Type of the joint.", "revolute"
    )
    alpha: Expression = optional("0", "Angle between the z axes about x, rad.", "-pi/2")
    a: Expression = optional(
        "0", "Distance of the z axes along x, m (called d by Khalil).", "D3"
    )
    theta: Expression = optional(
        "0", "Angle about z, rad; added to the coordinate of a revolute joint.", "pi/2"
    )
    d: Expression = optional(
        "0",
        "Distance along z, m (called r by Khalil); added to the coordinate of a prismatic joint.",
        "0.333",
    )


class ModifiedRow(_TableRow):
    """Rot z(gamma) Trans z(b) Rot x(alpha) Trans x(a) Rot z(theta) Trans z(d), with the motion last."""

    parent: Name | None = optional(
        None,
        "Name or number of the antecedent; 0 or base is the base. Default: the row before.",
        "2",
        "torso",
    )
    gamma: Expression = optional(
        "0", "Angle about z of the antecedent, for trees, rad.", "pi/2"
    )
    b: Expression = optional(
        "0", "Distance along z of the antecedent, for trees, m.", "0.1"
    )


class StandardRow(_TableRow):
    """Rot z(theta) Trans z(d) with the motion, then Trans x(a) Rot x(alpha); the body's frame is at the far end."""


class BodyEntry(_Carrier):
    """A body and the joint that connects it to its parent."""

    name: Name = required("Name of the body, unique.", "forearm")
    parent: Name | None = optional(
        None, "Name of the parent body; default, or base: the base.", "upper_arm"
    )
    joint: Joint | None = optional(
        None,
        "Connects the parent's frame to this body's. Only the first body may go without: it is the base.",
        {"type": "revolute", "axis": "z"},
    )
    frame: Frame = optional(
        Frame.model_construct(),
        "The body's frame in the frame that the joint moves.",
        {"xyz": ["l1", 0, 0]},
    )


class RobotDescription(Model):
    """One robot."""

    title = "Echelon robot description"
    schema_extra = {"oneOf": [{"required": [form]} for form in FORMS]}  # noqa: RUF012

    echelon: Version = required("Version of this format.", 1)
    name: str = optional("robot", "Name of the robot.", "panda")
    symbols: dict[str, SymbolEntry] = optional(
        {},
        "Every symbol that expressions use, with its value or null: an exact number or an expression of "
        "numbers and pi. SI units, radians. pi, sin, cos and sqrt have a fixed meaning.",
        {"D3": "0.45", "RL4": None, "beta": "pi/7"},
    )
    labels: dict[Name, Name] = optional(
        {},
        "With a robot file, labels of bodies by name; bodies with one label share one set of parameters.",
        {"front_wheel": "wheel", "rear_wheel": "wheel"},
    )
    gravity: Annotated[
        Annotated[Literal["generic", "none"], Tag("text")]
        | Annotated[Triple, Tag("list")],
        by_form("text", "list"),
    ] = optional(
        ("0", "0", "-9.81"),
        "Gravity in the base frame, m/s²; generic for an unknown direction.",
        [0, "-g", 0],
        "generic",
        "none",
    )
    floating_base: Flag = optional(False, "The base moves freely.", True)
    couplings: tuple[dict[str, CouplingEntry], ...] = optional(
        (),
        "Coordinates that depend linearly on others, each as an expression in coordinates and symbols.",
        [{"j3": "2*j2 - 0.5*j1"}],
    )
    loops: tuple[Loop, ...] = optional(
        (),
        "Joints that close loops; or pairs of frames that are welded together.",
        [
            {
                "joint": "revolute",
                "connects": ["coupler", "rocker"],
                "at": {"xyz": ["l3", 0, 0]},
            }
        ],
    )
    independent: tuple[Name, ...] | None = optional(
        None,
        "With loops, the coordinates that the others depend on, as many as there are degrees of freedom; "
        "default: a choice, driven coordinates first.",
        ["crank"],
    )
    assembly: dict[str, Expression] = optional(
        {},
        "With loops, positions near which they close, rad or m; zero where not stated.",
        {"coupler": "1.2", "rocker": "2*pi/3"},
    )
    rounding: Number | None = optional(
        None,
        "With loops, the unit of the last decimal of the numbers of the geometry, rad or a share of the size, if "
        "intended relations between them hold only to it; 0 if they are exact. As Echelon writes it.",
        1e-6,
    )
    actuators: dict[str, Expression | LinearTerms] = optional(
        {},
        "Transmission: actuator coordinates as combinations of joint coordinates. A coordinate that none "
        "of them drives has a drive of its own name.",
        {"m5": "45*j5", "m6": "32*j5 + 32*j6"},
    )
    rotors: tuple[RotorEntry, ...] = optional((), "Spinning rotors.")
    locked: dict[Name, Number] = optional(
        {},
        "Coordinates, or joints, that do not move, and where they stand, rad or m.",
        {"finger": 0.02},
    )
    effects: (
        Annotated[
            tuple[EffectEntry, ...],
            BeforeValidator(
                effect_list,
                json_schema_input_type=tuple[EffectEntry | str, ...]
                | dict[str, Any]
                | str,
            ),
        ]
        | None
    ) = optional(
        None,
        "Friction, springs, rotor inertia and other forces: a list, or by joint or type, or none. usual "
        "stands for friction and an offset in every drive, the zeros of force/torque sensors, and rotors and springs where "
        "the robot file shows any; default: usual for logs, else none.",
        [{"type": "viscous", "at": "all"}],
        ["viscous", "coulomb"],
        {"elbow": ["viscous", "offset"]},
    )
    outputs: tuple[OutputEntry, ...] | None = optional(
        None,
        "Measured outputs; default: the forces of all actuators.",
        [{"joint": "all"}, {"wrench": "base"}],
    )
    contacts: tuple[ContactEntry, ...] = optional(
        (),
        "Places where bodies touch something and unknown forces act, such as feet.",
        [{"body": "FL_foot"}, {"body": "FR_foot"}],
    )
    experiments: Experiments = optional(
        (),
        "Set-ups in which the robot is measured, whose base parameters are those of all together.  Names alone are "
        "those of bodies that trees of such experiments hang on, as Echelon writes them.",
        [{"name": "table"}, {"name": "wall", "gravity": [9.81, 0, 0]}],
    )
    measure: tuple[MeasureEntry, ...] = optional(
        (),
        "Measurements for a calibration of the geometry; default: the pose of the last body.",
        [{"pose": "flange"}, {"distance": "flange", "columns": "bar"}],
    )
    log: Annotated[
        Annotated[LogEntry, Tag("mapping")]
        | Annotated[tuple[LogEntry, ...], Tag("list")],
        by_form("mapping", "list"),
    ] = optional(
        (),
        "Meaning of the columns of logs; a list for several kinds of logs. Default: guessed from names.",
        {"time": "t", "position": "q_{n}", "output": "tau_{n}"},
    )
    preparation: PreparationEntry = optional(
        PreparationEntry.model_construct(),
        "Filters, derivatives and decimation of logs.",
    )
    identification: IdentificationEntry = optional(
        IdentificationEntry.model_construct(),
        "Estimator, prior and other settings of the fit.",
    )
    excitation: ExcitationEntry = optional(
        ExcitationEntry.model_construct(),
        "Exciting trajectory that is recorded for the identification.",
    )
    robot: Annotated[
        RobotFileEntry | None,
        BeforeValidator(
            lambda value: {"file": value} if isinstance(value, str) else value,
            json_schema_input_type=str | RobotFileEntry | None,
        ),
    ] = optional(
        None,
        "Instead of a geometry: a robot file that this adds to.",
        "arm.urdf",
        {"file": "arm.urdf"},
    )
    modified_dh: Annotated[tuple[ModifiedRow, ...], AS_ROWS] | None = optional(
        None,
        "Modified Denavit–Hartenberg (Khalil–Kleinfinger, Craig): one row per joint.",
        [{"joint": "revolute", "d": "0.333"}, {"joint": "revolute", "alpha": "-pi/2"}],
    )
    standard_dh: Annotated[tuple[StandardRow, ...], AS_ROWS] | None = optional(
        None,
        "Standard Denavit–Hartenberg: one row per joint.",
        [{"joint": "revolute", "d": "0.1273", "alpha": "pi/2"}],
    )
    bodies: tuple[BodyEntry, ...] | None = optional(
        None,
        "Bodies and joints in general, in any order; none for a robot that is all base.",
        [{"name": "cart", "joint": {"type": "prismatic", "axis": "x"}}],
    )

    _one_form = exactly_one(*FORMS)


def json_schema() -> dict[str, Any]:
    """The JSON schema of descriptions, for editors and other programs."""
    # `schemas/robot.schema.json` of the repository holds it; `echelon schema description` prints it
    return published_schema("robot", schema_of(RobotDescription))
