"""Signed distances of shapes by MuJoCo, whose geoms are put where our own kinematics says.

MuJoCo's distance function looks at the geoms' frames only, so no step of its dynamics is taken.  Two habits of it are
worked around.  Its function for a capsule and a box calls some deep overlaps positive distances (up to version 4.0 at
least), so boxes are handed over as hulls of their corners.  And its tolerance is meant for contacts; ours is tighter,
since derivatives are taken from the nearest points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.errors import EchelonError, InputError
from echelon.excite.collisions.shapes import Kind, Shape
from echelon.formats.mjcf_numbers import quaternion_matrix
from echelon.formats.mjcf_spec import import_mujoco

_OLDEST = (3, 12)
"""Versions of MuJoCo before this one have wrong distances, by up to decimetres, for some convex shapes far apart."""

_TOLERANCE = 1e-10  # m
_ITERATIONS = 200


@dataclass(frozen=True)
class Measured:
    """Distances of pairs of shapes.

    Attributes
    ----------
    distances : array of shape (K,)
        m, negative where shapes overlap, at most the reach that was asked for.
    points : array of shape (K, 2, 3)
        Nearest, or deepest, points on the first and on the second shape in the base frame, m; zero beyond the reach.
    """

    distances: Floats
    points: Floats


class Engine:
    """Measures distances between some shapes.

    Parameters
    ----------
    shapes : tuple of Shape

    Raises
    ------
    MissingExtraError
        If MuJoCo is not installed.
    EchelonError
        If it is too old.
    InputError
        If it does not accept a shape.
    """

    def __init__(self, shapes: tuple[Shape, ...]) -> None:
        self.shapes = shapes
        self._mujoco = _recent_mujoco()
        self._model = self._compiled()

    def places(self, frames: Floats) -> Floats:
        """Frames of all shapes in the base frame.

        Parameters
        ----------
        frames : array of shape (N, bodies, 3, 4)
            Of the bodies.

        Returns
        -------
        array of shape (N, shapes, 3, 4)
        """
        world = np.broadcast_to(np.eye(3, 4), (len(frames), 1, 3, 4))
        # the world is body −1, the last one
        carriers = np.concatenate([frames, world], axis=1)[:, [shape.body for shape in self.shapes]]
        return _behind(carriers, np.array([shape.placement for shape in self.shapes]).reshape(-1, 4, 4))

    def measure(self, places: Floats, asked: Integers, reach: float) -> Measured:
        """Signed distances.

        Parameters
        ----------
        places : array of shape (N, shapes, 3, 4)
            From :meth:`places`.
        asked : array of shape (K, 3)
            State, first and second shape; equal states one after another.
        reach : float
            Distances beyond it are not told from it, m.
        """
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
