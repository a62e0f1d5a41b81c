"""Derivatives, orientations, spectra, periods and shifts in time against signals that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.spatial.transform import Rotation

from echelon.errors import InputError
from echelon.signals.clock import shifted
from echelon.signals.derivatives import body_rates, central, continuous, fourier, savitzky_golay, savitzky_golay_window
from echelon.signals.periods import average, find_period
from echelon.signals.spectrum import best_cutoff, noise_deviation, spectrum

RATE = 1000.0
TIME = np.arange(8000) / RATE


def chirp(t: np.ndarray) -> np.ndarray:
    """A chirp from 1 to 13 Hz beside slow motion."""
    return np.sin(2 * np.pi * (1 + 0.75 * t) * t) + 0.5 * np.cos(2 * np.pi * 0.4 * t)


# -- derivatives -------------------------------------------------------------------------------------------------------


def test_central_differences_are_numpys() -> None:
    x = np.stack([TIME**2, chirp(TIME)], axis=1)
    _, xd, xdd = central(x, RATE)
    assert np.array_equal(xd, np.gradient(x, 1 / RATE, axis=0, edge_order=2))
    assert np.allclose(xd[:, 0], 2 * TIME, atol=1e-9)
    assert np.allclose(xdd[:, 0], 2, atol=1e-5)
    with pytest.raises(InputError, match="at least 3"):
        central(x[:2], RATE)


@pytest.mark.parametrize("method", ["central", "savitzky_golay"])
def test_derivatives_of_a_sine(method: str) -> None:
    w = 2 * np.pi * 2
    x = np.sin(w * TIME)
    found = central(x, RATE) if method == "central" else savitzky_golay(x, RATE, 60)
    for order, expected in enumerate((x, w * np.cos(w * TIME), -(w**2) * x)):
        assert np.abs(found[order] - expected)[100:-100].max() < 2e-4 * w**order


@pytest.mark.parametrize(("cutoff_hz", "degree"), [(5.0, 4), (20.0, 4), (12.0, 2), (30.0, 6)])
def test_savitzky_golay_takes_3_decibels_at_its_cutoff(cutoff_hz: float, degree: int) -> None:
    window = savitzky_golay_window(cutoff_hz, RATE, degree)
    assert window % 2 == 1
    f, response = signal.freqz(signal.savgol_coeffs(window, degree), worN=200000, fs=RATE)
    assert f[np.argmax(np.abs(response) < np.sqrt(0.5))] == pytest.approx(cutoff_hz, rel=0.1)


def test_savitzky_golay_is_exact_on_polynomials() -> None:
    t = TIME[:600]
    x, xd, xdd = savitzky_golay((1 + t - 3 * t**2 + t**4)[:, None], RATE, 20)
    assert np.allclose(x[:, 0], 1 + t - 3 * t**2 + t**4, atol=1e-10)
    assert np.allclose(xd[:, 0], 1 - 6 * t + 4 * t**3, atol=1e-8)
    assert np.allclose(xdd[:, 0], -6 + 12 * t**2, atol=1e-6)
    with pytest.raises(InputError, match="needs 81 samples, there are 50"):
        savitzky_golay(np.zeros((50, 1)), RATE, 20)


@settings(max_examples=25, deadline=None)
@given(st.floats(0.7, 2.9), st.integers(3000, 8000), st.integers(1, 9))
def test_fourier_series_have_exact_derivatives(period: float, samples: int, harmonic: int) -> None:
    """The period is not a whole number of samples, nor the record one of periods."""
    w = 2 * np.pi * harmonic / period
    t = TIME[:samples]
    x, xd, xdd = fourier(np.sin(w * t + 0.3)[:, None] + 2, RATE, period, cutoff=10 / period)
    assert np.allclose(x[:, 0], 2 + np.sin(w * t + 0.3), atol=1e-9)
    assert np.allclose(xd[:, 0], w * np.cos(w * t + 0.3), atol=1e-8 * w)
    assert np.allclose(xdd[:, 0], -(w**2) * np.sin(w * t + 0.3), atol=1e-8 * w**2)


def test_fourier_series_are_band_limited_and_average() -> None:
    random = np.random.default_rng(0)
    clean = np.sin(2 * np.pi * TIME) + 0.2 * np.cos(2 * np.pi * 3 * TIME)
    x, _, xdd = fourier(clean + 0.01 * random.standard_normal(8000), RATE, 1.0, cutoff=5)
    assert np.std(x - clean) < 0.01 * np.sqrt(11 / 8000) * 2  # 11 coefficients from 8000 samples
    assert np.std(xdd) == pytest.approx((2 * np.pi) ** 2 * np.sqrt((1 + 1.8**2) / 2), rel=0.01)
    with pytest.raises(InputError, match="do not cover the period"):
        fourier(clean[:900], RATE, 1.0)


# -- orientations ------------------------------------------------------------------------------------------------------


def spin(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An orientation with its angular velocity and acceleration in the body's axes: Rot z(a) Rot y(b) Rot x(c)."""
    a, ad, add = 0.8 * np.sin(2 * t), 1.6 * np.cos(2 * t), -3.2 * np.sin(2 * t)
    b, bd, bdd = 0.3 + 0.5 * t, 0.5 + 0 * t, 0 * t
    c, cd, cdd = t**2 / 3, 2 * t / 3, 2 / 3 + 0 * t
    q = Rotation.from_euler("ZYX", np.stack([a, b, c], axis=1)).as_quat(scalar_first=True)
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    omega = np.stack([cd - ad * sb, bd * cc + ad * cb * sc, -bd * sc + ad * cb * cc], axis=1)
    alpha = np.stack(
        [
            cdd - add * sb - ad * bd * cb,
            bdd * cc - bd * cd * sc + add * cb * sc - ad * bd * sb * sc + ad * cd * cb * cc,
            -bdd * sc - bd * cd * cc + add * cb * cc - ad * bd * sb * cc - ad * cd * cb * sc,
        ],
        axis=1,
    )
    return q, omega, alpha


