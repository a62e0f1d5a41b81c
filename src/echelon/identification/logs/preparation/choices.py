"""Settings of the preparation that follow from the signals alone, with reasons in words.

Regressor and outputs keep one band.  It has room for the motion, the products of velocities, the sines of angles and
the steps of dry friction, which is a dozen times the mean frequency of the velocities, and it ends where acceleration
is lost in noise.  Where outputs are measured, the model itself may narrow it further: see
:mod:`echelon.identification.band`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echelon.formats import PreparationEntry
from echelon.identification.logs.columns.column_map import (
    quaternion_columns,
    signal_names,
)
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    cutoffs,
    has_dry_friction,
    measured_signal,
    speed_rows,
    usable,
    velocity_names,
)
from echelon.identification.logs.recording import FEWEST, Segment
from echelon.identification.signals.clock import JITTER
from echelon.identification.signals.filters import (
    NEAR,
    PASSED,
    REACH,
    butterworth,
    derivative,
    lowpass,
)
from echelon.identification.signals.spectrum import (
    SHOWING,
    TRUSTED,
    PositionSpectrum,
    best_cutoff,
    noise_deviation,
    spectra,
)
from echelon.robot import Mechanism
from echelon.shared import Floats, InputError, locating

HARMONICS = 12
"""Times the mean frequency of the fastest velocity, up to which regressor and outputs are kept at most: on logs of five
robots, from drives of one axis to seven joints, fits to held-out data were best between 10 and 18."""

NARROWEST = 2.0
"""Times the mean frequency of the fastest velocity that a band holds at least: gravity, inertia, and products."""

OWN = 2.0
"""Low-pass over a single position, relative to where its acceleration is lost in noise: there its gain is right to
0.4 %.  It is for positions whose noise every band lets in that is wide enough for the others."""

SIGMAS = 2.0
"""Standard deviations of a velocity's noise, within which its sign says nothing; beyond, one in forty is wrong."""

ROWS = 10
"""Rows per parameter below which none are left out."""

FLATTEST = 1 / 6
"""Share of the rate up to which derivatives are right to two thousandths."""

_AGREEING = 0.05
"""Largest difference of measured from differentiated velocities, by their own size within the motion's band, that a
sensor of velocity may have; more is another signal, or one that is late or filtered."""

_REPEATED = 0.7
"""Share of their noise that velocities which were differentiated by the recorder have from the positions."""


def chosen(preparation: PreparationEntry, log: Signals) -> Preparation:
    """Settings with every None filled in from the signals, and the reasons."""
    made = Preparation(**preparation.model_dump())
    for choose in (_measured, _band, with_lowpass, with_still):
        made = choose(log, made)
    return made.model_copy(update={"delays": made.delays or {}})


