"""Distances along a motion as a user looks at them: of every pair over time, and on the way to where it begins.

Limits are proved elsewhere; here distances are measured at samples, up to a metre, so that a plot shows which pairs
come close and when.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from echelon.dynamics import Kinematics, assembly_of
from echelon.excite.problem.clearance import Clearance
from echelon.excite.problem.closed_loops import LoopLimits, LoopMotion
from echelon.excite.problem.state_limits import StateConstraint
from echelon.excite.problem.task import Task
from echelon.excite.problem.trajectory import Trajectory
from echelon.robot import Mechanism, upward
from echelon.shared import Floats

DISTANCE_RATE = 50.0
"""Rate, Hz, at which distances are shown: a body goes centimetres in between."""
MOST_SAMPLES = 3000
"""Samples of a distance: of a minute all at that rate."""
FARTHEST = 1.0
"""Largest distance that is told, m: what is a metre away is no concern."""
STEADY = 5e-3
"""Length, m, by which a distance may vary along a motion and still count as one that does not change."""
WAY_SAMPLES = 201
"""Samples of the way to the pose where a motion begins."""
EXACT = 1e-6
"""Length, m, to which distances are measured."""
AT_ZERO = 1e-9
"""Largest position, rad or m, at which a motion begins at zero: rounding."""


@dataclass(frozen=True)
class PairDistance:
    """The distance of two bodies, or of a body and an obstacle, along a motion."""

    label: str  # as that of the margin: ``"distance of hand and table"``
    obstacle: bool  # whether one of them is an obstacle
    low: float  # the clearance that is asked for, m
    distance: Floats  # shape (N,), m, at most ``FARTHEST``

    @property
    def least(self) -> float:
        """The smallest distance at the samples, m."""
        return float(self.distance.min())

    @property
    def steady(self) -> bool:
        """Whether the motion hardly changes it."""
        return float(np.ptp(self.distance)) < STEADY


@dataclass(frozen=True)
class Closeness:
    """Distances of all pairs that are checked, at samples."""

    time: Floats  # shape (N,), s
    pairs: tuple[PairDistance, ...]  # those that come nearest to their clearance first


def closeness_of(task: Task, trajectory: Trajectory) -> Closeness | None:
    """Distances over time; None where none are checked."""
    found = [(part, motion) for part, motion in clearances(task) if part.labels]
    if not found:
        return None
    clearance, motion = found[0]
    count = min(round(DISTANCE_RATE * trajectory.duration), MOST_SAMPLES)
    time = np.linspace(0.0, trajectory.duration, count + 1)
    distances = _distances(clearance, motion, trajectory(time))
    pairs = [
        PairDistance(label, any(name for _, name in owners), low, distance)
        for label, owners, low, distance in zip(
            clearance.labels,
            clearance.owners,
            clearance.low.tolist(),
            distances.T,
            strict=True,
        )
    ]
    pairs.sort(key=lambda pair: pair.least - pair.low)
    return Closeness(time, tuple(pairs))


def beginning(task: Task, trajectory: Trajectory) -> str:
    """Where a motion begins, and whether the straight way of the joints from zero to there is free, in a sentence."""
    start = trajectory(np.zeros(1))[0]
    if np.abs(start).max(initial=0.0) < AT_ZERO:
        return ""
    pose = ", ".join(
        f"{name} = {value:.4g} {unit}"
        for name, value, unit in zip(
            trajectory.coordinates, start, trajectory.units, strict=True
        )
    )
    text = f"the motion begins at {pose}: bring the robot there first, by a safe way, of which these limits say nothing"
    low, high = task.limits.low, task.limits.high
    if ((low > 0) | (high < 0)).any():
        return text
    way = start * np.linspace(0.0, 1.0, WAY_SAMPLES)[:, None]
    return text + _of_the_way(task, way)


def room_needed(task: Task, trajectory: Trajectory) -> str:
    """A sentence about the depth that a robot reaches below its base; empty if it floats or has no gravity."""
    mechanism = task.base.mechanism
    if not mechanism.gravity or task.setup.mechanism.floating_joints:
        return ""
    count = min(round(DISTANCE_RATE * trajectory.duration), MOST_SAMPLES)
    time = np.linspace(0.0, trajectory.duration, count + 1)
    q = positions_along(mechanism, trajectory, time)
    heights = Kinematics(mechanism).frames(q)[..., 3] @ upward(mechanism)
    below = -float(heights.min())
    if below < STEADY:
        return ""
    name = mechanism.bodies[int(heights.min(axis=0).argmin())].name
    text = f"the origin of '{name}' comes down to {below:.3g} m below that of the base"
    obstacles = [
        f"'{shape.name}'"
        for part, _ in clearances(task)
        for shape in part.shapes
        if shape.obstacle
    ]
    if obstacles:
        return f"{text}: is there room beside the obstacles {', '.join(obstacles)}?"
    return f"{text}: if there is no such room, state the floor or table under  collisions: obstacles"


def positions_along(
    mechanism: Mechanism, trajectory: Trajectory, time: Floats
) -> Floats:
    """Positions of all coordinates at some times, shape (N, positions); loops are closed."""
    if closed := assembly_of(mechanism):
        return closed.from_independent(trajectory(time))
    columns = [trajectory.coordinates.index(name) for name in mechanism.positions]
    return trajectory(time)[:, columns]


def _of_the_way(task: Task, way: Floats) -> str:
    """Distances on a way from zero of shape (N, n), in words."""
    found = [(part, motion) for part, motion in clearances(task) if part.labels]
    if not found or found[0][1] is not None:
        return ""
    clearance = found[0][0]
    room = _distances(clearance, None, way) - clearance.low
    sample, pair = np.unravel_index(int(room.argmin()), room.shape)
    whole = f"at {len(way)} samples, the straight way of the joints from zero"
    if room[sample, pair] >= -EXACT:
        return f"; {whole} keeps all distances"
    missing = (
        f"{-1e3 * room[sample, pair]:.3g} mm less than {clearance.low[pair]:.3g} m"
    )
    share = f"after {sample / (len(way) - 1):.0%} of it"
    return (
        f"; {whole} does not keep the {clearance.labels[pair]}: {share} it is {missing}"
    )


def _distances(clearance: Clearance, motion: LoopMotion | None, q: Floats) -> Floats:
    """Distances of the pairs of owners, shape (N, m), m."""
    far = replace(clearance, reach=max(FARTHEST, clearance.reach))
    return far.nearest(q if motion is None else motion.positioned(q).q).distances


def clearances(task: Task) -> Iterator[tuple[Clearance, LoopMotion | None]]:
    """Limits of distances, with the motion of loops if there are any."""
    for constraint in task.constraints:
        motion = None
        parts: tuple[StateConstraint, ...] = (constraint,)
        if isinstance(constraint, LoopLimits):
            motion, parts = constraint.motion, constraint.parts
        yield from ((part, motion) for part in parts if isinstance(part, Clearance))