def test_body_rates_of_a_known_rotation() -> None:
    q, omega, alpha = spin(TIME)
    unit, w, a = body_rates(*central(continuous(q), RATE))
    inside = slice(3, -3)
    assert np.allclose(np.linalg.norm(unit, axis=1), 1, atol=1e-14)
    assert np.allclose(w[inside], omega[inside], atol=2e-4)
    assert np.allclose(a[inside], alpha[inside], atol=2e-3)


def test_length_counts_for_nothing() -> None:
    q, _, _ = spin(TIME)
    length = (1 + 0.05 * np.sin(3 * TIME))[:, None]
    plain, scaled = body_rates(*central(continuous(q), RATE)), body_rates(*central(continuous(q) * length, RATE))
    for one, other, tolerance in zip(plain, scaled, (1e-14, 1e-5, 1e-4), strict=True):
        assert np.allclose(one[3:-3], other[3:-3], atol=tolerance)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31))
def test_signs_that_jump_are_made_continuous(seed: int) -> None:
    q = continuous(spin(TIME[::10])[0])
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(q))
    found = continuous(q * signs[:, None] * 1.001)
    assert np.allclose(found, q * signs[0], atol=1e-14)
    assert np.allclose(continuous(q[400:] * signs[400:, None], q[399]), q[400:], atol=1e-14)


def test_what_is_no_quaternion_is_named() -> None:
    q = spin(TIME[:20])[0]
    q[7] = 0
    with pytest.raises(InputError, match="sample 7"):
        continuous(q)


# -- spectra -----------------------------------------------------------------------------------------------------------


def motion(seed: int) -> np.ndarray:
    """Random motion below about 2 Hz."""
    random = np.random.default_rng(seed)
    f = random.uniform(0.1, 2.0, 12)
    return np.sin(2 * np.pi * np.outer(TIME, f) + random.uniform(0, 6, 12)) @ (0.3 / f)


@pytest.mark.parametrize("deviation", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(5))
def test_white_noise_is_measured(deviation: float, seed: int) -> None:
    x = motion(seed) + deviation * np.random.default_rng(100 + seed).standard_normal(8000)
    assert noise_deviation(spectrum(x, RATE)) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_quantisation_and_coloured_noise_are_measured(seed: int) -> None:
    step = 2e-4
    assert noise_deviation(spectrum(np.round(motion(seed) / step) * step, RATE)) == pytest.approx(
        step / np.sqrt(12), rel=0.2
    )
    random = np.random.default_rng(seed)
    coloured = 1e-4 * signal.lfilter(*signal.butter(1, 100, fs=RATE), random.standard_normal(8000))
    assert noise_deviation(spectrum(motion(seed) + coloured, RATE)) == pytest.approx(np.std(coloured), rel=0.25)


