"""Contradictions in a log: magnitudes that no robot has, and velocities that are not the rates of positions.

Where a number cannot be right (:mod:`echelon.identification.logs.columns.magnitudes`), and the column's unit was not
stated, reading
stops with the unit that would make it right.  To state the unit is to say that the number is right; then, and where
there is room for doubt, it is a finding.

A wrong sign, unit or column shows as a factor between velocities and the derivatives of positions.  That columns are
exchanged is only said where this explains clearly more than what is stated: where joints move alike, velocities follow
either.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import dropwhile

import numpy as np

from echelon.identification.logs.columns.by_values import are_numbers
from echelon.identification.logs.columns.column_map import (
    WRAP,
    Channel,
    ColumnMap,
    Series,
    motion_of,
    series,
)
from echelon.identification.logs.columns.magnitudes import (
    LARGEST,
    SMALLEST,
    fitting_units,
    is_period,
)
from echelon.identification.logs.faults.locked_joints import STILL, span
from echelon.identification.logs.files.log_file import LogFile
from echelon.identification.logs.finding import Finding, listed, warning
from echelon.identification.logs.recording import Recording
from echelon.identification.logs.units import factor
from echelon.identification.signals.chance import CLEAR, LITTLE
from echelon.identification.signals.clock import REPEATED, nominal_period
from echelon.identification.signals.rates import NEAR, common_slope, rate
from echelon.robot import GROUND, Mechanism, MotionKind, Placement, Step, known_values
from echelon.shared import Flags, InputError

_OF_WEIGHT = (1e-4, 50.0)
"""Largest torque of a log by the largest moment of the robot's weight: drives are made for its weight and motion."""


def check_plausible(
    recording: Recording, mechanism: Mechanism, columns: ColumnMap | None = None
) -> tuple[Finding, ...]:
    """Compare magnitudes with what robots do; units that were stated in the column map are believed."""
    checks = _Magnitudes(recording, mechanism, columns or ColumnMap())
    return (*checks.time(), *checks.angles(), *checks.lengths(), *checks.forces())


def surplus_columns(
    columns: ColumnMap, log: LogFile, mechanism: Mechanism
) -> tuple[Finding, ...]:
    """Positions that a file has beyond those that are used, such as ``q_7`` beside ``q_1`` … ``q_6``.

    As many as the robot has joints that never move may be there, unless they move.
    """
    names = log.names
    locked = sum(body.joint.is_fixed for body in mechanism.bodies)
    used = {channel.column for channel in columns.positions.values()}
    known = {
        channel.column
        for group in columns.channels.values()
        for channel in group.values()
    }
    known |= {name for some in columns.locked.values() for name in some.columns}
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
    if not more or len(patterns) > 1 or len(used) < 2 or are_numbers(names):
        return ()
    question = "is it a log of another robot?"
    if len(more) <= locked:
        table = next(log.tables(more), None)
        if table is None:
            return ()
        size = max(
            abs(c.scale) * factor(c.unit, None) for c in columns.positions.values()
        )
        more = [n for n in more if size * span(table.columns[n]) > STILL]
        question = "they move: are they positions of joints that the robot has locked or fixed? If so, name them under  position"
    if not more:
        return ()
    shown = listed(f"'{name}'" for name in more)
    text = (
        f"the log has {shown} beside the {len(used)} columns that are used: {question}"
    )
    return (warning("robot", "positions", text),)


