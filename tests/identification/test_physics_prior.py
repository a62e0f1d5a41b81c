"""Priors from other descriptions of the same robot: energies and torques stay the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.identification.physics.prior_information import prior_from
from echelon.robot.joint import GROUND, Body, Joint, Placement, merge, rotation
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support import textbook_arms as arms
from support.measured_logs import measured
from support.physical_robots import body_of_points, is_physical, states
from support.robot_files import robot_file
from support.selection import examples

LWR4 = """
echelon: 1
name: lwr4
symbols: {d1: 0.31, d3: 0.4, d5: 0.39}
gravity: [0, 0, -9.81]
modified_dh:
  - {joint: revolute, d: d1}
  - {joint: revolute, alpha: pi/2}
  - {joint: revolute, alpha: -pi/2, d: d3}
  - {joint: revolute, alpha: -pi/2}
  - {joint: revolute, alpha: pi/2, d: d5}
  - {joint: revolute, alpha: pi/2}
  - {joint: revolute, alpha: -pi/2}
"""


def same_torques(
    setup: ec.Mechanism, other: ec.Mechanism, fixed: int = 0
) -> ec.BaseModel:
    """Check that both descriptions need the same torques; the last coordinates of the other one rest at zero."""
    base, theirs = ec.base_parameters(setup), ec.base_parameters(other)
    prior = prior_from(base, other)
    log = states(base, np.random.default_rng(1), 20)
    rest = {
        name: np.hstack([value, np.zeros((20, fixed))]) for name, value in log.items()
    }
    mine = base.predict(log["q"], log["qd"], log["qdd"], base.values(prior.values))
    yours = theirs.predict(rest["q"], rest["qd"], rest["qdd"], theirs.values())
    assert np.allclose(mine, yours[:, : mine.shape[1]], rtol=1e-9, atol=1e-9)
    return base


def test_dh_table_of_the_lwr4_and_its_urdf(tmp_path: Path) -> None:
    file = measured("kuka_lwr4/model/kuka_lwr4.urdf")
    table = tmp_path / "lwr4.yaml"
    table.write_text(LWR4)
    other = ec.load(file)
    base = same_torques(ec.load(table), other)
    prior = prior_from(base, other)
    assert prior.findings == ()
    assert prior.values[9::10] == pytest.approx([2.7, 2.7, 2.7, 2.7, 1.7, 1.6, 0.3])
    assert is_physical(prior.values.reshape(-1, 10)).all()
    table.write_text(LWR4.replace("d5: 0.39", "d5: 0.4"))
    with pytest.raises(
        InputError,
        match=r"joint 'j6' of the set-up and 'lwr_5_joint' of the prior.*axis position differs by 0.01 m",
    ):
        prior_from(ec.base_parameters(ec.load(table)), other)
    table.write_text(LWR4.replace("alpha: pi/2, d: d5", "alpha: -pi/2, d: d5"))
    with pytest.raises(InputError, match=r"joint 'j4' .*zero differs by 180°"):
        prior_from(ec.base_parameters(ec.load(table)), other)


def test_dh_table_of_the_panda_and_its_urdf() -> None:
    setup, other = ec.load("examples/panda.yaml"), ec.load(robot_file("panda"))
    base = same_torques(setup, other, fixed=1)
    prior = prior_from(base, other)
    assert [f.kind for f in prior.findings] == ["locked joint", "locked joint"]
    assert "panda_finger_joint1" in prior.findings[0].where
    with pytest.raises(InputError, match="not the same robot"):
        prior_from(ec.base_parameters(other), setup)


_TURNS = st.sampled_from(["0", "pi/2", "-pi/2", "pi", "pi/4"])
_LENGTHS = st.sampled_from(["0", "0.1", "-0.25"])


@st.composite
def placements(draw: st.DrawFn) -> Placement:
    xyz = " ".join(draw(_LENGTHS) for _ in range(3))
    return arms.place(xyz, " ".join(draw(_TURNS) for _ in range(3)))


@examples(4)
@given(st.lists(placements(), min_size=8, max_size=8), st.integers(0, 2**32 - 1))
@pytest.mark.slow
def test_frames_do_not_matter(drawn: list[Placement], seed: int) -> None:
    rng = np.random.default_rng(seed)
    old, new = [], []
    for k in range(4):
        parent = (GROUND, 0, 1, 1)[k]
        place, frame = drawn[2 * k : 2 * k + 2]
        inertial = tuple(float(x) for x in body_of_points(rng, 0.02))
        steps = (
            place,
            rotation(f"q{k}", int(rng.integers(3)), int(rng.choice([1, -1]))),
        )
        old.append(
            Body(
                f"b{k}",
                str(k),
                parent,
                Joint(f"j{k}", "revolute", merge(steps)),
                inertial=inertial,
            )
        )
        before = Placement() if parent == GROUND else drawn[2 * parent + 1].inverse()
        moved = Joint(f"k{k}", "revolute", merge((before, *steps, frame)))
        new.append(Body(f"c{k}", str(k), parent, moved))
    gravity = arms.tree(
        "x", arms.body(1, 0, "revolute", drawn[0], rotation("q")), gravity="1 -2 -9"
    ).gravity
    other = Mechanism("old", tuple(old), gravity)
    same_torques(Mechanism("new", tuple(new), gravity), other)


def test_a_floating_robot_and_itself() -> None:
    other = ec.load(robot_file("solo12"), floating=True)
    base = same_torques(other, other)
    assert np.allclose(prior_from(base, other).values, base.standard_values())


def test_the_base_may_stand_anywhere() -> None:
    other = ec.load(robot_file("panda"))
    first, *rest = other.bodies
    moved = (arms.place("1 2 3", "0 0 pi/2"), *first.joint.steps)
    joint = replace(first.joint, steps=merge(moved))
    setup = replace(other, bodies=(replace(first, joint=joint), *rest))
    base = same_torques(setup, other)
    assert np.allclose(prior_from(base, other).values, base.standard_values())


def test_what_the_prior_does_not_say_is_named() -> None:
    base = ec.base_parameters(ec.load("examples/panda.yaml"))
    bodies = list(base.mechanism.bodies)
    bodies[2] = replace(bodies[2], inertial=(0.01, 0, 0, 0.01, 0, 0.05, 0, 0, 0, 1))
    bodies[3] = replace(bodies[3], inertial=(0.01, 0, 0, 0.01, 0, 0.01, 0, 0, 0, 1))
    prior = prior_from(base, replace(base.mechanism, bodies=tuple(bodies)))
    assert [f.kind for f in prior.findings].count("no prior") == 5
    assert [f.where for f in prior.findings if f.kind == "unphysical prior"] == [
        "body 'j3'"
    ]
    assert np.isfinite(prior.values).sum() == 20
    assert is_physical(prior.values[20:40].reshape(2, 10)).all()
