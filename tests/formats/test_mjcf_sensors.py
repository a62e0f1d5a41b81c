"""Sensors of MJCF files as outputs, against what MuJoCo's own sensors say in forward simulation."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.robot.mechanism import Mechanism
from support.float_regressor import float_regressor, random_states, standard_vector
from support.mjcf_models import INERTIA, model

BODIES = f"""
    <body name="a" pos="0.1 0 0.2" euler="10 20 30"><joint name="a" axis="0 1 0"/>{INERTIA}
      <site name="root" pos="0.05 0.02 0" euler="30 0 40"/>
      <body name="b" pos="0.3 0 0.1"><joint name="b" type="slide" axis="1 1 0"/>{INERTIA}
        <body name="mount" pos="0.1 0 0" euler="0 45 0"><site name="wrist" pos="0 0.03 0.01" euler="90 0 20"/>
          <body name="tool" pos="0 0 0.2">{INERTIA}</body>
          <body name="c" pos="0 0 0.1"><joint name="c" axis="1 0 0"/>{INERTIA}</body>
    </body></body></body>"""
DRIVES = (
    '<tendon><fixed name="t"><joint joint="c" coef="1"/></fixed></tendon>'
    '<actuator><motor name="ma" joint="a" gear="50"/>'
    '<motor name="mb" joint="b" gear="-2.5"/><motor name="mc" tendon="t"/></actuator>'
)
SENSORS = (
    '<sensor><force name="ft" site="wrist"/><torque site="wrist"/><torque name="low" site="root"/>'
    '<actuatorfrc name="drive" actuator="ma"/><actuatorfrc actuator="mb"/><jointactuatorfrc joint="c"/></sensor>'
)


def load(folder: Path, text: str, **options: object) -> Mechanism:
    (folder / "robot.xml").write_text(text)
    return ec.load(folder / "robot.xml", snap_tolerance=0, **options)  # type: ignore[arg-type]


def test_outputs_are_what_the_sensors_say(tmp_path: Path) -> None:
    text = model(BODIES, tail=DRIVES + SENSORS)
    robot = load(tmp_path, text, measured="file")
    assert [body.name for body in robot.bodies] == [
        "a",
        "b",
        "mount",
        "c",
    ]  # the sensor cuts the mount off
    assert [(output.name, output.unit) for output in robot.outputs[::3]] == [
        ("ft.fx", "N"), ("wrist.tx", "N·m"), ("low.tx", "N·m"), ("drive", "N·m"),
    ]  # fmt: skip
    q, qd, qdd = random_states(robot, 4)
    found = float_regressor(robot, q, qd, qdd) @ standard_vector(robot)
    simulated = mujoco.MjModel.from_xml_string(text)
    simulated.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(simulated)
    for state, expected in zip(zip(q, qd, qdd, strict=True), found, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(simulated, data)
        data.ctrl[:] = data.qfrc_inverse / [50, -2.5, 1]
        mujoco.mj_forward(simulated, data)
        np.testing.assert_allclose(data.qacc, state[2], atol=1e-9)
        np.testing.assert_allclose(
            data.sensordata, expected, atol=1e-9 * np.abs(expected).max()
        )


def notes(robot: Mechanism) -> tuple[str, ...]:
    assert robot.reading is not None
    return robot.reading.notes


def test_drives_are_measured_unless_the_sensors_are_asked_for(tmp_path: Path) -> None:
    text = model(BODIES, tail=DRIVES + SENSORS)
    robot = load(tmp_path, text)
    assert robot.measured is None
    assert [body.name for body in robot.bodies] == ["a", "b", "c"]
    assert (
        "6 force sensors of the file are not used; --measured file takes them as outputs"
        in notes(robot)
    )
    (tmp_path / "setup.yaml").write_text("echelon: 1\nrobot: {file: robot.xml}\n")
    setup = ec.load(tmp_path / "setup.yaml", measured="file")
    assert len(setup.outputs) == 12
    wrist = load(tmp_path, text, measured="file")
    rows = float_regressor(wrist, *random_states(wrist, 100)).reshape(
        -1, len(wrist.parameters)
    )
    singular = np.linalg.svd(rows, compute_uv=False)
    rank = ec.base_structure(wrist).rank
    assert singular[rank] < 1e-10 * singular[0] < 1e-4 * singular[rank - 1]


def test_what_is_left_out_is_noted(tmp_path: Path) -> None:
    sensors = (
        '<sensor><actuatorfrc name="n" actuator="mc"/><jointpos joint="a"/><jointpos joint="b"/><gyro site="wrist"/>'
        '<force name="w" site="ground"/><jointactuatorfrc joint="a"/><jointactuatorfrc name="two" joint="b"/></sensor>'
    )
    equality = '<equality><joint joint1="b" joint2="c"/></equality>'
    robot = load(
        tmp_path,
        model(BODIES + '<site name="ground"/>', tail=DRIVES + sensors + equality),
        measured="file",
    )
    assert [output.name for output in robot.outputs] == ["a"]
    for note in (
        "sensor actuatorfrc 'n' is left out: it does not drive a joint directly",
        "sensors of other quantities than drive forces and wrenches are left out: gyro (1), jointpos (2)",
        "sensor force 'w' is left out: the world has no parent",
        "sensor jointactfrc 'two' is left out: joint 'b' does not move freely",
    ):
        assert note in notes(robot)


def test_without_sensors_there_is_nothing_to_measure(tmp_path: Path) -> None:
    with pytest.raises(
        ec.InputError, match=r"robot\.xml: the file has no force sensors"
    ):
        load(
            tmp_path,
            model(BODIES, tail='<sensor><jointpos joint="a"/></sensor>'),
            measured="file",
        )
    with pytest.raises(
        ec.InputError,
        match="argument 'measured' of load: needs one of 'drives', 'file'; found str 'all'",
    ):
        load(tmp_path, model(BODIES), measured="all")
