"""Columns of logs, their preparation, and the fit, as data models of the description format."""

from __future__ import annotations

from math import inf
from typing import Annotated, Literal

from echelon.formats.schema.schema_types import (
    Expression,
    Flag,
    Model,
    Name,
    Real,
    by_form,
    exactly_one,
)
from echelon.shared import (
    AfterValidator,
    BeforeValidator,
    Criterion,
    Estimator,
    Tag,
    UnfitError,
    ValuesToUse,
    Within,
    WithJsonSchema,
    model_check,
    optional,
    required,
)

_Triples = tuple[tuple[float, float, float], tuple[float, float, float]]


def _range(value: tuple[float, float]) -> tuple[float, float]:
    low, high = value
    if low > high or low == inf or high == -inf:
        raise UnfitError(f"nothing is between {low:g} and {high:g}")
    return value


def _box(value: _Triples) -> _Triples:
    if not all(-inf < low <= high < inf for low, high in zip(*value, strict=True)):
        raise UnfitError("the first corner of the box must not exceed the second")
    return value


def _ellipsoid(value: _Triples) -> _Triples:
    if not all(
        abs(centre) < inf and 0 < axis < inf
        for centre, axis in zip(*value, strict=True)
    ):
        raise UnfitError("the semi-axes of the ellipsoid must be positive")
    return value


def _stages(value: object) -> tuple[object, ...]:
    return tuple(value) if isinstance(value, list | tuple) else (value,)


def _listed(value: object) -> object:
    return None if value is None or value == "auto" else _stages(value)


Positive = Annotated[Real, Within(gt=0)]
Bound = Annotated[tuple[Real, Real], AfterValidator(_range)]
MassBound = Annotated[
    Bound, AfterValidator(lambda value: _range((max(value[0], 0.0), value[1])))
]
Corner = tuple[Real, Real, Real]
Box = Annotated[tuple[Corner, Corner], AfterValidator(_box)]
Ellipsoid = Annotated[tuple[Corner, Corner], AfterValidator(_ellipsoid)]
Automatic = BeforeValidator(lambda value: None if value == "auto" else value)
_DERIVATIVES = WithJsonSchema(
    {"type": ["array", "string", "null"], "items": {"enum": ["qd", "qdd"]}}
)


# -- columns --------------------------------------------------------------------------------------------------------


class ColumnEntry(Model):
    """A column and how its numbers become SI units: scale · (column in SI units) + offset."""

    column: Name = required("Name of the column.", "q_1")
    unit: str = optional(
        "", "Unit of the column; default: the SI unit.", "deg", "N·mm", "ms"
    )
    scale: Expression = optional("1", "Sign, ratio or gain.", "-1", "1/100", "35.15")
    offset: Expression = optional("0", "Added last, SI unit.", "-pi/2")


Column = Annotated[
    Annotated[Name, Tag("text")] | Annotated[ColumnEntry, Tag("mapping")],
    by_form("text", "mapping"),
]
Columns = Annotated[
    Annotated[Name, Tag("text")] | Annotated[dict[str, Column], Tag("mapping")],
    by_form("text", "mapping"),
]


class MotionSensorEntry(Model):
    """A sensor of motion that measures a combination of coordinates, or the angle of a body to the vertical."""

    terms: dict[str, Expression] | None = optional(
        None, "Ratio to each coordinate, by name.", {"left-knee": "1", "hip": "1"}
    )
    body: Name | None = optional(
        None,
        "In place of terms, of an inclinometer: the body that carries it. All joints below that tilt the body turn about "
        "level axes of one direction; those below them may turn about the vertical.",
        "stick",
    )
    axis: Literal["x", "y", "z"] = optional(
        "x",
        "Axis of the body's frame whose angle from the vertical, upwards, an inclinometer measures; it grows as the "
        "coordinate of the last joint does that tilts the body.",
        "z",
    )

    _one_kind = exactly_one("terms", "body")


