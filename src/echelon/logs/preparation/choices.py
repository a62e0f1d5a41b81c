"""Settings of the preparation that follow from the data, with reasons in words.

Positions are filtered where acceleration is lost in noise.  Regressor and torques are filtered far below that, because
noise of torques begins where the motion ends.  That is after a dozen times the mean frequency of the velocities, which
leaves room for their products, for the sines of angles and for the steps of dry friction.  Samples beyond what this
band needs are redundant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, prod

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, locating
from echelon.formats.schema.schema_log import PreparationEntry
from echelon.logs.columns.quantities import motion_of, quaternion_columns, signal_names
from echelon.logs.preparation.prepare import RATES_ALIKE, WORTH, decimation_stages, rubs, speed_rows
from echelon.logs.preparation.settings import Preparation
from echelon.logs.preparation.states import usable, velocity_names
from echelon.logs.recording import Segment
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.filters import PASSED
from echelon.signals.periods import find_period
from echelon.signals.spectrum import Spectrum, best_cutoff, noise_deviation, spectrum

HARMONICS = 12
"""Times the mean frequency of the fastest velocity, up to which regressor and outputs are kept: on logs of five robots,
from drives of one axis to seven joints, fits to held-out data were best between 10 and 18."""

SIGMAS = 3.0
"""Standard deviations of a velocity's noise, within which its sign says nothing."""

ROWS = 10
"""Rows per parameter that decimation leaves at least."""


def chosen(preparation: PreparationEntry, segments: Sequence[Segment], mechanism: Mechanism) -> Preparation:
    """Settings with every None filled in from the data, and the reasons; of several rates that of the longest."""
    data = _Data(_checked(segments, mechanism), mechanism)
    made = Preparation(**dict(preparation))
    for choose in (_period, _cutoff, _output_cutoff, _decimation, _still):
        made = choose(data, made)
    return made.model_copy(update={"delays": made.delays or {}, "chosen_at": data.rate})


def _checked(segments: Sequence[Segment], mechanism: Mechanism) -> tuple[Segment, ...]:
    if not segments:
        raise InputError("there is no data to choose settings from")
    longest = max(segments, key=len).rate
    alike = [segment for segment in segments if abs(segment.rate - longest) <= RATES_ALIKE * longest]
    return tuple(usable(segment, mechanism) for segment in alike)


