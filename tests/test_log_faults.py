"""Faults planted in logs are found at their place; clean logs give no findings."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.formats.load import load
from echelon.logs.channels import recording
from echelon.logs.column_map import Channel, ColumnMap
from echelon.logs.faults import examine
from echelon.logs.finding import Finding, Severity
from echelon.logs.guess import guess_columns
from echelon.logs.plausibility import check_plausible, surplus_columns
from echelon.logs.recording import Recording
from echelon.logs.segments import segments
from echelon.logs.standstill import resolution, runs
from echelon.logs.table import Table

Floats = npt.NDArray[np.float64]

DATA = Path(os.environ.get("ECHELON_DATA", Path(__file__).parent.parent.parent / "shared" / "data"))

ARM = load("examples/double_pendulum.yaml")
GRIPPER = load("examples/gripper_coupled.yaml")
TREE = load("examples/floating_tree.yaml")
PANDA = load("examples/panda.yaml")
TX40 = load("examples/tx40.yaml")

RATE = 250.0
COUNT = 5000


def clean(seed: int = 0, noise: float = 1e-4, count: int = COUNT) -> Recording:
    """A smooth motion of two joints with its exact derivatives, outputs that depend on it, and some noise."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / RATE
    q, qd, qdd = (np.zeros((count, 2)) for _ in range(3))
    for column in range(2):
        for _ in range(4):
            size, omega, phase = random.uniform(0.2, 0.6), random.uniform(1, 9), random.uniform(0, 6)
            q[:, column] += size * np.sin(omega * time + phase)
            qd[:, column] += size * omega * np.cos(omega * time + phase)
            qdd[:, column] -= size * omega**2 * np.sin(omega * time + phase)
    y = 2 * qdd + 0.5 * np.tanh(50 * qd) + 9 * np.sin(q)
    shaken = {
        name: v + noise * random.normal(size=v.shape) for name, v in {"q": q, "qd": qd, "qdd": qdd, "y": y}.items()
    }
    return Recording("run", time, shaken)


def changed(recording: Recording, signal: str, values: Floats) -> Recording:
    return replace(recording, signals={**recording.signals, signal: values})


def one(findings: tuple[Finding, ...], kind: str) -> Finding:
    found = [finding for finding in findings if finding.kind == kind]
    assert len(found) == 1, [str(finding) for finding in findings]
    assert len(findings) == 1, [str(finding) for finding in findings]
    return found[0]


# -- clean logs -------------------------------------------------------------------------------------------------------


@given(st.integers(0, 10_000), st.sampled_from([0.0, 1e-5, 1e-2]))
def test_clean_logs_give_no_findings(seed: int, noise: float) -> None:
    recorded = clean(seed, noise)
    findings, usable = examine(recorded, ARM)
    assert not findings
    assert usable.all()
    assert not check_plausible(recorded, ARM)
    assert not segments(recorded, ARM, usable)[1]


@given(st.integers(0, 1000), st.integers(7, 16))
def test_coarse_sensors_are_neither_stuck_nor_saturated(seed: int, bits: int) -> None:
    """Quantised channels repeat values for long, at turning points longest, and reach their extremes many times."""
    recorded = clean(seed, 0.0)
    signals = {name: np.round(v / np.ptp(v) * 2**bits) * np.ptp(v) / 2**bits for name, v in recorded.signals.items()}
    findings, usable = examine(replace(recorded, signals=signals), ARM)
    assert usable.all()
    assert {finding.kind for finding in findings} <= {"resolution"}


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


# -- planted faults ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(("signal", "label"), [("q", "position"), ("qd", "velocity"), ("y", "output")])
def test_what_is_not_finite_is_named_and_cut_out(value: float, signal: str, label: str) -> None:
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
    assert [(part.start, len(part)) for part in parts] == [(0.0, 1000), (1030 / RATE, COUNT - 1030)]
    assert all(np.isfinite(v).all() for part in parts for v in part.signals.values())


def test_samples_without_time_and_channels_without_numbers() -> None:
    recorded = clean()
    time = recorded.time.copy()
    time[7] = math.nan
    findings, usable = examine(replace(recorded, time=time), ARM)
    assert "row 7" in one(findings, "not finite").where
    assert np.flatnonzero(~usable).tolist() == [7]
    y = recorded.signals["y"].copy()
    y[:, 1] = math.nan
    with pytest.raises(ec.InputError, match="run: output of 'j2': it holds no numbers"):
        examine(changed(recorded, "y", y), ARM)
    with pytest.raises(ec.InputError, match="no samples"):
        examine(Recording("run", np.zeros(0), {"q": np.zeros((0, 2))}), ARM)


