"""What cannot be right: magnitudes that no robot has, and velocities that contradict positions.

A wrong unit is an error of a factor of 57 or 1000, and robots differ by less than that: joints turn once or twice, not
fifty times, and are sampled between five and twenty thousand times a second.  Where a number cannot be right, and the
column's unit was not stated, reading stops with the unit that would make it right.  To state the unit is to say that
the number is right; then, and where there is room for doubt, it is a finding.

A wrong sign, unit or column shows as a factor between velocities and the derivatives of positions.  That columns are
exchanged is only said where this explains clearly more than what is stated: where joints move alike, velocities follow
either.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import dropwhile

import numpy as np

from echelon.arrays import Flags
from echelon.errors import InputError
from echelon.logs.columns.by_values import (
    DEGREES,
    LONG,
    NEAR,
    TURNS,
    are_numbers,
    fitting_units,
)
from echelon.logs.columns.column_map import (
    WRAP,
    Channel,
    ColumnMap,
    Series,
    motion_of,
    series,
)
from echelon.logs.finding import Finding, listed, warning
from echelon.logs.recording import Recording
from echelon.logs.units import factor
from echelon.mechanism.joint import GROUND, MotionKind, Placement, Step
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values
from echelon.signals.clock import nominal_period
from echelon.signals.rates import CLEAR, rate

_FARTHEST = 1e5  # rad, that not even a wheel or a spindle turns in a log: hundreds of seconds at hundreds of rad/s
_ODD_PERIODS = (2e-5, 0.5)
_LITTLE_ANGLE = 2 * math.pi**2 / 180
_LITTLE_LENGTH = 1e-3
_STRONG = {"N·m": 2e4, "N": 1e6}
_WEIGHTS = 50.0
_WEAK = 1e-4
_FORWARD = (
    0.75  # share of steps forward in time from which on their length says something
)
_G = 9.81


def check_plausible(
    recording: Recording, mechanism: Mechanism, columns: ColumnMap | None = None
) -> tuple[Finding, ...]:
    """Compare magnitudes with what robots do; units that were stated in the column map are believed."""
    stated = columns or ColumnMap()
    findings = _check_time(recording, stated)
    positions = [
        s for s in series(recording, mechanism, "q") if np.isfinite(s.values).any()
    ]
    turning = [s for s in positions if _kind(mechanism, s) is MotionKind.ROTATION]
    sliding = [
        s
        for s in positions
        if _kind(mechanism, s) is MotionKind.TRANSLATION and not _floats(mechanism, s)
    ]
    findings += _check_angles(recording, turning, stated.positions)
    findings += _check_lengths(recording, sliding, stated.positions)
    findings += _check_forces(recording, mechanism, stated.outputs)
    return tuple(findings)


def surplus_columns(
    columns: ColumnMap, names: Sequence[str], mechanism: Mechanism
) -> tuple[Finding, ...]:
    """Positions that a file has beyond those that are used, such as ``q_7`` beside ``q_1`` … ``q_6``."""
    locked = sum(body.joint.is_fixed for body in mechanism.bodies)
    used = {channel.column for channel in columns.positions.values()}
    known = {
        channel.column
        for group in columns.channels.values()
        for channel in group.values()
    }
    patterns = {
        re.sub(r"\d+(?=\D*$)", "#", name) for name in used if re.search(r"\d", name)
    }
    more = [
        n
        for n in names
        if n not in known
        and re.search(r"\d", n)
        and re.sub(r"\d+(?=\D*$)", "#", n) in patterns
    ]
    if len(more) <= locked or len(patterns) > 1 or len(used) < 2 or are_numbers(names):
        return ()
    shown = listed(f"'{name}'" for name in more)
    text = f"the log has {shown} beside the {len(used)} columns that are used: is it a log of another robot?"
    return (warning("robot", "positions", text),)


# -- time -------------------------------------------------------------------------------------------------------------


def _check_time(recording: Recording, columns: ColumnMap) -> list[Finding]:
    time = recording.time[np.isfinite(recording.time)]
    steps = np.diff(time)
    if columns.rate is not None and fitting_units(1 / columns.rate)[:1] != ["s"]:
        text = f"at the stated rate of {columns.rate:g} Hz there is a sample every {1 / columns.rate:.4g} s"
        return [
            warning(
                "time",
                f"{recording.source}, time",
                f"{text}, a rate that shows no dynamics",
            )
        ]
    if columns.rate is not None or len(time) < 3 or np.mean(steps > 0) < _FORWARD:
        return []  # that stamps are in no order is said where segments are made
    period = nominal_period(time)
    if _ODD_PERIODS[0] <= period <= _ODD_PERIODS[1]:
        return []
    channel = columns.time or Channel("")
    raw = period / factor(channel.unit, "s")
    units = fitting_units(raw)
    text = f"by its time stamps the log has a sample every {period:.4g} s"
    if columns.time is not None and not channel.unit and units:
        unit = units[0]
        problem = (
            f"{text}: is time in {unit} (unit: {unit}; {1 / (raw * factor(unit, 's')):.4g} samples per second)? "
            "If it really is in seconds, say unit: s"
        )
        raise InputError(
            problem, source=recording.source, element=f"column '{channel.column}'"
        )
    if channel.unit == "s":
        return []
    hint = f": is time in {units[0]}?" if units else ", a rate that shows no dynamics"
    return [warning("time", f"{recording.source}, time", text + hint)]


# -- positions --------------------------------------------------------------------------------------------------------


def _kind(mechanism: Mechanism, channel: Series) -> MotionKind | None:
    motion = motion_of(mechanism, channel.name)
    return None if motion is None else motion.kind


def _floats(mechanism: Mechanism, channel: Series) -> bool:
    """Whether a coordinate belongs to a joint that moves freely in space, as far as it likes."""
    joints = (body.joint for body in mechanism.bodies)
    own = next(
        joint
        for joint in joints
        if any(channel.name in m.positions for m in joint.motions)
    )
    return any(motion.kind is MotionKind.BALL for motion in own.motions)


def _largest(channel: Series) -> float:
    return float(
        np.nanmax(np.abs(np.where(np.isfinite(channel.values), channel.values, np.nan)))
    )


def _range(channel: Series) -> float:
    return float(np.ptp(channel.values[np.isfinite(channel.values)]))


def _unstated(channels: Mapping[str, Channel], name: str) -> bool:
    """Whether the column of a coordinate, or one at a motor that may be behind it, has no unit."""
    own = [channels[name]] if name in channels else list(channels.values())
    return not own or any(not channel.unit for channel in own)


def _check_angles(
    recording: Recording, turning: Sequence[Series], stated: Mapping[str, Channel]
) -> list[Finding]:
    far = [
        channel
        for channel in turning
        if _largest(channel) > TURNS and _unstated(stated, channel.name)
    ]
    if far:
        most = max(map(_largest, far))
        names = listed(f"'{channel.name}'" for channel in far)
        text = f"{names}: angles up to {most:.4g} rad are {most / math.tau:.3g} turns"
        text += (
            ": are they in degrees (unit: deg)?"
            if most <= DEGREES
            else ": are they encoder counts (scale), or those of motors (state actuators and name these)?"
        )
        if most > _FARTHEST or (len(far) > 1 and 2 * len(far) > len(turning)):
            problem = f"{text} If they are right, say unit: rad"
            raise InputError(problem, source=recording.source, element="positions")
        return [warning("units", f"{recording.source}, positions", text)]
    degrees = [
        c
        for c in turning
        if c.name in stated and factor(stated[c.name].unit, "rad") == math.radians(1)
    ]
    if (
        degrees
        and len(degrees) == len(turning)
        and max(map(_range, turning)) < _LITTLE_ANGLE
    ):
        most = math.degrees(max(map(_range, turning)))
        text = f"no joint turns by more than {most:.3g}°: are the columns in rad (leave out unit: deg)?"
        return [warning("units", f"{recording.source}, positions", text)]
    return []


def _check_lengths(
    recording: Recording, sliding: Sequence[Series], stated: Mapping[str, Channel]
) -> list[Finding]:
    findings = []
    for channel in sliding:
        most, where = _largest(channel), f"{recording.source}, {channel.label}"
        if most > LONG and _unstated(stated, channel.name):
            problem = f"it goes to {most:.4g} m: is it in mm (unit: mm)?  If it is right, say unit: m"
            raise InputError(problem, source=recording.source, element=channel.label)
        unit = stated[channel.name].unit if channel.name in stated else ""
        if unit and factor(unit, "m") < 0.1 and 0 < _range(channel) < _LITTLE_LENGTH:
            text = f"moves by {_range(channel) * 1e3:.3g} mm only: is the column in m (leave out unit: {unit})?"
            findings.append(warning("units", where, text))
    return findings


# -- forces -----------------------------------------------------------------------------------------------------------


def _check_forces(
    recording: Recording, mechanism: Mechanism, stated: Mapping[str, Channel]
) -> list[Finding]:
    units = {output.name: output.unit for output in mechanism.outputs}
    outputs = [
        s for s in series(recording, mechanism, "y") if np.isfinite(s.values).any()
    ]
    for channel in outputs:
        unit, most = units[channel.name], _largest(channel)
        if most > _STRONG.get(unit, math.inf) and _unstated(stated, channel.name):
            problem = f"it goes to {most:.4g} {unit}: is it in m{unit} (unit: m{unit})?  If it is right, say unit: {unit}"
            raise InputError(problem, source=recording.source, element=channel.label)
    torques = [channel for channel in outputs if units[channel.name] == "N·m"]
    static = _largest_static_torque(mechanism)
    if static is None or not torques:
        return []
    most, where = max(map(_largest, torques)), f"{recording.source}, outputs"
    text = f"torques go to {most:.3g} N·m, where the weight of the described robot makes {static:.3g} N·m at most"
    if most > _WEIGHTS * static:
        return [
            warning(
                "units",
                where,
                f"{text}: are they in mN·m, or is this another robot's log?",
            )
        ]
    if most < _WEAK * static and not mechanism.actuators:
        return [
            warning(
                "units",
                where,
                f"{text}: are they in kN·m, or those of motors before gears?",
            )
        ]
    return []


def _largest_static_torque(mechanism: Mechanism) -> float | None:
    """Largest moment of the weight about a joint, with all that it carries stretched out; None where nobody states it.

    The moment of a body is its mass times the way to its frame, and the first moments of its mass there.
    """
    if mechanism.gravity is None or any(
        body.carried and body.inertial is None for body in mechanism.bodies
    ):
        return None
    known = known_values(mechanism)
    whole = [_length(body.joint.steps, known) for body in mechanism.bodies]
    turned = [
        _length(dropwhile(_is_placed, body.joint.steps), known)
        for body in mechanism.bodies
    ]
    moments = [0.0] * len(whole)
    for body, inertial in enumerate(body.inertial for body in mechanism.bodies):
        way, joint = 0.0, body
        while joint != GROUND and inertial is not None:
            moments[joint] += inertial[9] * (way + turned[joint]) + math.hypot(
                *inertial[6:9]
            )
            way, joint = way + whole[joint], mechanism.bodies[joint].parent
    largest = _G * max(moments, default=0.0)
    return largest if 0 < largest < math.inf else None


def _is_placed(step: Step) -> bool:
    return isinstance(step, Placement)


def _length(steps: Iterable[Step], known: Mapping[str, float]) -> float:
    """How far steps lead, at most, m; inf where nobody states it."""
    ways = [step.translation for step in steps if isinstance(step, Placement)]
    stated = all(
        name in known for way in ways for entry in way for name in entry.symbols()
    )
    return (
        sum(math.hypot(*(entry.at(known) for entry in way)) for way in ways)
        if stated
        else math.inf
    )


_CLOCK = 0.005  # relative difference of velocities and derivatives of positions that calibration explains
_SEVERAL = 2  # joints that a clock is told by


@dataclass(frozen=True)
class _Pair:
    lower: Series
    upper: Series
    sliding: bool


def contradictions(
    recording: Recording, mechanism: Mechanism, usable: Flags
) -> list[Finding]:
    """Velocities that are not the derivatives of positions, and accelerations that are not those of velocities."""
    pairs, found = _pairs(recording, mechanism, usable), []
    for pair in pairs:
        own = rate(pair.lower.values, pair.upper.values, recording.time)
        if (
            not np.isfinite(own.slope) or not own.slope
        ):  # what never changes is said elsewhere
            continue
        is_one = abs(own.slope - 1) <= NEAR + CLEAR * own.error
        if is_one and own.relative < NEAR:
            continue
        others = [
            some.lower for some in pairs if some.lower.signal == pair.lower.signal
        ]
        rates = [
            (rate(lower.values, pair.upper.values, recording.time), lower)
            for lower in others
        ]
        better = [
            (some, lower)
            for some, lower in rates
            if abs(some.slope - 1) < NEAR and some.explains_more(own)
        ]
        where = f"{recording.source}, {pair.upper.label}"
        if better:
            other = min(better, key=lambda some: float(some[0].squares.sum()))[1]
            text = f"follows the {other.label}, and the {pair.lower.label} much less: are columns exchanged?"
        elif is_one:
            continue
        elif own.relative > NEAR:
            times = f"{own.slope:.2g} ± {2 * own.error:.1g} times its derivative"
            text = f"does not follow the {pair.lower.label} (it is {times}): is this its column?"
        else:
            text = f"is {own.slope:.4g} times the derivative of the {pair.lower.label}: {_reason(pair, own.slope)}"
        found.append(warning("rates", where, text))
    return found or _common_rate(recording, pairs)


def _common_rate(recording: Recording, pairs: Sequence[_Pair]) -> list[Finding]:
    """Velocities of all joints that are the same times what they should be, as with a wrong clock."""
    told = [
        rate(p.lower.values, p.upper.values, recording.time)
        for p in pairs
        if p.upper.signal == "qd"
    ]
    told = [some for some in told if np.isfinite(some.slope) and 0 < some.error < NEAR]
    if len(told) < _SEVERAL:
        return []
    weights = np.array([some.error**-2 for some in told])
    slopes = np.array([some.slope for some in told])
    mean = float(weights @ slopes / weights.sum())
    scatter = float(np.sum(weights * (slopes - mean) ** 2) / (len(told) - 1))
    # jitter of the stamps errs all joints alike, so that many of them are no surer than one
    error = float(np.sqrt(max(scatter, 1.0) / weights.mean()))
    if abs(mean - 1) < max(_CLOCK, CLEAR * error):
        return []
    text = (
        f"velocities of all joints are {mean:.4g} ± {2 * error:.1g} times the derivatives of their positions: is the "
        f"rate {mean:.4g} times that of the time stamps?"
    )
    return [warning("rates", recording.source, text)]


def _pairs(recording: Recording, mechanism: Mechanism, usable: Flags) -> list[_Pair]:
    """Signals with their rates; NaN where samples are not usable."""
    found = []
    for low, up in (("q", "qd"), ("qd", "qdd")):
        lower = {s.name: s for s in series(recording, mechanism, low)}
        for upper in series(recording, mechanism, up):
            motion = motion_of(mechanism, upper.name)
            if (
                motion is None
                or upper.name not in lower
                or (motion.kind is MotionKind.BALL and low == "q")
            ):
                continue
            own = lower[upper.name]
            wraps = bool(np.any(np.abs(np.diff(own.values)) > WRAP)) and bool(
                np.isfinite(own.values).all()
            )
            if low == "q" and motion.kind is MotionKind.ROTATION and wraps:
                own = Series(own.signal, own.name, np.unwrap(own.values, discont=WRAP))
            own = Series(own.signal, own.name, np.where(usable, own.values, np.nan))
            found.append(_Pair(own, upper, motion.kind is MotionKind.TRANSLATION))
    return found


def _reason(pair: _Pair, slope: float) -> str:
    """What would explain a slope: a sign, or the units in which one of both, or the time, would be right."""
    if abs(slope + 1) < NEAR:
        return "one of them has the wrong sign (scale: -1)"
    lower, below, above = (
        ("the position", "", "/s")
        if pair.lower.signal == "q"
        else ("the velocity", "/s", "/s²")
    )
    readings = [("time", unit, 1 / factor(unit, "s")) for unit in ("ms", "us", "ns")]
    for unit in ("mm",) if pair.sliding else ("deg", "rev"):
        readings += [
            ("it", unit + above, 1 / factor(unit, None)),
            (lower, unit + below, factor(unit, None)),
        ]
    readings += [] if pair.sliding else [("it", "rpm", 1 / factor("rpm", None))]
    fitting = [
        f"{what} were in {unit} (unit: {unit})"
        for what, unit, size in readings
        if abs(abs(slope) / size - 1) < NEAR
    ]
    sign = ", with the wrong sign" if slope < 0 else ""
    return (
        f"as if {' or '.join(fitting)}{sign}"
        if fitting
        else "check units, ratio (scale) and the side of the gear"
    )
