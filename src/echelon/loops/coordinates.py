"""The coordinates that all others depend on, chosen as engineers would.

Coordinates can be independent together if no velocities that keep the loops closed tie them: if their columns of a
basis of these velocities are.  So they are taken one joint after the other, as long as that stays so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from echelon.loops.closed_motion import NEGLIGIBLE
from echelon.robot import GROUND, Joint, Mechanism, MotionKind
from echelon.shared import Floats


def independent_coordinates(
    mechanism: Mechanism,
    rank: Callable[[Sequence[int]], int],
    first: Sequence[str] = (),
    real: Floats | None = None,
) -> tuple[str, ...]:
    """Velocity coordinates that determine all others, in the order of the mechanism.

    Those that should be come first, then joints that float, balls without which not all would be determined, whole
    joints near the base, and other motions near the base.  Parts of a ball come only if nothing else is left, such as
    the spin of a rod between two balls, and then those by which it can really turn most.
    """
    place = {name: k for k, name in enumerate(mechanism.velocities)}
    chosen: list[int] = []

    def take(names: Sequence[str]) -> None:
        """Take coordinates as a whole, if all stay independent."""
        more = [
            place[name] for name in names if name in place and place[name] not in chosen
        ]
        if more and rank(chosen + more) == len(chosen) + len(more):
            chosen.extend(more)

    joints = _near_the_base(mechanism)
    whole = {
        joint.name: [name for motion in joint.motions for name in motion.velocities]
        for joint in joints
    }
    motions = [
        m
        for joint in joints
        for m in joint.motions
        if m.name not in mechanism.dependent
    ]
    balls = [m.velocities for m in motions if m.kind is MotionKind.BALL]
    single = [place[m.name] for m in motions if m.kind is not MotionKind.BALL]
    for name in first:
        take([name])
    for joint in joints:
        if joint.is_floating:
            take(whole[joint.name])
    for ball in balls:
        if rank([*chosen, *(place[name] for name in ball), *single]) > rank(
            [*chosen, *single]
        ):
            take(ball)
    for joint in joints:
        if all(motion.kind is not MotionKind.BALL for motion in joint.motions):
            take(whole[joint.name])
    for column in single:
        take([mechanism.velocities[column]])
    for ball in balls:
        turning = (
            [0] * len(ball)
            if real is None
            else _left([place[name] for name in ball], chosen, real)
        )
        for _, name in sorted(
            zip(turning, ball, strict=True), key=lambda part: -part[0]
        ):
            take([name])
    return tuple(name for name, k in place.items() if k in chosen)


def _left(columns: Sequence[int], taken: Sequence[int], real: Floats) -> list[int]:
    """Mobility of coordinates while the taken ones rest, in units of the negligible."""
    moved, _ = np.linalg.qr(real[taken].T)
    resting = real[columns] - real[columns] @ moved @ moved.T
    return [round(float(size) / NEGLIGIBLE) for size in np.linalg.norm(resting, axis=1)]


def _near_the_base(mechanism: Mechanism) -> list[Joint]:
    """All joints, those with the fewest bodies between them and the base first."""
    depth: dict[int, int] = {GROUND: 0}
    for index, body in enumerate(mechanism.bodies):
        depth[index] = depth[body.parent] + 1
    return [
        mechanism.bodies[k].joint
        for k in sorted(range(len(mechanism.bodies)), key=depth.__getitem__)
    ]