@dataclass(frozen=True, eq=False)
class Signals:
    """Stretches of one rate from which settings are chosen."""

    segments: tuple[Segment, ...]
    mechanism: Mechanism

    @staticmethod
    def of(segments: Sequence[Segment], mechanism: Mechanism) -> Signals:
        """The stretches that have the rate of the longest."""
        if not segments:
            raise InputError("no data to choose settings from")
        longest = max(segments, key=len).rate
        alike = [
            segment
            for segment in segments
            if abs(segment.rate - longest) <= JITTER * longest
        ]
        return Signals(
            tuple(usable(segment, mechanism) for segment in alike), mechanism
        )

    @property
    def rate(self) -> float:
        """Samples per second."""
        return self.segments[0].rate

    @property
    def source(self) -> str:
        """The log, or the first one."""
        return self.segments[0].source

    def rows(self, made: Preparation) -> float:
        """Rows of all outputs that a band leaves."""
        samples = sum(len(segment) for segment in self.segments)
        return (
            samples
            * len(self.mechanism.outputs)
            * min(1.0, 2 * (made.band or np.inf) / PASSED / self.rate)
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the positions."""
        return signal_names(self.mechanism, "q", self.segments[0].signals["q"].shape[1])

    @cached_property
    def spectra(self) -> list[PositionSpectrum]:
        """Spectra of every position."""
        return self.spectra_of("q")

    @cached_property
    def velocity_spectra(self) -> list[PositionSpectrum]:
        """Spectra of every measured velocity."""
        return self.spectra_of("qd")

    def spectra_of(self, signal: str) -> list[PositionSpectrum]:
        """Spectra of every column of a signal."""
        with locating(self.source):
            some = (
                s.signals["q"] if signal == "q" else measured_signal(s, signal)
                for s in self.segments
            )
            return spectra(list(some), self.rate)

    @cached_property
    def moving(self) -> list[int]:
        """Positions that move."""
        found = [k for k, s in enumerate(self.spectra) if s.moves]
        if not found:
            longest = max(len(segment) for segment in self.segments) / self.rate
            problem = f"nothing moves: no position exceeds its noise in the {longest:.3g} s without a gap"
            raise InputError(problem, source=self.source)
        return found

    @cached_property
    def fastest(self) -> tuple[str, float]:
        """The position whose velocity has the highest mean frequency, and that frequency, Hz."""
        found = {k: self.spectra[k].mean_frequency(self.clean[k]) for k in self.moving}
        fastest = max(found, key=lambda k: found[k])
        return self.names[fastest], found[fastest]

    @cached_property
    def lost(self) -> tuple[str, float]:
        """The position whose acceleration is lost in noise last, and from where on, Hz."""
        found = {k: self.clean[k] for k in self.moving}
        last = max(found, key=lambda k: found[k])
        return self.names[last], found[last]

    @cached_property
    def clean(self) -> list[float]:
        """Where the accelerations of positions are lost in noise, Hz."""
        return [best_cutoff(spectrum) for spectrum in self.spectra]

    @cached_property
    def doubt(self) -> str:
        """Why velocities of the log are not those of its positions; empty if they are."""
        if any("qd" not in segment.signals for segment in self.segments):
            return "the log has no velocities"
        if quaternion_columns(self.mechanism, "q", len(self.names)):
            return "orientations are differentiated"
        if not all(self.velocity_spectra[k].moves for k in self.moving):
            return "velocities of the log are lost in noise"
        apart = self._disagreement()
        if apart is None:
            return "the rate is too low for the motion to compare velocities with positions"
        if apart > _AGREEING:
            return f"the velocities of the log differ from those of its positions by {apart:.0%} of their size"
        if self._repeated() > _REPEATED:
            return "velocities of the log were computed from its positions, whose noise they repeat"
        return ""

    def _compared(self, edge: float) -> tuple[list[Floats], list[Floats], slice]:
        """Positions and velocities of the longest stretch, below an edge, Hz, and above; and what its ends leave."""
        segment = max(self.segments, key=len)
        both = [segment.signals[name][:, self.moving] for name in ("q", "qd")]
        slow = [lowpass(values, edge, segment.rate) for values in both]
        rough = [values - low for values, low in zip(both, slow, strict=True)]
        spoilt = butterworth(edge, segment.rate).reach(NEAR) + REACH
        return slow, rough, slice(spoilt, -spoilt)

    def _disagreement(self) -> float | None:
        """Largest rms of measured less differentiated velocities in the band of the motion, by that of the velocity."""
        edge = 2 * self.fastest[1]
        if edge > FLATTEST * self.rate:
            return None
        (x, v), _, inside = self._compared(edge)
        apart, size = (
            np.std(values[inside], axis=0)
            for values in (derivative(x, self.rate) - v, v)
        )
        if len(v[inside]) and (size > 0).all():
            return float(np.max(apart / size))
        return None

    def _repeated(self) -> float:
        """Share of the noise of the velocities that is noise of the positions, by the nearest samples of these."""
        edge = HARMONICS * self.fastest[1]
        if edge > TRUSTED * self.rate:
            return 0.0
        _, (q, v), inside = self._compared(edge)
        inside = slice(inside.start, min(SHOWING, len(q) + inside.stop))
        lags = range(-REACH, REACH + 1)
        shares = []
        for x, y in zip(q.T, v[inside].T, strict=True):
            taps = np.column_stack([np.roll(x, lag)[inside] for lag in lags])
            left = y - taps @ np.linalg.lstsq(taps, y)[0]
            shares.append(
                1 - float(left @ left) / max(float(y @ y), np.finfo(float).tiny)
            )
        return float(np.median(shares)) if len(v[inside]) > FEWEST else 0.0

    def noise(self, made: Preparation) -> Floats:
        """Standard deviation of the noise that the velocity of a state has, for every velocity."""
        if "qd" in (made.measured or ()):
            own = cutoffs(
                made, self.rate, velocity_names(self.mechanism, len(self.names))
            )
            return np.array(
                [
                    noise_deviation(s, 0, c)
                    for s, c in zip(self.velocity_spectra, own, strict=True)
                ]
            )
        own = cutoffs(made, self.rate, self.names)
        noise = [
            noise_deviation(s, 1, c) for s, c in zip(self.spectra, own, strict=True)
        ]
        balls = quaternion_columns(self.mechanism, "q", len(noise))
        found: list[float] = []
        column = 0
        while column < len(noise):
            if (
                column in balls
            ):  # the angular velocity is twice the product of the quaternion with its derivative
                found += 3 * [
                    2 * float(np.sqrt(np.mean(np.square(noise[column : column + 4]))))
                ]
            else:
                found.append(noise[column])
            column += 4 if column in balls else 1
        return np.array(found)


def reasoned(made: Preparation, name: str, value: object, reason: str) -> Preparation:
    """The preparation with one more setting chosen, and why."""
    return made.model_copy(
        update={name: value, "reasons": {**made.reasons, name: reason}}
    )


def _measured(log: Signals, made: Preparation) -> Preparation:
    if made.measured is not None:
        return made
    if log.doubt:
        return reasoned(made, "measured", (), f"none: {log.doubt}")
    top = HARMONICS * log.fastest[1]
    from_positions = np.array(
        [noise_deviation(log.spectra[k], 1, top) for k in log.moving]
    )
    from_sensors = np.array(
        [noise_deviation(log.velocity_spectra[k], 0, top) for k in log.moving]
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = float(np.exp(np.nanmean(np.log(from_positions / from_sensors))))
    if not gain > 1:
        reason = f"none: velocities of the log have {1 / gain:.3g} times the noise of differentiated positions"
        return reasoned(made, "measured", (), reason)
    reason = f"velocities: differentiated positions have {gain:.3g} times their noise"
    return reasoned(made, "measured", ("qd",), reason)


def _band(log: Signals, made: Preparation) -> Preparation:
    if made.band is not None:
        return made
    name, mean = log.fastest
    found = HARMONICS * mean
    reason = f"{found:.3g} Hz: {HARMONICS} times {mean:.2g} Hz, the mean frequency of the velocity of {name}"
    who, lost = log.lost
    if "qd" not in (made.measured or ()) and lost < found:
        found = lost
        reason = f"{lost:.3g} Hz: above it the acceleration of {who} is lost in noise"
    if found > FLATTEST * log.rate:
        found = FLATTEST * log.rate
        reason = f"{found:.3g} Hz: a sixth of the rate, up to which derivatives are right to two thousandths"
    return reasoned(made, "band", found, reason)


def with_lowpass(log: Signals, made: Preparation) -> Preparation:
    """The preparation with low-passes over single positions whose noise lies where the others move."""
    if made.lowpass is not None and "lowpass" not in made.reasons:
        return made
    if "qd" in (made.measured or ()):
        return reasoned(made, "lowpass", {}, "none: velocities are measured")
    own = {k: OWN * log.clean[k] for k in log.moving}
    for first in quaternion_columns(log.mechanism, "q", len(log.names)):
        entries = range(first, first + 4)
        own |= dict.fromkeys(
            entries, max((own[k] for k in entries if k in own), default=np.inf)
        )
    floor = min(NARROWEST * log.fastest[1], made.band or 0.0)
    found = {log.names[k]: cutoff for k, cutoff in own.items() if cutoff < floor}
    listed = ", ".join(f"{name} {cutoff:.3g} Hz" for name, cutoff in found.items())
    reason = f"none: no position is lost in noise below {floor:.3g} Hz"
    if found:
        reason = f"{listed}: {OWN:g} times where their own motion is lost in noise; the others need {floor:.3g} Hz"
    return reasoned(made, "lowpass", found, reason)


def with_still(log: Signals, made: Preparation) -> Preparation:
    """The preparation with the speeds below which rows of an output leave the fit, where it leaves them open."""
    if made.still is not None and "still" not in made.reasons:
        return made
    noise = log.noise(made)
    names = velocity_names(log.mechanism, len(log.names))
    found: dict[str, float] = {}
    for output in log.mechanism.outputs:
        rows = (
            speed_rows(log.mechanism, output, names)
            if has_dry_friction(log.mechanism, output)
            else None
        )
        if rows is not None:
            found[output.name] = SIGMAS * float(np.sqrt(rows**2 @ noise**2).max())
    if not found:
        return reasoned(made, "still", 0.0, "none: no output has dry friction")
    parameters = len(log.mechanism.parameters)
    if log.rows(made) < ROWS * parameters:
        text = f"none: {log.rows(made):.0f} rows are too few for {parameters} parameters to leave any out"
        return reasoned(made, "still", 0.0, text)
    listed = ", ".join(f"{name} {value:.2g}" for name, value in found.items())
    reason = (
        f"{listed} (m/s, rad/s): {SIGMAS:g} standard deviations of the velocity's noise, within which the direction of "
        "dry friction is unknown"
    )
    return reasoned(made, "still", found, reason)
