"""Inertial values of files, in floats: from the centre of mass to the link's frame, and from link to link."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.formats.literal import LiteralPlacement

Inertial = Floats
"""The ten standard parameters XX XY XZ YY YZ ZZ MX MY MZ M."""

_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Floats:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def numeric_placement(placement: LiteralPlacement) -> tuple[Floats, Floats]:
    """Rotation and translation of a literal placement in floats."""
    roll, pitch, yaw = (float(v) for v in placement.rpy)
    rotation, translation = rotation_matrix(roll, pitch, yaw), np.array([float(v) for v in placement.xyz])
    return (rotation.T, -rotation.T @ translation) if placement.inverse else (rotation, translation)


def numeric_placements(placements: Iterable[LiteralPlacement]) -> tuple[Floats, Floats]:
    """Rotation and translation of several placements, one after the other."""
    rotation, translation = np.eye(3), np.zeros(3)
    for placement in placements:
        turned, shifted = numeric_placement(placement)
        translation, rotation = translation + rotation @ shifted, rotation @ turned
    return rotation, translation


def central_inertial(mass: float, centre: npt.ArrayLike, tensor: npt.ArrayLike, rotation: npt.ArrayLike) -> Inertial:
    """Standard parameters from mass, centre of mass, and inertia about it in rotated axes."""
    # centre in the link's frame, m; tensor about it, kg·m², along axes that are the columns of the rotation there
    turned = np.asarray(rotation) @ np.asarray(tensor) @ np.asarray(rotation).T
    c = np.asarray(centre, dtype=float)
    about_origin = turned + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return _pack(about_origin, mass * c, mass)


def move_inertial(inertial: Inertial, rotation: npt.ArrayLike, translation: npt.ArrayLike) -> Inertial:
    """The same body's parameters about a reference frame in which its own frame is placed."""
    r, p = np.asarray(rotation, dtype=float), np.asarray(translation, dtype=float)
    tensor, moment, mass = _unpack(inertial)
    h = r @ moment
    turned = r @ tensor @ r.T
    # parallel axes for a frame shift p: I + terms in h and m, symmetric in both factors
    shifted = turned + 2 * (p @ h) * np.eye(3) - np.outer(p, h) - np.outer(h, p)
    shifted = shifted + mass * (p @ p * np.eye(3) - np.outer(p, p))
    return _pack(shifted, h + mass * p, mass)


def _pack(tensor: Floats, moment: Floats, mass: float) -> Inertial:
    return np.array([*(tensor[i, j] for i, j in _UPPER), *moment, mass])


def _unpack(inertial: Inertial) -> tuple[Any, Any, float]:
    tensor = np.zeros((3, 3))
    for value, (i, j) in zip(inertial, _UPPER, strict=False):
        tensor[i, j] = tensor[j, i] = value
    return tensor, inertial[6:9], float(inertial[9])
