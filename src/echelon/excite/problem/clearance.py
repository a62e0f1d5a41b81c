"""Clearances as constraints of the state: smallest distances between bodies, and their exact derivatives.

The distance of two convex solids changes as that of their nearest points does when these ride on the bodies: moving
along the surfaces changes nothing in first order.  So its derivative is n · (∂p₂/∂q − ∂p₁/∂q) with the unit normal n
from the first to the second, and with the derivatives of the frames it is exact.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, Integers
from echelon.dynamics.kinematics import Kinematics
from echelon.errors import InputError
from echelon.excite.problem.distances import Engine, Measured, checked_pairs, owner_name
from echelon.excite.problem.shapes import BoundingSpheres, Owner, Shape
from echelon.excite.problem.state_limits import Slopes, StateConstraint
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import GROUND, Mechanism

REACH = 0.2
"""How far beyond the clearance distances are measured, m: enough to be warned before a limit is near."""

_TOUCHING = 1e-12  # m, below which points do not tell a normal


@dataclass(frozen=True, eq=False)
class Clearance(StateConstraint):
    """Bodies stay a distance apart; made by :func:`clearance_of`."""

    mechanism: Mechanism
    shapes: tuple[Shape, ...]
    pairs: Integers  # shape (P, 2); indices of shapes that are checked, pairs of the same owners next to each other
    reach: float  # larger distances are not told apart: values stop here and slopes are zero, m
    notes: tuple[str, ...] = ()  # which pairs were left out because they touch at the reference pose

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
            points, distances = found.points[states, columns], found.distances[states, columns]
            normals = _normals(points, distances)
            for side, sign in ((0, -1.0), (1, 1.0)):
                bodies = np.array([pair[side][0] for pair in self.owners])[columns]
                some = np.flatnonzero(bodies >= 0)  # the world does not move
                at, on, n = states[some], bodies[some], sign * normals[some]
                arms = points[some, side] - frames[at, on, :, 3]
                inside = np.einsum("kij,ki->kj", frames[at, on, :, :3], arms)
                arm = np.concatenate([inside, np.ones((len(some), 1))], axis=1)
                slopes[at, columns[some]] += np.einsum("ki,kicj,kc->kj", n, moved[at, on], arm)
        return slopes, None, None

    def nearest(self, q: Floats) -> Measured:
        """The nearest shapes of all pairs of owners."""
        last = next((found for at, found in tuple(self._last) if np.array_equal(at, q)), None)
        if last is None:
            last = self._nearest(q)
            self._last.append((np.array(q), last))
        return last

    def _nearest(self, q: Floats) -> Measured:
        places = self.places(q)
        asked = np.argwhere(self.spheres.gaps(places, self.pairs) < self.reach)
        measured = self.engine.measure(places, np.column_stack([asked[:, 0], self.pairs[asked[:, 1]]]), self.reach)
        distances = np.full((len(places), len(self.pairs)), self.reach)
        distances[asked[:, 0], asked[:, 1]] = np.minimum(measured.distances, self.reach)
        points = np.zeros((*distances.shape, 2, 3))
        points[asked[:, 0], asked[:, 1]] = measured.points
        if not self.owners:
            return Measured(distances, points)
        ends = [*self.starts[1:].tolist(), len(self.pairs)]
        least = np.column_stack(
            [a + distances[:, a:b].argmin(axis=1) for a, b in zip(self.starts.tolist(), ends, strict=True)]
        )
        rows = np.arange(len(places))[:, None]
        return Measured(distances[rows, least], points[rows, least])

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
        return np.array([index[pair] for pair in _owners(self.shapes, self.pairs)], dtype=np.intp)

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
    reference: npt.ArrayLike | None = None,
    ignore_touching: bool = False,
) -> Clearance:
    """The constraint that bodies stay a distance apart from each other and from what is around them."""
    if not (np.isfinite(clearance) and clearance >= 0):
        raise InputError(f"the clearance must be a distance in m, 0 or more, got {clearance}")
    farthest = clearance + REACH if reach is None else reach
    if not (np.isfinite(farthest) and farthest > clearance):
        raise InputError(f"the reach must be larger than the clearance of {clearance} m, got {farthest}")
    balls = [motion.name for motion in mechanism.motions if motion.kind is MotionKind.BALL]
    if balls:
        raise InputError(f"clearances are for joints with single coordinates; '{balls[0]}' rotates freely")
    found = _clearance(mechanism, tuple(shapes), checked_pairs(mechanism, shapes, exclude), clearance, farthest)
    return _without_touching(found, clearance, reference) if ignore_touching else found


def _clearance(
    mechanism: Mechanism,
    shapes: tuple[Shape, ...],
    pairs: Integers,
    clearance: float,
    reach: float,
    notes: tuple[str, ...] = (),
) -> Clearance:
    # what does not move comes last: "distance of link3 and table"
    owners = [two[::-1] if two[0][0] == GROUND else two for two in dict.fromkeys(_owners(shapes, pairs))]
    names = [[owner_name(mechanism, owner) for owner in two] for two in owners]
    labels = tuple(f"distance of {first} and {second}" for first, second in names)
    low, high = np.full(len(labels), float(clearance)), np.full(len(labels), np.inf)
    return Clearance(labels, ("m",) * len(labels), low, high, mechanism, shapes, pairs, float(reach), notes)


def _owners(shapes: Sequence[Shape], pairs: Integers) -> list[tuple[Owner, Owner]]:
    """The owners of every pair of shapes."""
    return [(shapes[i].owner, shapes[j].owner) for i, j in pairs.tolist()]


def _without_touching(found: Clearance, clearance: float, reference: npt.ArrayLike | None) -> Clearance:
    count = len(found.mechanism.positions)
    pose = np.zeros(count) if reference is None else np.asarray(reference, dtype=float)
    if pose.shape != (count,):
        raise InputError(f"the reference pose needs {count} positions, got shape {pose.shape}")
    places, pairs = found.places(pose[None]), found.pairs
    asked = np.column_stack([np.zeros(len(pairs), dtype=np.intp), pairs])
    near = found.engine.measure(places, asked, found.reach).distances < clearance
    names = [(found.shapes[i].name, found.shapes[j].name) for i, j in pairs[near].tolist()]
    notes = tuple(f"'{a}' and '{b}' are not checked: they are too near at the reference pose" for a, b in names)
    return _clearance(found.mechanism, found.shapes, pairs[~near], clearance, found.reach, notes)


def _normals(points: Floats, distances: Floats) -> Floats:
    """Unit vectors from the first to the second body; zero where shapes just touch and have no derivative."""
    apart = points[:, 1] - points[:, 0]
    lengths = np.linalg.norm(apart, axis=1, keepdims=True)
    # of overlapping shapes the points lie the other way round
    signs = np.where(distances < 0, -1.0, 1.0)[:, None]
    return np.where(lengths > _TOUCHING, signs * apart / np.maximum(lengths, _TOUCHING), 0.0)
