"""How exciting trajectories are designed, as data models of the description format.

A limit that does not exist is written ``none``, so that it cannot be mistaken for one that was forgotten; it becomes
infinite here.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from echelon.formats.schema.schema_types import (
    SCALAR,
    Flag,
    Model,
    Name,
    Number,
    Whole,
    number,
    of_size,
    sized,
)
from echelon.formats.snapping import NOT_FINITE
from echelon.shared import (
    BeforeValidator,
    Family,
    Optimality,
    PlainValidator,
    UnfitError,
    Unreadable,
    Within,
    WithJsonSchema,
    kind_of,
    model_check,
    optional,
    required,
)

EVERY = "all"  # key of mappings by name that stands for every name that is not listed


NO_LIMIT = "none"  # for a limit that does not exist, since JSON has no infinity
_TEXTS = ("body", "name", "mesh")  # keys of shapes whose values are texts


def _limit(value: object) -> float:
    if value == NO_LIMIT:
        return math.inf
    if NOT_FINITE.fullmatch(str(value).strip()):
        raise UnfitError(f"'{value}' is not a finite number: write none for no limit")
    return number(value)


def _range(value: object) -> tuple[float, float]:
    """Lowest and highest value; none, or none at one end, is unlimited."""
    if value == NO_LIMIT:
        return (-math.inf, math.inf)
    first, last = of_size(value, 2, "a range such as [-1.5, pi/2]")
    low, high = -_limit(first) if first == NO_LIMIT else _limit(first), _limit(last)
    if low > high:
        raise UnfitError(f"the range is empty: {low:g} is larger than {high:g}")
    return (low, high)


def _corner(value: object) -> tuple[float, ...]:
    return tuple(
        number(part) for part in of_size(value, 3, "three numbers such as [0, 0, 0.1]")
    )


def _normal(value: object) -> tuple[float, ...]:
    direction = _corner(value)
    length = math.hypot(*direction)
    if not length:
        raise UnfitError("the normal is zero; it needs a direction such as [0, 0, 1]")
    return tuple(part / length for part in direction)


def _shape(value: object) -> object:
    """A shape whose numbers are numbers; what shapes there are is not known here."""
    if not isinstance(value, dict):
        raise UnfitError(
            f"needs a mapping such as {{body: link3, sphere: 0.06}}, found {kind_of(value)}"
        )
    return {
        key: part if key in _TEXTS else _numbers(part) for key, part in value.items()
    }


def _numbers(value: object) -> object:
    return (
        [number(part) for part in value]
        if isinstance(value, list | tuple)
        else number(value)
    )


def _by_name(value: object) -> object:
    return value if isinstance(value, dict) else {EVERY: value}


_ENDS: dict[str, Any] = {"type": "array", "items": SCALAR, "minItems": 2, "maxItems": 2}
_INTERVAL: dict[str, Any] = {"anyOf": [_ENDS, {"const": NO_LIMIT}]}
_THREE = WithJsonSchema(
    {"type": "array", "items": SCALAR, "minItems": 3, "maxItems": 3}
)
_NAMES = {
    "type": "array",
    "items": {"type": ["string", "integer"]},
    "minItems": 2,
    "maxItems": 2,
}


def _one_or_each(item: dict[str, Any]) -> WithJsonSchema:
    return WithJsonSchema(
        {"anyOf": [item, {"type": "object", "additionalProperties": item}]}
    )


Positive = Annotated[Number, Within(gt=0)]
NotNegative = Annotated[Number, Within(ge=0)]
Count = Annotated[Whole, Within(ge=1)]
Limit = Annotated[float, PlainValidator(_limit), Within(gt=0)]
Range = Annotated[
    tuple[float, float],
    PlainValidator(_range),
    WithJsonSchema(_INTERVAL),
]
Point = Annotated[tuple[float, float, float], PlainValidator(_corner), _THREE]
Unit = Annotated[tuple[float, float, float], PlainValidator(_normal), _THREE]
Shape = Annotated[dict[str, Any], PlainValidator(_shape)]
Pair = Annotated[
    tuple[Name, Name],
    sized(2, "a pair of names such as [link1, link3]"),
    WithJsonSchema(_NAMES),
]
Limits = Annotated[dict[str, Limit], BeforeValidator(_by_name), _one_or_each(SCALAR)]
Ranges = Annotated[dict[str, Range], BeforeValidator(_by_name), _one_or_each(_INTERVAL)]
Deviations = Annotated[
    dict[str, Positive], BeforeValidator(_by_name), _one_or_each(SCALAR)
]

_WHOSE = "one for all, or by name of a coordinate or an actuator, where all is every other; none for no limit."


# -- limits -----------------------------------------------------------------------------------------------------------


class LimitsEntry(Model):
    """Limits of the robot; they come before those of the robot file."""

    position: Ranges = optional(
        {}, f"Lowest and highest position, rad or m: {_WHOSE}", {"j1": ["-pi/2", 1.5]}
    )
    velocity: Limits = optional(
        {}, f"Largest speed, rad/s or m/s: {_WHOSE}", {"all": 2, "j1": 1}
    )
    acceleration: Limits = optional(
        {}, f"Largest acceleration, rad/s² or m/s²: {_WHOSE}", 10, {"j1": "none"}
    )
    jerk: Limits = optional({}, f"Largest jerk, rad/s³ or m/s³: {_WHOSE}", 500)
    beyond_file: Flag = optional(
        False,
        "Allow positions beyond those of the robot file, or beyond two turns.",
        True,
    )
    effort: Limits = optional(
        {}, f"Largest torque or force, N·m or N: {_WHOSE}", {"j1": 87}
    )
    scale: Annotated[Number, Within(gt=0, le=1)] = optional(
        1.0,
        "Share of the robot file's limits that is used; those stated here hold as they are.",
        0.8,
    )


# -- where frames and bodies may go -----------------------------------------------------------------------------------


class BoxEntry(Model):
    """A box along the axes of the base frame; what is absent is unlimited."""

    x: Range | None = optional(
        None, "Lowest and highest x, m; none for no limit.", [-0.5, 0.5]
    )
    y: Range | None = optional(None, "Lowest and highest y, m.", ["-0.5", "none"])
    z: Range | None = optional(None, "Lowest and highest z, m.", [0.05, 1.2])

    @model_check
    def _check_one(self) -> None:
        if self.x is None and self.y is None and self.z is None:
            raise UnfitError("the box limits nothing: give x, y or z")


class HalfSpaceEntry(Model):
    """The points p of the base frame with normal · p ≥ offset."""

    normal: Unit = required(
        "Direction of any length, out of the forbidden side.", [0, 0, 1]
    )
    offset: Number = optional(
        0.0, "Distance of the plane from the base along the normal, m.", 0.1
    )


class FrameEntry(Model):
    """A point of a body, or a ball about it, that stays inside a box or on one side of a plane."""

    body: Name = required("Name of the body.", "hand")
    point: Point = optional(
        (0.0, 0.0, 0.0), "The point in the body's frame, m.", [0, 0, 0.1]
    )
    radius: NotNegative = optional(
        0.0, "Radius of the ball about it that stays inside, m.", 0.05
    )
    box: BoxEntry | None = optional(None, "Box that holds it.", {"z": [0.05, 1.2]})
    above: HalfSpaceEntry | None = optional(
        None, "Plane above which it stays.", {"normal": [0, 0, 1], "offset": 0.05}
    )

    @model_check
    def _check_one(self) -> None:
        if (self.box is None) == (self.above is None):
            both = ", not both" if self.box is not None else ""
            raise UnfitError(f"give box or above{both}")


class CollisionsEntry(Model):
    """Bodies and obstacles that must not touch."""

    self: Flag = optional(True, "Keep the robot's bodies apart.", False)
    clearance: NotNegative = optional(0.02, "Least distance, m.", 0.05)
    shapes: tuple[Shape, ...] = optional(
        (),
        "Shapes of bodies in their frames, beside those of the robot file: sphere, capsule or cylinder "
        "(radius), box (full lengths), ellipsoid (semi-axes), mesh (file).",
        [{"body": "link3", "capsule": 0.06, "from": [0, 0, 0], "to": [0, 0, 0.3]}],
    )
    obstacles: tuple[Shape, ...] = optional(
        (),
        "Shapes that do not move, in the base frame; a plane's normal points to the robot's side.",
        [
            {"name": "table", "box": [2, 2, 0.2], "at": [0, 0, -0.1]},
            {"plane": [0, 0, 1]},
        ],
    )
    exclude: tuple[Pair, ...] = optional(
        (), "Pairs of bodies or obstacles that may touch.", [["link1", "link3"]]
    )
    unreadable: Unreadable = optional(
        "refuse",
        "Shapes of the robot file that cannot be read: refuse them, let boxes of the inertias stand for links "
        "without shapes, or none, which leaves them out.",
        "boxes",
    )
    ignore_touching: Flag = optional(
        False, "Leave out pairs of bodies that touch already where motions start.", True
    )


# -- the section ------------------------------------------------------------------------------------------------------


class ExcitationEntry(Model):
    """The exciting motion: its form, its criterion, and conditions that it keeps."""

    duration: Positive | None = optional(
        None, "Length of the motion, or of its period, s.", 10
    )
    rate: Positive = optional(100.0, "Samples per second for the criterion, Hz.", 200)
    family: Family = optional(
        "fourier",
        "Functions of time: Fourier series, B-splines, or both added.",
        "bspline",
    )
    harmonics: Count | None = optional(
        None,
        "Harmonics of Fourier series; default: 7, fewer where more than 8 coordinates move.",
        5,
    )
    segments: Count = optional(8, "Segments of B-splines.", 12)
    criterion: Optimality = optional(
        "condition",
        "Criterion: the condition number, the volume of the confidence ellipsoid, or the sum of the variances.",
        "d_optimal",
    )
    noise: Deviations = optional(
        {EVERY: 1.0},
        "Standard deviation of the outputs' noise, SI units: one for all, or by output.",
        0.5,
        {"all": 1, "j6": 0.1},
    )
    move: tuple[Name, ...] | None = optional(
        None, "Coordinates that move; default: all that can.", ["j1", "j2"]
    )
    hold: dict[str, Number] = optional(
        {},
        "Positions of the coordinates that do not, rad or m; default: 0.",
        {"j3": "pi/2"},
    )
    centre: dict[str, Number] = optional(
        {}, "Positions about which motions start, rad or m.", {"j4": -1.5}
    )
    limits: LimitsEntry = optional(
        LimitsEntry.model_construct(), "Limits of the robot."
    )
    effort_margin: Annotated[Number, Within(ge=0, lt=1)] = optional(
        0.1, "Share of the effort limits kept free for errors of the prior model.", 0.2
    )
    model: Name | None = optional(
        None,
        "Identified model (model.json) that predicts torques, relative to this file; default: inertial "
        "values of the prior or of the robot file.",
        "result/model.json",
    )
    deviations: NotNegative = optional(
        3.0,
        "Standard deviations of torques predicted by an identified model that are kept free.",
        2,
    )
    frames: tuple[FrameEntry, ...] = optional(
        (),
        "Where points of bodies may go.",
        [{"body": "hand", "radius": 0.1, "above": {"normal": [0, 0, 1]}}],
    )
    collisions: CollisionsEntry = optional(
        CollisionsEntry.model_construct(),
        "Bodies, shapes and obstacles that must not touch.",
    )
    starts: Count = optional(
        4, "Random starts of the optimisation; the best result counts.", 8
    )
    seed: Annotated[Whole, Within(ge=0)] = optional(
        2015, "Seed of the random starts.", 1
    )
    iterations: Count = optional(500, "Steps of the solver in each start, at most.", 50)
    budget: Positive = optional(
        40.0,
        "Budget of the search, in seconds of a typical processor; counted, not timed, so that equal runs give "
        "equal results.",
        120,
    )

    @model_check
    def _check_roles(self) -> None:
        moved = next((name for name in self.move or () if name in self.hold), None)
        if moved is not None:
            raise UnfitError(
                f"'{moved}' moves and is held: name it under move or under hold"
            )
        held = next((name for name in self.centre if name in self.hold), None)
        if held is not None:
            raise UnfitError(f"'{held}' is held, so its motion has no centre")
