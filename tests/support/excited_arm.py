"""An arm in MuJoCo that runs trajectories, other motions to compare with, and what their torques show.

The robot is not the one that trajectories are designed for: its bodies weigh something else, it has friction, and its
joints may cog and stick, which no model says.  Torques are MuJoCo's, so are the truths.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.base.model import BaseModel
from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.problem.task import task_of
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.excite.solve.design import Design, designed
from echelon.identification.result import Identification
from echelon.identification.setup.setup import Setup
from support.simulated_models import Drive, Part
from support.simulated_robots import GUESSED, TRUE, Motion, System
from support.simulated_systems import joint_forces

Floats = npt.NDArray[np.float64]

PERIOD, RATE, SEEDS = 6.0, 200.0, 200
NOISE = np.array([0.5, 0.5, 0.5, 0.1, 0.1, 0.05])
POSITION = np.array([2.0, 1.5, 2.0, 2.0, 2.0, 2.0])
VELOCITY = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
ACCELERATION = 15.0
EFFORT = np.array([80.0, 100.0, 50.0, 20.0, 15.0, 10.0])
JOINTS = tuple(f"j{k}" for k in range(1, 7))
ENCODER = 1e-6
"""Noise of the positions, rad."""
UNMODELLED = 0.3
"""Cogging and sticking as a share of the dry friction."""

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_FRICTION = [{"type": "viscous", "at": "all"}, {"type": "coulomb", "at": "all"}]


def _by_name(values: Floats) -> dict[str, float]:
    return dict(zip(JOINTS, values.tolist(), strict=True))


def _arm() -> System:
    position = {name: [-value, value] for name, value in _by_name(POSITION).items()}
    limits = {
        "velocity": _by_name(VELOCITY),
        "acceleration": ACCELERATION,
        "jerk": "none",
        "effort": _by_name(EFFORT),
    }
    return System(
        "excited arm",
        (
            Part("column", "", (0, 0, 0.3), "j1", _Z, 4.0, 0.3),
            Part("upper", "column", (0.05, 0.05, 0.1), "j2", _Y, 3.0, 0.4),
            Part("elbow", "upper", (0, 0, 0.4), "j3", _Y, 2.0, 0.3),
            Part("fore", "elbow", (0.15, 0, 0.05), "j4", _X, 1.2, 0.2),
            Part("wrist", "fore", (0.2, 0, 0), "j5", _Y, 0.8, 0.15),
            Part("hand", "wrist", (0.1, 0, 0), "j6", _X, 0.6, 0.12),
        ),
        {
            name: Drive(viscous, coulomb)
            for name, viscous, coulomb in zip(
                JOINTS,
                (1.5, 2.0, 1.0, 0.3, 0.2, 0.1),
                (1.2, 2.0, 0.8, 0.2, 0.15, 0.1),
                strict=True,
            )
        },
        tuple(NOISE.tolist()),
        "mjcf",
        {
            "effects": _FRICTION,
            "log": {"time": "time", "position": "q_{n}", "output": "tau_{n}"},
            "preparation": {"delays": dict.fromkeys(JOINTS, 0)},
            "identification": {"physical": False, "essential": "none"},
            "excitation": {
                "harmonics": 5,
                "duration": PERIOD,
                "rate": RATE,
                "noise": _by_name(NOISE),
                "limits": {"position": position, **limits},
            },
        },
        "csv",
        joint_forces,
    )


ARM = _arm()


@dataclass(frozen=True)
class Known:
    """The set-up, with guessed bodies, and the truth; its files go when the process ends."""

    setup: Setup
    base: BaseModel
    truth: Floats
    design: Design
    kept: object


@cache
def known() -> Known:
    kept = TemporaryDirectory()
    setup = ARM.load(Path(kept.name))
    with TemporaryDirectory() as folder:
        base, standard = ARM.truth(Path(folder))
    return Known(
        setup,
        base,
        base.values(standard),
        designed(task_of(setup, setup.excitation)),
        kept,
    )


@cache
def excited(seed: int = 1, starts: int = 1) -> ExcitingTrajectory:
    return ec.exciting_trajectory(known().setup, seed=seed, starts=starts)


# -- motions to compare with -------------------------------------------------------------------------------------------


def random_motion(seed: int) -> Trajectory:
    """Random motion of the design's family, from rest to rest, and as large as the limits allow."""
    design = known().design
    return design.trajectory(
        design.problem.scaled(design.problem.random(np.random.default_rng(seed)), 0.98)
    )


def sines(shift: int) -> Trajectory:
    """Motion as made by hand: each joint swings at a frequency of its own, as far as its limits allow."""
    basis = Fourier(PERIOD, len(JOINTS))
    coefficients = np.zeros((basis.size, len(JOINTS)))
    for j in range(len(JOINTS)):
        k = 1 + (j + shift) % len(JOINTS)
        rate = 2 * np.pi * k / PERIOD
        coefficients[2 * k, j] = 0.98 * min(
            POSITION[j], VELOCITY[j] / rate, ACCELERATION / rate**2
        )
    return Trajectory(JOINTS, ("rad",) * len(JOINTS), basis, coefficients)


