"""Dry friction that turns smoothly is named with its width; Coulomb friction that is seen late or coarsely is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from support.robot_files import robot_file
from support.selection import slow_unless
from support.trap_logs import ROBOTS, TrapLog, arm, trap_log, usual_log


def named(robot: str, log: TrapLog) -> list[str]:
    """Findings that name smooth friction."""
    result = ec.identify(robot_file(ROBOTS[robot]), log.columns)
    return [f.text for f in result.findings if "smooth_coulomb" in f.text]


@pytest.mark.parametrize(
    ("robot", "seed"),
    slow_unless({("ur10", 1)}, [(r, s) for r in ("ur10", "z1") for s in (1, 2, 3)]),
)
def test_smooth_friction_is_named_with_its_width(robot: str, seed: int) -> None:
    (text,) = named(robot, trap_log("smooth", robot, seed))
    true = 0.05 * float(np.median(arm(robot, seed).qd.std(axis=0)))
    found = re.search(r"at: \[(.*?)\], width: (\S+)}.* in place of coulomb", text)
    assert found is not None
    assert len(found[1].split(", ")) >= 3
    assert true / 1.8 < float(found[2]) < 1.8 * true


@pytest.mark.parametrize(
    ("kind", "robot", "seed"),
    slow_unless(
        {("lag", "ur10", 1)},
        [
            (kind, robot, seed)
            for kind in ("lag", "coarse", "much")
            for robot in ("ur10", "z1")
            for seed in (1, 2, 3)
        ],
    ),
)
def test_coulomb_friction_is_not_smooth(kind: str, robot: str, seed: int) -> None:
    """Seen late, by coarse encoders, or much of it with little noise."""
    true = arm(robot, seed)
    if kind == "lag":
        log = trap_log("lag", robot, seed)
    elif kind == "coarse":
        log = usual_log(replace(true, noise=0.1 * true.noise), step=3e-3)
    else:
        log = usual_log(replace(true, dry=8 * true.dry))
    assert not named(robot, log)
