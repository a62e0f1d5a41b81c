"""Clearances as constraints of the state: smallest distances between bodies, by MuJoCo, and their exact derivatives.

MuJoCo's distance function looks at the geoms' frames only, so no step of its dynamics is taken.  Two habits of it are
worked around.  Its function for a capsule and a box calls some deep overlaps positive distances (up to version 4.0 at
least), so boxes are handed over as hulls of their corners.  And its tolerance is meant for contacts; ours is tighter,
since derivatives are taken from the nearest points.

Neighbouring bodies touch at their joint whatever the robot does, so distances between them say nothing; the same holds
for the fixed base and the first moving body.

The distance of two convex solids changes as that of their nearest points does when these ride on the bodies: moving
along the surfaces changes nothing in first order.  So its derivative is n · (∂p₂/∂q − ∂p₁/∂q) with the unit normal n
from the first to the second, and with the derivatives of the frames it is exact.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from echelon.dynamics import Kinematics
from echelon.excite.problem.shapes import (
    TOUCHING,
    WORLD,
    BoundingSpheres,
    Owner,
    Shape,
    ShapeKind,
    placed,
)
from echelon.excite.problem.state_limits import SECONDS, Slopes, StateConstraint
from echelon.formats import import_mujoco, quaternion_matrix
from echelon.robot import GROUND, Mechanism, MotionKind
from echelon.shared import EchelonError, Floats, InputError, Integers

_OLDEST = (3, 12)
"""Versions of MuJoCo before this one have wrong distances, by up to decimetres, for some convex shapes far apart."""

CCD_TOLERANCE = 1e-10
"""Tolerance of MuJoCo's distances, m: slopes are taken from the points that are nearest."""
CCD_ITERATIONS = 200
"""Iterations of MuJoCo until that tolerance is met."""


@dataclass(frozen=True)
class Measured:
    """Distances of pairs of shapes."""

    distances: Floats  # shape (K,); m, negative where shapes overlap, at most the reach that was asked for
    # shape (K, 2, 3); nearest, or deepest, points on the first and on the second shape in the base frame, m; zero
    # beyond the reach
    points: Floats


class Engine:
    """Measures distances between some shapes."""

    def __init__(self, shapes: tuple[Shape, ...]) -> None:
        self.shapes = shapes
        self._mujoco = _recent_mujoco()
        self._model = self._compiled()

    def places(self, frames: Floats) -> Floats:
        """Frames of all shapes in the base frame, (N, shapes, 3, 4), from those of the bodies, (N, bodies, 3, 4)."""
        world = np.broadcast_to(np.eye(3, 4), (len(frames), 1, 3, 4))
        # the world is body −1, the last one
        bodies = np.concatenate([frames, world], axis=1)[
            :, [shape.body for shape in self.shapes]
        ]
        return _behind(
            bodies,
            np.array([shape.placement for shape in self.shapes]).reshape(-1, 4, 4),
        )

    def measure(self, places: Floats, asked: Integers, reach: float) -> Measured:
        """Signed distances, for rows (state, first, second shape), (K, 3), equal states one after another."""
        geoms = _behind(places, self._offsets)
        rotations, origins = geoms[..., :3].reshape(len(geoms), -1, 9), geoms[..., 3]
        # a buffer of its own for every call, so that threads do not meet
        data = self._mujoco.MjData(self._model)
        distances, points = np.zeros(len(asked)), np.zeros((len(asked), 6))
        distance, model, now = self._mujoco.mj_geomDistance, self._model, -1
        for k, (state, first, second) in enumerate(asked.tolist()):
            if state != now:
                data.geom_xpos[:] = origins[state]
                data.geom_xmat[:] = rotations[state]
                now = state
            distances[k] = distance(model, data, first, second, reach, points[k])
        return Measured(distances, points.reshape(-1, 2, 3))

    @cached_property
    def _offsets(self) -> Floats:
        """Geoms in their shapes' frames: MuJoCo centres meshes and turns them to their principal axes."""
        poses = zip(self._model.geom_quat, self._model.geom_pos, strict=True)
        return np.array(
            [placed(quaternion_matrix(quat), pos) for quat, pos in poses]
        ).reshape(-1, 4, 4)

    def _compiled(self) -> Any:
        mujoco = self._mujoco
        spec = mujoco.MjSpec()
        spec.option.ccd_tolerance = CCD_TOLERANCE
        spec.option.ccd_iterations = CCD_ITERATIONS
        for k, shape in enumerate(self.shapes):
            if shape.core is None or shape.kind in (
                ShapeKind.SPHERE,
                ShapeKind.CAPSULE,
            ):
                size = (
                    (*shape.size, 0.0, 0.0, 0.0)[:3]
                    if shape.kind is not ShapeKind.PLANE
                    else (0.0, 0.0, 1.0)
                )
                spec.worldbody.add_geom(
                    type=getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}"),
                    size=size,
                )
            else:
                mesh = spec.add_mesh(name=f"mesh{k}", uservert=shape.core[0].ravel())
                mesh.inertia = (
                    mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
                )  # a thin mesh has hardly a volume
                spec.worldbody.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"mesh{k}"
                )
        try:
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            names = ", ".join(
                f"'{shape.name}'"
                for shape in self.shapes
                if shape.kind is ShapeKind.MESH
            )
            raise InputError(
                f"MuJoCo refuses one of the meshes {names}: {error}"
            ) from None


