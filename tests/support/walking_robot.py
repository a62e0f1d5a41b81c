"""A quadruped that trots in MuJoCo: states, joint torques, and which feet touch; nobody measures contact forces."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
LEGS = {"fl": (1, 1), "fr": (1, -1), "rl": (-1, 1), "rr": (-1, -1)}
THIGH, SHANK = 0.2, 0.2
_STEP = 0.0005  # s


def robot_mjcf(rng: np.random.Generator) -> str:
    """The robot alone, with inertias that are not symmetric."""

    def inertial(mass: float, size: float) -> str:
        com = " ".join(f"{x:.4f}" for x in 0.2 * size * rng.uniform(-1, 1, 3))
        spins = mass * size**2 * rng.uniform(0.25, 0.35, 3)
        tilt = " ".join(f"{x:.3f}" for x in rng.normal(size=4))
        return f'<inertial pos="{com}" mass="{mass}" diaginertia="{spins[0]:.5f} {spins[1]:.5f} {spins[2]:.5f}" quat="{tilt}"/>'

    legs = ""
    for name, (x, y) in LEGS.items():
        legs += f"""
      <body name="{name}_hip" pos="{0.2 * x} {0.06 * y} 0">
        <joint name="{name}_abduction" axis="1 0 0"/>{inertial(0.7, 0.12)}
        <body name="{name}_thigh" pos="0 {0.08 * y} 0">
          <joint name="{name}_hip_pitch" axis="0 1 0"/>{inertial(1.0, 0.2)}
          <body name="{name}_shank" pos="0 0 -{THIGH}">
            <joint name="{name}_knee" axis="0 1 0"/>{inertial(0.3, 0.2)}
            <geom name="{name}_foot" type="sphere" size="0.0005" pos="0 0 -{SHANK}" friction="1"/>
          </body>
        </body>
      </body>"""
    return f"""<mujoco model="quadruped"><compiler angle="radian" autolimits="true"/>
  <worldbody><body name="trunk" pos="0 0 0.36"><freejoint name="trunk"/>{inertial(8, 0.3)}{legs}
  </body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Walk:
    """Samples of a walk, in MuJoCo's coordinates."""

    q: Floats
    v: Floats
    a: Floats
    torque: Floats  # of the twelve joints
    touching: npt.NDArray[np.bool_]  # of the feet in the order of LEGS
    touched: npt.NDArray[np.bool_]  # the same since the sample before, as sensors tell


HARD = 300.0  # m/s² or rad/s²: beyond it a foot lands, which no log resolves


def trots(text: str, count: int) -> Walk:
    """Several short trots, before the robot, which nobody balances, falls; without the moments when feet land."""
    walks = [trot(text, 1.8, seed) for seed in range(1, count + 1)]
    parts = [
        np.concatenate([getattr(walk, field.name) for walk in walks])
        for field in fields(Walk)
    ]
    calm = np.abs(parts[2]).max(axis=1) < HARD
    return Walk(*(part[calm] for part in parts))


def trot(text: str, seconds: float, seed: int = 1) -> Walk:
    """Feet in diagonal pairs lift in turn, while the trunk sways."""
    import mujoco

    scene = text.replace(
        "<worldbody>",
        f'<option timestep="{_STEP}" integrator="implicitfast" cone="elliptic" impratio="10"/>'
        '<default><geom solref="0.002 1"/></default><worldbody><geom name="floor" type="plane" size="5 5 .1"/>',
    )
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    rest = np.tile([0.0, 0.55, -1.1], 4)
    sway = rng.uniform(-0.08, 0.08, (12, 3))
    beats = rng.uniform(0.5, 2.5, (12, 3))
    data.qpos[7:] = rest
    data.qpos[2] = THIGH * np.cos(0.55) + SHANK * np.cos(0.55) + 0.001
    feet = {model.geom(f"{name}_foot").id: k for k, name in enumerate(LEGS)}
    floor = model.geom("floor").id
    kept = list[tuple[Floats, ...]]()
    touched = np.zeros(4, dtype=bool)
    torque = np.zeros(12)
    for step in range(int(seconds / _STEP)):
        t = step * _STEP
        ramp = min(1.0, t)
        target = rest + ramp * (sway * np.sin(2 * np.pi * beats * t)).sum(axis=1)
        phase = np.sin(2 * np.pi * 1.5 * t)
        for leg, pair in enumerate((1, -1, -1, 1)):  # diagonal pairs
            lift = ramp * 0.35 * max(0.0, pair * phase - 0.2)
            target[3 * leg + 1] += lift
            target[3 * leg + 2] -= 2 * lift
        torque = 120 * (target - data.qpos[7:]) - 3 * data.qvel[6:]
        data.qfrc_applied[6:] = torque
        mujoco.mj_forward(model, data)
        touching = np.zeros(4, dtype=bool)
        for contact in data.contact[: data.ncon]:
            pair = {int(contact.geom1), int(contact.geom2)} - {floor}
            touching[[feet[g] for g in pair if g in feet]] = True
        touched |= touching
        if step % 10 == 0 and t > 0.3:
            kept.append(
                (
                    data.qpos.copy(),
                    data.qvel.copy(),
                    data.qacc.copy(),
                    torque.copy(),
                    touching,
                    touched,
                )
            )
            touched = np.zeros(4, dtype=bool)
        mujoco.mj_step(model, data)
    parts = (np.array(part) for part in zip(*kept, strict=True))
    return Walk(*parts)


JOINTS = [f"{leg}_{j}" for leg in LEGS for j in ("abduction", "hip_pitch", "knee")]
"""Joints in MuJoCo's order."""


def write_log(walk: Walk, path: Path, rng: np.random.Generator) -> None:
    """A log as users have it: pose and twist of the trunk, joints, torques with noise, and which feet touch."""
    torque = walk.torque + 0.1 * rng.normal(size=walk.torque.shape)
    time = 10 * _STEP * np.arange(len(walk.q))
    columns = np.column_stack([time, walk.q, walk.v, torque, walk.touched])
    names = ["t", *"xyz", *(f"q{k}" for k in "wxyz"), *(f"q_{n}" for n in JOINTS)]
    names += [f"{kind}{axis}" for kind in "vw" for axis in "xyz"]
    names += [f"v_{n}" for n in JOINTS] + [f"tau_{n}" for n in JOINTS]
    names += [f"contact_{leg}" for leg in LEGS]
    np.savetxt(path, columns, delimiter=",", header=",".join(names), comments="")
