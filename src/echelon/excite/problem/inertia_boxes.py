"""Boxes of uniform density with the stated inertias, for links without shapes, and why some cannot be their links.

Many robot files state inertias that nobody computed.  Two things tell, beside the lengths that the file states:

- A box is longer than its link.  Mass at both ends of a link of length l gives the box the length √3 l, and a casing is
  thicker than its joints are apart where these are close, so twice l and a fifth of the robot's reach are allowed: in
  the files of nine arms and legs right boxes stay within 90 % of that.
- A box is lighter than any link.  Right ones have 100 kg/m³ and more, foam has 30.

A box that is too small is worse, since distances to it are too large: it may not cover half of what is between joints.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from echelon.dynamics import Kinematics
from echelon.excite.problem.shapes import Shape, ShapeKind, box_lengths, placed
from echelon.robot import GROUND, Mechanism, pseudo_inertia
from echelon.shared import Floats

THINNEST = 5e-3
"""Least half length, m, of a box that stands for an inertia: mass points have none."""
LONGEST = 2.0
"""Ratio of a box's length to its link's, beyond which mass at both ends of the link explains too little."""
CASING = 0.2
"""Share of the robot's reach by which casings make a link longer."""
LIGHTEST = 50.0
"""Density, kg/m³, below which a box is no link: between foam and the lightest links."""
LEAST_COVER = 0.5
"""Share of the distance between a link's joints that its box has to be long."""


@dataclass(frozen=True)
class InertiaBox:
    """A box that stands for a body."""

    shape: Shape
    doubt: str  # why it can hardly be the link, in words, or nothing

    def __str__(self) -> str:
        name = self.shape.name.removesuffix(SUFFIX)
        return f"'{name}' {box_lengths(self.shape)}"


SUFFIX = ":inertia"  # of the names of boxes


def inertia_boxes(
    mechanism: Mechanism, shaped: Collection[int]
) -> tuple[InertiaBox, ...]:
    """Boxes of the stated inertias, for bodies that are not among those with shapes."""
    origins = _origins(mechanism)
    reach = _reach(mechanism, origins)
    found = []
    for index, body in enumerate(mechanism.bodies):
        if index in shaped or body.inertial is None:
            continue
        J = pseudo_inertia(np.array(body.inertial, dtype=float))
        mass = float(J[3, 3])
        if mass <= 0:
            continue
        centre = J[:3, 3] / mass
        variances, axes = np.linalg.eigh(J[:3, :3] / mass - np.outer(centre, centre))
        # a uniform box of half length a has the variance a²/3
        half = np.maximum(np.sqrt(3 * np.maximum(variances, 0.0)), THINNEST)
        axes[:, 0] *= np.linalg.det(axes)
        size, place = tuple(half.tolist()), placed(axes, centre)
        shape = Shape(f"{body.name}{SUFFIX}", index, ShapeKind.BOX, size, place)
        between = _between_joints(mechanism, index, origins)
        length = max(between, 2 * float(np.linalg.norm(centre)))
        density = mass / float(np.prod(2 * half))
        found.append(
            InertiaBox(
                shape, _doubt(2 * float(half.max()), length, between, reach, density)
            )
        )
    return tuple(found)


def _doubt(
    longest: float, length: float, between: float, reach: float, density: float
) -> str:
    """Why a box can hardly be its link, from lengths in m and a density in kg/m³; nothing if it can."""
    if longest > LONGEST * length + CASING * reach:
        return f"is too long for joints and a centre of mass within {length:.2g} m"
    if density < LIGHTEST:
        return f"would weigh {density:.2g} kg/m³"
    if longest < LEAST_COVER * between:
        return f"does not cover half of the {between:.2f} m between the link's joints"
    return ""


def _origins(mechanism: Mechanism) -> Floats:
    """Origins of all bodies at zero, shape (bodies, 3), m."""
    zero = np.zeros((1, len(mechanism.positions)))
    found: Floats = Kinematics(mechanism).frames(zero)[0, :, :, 3]
    return found


def _between_joints(mechanism: Mechanism, body: int, origins: Floats) -> float:
    """The largest distance from a body's joint to those that it carries, m; 0 for a last body."""
    carried = [k for k, other in enumerate(mechanism.bodies) if other.parent == body]
    away = np.linalg.norm(origins[carried] - origins[body], axis=1)
    return float(away.max(initial=0.0))


def _reach(mechanism: Mechanism, origins: Floats) -> float:
    """Length of the longest chain of joints, m."""
    lengths: list[float] = []
    for body, origin in zip(mechanism.bodies, origins, strict=True):
        fixed = body.parent == GROUND
        before = 0.0 if fixed else lengths[body.parent]
        step = origin - (0.0 if fixed else origins[body.parent])
        lengths.append(before + float(np.linalg.norm(step)))
    return max(lengths, default=0.0)