def _recent_mujoco() -> Any:
    mujoco = import_mujoco("excite")
    version = str(mujoco.__version__)
    if tuple(int(part) for part in version.split(".")[:2]) < _OLDEST:
        oldest = ".".join(map(str, _OLDEST))
        raise EchelonError(
            f"MuJoCo {version} gives wrong distances; clearances need version {oldest} or later"
        )
    return mujoco


def _behind(frames: Floats, placements: Floats) -> Floats:
    """Frames of shape (N, K, 3, 4), each moved on by a placement of shape (K, 4, 4)."""
    moved: Floats = np.einsum("nkij,kjl->nkil", frames[..., :3], placements[:, :3])
    moved[..., 3] += frames[..., 3]
    return moved


def checked_pairs(
    mechanism: Mechanism,
    shapes: Sequence[Shape],
    exclude: Sequence[tuple[str, str]] = (),
) -> Integers:
    """Pairs of shapes, shape (P, 2), on bodies that are neither rigidly connected nor neighbours.

    Planes come first, and pairs of the same owners are next to each other.  Exclusions name bodies, links or shapes.
    """
    excluded = [_excluded(mechanism, shapes, pair) for pair in exclude]
    found = []
    for pair in combinations(range(len(shapes)), 2):
        # planes belong to the world, whose index is the least
        first, second = sorted(pair, key=lambda k: (shapes[k].body, k))
        if not _neighbours(mechanism, shapes[first], shapes[second]) and not any(
            (first in a and second in b) or (first in b and second in a)
            for a, b in excluded
        ):
            found.append((first, second))
    order = {
        owner: k
        for k, owner in enumerate(dict.fromkeys(shape.owner for shape in shapes))
    }
    found.sort(
        key=lambda pair: [(shapes[k].body, order[shapes[k].owner]) for k in pair]
    )
    return np.array(found, dtype=np.intp).reshape(-1, 2)


def owner_name(mechanism: Mechanism, owner: Owner) -> str:
    """Name of an obstacle or a body, ``"world"`` for what else is fixed."""
    body, obstacle = owner
    return obstacle or (WORLD[0] if body == GROUND else mechanism.bodies[body].name)


def moving_body(mechanism: Mechanism, body: int) -> int:
    """The first body towards the root whose joint moves: both are one rigid body; −1 if that is the world."""
    while body != GROUND and mechanism.bodies[body].joint.is_fixed:
        body = mechanism.bodies[body].parent
    return body


def _neighbours(mechanism: Mechanism, first: Shape, second: Shape) -> bool:
    """Whether two shapes are on one rigid body, or one's body carries the other's; obstacles carry nothing."""
    ends = [moving_body(mechanism, shape.body) for shape in (first, second)]
    if ends[0] == ends[1] or first.obstacle or second.obstacle:
        return ends[0] == ends[1]
    above = [
        GROUND if e == GROUND else moving_body(mechanism, mechanism.bodies[e].parent)
        for e in ends
    ]
    return above[0] == ends[1] or above[1] == ends[0]


def _excluded(
    mechanism: Mechanism, shapes: Sequence[Shape], pair: tuple[str, str]
) -> tuple[frozenset[int], frozenset[int]]:
    names: Sequence[object] = pair  # that of a set-up may be anything
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise InputError(f"an exclusion needs two names, got {pair!r}")
    first, second = (_meant(mechanism, shapes, name) for name in pair)
    return first, second


