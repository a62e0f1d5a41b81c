"""Preparation of logs: states, samples, windows and automatic settings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from scipy.spatial.transform import Rotation

import echelon as ec
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    PreparationPlan,
    has_dry_friction,
    prepare,
    speed_rows,
)
from echelon.identification.logs.recording import Segment
from echelon.shared.errors import InputError
from support.measured_logs import measured
from support.paths import ROOT

RATE = 500.0
OPEN = Preparation()
FIXED = Preparation(band=10.0, measured=(), still=0.0, delays={})

FRICTION = """
effects:
  - {type: viscous, at: all}
  - {type: coulomb, at: all}
"""


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> ec.Mechanism:
    """A double pendulum with dry friction."""
    file = tmp_path_factory.mktemp("robot") / "pendulum.yaml"
    file.write_text(
        (ROOT / "examples" / "double_pendulum.yaml")
        .read_text()
        .partition("effects:")[0]
        + FRICTION
    )
    return ec.load(file)


def curves(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions of two joints with their derivatives."""
    w = 2 * np.pi * np.array([[0.3, 0.7, 1.1], [0.4, 0.6, 1.3]])
    a = np.array([[0.9, 0.5, 0.2], [0.7, 0.6, 0.3]])
    angle = t[:, None, None] * w + np.arange(6).reshape(2, 3)
    return (
        (a * np.sin(angle)).sum(2),
        (a * w * np.cos(angle)).sum(2),
        -(a * w**2 * np.sin(angle)).sum(2),
    )


def simulated(
    base: ec.BaseModel, count: int = 12000, noise: float = 0.0, seed: int = 0
) -> tuple[Segment, np.ndarray]:
    """A log of the pendulum, and the parameters behind it."""
    random = np.random.default_rng(seed)
    values = random.uniform(0.5, 1.5, base.rank)
    q, qd, qdd = curves(np.arange(count) / RATE)
    y = base.predict(q, qd, qdd, values)
    q = q + noise * random.standard_normal(q.shape)
    y = y + 1000 * noise * random.standard_normal(y.shape)
    return Segment("run.csv", 2.0, RATE, {"q": q, "y": y}), values


# -- states and samples ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [30.0, RATE])
def test_states_are_those_of_the_motion(pendulum: ec.Mechanism, rate: float) -> None:
    """At 30 Hz, too, where what is spoilt at each end is less than two thirds of a second."""
    count = int(20 * rate)
    q, qd, qdd = curves(np.arange(count) / rate)
    settings_ = FIXED.model_copy(update={"band": min(10.0, rate / 8)})
    found = prepare(Segment("run", 0.0, rate, {"q": q}), settings_, pendulum)
    first = round(found.start * rate)
    inside = slice(first, first + len(found))
    assert first < 0.67 * rate
    assert np.abs(found.q - q[inside]).max() < 1e-4
    assert np.abs(found.qd - qd[inside]).max() < 2e-3
    error = np.abs(found.qdd - qdd[inside])
    assert (
        error.max() < 5e-3 * np.abs(qdd).max()
    )  # at the ends, where filters are not yet settled
    assert (
        error[round(0.2 * rate) : -round(0.2 * rate)].max() < 1e-3 * np.abs(qdd).max()
    )
    assert found.y is None
    assert found.moving is None


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_parameters_come_back_without_a_setting_made(
    pendulum: ec.Mechanism, noise: float
) -> None:
    base = ec.base_parameters(pendulum)
    segment, values = simulated(base, noise=noise)
    found = prepare(segment, chosen(OPEN, Signals.of([segment], pendulum)), pendulum)
    assert found.reduction is not None
    filters = found.reduction
    regressor = filters.apply(base.regressor(found.q, found.qd, found.qdd))
    keep = (
        np.ones(regressor.shape[:2], bool)
        if found.moving is None
        else found.moving[:: filters.factor]
    )
    estimate = np.linalg.lstsq(
        regressor[keep], filters.apply(found.y)[keep], rcond=None
    )[0]
    assert np.abs(estimate - values).max() < (2e-3 if noise == 0 else 2e-2)


