"""Magnitudes that no robot has: wrong units of angles, times, lengths and torques, and surplus columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.faults.plausibility import (
    check_plausible,
    surplus_columns,
)
from echelon.identification.logs.files.log_file import LogFile
from echelon.identification.logs.files.numpy_file import MemoryLog
from echelon.identification.logs.files.open_log import open_log
from echelon.identification.logs.recording import Recording
from echelon.robot import lock_joints
from support.column_maps import channels
from support.faulty_logs import ARM, RATE, changed, clean

GRIPPER = load("examples/gripper_coupled.yaml")

MAP = ColumnMap(
    time=Channel("t"),
    positions={"j1": Channel("a"), "j2": Channel("b")},
    outputs={"j1": Channel("c"), "j2": Channel("d")},
)


def with_unit(group: str, unit: str) -> ColumnMap:
    own: Mapping[str, Channel] = getattr(MAP, group)
    return replace(
        MAP,
        **{group: {name: replace(channel, unit=unit) for name, channel in own.items()}},
    )  # type: ignore[arg-type]


def test_degrees_taken_for_radians() -> None:
    recorded = clean()
    degrees = changed(recorded, "q", np.degrees(recorded.signals["q"]))
    with pytest.raises(
        ec.InputError,
        match=r"'j1', 'j2': angles up to .* turns: are they in degrees \(unit: deg\)",
    ):
        check_plausible(degrees, ARM, MAP)
    assert not check_plausible(degrees, ARM, with_unit("positions", "rad"))
    counts = changed(recorded, "q", 4096 * recorded.signals["q"])
    with pytest.raises(ec.InputError, match="encoder counts"):
        check_plausible(counts, ARM, MAP)
    wheel = changed(
        recorded, "q", recorded.signals["q"] * [1, 1] + np.outer(recorded.time, [2, 0])
    )
    (found,) = check_plausible(wheel, ARM, MAP)
    assert found.kind == "units"
    assert "'j1': angles" in found.text


def test_radians_taken_for_degrees() -> None:
    recorded = clean()
    small = changed(recorded, "q", np.radians(recorded.signals["q"]))
    (found,) = check_plausible(small, ARM, with_unit("positions", "deg"))
    assert "are the columns in rad" in found.text
    assert not check_plausible(small, ARM, MAP)


@pytest.mark.parametrize(("scale", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_time_in_smaller_units(scale: float, unit: str) -> None:
    recorded = clean()
    slow = replace(recorded, time=recorded.time * scale)
    with pytest.raises(
        ec.InputError,
        match=rf"column 't': .*is time in {unit} \(unit: {unit}; 250 samples per second",
    ):
        check_plausible(slow, ARM, MAP)
    assert not check_plausible(slow, ARM, replace(MAP, time=Channel("t", "s")))
    assert not check_plausible(recorded, ARM, replace(MAP, time=Channel("t", unit)))
    assert [finding.kind for finding in check_plausible(slow, ARM)] == ["time"]
    fast = replace(recorded, time=recorded.time / scale)
    (found,) = check_plausible(fast, ARM, replace(MAP, time=Channel("t", unit)))
    assert "is time in s?" in found.text


def test_rates_that_show_no_dynamics() -> None:
    (found,) = check_plausible(clean(), ARM, replace(MAP, time=None, rate=1e6))
    assert found.text.startswith(
        "at the stated rate of 1e+06 Hz there is a sample every 1e-06 s"
    )
    assert not check_plausible(clean(), ARM, replace(MAP, time=None, rate=RATE))


def test_millimetres_taken_for_metres() -> None:
    names = GRIPPER.positions
    time = np.arange(1000) / RATE
    scale = np.array([120.0 if name == "left" else 1.0 for name in names])
    q = np.sin(np.outer(time, np.arange(1, len(names) + 1)))
    positions = {name: Channel(name) for name in names}
    with pytest.raises(
        ec.InputError, match="position of 'left': it goes to 120 m: is it in mm"
    ):
        check_plausible(
            Recording("run", time, {"q": q * scale}),
            GRIPPER,
            ColumnMap(positions=positions),
        )
    stated = positions | {"left": Channel("left", "mm")}
    assert not check_plausible(
        Recording("run", time, {"q": q}), GRIPPER, ColumnMap(positions=stated)
    )
    (found,) = check_plausible(
        Recording("run", time, {"q": q * scale**-2}),
        GRIPPER,
        ColumnMap(positions=stated),
    )
    assert "is the column in m (leave out unit: mm)" in found.text


def test_torques_beyond_every_robot_and_beyond_this_one() -> None:
    recorded = clean()
    strong = changed(recorded, "y", 1000 * recorded.signals["y"])
    with pytest.raises(
        ec.InputError,
        match=r"output of 'j1': it goes to .* is it in mN·m \(unit: mN·m\)",
    ):
        check_plausible(strong, ARM, MAP)
    assert not check_plausible(strong, ARM, with_unit("outputs", "N·m"))
    known = replace(
        ARM,
        bodies=tuple(
            replace(body, inertial=(0.1,) * 9 + (0.5,)) for body in ARM.bodies
        ),
    )
    assert not check_plausible(recorded, known, MAP)
    (found,) = check_plausible(
        changed(recorded, "y", 30 * recorded.signals["y"]), known, MAP
    )
    assert "where the weight of the described robot makes" in found.text
    (found,) = check_plausible(
        changed(recorded, "y", 1e-6 * recorded.signals["y"]), known, MAP
    )
    assert "kN·m" in found.text


def test_a_log_with_more_joints() -> None:
    used = ColumnMap(positions={f"j{n}": Channel(f"q_rad_{n}") for n in range(1, 7)})
    names = ["t_s", *(f"q_rad_{n}" for n in range(1, 8)), "tau_1"]
    (found,) = surplus_columns(used, _log(names), ARM)
    assert "'q_rad_7' beside the 6 columns" in found.text
    assert not surplus_columns(used, _log(names[:7]), ARM)
    # columns without names: those of other quantities, mapped or not, are no joints
    numbered = ColumnMap(
        positions=channels("{n}", ["a", "b"]), outputs=channels("{n}0", ["a", "b"])
    )
    assert not surplus_columns(numbered, _log([str(k) for k in range(12)]), ARM)


def test_a_joint_that_the_robot_has_locked_moves_in_the_log() -> None:
    used = ColumnMap(positions=channels("q_{n}", ["j2", "j3"]))
    held = lock_joints(ARM, {"j1": 0.0})
    names = ["t", "q_1", "q_2", "q_3"]
    (found,) = surplus_columns(used, _log(names, moving="q_3"), held)
    assert "'q_3' beside the 2 columns that are used: they move" in found.text
    assert not surplus_columns(used, _log(names, moving="q_1"), held)


def _log(names: Sequence[str], moving: str = "") -> LogFile:
    """A log of joints that rest, but for one."""
    columns = {n: np.full(5, 0.3) for n in names}
    if moving:
        columns[moving] = np.linspace(0, 1, 5)
    return open_log(MemoryLog.of(columns))
