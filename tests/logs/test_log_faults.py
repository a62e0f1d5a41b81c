"""Faults planted in logs are found at their place; clean logs give no findings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.faults.examine import examine
from echelon.identification.logs.faults.plausibility import check_plausible
from echelon.identification.logs.faults.repeated_values import runs
from echelon.identification.logs.finding import Severity
from echelon.identification.logs.preparation.segments import segments
from echelon.identification.logs.recording import Recording
from support.faulty_logs import ARM, COUNT, RATE, changed, clean, one

TREE = load("examples/floating_tree.yaml")


# -- clean logs --------------------------------------------------------------------------------------------------------


@given(st.integers(0, 10_000), st.sampled_from([0.0, 1e-5, 1e-2]))
def test_clean_logs_give_no_findings(seed: int, noise: float) -> None:
    recorded = clean(seed, noise)
    findings, usable = examine(recorded, ARM)
    assert [finding.kind for finding in findings] == ["smooth"] * (noise < 1e-9)
    assert usable.all()
    assert not check_plausible(recorded, ARM)
    assert not segments(recorded, ARM, usable)[1]


def test_joints_that_rest_are_not_stuck() -> None:
    """One joint after the other moves along quintics, on encoders that show nothing while it rests."""
    time = np.arange(COUNT) / RATE
    q = np.zeros((COUNT, 2))
    for column, start in ((0, 2.0), (1, 7.0), (0, 12.0)):
        s = np.clip((time - start) / 3, 0, 1)
        q[:, column] += 10 * s**3 - 15 * s**4 + 6 * s**5
    q = np.round(q / 1e-4) * 1e-4
    y = 9 * np.sin(q) + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    findings, usable = examine(Recording("run", time, {"q": q, "y": y}), ARM)
    assert usable.all()
    assert not findings


# -- planted faults ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("signal", "label"), [("q", "position"), ("qd", "velocity"), ("y", "output")]
)
def test_what_is_not_finite_is_named_and_cut_out(
    value: float, signal: str, label: str
) -> None:
    recorded = clean()
    values = recorded.signals[signal].copy()
    values[1000:1030, 1] = value
    values[3000, 1] = value
    recorded = changed(recorded, signal, values)
    findings, usable = examine(recorded, ARM)
    found = one(findings, "not finite")
    assert found.where == f"run, {label} of 'j2', from 4 s"
    assert "31 samples" in found.text
    assert "2 runs of up to 30" in found.text
    assert np.array_equal(np.flatnonzero(~usable), [*range(1000, 1030), 3000])
    parts, _ = segments(recorded, ARM, usable)
    assert [(part.start, len(part)) for part in parts] == [
        (0.0, 1000),
        (1030 / RATE, COUNT - 1030),
    ]
    assert all(np.isfinite(v).all() for part in parts for v in part.signals.values())


def test_samples_without_time_and_channels_without_numbers() -> None:
    recorded = clean()
    time = recorded.time.copy()
    time[7] = math.nan
    findings, usable = examine(replace(recorded, time=time), ARM)
    assert "row 7" in one(findings, "not finite").where
    assert np.flatnonzero(~usable).tolist() == [7]
    everything = {
        name: np.where(np.isnan(time)[:, None], math.nan, v)
        for name, v in recorded.signals.items()
    }
    one(
        examine(replace(recorded, time=time, signals=everything), ARM)[0], "not finite"
    )  # not once more per channel
    y = recorded.signals["y"].copy()
    y[:, 1] = math.nan
    with pytest.raises(ec.InputError, match="run: output of 'j2': it holds no numbers"):
        examine(changed(recorded, "y", y), ARM)
    with pytest.raises(ec.InputError, match="no samples"):
        examine(Recording("run", np.zeros(0), {"q": np.zeros((0, 2))}), ARM)


@pytest.mark.parametrize("noise", [1e-4, 0.05])
def test_spikes_are_left_out(noise: float) -> None:
    """Single samples and pairs, up and down, of forces as of positions, also across a turn of the encoder."""
    recorded = clean(noise=noise)
    q, y = (recorded.signals[name].copy() for name in ("q", "y"))
    planted = [700, 701, 1500, 2222, 4000]
    q[planted, 0] += [2.0, 2.0, -3.0, 1.5, 2.5]
    q[:, 0] = (q[:, 0] + np.pi) % (2 * np.pi) - np.pi
    y[1000, 1] += 3 * np.ptp(y[:, 1])
    signals = {"q": q, "y": y}
    findings, usable = examine(replace(recorded, signals=signals), ARM)
    assert np.flatnonzero(~usable).tolist() == sorted([*planted, 1000])
    assert [finding.text.split(" far")[0] for finding in findings] == [
        "5 outliers",
        "1 outlier",
    ]


def test_a_position_sensor_that_sticks() -> None:
    recorded = clean()
    fast = int(np.argmax(np.abs(recorded.signals["qd"][1000:3000, 0]))) + 1000
    q = recorded.signals["q"].copy()
    q[fast : fast + 200, 0] = q[fast, 0]
    without_speed = Recording(
        "run", recorded.time, {"q": q, "y": recorded.signals["y"]}
    )
    for stuck in (changed(recorded, "q", q), without_speed):
        findings, usable = examine(stuck, ARM)
        found = one(findings, "stuck")
        assert found.where == f"run, position of 'j1', from {fast / RATE:g} s"
        assert "200 samples" in found.text
        assert np.array_equal(np.flatnonzero(~usable), np.arange(fast, fast + 200))


def test_a_torque_sensor_that_sticks() -> None:
    recorded = clean()
    y = recorded.signals["y"].copy()
    y[2000:2300, 1] = y[2000, 1]
    findings, usable = examine(changed(recorded, "y", y), ARM)
    found = one(findings, "stuck")
    assert found.where == "run, output of 'j2', from 8 s"
    assert "until 9.196 s" in found.text
    assert np.array_equal(np.flatnonzero(~usable), np.arange(2000, 2300))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("step", [0.0, 0.2])
def test_saturation(sign: int, step: float) -> None:
    recorded = clean(noise=0.0)
    y = sign * recorded.signals["y"]
    if step:
        y = np.round(y / step) * step
    limit = round(float(np.percentile(y[:, 0], 97)) / 0.2) * 0.2
    clipped = np.minimum(y, [limit, np.inf])
    findings, usable = examine(changed(recorded, "y", sign * clipped), ARM)
    found = [finding for finding in findings if finding.kind == "saturation"]
    assert len(found) == 1
    starts, stops = runs(clipped[:, 0] >= limit - 1e-9)
    count = int(np.sum((stops - starts)[stops - starts >= 5]))
    assert f"extreme {sign * limit:.6g} in {count} samples" in found[0].text
    assert found[0].where.startswith("run, output of 'j1', from ")
    first = float(found[0].where.rsplit(" ", 2)[1])
    assert clipped[round(first * RATE), 0] == pytest.approx(limit)
    assert usable.all(), "only the user knows whether the sensor or the drive saturated"


def test_constant_columns() -> None:
    recorded = clean()
    for signal, text in (
        ("q", "cannot be identified"),
        ("y", "is the sensor connected"),
        ("qdd", "is this its column"),
    ):
        values = recorded.signals[signal].copy()
        values[:, 1] = 0.75
        kept = {
            name: v
            for name, v in recorded.signals.items()
            if name in (signal, "y", "q")
        }
        findings, usable = examine(
            replace(recorded, signals={**kept, signal: values}), ARM
        )
        found = one(findings, "constant")
        assert "0.75 in all 5000 samples" in found.text
        assert text in found.text
        assert usable.all()
        assert not examine(
            replace(recorded, signals={**kept, signal: values}), ARM, whole=False
        )[0]


def test_outputs_that_are_all_zero_are_refused() -> None:
    recorded = changed(clean(), "y", np.zeros((COUNT, 2)))
    with pytest.raises(
        ec.InputError,
        match="run: all measured outputs are zero, so there is nothing to identify",
    ):
        examine(recorded, ARM)
    examine(recorded, ARM, whole=False)


def test_columns_taken_twice() -> None:
    recorded = clean()
    y = recorded.signals["y"].copy()
    y[:, 1] = y[:, 0]
    found = one(examine(changed(recorded, "y", y), ARM)[0], "duplicate")
    assert found.where == "run, output of 'j1'"
    assert "output of 'j2'" in found.text
    same = replace(
        recorded, signals={**recorded.signals, "reference": recorded.signals["q"]}
    )
    assert [finding.kind for finding in examine(same, ARM)[0]] == [
        "duplicate",
        "duplicate",
    ]
    load = replace(recorded, inputs={"j1": recorded.signals["y"][:, 0]})
    assert not examine(load, ARM)[0]


def test_quaternions_that_are_none() -> None:
    time = np.arange(1000) / RATE
    names = TREE.positions
    q = np.tile(np.sin(time)[:, None], (1, len(names))) * np.arange(1, len(names) + 1)
    balls = [k for k, name in enumerate(names) if name.endswith(".w")]
    for first in balls:
        angle = 0.3 * np.sin(time * (1 + first))
        q[:, first : first + 4] = np.stack(
            [np.cos(angle), np.sin(angle) * 0.6, 0 * time, np.sin(angle) * 0.8], axis=1
        )
        q[:, first + 2] = 1e-9 * np.sin(time * first)
    assert {
        finding.kind for finding in examine(Recording("run", time, {"q": q}), TREE)[0]
    } == {"smooth"}
    name = names[balls[1]].removesuffix(".w")
    rough = q.copy()
    rough[:, balls[1] : balls[1] + 4] *= 1.01
    found = one(examine(Recording("run", time, {"q": rough}), TREE)[0], "quaternion")
    assert found.where == f"run, position of '{name}', from 0 s"
    assert found.severity is Severity.NOTE
    rough = q.copy()
    rough[100:150, balls[1] : balls[1] + 4] = 0
    findings, usable = examine(Recording("run", time, {"q": rough}), TREE)
    assert (
        "50 samples with a quaternion of length 0" in one(findings, "quaternion").text
    )
    assert np.array_equal(np.flatnonzero(~usable), np.arange(100, 150))
    parts, _ = segments(Recording("run", time, {"q": rough}), TREE, usable)
    assert [len(part) for part in parts] == [100, 850]


def test_an_encoder_that_is_set_to_another_zero_is_named() -> None:
    recorded = clean()
    q = recorded.signals["q"].copy()
    q[3000:, 1] += 0.2
    findings, usable = examine(changed(recorded, "q", q), ARM)
    (jump,) = (finding for finding in findings if "jumps" in finding.text)
    assert (
        "jumps by 0.192 between two samples" in jump.text
    )  # with the motion of one sample
    assert "position of 'j2'" in jump.where
    assert not usable[2995:3005].any()
    q[3000:, 0] -= 0.3  # two encoders at once are rather samples that are missing
    assert "contradiction" not in {
        finding.kind
        for finding in examine(Recording("run", recorded.time, {"q": q}), ARM)[0]
    }


def test_a_coarse_output_is_not_stuck() -> None:
    recorded = clean()
    step = np.ptp(recorded.signals["y"][:, 1]) / 4
    y = recorded.signals["y"].copy()
    y[:, 1] = np.round(y[:, 1] / step) * step
    assert examine(changed(recorded, "y", y), ARM)[1].all()
