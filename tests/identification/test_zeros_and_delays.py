"""Zeros of positions and delays of outputs are found with their sizes, and told from what explains as much."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind
from echelon.identification.judge.judge import Judge, Judged
from echelon.identification.judge.mounting import free_gravity
from echelon.identification.judge.readings import Readings
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.recording import Samples
from support.selection import one_in
from support.simulated_models import Floats
from support.simulated_motions import RATE, fourier
from support.swinging_arm import ARM, swinging

LINK = """<link name="{0}"><inertial><origin xyz="{1}"/><mass value="{2}"/>
<inertia ixx="{3}" iyy="{3}" izz="{3}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{4}" type="{5}"><parent link="{6}"/><child link="{0}"/>
<origin xyz="{7}"/><axis xyz="{8}"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>"""
TELESCOPE = "\n".join(
    [
        '<robot name="telescope"><link name="base"/>',
        LINK.format(
            "post", "0.02 0 0.1", 5, 0.05, "turn", "revolute", "base", "0 0 0", "0 0 1"
        ),
        LINK.format(
            "boom",
            "0.2 0.03 0",
            3,
            0.04,
            "lift",
            "revolute",
            "post",
            "0.1 0 0.4",
            "0 1 0",
        ),
        LINK.format(
            "slide",
            "0.1 0 0.02",
            1.5,
            0.01,
            "reach",
            "prismatic",
            "boom",
            "0.3 0 0.05",
            "1 0 0",
        ),
        LINK.format(
            "tool",
            "0.05 0.02 0.1",
            1,
            0.004,
            "wrist",
            "revolute",
            "slide",
            "0.2 0 0",
            "0 1 0",
        ),
        "</robot>",
    ]
)
HIP = "\n".join(
    [
        '<robot name="hip"><link name="base"/>',
        LINK.format(
            "hip",
            "0.01 0.03 0",
            1.2,
            0.004,
            "roll",
            "revolute",
            "base",
            "0 0 0",
            "1 0 0",
        ),
        LINK.format(
            "thigh",
            "0.005 0.02 -0.08",
            2.0,
            0.012,
            "pitch",
            "revolute",
            "hip",
            "0 0.08 0",
            "0 1 0",
        ),
        "</robot>",
    ]
)
JOINTS = ("turn", "lift", "reach", "wrist")
BAND = 8.0
"""Band of the logs, Hz."""

Plant = Callable[[Samples], Samples]


@cache
def model() -> tuple[BaseModel, Floats, BaseModel, Floats | None]:
    """A robot's base parameters with the values of its file, the model that judges, and gravity."""
    base = ec.base_parameters(ec.load(TELESCOPE))
    return base, base.values(), *free_gravity(base, 0)


def samples(speed: float = 1.0, noise: float = 0.01) -> Samples:
    """A motion with its forces, some times as fast as usual."""
    base, values, _, _ = model()
    rng = np.random.default_rng(5)
    q, qd, qdd = fourier(rng, 4, 0.6)
    qd, qdd = speed * qd, speed**2 * qdd
    y = base.predict(q, qd, qdd, values)
    y += noise * y.std(axis=0) * rng.standard_normal(y.shape)
    return Samples("log", 0.0, speed * RATE, q, qd, qdd, y)


def shifted(joint: str, size: float) -> Plant:
    """An encoder to whose values something has to be added."""
    return lambda some: replace(some, q=some.q - size * np.eye(4)[JOINTS.index(joint)])


def late(outputs: tuple[str, ...], count: int) -> Plant:
    """Outputs that come some samples after the positions."""

    def plant(some: Samples) -> Samples:
        assert some.y is not None
        on_time, y = slice(count, None), some.y[count:].copy()
        for k in map(JOINTS.index, outputs):
            y[:, k] = some.y[:-count, k]
        return replace(
            some, q=some.q[on_time], qd=some.qd[on_time], qdd=some.qdd[on_time], y=y
        )

    return plant


def told(
    log: Samples,
    columns: ColumnMap | None = None,
    delays: dict[str, float] | None = None,
) -> list[Judged]:
    """Hypotheses that are taken."""
    base, values, free, gravity = model()
    states = States.of([log], BAND, base, values, gravity)
    return Judge(
        free,
        states,
        Readings(free, states, columns or ColumnMap(), False, delays or {}),
        doubtful=False,
    ).run()


def size_and_error(judged: Judged) -> tuple[float, float]:
    """The first number with a standard error in words."""
    found = re.search(r"(-?[\d.e-]+) ± ([\d.e-]+)", judged.words)
    assert found is not None, judged.words
    return float(found[1]), float(found[2])


@pytest.mark.parametrize(
    ("joint", "size", "unit"), one_in(2, [("reach", 0.03, "m"), ("lift", -0.02, "rad")])
)
def test_planted_zeros_are_found(joint: str, size: float, unit: str) -> None:
    (found,) = told(shifted(joint, size)(samples()))
    assert found.kind is Kind.ZERO
    assert re.match(
        rf"the zero of the position of '{joint}' is .* {unit} off$", found.words
    )
    about, error = size_and_error(found)
    assert abs(about - size) < 3 * error < 0.25 * abs(size)
    assert float(found.write.removeprefix("offset: ")) == pytest.approx(
        size, abs=3 * error
    )


