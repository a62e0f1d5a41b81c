"""Trajectories for previews, and robots with hostile names."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf
from typing import Any

import numpy as np

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory, Start, conditioning_of
from echelon.excite.problem.task import changed, task_of
from echelon.excite.solve.design import designed
from echelon.excite.verify import Margin, margins_of
from echelon.identification.logs.finding import Finding, Severity
from support.paths import EXAMPLES
from support.report_data import HOSTILE
from support.unchecked_names import unchecked_names

STARTS = (
    Start(0, "optimal", -12.345678, 31, (3.5, -4.25, -12.345678)),
    Start(1, "no motion keeps the limits", inf, 7, ()),
    Start(2, "iterations", -11.5, 100, (1.5, -11.5)),
)


FINDINGS = (
    Finding(
        Severity.NOTE,
        "default limit",
        "arm.yaml",
        "'j1' has no jerk limit: takes 400 rad/s³",
    ),
    Finding(Severity.WARNING, "effort", "arm.yaml", "no limits of torques"),
)


@cache
def trajectory(robot: str = "double_pendulum", **changes: Any) -> ExcitingTrajectory:
    """A random motion within limits: what a page shows does not depend on how good it is."""
    setup = ec.load_setup(EXAMPLES / f"{robot}.yaml")
    limits = {"velocity": 2.0, "position": [-2.5, 2.5]}
    task = task_of(
        setup,
        changed(
            setup.excitation,
            {"duration": 6.0, "limits": limits, **changes},
            setup.source,
        ),
    )
    design = designed(task)
    run = design.trajectory(
        design.problem.scaled(design.problem.random(np.random.default_rng(1)), 0.5)
    )
    return ExcitingTrajectory(
        run, task.base, task.held, "d_optimal", conditioning_of(task, run), tuple(margins_of(run, task)), STARTS,
        FINDINGS,
        {"seed": 2015, "excitation": {"noise": {"all": 0.25}, "limits": {"effort": {"j1": inf}}}},
    )  # fmt: skip


def broken() -> ExcitingTrajectory:
    """A limit that is broken, one that is nearly reached, one without a lower end, all behind those that are kept."""
    found = trajectory()
    more = (
        Margin("height of hand", "m", 0.125, inf, 0.5, 1.5),
        Margin("torque of j2", "N·m", -40.0, 40.0, -39.875, 12.0),
        Margin("torque of j1", "N·m", -30.0, 30.0, -31.75, 12.0),
        Margin("torque of j3", "N·m", -30.0, 30.0, -12.0, 30.25),
    )
    return replace(found, margins=found.margins + more)


def hostile(found: ExcitingTrajectory) -> ExcitingTrajectory:
    """Copy of a motion with names that try to break out, wherever a name can stand."""
    names = {name: f"</script><b>{name}" for name in found.trajectory.coordinates}
    mechanism = found.base.mechanism
    bodies = []
    for k, body in enumerate(mechanism.bodies):
        steps = tuple(
            replace(s, name=names[s.name]) if hasattr(s, "name") else s
            for s in body.joint.steps
        )
        joint = replace(body.joint, name=HOSTILE, steps=steps)
        bodies.append(replace(body, name=f"{HOSTILE}{k}", label=f"<b>{k}", joint=joint))
    with unchecked_names():
        other = replace(
            mechanism,
            name=HOSTILE,
            bodies=tuple(bodies),
            effects=(),
            actuators=(),
            measured=None,
        )
    matrix = replace(found.base.matrix, parameters=other.parameters)
    base = ec.BaseModel(
        other, matrix, found.base.certificate, found.base.reading, found.base.seed
    )
    run = found.trajectory
    return replace(
        found, base=base, criterion=HOSTILE, held={HOSTILE: 1.0}, settings={HOSTILE: HOSTILE},
        trajectory=replace(run, coordinates=tuple(names.values()), units=(HOSTILE,) * len(names)),
        margins=tuple(replace(m, label=f"{HOSTILE}{k}", unit=HOSTILE) for k, m in enumerate(found.margins)),
        starts=tuple(replace(s, status=HOSTILE) for s in found.starts),
        findings=(Finding(Severity.WARNING, HOSTILE, HOSTILE, HOSTILE),),
    )  # fmt: skip
