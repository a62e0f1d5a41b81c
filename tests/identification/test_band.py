"""The band of both sides, chosen by the model: planted parameters come back from coarse encoders at any rate."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import echelon as ec
from echelon.identification.band import with_band
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.estimators.least_squares import irls
from echelon.identification.logs.finding import Severity
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.preparation.prepare import Preparation, prepare
from echelon.identification.logs.recording import Segment
from echelon.identification.rows.rows import ModelRows
from echelon.shared.errors import InputError
from support.paths import ROOT
from support.selection import one_in, slow_unless

TRUE = np.array([0.31, 0.9, 0.01, 0.07, 0.25, -0.02])
FRICTION = np.array([[0.3, 0.2], [0.4, 0.3]])
"""Viscous and dry, of both joints."""
SIZES = np.array([[0.5, 0.3], [0.4, 0.3], [0.2, 0.2]])


@cache
def pendulum(friction: bool = False) -> ec.BaseModel:
    text = (ROOT / "examples" / "double_pendulum.yaml").read_text()
    return ec.base_parameters(
        ec.load(
            text.replace("effects: none", "effects: [viscous, coulomb]")
            if friction
            else text
        )
    )


def log(
    rate: float,
    step: float | np.ndarray,
    noise: float,
    seed: int,
    seconds: float = 20.0,
    slower: float = 1.0,
    friction: bool = False,
) -> Segment:
    """A swing between 0.3 and 1.3 Hz that never repeats, by encoders of a step, rad, with relative noise in torques.

    The first joint may be some times slower.
    """
    rng = np.random.default_rng([3, seed])
    w = (
        2
        * np.pi
        * np.array([[0.3, 0.4], [0.7, 0.8], [1.1, 1.2]])
        * rng.uniform(0.9, 1.1, (3, 2))
        / [slower, 1]
    )
    waves = np.exp(
        1j
        * (
            np.arange(0, seconds, 1 / rate)[:, None, None] * w
            + rng.uniform(0, 6, (3, 2))
        )
    )
    q, qd, qdd = ((SIZES * waves * (1j * w) ** k).real.sum(axis=1) for k in range(3))
    y = pendulum().predict(q, qd, qdd, TRUE) + friction * (
        FRICTION[0] * qd + FRICTION[1] * np.sign(qd)
    )
    y = y + noise * y.std(axis=0) * np.sqrt(rate / 100) * rng.standard_normal(y.shape)
    return Segment("planted", 0.0, rate, {"q": np.round(q / step) * step, "y": y})


def fitted(
    segment: Segment, preparation: Preparation, friction: bool = False
) -> Estimate:
    base = pendulum(friction)
    rows = ModelRows.of(base, [prepare(segment, preparation, base.mechanism)])
    return irls(rows.observation(), rows.units)


def automatic(segment: Segment) -> Preparation:
    log = Signals.of([segment], pendulum().mechanism)
    return with_band(chosen(Preparation(delays={}), log), log, pendulum())[0]


@pytest.mark.parametrize(
    ("rate", "step"),
    slow_unless(
        [(30.0, 1e-2)], [(30.0, 1e-6), (30.0, 1e-2), (100.0, 1e-3), (1000.0, 1e-2)]
    ),
)
def test_planted_parameters_come_back(rate: float, step: float) -> None:
    """Means over seeds within chance, errors as large as intervals say."""
    found = []
    for seed in range(12):
        segment = log(rate, step, 0.03, seed)
        estimate = fitted(segment, automatic(segment))
        found.append((estimate.values - TRUE) / estimate.std)
    errors = np.array(found)
    assert np.abs(errors.mean(axis=0)).max() < 3.5 / np.sqrt(len(errors)) + 1 / 3
    assert np.mean(np.abs(errors) < 1.96) > 0.85


def test_coarse_encoders_narrow_the_band() -> None:
    """A band that is wide open is narrowed: noise of the acceleration shows in residuals before it biases."""
    fine, coarse = log(100.0, 1e-6, 1e-4, 0), log(100.0, 3e-3, 1e-4, 0)
    logs = [Signals.of([segment], pendulum().mechanism) for segment in (fine, coarse)]
    wide = chosen(Preparation(delays={}, measured=()), logs[0]).model_copy(
        update={"band": 14.0}
    )
    found, _ = with_band(wide, logs[1], pendulum())
    assert found.band is not None
    assert found.band < 7
    errors = [
        np.abs(fitted(coarse, some).values - TRUE).max() for some in (found, wide)
    ]
    assert errors[0] < 0.3 * errors[1]


def test_a_slow_joint_with_a_coarse_encoder_does_not_spoil_the_others() -> None:
    """Its noise passes only as far as it moves itself, so that the band of all need not end there."""
    errors, bands = {}, {}
    for lowpass in (None, {}):
        found = []
        for seed in range(6):
            segment = log(100.0, np.array([1e-2, 1e-6]), 0.01, seed, 60.0, slower=10.0)
            signals = Signals.of([segment], pendulum().mechanism)
            made, _ = with_band(
                chosen(Preparation(delays={}, lowpass=lowpass), signals),
                signals,
                pendulum(),
            )
            assert set(made.lowpass or {}) == (set() if lowpass == {} else {"j1"})
            estimate = fitted(segment, made)
            found.append([estimate.values - TRUE, estimate.std])
        off, std = np.swapaxes(found, 0, 1)
        errors[lowpass is None], bands[lowpass is None] = (
            np.sqrt(np.mean(off**2, axis=0)),
            np.abs(off / std).max(),
        )
    assert np.all(errors[True] < 1.1 * errors[False])
    assert np.median(errors[True] / errors[False]) < 0.6
    assert bands[True] < 4


def test_joints_that_move_alike_keep_one_band() -> None:
    assert automatic(log(100.0, np.array([1e-2, 1e-6]), 0.03, 0)).lowpass == {}


def test_a_lowpass_of_no_position_is_refused() -> None:
    with pytest.raises(InputError, match=r"no position 'j9' \(valid: j1, j2\)"):
        fitted(
            log(100.0, 1e-6, 0.03, 0),
            Preparation(
                band=5.0, measured=(), still=0.0, delays={}, lowpass={"j9": 1.0}
            ),
        )


def test_settings_that_the_log_cannot_have_are_named() -> None:
    signals = Signals.of([log(100.0, 1e-6, 0.03, 0)], pendulum().mechanism)
    for given, problem in (
        ({"band": 1e-9}, "band: 1e-09 Hz is slower than"),
        ({"measured": ("qdd",)}, "has no qdd"),
    ):
        with pytest.raises(InputError, match=problem):
            with_band(chosen(Preparation(**given), signals), signals, pendulum())


def test_the_band_ends_where_the_model_explains_no_more() -> None:
    """A vibration of the outputs that no parameter knows stays outside."""
    segment = log(100.0, 1e-6, 1e-3, 1)
    t = np.arange(len(segment)) / 100
    hum = np.random.default_rng(0).standard_normal(segment.signals["y"].shape)
    hum = np.apply_along_axis(
        np.convolve, 0, hum, np.sin(2 * np.pi * 5 * t[:60]) / 30, "same"
    )
    y = segment.signals["y"] + 0.3 * segment.signals["y"].std(axis=0) * hum / hum.std(
        axis=0
    )
    found = automatic(
        Segment("planted", 0.0, 100.0, {"q": segment.signals["q"], "y": y})
    )
    assert found.band is not None
    assert 1.5 < found.band < 5
    assert "explains less than half" in found.reasons["band"]


def test_dry_friction_at_rest_does_not_narrow_the_band() -> None:
    """Quintic moves with rests between them, in which there is no friction and encoders tell any direction."""
    rng, rate, rest = np.random.default_rng(5), 125.0, np.zeros((100, 1))
    t, via = (
        np.linspace(0, 1, 250, endpoint=False)[:, None],
        rng.uniform(-1.2, 1.2, (20, 2)),
    )
    shapes = (
        10 * t**3 - 15 * t**4 + 6 * t**5,
        15 * t**2 * (1 - t) ** 2,
        15 * t * (1 - t) * (1 - 2 * t),
    )
    q, qd, qdd = (
        np.concatenate(
            [
                np.vstack([shape, rest + end]) * (b - a) + offset * a
                for a, b in pairwise(via)
            ]
        )
        for shape, end, offset in zip(shapes, (1, 0, 0), (1, 0, 0), strict=True)
    )
    y = (
        pendulum().predict(q, qd, qdd, TRUE)
        + FRICTION[0] * qd
        + FRICTION[1] * np.sign(qd)
    )
    y = y + 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
    segment = Segment("planted", 0.0, rate, {"q": np.round(q, 4), "y": y})
    signals = Signals.of([segment], pendulum(True).mechanism)
    widest = chosen(Preparation(), signals)
    made, _ = with_band(widest, signals, pendulum(True))
    assert made.band == widest.band
    found, truth = (
        fitted(segment, made, friction=True),
        np.array([*TRUE, *FRICTION.ravel()]),
    )
    assert np.abs((found.values - truth) / found.std).max() < 4


def test_noise_that_no_band_mends_is_said() -> None:
    signals = Signals.of([log(100.0, 0.15, 1e-6, 0)], pendulum().mechanism)
    _, noisy = with_band(chosen(Preparation(delays={}), signals), signals, pendulum())
    assert noisy is not None
    assert noisy.finding.kind == "noisy positions"
    assert "standard deviations" in noisy.finding.text


@pytest.mark.parametrize("friction", one_in(2, [False, True]))
def test_what_noise_takes_away_is_given_back(friction: bool) -> None:
    """Bias and coverage of least squares, before and after the correction.

    Where dry friction takes rows near rest out of the fit, in which encoders this coarse err most, they bias by less
    than a standard deviation, and the correction gives back too much: ZZ1 is .17 deviations too small before and .83
    too large after, the mean of 60 logs, and 96 % and 94 % of intervals hold.
    """
    errors: list[list[np.ndarray]] = [[], []]
    told = 12
    base, true = pendulum(friction), np.append(TRUE, FRICTION) if friction else TRUE
    for seed in range(12):
        segment = log(100.0, 0.1, 1e-2, seed, 40.0, friction=friction)
        signals = Signals.of([segment], base.mechanism)
        made, noisy = with_band(chosen(Preparation(delays={}), signals), signals, base)
        estimate = fitted(segment, made, friction)
        if noisy is None:  # of one log in twelve the bias is just below what is told
            told -= 1
        else:
            assert noisy.finding.severity is Severity.NOTE
            assert "corrected" in noisy.finding.text
        corrected = estimate if noisy is None else noisy.corrected(estimate)
        for found, some in zip(errors, (estimate, corrected), strict=True):
            found.append((some.values - true) / some.std)
    assert told >= (11 if friction else 12)
    before, after = (np.abs(np.mean(some, axis=0)).max() for some in errors)
    assert friction or before > 1
    assert after < max(0.3 * before, 1.0 * friction)
    assert np.mean(np.abs(errors[1]) < 2) > 0.9
