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

from echelon.arrays import Floats
from echelon.errors import InputError, locating
from echelon.formats.schema.schema_log import PreparationEntry
from echelon.logs.columns.column_map import quaternion_columns, signal_names
from echelon.logs.preparation.prepare import (
    Preparation,
    cutoffs,
    measured_signal,
    rubs,
    speed_rows,
    usable,
    velocity_names,
)
from echelon.logs.recording import Segment
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.filters import (
    NEAR,
    PASSED,
    REACH,
    butterworth,
    derivative,
    lowpass,
)
from echelon.signals.spectrum import Spectrum, best_cutoff, noise_deviation, spectra

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

ROWS = 10  # rows per parameter below which none are left out

FLATTEST = (
    1 / 6
)  # share of the rate up to which derivatives are right to two thousandths

_RATES_ALIKE = 1e-3
_AGREEING = 0.05
"""Largest difference of measured from differentiated velocities, by their own size within the motion's band, that a
sensor of velocity may have; more is another signal, or one that is late or filtered."""

_REPEATED = 0.7
"""Share of their noise that velocities which were differentiated by the recorder have from the positions."""
_SHOWING_NOISE = 1 << 15  # samples that tell it
_NOISY = 0.35  # share of the rate at which noise has to begin, for it to be looked at


def chosen(preparation: PreparationEntry, log: Signals) -> Preparation:
    """Settings with every None filled in from the signals, and the reasons."""
    made = Preparation(**dict(preparation))
    for choose in (_measured, _band, with_lowpass, with_still):
        made = choose(log, made)
    return made.model_copy(update={"delays": made.delays or {}})