Combination = Annotated[
    Annotated[Expression, Tag("text")] | Annotated[MotionSensorEntry, Tag("mapping")],
    by_form("text", "mapping"),
]

_BY_NAME = (
    "{n} counts from 1, {i} from 0, {n+12} and {2*n-1} are numbers too, {name} is the name; all for every coordinate, "
    "actuators for every drive, "
    "or one by one, where names of actuators mean the motor's side, and those of sensors what these measure."
)


class LogEntry(Model):
    """Columns of the logs."""

    experiment: Name | None = optional(
        None,
        "Experiment that the logs belong to; default: the one whose name is a word in the log's file name, or what the "
        "columns under contact tell.",
        "wall",
    )
    files: Annotated[tuple[Name, ...], BeforeValidator(_stages)] = optional(
        (),
        "File names of the logs that this is for, with * for any text; default: all that have its columns.",
        ["wall_*.csv"],
    )
    contact: Columns | None = optional(
        None,
        "For each contact by name, or all: a column that is above zero where it touches. Offset -20 means: from 20 N.",
        "contact_{name}",
    )
    twist: Literal["mixed", "body", "world"] = optional(
        "mixed",
        "Axes of the velocities of a floating base: mixed (linear along the world's axes, angular about its own), body "
        "(both its own) or world (both the world's).",
        "body",
    )
    time: Column | None = optional(
        None,
        "Time stamps; default: those that messages of a bag have, or guessed.",
        "t",
    )
    rate: Positive | None = optional(
        None, "Samples per second, without time stamps.", 1000
    )
    sensors: dict[str, Combination] = optional(
        {},
        "Sensors of motion that measure combinations of coordinates, such as inclinometers, by names for position, "
        "velocity, acceleration and reference.",
        {"tilt_stick": "boom + stick"},
        {"tilt_stick": {"body": "stick", "axis": "x"}},
    )
    position: Columns | None = optional(
        None, f"Positions. {_BY_NAME}", "q_{n}", {"actuators": "motor_{n}"}
    )
    velocity: Columns | None = optional(None, "Velocities, if logged.", "qd_{n}")
    acceleration: Columns | None = optional(
        None, "Accelerations, if logged.", "qdd_{n}"
    )
    output: Columns | None = optional(
        None,
        "Measured outputs; of actuators also where joints are the outputs.",
        "tau_{n}",
    )
    reference: Columns | None = optional(
        None, "Commanded positions of the controller.", "q_ref_{n}"
    )
    input: Columns | None = optional(
        None, "Inputs that effects use.", {"j1": "current_1"}
    )

    @model_check
    def _check_clock(self) -> None:
        if self.time is not None and self.rate is not None:
            raise UnfitError("give time or rate, not both")


# -- preparation ----------------------------------------------------------------------------------------------------


class PreparationEntry(Model):
    """Preparation of logs; Echelon chooses missing settings, and those with the value auto, from the data."""

    band: Annotated[Positive | None, Automatic] = optional(
        None,
        "Pass band of both sides of the equation: 0 Hz up to this; inf for all.",
        5,
    )
    lowpass: dict[str, Positive] | None = optional(
        None,
        "Low-pass over single positions, Hz, where a coarse encoder would spoil the others.",
        {"j1": 3},
    )
    measured: Annotated[
        tuple[Literal["qd", "qdd"], ...] | None, BeforeValidator(_listed), _DERIVATIVES
    ] = optional(None, "Derivatives to take from the log; [] for none.", ["qd"])
    still: (
        Annotated[
            Annotated[Real, Tag("number")] | Annotated[dict[str, Real], Tag("mapping")],
            by_form("number", "mapping"),
        ]
        | None
    ) = optional(
        None, "Speed below which rows are left out, for all outputs or by output.", 0.01
    )
    rest: Annotated[tuple[str, ...] | None, BeforeValidator(_listed)] = optional(
        None,
        "Outputs whose joints count as at rest below 'still', where their dry friction is unknown.",
        ["j1"],
    )
    delays: dict[str, Real] | None = optional(
        None, "Lag of outputs behind positions, s.", {"j1": 0.002}
    )
    trim: Annotated[Real, Within(ge=0)] = optional(
        0.0, "Left out at both ends, s.", 0.5
    )
    rate: Positive | None = optional(None, "Resample to this rate, Hz.", 500)


