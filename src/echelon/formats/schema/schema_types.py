"""Types of the description format, from scalars to joints and loops, and what is said about unsuitable ones.

YAML would turn ``0.0825`` into a float, ``1e-3`` into a string, ``010`` into eight and ``y`` into a truth value.  So
scalars are read as text, and the types here say what each text may be; numbers and booleans are accepted as well, for
documents that come from JSON or from Python.

Of these are made frames, joints, couplings and loops.  A loop may be as short as the names of two frames that are held
together, as other programs list them.
"""

from __future__ import annotations

import math
import re
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, Literal

from echelon.algebra import PER_PI, PI, is_whole, parse, pi_generators
from echelon.formats.snapping import NOT_FINITE
from echelon.robot import ClosureKind
from echelon.shared import (
    BeforeValidator,
    ByValue,
    Discriminator,
    PlainValidator,
    Record,
    Tag,
    UnfitError,
    Within,
    WithJsonSchema,
    kind_of,
    model_check,
    optional,
    required,
)

_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
_FLAGS = {"true": True, "false": False}
_SHARED = ("label", "massless", "parameters", "separate", "inertial")
_RENAMED = {
    "r": ("alpha", "Khalil's r is d here, and Khalil's d is a"),
    "sigma": ("alpha", "write joint: revolute, prismatic or fixed"),
    "type": ("alpha", "write joint: revolute, prismatic or fixed"),
    "rpy": ("origin", "it belongs into origin: {rpy: …}"),
    "xyz": ("origin", "it belongs into origin: {xyz: …}"),
}
"""Keys of other conventions: a key of the mapping where they are found, and what to write instead."""