def test_a_position_sensor_that_sticks() -> None:
    recorded = clean()
    fast = int(np.argmax(np.abs(recorded.signals["qd"][1000:3000, 0]))) + 1000
    q = recorded.signals["q"].copy()
    q[fast : fast + 200, 0] = q[fast, 0]
    without_speed = Recording("run", recorded.time, {"q": q, "y": recorded.signals["y"]})
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
        kept = {name: v for name, v in recorded.signals.items() if name in (signal, "y", "q")}
        findings, usable = examine(replace(recorded, signals={**kept, signal: values}), ARM)
        found = one(findings, "constant")
        assert "0.75 in all 5000 samples" in found.text
        assert text in found.text
        assert usable.all()
        assert not examine(replace(recorded, signals={**kept, signal: values}), ARM, whole=False)[0]


def test_outputs_that_are_all_zero_are_refused() -> None:
    recorded = changed(clean(), "y", np.zeros((COUNT, 2)))
    with pytest.raises(ec.InputError, match="run: all measured outputs are zero, so there is nothing to identify"):
        examine(recorded, ARM)
    examine(recorded, ARM, whole=False)


def test_columns_taken_twice() -> None:
    recorded = clean()
    y = recorded.signals["y"].copy()
    y[:, 1] = y[:, 0]
    found = one(examine(changed(recorded, "y", y), ARM)[0], "duplicate")
    assert found.where == "run, output of 'j1'"
    assert "output of 'j2'" in found.text
    same = replace(recorded, signals={**recorded.signals, "reference": recorded.signals["q"]})
    assert [finding.kind for finding in examine(same, ARM)[0]] == ["duplicate", "duplicate"]


