"""Faults of a log: what sensors, drives and loggers do wrong, found channel by channel and named.

Only what is certainly no measurement is taken out: values that are not finite, quaternions of length zero, spikes of
one or two samples, sensors that stand still while the robot moves.  Everything else is reported, because only the user
knows whether it is a fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from echelon.identification.logs.columns.column_map import (
    Series,
    motion_of,
    quaternion_columns,
    series,
)
from echelon.identification.logs.columns.conversion import is_contact_input, unpushed
from echelon.identification.logs.faults.outliers import NO_ENCODER, TALL, jumps, spikes
from echelon.identification.logs.faults.plausibility import contradictions
from echelon.identification.logs.faults.repeated_values import (
    held,
    pinned,
    resolution,
    runs,
    stuck,
)
from echelon.identification.logs.finding import (
    Finding,
    Severity,
    counted,
    listed,
    seconds,
)
from echelon.identification.logs.recording import FEWEST, Recording
from echelon.identification.signals.chance import LITTLE
from echelon.identification.signals.clock import GAP, nominal_period, round_rate
from echelon.identification.signals.filters import FAR_FROM_UNIT
from echelon.identification.signals.spectrum import white_noise
from echelon.robot import Mechanism, MotionKind
from echelon.shared import Flags, Floats, InputError

_COARSE = 0.3
"""Ratio of an encoder's step to the rms of what a position changes by per sample, from which on derivatives suffer."""

_CUT = int(GAP / 2) + 1
"""Samples that are taken out on both sides of a jump, so that a stretch ends there."""


def examine(
    recording: Recording,
    mechanism: Mechanism,
    *,
    whole: bool = True,
    named: bool = True,
) -> tuple[tuple[Finding, ...], Flags]:
    """Findings about a recording, and which of its samples (N,) are usable.

    Of a piece of a log, ``whole=False``, nothing is said about channels that never change.  Where nobody asks for
    findings, ``named=False``, only what takes samples out is looked for.
    """
    if not len(recording.time):
        raise InputError("the log has no samples", source=recording.source)
    found = _Examination(recording, mechanism, whole, np.isfinite(recording.time))
    found.look_for_numbers()
    found.look_for_quaternions()
    y = recording.signals.get("y")
    if (
        whole
        and y is not None
        and y.size
        and found.usable.any()
        and not np.any(y[found.usable])
    ):
        problem = "all measured outputs are zero, so there is nothing to identify: are these the right columns?"
        raise InputError(problem, source=recording.source)
    found.look_for_constants()
    found.look_for_spikes()
    found.look_for_jumps()
    awake = found.awake()
    if not named:
        return (), found.usable & awake
    found.look_for_duplicates()
    found.look_for_saturation()
    found.usable &= awake
    found.look_at_resolution()
    found.look_for_holds()
    return (
        *found.findings,
        *contradictions(found.recording, mechanism, found.usable),
    ), found.usable


