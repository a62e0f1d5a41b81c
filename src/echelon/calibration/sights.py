"""Measurements of the geometry as recorded rows: what a tool's frame is, seen from an outer frame.

All kinds are functions of one relative frame, from an outer frame on one body to a tool on another: its pose, its
position, the distance of a point, the height over a plane.  A touched plane or sphere and a fixed point of contact
measure that a row is zero, and so does a closed loop; what they show they show at closed states only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from echelon.algebra import Scalar, exact_number
from echelon.calibration.errors import COMPONENTS, ErredRecorder, Frame, erred_frames
from echelon.dynamics import moved
from echelon.formats import MeasureEntry, RobotFile
from echelon.robot import (
    GROUND,
    Closure,
    Mechanism,
    RecordedStep,
    Vec,
    apply,
    dot,
    known_values,
    placement_matrix,
    product,
    scale,
    transpose,
)
from echelon.shared import Floats, InputError, nearest_of, symbol_stem

if TYPE_CHECKING:
    from echelon.formats import MeasureKind

BASE = "base"
USUAL_RADIUS = 0.1
"""Radius of a touched sphere that is not stated, m, from which the search begins."""

_SHIFTS = COMPONENTS[:3]
OUTER: dict[MeasureKind, Sequence[str]] = {
    "pose": COMPONENTS,
    "position": COMPONENTS,
    "distance": _SHIFTS,
    "sphere": _SHIFTS,
    "contact": _SHIFTS,
    "plane": ("pz", "rx", "ry"),
}
"""Errors of the outer frame that a measurement may depend on."""


@dataclass(frozen=True)
class Sight:
    """One pose, point or loop that is measured."""

    name: str
    entry: MeasureEntry | None  # None for a loop of the robot
    body: int  # that carries the tool; GROUND for the base
    on: int  # that carries the outer frame
    tool: str
    frame: str
    place: Floats = field(
        default_factory=lambda: np.eye(4)
    )  # nominal frame of the tool on its body, shape (4, 4)
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in the tool's frame, m
    closure: Closure | None = None

    @property
    def kind(self) -> str:
        """Kind of the measurement; ``closure`` of a loop."""
        return "closure" if self.entry is None else self.entry.kind

    @property
    def radius(self) -> float | None:
        """The length that is the same for all rows, m; None if it is measured or unknown."""
        return None if self.entry is None else self.entry.length

    @property
    def is_marker(self) -> bool:
        """Whether the tool is one point at an unknown place."""
        return self.entry is not None and self.entry.points.get(self.tool, ()) is None

    @property
    def unplaced(self) -> str:
        """The end whose place matters and nobody knows: a marker, or the centre of a distance; empty if none."""
        if self.is_marker:
            return self.tool
        return self.frame if self.kind == "distance" else ""

    @property
    def measured(self) -> int:
        """Numbers that the log holds for each row."""
        fixed = self.kind == "distance" and self.radius is not None
        if fixed:
            return 0
        return {"pose": 12, "position": 3, "distance": 1}.get(self.kind, 0)

    @property
    def constrains(self) -> bool:
        """Whether the robot is at states of a surface while this is measured."""
        return not self.measured


def sights_of(
    mechanism: Mechanism, entries: Sequence[MeasureEntry]
) -> tuple[Sight, ...]:
    """Everything that some entries measure, and the robot's own loops."""
    entries = entries or (MeasureEntry(pose=_last_body(mechanism)),)
    places = [_place(mechanism, entry.body) for entry in entries]
    carriers = {body for body, _ in places}
    found: list[Sight] = []
    for count, (entry, (body, place)) in enumerate(
        zip(entries, places, strict=True), 1
    ):
        name = entry.name or f"{entry.kind}{count}"
        on = GROUND if entry.on is None else _place(mechanism, entry.on)[0]
        if on == body:
            raise InputError(
                f"tool and outer frame are both on '{entry.body}', so nothing moves between them",
                element=f"measure '{name}'",
            )
        _check(entry, name)
        shared = "tool" if len(carriers) == 1 else mechanism.bodies[body].name
        outer = BASE if entry.kind in ("pose", "position") else name
        tool, frame = entry.tool or shared, entry.frame or outer
        for marker, point in (entry.points or {"": entry.point}).items():
            title = f"{name}.{marker}" if marker else name
            found.append(
                Sight(
                    title,
                    entry,
                    body,
                    on,
                    marker if point is None else tool,
                    frame,
                    place,
                    point or (0.0, 0.0, 0.0),
                )
            )
    for closure in mechanism.closures:
        ends = (f"{closure.name}_second", f"{closure.name}_first")
        found.append(
            Sight(
                closure.name,
                None,
                closure.second,
                closure.first,
                *ends,
                closure=closure,
            )
        )
    names = [sight.name for sight in found]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(
            "two measurements have this name", element=f"measure '{twice}'"
        )
    return tuple(found)


def _check(entry: MeasureEntry, name: str) -> None:
    """Refuse fields that say nothing about a kind of measurement."""
    where = f"measure '{name}'"
    if entry.points and entry.kind != "position":
        raise InputError(
            f"points belong to a position, not to a {entry.kind}", element=where
        )
    if entry.inverse and entry.kind != "pose":
        raise InputError(
            f"inverse belongs to a pose, not to a {entry.kind}", element=where
        )
    if entry.length is not None and entry.kind not in ("distance", "sphere"):
        raise InputError(f"a {entry.kind} has no length", element=where)
    touches = entry.kind in ("plane", "sphere", "contact")
    if entry.columns and (touches or entry.length is not None):
        raise InputError(
            f"no column is read of a {entry.kind} that touches or has a known length: leave out  columns"
            + (", or  length" if entry.length is not None else ""),
            element=where,
        )