@pytest.mark.parametrize("deviation", [1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", range(3))
def test_cutoff_is_nearly_the_best_of_all(deviation: float, seed: int) -> None:
    """Against the acceleration itself, which only a test knows."""
    from echelon.signals.filters import lowpass

    clean = motion(seed)
    noisy = clean + deviation * np.random.default_rng(seed).standard_normal(8000)
    truth = central(clean, RATE)[2]

    def error(at: float) -> float:
        return float(np.std((central(lowpass(noisy, at, RATE), RATE)[2] - truth)[1500:-1500]))

    errors = [error(at) for at in np.geomspace(1, 100, 40)]
    assert error(best_cutoff(spectrum(noisy, RATE))) < 1.5 * min(errors) + 1e-4 * np.std(truth)


def test_vibrations_little_above_the_noise_are_no_motion() -> None:
    random = np.random.default_rng(1)
    hum = signal.sosfilt(signal.butter(2, [40, 50], "bandpass", fs=RATE, output="sos"), random.standard_normal(8000))
    x = motion(1) + 1e-4 * random.standard_normal(8000) + 3e-4 * hum
    assert best_cutoff(spectrum(x, RATE)) < 15


def test_noise_of_derivatives_after_a_filter() -> None:
    from echelon.signals.filters import lowpass

    random = np.random.default_rng(4)
    noise = 1e-4 * random.standard_normal(8000)
    found = spectrum(motion(4) + noise, RATE)
    expected = central(lowpass(noise, 20, RATE), RATE)
    assert noise_deviation(found, 1, 20) == pytest.approx(np.std(expected[1]), rel=0.25)
    assert noise_deviation(found, 2, 20) == pytest.approx(np.std(expected[2]), rel=0.25)


def test_the_mean_frequency_of_velocity_is_rices() -> None:
    found = spectrum(np.sin(2 * np.pi * 3 * TIME) + 1e-5 * np.random.default_rng(0).standard_normal(8000), RATE)
    assert found.mean_frequency() == pytest.approx(3, rel=0.05)
    assert found.band_edge(0.99, 1) == pytest.approx(3, abs=1.5)


def test_a_signal_without_noise_needs_no_filter_and_one_at_rest_does_not_move() -> None:
    assert best_cutoff(spectrum(motion(0), RATE)) > 50
    assert not spectrum(np.full(4000, 0.3), RATE).moves
    assert not spectrum(np.random.default_rng(0).standard_normal(4000), RATE).moves
    with pytest.raises(InputError, match="at least 64"):
        spectrum(np.zeros(20), RATE)


def test_stretches_between_gaps_vote_together() -> None:
    x = motion(2) + 1e-4 * np.random.default_rng(2).standard_normal(8000)
    found = spectrum([x[:4000], x[4100:], x[4010:4050]], RATE)
    assert noise_deviation(found) == pytest.approx(1e-4, rel=0.1)


# -- periods and shifts ------------------------------------------------------------------------------------------------


@settings(max_examples=25, deadline=None)
@given(st.floats(0.6, 3.5), st.integers(0, 2**31))
def test_the_period_is_found(period: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    phases, sizes = random.uniform(0, 6, (4, 2)), random.uniform(0.3, 1, (4, 2)) / np.array([[1], [2], [3], [4]])
    angles = 2 * np.pi / period * TIME[:, None] * np.arange(1, 5)
    x = np.einsum("tk,kj->tj", np.ones((8000, 4)), 0 * phases)
    for k in range(4):
        x += sizes[k] * np.sin(angles[:, k : k + 1] + phases[k])
    x += 1e-3 * random.standard_normal(x.shape)
    assert find_period(x, RATE) == pytest.approx(period, rel=2e-4)


def test_no_period() -> None:
    with pytest.raises(InputError, match="does not repeat itself"):
        find_period(chirp(TIME)[:, None], RATE)
    with pytest.raises(InputError, match="nothing moves"):
        find_period(np.ones((100, 2)), RATE)


@pytest.mark.parametrize("period", [1.0, 0.98765432])
def test_average_over_periods_leaves_less_noise(period: float) -> None:
    random = np.random.default_rng(5)
    clean = np.stack([np.sin(2 * np.pi * TIME / period), np.cos(6 * np.pi * TIME / period)], axis=1)
    mean, rate = average(clean + [0.01, 0.03] * random.standard_normal((8000, 2)), RATE, period)
    t = np.arange(len(mean)) / rate
    expected = np.stack([np.sin(2 * np.pi * t / period), np.cos(6 * np.pi * t / period)], axis=1)
    assert len(mean) / rate == pytest.approx(period, rel=1e-12)
    assert np.std(mean - expected, axis=0) == pytest.approx([0.01 / 8**0.5, 0.03 / 8**0.5], rel=0.2)
    with pytest.raises(InputError, match="two periods"):
        average(clean[:1500], RATE, period)


@settings(max_examples=25, deadline=None)
@given(st.floats(-40, 40))
def test_shifting_undoes_a_delay(samples: float) -> None:
    late = chirp(TIME - samples / RATE)
    assert np.abs(shifted(late[:, None], samples)[:, 0] - chirp(TIME))[100:-100].max() < 2e-4
    assert np.array_equal(shifted(TIME, 3), np.append(TIME[3:], [TIME[-1]] * 3))
