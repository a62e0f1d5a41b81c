"""Frames in doubles: of errors, and as exact placements."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import numpy as np

from echelon.algebra import as_polynomial
from echelon.robot import Placement, rational_rotation, rotation_quaternion, shift
from echelon.shared import Floats

DECIMALS = 12
"""Decimals of calibrated frames, m and rad: far below what any measurement shows."""


def error_frame(values: Mapping[str, float], ending: str) -> Floats:
    """A frame that is shifted and turned by the errors of some ending, shape (4, 4)."""
    frame = np.eye(4)
    frame[:3, 3] = [values.get(f"p{axis}{ending}", 0.0) for axis in "xyz"]
    turns = [values.get(f"r{axis}{ending}", 0.0) for axis in "xyz"]
    for axis, angle in enumerate(turns):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turned, (c, s) = np.eye(3), (np.cos(angle), np.sin(angle))
        turned[i, i], turned[i, j], turned[j, i], turned[j, j] = c, -s, s, c
        frame[:3, :3] = frame[:3, :3] @ turned
    return frame


def as_placement(frame: Floats, decimals: int = DECIMALS) -> Placement:
    """A frame in doubles, shape (4, 4), as an exact one."""
    x, y, z = (as_polynomial(Fraction(f"{v:.{decimals}f}")) for v in frame[:3, 3])
    quaternion = rotation_quaternion(frame[:3, :3]).tolist()
    return shift(x, y, z) @ rational_rotation(quaternion, 0.1**decimals)
