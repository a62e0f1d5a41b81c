"""Clearances that pairs can have, from the largest distance that each pair reaches over random poses.

Many robots are nearer to themselves than any sensible clearance: two bodies behind one joint of a wrist, hulls of bent
links.  A search that does not know this looks for a pose that does not exist.  So pairs are measured first.  One that
never or hardly reaches the clearance keeps a share of its own largest distance, and two shapes of the robot that
overlap in all poses, whose hulls are larger than the links, are not checked; both are said.  An obstacle that no pose
keeps clear of is a mistake of the set-up, and so is one that holds what does not move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.excite.problem.clearance import Clearance, Engine, clearance_of_pairs
from echelon.excite.problem.shapes import (
    Shape,
    ShapeKind,
    bounding_sphere,
    box_lengths,
    placed,
)
from echelon.robot import GROUND
from echelon.shared import Flags, Floats, InputError

POSES = 512
"""Random poses: of six joints, a half that one joint decides is met with certainty, a tenth of it as well."""
KEPT_SHARE = 0.7
"""Share of the largest distance that is kept: the rest is what the pair may move by."""
MILLIMETRE = 1e-3
"""Unit of allowances, m; without half of it beyond the clearance a motion has nowhere to go."""
COMMON = 0.25
"""Share of poses with that room, below which the clearance leaves too few."""
STILL = 1e-4
"""Length, m, by which a distance that does not depend on the pose may vary: rounding, and facets of meshes."""
HELD_DEPTH = 0.02
"""Depth, m, by which an obstacle holds a point of the base: more than a plate or a rounded drawing explains."""


@dataclass(frozen=True)
class Allowances:
    """A clearance that poses can keep, and what had to be changed for it, in sentences."""

    clearance: Clearance
    lowered: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()


def allowances_of(stated: Clearance, poses: Floats) -> Allowances:
    """Clearances that are within reach, for random poses of shape (N, positions)."""
    distances = stated.of_pairs(poses).distances
    still = np.ptp(distances, axis=0) < STILL
    _check_obstacles(stated, still & (distances.max(axis=0) < stated.reach))
    touching = distances.max(axis=0) <= 0
    unchecked = [
        _touching(stated, pair, distances[:, pair])
        for pair in np.flatnonzero(touching).tolist()
    ]
    found = _without(stated, touching)
    reached = found.nearest(poses).distances
    never = (
        reached.max(axis=0) <= 0
    )  # several shapes, one of which touches in every pose
    groups = np.flatnonzero(never).tolist()
    unchecked += [
        _touching(found, int(found.starts[group]), reached[:, group])
        for group in groups
    ]
    found, reached = _without(found, never[found.groups]), reached[:, ~never]
    largest = reached.max(axis=0)
    kept = np.floor(KEPT_SHARE * largest / MILLIMETRE) * MILLIMETRE
    common = (reached >= found.low + MILLIMETRE / 2).mean(axis=0)
    lower = (common < COMMON) & (KEPT_SHARE * largest < found.low)
    low = np.where(lower, np.minimum(kept, found.low), found.low)
    lowered = []
    for k in np.flatnonzero(lower).tolist():
        when = "whatever the pose" if np.ptp(reached[:, k]) < STILL else "at most"
        lowered.append(
            f"{found.labels[k]}: {largest[k]:.4f} m {when}, so {low[k]:.3f} m is kept"
        )
    return Allowances(replace(found, low=low), tuple(lowered), tuple(unchecked))


def without_touching(stated: Clearance, pose: Floats) -> Allowances:
    """The clearance without pairs of shapes that are too near each other at a pose."""
    near = stated.of_pairs(pose[None]).distances[0] < stated.low[stated.groups]
    pairs = stated.pairs[near].tolist()
    texts = [
        f"{_names(stated, i, j)} are not checked: they are too close at the start of motions"
        for i, j in pairs
    ]
    return Allowances(_without(stated, near), unchecked=tuple(texts))


def _without(stated: Clearance, left_out: Flags) -> Clearance:
    """The clearance without some pairs of shapes."""
    if not left_out.any():
        return stated
    clearance = float(stated.low.max(initial=0.0))
    return clearance_of_pairs(
        stated.mechanism,
        stated.shapes,
        stated.pairs[~left_out],
        clearance,
        stated.reach,
    )


def _names(stated: Clearance, first: int, second: int) -> str:
    return f"'{stated.shapes[first].name}' and '{stated.shapes[second].name}'"


def _touching(stated: Clearance, pair: int, distances: Floats) -> str:
    """A sentence about shapes that overlap in all poses; obstacles may do so only where no motion changes it."""
    label = stated.labels[stated.groups[pair]]
    names = _names(stated, *stated.pairs[pair].tolist())
    largest = float(distances.max())
    shapes = [stated.shapes[k] for k in stated.pairs[pair]]
    if any(shape.obstacle for shape in shapes) and np.ptp(distances) >= STILL:
        first, second = label.removeprefix("distance of ").split(" and ", 1)
        problem = (
            f"none of {len(distances)} poses keeps the limit of {label}: {largest:.3f} m at most; "
            f"move '{second}' away, or write exclude: [[{first}, {second}]]"
        )
        raise InputError(problem, element="collisions")
    return f"{names} overlap in all poses ({largest:.4f} m at most) and are not checked"


def _check_obstacles(stated: Clearance, still: Flags) -> None:
    """Refuse obstacles that hold what does not move."""
    fixed = [
        shape for shape in stated.shapes if shape.body == GROUND and not shape.obstacle
    ]
    for number, obstacle in enumerate(stated.shapes):
        if not obstacle.obstacle:
            continue
        beside = [
            pair
            for pair in np.flatnonzero(still).tolist()
            if number in stated.pairs[pair]
        ]
        others = [
            stated.shapes[k]
            for pair in beside
            for k in stated.pairs[pair].tolist()
            if k != number
        ]
        frames = stated.places(np.zeros((1, len(stated.mechanism.positions))))[0]
        points = [
            _centre(shape, frames[stated.shapes.index(shape)])
            for shape in (*fixed, *others)
        ]
        depth = _depth(obstacle, points or [np.zeros(3)])
        if depth > HELD_DEPTH:
            raise InputError(_holds(obstacle), element="collisions")


def _centre(shape: Shape, frame: Floats) -> Floats:
    centre: Floats = frame[:, :3] @ bounding_sphere(shape)[0] + frame[:, 3]
    return centre


def _depth(obstacle: Shape, points: Sequence[Floats]) -> float:
    """The largest depth of some points inside an obstacle, m; negative outside."""
    engine = Engine(
        (obstacle, Shape("point", GROUND, ShapeKind.SPHERE, (MILLIMETRE,), np.eye(4)))
    )
    places = np.stack(
        [
            np.stack([obstacle.placement[:3], placed(np.eye(3), point)[:3]])
            for point in points
        ]
    )
    asked = np.array([(k, 0, 1) for k in range(len(points))], dtype=np.intp)
    distances = engine.measure(places, asked, 1.0).distances
    return float(-(distances.min() + MILLIMETRE))


def _holds(obstacle: Shape) -> str:
    if obstacle.kind is ShapeKind.PLANE:
        normal = ", ".join(f"{-x + 0:.3g}" for x in obstacle.placement[:3, 2])
        turned = f"write plane: [{normal}], or move it away"
        return f"the base is below '{obstacle.name}', whose normal points away from it: {turned}"
    ways = "obstacles are solid, so a crate around the robot is a floor and four walls"
    if obstacle.kind is ShapeKind.BOX:
        ways += f"; a box is stated by its full lengths, so this one measures {box_lengths(obstacle)}"
    return f"'{obstacle.name}' holds the base: {ways}"
