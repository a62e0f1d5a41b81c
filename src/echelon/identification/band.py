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
velocity, nor wider than what the signals allow (:mod:`echelon.logs.preparation.choices`), and of a short log it leaves
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
from itertools import pairwise

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.rows.plan import SAMPLED
from echelon.identification.rows.rows import ModelRows, rows_taken
from echelon.logs.finding import Finding, note, warning
from echelon.logs.preparation.choices import (
    NARROWEST,
    ROWS,
    Signals,
    reasoned,
    with_lowpass,
    with_still,
)
from echelon.logs.preparation.prepare import Preparation, prepare
from echelon.logs.recording import Segment
from echelon.signals.clock import low_passed
from echelon.signals.spectrum import Spectrum

_WIDER = 1.4  # ratio of neighbouring bands that are tried
_LONGEST = 6_000  # samples, at that rate, from which the band is chosen
_EXPLAINED = 0.5  # share of what is measured that the model explains at least at the edge of the band
_BIASED = 1 / 3  # largest bias of a base parameter, by its standard deviation
_TOLD = 0.5  # bias from which on it is said: intervals of 95 % then hold 92 % or less
_KNOWN = 0.3
"""Largest share that noise takes of any combination of parameters, for which a correction of first order is enough."""
_RESTS = 0.9  # share of the squares of residuals, as with delays, that none predicted at rest has to leave at most
_REWEIGHTED = 4
_LEAST = 1e-9  # residual of an output at least, by its largest value: rounding of exact data is no knowledge
_OPEN = 1e-12  # share of the largest eigenvalue of the scaled normal matrix below which nothing is known


@dataclass(frozen=True, eq=False)
class Noisy:
    """What noise of the positions does to an estimate even in the narrowest band."""

    source: str  # the log
    parameter: str  # that is moved most
    bias: float  # by its standard deviation
    lost: Floats  # share of the parameters that noise takes away, shape (n, n)

    @property
    def is_known(self) -> bool:
        """Whether it is small enough for its first order to be all of it."""
        return float(np.abs(np.linalg.eigvals(self.lost)).max()) < _KNOWN

    @property
    def finding(self) -> Finding:
        """What is said of it."""
        text = (
            f"noise of the positions moves {self.parameter} by {self.bias:.2g} standard deviations, however narrow the "
            "band"
        )
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
    while fits[place].bias > _BIASED and place > 0:
        place -= 1
        fits[place] = trials.fit(bands[place])
    if fits[place].bias > _BIASED:
        place = min(fits, key=lambda k: fits[k].bias)
    if place < informed:
        worst = (
            trials.name(fits[place + 1])
            if place + 1 in fits
            else trials.name(fits[place])
        )
        reason = f"{bands[place]:.3g} Hz: in a wider band noise of the positions would bias {worst}"
        preparation = reasoned(preparation, "band", bands[place], reason)
    elif place < len(bands) - 1:
        reason = f"{bands[place]:.3g} Hz: above it the model explains less than half of what is measured"
        preparation = reasoned(preparation, "band", bands[place], reason)
    fit = fits[place]
    preparation = _with_rest(with_still(log, preparation), trials, fit.values)
    if fit.bias <= _TOLD:
        return preparation, None
    return preparation, Noisy(log.source, trials.name(fit), fit.bias, fit.lost)


def _better_velocities(
    preparation: Preparation, trials: Trials
) -> tuple[Preparation, Trials]:
    """Velocities from the log or from positions: what leaves the smaller residuals in the same band."""
    if not trials.log.agreeing or "measured" not in preparation.reasons:
        return preparation, trials
    narrow = trials.bands[min(1, len(trials.bands) - 1)]
    sources: dict[tuple[str, ...], str] = {
        (): "differentiated positions",
        ("qd",): "measured velocities",
    }
    left = {}
    for measured in sources:
        every = preparation.model_copy(
            update={"measured": measured, "still": 0.0}
        )  # the same rows
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
        if as_none < _RESTS * as_sign
    ]
    text = f"{', '.join(found) or 'none'}: of these it would leave larger residuals to predict friction near standstill"
    return reasoned(preparation, "rest", tuple(found), text)


def _explained(trials: Trials) -> int:
    """Number of the widest band at whose edge the model explains enough, by fits to narrower ones."""
    place = 0
    for _ in range(2):
        narrow = trials.fit(trials.bands[min(max(place, 1), len(trials.bands) - 1)])
        above = np.flatnonzero(trials.explained(narrow.values) >= _EXPLAINED)
        place = int(above[-1]) + 1 if len(above) else 0
    rows = (
        trials.log.rows(trials.preparation.model_copy(update={"band": band}))
        for band in trials.bands
    )
    enough = [k for k, count in enumerate(rows) if count >= ROWS * trials.base.rank]
    return max(place, enough[0] if enough else len(trials.bands) - 1)


