"""Files to mutate: a small robot with its logs, trajectories and results, made once per run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

import echelon as ec

ROOT = Path(__file__).parents[2]
SAMPLES = 400
SETUP = """
echelon: 1
name: double pendulum
symbols: {l1: 0.3, g: 9.81}
gravity: [0, -g, 0]
modified_dh:
  - {joint: revolute, inertial: {mass: 1.0, com: [0.1, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
  - {joint: revolute, a: l1, inertial: {mass: 1.0, com: [0.1, 0, 0], inertia: {xx: 0.1, yy: 0.1, zz: 0.1}}}
effects: [{type: viscous, at: all}, {type: coulomb, at: j2}]
log: [{time: t, position: "q{n}", output: "tau{n}"}]
preparation: {band: 8, still: 0.02, delays: {}}
identification: {physical: false, essential: none, holdout: 0.2}
excitation:
  duration: 4
  limits: {position: {all: [-3, 3]}, velocity: 20, acceleration: 200, jerk: 5000}
"""
URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0" rpy="0 0 0"/><mass value="1.5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="lower"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    <collision><geometry><box size="0.1 0.1 0.5"/></geometry></collision></link>
  <link name="finger"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 0.2" rpy="0 1.5708 0"/><limit lower="-1" upper="1" velocity="2" effort="30"/>
    <dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/>
    <origin xyz="0.3 0 0" rpy="0 0 -1.57079632679"/></joint>
  <joint name="grip" type="prismatic"><parent link="lower"/><child link="finger"/><axis xyz="1 0 0"/>
    <mimic joint="elbow" multiplier="-2" offset="0.1"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
</robot>"""
_DESCRIPTIONS = (
    "double_pendulum",
    "cart_pole",
    "furuta",
    "scara",
    "gripper_coupled",
    "loops/four_bar",
    "linear/arrhenius",
)
_LINEAR = ("arrhenius", "heat_capacity", "thermal_network")

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Material:
    """Valid content by kind.

    Attributes
    ----------
    folder : Path
        With ``setup.yaml``, ``log.csv`` and the results as files.
    descriptions, linear, mjcf : list of str
    log : dict of str to array
    trajectory : dict
        JSON-able data.
    message : dict
        The same motion as a JointTrajectory.
    base, model : dict
        Results, JSON-able data.
    claims : str
    """

    folder: Path
    descriptions: list[str]
    linear: list[str]
    mjcf: list[str]
    log: dict[str, Floats]
    trajectory: dict[str, Any]
    message: dict[str, Any]
    base: dict[str, Any]
    model: dict[str, Any]
    claims: str


def make(folder: Path) -> Material:
    """Everything, written into a folder where a command needs it as a file."""
    from echelon.base.saved.saved import to_json
    from echelon.excite.files.samples import sampled, yaml_text
    from echelon.excite.files.trajectory_file import trajectory_to_json
    from echelon.excite.problem.trajectory import Fourier, Trajectory
    from echelon.identification.saved.identified import identification_to_json

    (folder / "setup.yaml").write_text(SETUP, encoding="utf-8")
    (folder / "robot.yaml").write_text(SETUP.split("log:")[0], encoding="utf-8")
    robot = ec.load(folder / "setup.yaml")
    base = ec.base_parameters(robot)
    log = _log(base)
    np.savetxt(
        folder / "log.csv",
        np.column_stack(list(log.values())),
        delimiter=",",
        header=",".join(log),
        comments="",
    )
    coefficients = np.random.default_rng(3).normal(scale=0.1, size=(5, 2))
    trajectory = Trajectory(("j1", "j2"), ("rad", "rad"), Fourier(4.0, 2), coefficients)
    model = identification_to_json(
        ec.identify(ec.load_setup(folder / "setup.yaml"), [folder / "log.csv"])
    )
    (folder / "base.json").write_text(to_json(base), encoding="utf-8")
    (folder / "model.json").write_text(model, encoding="utf-8")

    def texts(names: tuple[str, ...], pattern: str) -> list[str]:
        return [
            (ROOT / "examples" / pattern.format(name)).read_text(encoding="utf-8")
            for name in names
        ]

    return Material(
        folder,
        [*texts(_DESCRIPTIONS, "{}.yaml"), SETUP],
        texts(_LINEAR, "linear/{}.yaml"),
        texts(("two_link", "loops/four_bar"), "{}.xml"),
        log,
        trajectory_to_json(trajectory),
        yaml.safe_load(yaml_text(sampled(trajectory, 10.0))),
        json.loads(to_json(base)),
        json.loads(model),
        "\n".join(str(expression) for expression in base.expressions),
    )


def _log(base: ec.BaseModel) -> dict[str, Floats]:
    """A noisy motion."""
    rng = np.random.default_rng(1)
    t = np.arange(SAMPLES) / 100
    q, qd, qdd = np.zeros((3, SAMPLES, 2))
    for joint in range(2):
        for w in 2 * np.pi * rng.uniform(0.2, 1.5, 5):
            phase, size = rng.uniform(0, 7), rng.uniform(0.2, 0.6)
            q[:, joint] += size * np.sin(w * t + phase)
            qd[:, joint] += size * w * np.cos(w * t + phase)
            qdd[:, joint] -= size * w**2 * np.sin(w * t + phase)
    y = base.predict(q, qd, qdd, rng.uniform(0.5, 2.0, base.rank))
    y = y + 0.02 * y.std(axis=0) * rng.standard_normal(y.shape)
    return {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": y[:, 0], "tau2": y[:, 1]}