def test_measured_velocities_are_used_where_asked_for(pendulum: ec.Mechanism) -> None:
    q, qd, qdd = curves(np.arange(6000) / RATE)
    segment = Segment("run", 0.0, RATE, {"q": q, "qd": 2 * qd, "qdd": 5 * qdd})
    plain = prepare(segment, FIXED, pendulum)
    first = prepare(segment, FIXED.model_copy(update={"measured": ("qd",)}), pendulum)
    both = prepare(
        segment, FIXED.model_copy(update={"measured": ("qd", "qdd")}), pendulum
    )
    assert np.allclose(first.qd, 2 * plain.qd, atol=2e-3)
    assert np.allclose(first.qdd, 2 * plain.qdd, atol=0.2)
    assert np.allclose(both.qdd, 5 * plain.qdd, atol=0.5)
    with pytest.raises(InputError, match="the log has no qd"):
        prepare(
            Segment("run", 0.0, RATE, {"q": q}),
            FIXED.model_copy(update={"measured": ("qd",)}),
            pendulum,
        )


def test_delays_are_undone(pendulum: ec.Mechanism) -> None:
    t = np.arange(6000) / RATE
    late = np.stack([curves(t - 0.0131)[0][:, 0], curves(t)[0][:, 1]], axis=1)
    settings_ = FIXED.model_copy(update={"delays": {"j1": 0.0131}})
    found = prepare(
        Segment("run", 0.0, RATE, {"q": curves(t)[0], "y": late}), settings_, pendulum
    )
    first = round(found.start * RATE)
    assert np.allclose(found.y, curves(t)[0][first : first + len(found)], atol=1e-4)
    with pytest.raises(InputError, match="no output 'j7'"):
        prepare(
            Segment("run", 0.0, RATE, {"q": curves(t)[0]}),
            FIXED.model_copy(update={"delays": {"j7": 0.1}}),
            pendulum,
        )


def test_rows_near_rest_are_marked(pendulum: ec.Mechanism) -> None:
    q = curves(np.arange(6000) / RATE)[0]
    found = prepare(
        Segment("run", 0.0, RATE, {"q": q}),
        FIXED.model_copy(update={"still": {"j2": 0.5}}),
        pendulum,
    )
    assert found.moving is not None
    assert found.moving[:, 0].all()
    assert np.array_equal(found.moving[:, 1], np.abs(found.qd[:, 1]) > 0.5)
    assert 0.1 < found.moving[:, 1].mean() < 0.95
    with pytest.raises(InputError, match="no output 'elbow'"):
        prepare(
            Segment("run", 0.0, RATE, {"q": q}),
            FIXED.model_copy(update={"still": {"elbow": 0.5}}),
            pendulum,
        )


def test_a_low_pass_smears_no_motion_into_rests(pendulum: ec.Mechanism) -> None:
    """Moves of 1.2 s between rests of 0.6 s on a fine encoder: in the rests friction is not that of the motion."""
    t = np.arange(9000) / RATE
    s = np.clip((t % 1.8) / 1.2, 0, 1)
    there = np.where(
        t // 1.8 % 2 == 0,
        10 * s**3 - 15 * s**4 + 6 * s**5,
        1 - 10 * s**3 + 15 * s**4 - 6 * s**5,
    )
    q = np.round(there[:, None] * [0.7, -0.4] / 1e-5) * 1e-5
    found = prepare(
        Segment("run", 0.0, RATE, {"q": q}),
        FIXED.model_copy(update={"band": 2.5, "still": 1e-4}),
        pendulum,
    )
    assert found.moving is not None
    first = round(found.start * RATE)
    resting = (t % 1.8 > 1.2)[first : first + len(found.q)]
    assert (np.abs(found.qd[resting]) > 1e-4).mean() > 0.4
    assert found.moving[resting].mean() < 0.2
    assert found.moving[~resting].mean() > 0.99