@dataclass(frozen=True, eq=False)
class Signals:
    """What choices look at: stretches of one rate."""

    segments: tuple[Segment, ...]
    mechanism: Mechanism

    @staticmethod
    def of(segments: Sequence[Segment], mechanism: Mechanism) -> Signals:
        """The stretches that have the rate of the longest."""
        if not segments:
            raise InputError("there is no data to choose settings from")
        longest = max(segments, key=len).rate
        alike = [
            segment
            for segment in segments
            if abs(segment.rate - longest) <= _RATES_ALIKE * longest
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
    def spectra(self) -> list[Spectrum]:
        """Spectra of every position."""
        return self.spectra_of("q")

    @cached_property
    def velocity_spectra(self) -> list[Spectrum]:
        """Spectra of every measured velocity."""
        return self.spectra_of("qd")

    def spectra_of(self, signal: str) -> list[Spectrum]:
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
        found = {k: self.spectra[k].mean_frequency(self.clean(k)) for k in self.moving}
        fastest = max(found, key=lambda k: found[k])
        return self.names[fastest], found[fastest]

    @cached_property
    def lost(self) -> tuple[str, float]:
        """The position whose acceleration is lost in noise last, and from where on, Hz."""
        found = {k: self.clean(k) for k in self.moving}
        last = max(found, key=lambda k: found[k])
        return self.names[last], found[last]

    def clean(self, column: int) -> float:
        """Where the acceleration of a position is lost in noise, Hz."""
        return best_cutoff(self.spectra[column])

    @property
    def agreeing(self) -> bool:
        """Whether velocities were logged that are those of the positions."""
        if (
            any("qd" not in segment.signals for segment in self.segments)
            or self.disagreement > _AGREEING
        ):
            return False
        if self.repeated > _REPEATED:
            return False
        return all(self.velocity_spectra[k].moves for k in self.moving)

    @cached_property
    def disagreement(self) -> float:
        """Largest rms of measured less differentiated velocities in the band of the motion, by that of the velocity."""
        edge, segment = 2 * self.fastest[1], max(self.segments, key=len)
        if edge > FLATTEST * segment.rate or quaternion_columns(
            self.mechanism, "q", len(self.names)
        ):
            return np.inf
        x, v = (
            lowpass(segment.signals[name], edge, segment.rate)[:, self.moving]
            for name in ("q", "qd")
        )
        spoilt = butterworth(edge, segment.rate).reach(NEAR) + REACH
        apart, size = (
            np.std(some[spoilt:-spoilt], axis=0)
            for some in (derivative(x, segment.rate) - v, v)
        )
        return (
            float(np.max(apart / size))
            if len(v) > 2 * spoilt and (size > 0).all()
            else np.inf
        )

    @cached_property
    def repeated(self) -> float:
        """Share of the noise of the velocities that is noise of the positions, by the nearest samples of these."""
        edge, segment = HARMONICS * self.fastest[1], max(self.segments, key=len)
        if edge > _NOISY * segment.rate or quaternion_columns(
            self.mechanism, "q", len(self.names)
        ):
            return 0.0
        parts = (
            segment.signals[name][:_SHOWING_NOISE, self.moving] for name in ("q", "qd")
        )
        q, v = (values - lowpass(values, edge, segment.rate) for values in parts)
        spoilt = butterworth(edge, segment.rate).reach(NEAR) + REACH
        inside = slice(spoilt, -spoilt)
        shares = []
        for x, y in zip(q.T, v[inside].T, strict=True):
            taps = np.column_stack(
                [np.roll(x, lag)[inside] for lag in range(-REACH, REACH + 1)]
            )
            rest = y - taps @ np.linalg.lstsq(taps, y)[0]
            shares.append(
                1 - float(rest @ rest) / max(float(y @ y), np.finfo(float).tiny)
            )
        return float(np.median(shares)) if len(v) > 2 * spoilt + 10 * REACH else 0.0

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
    if any("qd" not in segment.signals for segment in log.segments):
        return reasoned(made, "measured", (), "none: the log has no velocities")
    if quaternion_columns(log.mechanism, "q", len(log.names)):
        return reasoned(made, "measured", (), "none: orientations are differentiated")
    velocities = log.velocity_spectra
    if not all(velocities[k].moves for k in log.moving):
        return reasoned(
            made, "measured", (), "none: velocities of the log are lost in noise"
        )
    top = HARMONICS * log.fastest[1]
    from_positions, from_sensors = (
        np.array([noise_deviation(some[k], order, top) for k in log.moving])
        for some, order in ((log.spectra, 1), (velocities, 0))
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = float(np.exp(np.nanmean(np.log(from_positions / from_sensors))))
    apart = log.disagreement
    if apart > _AGREEING:
        text = f"none: the velocities of the log differ from those of its positions by {apart:.0%} of their size"
        return reasoned(made, "measured", (), text)
    if log.repeated > _REPEATED:
        text = "none: velocities of the log were computed from its positions, whose noise they repeat"
        return reasoned(made, "measured", (), text)
    if not gain > 1:
        return reasoned(
            made,
            "measured",
            (),
            f"none: they have {1 / gain:.3g} times the noise of positions",
        )
    return reasoned(
        made,
        "measured",
        ("qd",),
        f"velocities: differentiated positions have {gain:.3g} times their noise",
    )


def _band(log: Signals, made: Preparation) -> Preparation:
    if made.band is not None:
        return made
    name, mean = log.fastest
    found = HARMONICS * mean
    reason = f"{found:.3g} Hz: {HARMONICS} times {mean:.2g} Hz, the mean frequency of the velocity of {name}"
    who, lost = log.lost
    if "qd" not in (made.measured or ()) and lost < found:
        found, reason = (
            lost,
            f"{lost:.3g} Hz: above it the acceleration of {who} is lost in noise",
        )
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
    own = {k: OWN * log.clean(k) for k in log.moving}
    for first in quaternion_columns(log.mechanism, "q", len(log.names)):
        entries = range(first, first + 4)
        own |= dict.fromkeys(
            entries, max((own[k] for k in entries if k in own), default=np.inf)
        )
    floor = min(NARROWEST * log.fastest[1], made.band or 0.0)
    found = {log.names[k]: cutoff for k, cutoff in own.items() if cutoff < floor}
    listed = ", ".join(f"{name} {cutoff:.3g} Hz" for name, cutoff in found.items())
    reason = f"{listed}: {OWN:g} times where their own motion is lost in noise; the others need {floor:.3g} Hz"
    return reasoned(
        made,
        "lowpass",
        found,
        reason if found else "none: no position is lost in noise so early",
    )


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
            if rubs(log.mechanism, output)
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
