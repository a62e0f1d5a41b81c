"""Numbers and poses of compiled MuJoCo models as what was meant: decimals, and angles about fixed axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import asin, atan2, floor, hypot, log10, pi

import numpy as np
import numpy.typing as npt

from echelon.algebra import Rational, parse_decimal
from echelon.formats.literal import (
    DOUBLE_DIGITS,
    LiteralMotion,
    LiteralPlacement,
    LiteralStep,
    Triple,
    roll_pitch_yaw,
    rotation_matrix,
)
from echelon.formats.snapping import (
    COMPUTED_ROUNDING,
    checked_size,
    is_tiny,
    nearest_step,
)
from echelon.robot import rotation_of
from echelon.shared import InputError

GIMBAL_LOCK = 1e-2
"""Cosine of the pitch below which roll and yaw lose two digits."""

# -- geometry ----------------------------------------------------------------------------------------------------------


def quaternion_matrix(quaternion: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rotation matrix of a quaternion w, x, y, z of any length but zero."""
    q = np.asarray(quaternion, dtype=float)
    return rotation_of(q / np.linalg.norm(q))


def placements(
    element: str, xyz: Triple, quaternion: npt.ArrayLike
) -> tuple[LiteralPlacement, ...]:
    """A pose as placements whose angles, where they are nearly multiples of 15°, are all seen to be."""
    return placements_of(element, xyz, quaternion_matrix(quaternion))


def placements_of(
    element: str, xyz: Triple, matrix: npt.NDArray[np.float64]
) -> tuple[LiteralPlacement, ...]:
    """Placements of a translation and a rotation matrix."""
    # with a pitch of nearly ±90° a rounded quaternion has arbitrary roll and yaw, and only their sum or difference
    # means anything.  Then the first placement has roll 0 and pitch ±90° exactly, and a second one, of three small
    # angles, the remainder
    if hypot(matrix[0, 0], matrix[1, 0]) >= GIMBAL_LOCK:
        return (LiteralPlacement(element, xyz, _rpy(matrix)),)
    pitch = pi / 2 if matrix[2, 0] < 0 else -pi / 2
    yaw = atan2(-matrix[0, 1], matrix[1, 1])
    locked = LiteralPlacement(element, xyz, (0, exact_angle(pitch), exact_angle(yaw)))
    remainder = _rpy(rotation_matrix(0.0, pitch, float(locked.rpy[2])).T @ matrix)
    if any(remainder):
        return locked, LiteralPlacement(f"{element} remainder", (0, 0, 0), remainder)
    return (locked,)


def _rpy(matrix: npt.NDArray[np.float64]) -> Triple:
    roll, pitch, yaw = map(exact_angle, roll_pitch_yaw(matrix))
    return roll, pitch, yaw


def displaced(
    where: str,
    kind: str,
    axis: Triple,
    displacement: Rational,
    motion: tuple[LiteralMotion, ...],
) -> Iterator[LiteralStep]:
    """A constant displacement and then a motion along or about one axis, which becomes z meanwhile."""
    # so both have exactly the same direction, however the angles of the axis are read
    x, y, z = (float(v) for v in axis)
    if hypot(x, y) < GIMBAL_LOCK:
        turns = ((1, exact_angle(atan2(x, z))), (0, exact_angle(-asin(y))))
    else:
        turns = ((2, exact_angle(atan2(y, x))), (1, exact_angle(atan2(hypot(x, y), z))))
    yield from (_turn(f"{where} axis", k, angle) for k, angle in turns)
    along: Triple = (0, 0, displacement)
    element = f"{where} ref"
    yield (
        LiteralPlacement(element, rpy=along)
        if kind == "hinge"
        else LiteralPlacement(element, along)
    )
    yield from (replace(m, axis=(0, 0, 1)) for m in motion)
    yield from (_turn(f"{where} axis", k, -angle) for k, angle in reversed(turns))


def _turn(element: str, axis: int, angle: Rational) -> LiteralPlacement:
    roll, pitch, yaw = (angle if k == axis else 0 for k in range(3))
    return LiteralPlacement(element, rpy=(roll, pitch, yaw))


# -- numbers -----------------------------------------------------------------------------------------------------------


def exact_number(value: float) -> Rational:
    """The shortest decimal that is this double, which is the number in the file unless that has over 15 digits.

    What is tiny is zero.
    """
    text = repr(float(value))
    try:
        number = parse_decimal(text)
        return 0 if is_tiny(number) else checked_size(number, text)
    except ValueError as error:
        raise InputError(str(error)) from None


def exact_angle(value: float) -> Rational:
    """An angle in rad without the noise of computing it, if it is a multiple of 15°."""
    nearest = nearest_step(value)
    return exact_number(nearest if abs(value - nearest) <= COMPUTED_ROUNDING else value)


def exact_triple(
    vector: npt.NDArray[np.float64], written: npt.NDArray[np.float64] | None = None
) -> Triple:
    """Exact numbers of a vector; one that is not as written was computed and keeps 15 digits of its largest entry."""
    largest = float(np.max(np.abs(vector)))
    if written is None or np.array_equal(vector, written) or not largest:
        x, y, z = (exact_number(v) for v in vector)
    else:
        x, y, z = (
            exact_number(round(float(v), DOUBLE_DIGITS - 1 - floor(log10(largest))))
            for v in vector
        )
    return x, y, z


def cleaned(direction: npt.NDArray[np.float64]) -> Triple:
    """A unit vector without the noise of computing it."""
    x, y, z = (exact_number(v) if abs(v) > COMPUTED_ROUNDING else 0 for v in direction)
    return x, y, z
