"""Slopes of rates and their errors, whatever noise velocities and positions have."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from echelon.identification.logs.columns.by_values import sample_rate
from echelon.identification.signals.rates import rate
from support.selection import slow_unless

Floats = npt.NDArray[np.float64]

NOISES = {
    "clean": (0.0, 1e-5, 0.01),
    "fast joints": (0.0, 1e-5, 1.0),
    "coarse encoder": (0.0, 3e-3, 0.02),
    "both": (1e-3, 3e-3, 1.0),
}
"""Of positions, rad; steps of encoders, rad; of velocities, by their standard deviation."""


def moved(seed: int, samples: float, noise: str) -> tuple[Floats, Floats]:
    """Positions and velocities of three joints for a minute."""
    rng, (white, step, rough) = np.random.default_rng(seed), NOISES[noise]
    time = np.arange(round(60 * samples)) / samples
    speeds, size, phase = (
        rng.uniform(0.5, 6, (4, 3)),
        rng.uniform(0.1, 0.5, (4, 3)),
        rng.uniform(0, 6, (4, 3)),
    )
    angle = time[:, None, None] * speeds + phase
    q, qd = (
        np.sum(size * np.sin(angle), axis=1),
        np.sum(size * speeds * np.cos(angle), axis=1),
    )
    q = step * np.round((q + white * rng.standard_normal(q.shape)) / step)
    return q, qd + rough * qd.std(axis=0) * rng.standard_normal(qd.shape)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("samples", slow_unless([50.0, 200.0], [50.0, 200.0, 1000.0]))
def test_slopes_have_honest_errors(noise: str, samples: float) -> None:
    off = []
    for seed in range(12):
        q, qd = moved(seed, samples, noise)
        time = np.arange(len(q), dtype=float)
        found = [
            rate(own, measured, time) for own, measured in zip(q.T, qd.T, strict=True)
        ]
        off += [(some.slope - samples) / some.error for some in found]
    assert abs(np.mean(off)) < 0.7
    assert np.sqrt(np.mean(np.square(off))) < 1.5  # 1.07 for blocks of normal noise


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("samples", slow_unless([50.0, 200.0], [50.0, 200.0, 1000.0]))
def test_the_rate_of_samples_is_that_of_all_joints(noise: str, samples: float) -> None:
    for seed in range(12):
        found, error = sample_rate(*moved(seed, samples, noise))
        assert abs(found - samples) < 4 * error
        assert error < 0.03 * samples


def test_what_follows_nothing_has_no_slope() -> None:
    q, qd = moved(1, 200.0, "clean")
    time, still = np.arange(len(q)) / 200, np.zeros(len(q))
    assert np.isnan(rate(still, qd[:, 0], time).slope)
    strange = rate(q[:, 0], np.random.default_rng(1).standard_normal(len(q)), time)
    assert abs(strange.slope) < 4 * strange.error
    assert np.isnan(rate(q[:20, 0], qd[:20, 0], time[:20]).slope)


def test_a_rate_explains_more_than_another_only_by_more_than_chance() -> None:
    q, qd = moved(2, 200.0, "fast joints")
    time = np.arange(len(q)) / 200
    own, other = rate(q[:, 0], qd[:, 0], time), rate(q[:, 1], qd[:, 0], time)
    assert own.explains_more(other)
    assert not other.explains_more(own)
    alike = rate(q[:, 0] + 1e-4 * q[:, 1], qd[:, 0], time)
    assert not own.explains_more(alike)
    assert not alike.explains_more(own)


def test_encoders_that_are_set_anew_and_gaps_of_the_clock_do_no_harm() -> None:
    q, qd = moved(3, 200.0, "clean")
    time = np.arange(len(q)) / 200
    time[5000:] += 10.0
    q[5000:] += 0.4
    q[7000:] -= 2 * np.pi
    q[8000:8002] += 50.0
    q[9000] = np.nan
    for own, measured in zip(q.T, qd.T, strict=True):
        found = rate(own, measured, time)
        assert abs(found.slope - 1) < 5e-3