def _last_body(mechanism: Mechanism) -> str:
    """The tip of a robot that has one tip only."""
    parents = {body.parent for body in mechanism.bodies}
    moving = range(len(mechanism.bodies))
    tips = [mechanism.bodies[k].name for k in moving if k not in parents]
    if len(tips) != 1:
        raise InputError(
            f"the robot has several tips: state the measured body, as in  measure: [{{pose: {tips[0]}}}]"
        )
    return tips[0]


def _place(mechanism: Mechanism, name: str) -> tuple[int, Floats]:
    """The body that carries a body, link or frame of some name, and its frame there, shape (4, 4)."""
    names = [body.name for body in mechanism.bodies]
    if name in names:
        return names.index(name), np.eye(4)
    if name == BASE:
        return GROUND, np.eye(4)
    reading = mechanism.reading
    rides = {}
    if reading is not None and isinstance(reading.file, RobotFile):
        built = reading.file.built(reading.options)
        rides = dict(built.rides)
        if name in rides:
            body, placement = built.place(name)
            values = known_values(built.mechanism)
            return body, placement_matrix(placement, values)
    raise InputError(
        f"the robot has no body or link '{name}'{nearest_of(name, [*names, *rides])}",
        element="measure",
    )


Nominal = Callable[[str], RecordedStep | None]
"""The nominal frame of a tool or of an outer frame by its name; None where it is that of its body."""


@dataclass(frozen=True)
class SightRecorder:
    """Records what sights see."""

    recorder: ErredRecorder
    sights: Sequence[Sight]
    nominal: Nominal
    rational: bool = False  # whether rows are rational, with distances squared, and closures have no idle ones

    def relative(self) -> Iterator[tuple[Sight, Frame]]:
        """For each sight, the point of the tool with its axes, seen from the outer frame."""
        components = dict[str, list[str]]()
        for sight in self.sights:
            used = components.setdefault(sight.frame, [])
            used += [c for c in OUTER.get(sight.kind, COMPONENTS) if c not in used]  # type: ignore[call-overload]
        outers = {
            sight.frame: self._errors(
                sight.frame,
                [c for c in COMPONENTS if c in components[sight.frame]],
                known=sight.closure is not None,
            )
            for sight in self.sights
        }
        ends = {end for sight in self.sights for end in (sight.body, sight.on)}
        frames = erred_frames(self.recorder, ends)
        for sight in self.sights:
            known = sight.closure is not None
            tool, outer = frames[sight.body], frames[sight.on]
            if sight.closure is not None:
                stated = {c.name: c for c in self.recorder.mechanism.closures}
                first, second = stated[sight.closure.name].placements
                tool = moved(tool, self.recorder.placement(second))
                outer = moved(outer, self.recorder.placement(first))
            parts = _SHIFTS if sight.is_marker else COMPONENTS
            tool_errors = self._errors(sight.tool, parts, known=known)
            tool = reduce(moved, tool_errors, tool)
            outer = reduce(moved, outers[sight.frame], outer)
            x, y, z = (
                self.recorder.program.constant(exact_number(v)) for v in sight.point
            )
            tool = moved(tool, RecordedStep(None, (x, y, z)))
            yield sight, _seen_from(outer, tool)

    def _errors(
        self, name: str, components: Sequence[str], *, known: bool
    ) -> list[RecordedStep]:
        """Steps to a tool or an outer frame: its errors, and its nominal place."""
        steps = self.recorder.frame(symbol_stem(name), components, known=known)
        nominal = self.nominal(name)
        return steps if nominal is None else [*steps, nominal]

    def rows(self, sight: Sight, frame: Frame) -> list[Scalar]:
        """Rows of a sight: what is measured, or what vanishes."""
        rotation, x = frame
        kind = sight.kind
        if sight.closure is not None:
            kinds = sight.closure.kind
            # the axes coincide where it is closed, so that entries above the diagonal tell all turns
            turns = [d for d in kinds.directions if d[0] < d[1] or not self.rational]
            ends = [x[k] for k in kinds.positions]
            return ends + [rotation[i][j] - value for i, j, value in turns]
        if kind == "pose":
            inverse = sight.entry is not None and sight.entry.inverse
            if inverse:
                turned = transpose(rotation)
                rotation = turned
                x = scale(apply(turned, x), -self.recorder.program.one)
            return [*x, *(entry for row in rotation for entry in row)]
        if kind == "plane":
            return [x[2]]
        if kind in ("distance", "sphere"):
            return [self._distance(sight, x)]
        return list(x)

    def _distance(self, sight: Sight, x: Vec) -> Scalar:
        """A measured distance, or what it exceeds a fixed one by."""
        square, fixed = dot(x, x), self.recorder.program.zero
        if sight.radius is not None:
            fixed = fixed + exact_number(sight.radius)
        elif not sight.measured:
            fixed = self.recorder.error(f"radius{symbol_stem(sight.name)}", "m", inf)
            fixed = fixed + exact_number(USUAL_RADIUS)
        return square - fixed * fixed if self.rational else square.sqrt() - fixed


def _seen_from(outer: Frame, inner: Frame) -> Frame:
    """A frame in another one."""
    (turned, origin), (rotation, shift) = outer, inner
    back = transpose(turned)
    x, y, z = (a - b for a, b in zip(shift, origin, strict=True))
    away: Vec = (x, y, z)
    return product(back, rotation), apply(back, away)
