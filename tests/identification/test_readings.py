"""Other readings of logs that explain contradictions: planted mistakes are named, none is where all is right."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judge, Judged
from echelon.identification.judge.knobs import turned
from echelon.identification.judge.readings import Readings
from echelon.identification.judge.units import common_unit
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.rows import ModelRows
from support.paths import EXAMPLES
from support.selection import slow_unless
from support.simulated_models import Floats
from support.simulated_motions import RATE, fourier
from support.simulated_systems import SYSTEMS
from support.swinging_arm import ARM, swinging

Plant = Callable[[Samples], Samples]
EVERY = 4
"""One sample of so many is enough."""


@cache
def case(name: str) -> tuple[BaseModel, Samples, Floats]:
    """A system's base parameters, noisy samples of a motion, and true standard parameters."""
    system = replace(SYSTEMS[name], simulated=False)
    motion = system.motion(11)
    with TemporaryDirectory() as folder:
        base, truth = system.truth(Path(folder))
    rng = np.random.default_rng(3)
    y = motion.y + np.array(system.noise) * rng.standard_normal(motion.y.shape)
    samples = system.samples(replace(motion, y=y).every(EVERY))
    return base, samples, truth


def misread(
    base: BaseModel,
    samples: list[Samples],
    columns: ColumnMap | None = None,
    *,
    velocities: bool = False,
    prior: Floats | None = None,
) -> Judged | None:
    """The other reading that is named, if one is."""
    states_ = States.of(samples, np.inf, base, np.zeros(base.rank))
    readings = Readings(base, states_, columns or ColumnMap(), velocities)
    found = Judge(base, states_, readings, prior=prior).other_reading()
    return None if found is None else found[0]


def by(values: Floats, place: int, factor: float = -1.0) -> Floats:
    return values * np.where(np.arange(values.shape[1]) == place, factor, 1.0)


def exchanged(values: Floats, i: int, j: int) -> Floats:
    order = list(range(values.shape[1]))
    order[i], order[j] = j, i
    return values[:, order]


def states(change: Callable[[Floats], Floats]) -> Plant:
    """A change of position columns, which velocities and accelerations follow."""
    return lambda s: replace(s, q=change(s.q), qd=change(s.qd), qdd=change(s.qdd))


def outputs(change: Callable[[Floats], Floats]) -> Plant:
    return lambda s: replace(s, y=change(s.y))  # type: ignore[arg-type]


def clock(factor: float) -> Plant:
    return lambda s: replace(s, qd=s.qd * factor, qdd=s.qdd * factor**2)


PLANTED: dict[str, tuple[str, Plant, str]] = {
    "sign of a torque": (
        "arm",
        outputs(lambda y: by(y, 4)),
        "the sign of the output of 'j5' is wrong",
    ),
    "signs of all torques": (
        "arm",
        outputs(lambda y: -y),
        "the signs of all outputs are wrong",
    ),
    "signs of all positions": (
        "arm",
        states(lambda q: -q),
        "the signs of all positions are wrong",
    ),
    "sign of a position": (
        "arm",
        states(lambda q: by(q, 3)),
        "the sign of the position of 'j4' is wrong",
    ),
    "a joint that turns back": (
        "arm",
        lambda s: states(lambda q: by(q, 1))(outputs(lambda y: by(y, 1))(s)),
        "'j2' turns the other way",
    ),
    "exchanged torques": (
        "arm",
        outputs(lambda y: exchanged(y, 1, 2)),
        "'j2' and the output of 'j3' are exchanged",
    ),
    "exchanged positions": (
        "arm",
        states(lambda q: exchanged(q, 0, 4)),
        "'j1' and the position of 'j5' are exchanged",
    ),
    "degrees": (
        "arm",
        states(lambda q: by(q, 2, 180 / np.pi)),
        "the position of 'j3' is in degrees",
    ),
    "zero": (
        "arm",
        lambda s: replace(s, q=s.q - np.eye(5)[2] * np.pi / 2),
        "zero of the position of 'j3'",
    ),
    "unit of a torque": (
        "arm",
        outputs(lambda y: by(y, 2, 1e3)),
        "the output of 'j3' is in mN·m",
    ),
    "rate": ("arm", clock(0.5), "the rate is about 2 times"),
    "milliseconds": ("arm", clock(1e3), "the rate is about 0.001 times"),
    "side of a gear": (
        "motor side",
        outputs(lambda y: by(y, 2, 40.0)),
        "the output of 'm3' is on the joints' side",
    ),
    "sign of a motor": (
        "motor side",
        outputs(lambda y: by(y, 3)),
        "the sign of the output of 'm4' is wrong",
    ),
    "loops": ("five-bar", outputs(lambda y: y[:, ::-1]), "are exchanged"),
    "floating": (
        "floating",
        outputs(lambda y: by(y, 7)),
        "the sign of the output of 'left2' is wrong",
    ),
}


