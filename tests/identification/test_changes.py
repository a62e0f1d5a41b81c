"""A payload that is attached on the way is named with its time by the log's own stamps, or with its log."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from support.robot_files import robot_file
from support.selection import slow_unless
from support.simulated_motions import RATE, fourier
from support.trap_logs import ROBOTS, arm, usual_log

Floats = npt.NDArray[np.float64]

ARM = """{echelon: 1, name: arm, gravity: [0, 0, -9.81], effects: usual, modified_dh: [{joint: revolute},
  {joint: revolute, alpha: pi/2, a: 0.1}, {joint: revolute, a: 0.5}],
  log: {time: t, position: "q{n}", output: "tau{n}"}}"""
BODIES = [
    *(4, 0, 0, 3, 0, 2, 1, 0.5, 0.2, 9),
    *(0.4, 0, 0, 1.2, 0, 1.1, 1.5, 0.1, 0.3, 5),
    *(0.1, 0, 0, 0.3, 0, 0.3, 0.5, 0, 0.1, 2),
]
LOAD = [0.02, 0, 0, 0.08, 0, 0.08, 0.2, 0, 0.05, 0.6]
"""Parameters that the payload adds to those of the last body."""


@cache
def base_of_arm() -> ec.BaseModel:
    return ec.base_parameters(ec.load_setup(ARM).mechanism)


def write_run(path: Path, seed: int, begin: float, loaded: slice) -> float:
    """Write a log whose stamps begin at some time, with a payload in some of its samples; its length, s."""
    base = base_of_arm()
    friction = [
        {"Fv": 2.0, "Fc": 1.5, "Fo": 0.3}[name[:2]] for name in base.parameters[30:]
    ]
    q, qd, qdd = fourier(np.random.default_rng(seed), 3, 0.9, harmonics=8)
    tau = base.predict(q, qd, qdd, base.values([*BODIES, *friction]))
    heavier = np.array(BODIES, dtype=float)
    heavier[20:] += LOAD
    tau[loaded] = base.predict(q, qd, qdd, base.values([*heavier, *friction]))[loaded]
    tau += 0.05 * np.random.default_rng(seed + 1).normal(size=q.shape)
    time = begin + np.arange(len(q)) / RATE
    table = np.column_stack([time, q, tau])
    np.savetxt(
        path,
        table,
        delimiter=",",
        header="t,q1,q2,q3,tau1,tau2,tau3",
        comments="",
        fmt="%.12g",
    )
    return len(q) / RATE


def changes(logs: list[Path]) -> list[str]:
    """Findings about changes between logs that are all fitted."""
    setup = ec.load_setup(ARM).with_settings(physical=False)
    return [
        finding.text
        for finding in ec.identify(setup, logs, logs[-1:]).findings
        if finding.kind == "changes"
    ]


def test_time_is_that_of_the_stamps(tmp_path: Path) -> None:
    log = tmp_path / "run.csv"
    length = write_run(log, 1, 1000.0, slice(1500, None))
    first, *others = changes([log])
    assert not others
    said = re.search(r"'[^']*3' carries another load from about ([\d.]+) s on", first)
    assert said is not None, first
    assert float(said[1]) == pytest.approx(1000 + 1500 / RATE, abs=length / 10)
    assert f"cut the log at {said[1]} s" in first


@pytest.mark.slow
def test_log_in_which_the_payload_is_is_named(tmp_path: Path) -> None:
    bare, loaded = tmp_path / "bare.csv", tmp_path / "loaded.csv"
    write_run(bare, 1, 0.0, slice(0, 0))
    write_run(loaded, 3, 0.0, slice(None))
    first, *others = changes([bare, loaded])
    assert not others
    assert re.search(r"3' carries another load in '.*loaded\.csv'", first)
    assert re.search(
        r"identify the logs up to '.*bare\.csv' and those from '.*loaded\.csv' on separately",
        first,
    )


@pytest.mark.slow
def test_log_between_others_in_which_the_payload_is_is_named(tmp_path: Path) -> None:
    logs = [tmp_path / f"{name}.csv" for name in ("before", "loaded", "after")]
    for seed, log in enumerate(logs):
        write_run(
            log, 1 + 2 * seed, 0.0, slice(None) if log.stem == "loaded" else slice(0, 0)
        )
    first, *others = changes(logs)
    assert not others
    assert re.search(r"3' carries another load in '.*loaded\.csv' alone", first)
    assert re.search(r"identify '.*loaded\.csv' and the other logs separately", first)


@pytest.mark.slow
def test_log_in_which_the_payload_is_attached_is_named(tmp_path: Path) -> None:
    bare, attached = tmp_path / "bare.csv", tmp_path / "attached.csv"
    write_run(bare, 1, 0.0, slice(0, 0))
    length = write_run(attached, 3, 1000.0, slice(1500, None))
    first, *others = changes([bare, attached])
    assert not others
    said = re.search(
        r"another load from about ([\d.]+) s of '.*attached\.csv' on", first
    )
    assert said is not None, first
    assert float(said[1]) == pytest.approx(1000 + 1500 / RATE, abs=length / 5)
    assert re.search(rf"cut '.*attached\.csv' at {said[1]} s", first)


@pytest.mark.parametrize("loaded", slow_unless([True], [False, True]))
def test_a_load_in_a_log_that_only_validates_is_named(
    loaded: bool, tmp_path: Path
) -> None:
    bare, other = tmp_path / "bare.csv", tmp_path / "other.csv"
    write_run(bare, 1, 0.0, slice(0, 0))
    write_run(other, 3, 0.0, slice(None) if loaded else slice(0, 0))
    setup = ec.load_setup(ARM).with_settings(physical=False)
    assert said_of_loads(ec.identify(setup, [bare], [other]), "j3") == loaded


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.0, 0.07])
def test_a_load_of_a_large_arm_in_a_log_that_only_validates_is_named(
    mass: float,
) -> None:
    first, other = arm("ur10", 1), arm("ur10", 2)
    second = replace(first, q=other.q, qd=other.qd, qdd=other.qdd).with_load(mass)
    logs = [usual_log(some).columns for some in (first, second)]
    result = ec.identify(robot_file(ROBOTS["ur10"]), *logs)
    assert said_of_loads(result, "wrist_3_link") == bool(mass)


def said_of_loads(result: ec.Identification, body: str) -> bool:
    """Whether another load of a body in the log that validates is the only finding of its kind; else there is none."""
    said = [f.text for f in result.findings if f.kind in ("changes", "setup error")]
    words = f"in this log, unlike in the fitted ones, '{body}' carries another load"
    assert said in ([], [words])
    return bool(said)
