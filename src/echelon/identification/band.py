"""The band that regressor and outputs keep, chosen so that the estimate does not move when it is widened.

Two things move an estimate.  Noise of the positions enters the regressor, more of it the wider the band is, and least
squares is then biased: by A⁻¹ D ζ with A = Σ Wᵀ W / σ² and D the same of what noise does to W.  D is measured: noise
with the spectrum that the positions have is added to them once more, and the rows are made again.  And where outputs
hold vibrations, elasticity and noise of sensors rather than what the model explains, rows say nothing of the parameters
and fit them to something else.

So the band ends, first, where the residuals hold more than half of what is measured (the mean of the outputs in
logarithms; by the spectra of outputs and residuals, of a fit to a narrower band, without what residuals are near
standstill), and second, before any base parameter is biased by more than a third of its standard deviation, which
leaves intervals of 95 % with 94 %.  It is never narrower than the motion, twice the mean frequency of the fastest
velocity, nor wider than what the signals allow (:mod:`echelon.identification.logs.preparation.choices`), and of a
short log it leaves
ten rows per parameter.  Where even the narrowest band is biased by more, that is said, and A⁻¹ D ζ is given back.
Noise that turns the direction of dry friction counts for nothing: rows so near rest leave the fit, and encoders that
round keep the direction.

Sources: Fuller, Measurement Error Models, 1987; Cook and Stefanski, J. Amer. Stat. Assoc. 89, 1994 (noise added to
data); Janot, Vandanjon and Gautier, IEEE Trans. Control Syst. Technol. 22, 2014 (bandwidth of identified robots).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from echelon.base import BaseModel
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.judge.evidence import OutputRows, Products, fitted
from echelon.identification.logs.finding import Finding, note, warning
from echelon.identification.logs.preparation.choices import (
    NARROWEST,
    ROWS,
    Signals,
    reasoned,
    with_lowpass,
    with_still,
)
from echelon.identification.logs.preparation.prepare import Preparation, prepare
from echelon.identification.logs.recording import Segment
from echelon.identification.rows.plan import LOOKED_AT, SAMPLED
from echelon.identification.rows.rows import ModelRows, rows_filtered
from echelon.identification.scores import HALF
from echelon.identification.signals.clock import low_passed
from echelon.identification.signals.spectrum import PositionSpectrum
from echelon.shared import Flags, Floats, InputError

BAND_RATIO = 1.4
"""Ratio of neighbouring bands that are tried: a band is then right to a fifth, and few fits are made."""

LARGEST_BIAS = 1 / 3
"""Largest bias of a base parameter, in its standard deviations: intervals of 95 % then hold at least 94 %."""

REMOVED = 0.1
"""Share of the residual's squares that a delay, or friction that is not predicted at rest, removes at least: chance
removes less, and smaller shares move no parameter by more than its standard deviation."""

FIRST_ORDER = 0.3
"""Largest share that noise may take of any combination of parameters for a correction of first order to be enough: what
is left out is of the order of its square, a tenth."""


@dataclass(frozen=True, eq=False)
class Noisy:
    """Bias of an estimate by noise of the positions, in a band in which it is too large nevertheless."""

    source: str  # the log
    parameter: str  # that is moved most
    bias: float  # by its standard deviation
    lost: Floats  # share of the parameters that noise takes away, shape (n, n)
    corrects: bool = True  # whether the estimate is one of these rows alone

    @property
    def is_known(self) -> bool:
        """Whether it is small enough for its first order to be all of it."""
        return (
            self.corrects
            and float(np.abs(np.linalg.eigvals(self.lost)).max()) < FIRST_ORDER
        )

    @property
    def finding(self) -> Finding:
        """Finding that names the parameter, and says whether the bias is corrected."""
        text = f"position noise shifts {self.parameter} by {self.bias:.2g} standard deviations even in the narrowest band"
        if self.is_known:
            return note(
                "noisy positions",
                self.source,
                f"{text}; least squares are corrected for it",
            )
        return warning(
            "noisy positions",
            self.source,
            f"{text}; finer encoders or measured velocities would help",
        )

    def corrected(self, estimate: Estimate) -> Estimate:
        """An estimate by least squares without the bias, as if it were known exactly.

        Where rows near rest leave the fit, it may be too much by up to a standard deviation: coarse encoders err most
        there, and their spectrum is that of all samples.
        """
        if not self.is_known:
            return estimate
        whole = np.linalg.inv(np.eye(len(self.lost)) - self.lost)
        return replace(
            estimate,
            values=whole @ estimate.values,
            covariance=whole @ estimate.covariance @ whole.T,
        )


def with_band(
    preparation: Preparation, log: Signals, base: BaseModel
) -> tuple[Preparation, Noisy | None]:
    """The preparation with the band narrowed as the model asks, and what noise does where it biases nevertheless."""
    longest = max(len(segment) for segment in log.segments) / log.rate
    if preparation.band is not None and preparation.band * longest < 1:
        problem = f"{preparation.band:g} Hz is slower than the {longest:.3g} s that a stretch lasts"
        raise InputError(problem, source=log.source, element="band")
    trials = Trials.of(log, preparation, base)
    if not trials.usable(trials.bands[0]):
        return preparation, None
    preparation, trials = _better_velocities(preparation, trials)
    bands = trials.bands
    informed = place = _explained(trials)
    fits = {place: trials.fit(bands[place])}
    while fits[place].bias > LARGEST_BIAS and place > 0:
        place -= 1
        fits[place] = trials.fit(bands[place])
    if fits[place].bias > LARGEST_BIAS:
        place = min(fits, key=lambda k: fits[k].bias)
    if place < informed:
        worst = (
            trials.name(fits[place + 1])
            if place + 1 in fits
            else trials.name(fits[place])
        )
        reason = (
            f"{bands[place]:.3g} Hz: in a wider band position noise would bias {worst}"
        )
        preparation = reasoned(preparation, "band", bands[place], reason)
    elif place < len(bands) - 1:
        reason = f"{bands[place]:.3g} Hz: above it the model explains less than half of the measurement"
        preparation = reasoned(preparation, "band", bands[place], reason)
    fit = fits[place]
    preparation = _with_rest(with_still(log, preparation), trials, fit.values)
    if fit.bias <= LARGEST_BIAS:
        return preparation, None
    return preparation, Noisy(log.source, trials.name(fit), fit.bias, fit.lost)


def _better_velocities(
    preparation: Preparation, trials: Trials
) -> tuple[Preparation, Trials]:
    """Velocities from the log or from positions: what leaves the smaller residuals in the same band."""
    if trials.log.doubt or "measured" not in preparation.reasons:
        return preparation, trials
    narrow = trials.bands[min(1, len(trials.bands) - 1)]
    sources: dict[tuple[str, ...], str] = {
        (): "differentiated positions",
        ("qd",): "measured velocities",
    }
    left = {}
    for measured in sources:
        # the same rows
        every = preparation.model_copy(update={"measured": measured, "still": 0.0})
        every = with_lowpass(trials.log, every).model_copy(update={"reasons": {}})
        left[measured] = replace(trials, preparation=every).fit(narrow).residual
    best, other = sorted(sources, key=lambda measured: left[measured])
    text = f"{sources[best]}: {sources[other]} leave {left[other] / left[best]:.4g} times the residuals"
    same = best == preparation.measured
    preparation = with_lowpass(
        trials.log, reasoned(preparation, "measured", best, text)
    )
    return preparation, trials if same else Trials.of(
        trials.log, preparation, trials.base
    )


def _with_rest(preparation: Preparation, trials: Trials, values: Floats) -> Preparation:
    """Outputs that hold no dry friction near standstill, as residuals say: their joints count as at rest there."""
    outputs = [output.name for output in trials.base.mechanism.outputs]
    if preparation.rest is not None or not preparation.still:
        return preparation
    left = []
    for rest in ((), tuple(outputs)):
        made = preparation.model_copy(
            update={"rest": rest, "delays": preparation.delays or {}}
        )
        left.append(
            sum(
                (trials.squares(made, slow, values) for slow, _ in trials.pairs),
                np.zeros(len(outputs)),
            )
        )
    found = [
        name
        for name, as_sign, as_none in zip(outputs, *left, strict=True)
        if as_none < (1 - REMOVED) * as_sign
    ]
    text = f"{', '.join(found) or 'none'}: here the residuals would be larger with friction near standstill than without"
    return reasoned(preparation, "rest", tuple(found), text)


def _explained(trials: Trials) -> int:
    """Number of the widest band at whose edge the model explains enough, by fits to narrower ones."""
    place = 0
    for _ in range(2):
        narrow = trials.fit(trials.bands[min(max(place, 1), len(trials.bands) - 1)])
        above = np.flatnonzero(trials.explained(narrow.values) >= HALF)
        place = int(above[-1]) + 1 if len(above) else 0
    rows = (
        trials.log.rows(trials.preparation.model_copy(update={"band": band}))
        for band in trials.bands
    )
    enough = [k for k, count in enumerate(rows) if count >= ROWS * trials.base.rank]
    return max(place, enough[0] if enough else len(trials.bands) - 1)


@dataclass(frozen=True)
class BandFit:
    """Least squares in one band."""

    values: Floats
    residual: float  # geometric mean of the outputs' rms
    bias: float  # largest of a base parameter, by its standard deviation
    worst: int  # that parameter
    lost: Floats  # share of the parameters that noise of the positions takes away, shape (n, n)


@dataclass(frozen=True, eq=False)
class Trials:
    """Fits of a log in several bands, on a clock that is no faster than the widest needs."""

    log: Signals
    preparation: Preparation
    base: BaseModel
    bands: tuple[float, ...]  # Hz, from the narrowest to the widest
    # segments, and the same with as much noise added as they have
    pairs: tuple[tuple[Segment, Segment], ...]
    # those made so far, by band
    fits: dict[float, BandFit] = field(default_factory=dict, init=False)

    @staticmethod
    def of(log: Signals, preparation: Preparation, base: BaseModel) -> Trials:
        """Trials up to the band of a preparation."""
        assert preparation.band is not None
        high = min(preparation.band, 0.5 * log.rate)
        low = min(NARROWEST * log.fastest[1], high)
        steps = round(np.log(high / low) / np.log(BAND_RATIO))
        bands = tuple(np.geomspace(high, low, steps + 1)[::-1].tolist())
        made = preparation.model_copy(update={"delays": preparation.delays or {}})
        spectra = {"q": log.spectra}
        spectra |= {
            n: log.velocity_spectra if n == "qd" else log.spectra_of(n)
            for n in made.measured or ()
        }
        rng, left, pairs = np.random.default_rng(0), LOOKED_AT, []
        for segment in log.segments:
            slow = slower(segment, SAMPLED * high, left)
            if "y" in slow.signals and left > 0:
                pairs.append((slow, _noisier(slow, spectra, rng)))
                left -= len(slow)
        return Trials(log, made, base, bands, tuple(pairs))

    @cached_property
    def model(self) -> ModelRows:
        """Rows of the model at no samples, which predict at any."""
        return ModelRows.of(self.base, ())

    def usable(self, band: float) -> bool:
        """Whether some output has rows in a band that are not all zero."""
        return any(y.any() for y, _, _ in self._rows(band))

    def name(self, fit: BandFit) -> str:
        """Name of the parameter that a fit has biased most."""
        return self.model.layout.parameters[fit.worst]

    def fit(self, band: float) -> BandFit:
        """Reweighted least squares in a band, and what noise of the positions does to it."""
        if band not in self.fits:
            told = [some for some in self._rows(band) if some[0].any()]
            self.fits[band] = self._fit(told)
        return self.fits[band]

    def _fit(self, rows: Sequence[tuple[Floats, Floats, Floats]]) -> BandFit:
        n = self.base.rank
        outputs = []
        for y, W, _ in rows:
            every, whole = np.ones(len(y), dtype=bool), (slice(0, len(y)),)
            table = np.column_stack([W, y])
            outputs.append(OutputRows(np.arange(n), table, every, whole))
        found = fitted(Products.of(n, outputs))
        added = np.zeros((n, n))
        for (_, _, E), noise in zip(rows, found.noise, strict=True):
            added += E.T @ E / noise
        lost = found.covariance @ added
        biased = np.abs(lost @ found.values) / found.errors
        worst = int(np.argmax(biased))
        level = float(np.exp(np.mean(np.log(found.noise)) / 2))
        return BandFit(found.values, level, float(biased[worst]), worst, lost)

    def explained(self, values: Floats) -> Floats:
        """Share of what is measured that a model explains, from each band's edge to the next, shape (bands − 1,)."""
        count = len(self.base.mechanism.outputs)
        measured, rest = np.zeros((2, len(self.bands) - 1, count))
        for slow, _ in self.pairs:
            with suppress(InputError):
                samples = prepare(slow, self._in(self.bands[-1]), self.base.mechanism)
                predicted = self.model.predict(samples, values)
                assert samples.y is not None
                measured += _powers(samples.y, samples.rate, self.bands)
                rest += _powers(
                    _where_moving(samples.y - predicted, samples.moving),
                    samples.rate,
                    self.bands,
                )
        told = (measured > 0) & (rest > 0)
        ratios = np.log(np.where(told, rest, 1.0) / np.where(told, measured, 1.0))
        return np.asarray(
            1 - np.exp(ratios.sum(axis=1) / np.maximum(told.sum(axis=1), 1))
        )

    def squares(
        self, preparation: Preparation, slow: Segment, values: Floats
    ) -> Floats:
        """Squares of what a model leaves of each output, at rest as well."""
        with suppress(InputError):  # too short
            samples = prepare(slow, preparation, self.base.mechanism)
            assert samples.y is not None
            left = samples.y - self.model.predict(samples, values)
            return np.asarray(np.sum(rows_filtered(samples, left) ** 2, axis=0))
        return np.zeros(len(self.base.mechanism.outputs))

    def _in(self, band: float) -> Preparation:
        return with_still(self.log, self.preparation.model_copy(update={"band": band}))

    def _rows(self, band: float) -> list[tuple[Floats, Floats, Floats]]:
        """Output by output: measured values, rows of the regressor, and what noise of the positions adds to them."""
        preparation, n = self._in(band), self.base.rank
        found: list[list[tuple[Floats, Floats, Floats]]] = [
            [] for _ in self.base.mechanism.outputs
        ]
        for pair in self.pairs:
            with suppress(InputError):  # too short for this band
                clean, noisy = (
                    prepare(segment, preparation, self.base.mechanism)
                    for segment in pair
                )
                onward = np.where(noisy.qd * clean.qd > 0, noisy.qd, clean.qd)
                noisy = replace(noisy, qd=onward, moving=clean.moving)
                models = (ModelRows.of(self.base, [some]) for some in (clean, noisy))
                for one, other in zip(
                    *(model.blocks() for model in models), strict=True
                ):
                    for output, columns in enumerate(self.model.layout.columns):
                        W, E = np.zeros((2, len(one.y[output]), n))
                        W[:, columns] = one.matrices[output]
                        E[:, columns] = other.matrices[output] - one.matrices[output]
                        found[output].append((one.y[output], W, E))
        parts = [
            zip(
                *(some or [(np.zeros(0), np.zeros((0, n)), np.zeros((0, n)))]),
                strict=True,
            )
            for some in found
        ]
        return [
            (np.concatenate(y), np.concatenate(W), np.concatenate(E))
            for y, W, E in parts
        ]