SLOW_MISTAKES = {
    "floating",
    "loops",
    "signs of all torques",
    "milliseconds",
    "sign of a position",
    "sign of a motor",
}


@pytest.mark.parametrize(
    "name", slow_unless(lambda name: name not in SLOW_MISTAKES, PLANTED)
)
def test_planted_mistakes_are_named(name: str) -> None:
    system, plant, words = PLANTED[name]
    base, samples, _ = case(system)
    found = misread(base, [plant(samples)])
    assert found is not None
    assert words in found.words
    assert found.after[0] < 0.75 * found.before[0]


SLOWER = ("floating", "five-bar", "wrist sensor")


@pytest.mark.parametrize(
    "system",
    [pytest.param(s, marks=[pytest.mark.slow] * (s in SLOWER)) for s in SYSTEMS],
)
def test_nothing_is_named_where_all_is_right(system: str) -> None:
    base, samples, _ = case(system)
    assert misread(base, [samples]) is None


LEG = """<robot name="leg"><link name="base"/>{}</robot>"""
LINK = """<link name="{0}"><inertial><origin xyz="{1}"/><mass value="{2}"/>
<inertia ixx="{3}" iyy="{3}" izz="{3}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{4}" type="{5}"><parent link="{6}"/><child link="{0}"/>
<origin xyz="{7}"/><axis xyz="{8}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
ROLL_AND_PITCH = LEG.format(
    LINK.format(
        "hip", "0.01 0.03 0", 1.2, 0.004, "roll", "revolute", "base", "0 0 0", "1 0 0"
    )
    + LINK.format(
        "thigh",
        "0.005 0.02 -0.08",
        2.0,
        0.012,
        "pitch",
        "revolute",
        "hip",
        "0 0.08 0",
        "0 1 0",
    )
)
GANTRY = LEG.format(
    LINK.format("x", "0 0.3 0", 30, 1, "X", "prismatic", "base", "0 0 0", "1 0 0")
    + LINK.format("z", "0 0 0.1", 6, 0.2, "Z", "prismatic", "x", "0 0 0", "0 0 1")
    + LINK.format("a", "0 0.02 0.06", 1, 0.004, "A", "revolute", "z", "0 0 0", "1 0 0")
)


@cache
def simple(text: str) -> tuple[BaseModel, Samples, Floats]:
    """A small robot with the masses of its file times 1.3, samples, and the base parameters of the file."""
    base = ec.base_parameters(ec.load(text))
    prior, rng = base.values(), np.random.default_rng(3)
    q, qd, qdd = fourier(rng, len(base.mechanism.positions), 0.9)
    y = 1.3 * base.predict(q, qd, qdd, prior)
    y += 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
    return base, Samples("log", 0.0, RATE, q, qd, qdd, y), prior


def test_the_prior_decides_between_mirrored_robots() -> None:
    base, samples, prior = simple(ROLL_AND_PITCH)
    wrong = outputs(lambda y: by(y, 0))(samples)
    found = misread(base, [wrong])
    assert found is not None
    assert found.words.count(" is wrong (scale: -1)") == 2
    found = misread(base, [wrong], prior=prior)
    assert found is not None
    assert found.words == "the sign of the output of 'roll' is wrong (scale: -1)"


def test_the_values_of_a_robot_file_decide_between_mirrored_robots() -> None:
    """They count where hypotheses are judged with gravity of any direction, too."""
    _, samples, _ = simple(ROLL_AND_PITCH)
    wrong = outputs(lambda y: by(y, 0))(samples)
    assert wrong.y is not None
    log = {
        "t": np.arange(len(wrong)) / RATE,
        "q": wrong.q,
        "qd": wrong.qd,
        "tau": wrong.y,
    }
    found = [
        f.text
        for f in ec.identify(ROLL_AND_PITCH, log).findings
        if f.kind == "setup error"
    ]
    assert len(found) == 1
    assert found[0].startswith("the sign of the output of 'roll'")
    assert ", or " not in found[0]


@pytest.mark.slow
def test_robots_with_vertical_slides_and_values_are_judged() -> None:
    """Gravity's direction is free in the model that judges, and base parameters of its slides depend on it."""
    _, samples, _ = simple(GANTRY)
    assert samples.y is not None
    log = {
        "t": np.arange(len(samples)) / RATE,
        "q": samples.q,
        "qd": samples.qd,
        "tau": samples.y.copy(),
    }
    log["tau"][:, 0] *= -1
    found = [
        f.text for f in ec.identify(GANTRY, log).findings if f.kind == "setup error"
    ]
    assert len(found) == 1
    assert (
        "the sign of the output of 'X'" in found[0]
        or "'X' turns the other way" in found[0]
    )


