"""Logs of servo-driven arms, simulated by MuJoCo: positions, commands, nothing else."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

STEP = 1 / 3000
RATE = 30.0
ENCODER = 2 * np.pi / 4096


@dataclass(frozen=True)
class ServoArm:
    """Truth: an arm whose joints are servos."""

    model: Any
    gains: np.ndarray

    @property
    def names(self) -> list[str]:
        return [self.model.joint(k).name for k in range(self.model.njnt)]

    def inertia(self) -> dict[str, np.ndarray]:
        """Mass, first moments and inertia about the frame's origin of every body, as Echelon orders them."""
        found = {}
        for k in range(1, self.model.nbody):
            m, c = self.model.body_mass[k], self.model.body_ipos[k]
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, self.model.body_iquat[k])
            R = rotation.reshape(3, 3)
            inertia = R @ np.diag(self.model.body_inertia[k]) @ R.T + m * (
                c @ c * np.eye(3) - np.outer(c, c)
            )
            found[self.model.body(k).name] = np.array(
                [m, *(m * c), *inertia[np.triu_indices(3)]]
            )
        return found


def servo_arm(urdf: Path, rng: np.random.Generator, spread: float = 0.3) -> ServoArm:
    """The arm of a file with masses, inertias, friction and gains that differ from the file's."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    for joint in spec.joints:
        servo = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_position(kp=1.0)
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
    model = spec.compile()
    model.opt.timestep = STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    factor = rng.uniform(1 - spread, 1 + spread, model.nbody)
    model.body_mass *= factor
    model.body_inertia *= factor[:, None]
    model.dof_armature[:] = rng.uniform(0.02, 0.035, model.nv)
    model.dof_damping[:] = rng.uniform(0.4, 0.8, model.nv)
    model.dof_frictionloss[:] = rng.uniform(0.03, 0.07, model.nv)
    model.dof_solref[:], model.dof_solimp[:, :2] = (
        (2 * STEP, 1.0),
        0.9999,
    )  # dry friction, not a stiff damper
    model.opt.disableflags |= (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    mujoco.mj_setConst(model, mujoco.MjData(model))
    gains = rng.uniform(12.0, 22.0, model.nv)
    model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1] = gains, -gains
    return ServoArm(model, gains)


def commands(
    arm: ServoArm, seconds: float, rng: np.random.Generator, size: float = 0.6
) -> np.ndarray:
    """Positions to go to, 30 times a second: sums of sines within some of the joints' range, shape (N, n)."""
    time = np.arange(round(seconds * RATE)) / RATE
    n = arm.model.nv
    found = np.zeros((len(time), n))
    for _ in range(4):
        frequency, phase = rng.uniform(0.1, 1.6, n), rng.uniform(0, 2 * np.pi, n)
        found += (
            rng.uniform(0.3, 1.0, n)
            * size
            / 2
            * np.sin(2 * np.pi * frequency * time[:, None] + phase)
        )
    return found


def simulated(
    arm: ServoArm,
    commanded: np.ndarray,
    delay: float = 0.0,
    *,
    torque: Any = np.inf,
    dead: Any = 0.0,
    speed: Any = np.inf,
) -> np.ndarray:
    """Positions 30 times a second, as encoders of 4096 steps count them, shape (N, n).

    Servos pull no more than at an error of ``torque``, not within ``dead`` of their commands, and follow them at a
    speed of ``speed`` at most.
    """
    force = arm.gains * np.broadcast_to(torque, arm.gains.shape)
    arm.model.actuator_forcelimited[:] = np.isfinite(force)
    arm.model.actuator_forcerange[:] = np.where(np.isfinite(force), force, 0.0)[
        :, None
    ] * [-1.0, 1.0]
    held, late, still = round(1 / (RATE * STEP)), round(delay / STEP), not np.any(dead)
    goals = commanded[np.maximum(np.arange(len(commanded) * held) - late, 0) // held]
    if np.isfinite(speed).any():
        goal = commanded[0].copy()
        for k, asked in enumerate(goals):
            goals[k] = goal = goal + np.clip(asked - goal, -speed * STEP, speed * STEP)
    data, found = mujoco.MjData(arm.model), []
    data.qpos[:] = commanded[0]
    for k, goal in enumerate(goals):
        if k % held == 0:
            found.append(data.qpos.copy())
        data.ctrl[:] = goal if still else goal - np.clip(goal - data.qpos, -dead, dead)
        mujoco.mj_step(arm.model, data)
    return np.round(np.array(found) / ENCODER) * ENCODER


def written(folder: Path, names: Sequence[str], q: np.ndarray, u: np.ndarray) -> Path:
    """A LeRobot dataset of one episode, with the columns that ``examples/logs/so101.yaml`` states."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    vector = {
        "dtype": "float64",
        "shape": [len(names)],
        "names": [f"{name}.pos" for name in names],
    }
    features = {"observation.state": vector, "action": vector}
    (folder / "dataset" / "meta").mkdir(parents=True)
    (folder / "dataset" / "data" / "chunk-000").mkdir(parents=True)
    (folder / "dataset" / "meta" / "info.json").write_text(
        json.dumps({"fps": RATE, "features": features})
    )
    table = {
        "observation.state": np.rad2deg(q).tolist(),
        "action": np.rad2deg(u[: len(q)]).tolist(),
        "timestamp": np.arange(len(q)) / RATE,
        "episode_index": np.zeros(len(q), dtype=int),
    }
    pq.write_table(
        pa.table(table), folder / "dataset" / "data" / "chunk-000" / "file-000.parquet"
    )
    return folder / "dataset"


def true_standard(arm: ServoArm, mechanism: Any) -> np.ndarray:
    """Standard parameters of the arm in Echelon's order."""
    inertia = arm.inertia()
    own = {
        "Kp": arm.gains,
        "Fv": arm.model.dof_damping,
        "Fc": arm.model.dof_frictionloss,
        "Ia": arm.model.dof_armature,
    }
    links = [arm.model.body(k).name for k in range(1, arm.model.nbody)]
    order = {
        "XX": 4,
        "XY": 5,
        "XZ": 6,
        "YY": 7,
        "YZ": 8,
        "ZZ": 9,
        "MX": 1,
        "MY": 2,
        "MZ": 3,
        "M": 0,
    }
    found = []
    for column in mechanism.columns:
        number = int("".join(c for c in column.name if c.isdigit()))
        kind = column.name.removesuffix(str(number))
        found.append(
            own[kind][number - 1]
            if kind in own
            else inertia[links[number - 1]][order[kind]]
        )
    return np.array(found)
