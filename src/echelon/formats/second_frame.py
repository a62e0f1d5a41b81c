"""The second frame of a closure, exactly where the first one is at a known pose of the tree."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from echelon.exact.polynomial import is_trigonometric, symbol_of
from echelon.mechanism.closure import ClosureKind
from echelon.mechanism.mechanism import GROUND
from echelon.mechanism.placement import IDENTITY, Placement

_MOST_ANGLES = 18  # a product of six rotations by three angles each has thousands of terms


def second_frame(
    kind: ClosureKind,
    first: int,
    second: int,
    frame: Placement,
    parent: Callable[[int], int],
    place: Callable[[int], Placement],
) -> Placement:
    """A frame of the first member of a tree in the frame of the second one.

    ``place`` says where a member is in its parent's frame at the pose in question.  Where the kind of closure fixes no
    directions, the axes are those of the second member.
    """
    inward, outward = list(_carriers(first, parent)), list(_carriers(second, parent))
    while inward and outward and inward[-1] == outward[-1]:
        inward.pop()
        outward.pop()
    places = {member: place(member) for member in (*inward, *outward)}
    _check_angles([frame, *places.values()])
    for member in inward:
        frame = places[member] @ frame
    for member in reversed(outward):
        frame = places[member].inverse() @ frame
    return frame if kind.directions else Placement(IDENTITY, frame.translation)


def _carriers(member: int, parent: Callable[[int], int]) -> Iterator[int]:
    """A member and those that carry it, outward."""
    while member != GROUND:
        yield member
        member = parent(member)


def _check_angles(placements: list[Placement]) -> None:
    generators = {g for placement in placements for entry in placement.entries() for g in entry.generators()}
    angles = sorted({symbol_of(generator) for generator in generators if is_trigonometric(generator)})
    if len(angles) > _MOST_ANGLES:
        shown = ", ".join(angles[:3])
        raise ValueError(
            f"between the two bodies lie {len(angles)} angles that are no multiples of 15° ({shown}, …), too many to "
            "derive the second frame from the first: state both"
        )