def test_stiffness_and_play_of_slides_are_in_metres() -> None:
    base, samples, prior = simple(GANTRY)
    states = States.of([samples], np.inf, base, prior)
    said: dict[str, list[str]] = {}
    for term in turned(
        Readings(base, states, ColumnMap(), velocities=False), states, prior
    ):
        if term.kind is Kind.JOINT and term.knob is not None:
            words, _ = term.knob.says(np.array([1e-4]), np.array([1e-5]))
            said.setdefault(term.place, []).append(words)
    for place, stiffness, play in (
        ("X", "N/m", "m"),
        ("Z", "N/m", "m"),
        ("A", "N·m/rad", "rad"),
    ):
        assert [
            words
            for words in said[place]
            if words.endswith(f"1e+04 ± 1e+03 {stiffness}")
        ]
        assert [
            words for words in said[place] if words.endswith(f"0.0002 ± 2e-05 {play}")
        ]


def test_mistakes_of_sliding_joints() -> None:
    base, samples, prior = simple(GANTRY)
    assert misread(base, [samples], prior=prior) is None
    planted = {
        "the sign of the output of 'Z'": outputs(lambda y: by(y, 1)),
        "the sign of the position of 'Z'": states(lambda q: by(q, 1)),
        "the position of 'Z' is in mm": states(lambda q: by(q, 1, 1e3)),
    }
    for words, plant in planted.items():
        found = misread(base, [plant(samples)], prior=prior)
        assert found is not None, words
        assert found.words.startswith(words)
    wrong = outputs(lambda y: by(y, 0, 1e3))(samples)
    told = common_unit(base, ModelRows.of(base, [wrong]).observation(), prior)
    assert told is not None
    assert told.words.startswith("the output of 'X' is in mN (unit: mN)")


def test_measured_velocities_have_mistakes_of_their_own() -> None:
    base, samples, _ = case("arm")
    found = misread(
        base,
        [replace(samples, qd=by(samples.qd, 1), qdd=by(samples.qdd, 1))],
        velocities=True,
    )
    assert found is not None
    assert "the sign of the velocity of 'j2' is wrong" in found.words
    found = misread(base, [replace(samples, q=by(samples.q, 1))], velocities=True)
    assert found is not None
    assert "the sign of the position of 'j2' is wrong" in found.words


def test_columns_are_named_and_their_offsets_stay() -> None:
    base, samples, _ = case("arm")
    positions = {
        f"j{k}": Channel(f"enc{k}", offset=0.4 * (k == 2)) for k in range(1, 6)
    }
    q = samples.q.copy()
    q[:, 1] = 0.8 - q[:, 1]  # the sign of the column, before the offset of 0.4 is added
    wrong = replace(samples, q=q, qd=by(samples.qd, 1), qdd=by(samples.qdd, 1))
    found = misread(base, [wrong], ColumnMap(positions=positions))
    assert found is not None
    assert "the position of 'j2' (column 'enc2') is wrong" in found.words


def test_a_unit_that_all_outputs_share_is_told_by_the_prior() -> None:
    base, samples, truth = case("arm")
    right = ModelRows.of(base, [samples]).observation()
    wrong = ModelRows.of(base, [replace(samples, y=1e3 * samples.y)]).observation()  # type: ignore[operator]
    prior = 1.4 * base.values(truth)
    assert common_unit(base, right, prior) is None
    found = common_unit(base, wrong, prior)
    assert found is not None
    assert "all outputs are in mN·m (unit: mN·m)" in found.words
    right = ModelRows.of(base, [replace(samples, y=1e-3 * samples.y)]).observation()  # type: ignore[operator]
    found = common_unit(base, right, prior)
    assert found is not None
    assert "all outputs are in kN·m" in found.words
    assert found.gain.mean > 1


