"""Spectra of measured positions: where motion ends and noise begins, and the cut-off that follows.

Noise of position sensors is white at best (quantisation, electronics) and coloured after somebody's filter, but one
thing can be relied on: as velocity it does not fall with frequency.  Motion does, as soon as inertia rules.  So the
largest non-decreasing function below the spectrum of velocity is a floor for the noise that needs no band without
motion, and what stands above it is motion.

With both known, the cut-off is the one whose filter does least harm to the acceleration, which needs it most: the
motion that the filter takes away plus the noise that it lets through is smallest.  This is Wiener's criterion among
Butterworth filters; the droop of the filter below its cut-off counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import comb, sqrt

import numpy as np
import numpy.typing as npt

from echelon.identification.signals.chance import CLEAR, normal_deviation
from echelon.identification.signals.filters import ORDER
from echelon.shared import Flags, Floats, InputError, extra

_WINDOWS = 4
"""Windows, without overlap, into which a signal is cut: fewer have no mean, more no resolution."""

LEAST_SAMPLES = 16 * _WINDOWS
"""Fewest samples of a spectrum, for eight frequencies."""

SHOWING = 1 << 15
"""Samples that show noise, resolution and spectrum of a channel; more would only cost time."""

_POINTS = 8
"""Points per octave of the smoothed spectrum, which the floor is taken from: each is a median of many values."""

_CUTOFFS = 120
"""Cut-offs that are tried: the error of an acceleration is flat near its least value."""

_HIGHEST = 0.45
"""Highest cut-off of a Butterworth filter, as a share of the rate; finite filters need more room for a transition."""

_BEYOND_DOUBT = 100.0
"""Ratio to the floor that every stretch of motion has somewhere; lower humps are vibrations or colour of noise."""

TRUSTED = 0.35
"""Share of the rate up to which noise is trusted not to fall as velocity; filters before sampling work above it."""


@dataclass(frozen=True, eq=False)
class PositionSpectrum:
    """Power spectral density of a position, divided into motion and noise."""

    rate: float  # samples per second
    frequencies: Floats  # shape (F,); Hz, without zero
    power: (
        Floats  # shape (F,); one-sided density of the position, its unit squared per Hz
    )
    noise: Floats  # shape (F,); the part of it that is noise

    @property
    def motion(self) -> Floats:
        """Power above the noise, shape (F,)."""
        return np.maximum(self.power - self.noise, 0.0)

    @property
    def moves(self) -> bool:
        """Whether there is any motion."""
        return bool(np.any(self.motion > 0))

    def filter_error(self, cutoffs: Floats) -> Floats:
        """Mean square error of accelerations after low-passes of some cut-offs, by the motion's mean square."""
        weight = (2 * np.pi * self.frequencies) ** 4
        motion, noise = self.motion * weight, self.noise * weight
        exponents = 2 * ORDER * (np.log(self.frequencies) - np.log(cutoffs)[:, None])
        passed = 1 / (1 + np.exp(exponents))  # faster than powers
        error = (1 - passed) ** 2 @ motion + passed**2 @ noise
        total = float(motion.sum())
        return np.asarray(error / total if total > 0 else error)

    def mean_frequency(self, below: float = np.inf) -> float:
        """Mean frequency of the velocity by Rice's formula, σ(ẍ) / (2π σ(ẋ)), Hz, over frequencies up to ``below``."""
        power = self.motion * self.frequencies**2 * (self.frequencies <= below)
        total = float(power.sum())
        if total > 0:
            return float(np.sqrt(float(power @ self.frequencies**2) / total))
        return 0.0


def spectrum(values: npt.ArrayLike | Sequence[Floats], rate: float) -> PositionSpectrum:
    """Spectrum of a position (N,) and of its noise, from one stretch or from several between gaps."""
    pieces = values if isinstance(values, list | tuple) else [values]
    return spectra(
        [np.asarray(piece, dtype=np.float64)[:, None] for piece in pieces], rate
    )[0]


