"""The direction of gravity is found where nobody states it, and what a fit has not taken in is not said to be."""

from __future__ import annotations

import pytest

import echelon as ec
from echelon.identification import identifying as job
from echelon.identification.judge.mounting import standing
from echelon.identification.logs.finding import Finding
from echelon.shared.errors import InputError
from support.paths import ROOT
from support.swinging_arm import ARM, swinging


def about_gravity(result: ec.Identification) -> list[Finding]:
    return [found for found in result.findings if found.kind == "gravity"]


def test_where_gravity_was_left_open_its_direction_is_said() -> None:
    result = ec.identify(ec.load_setup(ARM, gravity="generic"), swinging())
    (found,) = about_gravity(result)
    assert (
        found.text
        == "the set-up does not state the direction of gravity: -z of the base was used, and the logs agree with it"
    )


def test_a_wall_that_nobody_stated_is_found() -> None:
    result = ec.identify(
        ec.load_setup(ARM, gravity="generic"), swinging(gravity="9.81,0,0")
    )
    found = about_gravity(result)
    assert "gravity is along x of the base" in found[0].text
    assert found[0].text.endswith("it is part of the model now")
    assert min(score.r2 for score in result.validations[-1].scores) > 0.999


@pytest.mark.slow
def test_what_was_not_taken_in_is_not_said_to_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where fits end, the last one's hypotheses are told as what is still to be stated."""
    log = swinging(gravity="9.81,0,0")
    monkeypatch.setattr(job, "COMPLETIONS", 0)
    result = ec.identify(ec.load_setup(ARM, gravity="generic"), log)
    assert not any("part of the model now" in found.text for found in result.findings)
    assert "gravity is along x of the base" in about_gravity(result)[0].text
    assert min(score.r2 for score in result.validations[-1].scores) < 0.9


BODY = '<inertial><mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
FLOATING = ARM.replace('<link name="base"/>', f'<link name="base">{BODY}</link>')
LOOP = ROOT / "examples" / "loops" / "four_bar.yaml"


def test_a_wall_and_a_zero_that_explain_alike_are_both_named() -> None:
    """Gravity may be along x, or the first joint's zero 90° off: a robot file alone says neither."""
    result = ec.identify(ARM, swinging(gravity="9.81,0,0"))
    (found,) = [found for found in result.findings if found.kind == "setup error"]
    assert "zero of the position of 'shoulder_joint'" in found.text
    assert "or gravity is along x of the base" in found.text
    assert "part of the model now" not in found.text


@pytest.mark.parametrize(
    ("robot", "floating", "what"),
    [(FLOATING, True, "a base that moves"), (LOOP, False, "closed loops")],
)
def test_where_no_direction_is_looked_for_it_must_be_stated(
    robot: object, floating: bool, what: str
) -> None:
    mechanism = ec.load(robot, gravity="generic", floating=floating)
    with pytest.raises(
        InputError, match=rf"{what}: state it, as in --gravity 0,0,-9\.81"
    ):
        standing(mechanism)