def test_one_of_two_outputs_does_not_tell_the_unit_of_both() -> None:
    """The other one has little to do with what the prior predicts."""
    base, samples, prior = simple(ARM)
    y = samples.y
    assert y is not None
    noise = np.random.default_rng(5).normal(size=len(y)) * y[:, 1].std()
    wrong = replace(samples, y=np.column_stack([1e-3 * y[:, 0], noise]))
    assert common_unit(base, ModelRows.of(base, [wrong]).observation(), prior) is None


@pytest.mark.parametrize("factor", [1e-3, 1e3])
@pytest.mark.parametrize("place", [0, 1])
def test_the_output_that_the_prior_names_is_the_only_cause(
    place: int, factor: float
) -> None:
    """Data show ratios only, so that without the prior either torque may be in another unit."""
    log = swinging()
    log["tau"][:, place] *= factor
    result = ec.identify(ec.load_setup(ARM).with_settings(physical=False), log)
    causes = [text for text in result.reasons if "cause" in text]
    name = ("shoulder_joint", "elbow_joint")[place]
    unit = "kN·m" if factor < 1 else "mN·m"
    assert len(causes) == 1
    assert f"the output of '{name}' is in {unit} (unit: {unit})" in causes[0]


@pytest.mark.parametrize("factor", [1 / 50, 1 / 10, 10.0, 1.0, 2.0])
def test_a_common_factor_of_no_unit_is_doubted_by_the_prior(factor: float) -> None:
    """Predictions are as good with it, and the robot may be lighter than its file."""
    log = swinging()
    log["tau"] *= factor
    result = ec.identify(ec.load_setup(ARM).with_settings(physical=False), log)
    told = [some.text for some in result.findings if some.kind == "scale"]
    assert len(told) == (factor not in (1.0, 2.0))
    assert result.judgement.badge == "good"
    for text in told:
        assert text.startswith("all outputs are about ")
        assert 0.7 < float(text.split()[4]) / factor < 1.4


def test_an_output_in_a_far_larger_unit_is_named_not_refused() -> None:
    """Weights of outputs differ by 1e12 then, which a covariance in double precision does not hold."""
    setup = ec.load_setup(EXAMPLES / "scara.yaml")
    robot = setup.mechanism
    base = ec.base_parameters(robot)
    t = np.arange(3000)[:, None] / 200
    rates, sizes = np.array([1.7, 2.9, 2.3]), np.array([0.8, 0.7, 0.1])
    q, qd, qdd = np.zeros((3, len(t), 3))
    for k, phase in enumerate((0.0, 1.0, 2.0), start=1):
        turn = k * rates * t + phase
        q += sizes / k * np.sin(turn)
        qd += sizes * rates * np.cos(turn)
        qdd -= sizes * rates**2 * k * np.sin(turn)
    rng = np.random.default_rng(2)
    standard = [
        rng.uniform(0.1, 0.5) if v is None else v for v in robot.standard_values()
    ]
    tau = base.predict(q, qd, qdd, base.values(standard))
    tau += 0.01 * tau.std(axis=0) * rng.normal(size=tau.shape)
    tau[:, 0] *= 1e-3
    result = ec.identify(setup, {"t": t[:, 0], "q": q, "tau": tau})
    assert any("output of 'upper_arm' is 0.00" in text for text in result.reasons)


def test_drives_couple_joints_that_are_near() -> None:
    base, samples, _ = case("arm")
    readings = Readings(
        base,
        States.of([samples], np.inf, base, np.zeros(base.rank)),
        ColumnMap(),
        velocities=False,
    )
    found = [
        re.search(r"drive of 'j(\d)' turns by j\d [+-] j(\d)", reading.words)
        for reading in readings.all()
    ]
    apart = [abs(int(some[1]) - int(some[2])) for some in found if some is not None]
    assert [apart.count(k) for k in range(1, 5)] == [
        16,
        12,
        8,
        0,
    ]  # both ways, with both signs