@dataclass(frozen=True)
class _Magnitudes:
    """The magnitudes of a recording, beside the units that a column map states."""

    recording: Recording
    mechanism: Mechanism
    stated: ColumnMap

    def warned(self, kind: str, label: str, text: str) -> list[Finding]:
        """The finding about a channel, alone."""
        return [warning(kind, f"{self.recording.source}, {label}", text)]

    def refused(self, label: str, text: str) -> InputError:
        """The error about a channel."""
        return InputError(text, source=self.recording.source, element=label)

    def time(self) -> list[Finding]:
        """Findings about the clock; an error where another unit of the stamps would be right."""
        slow, given = "a rate that shows no dynamics", self.stated.rate
        if given is not None:
            text = f"at the stated rate of {given:g} Hz there is a sample every {1 / given:.4g} s, {slow}"
            return [] if is_period(1 / given) else self.warned("time", "time", text)
        time = self.recording.time[np.isfinite(self.recording.time)]
        if len(time) < 3 or np.mean(np.diff(time) > 0) < 1 - REPEATED:
            return []  # that stamps are in no order is said where segments are made
        period, channel = nominal_period(time), self.stated.time or Channel("")
        if is_period(period) or channel.unit == "s":
            return []
        raw = period / factor(channel.unit, "s")
        unit = next(iter(fitting_units(raw)), "")
        text = f"by its time stamps the log has a sample every {period:.4g} s"
        if unit and self.stated.time is not None and not channel.unit:
            samples = 1 / (raw * factor(unit, "s"))
            question = (
                f"is time in {unit} (unit: {unit}; {samples:.4g} samples per second)?"
            )
            text = f"{text}: {question} If it really is in seconds, write unit: s"
            raise self.refused(f"column '{channel.column}'", text)
        return self.warned(
            "time", "time", text + (f": is time in {unit}?" if unit else f", {slow}")
        )

    def angles(self) -> list[Finding]:
        """Findings about the positions of turning joints; an error where most go farther than joints do."""
        turning, stated = self._positions(MotionKind.ROTATION), self.stated.positions
        far = [
            channel
            for channel in turning
            if _largest(channel) > LARGEST["rad"] and _unstated(stated, channel)
        ]
        if far:
            most = max(map(_largest, far))
            question = (
                "are they in degrees (unit: deg)?"
                if most <= math.degrees(LARGEST["rad"])
                else "are they encoder counts (scale), or those of motors (state actuators and name these)?"
            )
            names = listed(f"'{channel.name}'" for channel in far)
            text = f"{names}: angles up to {most:.4g} rad are {most / math.tau:.3g} turns: {question}"
            if len(far) > 1 and 2 * len(far) > len(turning):
                raise self.refused(
                    "positions", f"{text} If they are right, write unit: rad"
                )
            return self.warned("units", "positions", text)
        most = max(map(_range, turning), default=math.inf)
        units = [stated[c.name].unit if c.name in stated else "" for c in turning]
        if most < SMALLEST["rad"] and all(
            factor(unit, "rad") == math.radians(1) for unit in units
        ):
            question = "are the columns in rad (leave out unit: deg)?"
            text = f"no joint turns by more than {math.degrees(most):.3g}°: {question}"
            return self.warned("units", "positions", text)
        return []

    def lengths(self) -> list[Finding]:
        """Findings about the positions of sliding joints; an error where one slides farther than joints do."""
        findings, stated = [], self.stated.positions
        for channel in self._positions(MotionKind.TRANSLATION):
            most, moved = _largest(channel), _range(channel)
            if most > LARGEST["m"] and _unstated(stated, channel):
                problem = f"it goes to {most:.4g} m: is it in mm (unit: mm)?  If it is right, write unit: m"
                raise self.refused(channel.label, problem)
            unit = stated[channel.name].unit if channel.name in stated else ""
            if factor(unit, "m") < 0.1 and 0 < moved < SMALLEST["m"]:
                text = f"moves by {moved * 1e3:.3g} mm only: is the column in m (leave out unit: {unit})?"
                findings += self.warned("units", channel.label, text)
        return findings

    def forces(self) -> list[Finding]:
        """Findings about torques beside the robot's weight; an error where they are those of no drive."""
        units = {output.name: output.unit for output in self.mechanism.outputs}
        torques = []
        for channel in self._numbers("y"):
            unit, most = units[channel.name], _largest(channel)
            if most > LARGEST.get(unit, math.inf) and _unstated(
                self.stated.outputs, channel
            ):
                problem = (
                    f"it goes to {most:.4g} {unit}: is it in m{unit} (unit: m{unit})?"
                )
                raise self.refused(
                    channel.label, f"{problem}  If it is right, write unit: {unit}"
                )
            if unit == "N·m":
                torques.append(most)
        static = _largest_static_torque(self.mechanism)
        if static is None or not torques:
            return []
        text = (
            f"torques go to {max(torques):.3g} N·m, where the weight of the described robot makes {static:.3g} N·m at "
            "most: are they in "
        )
        least, most = _OF_WEIGHT
        if max(torques) > most * static:
            return self.warned(
                "units", "outputs", f"{text}mN·m, or is this another robot's log?"
            )
        if max(torques) < least * static and not self.mechanism.actuators:
            return self.warned(
                "units", "outputs", f"{text}kN·m, or those of motors before gears?"
            )
        return []

    def _numbers(self, signal: str) -> list[Series]:
        """The channels of a signal that hold numbers."""
        return [
            s
            for s in series(self.recording, self.mechanism, signal)
            if np.isfinite(s.values).any()
        ]

    def _positions(self, kind: MotionKind) -> list[Series]:
        """Positions of joints that turn or slide; not of those that slide freely in space, and of rotors."""
        free: set[str] = set()
        for body in self.mechanism.bodies:
            if body.joint.kind == "rotor":
                free.update(motion.name for motion in body.joint.motions)
            if any(motion.kind is MotionKind.BALL for motion in body.joint.motions):
                slides = [
                    motion
                    for motion in body.joint.motions
                    if motion.kind is MotionKind.TRANSLATION
                ]
                free.update(name for motion in slides for name in motion.positions)
        found = [
            (s, motion_of(self.mechanism, s.name))
            for s in self._numbers("q")
            if s.name not in free
        ]
        return [s for s, motion in found if motion is not None and motion.kind is kind]


