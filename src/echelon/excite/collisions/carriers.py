"""Which body carries each link of a file, and what is found in a file.

Links that are fixed to others ride on the bodies that carry them, so their shapes are placed in those bodies' frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.collisions.shapes import Shape, placed
from echelon.formats.inertia import numeric_placement
from echelon.formats.literal import LiteralPlacement, LiteralTree
from echelon.mechanism.mechanism import GROUND, Mechanism

STAND_IN = "shapes of the set-up can stand in for it"
"""What can be done about a shape that cannot be read."""


@dataclass(frozen=True)
class Geometry:
    """Shapes of a file.

    Attributes
    ----------
    shapes : tuple of Shape
    excluded : tuple of (str, str)
        Pairs of links that the file declares not to collide.
    notes : tuple of str
        What was left out, and why.
    """

    shapes: tuple[Shape, ...]
    excluded: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()


def carriers(tree: LiteralTree, mechanism: Mechanism) -> tuple[tuple[int, Floats], ...]:
    """For every link of a file, the body that carries it and the link's frame in the body's.

    Parameters
    ----------
    tree : LiteralTree
        The file.
    mechanism : Mechanism
        Read from it.

    Returns
    -------
    tuple of (int, array of shape (4, 4))
        Index of the body, −1 for the world.

    Raises
    ------
    InputError
        If a link moves that is no body of the mechanism.
    """
    bodies: Mapping[str, int] = {body.name: index for index, body in enumerate(mechanism.bodies)}
    found: list[tuple[int, Floats]] = []
    for index, link in enumerate(tree.links):
        if link.name in bodies and not (index == 0 and tree.root_is_world):
            found.append((bodies[link.name], np.eye(4)))
            continue
        body, place = found[link.parent] if link.parent >= 0 else (GROUND, np.eye(4))
        for step in link.steps:
            if not isinstance(step, LiteralPlacement):
                problem = "it moves but is no body of the mechanism; read both from the same file"
                raise InputError(problem, source=tree.source, element=f"link '{link.name}'")
            place = place @ placed(*numeric_placement(step))
        found.append((body, place))
    return tuple(found)
