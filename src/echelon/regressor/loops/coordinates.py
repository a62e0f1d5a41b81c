"""The coordinates that all others depend on, chosen as engineers would.

Coordinates can be independent together if no velocities that keep the loops closed tie them: if their columns of a
basis of these velocities are.  So they are taken one joint after the other, as long as that stays so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from echelon.exact.elimination import null_vectors, rank
from echelon.exact.field import PrimeField, Residues
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import GROUND, Mechanism

Floats = npt.NDArray[np.float64]

_DIGITS = 6  # of velocities that are compared; where they are alike, x comes first


def independent_coordinates(
    mechanism: Mechanism,
    jacobian: Residues,
    field: PrimeField,
    first: Sequence[str] = (),
    real: Floats | None = None,
) -> tuple[str, ...]:
    """Velocity coordinates that determine all others, in the order of the mechanism.

    Those that should be come first, then joints that float, whole joints near the base, other motions near the base,
    and whole balls; parts of a ball only if nothing else is left, such as the spin of a rod between two balls, and then
    those along which the ball can really turn most.

    Parameters
    ----------
    mechanism : Mechanism
    jacobian : array of shape (equations, velocities)
        Of the closures, at one pose.
    field : PrimeField
    first : sequence of str
        Coordinates that should be independent, the most wanted first.
    real : array of shape (velocities, freedoms), optional
        Orthonormal velocities that keep the loops closed at the assembly pose.
    """
    place = {name: k for k, name in enumerate(mechanism.velocities)}
    freedom = np.array(null_vectors(jacobian, field), dtype=np.int64).reshape(-1, len(place))
    taken: list[int] = []

    def take(group: Sequence[str]) -> None:
        more = [place[name] for name in group if name in place and place[name] not in taken]
        if more and rank(freedom[:, taken + more], field) == len(taken) + len(more):
            taken.extend(more)

    for group in _groups(mechanism, first):
        take(group)
    for ball in _balls(mechanism):
        parts = list(ball.velocities)
        if real is not None:
            turning = dict(zip(parts, _left([place[name] for name in parts], taken, real), strict=True))
            parts.sort(key=turning.__getitem__, reverse=True)
        for name in parts:
            take([name])
    return tuple(name for name, k in place.items() if k in taken)


def _left(columns: Sequence[int], taken: Sequence[int], real: Floats) -> list[float]:
    """How much some coordinates can move while those that are taken rest."""
    moved, _ = np.linalg.qr(real[taken].T)
    resting = real[columns] - real[columns] @ moved @ moved.T
    return [round(float(size), _DIGITS) for size in np.linalg.norm(resting, axis=1)]


def split_balls(mechanism: Mechanism) -> list[str]:
    """Independent coordinates of balls of which other components depend on them."""
    chosen = set(mechanism.independent)
    return [
        name
        for m in _balls(mechanism)
        for name in m.velocities
        if name in chosen and not chosen.issuperset(m.velocities)
    ]


def _balls(mechanism: Mechanism) -> list[Motion]:
    return [motion for motion in mechanism.motions if motion.kind is MotionKind.BALL]


def _groups(mechanism: Mechanism, first: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Coordinates that are best taken together, the most wanted first."""
    depth: dict[int, int] = {GROUND: 0}
    for index, body in enumerate(mechanism.bodies):
        depth[index] = depth[body.parent] + 1
    near = sorted(range(len(mechanism.bodies)), key=depth.__getitem__)
    joints = [mechanism.bodies[index].joint for index in near]
    scalar = [joint for joint in joints if all(m.kind is not MotionKind.BALL for m in joint.motions)]
    motions = [motion for joint in joints for motion in joint.motions]
    yield from ((name,) for name in first)
    yield from (_velocities(joint.motions) for joint in joints if joint.kind == "floating")
    yield from (_velocities(joint.motions) for joint in scalar)
    yield from (motion.velocities for motion in motions if motion.kind is not MotionKind.BALL)
    yield from (motion.velocities for motion in motions if motion.kind is MotionKind.BALL)


def _velocities(motions: Sequence[Motion]) -> tuple[str, ...]:
    return tuple(name for motion in motions for name in motion.velocities)
