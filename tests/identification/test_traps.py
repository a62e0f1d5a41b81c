"""Faults of logs of real arms, and effects that their models lack, are named; `benchmarks/traps.py` has all cases."""

from __future__ import annotations

import re

import pytest

import echelon as ec
from support.robot_files import robot_file
from support.selection import slow_unless
from support.trap_logs import ROBOTS, TRAPS, TrapLog, trap_log
from support.trap_logs import arm as trap_arm

NAMED = (
    *(
        "tilt",
        "payload_mid",
        "gravcomp",
        "temp",
        "gain",
        "sign",
        "exchanged",
        "stribeck",
        "smooth",
    ),
    *(
        "sea",
        "backlash",
        "coupled",
        "saturate",
        "negative",
        "zero",
        "zero20",
        "delay",
        "delay1",
    ),
)
UNHARMED = ("clean", "tool", "quant")
ARMS = ("ur10", "xarm7")
QUICK = {("ur10", "clean")}


def found(arm: str, trap: str) -> tuple[TrapLog, ec.Identification]:
    log = trap_log(trap, arm, 1)
    return log, ec.identify(robot_file(ROBOTS[arm]), log.columns)


@pytest.mark.parametrize(
    ("arm", "trap"), slow_unless(QUICK, [(arm, trap) for arm in ARMS for trap in NAMED])
)
def test_what_is_wrong_is_named_before_all_else(arm: str, trap: str) -> None:
    log, result = found(arm, trap)
    assert log.named(result), result.findings
    assert log.named_first(result), result.findings
    assert not log.wrong(result)


@pytest.mark.parametrize(
    ("arm", "trap"),
    slow_unless(QUICK, [(arm, trap) for arm in (*ARMS, "panda") for trap in UNHARMED]),
)
def test_where_nothing_is_wrong_nothing_is_named(arm: str, trap: str) -> None:
    log, result = found(arm, trap)
    assert not log.wrong(result)
    assert result.reasons == ()
    covered, parameters = log.coverage(result) or (0, 0)
    assert covered > 0.8 * parameters > 0


def test_rows_at_a_limit_of_the_sensor_are_left_out() -> None:
    log, result = found("ur10", "saturate")
    assert log.named_first(result)
    covered, parameters = log.coverage(result) or (0, 0)
    assert covered > 0.9 * parameters > 0
    assert (
        min(
            score.r2 for validation in result.validations for score in validation.scores
        )
        > 0.999
    )


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_sizes_of_what_gives_way_are_about_right(arm: str) -> None:
    """Stiffnesses within 15 %: two joints bend by 0.03 rad per standard deviation of their load."""
    _, result = found(arm, "sea")
    true = trap_arm(arm, 1)
    said = {
        name: float(size)
        for judged in result.hypotheses
        for name, size in re.findall(
            r"'(\w+)' gives way: its stiffness is about (\S+)", judged.words
        )
    }
    for joint in true.strong[:2]:
        assert said[true.names[joint]] == pytest.approx(
            true.size[joint] / 0.03, rel=0.15
        )


def test_truth_is_of_the_model_alone() -> None:
    """Base parameters are those of the robot where the model can have its forces, and there are none elsewhere."""
    log = trap_log("tool", "ur3", 1)
    base = ec.base_parameters(ec.load(robot_file(ROBOTS["ur3"])))
    assert log.truth(base) is None  # of a model without friction
    assert TRAPS.keys() > {*NAMED, *UNHARMED}
