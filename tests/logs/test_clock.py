"""Time stamps, uniform segments and resampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import echelon as ec
from echelon.identification.logs.finding import Finding
from echelon.identification.logs.preparation.segments import FEWEST, segments
from echelon.identification.logs.recording import Recording
from echelon.identification.signals.clock import (
    grid,
    interpolated,
    low_passed,
    regularity,
    round_rate,
    stretches,
)

Floats = npt.NDArray[np.float64]

ARM = ec.load("examples/double_pendulum.yaml")
TREE = ec.load("examples/floating_tree.yaml")


def wave(time: Floats, highest: float = 3.0) -> Floats:
    """A band-limited signal of known derivatives, amplitude below 1."""
    return np.sin(2 * np.pi * highest * time + 0.3) * 0.6 + 0.3 * np.cos(
        2 * np.pi * 0.37 * highest * time
    )


def log(time: Floats, **more: Floats) -> Recording:
    q = np.stack([wave(time), wave(time, 1.7)], axis=1)
    return Recording(
        "run", time, {"q": q, "y": 3 * q[:, ::-1], **more}, {"j1": 2 * wave(time)}
    )


def jittered(count: int, period: float, share: float, seed: int = 1) -> Floats:
    random = np.random.default_rng(seed)
    return np.sort((np.arange(count) + share * random.uniform(-1, 1, count)) * period)


def kinds(findings: tuple[Finding, ...]) -> list[str]:
    return [finding.kind for finding in findings]


# -- stamps -----------------------------------------------------------------------------------------------------------


def test_uniform_stamps_are_left_alone() -> None:
    time = 1.6e9 + np.round(np.arange(2000) * 0.002, 4)
    recording = log(time)
    (segment,), findings = segments(recording, ARM)
    assert not findings
    assert segment.rate == 500
    for name, values in recording.signals.items():
        assert np.array_equal(segment.signals[name], values)
    assert np.array_equal(segment.inputs["j1"], recording.inputs["j1"])
    assert np.allclose(segment.time, time, atol=1e-6)


def test_a_uniform_clock_of_no_round_rate_keeps_its_rate() -> None:
    (segment,), findings = segments(log(np.arange(5000) / 499.71), ARM)
    assert not findings
    assert segment.rate == pytest.approx(499.71, rel=1e-9)


@pytest.mark.parametrize(
    ("share", "bound"), [(0.05, 5e-6), (0.3, 1e-5), (0.45, 1.5e-5)]
)
def test_jitter_is_resampled_to_a_stated_accuracy(share: float, bound: float) -> None:
    """The error of a spline is at most 5/384 of the fourth derivative times h⁴, h the longest interval."""
    time = jittered(3000, 0.002, share)
    recording = replace(
        log(time), signals={"q": np.stack([wave(time, 10), wave(time)], axis=1)}
    )
    (segment,), findings = segments(recording, ARM)
    assert kinds(findings) == ["jitter"]
    assert f"{segment.rate:g} Hz" in findings[0].text
    assert segment.rate == pytest.approx(500, rel=0.01)
    inside = slice(10, -10)
    exact = np.stack([wave(segment.time, 10), wave(segment.time)], axis=1)
    worst = np.abs(segment.signals["q"] - exact)[inside].max(axis=0)
    assert worst[0] < bound
    assert worst[1] < bound / 50
    nearest = recording.signals["q"][: len(exact)]
    assert np.abs(nearest - exact).max() > 100 * bound, (
        "ignoring the jitter would be much worse"
    )


def test_lost_samples_are_bridged_and_counted() -> None:
    kept = np.ones(4000, dtype=bool)
    kept[[100, 101, 102, 900, 2000, 2001]] = False
    time = np.arange(4000)[kept] / 1000
    (segment,), findings = segments(log(time), ARM)
    assert kinds(findings) == ["missing", "jitter"]
    assert "6 samples" in findings[0].text
    assert "up to 4 ms" in findings[0].text
    assert len(segment) == 4000
    assert np.abs(segment.signals["q"][:, 0] - wave(segment.time)).max() < 1e-6


def test_gaps_split_and_are_named() -> None:
    time = np.concatenate(
        [np.arange(200) * 0.01, 5 + np.arange(300) * 0.01, 20 + np.arange(5) * 0.01]
    )
    parts, findings = segments(log(time), ARM)
    assert [(len(part), part.start) for part in parts] == [(200, 0.0), (300, 5.0)]
    assert kinds(findings) == ["gap", "short"]
    assert "2 gaps" in findings[0].text
    assert "12.01 s" in findings[0].text
    assert "1.99 s" in findings[0].where
    assert "5 samples" in findings[1].text
    assert [len(part) for part in segments(log(time), ARM, gap=400)[0]] == [800]
    with pytest.raises(ec.InputError, match="at least one period"):
        segments(log(time), ARM, gap=0.5)


def test_a_clock_that_jumps_back_splits_where_runs_were_joined() -> None:
    time = np.concatenate([np.arange(300) * 0.004, np.arange(250) * 0.004])
    parts, findings = segments(log(time), ARM)
    assert [len(part) for part in parts] == [300, 250]
    assert kinds(findings) == ["backward"]
    assert "1.196 → 0 s" in findings[0].text


def test_time_without_order_is_refused() -> None:
    time = np.random.default_rng(0).permutation(500) * 0.01
    row = int(np.flatnonzero(np.diff(time) < 0)[0]) + 1
    with pytest.raises(
        ec.InputError, match=rf"run: time goes backwards .* first at row {row} "
    ):
        segments(log(time), ARM)
    with pytest.raises(ec.InputError, match="never advances"):
        segments(log(np.zeros(100)), ARM)
    with pytest.raises(ec.InputError, match=r"coarser than the samples.*give rate"):
        segments(log(np.floor(np.arange(2000) / 5) * 0.001), ARM)


@given(st.sets(st.integers(1, 399), max_size=12), st.integers(0, 1000))
def test_duplicates_are_dropped_in_any_order(places: set[int], seed: int) -> None:
    """Repeated rows anywhere change nothing but the findings."""
    time = jittered(400, 0.01, 0.2, seed)
    rows = np.sort(np.concatenate([np.arange(400), sorted(places)])).astype(int)
    recording = log(time)
    doubled = replace(
        recording,
        time=time[rows],
        signals={name: values[rows] for name, values in recording.signals.items()},
        inputs={"j1": recording.inputs["j1"][rows]},
    )
    found = stretches(doubled.time)
    assert len(found.duplicates) == len(places)
    assert len(found.pieces) == 1
    plain, _ = segments(recording, ARM)
    parts, findings = segments(doubled, ARM)
    assert ("duplicates" in kinds(findings)) == bool(places)
    assert np.array_equal(parts[0].signals["q"], plain[0].signals["q"])


@given(
    st.lists(st.sampled_from([0.0, 0.01, 0.012, 0.5, -0.3]), min_size=30, max_size=120)
)
def test_pieces_increase_and_hold_every_sample_once(steps: list[float]) -> None:
    time = np.cumsum([0.0, *steps])
    try:
        found = stretches(time)
    except ec.InputError:
        assert (
            not any(s > 0 for s in steps)
            or sum(s == 0 for s in steps) > 5
            or sum(s < 0 for s in steps) > 1
        )
        return
    together = np.concatenate([*found.pieces, found.duplicates])
    assert sorted(together.tolist()) == list(range(len(time)))
    for piece in found.pieces:
        assert np.all(np.diff(time[piece]) > 0)
        assert np.all(np.diff(time[piece]) <= 10 * found.period)


def test_the_nominal_period_survives_late_and_coarse_stamps() -> None:
    late = np.cumsum(np.where(np.arange(1000) % 10 == 0, 0.005, 0.002))
    assert stretches(late).period == pytest.approx(0.002)
    coarse = np.round(np.arange(3000) / 300, 3)
    assert 1 / stretches(coarse).period == pytest.approx(300, rel=2e-3)
    assert round_rate(stretches(coarse).period) == 300
    assert regularity(coarse, 1 / 300).missing == 0
    assert stretches(np.array([0.0, 1, 11])).period == 5.5


# -- rates ------------------------------------------------------------------------------------------------------------


def test_a_lower_rate_folds_nothing_into_the_band() -> None:
    time = np.arange(8000) / 1000
    noisy = np.stack([wave(time) + 0.2 * np.sin(2 * np.pi * 180 * time)] * 2, axis=1)
    (segment,), findings = segments(Recording("run", time, {"q": noisy}), ARM, rate=100)
    assert kinds(findings) == ["rate"]
    assert segment.rate == 100
    assert len(segment) == 800
    inside = slice(50, -50)
    assert np.abs(segment.signals["q"][:, 0] - wave(segment.time))[inside].max() < 1e-4
    assert np.abs(noisy[::10, 0] - wave(time[::10]))[inside].max() > 0.1, (
        "plain decimation would fold it down"
    )


def test_a_rate_that_is_no_divisor() -> None:
    time = jittered(6000, 0.001, 0.2)
    (segment,), _ = segments(log(time), ARM, rate=333)
    assert segment.rate == 333
    assert np.abs(segment.signals["q"][:, 0] - wave(segment.time))[40:-40].max() < 1e-4


def test_a_rate_that_leaves_too_few_samples_is_refused() -> None:
    with pytest.raises(
        ec.InputError,
        match="no stretch without gaps has 20 samples: the longest of 1 has 10, at 1 Hz",
    ):
        segments(log(np.arange(10_000) / 1000), ARM, rate=1)


def test_a_higher_rate_is_refused() -> None:
    with pytest.raises(
        ec.InputError,
        match=r"100 samples per second; at a rate of 150 the others would be invented",
    ):
        segments(log(np.arange(500) * 0.01), ARM, rate=150)
    with pytest.raises(ec.InputError, match="positive"):
        segments(log(np.arange(500) * 0.01), ARM, rate=-1)


@pytest.mark.parametrize("ratio", [0.5, 0.1, 0.9])
def test_gain_of_the_low_pass(ratio: float) -> None:
    time = np.arange(6000.0)
    for share, gain in (
        (0.79 * ratio, 1.0),
        (0.2 * ratio, 1.0),
        (1.0 * ratio, 0.0),
        (1.0, 0.0),
    ):
        found = low_passed(np.cos(np.pi * share * time), ratio)[1000:-1000]
        assert (
            np.abs(found - gain * np.cos(np.pi * share * time)[1000:-1000]).max() < 2e-4
        )


def test_interpolation_is_exact_for_cubics_and_for_few_samples() -> None:
    time = jittered(30, 1.0, 0.3)
    wanted = np.linspace(time[0], time[-1], 77)
    cubic = np.polynomial.Polynomial([1.0, -2, 0.3, 0.01])
    assert np.allclose(
        interpolated(time, cubic(time), wanted), cubic(wanted), rtol=1e-11
    )
    assert interpolated(time[:2], np.array([[1.0], [3]]), time[:1]).tolist() == [[1.0]]
    assert interpolated(time[:1], np.array([4.0]), time[:1]).tolist() == [4.0]


@given(
    st.floats(0, 2e9),
    st.integers(1, 2000),
    st.sampled_from([30.0, 100.0, 333.0, 1000.0]),
)
def test_grids_end_at_the_last_sample(first: float, count: int, rate: float) -> None:
    times = grid(first, first + (count - 1) / rate, rate)
    assert len(times) == count


# -- rotations --------------------------------------------------------------------------------------------------------


def test_angles_that_were_wrapped_are_made_continuous() -> None:
    time = jittered(2000, 0.005, 0.2)
    angle = np.stack([2.5 * time, wave(time)], axis=1)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    (segment,), findings = segments(
        Recording("run", time, {"q": wrapped, "reference": angle}), ARM
    )
    assert kinds(findings) == ["jitter", "wrapped"]
    assert "position of 'j1'" in findings[1].where
    assert (
        f"{int(np.sum(np.abs(np.diff(wrapped[:, 0])) > 3))} times" in findings[1].text
    )
    assert np.allclose(segment.signals["q"][:, 0], 2.5 * segment.time, atol=1e-9)


def test_quaternions_keep_sign_and_norm() -> None:
    time = jittered(1000, 0.01, 0.3)
    names = TREE.positions
    balls = [k for k, name in enumerate(names) if name.endswith(".w")]
    assert len(balls) == 2

    def turned(at: Floats) -> Floats:
        angles = np.stack([0.8 * wave(at, 0.5), 2 * at, 0.3 * wave(at, 0.9)], axis=1)
        return Rotation.from_euler("xyz", angles).as_quat()[:, [3, 0, 1, 2]]

    q = np.tile(wave(time)[:, None], (1, len(names)))
    for first in balls:
        flips = np.where(
            np.random.default_rng(first).random(len(time)) < 0.5, -1.0, 1.0
        )
        q[:, first : first + 4] = turned(time) * flips[:, None]
    (segment,), _ = segments(Recording("run", time, {"q": q}), TREE)
    for first in balls:
        found = segment.signals["q"][:, first : first + 4]
        exact = turned(segment.time)
        assert np.allclose(np.linalg.norm(found, axis=1), 1, atol=1e-14)
        assert np.all(np.einsum("ij,ij->i", found[1:], found[:-1]) > 0)
        assert np.abs(np.abs(np.einsum("ij,ij->i", found, exact)) - 1).max() < 1e-9


# -- what is left out -------------------------------------------------------------------------------------------------


def test_what_is_not_usable_splits_or_is_bridged() -> None:
    time = np.arange(1000) / 200
    recording = log(time)
    q = recording.signals["q"].copy()
    q[300:303, 1] = np.nan
    usable = np.ones(1000, dtype=bool)
    usable[500:560] = False
    parts, findings = segments(replace(recording, signals={"q": q}), ARM, usable)
    assert [len(part) for part in parts] == [500, 440]
    assert set(kinds(findings)) == {"gap", "missing", "jitter"}
    assert np.abs(parts[0].signals["q"][:, 1] - wave(parts[0].time, 1.7)).max() < 1e-5
    assert parts[1].start == time[560]


def test_too_little_is_refused_but_not_in_a_piece_of_a_log() -> None:
    time = np.arange(FEWEST - 1) * 0.01
    with pytest.raises(
        ec.InputError,
        match=f"run: {FEWEST - 1} usable samples of {FEWEST - 1}; at least {FEWEST}",
    ):
        segments(log(time), ARM)
    parts, findings = segments(log(time), ARM, whole=False)
    assert not parts
    assert kinds(findings) == ["short"]
    scattered = np.concatenate(
        [[0, 0.01, 0.02 + 0.01 * k] for k in range(3)]
    ) + np.repeat(np.arange(3) * 9.0, 3)
    many = np.concatenate([scattered + 100 * k for k in range(5)])
    with pytest.raises(
        ec.InputError,
        match="no stretch without gaps has 20 samples: the longest of 15 has 3",
    ):
        segments(log(many), ARM)
