"""A robot as a drawing: bodies as segments from joint to joint, labels beside with what can be seen of each.

A flat drawing of an axonometric projection needs neither WebGL nor a script, and prints.  The direction of view is the
one of a dozen from which the robot's joints spread widest.  The pose is one that can be recognised: assembled, or bent
where the zero pose is a line.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.base import BaseModel, Identifiability
from echelon.dynamics import Kinematics, assembly_of
from echelon.report.page import Context
from echelon.robot import (
    GROUND,
    Mechanism,
    MotionKind,
    Placement,
    placement_matrix,
    symbol_values,
    upward,
)
from echelon.shared import PARAMETERS, PER_BODY, EchelonError, Floats, one_line

CLASSES = {
    Identifiability.ALONE: "alone",
    Identifiability.COMBINATION: "combined",
    Identifiability.UNIDENTIFIABLE: "unseen",
}
"""Names of the classes in style sheets."""

Point = tuple[float, float]


@dataclass(frozen=True)
class _Layout:
    """Measures of a drawing, px."""

    width: float = 940.0
    label: float = 262.0  # width of the columns of labels on both sides
    row: float = 24.0  # height of a label
    least_height: float = 180.0
    largest_height: float = 420.0  # if the labels need no more
    margin: float = 24.0


_LAYOUT = _Layout()


@dataclass(frozen=True)
class _Proportions:
    """How a robot without stated shapes is drawn, flat or moving; lengths are shares of its extent."""

    elevation: float = 0.4  # how far the view looks down, rad
    axis: float = 0.035  # half-length of a joint's axis
    last_body: float = 0.15  # length of a last body


PROPORTIONS = _Proportions()


@dataclass(frozen=True)
class SeenBody:
    """One body."""

    index: int  # in ``mechanism.bodies``
    label: str
    name: str
    cells: tuple[
        str, ...
    ]  # for XX … M a value of :data:`CLASSES`; empty for what it does not carry
    parameters: tuple[
        tuple[str, tuple[str, ...]], ...
    ]  # shape (str, tuple of str): class → names of its parameters

    @property
    def level(self) -> int:
        """Identifiable share of the body's parameters: 0 none, 1 to 3 in thirds, 4 all."""
        carried = sum(1 for cell in self.cells if cell)
        seen = sum(1 for cell in self.cells if cell in ("alone", "combined"))
        if seen in (0, carried):
            return 4 if seen else 0
        return min(1 + 3 * seen // carried, 3)

    @property
    def counts(self) -> dict[str, int]:
        """Number of parameters in each class."""
        return {kind: len(names) for kind, names in self.parameters}

    @property
    def words(self) -> str:
        """All in one sentence."""
        known = {"alone": "alone", "combined": "in combination", "unseen": "not at all"}
        parts = [
            f"{known[kind]}: {', '.join(names)}"
            for kind, names in self.parameters
            if names
        ]
        return one_line(f"{self.name} (link {self.label}) – {'; '.join(parts)}")


def seen_links(base: BaseModel) -> Context:
    """Context of ``links.html.j2``: a drawing of the robot that shows how much of every body is identifiable."""
    bodies, pose = seen_bodies(base), drawable_pose(base.mechanism)
    classes = list(base.classification.values())
    return {
        "bodies": bodies,
        "columns": PARAMETERS,
        "drawing": None if pose is None else drawing(base.mechanism, pose, bodies),
        "bent": pose is not None and pose.bent,
        "loops": bool(base.mechanism.dependent_velocities),
        "counts": {name: classes.count(kind) for kind, name in CLASSES.items()},
    }


def seen_bodies(base: BaseModel) -> list[SeenBody]:
    """All bodies that carry parameters, base to tip."""
    classes = [CLASSES[kind] for kind in base.classification.values()]
    found = []
    for index in base.mechanism.carriers:
        body, first = base.mechanism.bodies[index], base.mechanism.first_column[index]
        own = {kind: classes[first + k] for k, kind in enumerate(body.carried)}
        names = {
            kind: tuple(f"{PARAMETERS[k]}" for k in own if own[k] == kind)
            for kind in CLASSES.values()
        }
        cells = tuple(own.get(k, "") for k in range(PER_BODY))
        found.append(
            SeenBody(
                index,
                body.label,
                one_line(base.mechanism.carrier_name(index)),
                cells,
                tuple(names.items()),
            )
        )
    return found


@dataclass(frozen=True)
class Link:
    """A body in the drawing, px."""

    body: SeenBody | None  # none if it carries no parameters
    # to the joints that it carries; a single dashed one for a last body, whose length nobody states
    segments: tuple[tuple[Point, Point], ...]
    last: bool
    axis: tuple[Point, Point]  # along the axis of its joint
    label: Point | None  # where its label begins
    leader: tuple[Point, ...]  # line from the label to the body


@dataclass(frozen=True)
class Drawing:
    """A robot, ready to be drawn."""

    width: float  # px
    height: float  # px
    links: tuple[Link, ...]
    ground: tuple[tuple[Point, Point], ...]  # from the base frame to the first joints
    base: Point  # origin of the base frame


def drawing(mechanism: Mechanism, pose: Pose, seen: Sequence[SeenBody]) -> Drawing:
    """A mechanism at a pose as a drawing."""
    ends = _ends(mechanism, pose)
    extent = _extent(np.vstack([pose.origins, *ends.values(), np.zeros((1, 3))]))
    half = PROPORTIONS.axis * extent * pose.axes
    axes = np.stack([pose.origins - half, pose.origins + half], axis=1)
    tips = dict(ends)
    for i, points in ends.items():
        if not len(points):
            stub = PROPORTIONS.last_body * extent * ahead(mechanism, i, extent)
            tips[i] = (pose.origins[i] + pose.rotations[i] @ stub)[None]
    cloud = np.vstack(
        [np.zeros((1, 3)), pose.origins, axes.reshape(-1, 3), *tips.values()]
    )
    place = _Paper(
        cloud, pose.up, _LAYOUT.row * ((len(seen) + 1) // 2) + 2 * _LAYOUT.margin
    )
    height = place.height
    anchors = {}
    for body in seen:
        end = tips[body.index].mean(axis=0)
        anchors[body.index] = place(0.5 * (pose.origins[body.index] + end))
    labels = _labels(anchors, height)
    by_index = {body.index: body for body in seen}
    links = []
    for index in range(len(mechanism.bodies)):
        start = place(pose.origins[index])
        links.append(
            Link(
                by_index.get(index),
                tuple((start, place(tip)) for tip in tips[index]),
                not len(ends[index]),
                (place(axes[index, 0]), place(axes[index, 1])),
                *labels.get(index, (None, ())),
            )
        )
    roots = [i for i, body in enumerate(mechanism.bodies) if body.parent == GROUND]
    origin = place(np.zeros(3))
    return Drawing(
        _LAYOUT.width,
        height,
        tuple(links),
        tuple((origin, place(pose.origins[i])) for i in roots),
        origin,
    )


def _ends(mechanism: Mechanism, pose: Pose) -> dict[int, Floats]:
    """For every body the origins of the bodies that hang on it, shape (children, 3)."""
    children: dict[int, list[int]] = {i: [] for i in range(len(mechanism.bodies))}
    for index, body in enumerate(mechanism.bodies):
        if body.parent != GROUND:
            children[body.parent].append(index)
    return {i: pose.origins[some].reshape(-1, 3) for i, some in children.items()}


def _extent(points: Floats) -> float:
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return size if size > 0 else 1.0


def ahead(mechanism: Mechanism, index: int, extent: float) -> Floats:
    """Where a last body, whose length nobody states, goes on in its own frame: a unit vector."""
    # that is as its parent came while all joints are at zero, or as it slides
    body, zero = mechanism.bodies[index], pose_at(mechanism, positions_of(mechanism))
    direction = zero.origins[index] - (
        np.zeros(3) if body.parent == GROUND else zero.origins[body.parent]
    )
    slides = any(
        motion.kind in (MotionKind.TRANSLATION, MotionKind.SCREW)
        for motion in body.joint.motions[:1]
    )
    if slides or np.linalg.norm(direction) < 1e-6 * extent:
        direction = zero.axes[index] if np.linalg.norm(zero.axes[index]) else zero.up
    found: Floats = zero.rotations[index].T @ direction / np.linalg.norm(direction)
    return found


class _Paper:
    """Points in space to points on paper."""

    def __init__(self, cloud: Floats, up: Floats, least: float) -> None:
        elevation = PROPORTIONS.elevation
        turn = widest_view(cloud / _extent(cloud), up, elevation)
        self._axes = projection(up, turn, elevation)
        flat = cloud @ self._axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        width, tall = np.maximum(
            high - low, 1e-9 * max(float(np.max(high - low)), 1e-300)
        )
        margins = 2 * _LAYOUT.margin
        room = _LAYOUT.width - 2 * _LAYOUT.label - margins
        wanted = room * tall / width + margins
        usual = np.clip(wanted, _LAYOUT.least_height, _LAYOUT.largest_height)
        self.height = max(least, float(usual))
        self._scale = float(min(room / width, (self.height - margins) / tall))
        self._middle = 0.5 * (low + high)
        self._centre = np.array([_LAYOUT.width, self.height]) / 2

    def __call__(self, point: Floats) -> Point:
        x, y = self._centre + self._scale * np.array([1.0, -1.0]) * (
            self._axes @ point - self._middle
        )
        return float(x), float(y)


def _labels(
    anchors: dict[int, Point], height: float
) -> dict[int, tuple[Point, tuple[Point, ...]]]:
    """Places of labels in two columns, and lines from there: half of the bodies left, by height, without crossings."""
    by_side = sorted(anchors, key=lambda i: (round(anchors[i][0], 3), i))
    half = len(by_side) // 2
    found: dict[int, tuple[Point, tuple[Point, ...]]] = {}
    for left, some in ((True, by_side[:half]), (False, by_side[half:])):
        # of bodies at one place the outer ones stand above
        order = sorted(some, key=lambda i: (round(anchors[i][1], 3), -i))
        for index, y in zip(
            order, _apart([anchors[i][1] for i in order], height), strict=True
        ):
            edge = _LAYOUT.label if left else _LAYOUT.width - _LAYOUT.label
            bend = edge + 12 if left else edge - 12
            begin = 0.0 if left else edge + 6
            found[index] = (begin, y), ((edge, y), (bend, y), anchors[index])
    return found


def _apart(wanted: Sequence[float], height: float) -> list[float]:
    """Ascending heights near the wanted ones, a row apart, inside the drawing."""
    placed: list[float] = []
    low = _LAYOUT.margin
    for y in wanted:
        placed.append(max(y, low))
        low = placed[-1] + _LAYOUT.row
    high = height - _LAYOUT.margin
    for k in reversed(range(len(placed))):
        placed[k] = min(placed[k], high)
        high = placed[k] - _LAYOUT.row
    return placed


BEND = 0.5
"""Angle, rad, between neighbouring joints of a robot whose zero pose is a line."""
VIEWS = 12
"""Directions of view that are tried: the widest of them is within 8° of the best one."""
LINE_THICKNESS = 0.15
"""Ratio of a pose's second extent to its first, below which it looks like a line."""


@dataclass(frozen=True)
class Pose:
    """Frames and joint axes of all bodies, in the base frame."""

    origins: Floats  # shape (bodies, 3): origins of the bodies' frames, m
    rotations: Floats  # shape (bodies, 3, 3): axes of the bodies' frames, as columns
    axes: Floats  # shape (bodies, 3): direction of the joint's first freedom; zero for fixed joints
    up: Floats  # shape (3,): against gravity; z without gravity
    bent: bool  # whether joints were turned from zero, because the zero pose is a line


def drawable_pose(mechanism: Mechanism) -> Pose | None:
    """A pose in which a robot can be recognised: assembled where there are loops, else zero, bent if that is a line.

    None where lengths have no values or loops do not close.
    """
    try:
        if closed := assembly_of(mechanism):
            return pose_at(mechanism, closed.pose)
        straight = pose_at(mechanism, positions_of(mechanism))
        if len(mechanism.bodies) < 2:
            return straight if mechanism.bodies else None
        extent = np.linalg.svd(
            straight.origins - straight.origins.mean(axis=0), compute_uv=False
        )
        if extent[1] < LINE_THICKNESS * extent[0]:
            return pose_at(mechanism, positions_of(mechanism, BEND), bent=True)
        return straight
    except EchelonError:
        return None


def positions_of(mechanism: Mechanism, bend: float = 0.0) -> Floats:
    """All positions, shape (positions,): rotations alternate between bend and −bend; balls are upright; others zero."""
    found: dict[str, float] = {}
    sign = 1.0
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            found |= dict(zip(motion.positions, (1.0, 0.0, 0.0, 0.0), strict=True))
        elif motion.kind is MotionKind.ROTATION:
            found[motion.name] = sign * bend
            sign = -sign
    return np.array([found.get(name, 0.0) for name in mechanism.positions])


def pose_at(mechanism: Mechanism, q: Floats, *, bent: bool = False) -> Pose:
    """Frames of all bodies at positions of shape (positions,); an InputError if a geometry symbol has no value."""
    symbols = symbol_values(
        mechanism,
        sorted({s for body in mechanism.bodies for s in body.joint.symbols()}),
    )
    frames = Kinematics(mechanism).frames(q[None])
    axes = joint_axes(mechanism, frames[..., :3], symbols)[0]
    return Pose(frames[0, :, :, 3], frames[0, :, :, :3], axes, upward(mechanism), bent)


def joint_axes(
    mechanism: Mechanism, rotations: Floats, symbols: Mapping[str, float]
) -> Floats:
    """Direction of each joint's first freedom, shape (N, bodies, 3), for rotations of all bodies, (N, bodies, 3, 3)."""
    # it is fixed in the parent's frame, behind constant placements; zero for fixed joints
    axes = np.zeros(rotations.shape[:-1])
    for index, body in enumerate(mechanism.bodies):
        if body.joint.is_fixed:
            continue
        first, motion = body.joint.steps[0], body.joint.motions[0]
        frame = (
            placement_matrix(first, symbols)[:3, :3]
            if isinstance(first, Placement)
            else np.eye(3)
        )
        own = (
            frame[:, 0]
            if motion.kind is MotionKind.BALL
            else motion.sign * frame[:, motion.axis]
        )
        axes[:, index] = (
            own if body.parent == GROUND else rotations[:, body.parent] @ own
        )
    return axes


def sides(up: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors perpendicular to a third and to each other; the script of the preview derives the same ones."""
    side = np.cross(up, [1.0, 0.0, 0.0] if abs(up[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    return side, np.cross(side, up)


def projection(up: Floats, turn: float, elevation: float) -> Floats:
    """Right and up on paper, as rows, seen from a direction around the vertical that looks down; angles in rad."""
    side, front = sides(up)
    right = np.cos(turn) * side + np.sin(turn) * front
    return np.stack(
        [right, np.cos(elevation) * up + np.sin(elevation) * np.cross(up, right)]
    )


def widest_view(points: Floats, up: Floats, elevation: float) -> float:
    """Direction of view around the vertical, rad, from which points of about unit size fill the largest area."""

    def area(turn: float) -> float:
        flat = points @ projection(up, turn, elevation).T
        values = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
        return round(
            float(values[0] * values[1]), 6
        )  # rounded, so that the view is the same everywhere

    turns: list[float] = (np.pi * (np.arange(VIEWS) + 0.25) / VIEWS).tolist()
    return max(turns, key=area)
