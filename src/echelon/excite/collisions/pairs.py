"""Which shapes can collide at all.

Neighbours touch at their joint whatever the robot does, so distances between them say nothing; the same holds for the
fixed base and the first moving body.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from echelon.arrays import Integers
from echelon.errors import InputError
from echelon.excite.collisions.entries import WORLD
from echelon.excite.collisions.shapes import Owner, Shape
from echelon.mechanism.mechanism import GROUND, Mechanism


def checked_pairs(
    mechanism: Mechanism, shapes: Sequence[Shape], exclude: Sequence[tuple[str, str]] = (), source: str | None = None
) -> Integers:
    """Pairs of shapes on bodies that are neither rigidly connected nor neighbours.

    Parameters
    ----------
    mechanism : Mechanism
    shapes : sequence of Shape
    exclude : sequence of (str, str)
        Pairs of names that are not checked: of bodies, of links of the file that the shapes came with, or of shapes
        such as obstacles; ``"world"`` for all that is fixed.
    source : str, optional
        Where the exclusions come from, for messages.

    Returns
    -------
    array of shape (P, 2)
        Indices of shapes, ordered by their owners: the world, obstacles as stated, then parents before children; pairs
        of the same owners are next to each other.  Planes come first.

    Raises
    ------
    InputError
        If an exclusion names nothing.
    """
    excluded = [_excluded(mechanism, shapes, pair, source) for pair in exclude]
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
    mechanism: Mechanism, shapes: Sequence[Shape], pair: tuple[str, str], source: str | None
) -> tuple[frozenset[int], frozenset[int]]:
    names: Sequence[object] = pair  # that of a set-up may be anything
    if len(names) != 2 or not all(isinstance(name, str) for name in names):
        raise InputError(f"an exclusion needs two names, got {pair!r}", source=source)
    first, second = (_meant(mechanism, shapes, name, source) for name in pair)
    return first, second


def _meant(mechanism: Mechanism, shapes: Sequence[Shape], name: str, source: str | None) -> frozenset[int]:
    """The shapes that a name stands for."""
    bodies = [body.name for body in mechanism.bodies]
    known = {name for shape in shapes for name in (shape.name, shape.link) if name}
    fixed = set(WORLD) - known  # an obstacle that is called ground stands for itself
    body = bodies.index(name) if name in bodies else GROUND if name == WORLD[0] or name in fixed else None
    if body is None and name not in known:
        valid = ", ".join(dict.fromkeys((*bodies, WORLD[0], *sorted(known))))
        raise InputError(f"there is no body, link or shape '{name}' to exclude (valid: {valid})", source=source)
    return frozenset(
        k
        for k, shape in enumerate(shapes)
        if name in (shape.name, shape.link) or (body is not None and body == shape.body)
    )
