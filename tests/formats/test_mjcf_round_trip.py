"""An MJCF file, a log of the robot it stands for, and the file that identification makes of both, all in MuJoCo."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
from echelon.formats.writers.robot_writer import identified_robot
from support.simulated_motions import RATE, fourier

Floats = npt.NDArray[np.float64]

TRUE, STATED = 1.0, 0.6
"""Factors of what the robot is, and of what its file says of it."""
NAMES = ("a", "b", "c")
GEAR = '<actuator><motor joint="b" gear="50"/></actuator>'
FINGER = 0.4
"""Angle of the finger per angle of its leader, where the robot has one."""


def model(factor: float, joint: str, *, finger: bool = False, extra: str = "") -> str:
    """An arm of three joints, with attributes for all of them; numbers in braces are multiplied by the factor."""
    drive = " ".join(
        f'{k}="{factor * float(v)}"'
        for k, v in (pair.split("=") for pair in joint.split())
    )
    turned = f"{np.degrees(factor * 0.3)}"
    drive = drive if "stiffness" not in drive else f'{drive} springref="{turned}"'
    body = '<inertial pos="{} 0.02 {}" mass="{}" diaginertia="{} {} {}"/>'
    inertials = [
        body.format(
            factor * x,
            factor * 0.1,
            factor * m,
            factor**2 * m / 50,
            factor**2 * m / 60,
            factor**2 * m / 90,
        )
        for x, m in ((0.05, 4.0), (0.2, 3.0), (0.15, 1.5), (0.05, 0.4))
    ]
    follower = (
        f'<body pos="0.1 0.05 0"><joint name="finger" axis="0 0 1" {drive}/>{inertials[3]}</body>'
        if finger
        else ""
    )
    equality = (
        f'<joint joint1="finger" joint2="c" polycoef="0 {FINGER} 0 0 0"/>'
        if finger
        else ""
    )
    return f"""<mujoco><worldbody><body><joint name="a" axis="0 0 1" {drive}/>{inertials[0]}
        <body pos="0.1 0 0.2"><joint name="b" axis="0 1 0" {drive}/>{inertials[1]}
        <body pos="0.4 0 0"><joint name="c" axis="0 1 0" {drive}/>{inertials[2]}{follower}
        </body></body></body></worldbody><equality>{equality}</equality>{extra}</mujoco>"""


def torques(text: str, states: tuple[Floats, ...]) -> Floats:
    """Torques of the leading joints, without the constraints that make others follow."""
    robot = mujoco.MjModel.from_xml_string(text)
    robot.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    robot.dof_solref[:] = [0.001, 1]
    data, found, follows = mujoco.MjData(robot), [], np.eye(3, robot.nv)
    follows[2, 3:] = FINGER
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(
        *(s @ follows for s in states), strict=True
    ):
        mujoco.mj_inverse(robot, data)
        found.append(follows @ data.qfrc_inverse)
    return np.array(found)


def identified(
    folder: Path, given: str, true: str, **more: str
) -> tuple[str, ec.Identification]:
    """The file that is written, and the identification, from a noisy log of the true robot."""
    (folder / "in.xml").write_text(given)
    states = fourier(np.random.default_rng(3), 3, 0.9)
    y = torques(true, states) + 0.02 * np.random.default_rng(4).normal(
        size=states[0].shape
    )
    table = np.column_stack([np.arange(len(y)) / RATE, states[0], y])
    header = ",".join(["t", *(f"q_{n}" for n in NAMES), *(f"tau_{n}" for n in NAMES)])
    np.savetxt(folder / "run.csv", table, delimiter=",", header=header, comments="")
    log = {"time": "t", "position": "q_{name}", "output": "tau_{name}"}
    (folder / "setup.yaml").write_text(
        json.dumps({"echelon": 1, "robot": {"file": "in.xml"}, "log": log, **more})
    )
    setup = ec.load_setup(folder / "setup.yaml")
    result = ec.identify(setup, [folder / "run.csv"])
    assert result.physical is not None
    (written,) = identified_robot(
        result.base.mechanism, result.physical.standard, setup.robot_file
    )
    return written.text, result


FRESH = tuple(s[::40] for s in fourier(np.random.default_rng(5), 3, 0.9))


@pytest.mark.parametrize(
    ("joint", "finger", "extra"),
    [
        pytest.param("armature=0.8", False, "", id="armature", marks=pytest.mark.slow),
        pytest.param(
            "damping=1.5 frictionloss=0.7",
            False,
            "",
            id="friction",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "armature=0.5 damping=1.5 frictionloss=0.7 stiffness=6",
            False,
            "",
            id="all with springs",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "armature=0.5",
            False,
            '<actuator><motor joint="b" gear="50"/></actuator>',
            id="gear",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "armature=0.4 damping=0.5 frictionloss=0.3", True, "", id="equality"
        ),
    ],
)
def test_the_written_file_predicts_better(
    joint: str, finger: bool, extra: str, tmp_path: Path
) -> None:
    given, true = (
        model(factor, joint, finger=finger, extra=extra) for factor in (STATED, TRUE)
    )
    written, _ = identified(tmp_path, given, true)
    exact = torques(true, FRESH)
    before, after = (
        np.sqrt(np.mean((torques(text, FRESH) - exact) ** 2, axis=0))
        for text in (given, written)
    )
    assert (after < before).all()
    assert (after < 0.02 * exact.std(axis=0)).all()


@pytest.mark.slow
def test_armatures_that_are_no_effects_are_in_the_inertias_alone(
    tmp_path: Path,
) -> None:
    written, result = identified(
        tmp_path,
        model(STATED, "armature=0.8"),
        model(TRUE, "armature=0.8"),
        effects="none",
    )
    assert result.physical is not None
    np.testing.assert_allclose(
        torques(written, FRESH),
        result.base.predict(*FRESH, result.physical.base),
        atol=1e-9,
    )


GANTRY = """<mujoco><worldbody><body><joint name="a" type="slide" axis="1 0 0" {drive}/>
    <inertial pos="0 0 0" mass="{0}" diaginertia="1 1 1"/><body><joint name="b" type="slide" axis="0 1 0" {drive}/>
    <inertial pos="0 0 0" mass="{1}" diaginertia="1 1 1"/><body><joint name="c" type="slide" axis="0 0 1" {drive}/>
    <inertial pos="0 0 0" mass="{2}" diaginertia="1 1 1"/></body></body></body></worldbody></mujoco>"""


@pytest.mark.slow
def test_the_rotor_of_a_vertical_slide_is_not_lifted_by_an_offset(
    tmp_path: Path,
) -> None:
    """Its inertia weighs nothing: as mass it would need a constant force, for which MJCF has no place."""
    given, true = (
        GANTRY.format(30, 9, 4, drive=""),
        GANTRY.format(40, 15, 6, drive='armature="4" damping="30"'),
    )
    written, result = identified(tmp_path, given, true)
    assert "Ia3" in result.base.mechanism.parameters
    assert any(
        "a rotor inertia was added to the model at c" in finding.text
        for finding in result.findings
    )
    np.testing.assert_allclose(torques(written, FRESH), torques(true, FRESH), atol=0.3)
    robot = mujoco.MjModel.from_xml_string(written)
    np.testing.assert_allclose(
        [robot.body_mass[3], robot.dof_armature[2]], [6, 4], rtol=0.01
    )
