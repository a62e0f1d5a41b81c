"""Default independent coordinates of mechanisms with loops."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from echelon.loops.assembly import Assembly
from echelon.robot.closed_pose import split_balls
from support.closed_states import read
from support.paths import ROOT
from support.zoo import ZOO

EXAMPLES = ROOT / "examples" / "loops"
LEG = (
    "hip-roll",
    "hip-yaw",
    "hip-pitch",
    "achilles-rod.x",
    "knee",
    "shin",
    "tarsus",
    "foot-crank",
)
FLOATING = ("tx", "ty", "tz", "r.x", "r.y", "r.z")


def without_choice(text: str) -> ec.Mechanism:
    text = re.sub(r"^independent:.*\n", "", text, flags=re.MULTILINE)
    return read(text.replace("echelon: 1\n", ""))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("four_bar", "crank"),
        ("delta", "arm1 arm2 arm3"),
        ("three_rps", "swing1 swing2 swing3"),
        ("gough_stewart", "leg1.1 leg1.2 leg2.1 leg2.2 leg3.1 leg3.2"),
        ("sr400", "j1 j2 j4 j5 j6 j7"),
    ],
)
def test_joints_near_the_base_are_taken(name: str, expected: str) -> None:
    assert without_choice((EXAMPLES / f"{name}.yaml").read_text()).independent == tuple(
        expected.split()
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("two cranks on a table", "crank plate.x plate.y"),
        ("two arms carrying", "l1 l2 box.x box.y box.z r1"),
        ("floating base, closed to the world", "base.r.x base.r.y base.r.z arm"),
        (
            "four bar, floating base",
            "base.tx base.ty base.tz base.r.x base.r.y base.r.z crank",
        ),
    ],
)
def test_balls_are_taken_whole(name: str, expected: str) -> None:
    mechanism = without_choice(ZOO[name].text)
    assert mechanism.independent == tuple(expected.split())
    assert not split_balls(mechanism)


def test_independent_positions_are_those_that_all_others_follow_from() -> None:
    floating = without_choice(ZOO["four bar, floating base"].text)
    assert floating.independent_positions == (*floating.positions[:7], "crank")
    legs = ec.load(EXAMPLES / "biped.xml")  # with rods that spin
    assert legs.independent_positions == legs.positions
    arm = ec.load(ROOT / "examples" / "panda.yaml")
    assert arm.independent_positions == arm.positions
    assert not arm.dependent_velocities


@pytest.mark.parametrize("drive", ["rod1", "rod2"])
def test_driven_coordinates_come_first(drive: str) -> None:
    text = (
        EXAMPLES / "gough_stewart.yaml"
    ).read_text() + f"actuators: {{motor: 100*{drive}}}\n"
    assert drive in without_choice(text).independent


def test_legs_with_rods_between_balls() -> None:
    mechanism = ec.load(EXAMPLES / "biped.xml")
    legs = [f"{side}-{name}" for side in ("left", "right") for name in LEG]
    assert mechanism.independent == (*(f"pelvis.{name}" for name in FLOATING), *legs)
    assert split_balls(mechanism) == ["left-achilles-rod.x", "right-achilles-rod.x"]


def test_the_part_of_a_ball_is_that_which_turns_most_and_is_noted() -> None:
    mechanism = read(ZOO["rod, connects at both ends"].text)
    assert mechanism.independent == (
        "hip",
        "knee",
        "rod.r.z",
    )  # the rod lies along its z axis
    spin = np.abs(Assembly(mechanism).free_velocities(Assembly(mechanism).pose))
    assert (
        spin[mechanism.velocities.index("rod.r.z")].max()
        > spin[mechanism.velocities.index("rod.r.x")].max()
    )
    notes = ec.base_parameters(mechanism, budget=0).reading.notes
    assert any(
        "spin of a rod between two ball joints: 'rod.r.z' is independent" in note
        for note in notes
    )


@pytest.mark.parametrize("tied", [("crank", "rocker"), ("crank", "coupler", "rocker")])
def test_tied_coordinates_are_refused(tied: tuple[str, ...]) -> None:
    text = (EXAMPLES / "four_bar.yaml").read_text()
    with pytest.raises(ec.InputError, match=r"not \d.*follows from the others"):
        read(
            re.sub(
                r"^independent:.*",
                f"independent: [{', '.join(tied)}]",
                text.replace("echelon: 1\n", ""),
                flags=re.M,
            )
        )
    mechanism = replace(read(text.replace("echelon: 1\n", "")), independent=tied)
    for derive in (ec.base_structure, ec.base_parameters):
        with pytest.raises(ec.InputError, match="independent"):
            derive(mechanism)