def test_offset_to_write_holds_the_one_that_was_stated() -> None:
    columns = ColumnMap(
        positions={joint: Channel(f"enc_{joint}", offset=0.3) for joint in JOINTS}
    )
    (found,) = told(shifted("lift", 0.05)(samples()), columns)
    assert (
        "the zero of the position of 'lift' (column 'enc_lift') is 0.0" in found.words
    )
    assert float(found.write.removeprefix("offset: ")) == pytest.approx(0.35, abs=0.002)


@pytest.mark.parametrize("joint", ["turn", "wrist"])
def test_zeros_that_no_data_show_are_not_named(joint: str) -> None:
    """A vertical first axis leaves forces as they are, and the last body takes any place on its axis."""
    assert told(shifted(joint, 0.05)(samples())) == []


def test_a_zero_that_a_tilted_base_would_explain_names_both() -> None:
    base = ec.base_parameters(ec.load(HIP))
    free, gravity = free_gravity(base, 0)
    q, qd, qdd = fourier(np.random.default_rng(3), 2, 0.9)
    y = base.predict(q, qd, qdd, base.values())
    y += 0.01 * y.std(axis=0) * np.random.default_rng(4).standard_normal(y.shape)
    log = Samples("log", 0.0, RATE, q - np.array([0.05, 0.0]), qd, qdd, y)
    states = States.of([log], BAND, base, base.values(), gravity)
    found = Judge(
        free, states, Readings(free, states, ColumnMap(), False), doubtful=False
    ).run()[0]
    assert re.match(
        r"the zero of the position of 'roll' is 0\.0\d+ ± \S+ rad off; these data",
        found.words,
    )
    assert found.words.endswith(
        "cannot distinguish it from gravity in another direction"
    )


@pytest.mark.parametrize("count", one_in(2, [40, -12]))
def test_a_planted_delay_of_all_outputs_is_found(count: int) -> None:
    log = samples()
    planted = late(JOINTS, count)(log) if count > 0 else early(log, -count)
    (found,) = told(planted)
    assert found.kind is Kind.DELAY
    assert re.match(
        rf"the outputs are .* s {'late' if count > 0 else 'early'}$", found.words
    )
    about, error = size_and_error(found)
    assert abs(about - abs(count) / RATE) < max(3 * error, 2e-4)
    assert found.delays == {
        joint: pytest.approx(count / RATE, abs=5e-4) for joint in JOINTS
    }


def early(some: Samples, count: int) -> Samples:
    assert some.y is not None
    ahead = slice(None, -count)
    return replace(
        some, q=some.q[ahead], qd=some.qd[ahead], qdd=some.qdd[ahead], y=some.y[count:]
    )


def test_a_planted_delay_of_one_output_is_found_beside_those_undone() -> None:
    (found,) = told(
        late(("lift",), 20)(samples()), delays={"turn": 0.004, "lift": 0.004}
    )
    assert re.match(r"the output of 'lift' is 0\.0\d+ ± \S+ s late$", found.words)
    assert found.delays == {"turn": 0.004, "lift": pytest.approx(0.054, abs=5e-4)}
    assert found.write == f"delays: {{turn: 0.004, lift: {found.delays['lift']:.4g}}}"


def test_delays_longer_than_half_a_period_of_the_motion_are_found() -> None:
    """A derivative says nothing of them: the fastest harmonic has turned over twice."""
    fast = samples(speed=6.0)
    (found,) = told(late(JOINTS, 720)(fast))
    assert found.delays == {
        joint: pytest.approx(720 / fast.rate, abs=1e-3) for joint in JOINTS
    }


@pytest.mark.parametrize("count", one_in(2, [0, 2]))
def test_what_is_right_has_neither(count: int) -> None:
    """Delays of few samples are looked for on the clock of the log."""
    exact = samples()
    assert told(late(JOINTS, count)(exact) if count else exact) == []


def swinging_late() -> dict[str, Floats]:
    """A log whose torques are late by 45 samples."""
    return {
        name: values[:-45] if name == "tau" else values[45:]
        for name, values in swinging().items()
    }


def test_delays_that_nobody_stated_are_taken_in() -> None:
    result = ec.identify(ARM, swinging_late())
    assert result.preparation.delays == {
        joint: pytest.approx(0.15, abs=1e-3)
        for joint in ("shoulder_joint", "elbow_joint")
    }
    assert min(score.r2 for score in result.validations[-1].scores) > 0.999
    (found,) = [f for f in result.findings if f.kind == "setup error"]
    assert re.match(r"the outputs are 0\.15 ± \S+ s late", found.text)
    assert found.text.endswith("it is part of the model now")


@pytest.mark.slow
def test_delays_that_are_stated_are_not_taken_in() -> None:
    stated = ec.load_setup(ARM)
    stated = replace(
        stated, preparation=stated.preparation.model_copy(update={"delays": {}})
    )
    result = ec.identify(stated, swinging_late())
    (found,) = [f for f in result.findings if f.kind == "setup error"]
    assert "delays: {shoulder_joint: 0.1" in found.text
    assert "a likely cause: the outputs are" in result.verdict
