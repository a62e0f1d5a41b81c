"""The states over which two robots are compared: within limits that are given, or that their files state."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from echelon.comparison.inertias import file_of
from echelon.comparison.outputs import StateBox
from echelon.excite import changed, resolved_limits
from echelon.formats import (
    EVERY,
    NO_LIMIT,
    ExcitationEntry,
    StatedLimits,
    stated_limits,
)
from echelon.robot import Mechanism, MotionKind
from echelon.shared import InputError, listed, plain_data

_ROOM = 1.0  # m to each side for a floating base, where no output depends on the place
_ANYWHERE = 1e3  # rad or m, beyond all positions that loops lead to


def states_of(
    one: Mechanism, two: Mechanism, names: Mapping[str, str], limits: Mapping[str, Any]
) -> tuple[StateBox, dict[str, tuple[float, float]], list[str]]:
    """States within the limits that are given, or that the first robot's file or the second's states."""
    stated = _stated_limits(one)
    others = {names[name]: found for name, found in _stated_limits(two).items()}
    notes = []
    if unlike := [n for n in stated if n in others and stated[n] != others[n]]:
        notes.append(
            f"the files have different limits of {listed(unlike)}: those of {one.name} count"
        )
    entry = ExcitationEntry.model_construct()
    file = file_of(one)
    if file is not None and file.is_description:
        entry = file.description.excitation
    floating = {
        name: (-_ROOM, _ROOM)
        for joint in one.floating_joints
        for motion in joint.motions
        if motion.kind is MotionKind.TRANSLATION
        for name in motion.velocities
    }
    own = plain_data(entry.limits.model_dump(exclude_unset=True), NO_LIMIT)
    own |= limits
    entry = changed(entry, {"limits": own}, "limits")
    room = {**floating, **entry.limits.position}
    limited = entry.limits.model_copy(update={"position": room, "jerk": {EVERY: inf}})
    found = resolved_limits(one, limited, {**others, **stated}, one.name)
    notes += [finding.text for finding in found.findings]
    free = one.independent_velocities
    rates = [{m.name: m.high for m in found.motion if m.order == k} for k in (1, 2)]
    ranges: dict[str, tuple[float, float]] = {}
    turning = []
    for k, name in enumerate(free):
        low, high = float(found.low[k]), float(found.high[k])
        if found.units[k] == "rad" and not isfinite(high - low):
            low, high = _one_turn(low, high)
            turning.append(name)
        ranges[f"q[{name}]"] = low, high
        for kind, rate in zip(("qd", "qdd"), rates, strict=True):
            ranges[f"{kind}[{name}]"] = -rate.get(name, inf), rate.get(name, inf)
    if turning:
        notes.append(f"{listed(turning)} can turn without end: compared over one turn")
    endless = [name for name, (low, high) in ranges.items() if not isfinite(high - low)]
    if endless:
        raise InputError(
            f"nothing limits {listed(endless)}: state limits, such as limits={{'velocity': 2}}"
        )
    ends = np.array(
        [
            _range_of(name, motion.kind, ranges)
            for motion in one.free_motions
            for name in motion.positions
        ]
    )
    sizes = [
        np.array([ranges[f"{kind}[{name}]"][1] for name in free])
        for kind in ("qd", "qdd")
    ]
    ends = ends.reshape(-1, 2)
    return StateBox(ends[:, 0], ends[:, 1], *sizes), ranges, notes


def _one_turn(low: float, high: float) -> tuple[float, float]:
    """A turn of an angle that is limited on one side or on none."""
    if isfinite(low):
        return low, low + 2 * pi
    if isfinite(high):
        return high - 2 * pi, high
    return -pi, pi


def _range_of(
    name: str, kind: MotionKind, ranges: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """The range of a position: of a component of a unit quaternion, or of what follows from loops, any value."""
    if kind is MotionKind.BALL:
        return -1.0, 1.0
    return ranges.get(f"q[{name}]", (-_ANYWHERE, _ANYWHERE))


def _stated_limits(robot: Mechanism) -> Mapping[str, StatedLimits]:
    file = file_of(robot)
    return {} if file is None else stated_limits(file, robot)