def spectra(pieces: Sequence[Floats], rate: float) -> list[PositionSpectrum]:
    """Spectra of positions (N, columns) and of their noise, from one stretch or from several between gaps."""
    longest = max((len(piece) for piece in pieces), default=0)
    if longest < LEAST_SAMPLES:
        raise InputError(
            f"{longest} samples are too few for a spectrum; at least {LEAST_SAMPLES} are needed"
        )
    frequencies, densities = _differences(
        pieces, rate, min((longest - 1) // _WINDOWS, SHOWING)
    )
    smooth = np.maximum(_medians(frequencies, densities), np.finfo(float).tiny)
    return [
        _divided(rate, frequencies, *parts)
        for parts in zip(densities.T, smooth.T, strict=True)
    ]


def _divided(
    rate: float, frequencies: Floats, density: Floats, smooth: Floats
) -> PositionSpectrum:
    """A position's spectrum, divided into motion and noise, from that of its differences, also smoothed."""
    step = 2 * np.sin(np.pi * frequencies / rate)
    power = density / step**2
    floor = np.where(frequencies < TRUSTED * rate, smooth, np.inf)
    rising = np.minimum(np.minimum.accumulate(floor[::-1])[::-1], smooth)
    moves, floor = _stretches(smooth / rising), rising / step**2
    knee = best_cutoff(
        PositionSpectrum(rate, frequencies, power, np.where(moves, floor, power))
    )
    flat = floor[min(int(np.searchsorted(frequencies, knee)), len(floor) - 1)]
    floor = np.where(frequencies < knee, np.minimum(floor, flat), floor)
    return PositionSpectrum(
        rate, frequencies, power, np.where(moves, np.minimum(floor, power), power)
    )


def _differences(
    pieces: Sequence[Floats], rate: float, length: int
) -> tuple[Floats, Floats]:
    """Frequencies without zero, shape (F,), and the mean spectra of differences, shape (F, columns).

    Slow motion is so much stronger than the noise that it would leak over all of it if it were not differenced first;
    differenced twice, noise would leak over the motion.
    """
    with extra("identify"):
        from scipy.signal import welch

    total, weights = np.zeros((length // 2, pieces[0].shape[1])), 0
    for piece in pieces:
        if len(piece) > length:
            rises = np.diff(piece, axis=0)
            f, density = welch(
                rises,
                rate,
                window="blackman",
                nperseg=length,
                detrend="constant",
                axis=0,
            )
            total += len(piece) * density[1 : length // 2 + 1]
            weights += len(piece)
    return np.asarray(f[1 : length // 2 + 1], dtype=np.float64), total / weights


def _medians(frequencies: Floats, densities: Floats) -> Floats:
    """Densities (F, columns) smoothed by medians over narrow bands, which single lines do not raise."""
    octaves = np.log2(frequencies[-1] / frequencies[0])
    last = np.nextafter(frequencies[-1], np.inf)
    edges = np.geomspace(frequencies[0], last, max(2, int(_POINTS * octaves)) + 1)
    centres, medians = [], []
    for low, high in pairwise(np.searchsorted(frequencies, edges)):
        if high > low:
            centres.append(float(np.sqrt(frequencies[low] * frequencies[high - 1])))
            medians.append(np.median(densities[max(0, low - 1) : high + 1], axis=0))
    logs = np.log(np.maximum(np.array(medians), np.finfo(float).tiny))
    places, known = np.log(frequencies), np.log(np.array(centres))
    return np.asarray(
        np.exp(
            np.stack([np.interp(places, known, column) for column in logs.T], axis=1)
        )
    )


def _stretches(ratio: Floats) -> Flags:
    """Where motion stands clearly above the floor, in stretches that somewhere do so beyond doubt."""
    above = ratio > CLEAR
    number = np.cumsum(np.diff(above, prepend=False) & above) * above
    certain = np.unique(number[ratio > _BEYOND_DOUBT])
    return np.isin(number, certain[certain > 0])


def best_cutoff(spectrum: PositionSpectrum) -> float:
    """The cut-off with the least error of the acceleration, Hz; ``inf`` if any filter would only make it larger."""
    low = float(spectrum.frequencies[0])
    cutoffs = np.geomspace(low, max(_HIGHEST * spectrum.rate, 2 * low), _CUTOFFS)
    best = int(np.argmin(spectrum.filter_error(cutoffs)))
    return float(cutoffs[best]) if best < len(cutoffs) - 1 else np.inf


def noise_deviation(
    spectrum: PositionSpectrum, derivative: int = 0, cutoff: float = np.inf
) -> float:
    """Standard deviation of the noise of a derivative after a Butterworth low-pass both ways; the cut-off is in Hz."""
    f = spectrum.frequencies
    passed = 1 / (1 + (f / cutoff) ** (2 * ORDER)) ** 2
    variance = float(
        spectrum.noise @ (passed * (2 * np.pi * f) ** (2 * derivative))
    ) * float(f[0])
    return float(np.sqrt(variance))


def white_noise(values: Floats, order: int = 8) -> float:
    """Standard deviation of white noise in samples (N,) of a smooth signal, from differences of an order.

    Those of order 8 take away motion down to some 30 samples per period.

    Differences take away what is smooth; the variance of noise they multiply by the binomial (2·order over order).
    Nine tenths of them tell their size, which jumps, as of dry friction, do not sway.
    """
    return float(normal_deviation(np.diff(values, order), 0.9)) / sqrt(
        comb(2 * order, order)
    )