def test_coarse_positions_are_noted_with_their_step() -> None:
    recorded = clean()
    step = math.tau / 400
    found = one(
        examine(changed(recorded, "q", np.round(recorded.signals["q"] / step) * step), ARM)[0][:1], "resolution"
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
    signals = {name: np.repeat(slow.signals[name], factor, axis=0) for name in ("q", "y")}
    fast = Recording("run", np.arange(COUNT) / RATE / factor, signals)
    found = one(examine(fast, ARM)[0], "held")
    assert f"every {factor} samples" in found.text
    assert "rate: 250" in found.text


def test_encoders_that_creep_are_not_held() -> None:
    time = np.arange(COUNT) / RATE
    ramp = np.floor(time / 0.04 + 1e-9) * 1e-3
    q = np.stack([ramp, ramp + 1], axis=1)
    y = np.random.default_rng(0).normal(size=q.shape)
    assert "held" not in [finding.kind for finding in examine(Recording("run", time, {"q": q, "y": y}), ARM)[0]]


FACTORS = [
    (-1.0, "wrong sign"),
    (180 / math.pi, "deg/s (unit: deg/s)"),
    (math.pi / 180, "position were in degrees (unit: deg)"),
    (30 / math.pi, "rpm"),
    (-0.5 / math.pi, "rev/s), with the wrong sign"),
    (1000.0, "time were in ms"),
    (100.0, "ratio (scale) differ"),
]


@pytest.mark.parametrize(("ratio", "hint"), FACTORS)
def test_velocities_that_contradict_positions(ratio: float, hint: str) -> None:
    recorded = clean()
    qd = recorded.signals["qd"].copy()
    qd[:, 1] *= ratio
    signals = {**recorded.signals, "qd": qd}
    del signals["qdd"]
    found = one(examine(replace(recorded, signals=signals), ARM)[0], "contradiction")
    assert found.where == "run, velocity of 'j2'"
    assert hint in found.text
    assert float(found.text.split()[1]) == pytest.approx(ratio, rel=1e-3)


def test_velocities_of_another_joint_and_accelerations() -> None:
    recorded = clean()
    signals = {**recorded.signals, "qd": recorded.signals["qd"][:, ::-1]}
    del signals["qdd"]
    findings, _ = examine(replace(recorded, signals=signals), ARM)
    assert [finding.kind for finding in findings] == ["contradiction"] * 2
    assert "does not follow the position of 'j1'" in findings[0].text
    flipped = changed(recorded, "qdd", -recorded.signals["qdd"])
    findings, _ = examine(flipped, ARM)
    assert {finding.where for finding in findings} == {"run, acceleration of 'j1'", "run, acceleration of 'j2'"}


def test_wrapped_angles_do_not_contradict_their_velocity() -> None:
    time = np.arange(COUNT) / RATE
    q = np.stack([3 * time + 0.2 * np.sin(5 * time), np.sin(time)], axis=1)
    qd = np.stack([3 + np.cos(5 * time), np.cos(time)], axis=1)
    wrapped = np.stack([(q[:, 0] + np.pi) % math.tau - np.pi, q[:, 1]], axis=1)
    assert not examine(Recording("run", time, {"q": wrapped, "qd": qd}), ARM)[0]


def test_quaternions_that_are_none() -> None:
    time = np.arange(1000) / RATE
    names = TREE.positions
    q = np.tile(np.sin(time)[:, None], (1, len(names))) * np.arange(1, len(names) + 1)
    balls = [k for k, name in enumerate(names) if name.endswith(".w")]
    for first in balls:
        angle = 0.3 * np.sin(time * (1 + first))
        q[:, first : first + 4] = np.stack([np.cos(angle), np.sin(angle) * 0.6, 0 * time, np.sin(angle) * 0.8], axis=1)
        q[:, first + 2] = 1e-9 * np.sin(time * first)
    assert not examine(Recording("run", time, {"q": q}), TREE)[0]
    name = names[balls[1]].removesuffix(".w")
    rough = q.copy()
    rough[:, balls[1] : balls[1] + 4] *= 1.01
    found = one(examine(Recording("run", time, {"q": rough}), TREE)[0], "quaternion")
    assert found.where == f"run, position of '{name}', from 0 s"
    assert found.severity is Severity.NOTE
    rough = q.copy()
    rough[100:150, balls[1] : balls[1] + 4] = 0
    findings, usable = examine(Recording("run", time, {"q": rough}), TREE)
    assert "50 samples with a quaternion of length 0" in one(findings, "quaternion").text
    assert np.array_equal(np.flatnonzero(~usable), np.arange(100, 150))
    parts, _ = segments(Recording("run", time, {"q": rough}), TREE, usable)
    assert [len(part) for part in parts] == [100, 850]


# -- magnitudes -------------------------------------------------------------------------------------------------------

MAP = ColumnMap(
    time=Channel("t"),
    positions={"j1": Channel("a"), "j2": Channel("b")},
    outputs={"j1": Channel("c"), "j2": Channel("d")},
)


def with_unit(group: str, unit: str) -> ColumnMap:
    own: Mapping[str, Channel] = getattr(MAP, group)
    return replace(MAP, **{group: {name: replace(channel, unit=unit) for name, channel in own.items()}})  # type: ignore[arg-type]


def test_degrees_taken_for_radians() -> None:
    recorded = clean()
    degrees = changed(recorded, "q", np.degrees(recorded.signals["q"]))
    with pytest.raises(ec.InputError, match=r"'j1', 'j2': angles up to .* turns: are they in degrees \(unit: deg\)"):
        check_plausible(degrees, ARM, MAP)
    assert not check_plausible(degrees, ARM, with_unit("positions", "rad"))
    counts = changed(recorded, "q", 4096 * recorded.signals["q"])
    with pytest.raises(ec.InputError, match="encoder counts"):
        check_plausible(counts, ARM, MAP)
    wheel = changed(recorded, "q", recorded.signals["q"] * [1, 1] + np.outer(recorded.time, [2, 0]))
    (found,) = check_plausible(wheel, ARM, MAP)
    assert found.kind == "units"
    assert "'j1': angles" in found.text


def test_radians_taken_for_degrees() -> None:
    recorded = clean()
    small = changed(recorded, "q", np.radians(recorded.signals["q"]))
    (found,) = check_plausible(small, ARM, with_unit("positions", "deg"))
    assert "are the columns in rad" in found.text
    assert not check_plausible(small, ARM, MAP)


@pytest.mark.parametrize(("scale", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_time_in_smaller_units(scale: float, unit: str) -> None:
    recorded = clean()
    slow = replace(recorded, time=recorded.time * scale)
    with pytest.raises(ec.InputError, match=rf"column 't': .*is time in {unit} \(unit: {unit}; 250 samples per second"):
        check_plausible(slow, ARM, MAP)
    assert not check_plausible(slow, ARM, replace(MAP, time=Channel("t", "s")))
    assert not check_plausible(recorded, ARM, replace(MAP, time=Channel("t", unit)))
    assert [finding.kind for finding in check_plausible(slow, ARM)] == ["time"]
    fast = replace(recorded, time=recorded.time / scale)
    (found,) = check_plausible(fast, ARM, replace(MAP, time=Channel("t", unit)))
    assert "is time in s?" in found.text


def test_millimetres_taken_for_metres() -> None:
    names = GRIPPER.positions
    time = np.arange(1000) / RATE
    scale = np.array([120.0 if name == "left" else 1.0 for name in names])
    q = np.sin(np.outer(time, np.arange(1, len(names) + 1)))
    positions = {name: Channel(name) for name in names}
    with pytest.raises(ec.InputError, match="position of 'left': it goes to 120 m: is it in mm"):
        check_plausible(Recording("run", time, {"q": q * scale}), GRIPPER, ColumnMap(positions=positions))
    stated = positions | {"left": Channel("left", "mm")}
    assert not check_plausible(Recording("run", time, {"q": q}), GRIPPER, ColumnMap(positions=stated))
    (found,) = check_plausible(Recording("run", time, {"q": q * scale**-2}), GRIPPER, ColumnMap(positions=stated))
    assert "is the column in m (leave out unit: mm)" in found.text


def test_torques_beyond_every_robot_and_beyond_this_one() -> None:
    recorded = clean()
    strong = changed(recorded, "y", 1000 * recorded.signals["y"])
    with pytest.raises(ec.InputError, match=r"output of 'j1': it goes to .* is it in mN·m \(unit: mN·m\)"):
        check_plausible(strong, ARM, MAP)
    assert not check_plausible(strong, ARM, with_unit("outputs", "N·m"))
    known = replace(ARM, bodies=tuple(replace(body, inertial=(0.1,) * 9 + (0.5,)) for body in ARM.bodies))
    assert not check_plausible(recorded, known, MAP)
    (found,) = check_plausible(changed(recorded, "y", 30 * recorded.signals["y"]), known, MAP)
    assert "where the weight of the described robot makes" in found.text
    (found,) = check_plausible(changed(recorded, "y", 1e-6 * recorded.signals["y"]), known, MAP)
    assert "kN·m" in found.text


def test_a_log_with_more_joints() -> None:
    used = ColumnMap(positions={f"j{n}": Channel(f"q_rad_{n}") for n in range(1, 7)})
    names = ["t_s", *(f"q_rad_{n}" for n in range(1, 8)), "tau_1"]
    (found,) = surplus_columns(used, names)
    assert "'q_rad_7' beside the 6 columns" in found.text
    assert not surplus_columns(used, names[:7])


# -- real logs --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("folder", "robot"),
    [
        ("double_pendulum", ARM),
        ("panda_1khz", PANDA),
        ("panda_30hz", PANDA),
        ("kuka_lwr4", PANDA),
        ("staubli_tx40", TX40),
    ],
)
def test_real_logs_are_sound(folder: str, robot: ec.Mechanism) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    files = sorted((DATA / folder).glob("*.parquet"))
    if not files:
        pytest.skip(f"the measured logs are not there: {DATA / folder}")
    for file in files:
        read = parquet.read_table(file)
        table = Table(file.name, {name: read[name].to_numpy().astype(float) for name in read.column_names})
        recorded = recording(table, guess_columns(list(table.columns), robot), robot)
        findings, usable = examine(recorded, robot)
        assert usable.all()
        assert not findings
        assert not check_plausible(recorded, robot)
        parts, more = segments(recorded, robot, usable)
        assert len(parts) == 1
        assert {finding.kind for finding in more} <= {"jitter", "missing"}
        span = recorded.time[-1] - recorded.time[0]
        assert len(parts[0]) == pytest.approx(span * parts[0].rate, abs=1.5)


def test_the_panda_log_names_its_lost_packets() -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    file = DATA / "panda_1khz" / "panda_gaz_exciting_1kHz.parquet"
    if not file.is_file():
        pytest.skip(f"the measured log is not there: {file}")
    read = parquet.read_table(file)
    table = Table(file.name, {name: read[name].to_numpy() for name in read.column_names})
    recorded = recording(table, guess_columns(list(table.columns), PANDA), PANDA)
    (part,), findings = segments(recorded, PANDA)
    assert part.rate == 1000
    missing = next(finding for finding in findings if finding.kind == "missing")
    assert f"{len(part) - len(recorded.time)} samples are missing" in missing.text
    assert "up to 8.81 ms" in missing.text

    def mismatch(signals: Mapping[str, Floats]) -> float:
        """How far positions, 100 samples apart, are from what the logged velocity says at 1 kHz, rms."""
        q, qd = signals["q"], signals["qd"]
        travelled = np.cumsum(0.5 * (qd[1:] + qd[:-1]), axis=0) / 1000
        return float(np.sqrt(np.mean(((travelled[100:] - travelled[:-100]) - (q[101:] - q[1:-100])) ** 2)))

    assert mismatch(part.signals) < 1e-3
    assert mismatch(recorded.signals) > 3e-3, "without resampling the lost time is missing"
