"""Zero-phase filters and the reductions that go over both sides of the equation, against scipy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from echelon.identification.signals.filters import (
    NEAR,
    butterworth,
    fir_lowpass,
    lowpass,
    reduction,
)
from echelon.shared.errors import InputError
from support.selection import examples

RATE = 1000.0
INF = float("inf")
EDGES = [20.0, 30.0, 130.0, 1.8, 390.0]


@pytest.fixture
def noise() -> np.ndarray:
    return np.random.default_rng(3).standard_normal((6000, 3))


@pytest.mark.parametrize(
    ("order", "cutoff"), [(2, 3.0), (4, 40.0), (5, 260.0), (1, 250.0), (8, 20.0)]
)
def test_response_is_the_square_of_butterworths(order: int, cutoff: float) -> None:
    impulse = np.zeros(16001)
    impulse[8000] = 1.0
    found = np.abs(np.fft.rfft(lowpass(impulse, cutoff, RATE, order)))
    b, a = signal.butter(order, cutoff, fs=RATE)
    if order <= 5:  # beyond, polynomials have lost their digits
        _, once = signal.freqz(b, a, np.fft.rfftfreq(16001, 1 / RATE), fs=RATE)
        assert np.allclose(found, np.abs(once) ** 2, atol=2e-5)
    place = round(cutoff * 16001 / RATE)
    assert found[place] == pytest.approx(0.5, abs=0.02)


def test_no_delay_and_no_filter(noise: np.ndarray) -> None:
    t = np.arange(4000) / RATE
    slow = np.sin(2 * np.pi * 1.5 * t)
    assert np.abs(lowpass(slow, 40, RATE) - slow)[200:-200].max() < 1e-7
    assert np.array_equal(lowpass(noise, INF, RATE), noise)
    line = 3 + 2 * t
    assert np.allclose(
        lowpass(line, 5, RATE), line, atol=1e-9
    )  # at the ends too, because it is continued by itself


def test_channels_do_not_mix_whatever_their_number() -> None:
    many = np.random.default_rng(0).standard_normal((9000, 5, 4))
    together = lowpass(many, 30, RATE)
    assert together.shape == many.shape
    assert np.allclose(together[:, 3, 2], lowpass(many[:, 3, 2], 30, RATE), atol=1e-14)


@pytest.mark.parametrize(
    "both", [butterworth(5, RATE), butterworth(100, RATE, 2), butterworth(250, RATE, 1)]
)
@pytest.mark.parametrize("influence", [1e-9, NEAR])
def test_reach_bounds_the_influence_closely(both, influence: float) -> None:
    impulse = np.zeros(20001)
    impulse[10000] = 1.0
    response = np.abs(both.apply(impulse, 0))
    reach = both.reach(influence)
    assert 2 * response[10000 + reach + 1 :].sum() <= influence
    assert 2 * response[10000 + max(0, int(0.7 * reach) - 2) :].sum() > influence


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 500.0, 700.0, float("nan")])
def test_impossible_cutoffs_are_refused(cutoff: float) -> None:
    with pytest.raises(InputError, match="less than 500 Hz"):
        lowpass(np.zeros(100), cutoff, RATE)


@pytest.mark.parametrize(("cutoff", "factor"), [(40.0, 10), (12.0, 1), (4.0, 100)])
def test_finite_filter_passes_its_band_and_stops_the_rest(
    cutoff: float, factor: int
) -> None:
    found = fir_lowpass(cutoff, RATE, factor)
    f, response = signal.freqz(found.taps, worN=40000, fs=RATE)
    passes = np.abs(response[f <= cutoff])
    stops = np.abs(response[f >= min(1.5 * cutoff, RATE / factor - cutoff)])
    assert np.abs(passes - 1).max() < 2e-4
    assert stops.max() < 2e-4  # 80 dB by Kaiser's formula, which errs by one
    assert np.array_equal(found.taps, found.taps[::-1])
    assert found.taps.sum() == pytest.approx(1, abs=1e-14)


def test_finite_filter_computes_the_convolution(noise: np.ndarray) -> None:
    found = fir_lowpass(20, RATE, 7)
    whole = np.stack(
        [np.convolve(column, found.taps, "same") for column in noise.T], axis=1
    )
    weight = np.convolve(np.ones(len(noise)), found.taps, "same")[:, None]
    assert np.allclose(found.apply(noise), (whole / weight)[::7], atol=1e-13)
    short = noise[: found.reach]
    weight = np.convolve(np.ones(len(short)), found.taps)[found.reach :][: len(short)]
    assert np.allclose(
        found.apply(short)[:, 0],
        (np.convolve(short[:, 0], found.taps)[found.reach :][: len(short)] / weight)[
            ::7
        ],
    )


@pytest.mark.parametrize("edge", EDGES)
def test_constants_pass_and_shapes_stay(edge: float) -> None:
    found = reduction(edge, RATE)
    assert found is not None
    ones = found.apply(np.ones((3001, 2, 3)))
    assert ones.shape == (len(range(0, 3001, found.factor)), 2, 3)
    assert np.abs(ones - 1).max() < 1e-9


@examples(25)
@given(st.sampled_from(EDGES), st.integers(1, 400), st.integers(0, 2**31))
def test_windows_fit_together(edge: float, start: int, seed: int) -> None:
    """A window that begins at a multiple of the factor keeps the same samples; beyond its reach they are equal."""
    found = reduction(edge, RATE)
    assert found is not None
    values = np.random.default_rng(seed).standard_normal((5000, 2))
    begin = start * found.factor if start * found.factor < 2500 else 0
    whole, window = found.apply(values), found.apply(values[begin:])
    assert len(window) == len(whole) - begin // found.factor
    inner = -(-found.reach // found.factor)
    assert np.allclose(
        whole[begin // found.factor :][inner:], window[inner:], atol=1e-8
    )


@examples(20)
@given(st.sampled_from(EDGES), st.integers(0, 2**31))
def test_both_sides_filtered_alike_keep_a_linear_model_exact(
    edge: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    found = reduction(edge, RATE)
    assert found is not None
    regressor, parameters = (
        random.standard_normal((1500, 4, 6)),
        random.standard_normal(6),
    )
    assert np.allclose(
        found.apply(regressor @ parameters),
        found.apply(regressor) @ parameters,
        atol=1e-11,
    )


@pytest.mark.parametrize("edge", [24.0, 6.4, 0.3])
def test_two_filters_pass_and_stop_like_one(edge: float) -> None:
    """Waves within the band come through, and nothing from beyond it folds into it."""
    found = reduction(edge, RATE)
    assert found is not None
    assert found.before is not None
    assert 0.8 * 0.4 * RATE / edge < found.factor <= 0.4 * RATE / edge
    t = np.arange(int(40 / edge * RATE)) / RATE
    inner = slice(found.reach // found.factor + 1, -found.reach // found.factor - 1)
    passed = np.linspace(0.05, 1, 9) * edge
    folding = np.concatenate(
        [
            np.linspace(1.5, 4, 20) * edge,
            RATE / found.before.factor + np.linspace(-1, 1, 9) * edge,
        ]
    )
    for frequencies, gain in ((passed, 1.0), (folding[folding < RATE / 2], 0.0)):
        for f in frequencies:
            waves = np.cos(2 * np.pi * f * t + 0.3)
            assert (
                np.abs(found.apply(waves) - gain * waves[:: found.factor])[inner].max()
                < 5e-4
            ), f


def test_what_reductions_are_made_of() -> None:
    assert reduction(INF, RATE) is None
    assert reduction(410.0, RATE) is None
    assert reduction(20.0, RATE).factor == 20  # type: ignore[union-attr]  # rows at two and a half times the band
    with pytest.raises(InputError, match="too long at 1000 samples"):
        reduction(0.0001, RATE)
