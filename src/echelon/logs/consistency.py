"""Velocities against positions: a wrong sign, unit or column shows as a factor between them.

Measured velocities are integrated instead of differentiating positions: over windows of many samples noise and
resolution count for little, and a delay of a few samples for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.logs.finding import Finding, Severity
from echelon.logs.quantities import Series, motion_of, series
from echelon.logs.recording import Recording
from echelon.logs.rotations import WRAP
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.clock import GAP, nominal_period

_WINDOWS = 400
_LEAST = 4
_FOLLOWS = 0.9
_UNRELATED = 0.5
_OFF = 0.1
_NEAR = 0.03

_TURNING = (
    (180 / math.pi, "as if it were in deg{per} (unit: deg{per})"),
    (math.pi / 180, "as if the {lower} were in degrees (unit: deg{lower_per})"),
    (30 / math.pi, "as if it were in rpm (unit: rpm)"),
    (0.5 / math.pi, "as if it were in turns (unit: rev{per})"),
    (2 * math.pi, "as if the {lower} were in turns (unit: rev{lower_per})"),
    (1e3, "as if time were in ms (unit: ms)"),
    (1e6, "as if time were in µs (unit: us)"),
    (1e9, "as if time were in ns (unit: ns)"),
)
_SLIDING = (
    (1e3, "as if it were in mm{per} (unit: mm{per}), or time in ms (unit: ms)"),
    (1e-3, "as if the {lower} were in mm{lower_per} (unit: mm{lower_per})"),
    (1e6, "as if time were in µs (unit: us)"),
    (1e9, "as if time were in ns (unit: ns)"),
)


@dataclass(frozen=True)
class _Pair:
    lower: Series
    upper: Series
    sliding: bool


def contradictions(recording: Recording, mechanism: Mechanism, usable: Flags) -> list[Finding]:
    """Velocities that are not the derivatives of positions, and accelerations that are not those of velocities.

    Parameters
    ----------
    recording : Recording
    mechanism : Mechanism
        Angular velocities of balls, which are no derivatives of coordinates, are not compared.
    usable : array of bool of shape (N,)

    Returns
    -------
    list of Finding
        ``contradiction``, with the factor between them and the unit or sign that it hints at.
    """
    time = recording.time
    if usable.sum() < _LEAST * 10 or not np.any(np.diff(time[usable]) > 0):
        return []
    width = max(_LEAST, len(time) // _WINDOWS)
    inside = _whole_windows(time, usable, width)
    if inside.sum() < 10:
        return []
    found = []
    for pair in _pairs(recording, mechanism):
        text = _compared(pair, time, inside, width)
        if text:
            where = f"{recording.source}, {pair.upper.label}"
            found.append(Finding(Severity.WARNING, "contradiction", where, text))
    return found


def _pairs(recording: Recording, mechanism: Mechanism) -> list[_Pair]:
    found = []
    for low, up in (("q", "qd"), ("qd", "qdd")):
        lower = {s.name: s for s in series(recording, mechanism, low)}
        for upper in series(recording, mechanism, up):
            motion = motion_of(mechanism, upper.name)
            if motion is None or upper.name not in lower or (motion.kind is MotionKind.BALL and low == "q"):
                continue
            own = lower[upper.name]
            if low == "q" and motion.kind is MotionKind.ROTATION and _wraps(own.values):
                own = Series(own.signal, own.name, np.unwrap(own.values, discont=WRAP))
            found.append(_Pair(own, upper, motion.kind is MotionKind.TRANSLATION))
    return found


def _wraps(values: Floats) -> bool:
    """Whether an angle, finite throughout, jumps by a turn."""
    jumps = bool(np.any(np.abs(np.diff(values)) > WRAP))
    return jumps and bool(np.isfinite(values).all())


def _whole_windows(time: Floats, usable: Flags, width: int) -> Flags:
    """Which windows of so many intervals have only usable samples and no jump of the clock."""
    count = (len(time) - 1) // width
    steps = np.diff(time)[: count * width].reshape(count, width)
    period = nominal_period(time[usable])
    good = usable[: count * width].reshape(count, width).all(axis=1) & usable[width : count * width + 1 : width]
    return np.asarray(good & (steps.min(axis=1) >= 0) & (steps.max(axis=1) <= GAP * period))


def _compared(pair: _Pair, time: Floats, inside: Flags, width: int) -> str:
    count = len(inside)
    ends = np.arange(count + 1) * width
    moved = np.diff(pair.lower.values[ends])[inside]
    v = pair.upper.values
    area = 0.5 * (v[1:] + v[:-1]) * np.diff(time)
    integral = area[: count * width].reshape(count, width).sum(axis=1)[inside]
    size, other = float(np.linalg.norm(moved)), float(np.linalg.norm(integral))
    if size == 0 or other == 0:
        return ""  # one of them is constant, which is said elsewhere
    likeness = float(moved @ integral) / (size * other)
    factor = math.copysign(other / size, likeness)
    what = pair.lower.label
    if abs(likeness) < _UNRELATED:
        return f"does not follow the {what} (correlation {likeness:.2f}): is this its column?"
    if abs(likeness) < _FOLLOWS or abs(factor - 1) < _OFF:
        return ""
    return f"is {factor:.4g} times the derivative of the {what}: {_reason(pair, factor)}"


def _reason(pair: _Pair, factor: float) -> str:
    if abs(factor + 1) < _OFF:
        return "one of them has the wrong sign (scale: -1)"
    words = {
        "lower": "position" if pair.lower.signal == "q" else "velocity",
        "per": "/s" if pair.upper.signal == "qd" else "/s²",
        "lower_per": "" if pair.lower.signal == "q" else "/s",
    }
    known: Sequence[tuple[float, str]] = _SLIDING if pair.sliding else _TURNING
    hint = next((text for value, text in known if abs(abs(factor) / value - 1) < _NEAR), None)
    sign = ", with the wrong sign" if factor < 0 else ""
    return hint.format(**words) + sign if hint else "units or a ratio (scale) differ, or the sides of the gear do"