def _largest(channel: Series) -> float:
    return float(
        np.max(np.abs(channel.values), where=np.isfinite(channel.values), initial=0.0)
    )


def _range(channel: Series) -> float:
    return float(np.ptp(channel.values[np.isfinite(channel.values)]))


def _unstated(channels: Mapping[str, Channel], channel: Series) -> bool:
    """Whether the column of a coordinate, or one at a motor that may be behind it, has no unit."""
    own = (
        [channels[channel.name]]
        if channel.name in channels
        else list(channels.values())
    )
    return not own or any(not stated.unit for stated in own)


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
    largest = factor("kgf", "N") * max(moments, default=0.0)
    return largest if 0 < largest < math.inf else None


def _is_placed(step: Step) -> bool:
    return isinstance(step, Placement)


def _length(steps: Iterable[Step], known: Mapping[str, float]) -> float:
    """The longest way that steps lead, m; inf where nobody states it."""
    ways = [step.translation for step in steps if isinstance(step, Placement)]
    stated = all(
        name in known for way in ways for entry in way for name in entry.symbols()
    )
    return (
        sum(math.hypot(*(entry.at(known) for entry in way)) for way in ways)
        if stated
        else math.inf
    )


@dataclass(frozen=True)
class _RatedSeries:
    """A signal and what should be its rate."""

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


def _common_rate(recording: Recording, pairs: Sequence[_RatedSeries]) -> list[Finding]:
    """Velocities of all joints that are the same times what they should be, as with a wrong clock."""
    told = [
        rate(p.lower.values, p.upper.values, recording.time)
        for p in pairs
        if p.upper.signal == "qd"
    ]
    told = [some for some in told if np.isfinite(some.slope) and 0 < some.error < NEAR]
    if len(told) < 2:
        return []
    mean, error = common_slope(told)
    error *= math.sqrt(
        len(told)
    )  # jitter of the stamps errs all joints alike: many of them are no surer than one
    if abs(mean - 1) < max(LITTLE, CLEAR * error):
        return []
    text = (
        f"velocities of all joints are {mean:.4g} ± {2 * error:.1g} times the derivatives of their positions: is the "
        f"rate {mean:.4g} times that of the time stamps?"
    )
    return [warning("rates", recording.source, text)]


def _pairs(
    recording: Recording, mechanism: Mechanism, usable: Flags
) -> list[_RatedSeries]:
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
                own = replace(own, values=np.unwrap(own.values, discont=WRAP))
            own = replace(own, values=np.where(usable, own.values, np.nan))
            found.append(
                _RatedSeries(own, upper, motion.kind is MotionKind.TRANSLATION)
            )
    return found


def _reason(pair: _RatedSeries, slope: float) -> str:
    """An explanation of a slope: a sign, or the units in which one of both, or the time, would be right."""
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