def test_speeds_of_actuators_follow_the_transmission() -> None:
    arm = ec.load(ROOT / "examples" / "coupled_arm.yaml")  # m2 = j2 + j3, m3 = j2 - j3
    by_name = {
        output.name: speed_rows(arm, output, arm.velocities) for output in arm.outputs
    }
    assert by_name["m2"].tolist() == [[0, 1, 1, 0, 0, 0, 0]]
    assert by_name["m3"].tolist() == [[0, 1, -1, 0, 0, 0, 0]]
    assert by_name["j1"].tolist() == [[1, 0, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize("band", [2.0, 10.0])
def test_no_side_is_attenuated(pendulum: ec.Mechanism, band: float) -> None:
    """An acceleration at the edge of the band is as large in the regressor as in the outputs."""
    t = np.arange(8000) / RATE
    w = 2 * np.pi * band * np.array([0.5, 1.0])
    q = np.sin(w * t[:, None])
    made = FIXED.model_copy(update={"band": band})
    found = prepare(
        Segment("run", 0.0, RATE, {"q": q, "y": -(w**2) * q}), made, pendulum
    )
    filters = found.reduction
    assert filters is not None
    assert found.y is not None
    regressor, output = (filters.apply(some)[5:-5] for some in (found.qdd, found.y))
    for k in range(2):
        assert regressor[:, k] @ output[:, k] / (
            output[:, k] @ output[:, k]
        ) == pytest.approx(1, abs=5e-4)


def test_trim_and_too_little_data(pendulum: ec.Mechanism) -> None:
    q = curves(np.arange(6000) / RATE)[0]
    segment = Segment("run.csv", 0.0, RATE, {"q": q})
    plain, trimmed = (
        prepare(segment, FIXED.model_copy(update={"trim": trim}), pendulum)
        for trim in (0.0, 1.5)
    )
    assert trimmed.start == pytest.approx(plain.start + 1.5)
    assert len(plain) - len(trimmed) == 2 * 750
    needed = PreparationPlan(FIXED, pendulum, RATE).needed
    short = Segment("run.csv", 0.0, RATE, {"q": q[: needed - 1]})
    with pytest.raises(
        InputError, match=rf"run\.csv: .* has {needed - 1} samples.* need {needed} "
    ):
        prepare(short, FIXED, pendulum)
    with pytest.raises(InputError, match="expected positions of j1, j2"):
        prepare(Segment("run.csv", 0.0, RATE, {"q": q[:, :1]}), FIXED, pendulum)
    with pytest.raises(InputError, match="still open"):
        prepare(segment, OPEN, pendulum)


def test_a_floating_base_and_balls() -> None:
    tree = ec.load(ROOT / "examples" / "floating_tree.yaml")
    t = np.arange(4000) / RATE
    q = np.zeros((4000, len(tree.positions)))
    q[:, 0], q[:, 11:] = np.sin(t), np.sin(t[:, None] + np.arange(4))
    rate = np.array(
        [0.3, -0.8, 0.5]
    )  # rad/s, in the body's axes and in the parent's, since it is constant
    turn = Rotation.from_rotvec(t[:, None] * rate).as_quat(scalar_first=True)
    start = Rotation.from_euler("xyz", [0.4, 0.2, -0.9]).as_quat(scalar_first=True)
    q[:, 3:7] = (
        turn * np.where(np.random.default_rng(0).random(4000) < 0.5, 1, -1)[:, None]
    )  # signs jump
    spun = Rotation.from_quat(start, scalar_first=True) * Rotation.from_quat(
        turn, scalar_first=True
    )
    q[:, 7:11] = spun.as_quat(scalar_first=True)
    found = prepare(Segment("run", 0.0, RATE, {"q": q}), FIXED, tree)
    assert found.q.shape[1] == len(tree.positions)
    assert found.qd.shape[1] == found.qdd.shape[1] == len(tree.velocities)
    first = round(found.start * RATE)
    assert np.allclose(found.qd[:, 3:6], rate, atol=1e-3)
    assert np.allclose(
        found.qd[:, 6:9], rate, atol=1e-3
    )  # a constant turn before changes nothing in the body's axes
    assert np.allclose(found.qdd[:, 3:9], 0, atol=2e-2)
    assert np.allclose(found.qd[:, 0], np.cos(t)[first : first + len(found)], atol=1e-4)
    assert np.allclose(np.linalg.norm(found.q[:, 3:7], axis=1), 1, atol=1e-14)


def test_with_loops_the_independent_coordinates_are_enough() -> None:
    bar = ec.load(ROOT / "examples" / "loops" / "four_bar.yaml")
    t = np.arange(4000) / RATE
    crank = 0.3 * np.sin(2 * t)
    q = np.stack([crank, np.zeros_like(t), np.ones_like(t)], axis=1)
    whole, few = (
        prepare(Segment("run", 0.0, RATE, {"q": some}), FIXED, bar)
        for some in (q, q[:, :1])
    )
    assert whole.q.shape[1] == whole.qdd.shape[1] == 1
    assert np.array_equal(whole.qd, few.qd)


# -- settings from the data --------------------------------------------------------------------------------------------


def test_everything_is_chosen_with_a_reason(pendulum: ec.Mechanism) -> None:
    segment, _ = simulated(ec.base_parameters(pendulum), noise=1e-4)
    found = chosen(OPEN, Signals.of([segment], pendulum))
    assert 3 < found.band < 20
    assert found.measured == ()
    assert set(found.still) == {"j1", "j2"}
    assert all(1e-4 < value < 0.1 for value in found.still.values())
    assert found.delays == {}
    assert found.rate is None
    assert found.lowpass == {}
    assert set(found.reasons) == {"band", "lowpass", "measured", "still"}
    assert f"{found.band:.3g} Hz" in found.reasons["band"]
    assert chosen(found, Signals.of([segment], pendulum)) == found


def test_what_is_given_stays(pendulum: ec.Mechanism) -> None:
    segment, _ = simulated(ec.base_parameters(pendulum), noise=1e-4)
    given_ = Preparation(
        band=6.0, lowpass={}, measured=(), still=0.2, delays={"j1": 0.01}
    )
    assert chosen(given_, Signals.of([segment], pendulum)) == given_


def test_velocities_are_measured_where_they_are_better(pendulum: ec.Mechanism) -> None:
    q, qd, _ = curves(np.arange(12000) / RATE)
    random = np.random.default_rng(0)
    noise = random.standard_normal((2, *q.shape))
    coarse = Segment(
        "run.csv", 0.0, RATE, {"q": q + 1e-3 * noise[0], "qd": qd + 1e-4 * noise[1]}
    )
    fine = Segment(
        "run.csv", 0.0, RATE, {"q": q + 1e-6 * noise[0], "qd": qd + 1e-2 * noise[1]}
    )
    late = Segment(
        "run.csv", 0.0, RATE, {"q": q + 1e-3 * noise[0], "qd": np.roll(qd, 20, axis=0)}
    )
    assert chosen(OPEN, Signals.of([coarse], pendulum)).measured == ("qd",)
    assert chosen(OPEN, Signals.of([fine], pendulum)).measured == ()
    assert (
        "differ from those of its positions"
        in chosen(OPEN, Signals.of([late], pendulum)).reasons["measured"]
    )
    rounded = np.round(q, 4)
    computed = Segment(
        "run.csv",
        0.0,
        RATE,
        {"q": rounded, "qd": np.gradient(rounded, 1 / RATE, axis=0)},
    )
    assert (
        "were computed from its positions"
        in chosen(OPEN, Signals.of([computed], pendulum)).reasons["measured"]
    )


def test_dry_friction_decides_what_is_still(pendulum: ec.Mechanism) -> None:
    smooth = ec.load(ROOT / "examples" / "double_pendulum.yaml")
    segment, _ = simulated(ec.base_parameters(pendulum), noise=1e-4)
    assert chosen(OPEN, Signals.of([segment], smooth)).still == 0.0
    assert all(has_dry_friction(pendulum, output) for output in pendulum.outputs)
    assert not any(has_dry_friction(smooth, output) for output in smooth.outputs)


def test_choices_that_cannot_be_made(pendulum: ec.Mechanism) -> None:
    random = np.random.default_rng(0)
    rest = Segment(
        "run.csv", 0.0, RATE, {"q": 1 + 1e-5 * random.standard_normal((4000, 2))}
    )
    with pytest.raises(InputError, match=r"run\.csv: nothing moves"):
        chosen(OPEN, Signals.of([rest], pendulum))
    with pytest.raises(InputError, match="at least 64"):
        chosen(
            OPEN,
            Signals.of(
                [Segment("run.csv", 0.0, RATE, {"q": np.zeros((30, 2))})], pendulum
            ),
        )
    with pytest.raises(InputError, match="no data"):
        chosen(OPEN, Signals.of([], pendulum))


# -- real logs ---------------------------------------------------------------------------------------------------------


def real(
    file: str, positions: list[str], outputs: list[str], rate: float, time: str = ""
) -> Segment:
    """A log on a uniform clock."""
    table = parquet.read_table(measured(file))
    values = np.stack([table[name].to_numpy() for name in positions + outputs], axis=1)
    if time:
        stamps = table[time].to_numpy()
        uniform = np.arange(stamps[0], stamps[-1], 1 / rate)
        values = np.stack(
            [np.interp(uniform, stamps, column) for column in values.T], axis=1
        )
    return Segment(
        file,
        0.0,
        rate,
        {"q": values[:, : len(positions)], "y": values[:, len(positions) :]},
    )


def numbered(name: str, count: int) -> list[str]:
    return [f"{name}_{k + 1}" for k in range(count)]


SLIDER = """
echelon: 1
name: slider
gravity: [0, 0, -9.81]
modified_dh:
  - {joint: prismatic, alpha: pi/2}
effects:
  - {type: viscous, at: all}
  - {type: coulomb, at: all}
  - {type: offset, at: all}
"""

PANDA = (
    "panda_1khz/panda_gaz_exciting_1kHz.parquet",
    numbered("q_rad", 7),
    numbered("tau_J_Nm", 7),
    1000.0,
    "t_s",
)
ARMS = (
    "double_pendulum/A0_20220812_061157-PM.parquet",
    ["pos1", "pos2"],
    ["tau1", "tau2"],
    300.0,
    "time",
)
LWR = (
    "kuka_lwr4/lwr4_measurements_1.parquet",
    numbered("q_rad", 7),
    numbered("tau_Nm", 7),
    200.0,
)
TX40 = (
    "staubli_tx40/tx40_5kHz.parquet",
    numbered("q_motor_rad", 6),
    numbered("tau_motor_Nm", 6),
    5000.0,
)


@pytest.mark.parametrize(
    ("robot", "log", "bands"),
    [
        ("panda.yaml", PANDA, (1.5, 5)),
        ("double_pendulum.yaml", ARMS, (5, 20)),
        ("panda.yaml", LWR, (1, 5)),
        ("tx40.yaml", TX40, (10, 40)),
    ],
    ids=["panda", "double pendulum", "lwr4", "tx40"],
)
def test_choices_for_real_logs(robot: str, log: tuple, bands: tuple) -> None:
    segment = real(*log)
    mechanism = ec.load(ROOT / "examples" / robot)
    found = chosen(OPEN, Signals.of([segment], mechanism))
    assert bands[0] <= found.band <= bands[1]
    samples = prepare(segment, found, mechanism)
    most = int(0.4 * segment.rate / found.band)
    assert 0.8 * most <= samples.reduction.factor <= most
    assert len(samples) > 0.9 * len(segment)
    assert samples.moving is None or samples.moving.mean() > 0.8


def test_the_published_parameters_of_a_drive(tmp_path: Path) -> None:
    """EMPS (Janot, Gautier, Brunot 2019): mass, friction and offset, with no setting made by hand."""
    segment = real("emps/data_emps.parquet", ["q_meas_m"], ["force_N"], 1000.0)
    (tmp_path / "slider.yaml").write_text(SLIDER)
    mechanism = ec.load(tmp_path / "slider.yaml")
    base = ec.base_parameters(mechanism)
    settings_ = chosen(OPEN, Signals.of([segment], mechanism))
    assert 5 < settings_.band < 60
    found = prepare(segment, settings_, mechanism)
    filters = found.reduction
    regressor = filters.apply(base.regressor(found.q, found.qd, found.qdd))[:, 0]
    names = [expression.name for expression in base.expressions]
    estimate = dict(
        zip(
            names,
            np.linalg.lstsq(regressor, filters.apply(found.y)[:, 0], rcond=None)[0],
            strict=True,
        )
    )
    published = {"M1": 95.1089, "Fv1": 203.5034, "Fc1": 20.3935, "Fo1": -3.1648}
    assert estimate == pytest.approx(published, rel=0.01)