@dataclass(frozen=True, eq=False)
class _Data:
    """What choices look at."""

    segments: tuple[Segment, ...]
    mechanism: Mechanism

    @property
    def rate(self) -> float:
        return self.segments[0].rate

    @property
    def samples(self) -> int:
        return sum(len(segment) for segment in self.segments)

    @property
    def source(self) -> str:
        return self.segments[0].source

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the positions."""
        return signal_names(self.mechanism, "q", self.segments[0].signals["q"].shape[1])

    @cached_property
    def spectra(self) -> list[Spectrum]:
        """Spectra of every position."""
        return self.spectra_of("q")

    def spectra_of(self, signal: str) -> list[Spectrum]:
        """Spectra of every column of a signal."""
        columns = self.segments[0].signals[signal].shape[1]
        with locating(self.source):
            return [spectrum([s.signals[signal][:, k] for s in self.segments], self.rate) for k in range(columns)]

    @cached_property
    def moving(self) -> list[int]:
        """Positions that move."""
        found = [k for k, s in enumerate(self.spectra) if s.moves]
        if not found:
            longest = max(len(segment) for segment in self.segments) / self.rate
            problem = f"nothing moves: no position exceeds its noise in the {longest:.3g} s without a gap"
            raise InputError(problem, source=self.source)
        return found


def _reasoned(made: Preparation, name: str, value: object, reason: str) -> Preparation:
    return made.model_copy(update={name: value, "reasons": {**made.reasons, name: reason}})


def _period(data: _Data, made: Preparation) -> Preparation:
    if made.period is not None or not (made.average or made.derivative == "fourier"):
        return made
    longest = max(data.segments, key=len)
    with locating(data.source):
        period = find_period(longest.signals["q"], data.rate)
    times = len(longest) / data.rate / period
    return _reasoned(made, "period", period, f"{period:.6g} s: after it the motion repeats itself, {times:.3g} times")


def _cutoff(data: _Data, made: Preparation) -> Preparation:
    if made.cutoff is not None:
        return made
    best = {k: best_cutoff(data.spectra[k], 2, made.order) for k in data.moving}
    highest = max(best, key=lambda k: best[k])
    if not isfinite(best[highest]):
        clean = [k for k in best if not isfinite(best[k])]
        best.update({k: _clean(data.spectra[k]) for k in clean})
        highest = max(best, key=lambda k: best[k])
        if len(clean) == len(best) and made.derivative == "central":
            return _reasoned(made, "cutoff", np.inf, "none: the positions have no noise that a filter could take away")
    noise = noise_deviation(data.spectra[highest])
    name = data.names[highest]
    reason = (
        f"{best[highest]:.3g} Hz: above it the acceleration of {name} is lost in noise, of which its position has "
        f"{noise:.2g} {_unit(data.mechanism, name)} (standard deviation)"
    )
    return _reasoned(made, "cutoff", best[highest], reason)


def _clean(found: Spectrum) -> float:
    """A cut-off for a position without noise, where others have some: far above its motion."""
    return float(min(3 * found.band_edge(0.999, 2), 0.4 * found.rate))


def _unit(mechanism: Mechanism, name: str) -> str:
    motion = motion_of(mechanism, name)
    return "m" if motion is not None and motion.kind is MotionKind.TRANSLATION else "rad"


def _output_cutoff(data: _Data, made: Preparation) -> Preparation:
    if made.output_cutoff is not None:
        return made
    given = prod(made.decimation or ())
    if given > 1 and made.output_filter == "chebyshev":
        return _reasoned(made, "output_cutoff", np.inf, "what the decimation leaves")
    below = made.cutoff if made.cutoff is not None else np.inf
    frequencies = {k: data.spectra[k].mean_frequency(below) for k in data.moving}
    fastest = max(frequencies, key=lambda k: frequencies[k])
    found = HARMONICS * frequencies[fastest]
    reason = (
        f"{found:.3g} Hz: {HARMONICS} times {frequencies[fastest]:.2g} Hz, the mean frequency of the velocity of "
        f"{data.names[fastest]}"
    )
    most = PASSED * data.rate / given / 2
    if given > 1 and found > most:
        return _reasoned(made, "output_cutoff", most, f"{most:.3g} Hz: the band that decimation by {given} leaves")
    if found > WORTH * data.rate:
        return _reasoned(made, "output_cutoff", np.inf, "none: the motion fills the band of the log")
    return _reasoned(made, "output_cutoff", found, reason)


def _decimation(data: _Data, made: Preparation) -> Preparation:
    if made.decimation is not None:
        return made
    cutoff = made.output_cutoff if made.output_cutoff is not None else np.inf
    factor = max(1, int(PASSED * data.rate / 2 / cutoff)) if isfinite(cutoff) else 1
    rows = data.samples * len(data.mechanism.outputs)
    enough = ROWS * max(1, len(data.mechanism.parameters))
    reason = f"a band of {cutoff:.3g} Hz needs no more than one sample of {factor}"
    if factor > max(1, rows // enough):
        factor = max(1, rows // enough)
        reason = f"one sample of {factor}, which leaves {ROWS} rows per parameter"
    if factor == 1:
        return _reasoned(made, "decimation", (), "none: every sample is needed")
    return _reasoned(made, "decimation", decimation_stages(factor, made.output_filter), reason)


def _still(data: _Data, made: Preparation) -> Preparation:
    if made.still is not None:
        return made
    noise = _velocity_noise(data, made)
    names = velocity_names(data.mechanism, len(data.names))
    found: dict[str, float] = {}
    for output in data.mechanism.outputs:
        rows = speed_rows(data.mechanism, output, names) if rubs(data.mechanism, output) else None
        if rows is not None:
            found[output.name] = SIGMAS * float(np.sqrt(rows**2 @ noise**2).max())
    if not found:
        return _reasoned(made, "still", 0.0, "none: no output has dry friction")
    listed = ", ".join(f"{name} {value:.2g}" for name, value in found.items())
    reason = (
        f"{listed} (m/s, rad/s): {SIGMAS:g} standard deviations of the velocity's noise, within which the direction of "
        "dry friction is unknown"
    )
    return _reasoned(made, "still", found, reason)


def _velocity_noise(data: _Data, made: Preparation) -> Floats:
    """Standard deviation of the noise of every velocity, within the band of the rows, which are means over it."""
    cutoff = min(made.cutoff or np.inf, made.output_cutoff or np.inf)
    if "qd" in made.measured and "qd" in data.segments[0].signals:
        return np.array([noise_deviation(s, 0, cutoff, made.order) for s in data.spectra_of("qd")])
    noise = [noise_deviation(s, 1, cutoff, made.order) for s in data.spectra]
    balls = quaternion_columns(data.mechanism, "q", len(noise))
    found: list[float] = []
    column = 0
    while column < len(noise):
        if column in balls:  # the angular velocity is twice the product of the quaternion with its derivative
            found += 3 * [2 * float(np.sqrt(np.mean(np.square(noise[column : column + 4]))))]
        else:
            found.append(noise[column])
        column += 4 if column in balls else 1
    return np.array(found)
