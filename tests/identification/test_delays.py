"""Delays between positions and torques, found by the model: planted ones come back, absent ones are not invented."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.identification.delays import with_delays
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.logs.recording import Segment
from support.paths import EXAMPLES, ROOT

RATE, COUNT = 500.0, 6000
VALUES = [0.31, 0.9, 0.01, 0.07, 0.25, -0.02]


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / "examples" / "double_pendulum.yaml"))


def run(
    base: ec.BaseModel, delay: float, noise: float = 0.02, seed: int = 0
) -> Segment:
    """A swing whose torques lag the motion by a delay in seconds."""
    rates, phases = (
        np.array([[2.1, 5.3], [3.7, 6.1]]),
        np.array([[0.2, 1.9], [0.7, 2.3]]),
    )

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        angle = t[:, None, None] * rates + phases
        parts = (np.sin(angle), rates * np.cos(angle), -(rates**2) * np.sin(angle))
        q, qd, qdd = (part.sum(axis=1) for part in parts)
        return q, qd, qdd

    t = np.arange(COUNT) / RATE
    y = base.predict(*motion(t - delay), VALUES)
    y = y + noise * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    return Segment("run.csv", 0.0, RATE, {"q": motion(t)[0], "y": y})


@pytest.mark.parametrize("delay", [-0.0113, -0.004, 0.0027, 0.008, 0.0165])
def test_a_planted_delay_is_found(base: ec.BaseModel, delay: float) -> None:
    segment = run(base, delay)
    found = with_delays(
        prepared(base, segment).model_copy(update={"delays": None}), [segment], base
    )
    assert found.delays is not None
    assert set(found.delays) == {"j1", "j2"}
    assert all(
        value == pytest.approx(delay, abs=3e-4) for value in found.delays.values()
    )
    assert f"{1e3 * found.delays['j1']:.2g} ms" in found.reasons["delays"]


@pytest.mark.parametrize("delay", [0.0004, 0.0095])
def test_the_delay_of_dry_friction_is_found_between_samples(
    delay: float, base: ec.BaseModel, tmp_path: Path
) -> None:
    """It turns at an instant, which a clock that is just fast enough for the band would place some milliseconds off."""
    text = (
        (EXAMPLES / "double_pendulum.yaml")
        .read_text()
        .replace("effects: none", "effects: [viscous, coulomb]")
    )
    (tmp_path / "dry.yaml").write_text(text)
    rubbed, swing, t = (
        ec.base_parameters(ec.load(tmp_path / "dry.yaml")),
        run(base, delay),
        np.arange(COUNT) / RATE,
    )
    qd = np.gradient(swing.signals["q"], 1 / RATE, axis=0)
    late = np.stack([np.interp(t - delay, t, some) for some in qd.T], axis=1)
    y = swing.signals["y"] + [3.0, 2.0] * late + [4.0, 3.0] * np.sign(late)
    segment = Segment("run.csv", 0.0, RATE, {"q": swing.signals["q"], "y": y})
    made = prepared(rubbed, segment).model_copy(update={"delays": None, "band": 6.0})
    found = with_delays(made, [segment], rubbed).delays
    assert found is not None
    assert [*found.values()] == [pytest.approx(delay, abs=1e-4)] * 2


def test_slow_logs_may_be_two_samples_late(base: ec.BaseModel) -> None:
    whole = run(base, 0.04)
    slow = Segment(
        "run.csv",
        0.0,
        50.0,
        {name: values[::10] for name, values in whole.signals.items()},
    )
    found = with_delays(
        prepared(base, slow).model_copy(update={"delays": None}), [slow], base
    )
    assert found.delays is not None
    assert found.delays["j1"] == pytest.approx(0.04, abs=1e-3)


def test_none_is_invented(base: ec.BaseModel) -> None:
    for seed in range(3):
        segment = run(base, 0.0, noise=0.1, seed=seed)
        found = with_delays(
            prepared(base, segment).model_copy(update={"delays": None}), [segment], base
        )
        assert found.delays == {}
        assert "none" in found.reasons["delays"]


def test_stated_delays_stay(base: ec.BaseModel) -> None:
    segment = run(base, 0.01)
    stated = prepared(base, segment).model_copy(update={"delays": {"j1": 0.002}})
    assert with_delays(stated, [segment], base) is stated


def prepared(base: ec.BaseModel, segment: Segment) -> Preparation:
    return chosen(Preparation(), Signals.of([segment], base.mechanism))


def test_an_output_that_comes_later_than_the_others_has_a_delay_of_its_own(
    base: ec.BaseModel,
) -> None:
    early, late = run(base, 0.0), run(base, 0.012)
    y = np.stack([early.signals["y"][:, 0], late.signals["y"][:, 1]], axis=1)
    segment = Segment("run.csv", 0.0, RATE, {"q": early.signals["q"], "y": y})
    found = with_delays(
        prepared(base, segment).model_copy(update={"delays": None}), [segment], base
    ).delays
    assert found is not None
    assert found["j2"] - found.get("j1", 0.0) == pytest.approx(0.012, abs=5e-4)


@pytest.mark.parametrize("rate", [RATE, 50 * RATE])
def test_stretches_too_short_for_a_delay_have_none(
    base: ec.BaseModel, rate: float
) -> None:
    """As of a log whose rate is stated far too high."""
    whole = run(base, 0.01)
    short = Segment(
        "run.csv",
        0.0,
        rate,
        {name: values[:400] for name, values in whole.signals.items()},
    )
    made = Preparation(band=8.0, measured=(), still=0.0)
    assert with_delays(made, [short], base).delays is not None
