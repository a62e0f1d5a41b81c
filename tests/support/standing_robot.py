"""Robots that stand on feet which MuJoCo holds to the ground; nobody measures the forces there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

STEP, EVERY = 0.0005, 10  # s; steps between samples
STIFF = 20.0  # rad/s, natural frequency of controlled joints


def biped_mjcf(rng: np.random.Generator) -> str:
    """A trunk on two legs of three joints with point feet, and inertias that are not symmetric."""

    def inertial(mass: float, size: float) -> str:
        com = " ".join(f"{x:.4f}" for x in 0.2 * size * rng.uniform(-1, 1, 3))
        a, b, c = mass * size**2 * rng.uniform(0.25, 0.35, 3)
        tilt = " ".join(f"{x:.3f}" for x in rng.normal(size=4))
        spins = f"{a:.5f} {b:.5f} {c:.5f}"
        return (
            f'<inertial pos="{com}" mass="{mass}" diaginertia="{spins}" quat="{tilt}"/>'
        )

    legs = ""
    for name, side in (("left", 1), ("right", -1)):
        legs += f"""<body name="{name}_hip" pos="0 {0.1 * side} 0"><joint name="{name}_roll" axis="1 0 0"/>
          {inertial(1.0, 0.2)}<body name="{name}_thigh" pos="0.05 0 0"><joint name="{name}_pitch" axis="0 1 0"/>
          {inertial(2.0, 0.3)}<body name="{name}_shank" pos="0 0 -0.3"><joint name="{name}_knee" axis="0 1 0"/>
          {inertial(1.0, 0.3)}</body></body></body>"""
    trunk = f'<freejoint name="trunk"/>{inertial(6.0, 0.4)}'
    return (
        '<mujoco model="biped"><compiler angle="radian"/><worldbody>'
        f'<body name="trunk" pos="0 0 0.55">{trunk}{legs}</body></worldbody></mujoco>'
    )


def log_standing(
    robot: Path,
    feet: Sequence[tuple[str, str]],
    path: Path,
    seconds: float,
    seed: int,
) -> None:
    """A log of a robot that sways while bodies are held: a name and a point for each foot, or no point for a sole."""
    import mujoco

    rng = np.random.default_rng(seed)
    spec = mujoco.MjSpec.from_file(str(robot))
    spec.option.timestep = STEP
    spec.option.gravity = (0, 0, -9.81)
    for joint in spec.joints:  # what a file states beside inertias
        joint.limited, joint.frictionloss = mujoco.mjtLimited.mjLIMITED_FALSE, 0
        joint.damping = np.zeros_like(joint.damping)
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        spec.worldbody.first_body().add_freejoint()
    for body, point in feet:
        held = spec.add_equality()
        held.type = mujoco.mjtEq.mjEQ_CONNECT if point else mujoco.mjtEq.mjEQ_WELD
        held.objtype = mujoco.mjtObj.mjOBJ_BODY
        held.name1, held.name2 = body, "world"
        held.data[:3] = [float(x) for x in point.split()] if point else 0
        held.solref[:] = (0.001, 1)
    model = spec.compile()
    data = mujoco.MjData(model)
    joints = model.nv - 6
    inertia = model.dof_M0[6:]
    size = rng.uniform(0.1, 0.4, (joints, 4)) / np.arange(1, 5)
    beats = rng.uniform(0.3, 1.5, (joints, 4))
    rows = []
    for step in range(int(seconds / STEP)):
        t = step * STEP
        target = min(1.0, t) * (size * np.sin(2 * np.pi * beats * t)).sum(axis=1)
        wanted = STIFF**2 * (target - data.qpos[7:]) - 2 * STIFF * data.qvel[6:]
        torque = inertia * wanted
        data.qfrc_applied[6:] = torque
        mujoco.mj_forward(model, data)
        if step % EVERY == 0:
            measured = torque + 0.02 * rng.normal(size=joints)
            rows.append(np.concatenate([[t], data.qpos, data.qvel, measured]))
        mujoco.mj_step(model, data)
    names = [model.joint(k).name for k in range(1, model.njnt)]
    head = ["t", *"xyz", *(f"q{k}" for k in "wxyz"), *(f"q_{n}" for n in names)]
    head += [f"{kind}{axis}" for kind in "vw" for axis in "xyz"]
    head += [f"v_{n}" for n in names] + [f"tau_{n}" for n in names]
    np.savetxt(path, np.array(rows), delimiter=",", header=",".join(head), comments="")