def _scalar(what: str, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        found = str(value).lower() if isinstance(value, bool) else kind_of(value)
        if isinstance(value, dict) and "fit" in value:
            found += "; a range to fit belongs to a symbol: symbols: {w: {fit: [0.01, 1]}}, then write w here"
        raise UnfitError(f"needs {what}, found {found}")
    text = value.strip() if isinstance(value, str) else repr(value)
    if not text:
        raise UnfitError(f"needs {what}, found an empty text")
    return text


_name = partial(_scalar, "a name")


def _flag(value: object) -> object:
    found = _FLAGS.get(value.lower()) if isinstance(value, str) else value
    if not isinstance(found, bool):
        raise UnfitError(f"needs true or false, found {kind_of(value)}")
    return found


def _version(value: object) -> object:
    if isinstance(value, bool) or str(value) != "1":
        raise UnfitError(
            f"this is version {kind_of(value)} of the format; this program reads version 1: 'echelon: 1'"
        )
    return 1


def _rows(value: object) -> object:
    if value == [] or value == ():
        raise UnfitError("the table is empty; it needs at least one row")
    return value


def of_size(value: object, size: int, what: str) -> tuple[object, ...]:
    """The entries of a list of known size; refuses everything else as not being what it needs."""
    if not isinstance(value, list | tuple):
        raise UnfitError(f"needs {what}, found {kind_of(value)}")
    if len(value) != size:
        raise UnfitError(f"needs {what}, found {len(value)} entries")
    return tuple(value)


def sized(size: int, what: str) -> BeforeValidator:
    """A check of a list of known size."""
    return BeforeValidator(partial(of_size, size=size, what=what))


Expression = Annotated[
    str,
    PlainValidator(partial(_scalar, "an expression such as 0.333, pi/2 or -l1/2")),
    WithJsonSchema({"type": ["number", "string"]}),
]
"""The text of an exact expression."""

Name = Annotated[
    str, PlainValidator(_name), WithJsonSchema({"type": ["string", "integer"]})
]
Flag = Annotated[bool, PlainValidator(_flag)]
Version = Annotated[Literal[1], PlainValidator(_version)]
Triple = Annotated[
    tuple[Expression, Expression, Expression],
    sized(3, "a list of three expressions such as [0, 0, 0.333]"),
]
Matrix = Annotated[
    tuple[Triple, Triple, Triple],
    sized(3, "a list of three rows such as [[1, 0, 0], [0, 0, -1], [0, 1, 0]]"),
]
Ten = Annotated[
    tuple[Expression, ...],
    Within(min_length=10, max_length=10),
    sized(10, "a list of ten numbers: XX XY XZ YY YZ ZZ MX MY MZ M"),
]
Part = Annotated[
    str | None,
    PlainValidator(lambda value: None if value is None else _name(value)),
    WithJsonSchema({"type": ["string", "integer", "null"]}),
]
PairOfParts = Annotated[
    tuple[Part, Part],
    sized(2, "a list of two names of bodies such as [coupler, rocker]"),
]

AS_ROWS = BeforeValidator(_rows)


# -- numbers of set-ups, which no symbol of the geometry belongs into --------------------------------------------------


def number(value: object) -> float:
    """A finite number: an expression of numbers and pi, since data sheets state ``2*pi`` as often as ``6.28``."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise UnfitError(f"needs a number such as 0.5 or 2*pi, found {kind_of(value)}")
    text = str(value).strip()
    if NOT_FINITE.fullmatch(text):
        raise UnfitError(f"'{text}' is not a finite number")
    try:
        expression = parse(text)
        if not set(expression.symbols()) <= {PI, PER_PI}:
            raise UnfitError(
                f"needs a number or an expression of numbers and pi, found '{text}'"
            )
        return expression.at(pi_generators(math.pi))
    except ValueError as error:
        raise UnfitError(str(error)) from None


def _real(value: object) -> float:
    return (
        float(str(value)) if _INFINITE.fullmatch(str(value).strip()) else number(value)
    )


def _whole(value: object) -> int:
    text = str(value)
    if not is_whole(text.removeprefix("-")):
        raise UnfitError(f"needs a whole number, found {kind_of(value)}")
    return int(text)


SCALAR: dict[str, Any] = {"type": ["number", "string"]}
Number = Annotated[float, PlainValidator(number), WithJsonSchema(SCALAR)]
Real = Annotated[
    float, PlainValidator(_real), WithJsonSchema(SCALAR)
]  # a number or ``inf``
Whole = Annotated[
    int, PlainValidator(_whole), WithJsonSchema({"type": ["integer", "string"]})
]


# -- which of several forms a value has -----------------------------------------------------------------------------


_FORMS: dict[str, Any] = {"mapping": dict, "list": (list, tuple), "null": type(None)}


def by_form(usual: str, *others: str) -> Discriminator:
    """Tells apart values that may be a mapping, a list or null; what is none of the others has the usual form."""
    return Discriminator(
        lambda value: next(
            (form for form in others if isinstance(value, _FORMS[form])), usual
        )
    )


def by_key(key: str, usual: str) -> Discriminator:
    """Tells mappings that have a key, which is their tag, from the usual ones."""
    return Discriminator(
        lambda value: key if isinstance(value, dict) and key in value else usual
    )


# -- mappings -------------------------------------------------------------------------------------------------------


Direction = Literal["x", "y", "z", "-x", "-y", "-z"]
Axis = Annotated[
    Annotated[Direction, Tag("text")] | Annotated[Triple, Tag("list")],
    by_form("text", "list"),
]


class Model(Record):
    """Common behaviour of all mappings."""

    @classmethod
    def valid_keys(cls) -> list[str]:
        """Keys; what rows and bodies share stands behind what distinguishes them."""
        return sorted(cls.model_fields, key=lambda key: key in _SHARED)

    @classmethod
    def hint_at(cls, key: str) -> str:
        """A hint at what was meant by an unknown key, which may be one of another convention."""
        instead, hint = _RENAMED.get(key, ("", ""))
        return f"; {hint}" if instead in cls.model_fields else super().hint_at(key)


def exactly_one(*keys: str) -> Any:
    """A check that a mapping states exactly one of some keys."""

    def check(model: Model) -> None:
        stated = [key for key in keys if getattr(model, key) is not None]
        if len(stated) != 1:
            raise UnfitError(
                f"give exactly one of {', '.join(keys)}; found {' and '.join(stated) or 'none of them'}"
            )

    return model_check(check)


class Frame(Model):
    """Where a frame sits in another."""

    xyz: Triple = optional(("0", "0", "0"), "Translation, m.", [0, 0, "l1"])
    rpy: Triple | None = optional(
        None,
        "Rotations about the fixed x, y, z axes, in this order, rad: Rz(yaw) Ry(pitch) Rx(roll).",
        ["pi/2", 0, 0],
    )
    rotation: Matrix | None = optional(
        None,
        "Instead of rpy: the exact rotation matrix by rows; its columns are the axes of the placed frame.",
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    )

    @model_check
    def _check_rotation(self) -> None:
        if self.rpy is not None and self.rotation is not None:
            raise UnfitError("give rpy or rotation, not both")


class MotionStep(Model):
    """One elementary motion of a custom joint."""

    motion: Literal["rotation", "translation", "screw", "ball"] = required(
        "Kind of the motion.", "rotation"
    )
    name: Name = required("Name of the coordinate.", "wrist.1")
    axis: Direction = optional("z", "Coordinate axis of the frame that it moves.", "x")
    pitch: Expression = optional("0", "Travel of a screw, m/rad.", "0.002")


Step = Annotated[
    Annotated[MotionStep, Tag("motion")] | Annotated[Frame, Tag("frame")],
    by_key("motion", "frame"),
]


class _Joint(Model):
    name: str | None = optional(
        None,
        "Name of the joint and of its coordinate; default: the body's name.",
        "elbow",
    )
    origin: Frame = optional(
        Frame.model_construct(),
        "Frame of the joint in the frame of the parent body.",
        {"xyz": [0, 0, "l1"]},
    )


class AxisJoint(_Joint):
    """One axis: the body turns about it, slides along it, or both; the axis of a planar joint is the plane's normal."""

    type: Literal["revolute", "continuous", "prismatic", "cylindrical", "planar"] = (
        required("Type of the joint.", "revolute")
    )
    axis: Axis = required("Axis in the joint's frame.", "z", [0, "0.6", "0.8"])


class HelicalJoint(_Joint):
    """A screw."""

    type: Literal["helical"] = required("Type of the joint.", "helical")
    axis: Axis = required("Axis in the joint's frame.", "z")
    pitch: Expression = required("Travel along the axis, m/rad.", "0.002", "h")


class UniversalJoint(_Joint):
    """Two rotations about perpendicular axes that intersect; the first is fixed in the parent."""

    type: Literal["universal"] = required("Type of the joint.", "universal")
    axis: Direction = required("First axis.", "x")
    axis2: Direction = required("Second axis, perpendicular to the first.", "y")

    @model_check
    def _check_axes(self) -> None:
        if self.axis[-1] == self.axis2[-1]:
            raise UnfitError(
                f"axis2 must be perpendicular to axis, so not along {self.axis[-1]}"
            )


class PlainJoint(_Joint):
    """A joint without an axis."""

    type: Literal["spherical", "floating", "fixed"] = required(
        "Type of the joint.", "spherical"
    )


class CustomJoint(Model):
    """Any sequence of frames and elementary motions."""

    type: Literal["custom"] = required("Type of the joint.", "custom")
    kind: str = optional("custom", "Name of the joint in results.", "offset hinge")
    name: str | None = optional(
        None,
        "Name of the joint; default: the body's name. Motions have their own.",
        "wrist",
    )
    steps: tuple[Step, ...] = required(
        "From the parent's frame to the body's.",
        [{"motion": "rotation", "name": "wrist.1", "axis": "x"}, {"xyz": ["e", 0, 0]}],
    )


Joint = Annotated[
    AxisJoint | HelicalJoint | UniversalJoint | PlainJoint | CustomJoint,
    ByValue("type", "{type: revolute, axis: z}"),
]


if TYPE_CHECKING:
    LoopJoint = str
else:
    LoopJoint = Literal[*(kind.value for kind in ClosureKind), "points", "axes"]
_WITHOUT_AXIS = ("weld", "spherical", "points")


class LoopEntry(Model):
    """A joint that closes a loop: it holds a frame of one body against a frame of another."""

    name: Name | None = optional(
        None, "Name of the loop; default loop1, loop2, …", "rocker"
    )
    joint: LoopJoint = required(
        "Kind of the joint; points is another word for spherical, axes for cylindrical.",
        "revolute",
    )
    connects: PairOfParts = required(
        "Names of the first and the second body, or of frames on them; base for the base, null for the fixed world.",
        ["coupler", "rocker"],
    )
    at: Frame = optional(
        Frame.model_construct(),
        "Frame on the first body; its z axis is that of the joint, its x axis the first of a universal.",
        {"xyz": ["l3", 0, 0]},
    )
    on_second: Frame | None = optional(
        None,
        "Frame on the second body; its y axis is the second of a universal. Default: its own, where two "
        "fixed frames are connected and at is left out; otherwise where the first frame is while all coordinates are "
        "zero.",
        {"xyz": ["l4", 0, 0]},
    )
    axis: Axis | None = optional(
        None,
        "Direction of the joint's axis, or of the normal of its plane, in at and on_second, if not z.",
        "y",
    )

    @model_check
    def _check_axis(self) -> None:
        if self.axis is not None and self.joint in _WITHOUT_AXIS:
            raise UnfitError(f"a {self.joint} joint has no axis")
        if self.axis is not None and self.joint == "universal":
            raise UnfitError(
                "a universal joint has two axes, x of at and y of on_second: turn these frames by rpy"
            )


Loop = Annotated[
    Annotated[LoopEntry, Tag("mapping")] | Annotated[PairOfParts, Tag("list")],
    by_form("mapping", "list"),
]
"""A joint, or the names of two frames that are held together in all six directions."""


Pair = tuple[Expression, Expression]


class SplineFunction(Model):
    """A function of one coordinate that is zero at zero: a polynomial, with cubic terms beyond knots."""

    coefficients: tuple[Expression, ...] = required(
        "Coefficients of the coordinate, its square, its cube and so on.",
        ["1/2", "0", "0.1"],
    )
    knots: tuple[Pair, ...] = optional(
        (),
        "Pairs x, c: c times the cube of the distance from x is added beyond x, seen from zero.",
        [["0.5", "0.2"]],
    )


TermEntry = Annotated[
    Annotated[Expression, Tag("text")] | Annotated[SplineFunction, Tag("mapping")],
    by_form("text", "mapping"),
]


class CouplingTerms(Model):
    """A dependent coordinate term by term, for coordinates whose names cannot stand in an expression."""

    terms: dict[str, TermEntry] = required(
        "Ratio to each independent coordinate, or another function of it.",
        {"left-knee": "1/2"},
    )
    offset: Expression = optional("0", "Constant part, rad or m.", "pi/2")


class SplineThrough(Model):
    """A natural cubic spline of one coordinate, straight beyond its first and last point."""

    of: Name = required("The independent coordinate.", "knee")
    points: tuple[Pair, ...] = required(
        "Pairs: the independent coordinate, and the dependent one there; rad or m.",
        [["-2", "0.01"], ["-1", "0.004"], ["0", "0"]],
    )


class CouplingSpline(Model):
    """A dependent coordinate as a spline of another one, as muscle models have it at the knee."""

    spline: SplineThrough


CouplingEntry = Annotated[
    Annotated[Expression, Tag("text")]
    | Annotated[CouplingTerms, Tag("mapping")]
    | Annotated[CouplingSpline, Tag("spline")],
    Discriminator(
        lambda value: (
            "text"
            if not isinstance(value, dict)
            else "spline"
            if "spline" in value
            else "mapping"
        )
    ),
]
