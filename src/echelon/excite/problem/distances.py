"""Signed distances of shapes by MuJoCo, and which pairs of shapes are checked.

MuJoCo's distance function looks at the geoms' frames only, so no step of its dynamics is taken.  Two habits of it are
worked around.  Its function for a capsule and a box calls some deep overlaps positive distances (up to version 4.0 at
least), so boxes are handed over as hulls of their corners.  And its tolerance is meant for contacts; ours is tighter,
since derivatives are taken from the nearest points.

Neighbouring bodies touch at their joint whatever the robot does, so distances between them say nothing; the same holds
for the fixed base and the first moving body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.errors import EchelonError, InputError
from echelon.excite.problem.shapes import Kind, Owner, Shape
from echelon.excite.problem.stated_shapes import WORLD
from echelon.formats.mjcf.mjcf_model import import_mujoco
from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix
from echelon.mechanism.mechanism import GROUND, Mechanism

_OLDEST = (3, 12)
"""Versions of MuJoCo before this one have wrong distances, by up to decimetres, for some convex shapes far apart."""

_TOLERANCE = 1e-10  # m
_ITERATIONS = 200


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
        bodies = np.concatenate([frames, world], axis=1)[:, [shape.body for shape in self.shapes]]
        return _behind(bodies, np.array([shape.placement for shape in self.shapes]).reshape(-1, 4, 4))

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
                data.geom_xpos[:], data.geom_xmat[:], now = origins[state], rotations[state], state
            distances[k] = distance(model, data, first, second, reach, points[k])
        return Measured(distances, points.reshape(-1, 2, 3))

    @cached_property
    def _offsets(self) -> Floats:
        """Geoms in their shapes' frames: MuJoCo centres meshes and turns them to their principal axes."""
        found = np.tile(np.eye(4), (len(self.shapes), 1, 1))
        for k in range(len(self.shapes)):
            found[k, :3, :3] = quaternion_matrix(self._model.geom_quat[k])
            found[k, :3, 3] = self._model.geom_pos[k]
        return found

    def _compiled(self) -> Any:
        mujoco = self._mujoco
        spec = mujoco.MjSpec()
        spec.option.ccd_tolerance, spec.option.ccd_iterations = _TOLERANCE, _ITERATIONS
        for k, shape in enumerate(self.shapes):
            vertices = _corners(shape) if shape.kind is Kind.BOX else shape.vertices
            if vertices is None:
                size = (*shape.size, 0.0, 0.0, 0.0)[:3] if shape.kind is not Kind.PLANE else (0.0, 0.0, 1.0)
                spec.worldbody.add_geom(type=getattr(mujoco.mjtGeom, f"mjGEOM_{shape.kind.upper()}"), size=size)
            else:
                mesh = spec.add_mesh(name=f"mesh{k}", uservert=vertices.ravel())
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a thin mesh has hardly a volume
                spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"mesh{k}")
        try:
            return spec.compile()
        except (ValueError, mujoco.FatalError) as error:
            names = ", ".join(f"'{shape.name}'" for shape in self.shapes if shape.kind is Kind.MESH)
            raise InputError(f"MuJoCo refuses one of the meshes {names}: {error}") from None


def _recent_mujoco() -> Any:
    mujoco = import_mujoco()
    version = str(mujoco.__version__)
    if tuple(int(part) for part in version.split(".")[:2]) < _OLDEST:
        oldest = ".".join(map(str, _OLDEST))
        raise EchelonError(f"MuJoCo {version} gives wrong distances; clearances need version {oldest} or later")
    return mujoco


def _corners(shape: Shape) -> Floats:
    return np.array(list(product((-1.0, 1.0), repeat=3))) * shape.size


def _behind(frames: Floats, placements: Floats) -> Floats:
    """Frames of shape (N, K, 3, 4), each moved on by a placement of shape (K, 4, 4)."""
    moved: Floats = np.einsum("nkij,kjl->nkil", frames[..., :3], placements[:, :3])
    moved[..., 3] += frames[..., 3]
    return moved


def checked_pairs(mechanism: Mechanism, shapes: Sequence[Shape], exclude: Sequence[tuple[str, str]] = ()) -> Integers:
    """Pairs of shapes, shape (P, 2), on bodies that are neither rigidly connected nor neighbours.

    Planes come first, and pairs of the same owners are next to each other.  Exclusions name bodies, links or shapes.
    """
    excluded = [_excluded(mechanism, shapes, pair) for pair in exclude]
    found = []
    for pair in combinations(range(len(shapes)), 2):
        # planes belong to the world, whose index is the least
        first, second = sorted(pair, key=lambda k: (shapes[k].body, k))
        if not _neighbours(mechanism, shapes[first], shapes[second]) and not any(
            (first in a and second in b) or (first in b and second in a) for a, b in excluded
        ):
            found.append((first, second))
    order = {owner: k for k, owner in enumerate(dict.fromkeys(shape.owner for shape in shapes))}
    found.sort(key=lambda pair: [(shapes[k].body, order[shapes[k].owner]) for k in pair])
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
    above = [GROUND if e == GROUND else moving_body(mechanism, mechanism.bodies[e].parent) for e in ends]
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
    body = bodies.index(name) if name in bodies else GROUND if name == WORLD[0] or name in fixed else None
    if body is None and name not in known:
        valid = ", ".join(dict.fromkeys((*bodies, WORLD[0], *sorted(known))))
        raise InputError(f"there is no body, link or shape '{name}' to exclude (valid: {valid})")
    return frozenset(
        k
        for k, shape in enumerate(shapes)
        if name in (shape.name, shape.link) or (body is not None and body == shape.body)
    )