@dataclass(frozen=True)
class Fit:
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
    pairs: tuple[
        tuple[Segment, Segment], ...
    ]  # segments, and the same with as much noise added as they have
    fits: dict[float, Fit] = field(
        default_factory=dict, init=False
    )  # those made so far, by band

    @staticmethod
    def of(log: Signals, preparation: Preparation, base: BaseModel) -> Trials:
        """Trials up to the band of a preparation."""
        assert preparation.band is not None
        high = min(preparation.band, 0.5 * log.rate)
        low = min(NARROWEST * log.fastest[1], high)
        steps = round(np.log(high / low) / np.log(_WIDER))
        bands = (
            tuple(float(band) for band in np.geomspace(low, high, steps + 1))
            if steps
            else (high,)
        )
        made = preparation.model_copy(update={"delays": preparation.delays or {}})
        spectra = {"q": log.spectra}
        spectra |= {
            n: log.velocity_spectra if n == "qd" else log.spectra_of(n)
            for n in made.measured or ()
        }
        rng, left, pairs = np.random.default_rng(0), _LONGEST, []
        for segment in log.segments:
            slow = slower(segment, SAMPLED * high, left)
            if "y" in slow.signals and left > 0:
                pairs.append((slow, _noisier(slow, spectra, rng)))
                left -= len(slow)
        return Trials(log, made, base, bands, tuple(pairs))

    def usable(self, band: float) -> bool:
        """Whether there are rows in a band."""
        return any(len(y) for y, _, _ in self._rows(band))

    def name(self, fit: Fit) -> str:
        """Of the parameter that is biased most."""
        return ModelRows.of(self.base, ()).layout.parameters[fit.worst]

    def fit(self, band: float) -> Fit:
        """Reweighted least squares in a band, and what noise of the positions does to it."""
        if band not in self.fits:
            self.fits[band] = self._fit(self._rows(band))
        return self.fits[band]

    def _fit(self, rows: Sequence[tuple[Floats, Floats, Floats]]) -> Fit:
        n = self.base.rank
        sigma = np.ones(len(rows))
        for _ in range(_REWEIGHTED):
            A = sum(
                (W.T @ W / s**2 for (_, W, _), s in zip(rows, sigma, strict=True)),
                np.zeros((n, n)),
            )
            right = sum(
                (W.T @ y / s**2 for (y, W, _), s in zip(rows, sigma, strict=True)),
                np.zeros(n),
            )
            inverse = _inverse(A)
            values = inverse @ right
            rms = np.array(
                [
                    np.sqrt(np.mean((y - W @ values) ** 2)) if len(y) else np.inf
                    for y, W, _ in rows
                ]
            )
            sigma = np.maximum(
                rms,
                _LEAST * np.array([np.abs(y).max(initial=1e-300) for y, _, _ in rows]),
            )
        D = sum(
            (E.T @ E / s**2 for (_, _, E), s in zip(rows, sigma, strict=True)),
            np.zeros((n, n)),
        )
        lost = inverse @ D
        with np.errstate(divide="ignore", invalid="ignore"):
            biased = np.nan_to_num(np.abs(lost @ values) / np.sqrt(np.diag(inverse)))
        worst = int(np.argmax(biased))
        level = float(np.exp(np.log(sigma[np.isfinite(sigma)]).mean()))
        return Fit(values, level, float(biased[worst]), worst, lost)

    def explained(self, values: Floats) -> Floats:
        """Share of what is measured that a model explains, from each band's edge to the next, shape (bands − 1,)."""
        count = len(self.base.mechanism.outputs)
        measured, rest = np.zeros((2, len(self.bands) - 1, count))
        for slow, _ in self.pairs:
            with suppress(InputError):
                samples = prepare(slow, self._in(self.bands[-1]), self.base.mechanism)
                predicted = ModelRows.of(self.base, ()).predict(samples, values)
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
            rest = rows_taken(
                samples,
                samples.y - ModelRows.of(self.base, ()).predict(samples, values),
            )[1]
            return np.asarray(np.sum(rest**2, axis=0))
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
                    for output, columns in enumerate(
                        ModelRows.of(self.base, ()).layout.columns
                    ):
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


def _inverse(A: Floats) -> Floats:
    """Inverse of a normal matrix; directions that the rows say nothing of count as known."""
    scale = 1 / np.sqrt(np.maximum(np.diag(A), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(A * np.outer(scale, scale))
    told = values > _OPEN * values[-1]
    return np.asarray(
        (vectors[:, told] / values[told]) @ vectors[:, told].T * np.outer(scale, scale)
    )


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
    spectra: Mapping[str, Sequence[Spectrum]],
    rng: np.random.Generator,
) -> Segment:
    """A segment with normal noise added that has the spectra of what its signals hold."""
    signals, frequencies = (
        dict(segment.signals),
        np.fft.rfftfreq(len(segment), 1 / segment.rate),
    )
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