@dataclass
class _Examination:
    """A recording with what has been found so far."""

    recording: Recording
    mechanism: Mechanism
    whole: bool
    usable: Flags  # shape (N,)
    findings: list[Finding] = field(default_factory=list)
    moving: Sequence[Series] = ()  # channels that change

    def say(
        self,
        kind: str,
        label: str,
        text: str,
        row: int | None = None,
        severity: Severity = Severity.WARNING,
    ) -> None:
        """Add a finding about a channel, from a row on."""
        since = (
            ""
            if row is None
            else f", from {seconds(float(self.recording.time[row]))} s"
        )
        self.findings.append(
            Finding(severity, kind, f"{self.recording.source}, {label}{since}", text)
        )

    def used(self, values: Floats) -> Floats:
        """The usable values, which are not copied where all are."""
        return values if self.usable.all() else values[self.usable]

    def of(self, *signals: str) -> list[Series]:
        """The channels of some signals that change."""
        return [channel for channel in self.moving if channel.signal in signals]

    def motion(self, channel: Series) -> MotionKind | None:
        """How the joint of a position moves; None for other signals."""
        motion = (
            motion_of(self.mechanism, channel.name) if channel.signal == "q" else None
        )
        return None if motion is None else motion.kind

    def look_for_numbers(self) -> None:
        """Take out samples that are not finite, for which differences would warn."""
        timeless = ~self.usable
        if timeless.any():
            text = f"{counted(int(timeless.sum()), 'sample')} without a time; left out"
            where = f"{self.recording.source}, time, row {int(np.argmax(timeless))}"
            self.findings.append(Finding(Severity.WARNING, "not finite", where, text))
        for channel in series(self.recording, self.mechanism):
            good = np.isfinite(channel.values) | timeless
            if good.all():
                continue
            if self.whole and not np.isfinite(channel.values).any():
                problem = "it holds no numbers, only NaN"
                raise InputError(
                    problem, source=self.recording.source, element=channel.label
                )
            starts, stops = runs(~good)
            text = (
                f"{counted(int(np.sum(~good)), 'sample')} not finite (NaN or infinite), in "
                f"{counted(len(starts), 'run')} of up to {int((stops - starts).max())}; left out"
            )
            self.say("not finite", channel.label, text, int(starts[0]))
            self.usable &= good
        if not self.usable.all():
            parts = (self.recording.signals, self.recording.inputs)
            signals, inputs = (
                {name: _finite(values) for name, values in part.items()}
                for part in parts
            )
            time = _finite(self.recording.time)
            self.recording = replace(
                self.recording, time=time, signals=signals, inputs=inputs
            )

    def look_for_quaternions(self) -> None:
        """Take out quaternions that are none; those of nearly unit length are normalised later."""
        q = self.recording.signals["q"]
        positions = list(series(self.recording, self.mechanism, "q"))
        for first in quaternion_columns(self.mechanism, "q", q.shape[1]):
            length = np.linalg.norm(q[:, first : first + 4], axis=1)
            off = np.abs(length - 1)
            label = Series("q", positions[first].name.removesuffix(".w"), length).label
            wrong = (
                off > FAR_FROM_UNIT
            )  # false where it is NaN, which is reported elsewhere
            if wrong.any():
                self.usable &= ~wrong
                text = (
                    f"{counted(int(wrong.sum()), 'sample')} with a quaternion of length {length[wrong].min():.3g} to "
                    f"{length[wrong].max():.3g} instead of 1; left out.  Are these columns w, x, y, z?"
                )
                self.say("quaternion", label, text, int(np.argmax(wrong)))
            elif np.any(off > LITTLE):
                text = f"quaternions have lengths from {np.nanmin(length):.6g} to {np.nanmax(length):.6g}; normalised"
                self.say(
                    "quaternion",
                    label,
                    text,
                    int(np.argmax(off > LITTLE)),
                    Severity.NOTE,
                )

    def look_for_constants(self) -> None:
        """Report channels that never change, and keep the others for what follows."""
        moving, silent = [], set(unpushed(self.mechanism))
        for channel in series(self.recording, self.mechanism):
            if is_contact_input(channel.name) or (
                channel.name in silent and channel.signal == "y"
            ):
                continue
            values = self.used(channel.values)
            if len(values) and np.ptp(values) > 0:
                moving.append(channel)
            elif self.whole and len(values) > 1:
                question = {
                    "q": "parameters that only its motion excites cannot be identified; if the joint rests, write  "
                    f"locked: {{{channel.name}: {values[0]:.6g}}}",
                    "y": "is the sensor connected, and is this its column?",
                }.get(channel.signal, "is this its column?")
                text = f"is {values[0]:.6g} in all {len(values)} samples: {question}"
                self.say("constant", channel.label, text)
        self.moving = moving

    def look_for_spikes(self) -> None:
        """Take out samples that leave the course of a channel and return at once."""
        for channel in self.of(*TALL):
            turns = self.motion(channel) is MotionKind.ROTATION
            places = spikes(self.used(channel.values), TALL[channel.signal], turns)
            if len(places):
                places = np.flatnonzero(self.usable)[places]
                self.usable[places] = False
                samples = counted(len(places), "outlier")
                self.say(
                    "spikes",
                    channel.label,
                    f"{samples} far from the neighbouring samples; left out",
                    places[0],
                )

    def look_for_jumps(self) -> None:
        """Take out where positions change as no joint can between two samples."""
        found: dict[int, list[Series]] = {}
        for channel in self.of("q"):
            kind = self.motion(channel)
            if kind is not MotionKind.BALL:
                places = jumps(
                    self.recording.time,
                    channel.values,
                    self.usable,
                    kind is MotionKind.ROTATION,
                )
                for place in places.tolist():
                    found.setdefault(place, []).append(channel)
        for place, (first, *others) in found.items():
            size = first.values[place + 1] - first.values[place]
            if others:
                names = listed(channel.name for channel in others)
                text = f"jumps by {size:.4g} between two samples, with {names}: are samples missing?"
            else:
                text = (
                    f"jumps by {size:.4g} between two samples: was the encoder set to another zero?  Use the part "
                    "before or after it, or give each part as a file of its own, with the offset of each"
                )
            self.say("gap" if others else "contradiction", first.label, text, place + 1)
            self.usable[max(place - _CUT, 0) : place + _CUT + 2] = False

    def awake(self) -> Flags:
        """Samples (N,) at which no sensor is stuck."""
        awake = np.ones(len(self.usable), dtype=bool)
        time, speeds = (
            self.recording.time,
            {channel.name: channel.values for channel in self.of("qd")},
        )
        for channel in self.of("q", "y"):
            others = [other.values for other in self.of("q") if other is not channel]
            is_output = channel.signal == "y"
            speed = None if is_output else speeds.get(channel.name)
            for start, stop in stuck(
                time, channel.values, others, speed, self.usable, is_output
            ):
                awake[start:stop] = False
                text = (
                    f"stays at exactly {channel.values[start]:.6g} until {seconds(time[stop - 1])} s "
                    f"({counted(stop - start, 'sample')}) while the robot moves: the sensor is stuck; left out"
                )
                self.say("stuck", channel.label, text, start)
        return awake

    def look_for_duplicates(self) -> None:
        """Report columns that were taken twice."""
        groups: dict[bytes, list[Series]] = {}
        for channel in self.moving:
            groups.setdefault(self.used(channel.values).tobytes(), []).append(channel)
        for first, *others in groups.values():
            signals = {channel.signal for channel in (first, *others)}
            # friction that grows with the load has the output as its input
            loads = signals == {"y", "input"} and {
                channel.name for channel in others
            } == {first.name}
            # two joints may well be asked to move alike, but they will not
            if others and signals != {"reference"} and not loads:
                labels = listed(channel.label for channel in others)
                text = f"has the same values as {labels} in every sample: was one column used twice?"
                self.say("duplicate", first.label, text)

    def look_for_saturation(self) -> None:
        """Report outputs that are pinned at their extremes while the robot moves."""
        motion = [channel.values for channel in self.of("q")]
        for channel in self.of("y"):
            for limit, starts, stops in pinned(channel.values, self.usable):
                stretches = list(zip(starts, stops, strict=True))
                if not any(
                    np.ptp(values[a:b]) > 0 for a, b in stretches for values in motion
                ):
                    continue
                count = int((stops - starts).sum())
                text = (
                    f"is pinned at its extreme {limit:.6g} in {counted(count, 'sample')} "
                    f"({count / len(self.usable):.2%}), in runs of up to {int((stops - starts).max())}: rows of this "
                    "output are left out there"
                )
                self.say("saturation", channel.label, text, int(starts[0]))

    def look_at_resolution(self) -> None:
        """Note encoders that are coarse, and positions without the noise or the steps that every encoder has."""
        positions = [
            (channel.label, self.used(channel.values)) for channel in self.of("q")
        ]
        for label, values in positions:
            step = resolution(values)
            if step and step > _COARSE * float(np.sqrt(np.mean(np.diff(values) ** 2))):
                text = f"comes in steps of {step:.4g}, coarse for its motion: derivatives need a low cut-off"
                self.say("resolution", label, text, severity=Severity.NOTE)
        if not positions or self.usable.sum() <= FEWEST:
            return
        noise = max(white_noise(values) for _, values in positions)
        if noise < NO_ENCODER:
            text = (
                f"their noise is at most {noise:.1g} (rad, m), less than any encoder has: they were smoothed, "
                "commanded or simulated, and may differ from the real motion"
            )
            self.say("smooth", "positions", text, severity=Severity.NOTE)

    def look_for_holds(self) -> None:
        """Report positions that were taken at a lower rate and held."""
        count = held([self.used(channel.values) for channel in self.of("q")])
        time = self.recording.time[self.usable]
        if count > 1 and np.any(np.diff(time) > 0):
            rate = round_rate(nominal_period(time) * count)
            text = (
                f"change only every {count} samples: they were taken at {rate:g} Hz and held, so derivatives show the "
                f"steps; resample (rate: {rate:g}), or log at that rate"
            )
            self.say("held", "positions", text)


def _finite(values: Floats) -> Floats:
    """Values with NaN for all that is not finite: differences of infinities would warn."""
    return (
        values
        if np.isfinite(values).all()
        else np.where(np.isfinite(values), values, np.nan)
    )
