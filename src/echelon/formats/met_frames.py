"""The second frame of a closure where only the first one is stated: where the two meet at some pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from operator import matmul

import numpy as np

from echelon.algebra import as_polynomial, is_trigonometric, symbol_of
from echelon.formats.literal import DOUBLE_ROUNDING
from echelon.robot import (
    IDENTITY,
    Body,
    ClosureKind,
    Motion,
    Placement,
    Symbol,
    parted,
    placement_matrix,
    rational_rotation,
    rotation_quaternion,
    shift,
)

MOST_ANGLES = 18
"""A product of rotations by more angles has thousands of terms: it is rounded to doubles."""


def second_frame(
    kind: ClosureKind,
    first: int,
    second: int,
    frame: Placement,
    parent: Callable[[int], int],
    place: Callable[[int], Placement],
    symbols: Mapping[str, Symbol],
) -> Placement:
    """A frame of the first member of a tree in the frame of the second one.

    ``place`` says where a member is in its parent's frame at the pose in question.  Where the kind of closure fixes no
    directions, the axes are those of the second member.  Between many angles it is rounded to doubles.
    """
    inward, outward = parted(first, second, parent)
    places = {member: place(member) for member in (*inward, *outward)}
    chain = [
        *(places[m].inverse() for m in outward),
        *(places[m] for m in reversed(inward)),
        frame,
    ]
    angles = _angles(chain)
    frame = (
        reduce(matmul, chain)
        if len(angles) <= MOST_ANGLES
        else _rounded(chain, angles, symbols)
    )
    return frame if kind.directions else Placement(IDENTITY, frame.translation)


def _angles(placements: list[Placement]) -> list[str]:
    generators = {
        g
        for placement in placements
        for entry in placement.entries()
        for g in entry.generators()
    }
    return sorted(
        {
            symbol_of(generator)
            for generator in generators
            if is_trigonometric(generator)
        }
    )


def _rounded(
    chain: Sequence[Placement], angles: Sequence[str], symbols: Mapping[str, Symbol]
) -> Placement:
    """The product of placements in doubles, as a rational rotation and decimals."""
    known = {
        name: symbol.value
        for name, symbol in symbols.items()
        if symbol.value is not None
    }
    if not known.keys() >= {s for placement in chain for s in placement.symbols()}:
        shown = ", ".join(angles[:3])
        raise ValueError(
            f"between the two bodies lie {len(angles)} angles other than multiples of 15° ({shown}, …), too many to "
            "derive the second frame from the first: state both, or values of all symbols"
        )
    pose = reduce(
        np.matmul, (placement_matrix(placement, known) for placement in chain)
    )
    x, y, z = (as_polynomial(Fraction(f"{value:.15f}")) for value in pose[:3, 3])
    return shift(x, y, z) @ rational_rotation(
        rotation_quaternion(pose[:3, :3]).tolist(), DOUBLE_ROUNDING
    )


def at_zero(body: Body) -> Placement:
    """A body's frame in that of its parent while its coordinates are zero."""
    return reduce(
        matmul,
        (step for step in body.joint.steps if not isinstance(step, Motion)),
        Placement(),
    )
