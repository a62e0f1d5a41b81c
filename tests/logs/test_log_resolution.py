"""Coarse and held signals: noted with their step, and not taken for faults."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from echelon.identification.logs.faults.examine import examine
from echelon.identification.logs.faults.repeated_values import resolution, stuck
from echelon.identification.logs.finding import Severity
from echelon.identification.logs.recording import Recording
from support.faulty_logs import ARM, COUNT, RATE, changed, clean, one
from support.selection import examples


@examples(100)
@given(st.integers(0, 1000), st.integers(7, 16))
@example(501, 7)  # a level that is reached for one sample where the motion turns
def test_coarse_sensors_are_neither_stuck_nor_saturated(seed: int, bits: int) -> None:
    """Quantised channels repeat values for long, at turning points longest, and reach their extremes many times."""
    recorded = clean(seed, 0.0)
    signals = {
        name: np.round(v / np.ptp(v) * 2**bits) * np.ptp(v) / 2**bits
        for name, v in recorded.signals.items()
    }
    findings, usable = examine(replace(recorded, signals=signals), ARM)
    assert usable.all()
    assert {finding.kind for finding in findings} <= {"resolution"}


def test_coarse_positions_are_noted_with_their_step() -> None:
    recorded = clean()
    step = math.tau / 400
    found = one(
        examine(
            changed(recorded, "q", np.round(recorded.signals["q"] / step) * step), ARM
        )[0][:1],
        "resolution",
    )
    assert found.severity is Severity.NOTE
    assert f"{step:.4g}" in found.text


@given(st.floats(1e-6, 0.1), st.floats(-5, 5), st.integers(0, 100))
def test_the_resolution_of_a_channel(step: float, offset: float, seed: int) -> None:
    values = np.cumsum(np.random.default_rng(seed).integers(-3, 4, 500)) * step + offset
    found = resolution(values)
    assert found is not None
    assert found == pytest.approx(step, rel=1e-3)
    assert resolution(np.random.default_rng(seed).normal(size=500)) is None


@pytest.mark.parametrize("factor", [2, 10])
def test_slow_signals_that_were_held(factor: int) -> None:
    slow = clean(count=COUNT // factor)
    signals = {
        name: np.repeat(slow.signals[name], factor, axis=0) for name in ("q", "y")
    }
    fast = Recording("run", np.arange(COUNT) / RATE / factor, signals)
    found = one(examine(fast, ARM)[0], "held")
    assert f"every {factor} samples" in found.text
    assert "rate: 250" in found.text


def test_encoders_that_creep_are_not_held() -> None:
    time = np.arange(COUNT) / RATE
    ramp = np.floor(time / 0.04 + 1e-9) * 1e-3
    q = np.stack([ramp, ramp + 1], axis=1)
    y = np.random.default_rng(0).normal(size=q.shape)
    assert "held" not in [
        finding.kind
        for finding in examine(Recording("run", time, {"q": q, "y": y}), ARM)[0]
    ]


@pytest.mark.parametrize("step", [1e-3, 1e-2, 3e-2])
def test_steps_of_a_coarse_encoder_are_no_stuck_sensor(step: float) -> None:
    """Although a velocity that was measured finely goes on while the position is held."""
    time = np.arange(8000) / 1000
    q, qd = 0.4 * np.sin(2 * time), 0.8 * np.cos(2 * time)
    held = np.round(q / step) * step
    everywhere = np.ones(len(time), dtype=bool)
    assert not list(stuck(time, held, [np.cos(3 * time)], qd, everywhere, False))
    held[2000:2600] = held[2000]
    assert list(stuck(time, held, [np.cos(3 * time)], qd, everywhere, False))
