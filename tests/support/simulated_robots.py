"""Robots that MuJoCo simulates: their set-ups, logs and true parameters; see ``simulated_systems``."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identification.logs.recording import Samples
from echelon.identification.setup.setup import Setup, load_setup
from echelon.robot.mechanism import Mechanism
from support.simulated_logs import write_log
from support.simulated_models import (
    FREE,
    Drive,
    Floats,
    Part,
    described,
    mjcf,
    solids,
    urdf,
)
from support.simulated_motions import LOGGED, RATE, SIMULATED, closed, floating, fourier

TRUE, GUESSED = 1, 2
"""Seeds of the bodies that are simulated, and of those that a file states beforehand."""
SLOW = 0.06
"""Speed below which dry friction is not told apart, rad/s of the joint."""

Measure = Callable[[Any, Any], Floats]


@dataclass(frozen=True)
class Motion:
    """States of all joints, and the outputs that they need, exactly."""

    time: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    y: Floats

    def every(self, step: int) -> Motion:
        """Motion with every ``step``-th sample."""
        return self.at(slice(None, None, step))

    def at(self, chosen: slice | npt.NDArray[np.int64]) -> Motion:
        """Some of the samples."""
        return Motion(
            *(
                values[chosen]
                for values in (self.time, self.q, self.qd, self.qdd, self.y)
            )
        )


@dataclass(frozen=True)
class System:
    """A robot, how it is simulated, and how it is measured.

    Attributes
    ----------
    name : str
    parts, drives : tables
    noise : tuple of float
        Standard deviation of each output's noise, SI units.
    robot : str
        What identification starts from: "description", "urdf" or "mjcf".
    setup : mapping
        What the set-up file says besides the robot.
    format : str
        Ending of the logs.
    reading : mapping
        Arguments of ``load``.
    measure : callable
        From MuJoCo's model and data after inverse dynamics to the outputs.
    independent : tuple of int
        Columns of MuJoCo's coordinates that are measured; all if empty.
    simulated : bool
        Whether motions come from integrating forward dynamics under a controller.
    inside, tail : MJCF
    """

    name: str
    parts: tuple[Part, ...]
    drives: Mapping[str, Drive]
    noise: tuple[float, ...]
    robot: str
    setup: Mapping[str, Any]
    format: str
    measure: Measure
    reading: Mapping[str, Any] = field(default_factory=dict)
    independent: tuple[int, ...] = ()
    simulated: bool = False
    inside: Mapping[str, str] = field(default_factory=dict)
    tail: str = ""

    # -- files -----------------------------------------------------------------------------------------------------

    def mjcf(self, seed: int = TRUE) -> str:
        """The model as MuJoCo simulates it, or with guessed bodies and no friction."""
        drives = (
            self.drives
            if seed == TRUE
            else {n: Drive(ratios=d.ratios) for n, d in self.drives.items()}
        )
        return mjcf(
            self.parts,
            solids(self.parts, seed),
            drives,
            inside=self.inside,
            tail=self.tail,
        )

    def write_setup(self, folder: Path, seed: int = GUESSED, **changes: Any) -> Path:
        """The set-up file, and the robot file that it refers to; returns its path."""
        bodies = solids(self.parts, seed)
        content: dict[str, Any] = {"echelon": 1, "name": self.name.replace(" ", "_")}
        if self.robot == "description":
            stated = described(self.parts, bodies if seed == TRUE else None)
            content |= {"gravity": [0, 0, "-9.81"], "bodies": stated}
        else:
            file = "robot.urdf" if self.robot == "urdf" else "robot.xml"
            text = urdf(self.parts, bodies) if self.robot == "urdf" else self.mjcf(seed)
            (folder / file).write_text(text)
            content["robot"] = {"file": file}
        path = folder / "setup.yaml"
        path.write_text(json.dumps({**content, **self.setup, **changes}, default=str))
        return path

    def load(self, folder: Path, seed: int = GUESSED, **changes: Any) -> Setup:
        """The set-up as identification reads it."""
        return load_setup(self.write_setup(folder, seed, **changes), **self.reading)

    def log(
        self,
        motion: Motion,
        path: Path,
        mechanism: Mechanism,
        seed: int | None = 0,
        positions: float = 0.0,
    ) -> Path:
        """A log of a motion with noise (none without a seed)."""
        rng = np.random.default_rng(seed)
        y = (
            motion.y
            if seed is None
            else motion.y + np.array(self.noise) * rng.standard_normal(motion.y.shape)
        )
        q = (
            motion.q
            if seed is None
            else motion.q + positions * rng.standard_normal(motion.q.shape)
        )
        file, motors = (
            path.with_suffix(f".{self.format}"),
            q[:, -self.rates.shape[1] :] @ self.rates.T,
        )
        return write_log(file, motion.time, self._measured(q), y, mechanism, motors)

    # -- truth -----------------------------------------------------------------------------------------------------

    def truth(self, folder: Path) -> tuple[BaseModel, Floats]:
        """The base model, and the true standard parameters."""
        mechanism = self.load(folder, TRUE).mechanism
        values = [
            0.0 if value is None else value for value in mechanism.standard_values()
        ]
        places = {
            effect.parameter: effect.actions[0].at for effect in mechanism.effects
        }
        for k, column in enumerate(mechanism.columns):
            if column.body is None:
                values[k] = self.drives[places[mechanism.parameters[k]]].value(
                    mechanism.parameters[k]
                )
        return ec.base_parameters(mechanism), np.array(values)

    def samples(self, motion: Motion) -> Samples:
        """The exact motion as prepared samples, without those that are too slow to tell dry friction."""
        states = (
            self._measured(values) for values in (motion.q, motion.qd, motion.qdd)
        )
        moving = None
        if any(drive.coulomb for drive in self.drives.values()):
            moving = np.abs(motion.qd @ self.rates.T) > SLOW * np.abs(self.rates).sum(
                axis=1
            )
        return Samples(
            self.name,
            0.0,
            1 / (motion.time[1] - motion.time[0]),
            *states,
            motion.y,
            moving=moving,
        )

    @property
    def rates(self) -> Floats:
        """How fast drives turn per joint velocity, shape (drives, joints)."""
        joints = [part.joint for part in self.parts if part.joint]
        return np.array(
            [
                [d.ratios.get(j, float(j == n)) for j in joints]
                for n, d in self.drives.items()
            ]
        ).reshape(len(self.drives), len(joints))

    def _measured(self, values: Floats) -> Floats:
        return values[:, list(self.independent)] if self.independent else values

    # -- simulation ------------------------------------------------------------------------------------------------

    def motion(self, seed: int) -> Motion:
        """A random smooth motion and the outputs that it needs."""
        q, qd, qdd = self._reference(seed)
        if self.simulated:
            return self._forward(q, qd, qdd)
        time = np.arange(len(q)) / RATE
        return Motion(time, q, qd, qdd, self.inverse(self.mjcf(), q, qd, qdd))

    def inverse(self, text: str, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The outputs by MuJoCo's inverse dynamics of a model, without the forces that close loops."""
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
        data = mujoco.MjData(model)
        found = []
        for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, qd, qdd, strict=True):
            mujoco.mj_inverse(model, data)
            found.append(self.measure(model, data))
        return np.array(found)

    def _reference(self, seed: int) -> tuple[Floats, Floats, Floats]:
        rng = np.random.default_rng(seed)
        joints = [part for part in self.parts if part.axis is not None]
        if self.independent:
            return closed(
                mujoco.MjModel.from_xml_string(self.mjcf()), list(self.independent), rng
            )
        if any(part.joint == FREE for part in self.parts):
            return floating(len(joints), rng)
        return fourier(
            rng, len(joints), 0.9, rate=SIMULATED if self.simulated else RATE
        )

    def _forward(self, q: Floats, qd: Floats, qdd: Floats) -> Motion:
        """A controller with feed-forward follows the reference; what is kept are the states that it reached."""
        model = mujoco.MjModel.from_xml_string(self.mjcf())
        data = mujoco.MjData(model)
        wanted, drives = (
            self.inverse(self.mjcf(), q, qd, qdd),
            np.linalg.inv(self.rates.T),
        )

        def control(_: Any, state: Any) -> None:
            k = min(round(state.time * SIMULATED), len(q) - 1)
            state.ctrl[:] = wanted[k] + drives @ (
                20 * (q[k] - state.qpos) + 2 * (qd[k] - state.qvel)
            )

        data.qpos[:], data.qvel[:] = q[0], qd[0]
        kept = []
        # also between the steps, at the stages of the integrator, so that torques do not come in stairs
        mujoco.set_mjcb_control(control)
        try:
            for step in range(len(q) // 2):
                if step % round(1 / LOGGED / model.opt.timestep) == 0:
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
