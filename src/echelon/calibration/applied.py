"""A robot with errors in its geometry: the calibrated mechanism, and what changes in its file.

Frames of bodies stay on their joints.  Errors behind the last motion of a body move what is fixed to the body: the next
joints, ends of loops, and tools.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from echelon.calibration.errors import labels_of
from echelon.calibration.frames import as_placement, error_frame
from echelon.robot import (
    GROUND,
    Mechanism,
    Motion,
    MotionKind,
    Placement,
    Step,
    known_values,
    merge,
    placement_matrix,
)
from echelon.shared import Floats, symbol_stem


@dataclass(frozen=True)
class Applied:
    """A calibrated robot."""

    mechanism: Mechanism
    moves: Mapping[
        str, Floats
    ]  # by body: where what is fixed to it sits now, shape (4, 4)
    # by body: how its joint is moved on its parent, seen from the parent's frame, shape (4, 4)
    mounts: Mapping[str, Floats] = field(default_factory=dict)

    def place(self, body: int, frame: Floats) -> Floats:
        """Where a tool sits on a body now."""
        name = "" if body == GROUND else self.mechanism.bodies[body].name
        found: Floats = self.moves.get(name, np.eye(4)) @ frame
        return found


def applied(mechanism: Mechanism, values: Mapping[str, float]) -> Applied:
    """The robot with errors of some names; ratios and compliances are no part of its geometry."""
    labels = labels_of(mechanism)
    known = known_values(mechanism)
    moves, mounts = dict[str, Floats](), dict[str, Floats]()
    bodies = []
    for body in mechanism.bodies:
        steps: list[Step] = []
        if (
            body.parent != GROUND
            and (name := mechanism.bodies[body.parent].name) in moves
        ):
            steps.append(as_placement(moves[name]))
        motions = body.joint.motions
        before = np.eye(4)
        for step in body.joint.steps:
            if isinstance(step, Motion):
                mount = error_frame(values, f"{labels[step.name]}b")
                if not np.array_equal(mount, np.eye(4)):
                    mounts[body.name] = before @ mount @ np.linalg.inv(before)
                break
            before = before @ placement_matrix(step, known)
        for step in body.joint.steps:
            if isinstance(step, Motion) and step is motions[0]:
                steps += _changed(error_frame(values, f"{labels[step.name]}b"))
            steps.append(step)
            if isinstance(step, Motion) and step is not motions[-1]:
                steps += _changed(_behind(step, labels[step.name], values))
        if motions:
            move = _behind(motions[-1], labels[motions[-1].name], values)
            after = np.eye(4)
            for step in body.joint.steps[body.joint.steps.index(motions[-1]) + 1 :]:
                assert isinstance(step, Placement)
                after = after @ placement_matrix(step, known)
            move = np.asarray(np.linalg.solve(after, move @ after), dtype=float)
            move = move @ error_frame(values, f"{labels[motions[-1].name]}a")
            if not np.array_equal(move, np.eye(4)):
                moves[body.name] = move
        bodies.append(
            replace(body, joint=replace(body.joint, steps=merge(tuple(steps))))
        )
    closures = []
    for closure in mechanism.closures:
        frames = []
        ends = ((closure.first, "first"), (closure.second, "second"))
        for (index, end), placement in zip(ends, closure.placements, strict=True):
            name = "" if index == GROUND else mechanism.bodies[index].name
            ending = symbol_stem(f"{closure.name}_{end}")
            moved = [as_placement(moves[name])] if name in moves else []
            whole = Placement()
            for part in (*moved, placement, *_changed(error_frame(values, ending))):
                whole = whole @ part
            frames.append(whole)
        closures.append(replace(closure, first_frame=frames[0], second_frame=frames[1]))
    return Applied(
        replace(mechanism, bodies=tuple(bodies), closures=tuple(closures)),
        moves,
        mounts,
    )


def _behind(motion: Motion, label: str, values: Mapping[str, float]) -> Floats:
    """The frame behind a motion: errors of the frame, then an offset along the motion."""
    offset = motion.sign * values.get(f"offset{label}", 0.0)
    turns = motion.kind is not MotionKind.TRANSLATION
    pitch = float(motion.pitch.at({})) if motion.kind is MotionKind.SCREW else 0.0
    axis = "xyz"[motion.axis]
    along = {
        f"p{axis}": pitch * offset if turns else offset,
        f"r{axis}": offset * turns,
    }
    found: Floats = error_frame(values, label) @ error_frame(along, "")
    return found


def _changed(frame: Floats) -> list[Placement]:
    return [] if np.array_equal(frame, np.eye(4)) else [as_placement(frame)]