def _where_moving(signal: Floats, moving: Flags | None) -> Floats:
    """A signal (N, outputs) where its output moves, else zero: no fit explains rest.  It has the power of all rows."""
    if moving is None:
        return signal
    share = moving.mean(axis=0)
    return np.asarray(
        np.where(
            moving & (share > 0), signal / np.sqrt(np.where(share > 0, share, 1.0)), 0.0
        )
    )


def _powers(signal: Floats, rate: float, bands: Sequence[float]) -> Floats:
    """Power of signals (N, outputs) between neighbouring bands, shape (bands − 1, outputs)."""
    window = np.hanning(len(signal))[:, None]
    squares = np.abs(np.fft.rfft((signal - signal.mean(axis=0)) * window, axis=0)) ** 2
    places = np.searchsorted(np.fft.rfftfreq(len(signal), 1 / rate), bands)
    return np.array(
        [squares[low:high].sum(axis=0) for low, high in pairwise(places)]
    ).reshape(-1, signal.shape[1])


def slower(segment: Segment, rate: float, most: int) -> Segment:
    """The beginning of a segment on a clock that is a whole number of times slower, not below a rate."""
    factor = max(1, int(segment.rate / rate))
    whole = slice(0, max(most, 1) * factor)
    signals = {
        name: values[whole]
        for name, values in segment.signals.items()
        if name != "reference"
    }
    if factor > 1:
        signals = {
            name: low_passed(values, 1 / factor)[::factor]
            for name, values in signals.items()
        }
    inputs = {name: values[whole][::factor] for name, values in segment.inputs.items()}
    return Segment(
        segment.source, segment.start, segment.rate / factor, signals, inputs
    )


def _noisier(
    segment: Segment,
    spectra: Mapping[str, Sequence[PositionSpectrum]],
    rng: np.random.Generator,
) -> Segment:
    """A segment with normal noise added that has the spectra of what its signals hold."""
    signals = dict(segment.signals)
    frequencies = np.fft.rfftfreq(len(segment), 1 / segment.rate)
    for name, some in spectra.items():
        power = np.stack(
            [np.interp(frequencies, s.frequencies, s.noise) for s in some], axis=1
        )
        waves = rng.standard_normal((2, *power.shape))
        size = np.sqrt(power * segment.rate * len(segment) / 4)
        size[0] = 0
        signals[name] = signals[name] + np.fft.irfft(
            (waves[0] + 1j * waves[1]) * size, len(segment), axis=0
        )
    return replace(segment, signals=signals)
