"""Derivatives, orientations, spectra and shifts in time against signals that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal
from scipy.spatial.transform import Rotation

from echelon.identification.signals.clock import shifted
from echelon.identification.signals.filters import (
    REACH,
    body_rates,
    continuous,
    derivatives,
)
from echelon.identification.signals.spectrum import (
    best_cutoff,
    noise_deviation,
    spectrum,
)
from echelon.shared.errors import InputError
from support.selection import examples, one_in

RATE = 1000.0
TIME = np.arange(8000) / RATE


def chirp(t: np.ndarray) -> np.ndarray:
    """A chirp from 1 to 13 Hz beside slow motion."""
    return np.sin(2 * np.pi * (1 + 0.75 * t) * t) + 0.5 * np.cos(2 * np.pi * 0.4 * t)


# -- derivatives -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.01, 0.05, 0.1, 1 / 6])
def test_derivatives_are_right_up_to_a_sixth_of_the_rate(share: float) -> None:
    w = 2 * np.pi * share * RATE
    found = derivatives(np.stack([np.sin(w * TIME), TIME**2], axis=1), RATE)
    waves = (w * np.cos(w * TIME), -(w**2) * np.sin(w * TIME))
    for order, polynomial in enumerate((2 * TIME, 2 + 0 * TIME)):
        error = np.abs(found[order] - np.stack([waves[order], polynomial], axis=1))[
            REACH:-REACH
        ]
        assert error[:, 0].max() < 2e-3 * w ** (order + 1)
        assert error[:, 1].max() < 1e-6


def test_derivatives_at_the_ends_continue_the_motion() -> None:
    first, second = derivatives(3 + 2 * TIME, RATE)
    assert np.allclose(first, 2, atol=1e-9)
    assert np.allclose(second, 0, atol=1e-6)


# -- orientations ------------------------------------------------------------------------------------------------------


def spin(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """An orientation with its angular velocity and acceleration in the body's axes: Rot z(a) Rot y(b) Rot x(c)."""
    a, ad, add = 0.8 * np.sin(2 * t), 1.6 * np.cos(2 * t), -3.2 * np.sin(2 * t)
    b, bd, bdd = 0.3 + 0.5 * t, 0.5 + 0 * t, 0 * t
    c, cd, cdd = t**2 / 3, 2 * t / 3, 2 / 3 + 0 * t
    q = Rotation.from_euler("ZYX", np.stack([a, b, c], axis=1)).as_quat(
        scalar_first=True
    )
    sb, cb, sc, cc = np.sin(b), np.cos(b), np.sin(c), np.cos(c)
    omega = np.stack(
        [cd - ad * sb, bd * cc + ad * cb * sc, -bd * sc + ad * cb * cc], axis=1
    )
    alpha = np.stack(
        [
            cdd - add * sb - ad * bd * cb,
            bdd * cc
            - bd * cd * sc
            + add * cb * sc
            - ad * bd * sb * sc
            + ad * cd * cb * cc,
            -bdd * sc
            - bd * cd * cc
            + add * cb * cc
            - ad * bd * sb * cc
            - ad * cd * cb * sc,
        ],
        axis=1,
    )
    return q, omega, alpha