# -- identification -------------------------------------------------------------------------------------------------


class BodyBoundsEntry(Model):
    """Knowledge about a body before any measurement, about and along its own frame."""

    mass: MassBound | None = optional(None, "Least and largest mass, kg.", [1, 5])
    box: Box | None = optional(
        None,
        "Box that holds the centre of mass: two opposite corners, m.",
        [[-0.1, -0.1, 0], [0.1, 0.1, 0.3]],
    )
    ellipsoid: Ellipsoid | None = optional(
        None,
        "Ellipsoid that holds it: centre and semi-axes, m.",
        [[0, 0, 0.1], [0.1, 0.1, 0.2]],
    )
    extent: Ellipsoid | None = optional(
        None,
        "Ellipsoid that holds all of the mass: centre and semi-axes, m.",
        [[0, 0, 0.05], [0.08, 0.08, 0.08]],
    )
    symmetry: Annotated[
        tuple[Literal["xy", "xz", "yz", "x", "y", "z"], ...], BeforeValidator(_stages)
    ] = optional(
        (), "Planes to which, and axes about which, the mass is symmetric.", ["xz"]
    )


class PriorEntry(Model):
    """Prior values of the parameters, and their weight."""

    file: Name | None = optional(
        None,
        "Another description of the robot with inertial values, relative to this one; default: the values of this one.",
        "arm.urdf",
    )
    weight: Annotated[Positive | None, Automatic] = optional(
        None,
        "Weight of the prior relative to the data; chosen from the data if absent.",
        1.0,
    )


class IdentificationEntry(Model):
    """Identification: estimator, known values, validation and bounds."""

    estimator: Estimator = optional("irls", "Estimator of the base parameters.", "irls")
    known: dict[str, Real] = optional(
        {}, "Base parameters with known values.", {"Ia1": 0.1}
    )
    holdout: Annotated[Real, Within(ge=0, lt=1)] = optional(
        0.3, "Share of each log kept for validation if no other log is given.", 0.3
    )
    physical: Flag = optional(True, "Fit a physically consistent robot as well.", False)
    predict: ValuesToUse = optional(
        "auto",
        "Values for predictions; auto: the estimate, or physical values where the data hardly excite combinations "
        "that unseen motions need.",
        "physical",
    )
    essential: Literal[Criterion, "none"] = optional(
        "bic", "Criterion that eliminates parameters.", "bic"
    )
    prior: PriorEntry = optional(PriorEntry.model_construct(), "Prior values.")
    bodies: dict[str, BodyBoundsEntry] = optional(
        {}, "Bounds on bodies.", {"link1": {"mass": [1, 5]}}
    )
    parameters: dict[str, Bound] = optional(
        {}, "Bounds on parameters.", {"Fv1": [0, 10]}
    )
    total_mass: MassBound | None = optional(
        None,
        "Range of the mass of all bodies without loads of experiments, kg.",
        [12, 14],
    )
    intervals: Literal["clustered", "classical"] = optional(
        "clustered",
        "Covariance from batches of time, which holds where residuals are not white, or the classical one.",
        "classical",
    )
    level: Annotated[Real, Within(gt=0, lt=1)] = optional(
        0.95, "Probability of confidence intervals.", 0.95
    )

    @model_check
    def _check_prediction(self) -> None:
        if self.predict == "physical" and not self.physical:
            raise UnfitError(
                "predictions cannot use a physical fit that is switched off"
            )