def others() -> Iterator[tuple[str, Trajectory]]:
    yield from ((f"random {seed}", random_motion(seed)) for seed in range(6))
    yield from ((f"sines {shift}", sines(shift)) for shift in (0, 4, 5))


# -- what a motion shows, from regressors and from torques -------------------------------------------------------------


@dataclass(frozen=True)
class Rows:
    """Regressors and exact torques of a motion, in units of the noise."""

    W: Floats
    y: Floats

    @property
    def information(self) -> Floats:
        found: Floats = self.W.T @ self.W
        return found

    def estimates(self, seeds: int, first: int = 0) -> Floats:
        """Plain least squares with other noise each time, shape (seeds, r)."""
        rng = np.random.default_rng(first)
        Q, R = np.linalg.qr(self.W)
        seen = np.stack(
            [Q.T @ (self.y + rng.standard_normal(len(self.y))) for _ in range(seeds)],
            axis=1,
        )
        found: Floats = np.linalg.solve(R, seen).T
        return found

    def errors(self, estimates: Floats) -> Floats:
        """Root mean square of prediction errors, in units of the noise, for each estimate."""
        found: Floats = np.sqrt(
            np.mean((self.y[:, None] - self.W @ estimates.T) ** 2, axis=0)
        )
        return found


def rows(trajectory: Trajectory, periods: int = 1) -> Rows:
    """MuJoCo's torques along a motion that is followed exactly; dry friction at rest is nobody's to know, so ours."""
    t = np.arange(round(PERIOD * RATE) * periods) / RATE
    states = trajectory.states(t)
    smooth = replace(
        ARM,
        drives={
            name: replace(drive, coulomb=0.0) for name, drive in ARM.drives.items()
        },
    )
    dry = np.sign(states[1]) * [drive.coulomb for drive in ARM.drives.values()]
    y = ARM.inverse(smooth.mjcf(TRUE), *states) + dry
    W = known().base.regressor(*states) / NOISE[:, None]
    return Rows(W.reshape(-1, W.shape[2]), (y / NOISE).ravel())


def log_det(F: Floats) -> float:
    return float(np.linalg.slogdet(F)[1])


def scaled_condition(F: Floats) -> float:
    size = np.sqrt(np.diag(F))
    return float(np.sqrt(np.linalg.cond(F / np.outer(size, size))))


# -- a robot that runs a trajectory ------------------------------------------------------------------------------------


def followed(
    trajectory: Trajectory, periods: int = 1, unmodelled: float = 0.0
) -> Motion:
    """Forward dynamics under feed-forward of the guessed robot and feedback; torques are those of the motors."""
    model = mujoco.MjModel.from_xml_string(ARM.mjcf(TRUE))
    data = mujoco.MjData(model)
    step, seconds = model.opt.timestep, periods * PERIOD
    q, qd, qdd = trajectory.states(np.arange(2 * round(seconds / step) + 1) * step / 2)
    forward = ARM.inverse(ARM.mjcf(GUESSED), q, qd, qdd)
    dry = unmodelled * np.array([drive.coulomb for drive in ARM.drives.values()])

    def control(_: Any, state: Any) -> None:
        k = round(2 * state.time / step)
        state.ctrl[:] = forward[k] + EFFORT * (
            5 * (q[k] - state.qpos) + 0.3 * (qd[k] - state.qvel)
        )
        stick = np.exp(-((state.qvel / 0.1) ** 2)) * np.tanh(state.qvel / 0.005)
        state.qfrc_applied[:] = dry * (np.sin(20 * state.qpos) - stick)

    data.qpos[:], data.qvel[:] = q[0], qd[0]
    kept = []
    mujoco.set_mjcb_control(control)
    try:
        for k in range(round(seconds / step)):
            if k % round(1 / RATE / step) == 0:
                mujoco.mj_forward(model, data)
                kept.append(
                    (
                        data.time,
                        data.qpos.copy(),
                        data.qvel.copy(),
                        data.qacc.copy(),
                        data.ctrl.copy(),
                    )
                )
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return Motion(*(np.array(values) for values in zip(*kept, strict=True)))


def identified(
    folder: Path,
    motion: Motion,
    fresh: Motion | None = None,
    seed: int = 0,
    **settings: Any,
) -> Identification:
    """Identification from a noisy log without a held-out part; ``fresh`` is predicted, without noise."""
    setup = known().setup.with_settings(holdout=0.0, **settings)
    log = ARM.log(motion, folder / f"run{seed}", setup.mechanism, seed, ENCODER)
    unseen = (
        []
        if fresh is None
        else [ARM.log(fresh, folder / "fresh", setup.mechanism, None)]
    )
    return ec.identify(setup, [log], validate_on=unseen)
