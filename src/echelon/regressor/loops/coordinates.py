"""The coordinates that all others depend on, chosen as engineers would.

Coordinates can be independent together if no velocities that keep the loops closed tie them: if their columns of a
basis of these velocities are.  So they are taken one joint after the other, as long as that stays so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.mechanism.body import GROUND
from echelon.mechanism.joint import Joint, MotionKind
from echelon.mechanism.mechanism import Mechanism

_DIGITS = 6  # of velocities that are compared; where they are alike, x comes first


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
    chosen = _Chosen(rank)
    joints = _near_the_base(mechanism)
    motions = [m for joint in joints for m in joint.motions if m.name not in mechanism.dependent]
    balls = [[place[name] for name in m.velocities] for m in motions if m.kind is MotionKind.BALL]
    single = [place[m.name] for m in motions if m.kind is not MotionKind.BALL]

    def take(joint: Joint) -> None:
        chosen.take([place[name] for motion in joint.motions for name in motion.velocities if name in place])

    for name in first:
        chosen.take([place[name]])
    for joint in joints:
        if joint.kind == "floating":
            take(joint)
    for ball in balls:
        if chosen.rank([*chosen.columns, *ball, *single]) > chosen.rank([*chosen.columns, *single]):
            chosen.take(ball)
    for joint in joints:
        if all(motion.kind is not MotionKind.BALL for motion in joint.motions):
            take(joint)
    for column in single:
        chosen.take([column])
    for ball in balls:
        turning = [0.0] * len(ball) if real is None else _left(ball, chosen.columns, real)
        for _, column in sorted(zip(turning, ball, strict=True), key=lambda part: -part[0]):
            chosen.take([column])
    return tuple(name for name, k in place.items() if k in chosen.columns)


def split_balls(mechanism: Mechanism) -> list[str]:
    """Independent coordinates of balls of which other components depend on them."""
    chosen = set(mechanism.independent)
    balls = [motion for motion in mechanism.motions if motion.kind is MotionKind.BALL]
    return [name for m in balls for name in m.velocities if name in chosen and not chosen.issuperset(m.velocities)]


class _Chosen:
    """Columns that are independent of one another."""

    def __init__(self, rank: Callable[[Sequence[int]], int]) -> None:
        self.rank = rank
        self.columns: list[int] = []

    def take(self, group: Sequence[int]) -> None:
        """Add a group of columns as a whole, if all stay independent."""
        more = [column for column in group if column not in self.columns]
        if more and self.rank(self.columns + more) == len(self.columns) + len(more):
            self.columns += more


def _left(columns: Sequence[int], taken: Sequence[int], real: Floats) -> list[float]:
    """How much some coordinates can move while those that are taken rest."""
    moved, _ = np.linalg.qr(real[taken].T)
    resting = real[columns] - real[columns] @ moved @ moved.T
    return [round(float(size), _DIGITS) for size in np.linalg.norm(resting, axis=1)]


def _near_the_base(mechanism: Mechanism) -> list[Joint]:
    """All joints, those with the fewest bodies between them and the base first."""
    depth: dict[int, int] = {GROUND: 0}
    for index, body in enumerate(mechanism.bodies):
        depth[index] = depth[body.parent] + 1
    return [mechanism.bodies[k].joint for k in sorted(range(len(mechanism.bodies)), key=depth.__getitem__)]