def _meant(mechanism: Mechanism, shapes: Sequence[Shape], name: str) -> frozenset[int]:
    """The shapes that a name stands for."""
    bodies = [body.name for body in mechanism.bodies]
    known = {name for shape in shapes for name in (shape.name, shape.link) if name}
    fixed = set(WORLD) - known  # an obstacle that is called ground stands for itself
    body = (
        bodies.index(name)
        if name in bodies
        else GROUND
        if name == WORLD[0] or name in fixed
        else None
    )
    if body is None and name not in known:
        valid = ", ".join(dict.fromkeys((*bodies, WORLD[0], *sorted(known))))
        raise InputError(
            f"there is no body, link or shape '{name}' to exclude (valid: {valid})"
        )
    return frozenset(
        k
        for k, shape in enumerate(shapes)
        if name in (shape.name, shape.link) or (body is not None and body == shape.body)
    )


REACH = 0.2
"""Distance beyond the clearance up to which distances are measured, m: enough to be warned before a limit is near."""

MISLED = 1e-4
"""Length, m, by which nearest points may be further apart than the distance and still tell a normal."""


@dataclass(frozen=True, eq=False)
class Clearance(StateConstraint):
    """Bodies stay a distance apart; made by :func:`clearance_of`."""

    mechanism: Mechanism
    shapes: tuple[Shape, ...]
    pairs: Integers  # shape (P, 2); indices of shapes that are checked, pairs of the same owners next to each other
    reach: float  # larger distances are not told apart: values stop here and slopes are zero, m

    @property
    def seconds(self) -> float:
        """Work of all distances and their slopes at a sample, s."""
        return SECONDS.distance * len(self.pairs)

    @cached_property
    def owners(self) -> tuple[tuple[Owner, Owner], ...]:
        """Pairs of bodies, or of an obstacle and a body: what the values belong to."""
        return tuple(dict.fromkeys(_owners(self.shapes, self.pairs)))

    def __getstate__(self) -> dict[str, object]:
        """Copies make their own engine: it belongs to one process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:  # noqa: ARG002
        """Smallest distances of the pairs of owners, (N, m), m: negative where shapes overlap, at most the reach."""
        return self.nearest(q).distances

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:  # noqa: ARG002
        """Derivatives of the distances by the positions, zero beyond the reach, shape (N, m, n)."""
        found = self.nearest(q)
        states, columns = np.nonzero(found.distances < self.reach)
        slopes = np.zeros((*found.distances.shape, np.shape(q)[1]))
        if len(states):
            frames, moved = self.kinematics.frames(q), self.kinematics.slopes(q)
            points = found.points[states, columns]
            distances = found.distances[states, columns]
            normals = _normals(points, distances)
            for side, sign in ((0, -1.0), (1, 1.0)):
                bodies = np.array([pair[side][0] for pair in self.owners])[columns]
                some = np.flatnonzero(bodies >= 0)  # the world does not move
                at, on, n = states[some], bodies[some], sign * normals[some]
                arms = points[some, side] - frames[at, on, :, 3]
                inside = np.einsum("kij,ki->kj", frames[at, on, :, :3], arms)
                arm = np.concatenate([inside, np.ones((len(some), 1))], axis=1)
                slopes[at, columns[some]] += np.einsum(
                    "ki,kicj,kc->kj", n, moved[at, on], arm
                )
        return slopes, None, None

    def nearest(self, q: Floats) -> Measured:
        """The nearest shapes of all pairs of owners."""
        last = next(
            (found for at, found in tuple(self._last) if np.array_equal(at, q)), None
        )
        if last is None:
            last = self._nearest(q)
            self._last.append((np.array(q), last))
        return last

    def _nearest(self, q: Floats) -> Measured:
        pairs = self.of_pairs(q)
        if not self.owners:
            return pairs
        ends = [*self.starts[1:].tolist(), len(self.pairs)]
        groups = zip(self.starts.tolist(), ends, strict=True)
        least = np.column_stack(
            [
                first + pairs.distances[:, first:end].argmin(axis=1)
                for first, end in groups
            ]
        )
        rows = np.arange(len(least))[:, None]
        return Measured(pairs.distances[rows, least], pairs.points[rows, least])

    def of_pairs(self, q: Floats) -> Measured:
        """Distances of all pairs of shapes, (N, P), m, at most the reach: only near bounding spheres are measured."""
        places = self.places(q)
        asked = np.argwhere(self.spheres.gaps(places, self.pairs) < self.reach)
        measured = self.engine.measure(
            places, np.column_stack([asked[:, 0], self.pairs[asked[:, 1]]]), self.reach
        )
        distances = np.full((len(places), len(self.pairs)), self.reach)
        distances[asked[:, 0], asked[:, 1]] = np.minimum(measured.distances, self.reach)
        points = np.zeros((*distances.shape, 2, 3))
        points[asked[:, 0], asked[:, 1]] = measured.points
        return Measured(distances, points)

    def places(self, q: Floats) -> Floats:
        """Frames of all shapes in the base frame, shape (N, shapes, 3, 4)."""
        return self.engine.places(self.kinematics.frames(q))

    # -- parts -----------------------------------------------------------------------------------------------------

    @cached_property
    def _last(self) -> deque[tuple[Floats, Measured]]:
        """Positions with what is nearest there: at the samples that a solver knows of, and at all."""
        return deque(maxlen=2)

    @cached_property
    def kinematics(self) -> Kinematics:
        """Frames of the bodies."""
        return Kinematics(self.mechanism)

    @cached_property
    def engine(self) -> Engine:
        """Measures distances."""
        return Engine(self.shapes)

    @cached_property
    def spheres(self) -> BoundingSpheres:
        """BoundingSpheres that hold the shapes."""
        return BoundingSpheres(self.shapes)

    @cached_property
    def groups(self) -> Integers:
        """For every pair of shapes, the index of its pair of owners, shape (P,)."""
        index = {pair: k for k, pair in enumerate(self.owners)}
        return np.array(
            [index[pair] for pair in _owners(self.shapes, self.pairs)], dtype=np.intp
        )

    @cached_property
    def starts(self) -> Integers:
        """The first pair of shapes of every pair of owners, shape (m,)."""
        return np.searchsorted(self.groups, np.arange(len(self.owners)))


def clearance_of(
    mechanism: Mechanism,
    shapes: Sequence[Shape],
    clearance: float,
    exclude: Sequence[tuple[str, str]] = (),
    *,
    reach: float | None = None,
) -> Clearance:
    """The constraint that bodies stay a distance apart from each other and from what is around them."""
    if not (np.isfinite(clearance) and clearance >= 0):
        raise InputError(
            f"the clearance must be a distance in m, 0 or more, got {clearance}"
        )
    farthest = clearance + REACH if reach is None else reach
    if not (np.isfinite(farthest) and farthest > clearance):
        raise InputError(
            f"the reach must be larger than the clearance of {clearance} m, got {farthest}"
        )
    balls = [
        motion.name for motion in mechanism.motions if motion.kind is MotionKind.BALL
    ]
    if balls:
        raise InputError(
            f"distances are not computed with ball joints: '{balls[0]}' rotates freely"
        )
    pairs = checked_pairs(mechanism, shapes, exclude)
    return clearance_of_pairs(mechanism, tuple(shapes), pairs, clearance, farthest)


def clearance_of_pairs(
    mechanism: Mechanism,
    shapes: tuple[Shape, ...],
    pairs: Integers,
    clearance: float,
    reach: float,
) -> Clearance:
    """The constraint for some pairs of shapes."""
    # what does not move comes last: "distance of link3 and table"
    owners = [
        two[::-1] if two[0][0] == GROUND else two
        for two in dict.fromkeys(_owners(shapes, pairs))
    ]
    names = [[owner_name(mechanism, owner) for owner in two] for two in owners]
    labels = tuple(f"distance of {first} and {second}" for first, second in names)
    low, high = np.full(len(labels), float(clearance)), np.full(len(labels), np.inf)
    return Clearance(
        labels, ("m",) * len(labels), low, high, mechanism, shapes, pairs, float(reach)
    )


def _owners(shapes: Sequence[Shape], pairs: Integers) -> list[tuple[Owner, Owner]]:
    """The owners of every pair of shapes."""
    return [(shapes[i].owner, shapes[j].owner) for i, j in pairs.tolist()]


def _normals(points: Floats, distances: Floats) -> Floats:
    """Unit vectors from the first to the second body; zero where shapes just touch and have no derivative."""
    apart = points[:, 1] - points[:, 0]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    # of overlapping shapes the points lie the other way round
    signs = np.where(distances < 0, -1.0, 1.0)[:, None]
    # points of faces that lie on each other need not be opposite: the distance then changes otherwise, or not at all
    told = (lengths > TOUCHING) & (
        np.abs(lengths - np.abs(distances)[:, None]) < MISLED
    )
    return np.where(told, signs * apart / np.maximum(lengths, TOUCHING), 0.0)