def rates(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return body_rates(q, *derivatives(q, RATE))


def test_body_rates_of_a_known_rotation() -> None:
    q, omega, alpha = spin(TIME)
    unit, w, a = rates(continuous(q))
    inside = slice(REACH, -REACH)
    assert np.allclose(np.linalg.norm(unit, axis=1), 1, atol=1e-14)
    assert np.allclose(w[inside], omega[inside], atol=2e-4)
    assert np.allclose(a[inside], alpha[inside], atol=2e-3)


def test_length_counts_for_nothing() -> None:
    q, _, _ = spin(TIME)
    length = (1 + 0.05 * np.sin(3 * TIME))[:, None]
    plain, scaled = rates(continuous(q)), rates(continuous(q) * length)
    for one, other, tolerance in zip(plain, scaled, (1e-14, 1e-5, 1e-4), strict=True):
        assert np.allclose(one[REACH:-REACH], other[REACH:-REACH], atol=tolerance)


@examples(25)
@given(st.integers(0, 2**31))
def test_signs_that_jump_are_made_continuous(seed: int) -> None:
    q = continuous(spin(TIME[::10])[0])
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(q))
    found = continuous(q * signs[:, None] * 1.001)
    assert np.allclose(found, q * signs[0], atol=1e-14)


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
    x = motion(seed) + deviation * np.random.default_rng(100 + seed).standard_normal(
        8000
    )
    assert noise_deviation(spectrum(x, RATE)) == pytest.approx(deviation, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_quantisation_and_coloured_noise_are_measured(seed: int) -> None:
    step = 2e-4
    assert noise_deviation(
        spectrum(np.round(motion(seed) / step) * step, RATE)
    ) == pytest.approx(step / np.sqrt(12), rel=0.2)
    random = np.random.default_rng(seed)
    coloured = 1e-4 * signal.lfilter(
        *signal.butter(1, 100, fs=RATE), random.standard_normal(8000)
    )
    assert noise_deviation(spectrum(motion(seed) + coloured, RATE)) == pytest.approx(
        np.std(coloured), rel=0.25
    )


@pytest.mark.parametrize("deviation", [1e-6, 1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", one_in(3, range(3)))
def test_cutoff_is_nearly_the_best_of_all(deviation: float, seed: int) -> None:
    """Against the acceleration itself, which only a test knows."""
    from echelon.identification.signals.filters import lowpass

    clean = motion(seed)
    noisy = clean + deviation * np.random.default_rng(seed).standard_normal(8000)
    truth = derivatives(clean, RATE)[1]

    def error(at: float) -> float:
        return float(
            np.std((derivatives(lowpass(noisy, at, RATE), RATE)[1] - truth)[1500:-1500])
        )

    errors = [error(at) for at in np.geomspace(1, 100, 40)]
    assert error(best_cutoff(spectrum(noisy, RATE))) < 1.5 * min(
        errors
    ) + 1e-4 * np.std(truth)


def test_vibrations_little_above_the_noise_are_no_motion() -> None:
    random = np.random.default_rng(1)
    hum = signal.sosfilt(
        signal.butter(2, [40, 50], "bandpass", fs=RATE, output="sos"),
        random.standard_normal(8000),
    )
    x = motion(1) + 1e-4 * random.standard_normal(8000) + 3e-4 * hum
    assert best_cutoff(spectrum(x, RATE)) < 15


def test_noise_of_derivatives_after_a_filter() -> None:
    from echelon.identification.signals.filters import lowpass

    random = np.random.default_rng(4)
    noise = 1e-4 * random.standard_normal(8000)
    found = spectrum(motion(4) + noise, RATE)
    expected = derivatives(lowpass(noise, 20, RATE), RATE)
    assert noise_deviation(found, 1, 20) == pytest.approx(np.std(expected[0]), rel=0.25)
    assert noise_deviation(found, 2, 20) == pytest.approx(np.std(expected[1]), rel=0.25)


def test_the_mean_frequency_of_velocity_is_rices() -> None:
    found = spectrum(
        np.sin(2 * np.pi * 3 * TIME)
        + 1e-5 * np.random.default_rng(0).standard_normal(8000),
        RATE,
    )
    assert found.mean_frequency() == pytest.approx(3, rel=0.05)


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


@examples(25)
@given(st.floats(-40, 40))
def test_shifting_undoes_a_delay(samples: float) -> None:
    late = chirp(TIME - samples / RATE)
    assert (
        np.abs(shifted(late[:, None], samples)[:, 0] - chirp(TIME))[100:-100].max()
        < 1e-6
    )
    assert np.array_equal(shifted(TIME, 3), np.append(TIME[3:], [TIME[-1]] * 3))
