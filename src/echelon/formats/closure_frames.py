"""Frames of closures: where the second one is if only the first is stated, or the loop stays open; parallelograms.

With opposite sides exactly equal a parallelogram moves in a special way, and fewer parameters show.  Rounded numbers
destroy that, as they destroy right angles.  So the point at which such a loop is closed is moved to where the sides are
equal, and the move is recorded like every number that is read as another one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from math import hypot
from operator import matmul

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import Polynomial, as_polynomial, is_trigonometric, symbol_of
from echelon.formats.literal import rotation_matrix
from echelon.formats.snapping import PRECISION, Snapping
from echelon.inertia import rotation_quaternion
from echelon.mechanism.closed_pose import met_frame, parted, rational_rotation, shown_loops
from echelon.mechanism.closure import Closure, ClosureKind
from echelon.mechanism.joint import IDENTITY, Body, Motion, MotionKind, Placement, Symbol, Vector, shift
from echelon.mechanism.mechanism import Mechanism, Snap
from echelon.mechanism.stated import known_values, placement_matrix

_ROUNDING = 1e-15
_MOST_ANGLES = 18  # a product of six rotations by three angles each has thousands of terms


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
    chain = [*(places[m].inverse() for m in outward), *(places[m] for m in reversed(inward)), frame]
    angles = _angles(chain)
    frame = reduce(matmul, chain) if len(angles) <= _MOST_ANGLES else _rounded(chain, angles, symbols)
    return frame if kind.directions else Placement(IDENTITY, frame.translation)


def _angles(placements: list[Placement]) -> list[str]:
    generators = {g for placement in placements for entry in placement.entries() for g in entry.generators()}
    return sorted({symbol_of(generator) for generator in generators if is_trigonometric(generator)})


def _rounded(chain: Sequence[Placement], angles: Sequence[str], symbols: Mapping[str, Symbol]) -> Placement:
    """The product of placements in doubles, as a rational rotation and decimals."""
    known = {name: symbol.value for name, symbol in symbols.items() if symbol.value is not None}
    if not known.keys() >= {s for placement in chain for s in placement.symbols()}:
        shown = ", ".join(angles[:3])
        raise ValueError(
            f"between the two bodies lie {len(angles)} angles that are no multiples of 15° ({shown}, …), too many to "
            "derive the second frame from the first: state both, or values of all symbols"
        )
    pose = reduce(np.matmul, (placement_matrix(placement, known) for placement in chain))
    return rational_frame(pose)


def rational_frame(pose: Floats) -> Placement:
    """The frame next to a pose with rational numbers, to fifteen digits."""
    x, y, z = (as_polynomial(Fraction(f"{value:.15f}")) for value in pose[:3, 3])
    return shift(x, y, z) @ rational_rotation(rotation_quaternion(pose[:3, :3]).tolist(), _ROUNDING)


_NEARLY = 1e-2  # what may be open where frames are moved, rad or characteristic lengths
_STILL, _FINE = 1e-9, 12  # turns that do not matter, rad; decimals of moves
_STEPS = 4  # of Newton's iteration for a turn


def closed(
    mechanism: Mechanism, snapping: Snapping, wanted: Sequence[str] | None = None, *, prefer: Sequence[str] = ()
) -> Mechanism:
    """:func:`echelon.regressor.loops.closing.close`, with second frames moved by what redundant constraints miss."""
    from echelon.regressor.loops.assembly import OpenLoopsError  # robots without loops load without it
    from echelon.regressor.loops.closing import close

    try:
        return close(mechanism, wanted, prefer=prefer)
    except OpenLoopsError as error:
        if error.size > _NEARLY:
            raise
        return close(_with_frames_that_meet(mechanism, error.pose, snapping), wanted, prefer=prefer)


def _with_frames_that_meet(mechanism: Mechanism, pose: Floats, snapping: Snapping) -> Mechanism:
    """The second frames are moved to where closures hold at a pose, by as little as it takes."""
    known, closures, far = known_values(mechanism), list[Closure](), [0.0, 0.0]
    for closure in mechanism.closures:
        by = _missing(closure, met_frame(mechanism, closure, pose), placement_matrix(closure.second_frame, known))
        closures.append(replace(closure, second_frame=closure.second_frame @ by))
        matrix = placement_matrix(by, {})
        turn = 2 * np.linalg.norm(rotation_quaternion(matrix[:3, :3])[1:])
        far = [max(far[0], float(np.linalg.norm(matrix[:3, 3]))), max(far[1], float(turn))]
    opening = f"open by {far[0]:.1g} m and {far[1]:.1g} rad"
    snapping.snaps.append(Snap(f"frames of {shown_loops(mechanism)}", opening, "closed", max(far)))
    return replace(mechanism, closures=tuple(closures))


def _missing(closure: Closure, met: Floats, stated: Floats) -> Placement:
    """What moves a second frame, least, so that the closure holds with the first frame where it is met."""
    apart = np.linalg.inv(met) @ stated
    held, start = list(closure.kind.positions), apart.copy()
    apart[held, 3] = 0
    for _ in range(_STEPS):
        opening = [apart[i, j] - target for i, j, target in closure.kind.directions]
        # the rate of an entry R_ij, while R turns about its own axes: (row i of R) × e_j
        rates = [np.cross(np.eye(3)[j], apart[i, :3]) for i, j, _ in closure.kind.directions]
        turn = np.linalg.lstsq(np.reshape(rates, (-1, 3)), -np.array(opening), rcond=_NEARLY)[0]
        apart[:3, :3] = apart[:3, :3] @ rotation_matrix(*turn)
    by = np.linalg.inv(start) @ apart
    x, y, z = (as_polynomial(round(Fraction(value), _FINE)) for value in by[:3, 3])
    quaternion = rotation_quaternion(by[:3, :3])
    turns = bool(np.abs(quaternion[1:]).max() > _STILL)
    return shift(x, y, z) @ (rational_rotation(quaternion.tolist(), 10.0**-_FINE) if turns else Placement())


_FEW_ANGLES = 6
_PINS = (ClosureKind.SPHERICAL, ClosureKind.REVOLUTE)
_PARALLEL = 1e-9


def with_parallelogram(closure: Closure, element: str, bodies: Sequence[Body], snapping: Snapping) -> Closure:
    """A closure moved to where it completes a parallelogram, if it nearly does."""
    # only where the loop is closed while all coordinates are zero is it known beforehand where that is.  In general
    # frames all relations of the loops are looked at together later (echelon.formats.loop_axes)
    chains = parted(closure.first, closure.second, lambda k: bodies[k].parent)
    steps = [step for chain in chains for k in chain for step in bodies[k].joint.steps if isinstance(step, Placement)]
    if len(_angles([*steps, *closure.placements])) > _FEW_ANGLES:
        return closure
    pivots = [[_Pivot.of(bodies, chain[k:]) for k in range(len(chain))] for chain in chains]
    inner, outer = sorted(([p for p in side if p is not None] for side in pivots), key=len, reverse=True)
    if closure.kind not in _PINS or [*map(len, chains)].count(0) or (len(inner), len(outer)) != (2, 1):
        return closure
    tip, base, other = *inner, *outer
    if sum(map(len, chains)) != len((tip, base, other)) or not all(tip.parallel(p, snapping) for p in (base, other)):
        return closure
    carriers = [reduce(matmul, (at_zero(bodies[k]) for k in reversed(chain)), Placement()) for chain in chains]
    frames = (closure.first_frame, closure.second_frame)
    corner, met = ((carrier @ frame).translation for carrier, frame in zip(carriers, frames, strict=True))
    if any(_across(tip, [c - m for c, m in zip(corner, met, strict=True)])):
        return closure
    missing = _across(tip, [b + d - a - c for a, b, c, d in zip(base.at, tip.at, corner, other.at, strict=True)])
    size, sides = _length(missing, snapping), [[b - a for a, b in zip(base.at, tip.at, strict=True)]]
    sides.append([d - a for a, d in zip(base.at, other.at, strict=True)])
    shortest = min(_length(_across(tip, side), snapping) for side in sides)
    tolerance = PRECISION if element in snapping.literal else snapping.options.snap_tolerance
    if not any(missing) or size > tolerance * shortest:
        return closure
    snapping.snaps.append(Snap(element, f"sides that differ by {size:.3g} m", "a parallelogram", size))
    x, y, z = missing
    one, two = (c.inverse() @ shift(x, y, z) @ c @ frame for c, frame in zip(carriers, frames, strict=True))
    return replace(closure, first_frame=one, second_frame=two)


@dataclass(frozen=True)
class _Pivot:
    """A revolute joint where all coordinates are zero: a point on its axis, and the frame in which it turns."""

    at: Vector
    frame: Placement
    axis: int

    @classmethod
    def of(cls, bodies: Sequence[Body], chain: Sequence[int]) -> _Pivot | None:
        """The only joint of the first body of a chain, seen from what carries the last one."""
        motions = bodies[chain[0]].joint.motions
        if len(motions) != 1 or motions[0].kind is not MotionKind.ROTATION:
            return None
        steps = bodies[chain[0]].joint.steps
        before = [step for step in steps[: steps.index(motions[0])] if isinstance(step, Placement)]
        carrier = reduce(matmul, (at_zero(bodies[k]) for k in reversed(chain[1:])), Placement())
        frame = reduce(matmul, before, carrier)
        return cls(frame.translation, frame, motions[0].axis)

    def parallel(self, other: _Pivot, snapping: Snapping) -> bool:
        """Whether two axes are parallel."""
        along, seen = self._direction(snapping), other._direction(snapping)
        cross = [along[i] * seen[j] - along[j] * seen[i] for i, j in ((1, 2), (2, 0), (0, 1))]
        return hypot(*cross) < _PARALLEL

    def _direction(self, snapping: Snapping) -> list[float]:
        return [snapping.numeric(row[self.axis]) for row in self.frame.rotation]


def at_zero(body: Body) -> Placement:
    """A body's frame in that of its parent while its coordinates are zero."""
    return reduce(matmul, (step for step in body.joint.steps if not isinstance(step, Motion)), Placement())


def _across(pivot: _Pivot, vector: Sequence[Polynomial]) -> list[Polynomial]:
    """The part of a vector that is perpendicular to an axis."""
    direction = [row[pivot.axis] for row in pivot.frame.rotation]
    along = Polynomial.sum(n * v for n, v in zip(direction, vector, strict=True))
    return [v - along * n for n, v in zip(direction, vector, strict=True)]


def _length(vector: Sequence[Polynomial], snapping: Snapping) -> float:
    return hypot(*(snapping.numeric(entry) for entry in vector))
