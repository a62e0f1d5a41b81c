"""Robots that MuJoCo simulates, with their measurement set-ups, logs and true parameters."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.base.model import BaseModel
from echelon.identify.settings import Setup
from echelon.identify.setup import load_setup
from echelon.logs.samples import Samples
from echelon.mechanism.mechanism import Mechanism
from simulated_logs import CONSTANT, write_log
from simulated_models import FREE, Drive, Floats, Part, described, mjcf, solids, urdf

TRUE, GUESSED = 1, 2
"""Seeds of the bodies that are simulated, and of those that a file states beforehand."""
PERIOD, RATE = 10.0, 400.0
"""Length and sampling of motions that are prescribed, s and Hz."""
SIMULATED, LOGGED = 4000.0, 200.0
"""Of those that are simulated: the reference at every half step of the integrator, and the log."""
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
        """One sample of so many."""
        return self.at(slice(None, None, step))

    def at(self, chosen: slice | npt.NDArray[np.int64]) -> Motion:
        """Some of the samples."""
        return Motion(*(values[chosen] for values in (self.time, self.q, self.qd, self.qdd, self.y)))


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
        drives = self.drives if seed == TRUE else {n: Drive(ratios=d.ratios) for n, d in self.drives.items()}
        return mjcf(self.parts, solids(self.parts, seed), drives, inside=self.inside, tail=self.tail)

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

    def log(self, motion: Motion, path: Path, mechanism: Mechanism, seed: int | None = 0, positions: float = 0.0) -> Path:
        """A log of a motion with noise (none without a seed)."""
        rng = np.random.default_rng(seed)
        y = motion.y if seed is None else motion.y + np.array(self.noise) * rng.standard_normal(motion.y.shape)
        q = motion.q if seed is None else motion.q + positions * rng.standard_normal(motion.q.shape)
        file, motors = path.with_suffix(f".{self.format}"), q[:, -self.rates.shape[1] :] @ self.rates.T
        return write_log(file, motion.time, self._measured(q), y, mechanism, motors)

    # -- truth -----------------------------------------------------------------------------------------------------

    def truth(self, folder: Path) -> tuple[BaseModel, Floats]:
        """The base model, and the true standard parameters."""
        mechanism = self.load(folder, TRUE).mechanism
        values = [0.0 if value is None else value for value in mechanism.standard_values()]
        places = {effect.parameter: effect.actions[0].at for effect in mechanism.effects}
        for k, column in enumerate(mechanism.columns):
            if column.body is None:
                values[k] = self.drives[places[mechanism.parameters[k]]].value(mechanism.parameters[k])
        return ec.base_parameters(mechanism), np.array(values)

    def samples(self, motion: Motion) -> Samples:
        """The exact motion as prepared samples, without those that are too slow to tell dry friction."""
        states = (self._measured(values) for values in (motion.q, motion.qd, motion.qdd))
        moving = None
        if any(drive.coulomb for drive in self.drives.values()):
            moving = np.abs(motion.qd @ self.rates.T) > SLOW * np.abs(self.rates).sum(axis=1)
        return Samples(self.name, 0.0, 1 / (motion.time[1] - motion.time[0]), *states, motion.y, moving=moving)

    @property
    def rates(self) -> Floats:
        """How fast drives turn per joint velocity, shape (drives, joints)."""
        joints = [part.joint for part in self.parts if part.joint]
        return np.array([[d.ratios.get(j, float(j == n)) for j in joints] for n, d in self.drives.items()]).reshape(
            len(self.drives), len(joints)
        )

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
            return _closed(mujoco.MjModel.from_xml_string(self.mjcf()), list(self.independent), rng)
        if any(part.joint == FREE for part in self.parts):
            return _floating(len(joints), rng)
        return fourier(rng, len(joints), 0.9, rate=SIMULATED if self.simulated else RATE)

    def _forward(self, q: Floats, qd: Floats, qdd: Floats) -> Motion:
        """A controller with feed-forward follows the reference; what is kept are the states that it reached."""
        model = mujoco.MjModel.from_xml_string(self.mjcf())
        data = mujoco.MjData(model)
        wanted, drives = self.inverse(self.mjcf(), q, qd, qdd), np.linalg.inv(self.rates.T)

        def control(_: Any, state: Any) -> None:
            k = min(round(state.time * SIMULATED), len(q) - 1)
            state.ctrl[:] = wanted[k] + drives @ (20 * (q[k] - state.qpos) + 2 * (qd[k] - state.qvel))

        data.qpos[:], data.qvel[:] = q[0], qd[0]
        kept = []
        # also between the steps, at the stages of the integrator, so that torques do not come in stairs
        mujoco.set_mjcb_control(control)
        try:
            for step in range(len(q) // 2):
                if step % round(1 / LOGGED / model.opt.timestep) == 0:
                    mujoco.mj_forward(model, data)
                    kept.append((data.time, data.qpos.copy(), data.qvel.copy(), data.qacc.copy(), data.ctrl.copy()))
                mujoco.mj_step(model, data)
        finally:
            mujoco.set_mjcb_control(None)
        return Motion(*(np.array(values) for values in zip(*kept, strict=True)))


# -- motions -----------------------------------------------------------------------------------------------------------


def fourier(
    rng: np.random.Generator, count: int, size: float, *, centre: float = 0.3, rate: float = RATE, harmonics: int = 8
) -> tuple[Floats, Floats, Floats]:
    """Random periodic curves with their derivatives."""
    t = np.arange(round(PERIOD * rate)) / rate
    q, qd, qdd = (np.zeros((len(t), count)) for _ in range(3))
    for k in range(1, harmonics + 1):
        w = 2 * np.pi * k / PERIOD
        a, b = size * rng.normal(size=(2, count)) / np.sqrt(harmonics) / k**0.5
        sine, cosine = np.sin(w * t)[:, None], np.cos(w * t)[:, None]
        q += a * sine + b * cosine
        qd += w * (a * cosine - b * sine)
        qdd -= w * w * (a * sine + b * cosine)
    return q + rng.uniform(-centre, centre, count), qd, qdd


def derivative(values: Floats, order: int = 1) -> Floats:
    """Derivative of periodic curves, exact to rounding where they are smooth."""
    w = 2 * np.pi * np.fft.rfftfreq(len(values), 1 / RATE)
    found: Floats = np.fft.irfft((1j * w[:, None]) ** order * np.fft.rfft(values, axis=0), len(values), axis=0)
    return found


def _floating(joints: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    place, turn, arms = (fourier(rng, count, size) for count, size in ((3, 0.5), (3, 0.8), (joints, 0.9)))
    quaternions = np.zeros((len(turn[0]), 4))
    for quaternion, vector in zip(quaternions, turn[0], strict=True):
        mujoco.mju_axisAngle2Quat(quaternion, vector / np.linalg.norm(vector), np.linalg.norm(vector))
    speed, change = (2 * _product(quaternions, derivative(quaternions, order)) for order in (1, 2))
    return (
        np.hstack([place[0], quaternions, arms[0]]),
        np.hstack([place[1], speed, arms[1]]),
        np.hstack([place[2], change, arms[2]]),
    )


def _product(first: Floats, second: Floats) -> Floats:
    """Vector parts of conjugate quaternions times others."""
    w, v, s, u = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    found: Floats = w * u - s * v - np.cross(v, u)
    return found


def _closed(model: Any, independent: list[int], rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """All coordinates by Newton's iteration on MuJoCo's own residuals, from those that are chosen."""
    chosen = fourier(rng, len(independent), 0.35, centre=0.1)[0]
    dependent = [k for k in range(model.nq) if k not in independent]
    data = mujoco.MjData(model)
    full = []
    for data.qpos[independent] in chosen:
        J, residual = closure(model, data)
        for _ in range(20):
            data.qpos[dependent] -= np.linalg.lstsq(J[:, dependent], residual, rcond=None)[0]
            J, residual = closure(model, data)
            if np.abs(residual).max() < 1e-14:
                break
        full.append(data.qpos.copy())
    q = np.array(full)
    return q, derivative(q), derivative(q, 2)


def closure(model: Any, data: Any) -> tuple[Floats, Floats]:
    """Jacobian and residual of the constraints that close loops."""
    mujoco.mj_fwdPosition(model, data)
    rows = np.flatnonzero(data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    return data.efc_J.reshape(-1, model.nv)[rows], data.efc_pos[rows].copy()


# -- what is measured --------------------------------------------------------------------------------------------------


def joint_forces(_: Any, data: Any) -> Floats:
    """Forces of all joints."""
    return np.array(data.qfrc_inverse)


def forces_and_sensors(model: Any, data: Any) -> Floats:
    """Forces of all joints, then force and torque sensors."""
    mujoco.mj_rnePostConstraint(model, data)
    mujoco.mj_sensorAcc(model, data)
    return np.concatenate([data.qfrc_inverse, data.sensordata])


def motor_torques(model: Any, data: Any) -> Floats:
    """Torques of drives that are tendons, τ_q = Tᵀ τ_θ."""
    ratios = np.zeros((model.ntendon, model.nv))
    for row, (first, count) in enumerate(zip(model.tendon_adr, model.tendon_num, strict=True)):
        wrapped = slice(first, first + count)
        ratios[row, model.wrap_objid[wrapped]] = model.wrap_prm[wrapped]
    return np.linalg.solve(ratios.T, data.qfrc_inverse)


def crank_torques(independent: Sequence[int]) -> Measure:
    """Gᵀ Γ, with the forces Γ of the tree."""

    def measure(model: Any, data: Any) -> Floats:
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        forces, dependent = np.array(data.qfrc_inverse), [k for k in range(model.nv) if k not in independent]
        J = closure(model, data)[0]
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        G = -np.linalg.lstsq(J[:, dependent], J[:, list(independent)], rcond=None)[0]
        found: Floats = forces[list(independent)] + G.T @ forces[dependent]
        return found

    return measure


# -- the systems -------------------------------------------------------------------------------------------------------

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_FRICTION = [{"type": "viscous", "at": "all"}, {"type": "coulomb", "at": "all"}, {"type": "rotor_inertia", "at": "all"}]


def _arm() -> System:
    return System(
        "arm",
        (
            Part("base_link", "", (0, 0, 0.2), "j1", _Z, 4.0, 0.3),
            Part("upper", "base_link", (0.05, 0, 0.15), "j2", _Y, 3.0, 0.4),
            Part("elbow", "upper", (0, 0, 0.4), "j3", _Y, 2.0, 0.3),
            Part("fore", "elbow", (0.3, 0, 0.05), "j4", _X, 1.2, 0.2),
            Part("hand", "fore", (0.1, 0, 0), "j5", _Y, 0.8, 0.15),
        ),
        {
            "j1": Drive(1.5, 1.2, 0.3),
            "j2": Drive(2.0, 2.0, 0.4),
            "j3": Drive(1.0, 0.8, 0.2),
            "j4": Drive(0.3, 0.2, 0.05),
            "j5": Drive(0.1, 0.1, 0.02),
        },
        (0.5, 0.8, 0.4, 0.05, 0.03),
        "description",
        {
            "effects": _FRICTION,
            "log": {"time": "time", "position": "q_{n}", "output": "tau_{n}"},
            "preparation": {"still": SLOW},
        },
        "csv",
        joint_forces,
        simulated=True,
    )


def _floats() -> System:
    return System(
        "floating",
        (
            Part("trunk", "", (0, 0, 0), FREE, None, 8.0, 0.4),
            Part("left_arm", "trunk", (0.1, 0.2, 0.1), "left1", _Y, 2.0, 0.3),
            Part("left_hand", "left_arm", (0, 0.05, 0.3), "left2", _X, 1.0, 0.2),
            Part("right_arm", "trunk", (0.1, -0.2, 0.1), "right1", _X, 2.0, 0.3),
            Part("right_hand", "right_arm", (0.3, 0, 0), "right2", _Z, 1.0, 0.2),
        ),
        {},
        (1.0, 1.2, 0.8, 0.2, 0.3, 0.25, 0.1, 0.05, 0.12, 0.02),
        "urdf",
        {"log": {"time": "time", "position": "{name}", "output": "force.{name}"}},
        "parquet",
        joint_forces,
        reading={"floating": True},
    )


def _five_bar() -> System:
    return System(
        "five-bar",
        (
            Part("crank1", "", (0, 0, 0), "drive1", _Y, 1.5, 0.25),
            Part("rod1", "crank1", (0, 0, 0.25), "passive1", _Y, 0.8, 0.35),
            Part("crank2", "", (0.3, 0, 0), "drive2", _Y, 1.5, 0.25),
            Part("rod2", "crank2", (0, 0, 0.25), "passive2", _Y, 0.8, 0.35),
        ),
        {"drive1": Drive(0.5, rotor=0.02), "drive2": Drive(0.4, rotor=0.03)},
        (0.05, 0.12),
        "mjcf",
        {
            "effects": [{"type": kind, "at": ["drive1", "drive2"]} for kind in ("viscous", "rotor_inertia")],
            "log": {
                "time": {"column": "stamp", "unit": "ms"},
                "position": {"drive1": "angle[0]", "drive2": {"column": "angle[1]", "scale": "-1", "offset": "0.25"}},
                "output": {"drive1": "torque[0]", "drive2": "torque[1]"},
            },
        },
        "npz",
        crank_torques((0, 2)),
        independent=(0, 2),
        tail='<equality><connect name="tip" body1="rod1" body2="rod2" anchor="0.15 0 0.3"/></equality>',
    )


def _wrist() -> System:
    return System(
        "wrist sensor",
        (
            Part("shoulder", "", (0, 0, 0.3), "j1", _Z, 3.0, 0.3),
            Part("upper", "shoulder", (0, 0.1, 0), "j2", _X, 2.0, 0.35),
            Part("fore", "upper", (0, 0, 0.35), "j3", _X, 1.5, 0.3),
            Part("flange", "fore", (0, 0, 0.3), "j4", _Y, 0.6, 0.1),
            Part("tool", "flange", (0, 0, 0.05), mass=0.7, size=0.15),
        ),
        {},
        (0.2, 0.3, 0.1, 0.04, 0.3, 0.3, 0.5, 0.01, 0.01, 0.008),
        "mjcf",
        {
            "outputs": [
                {"joint": "all"},
                {"wrench": "tool", "name": "ft", "frame": {"xyz": [0, 0, "0.02"], "rpy": [0, 0, "pi/4"]}},
            ],
            "log": {
                "time": "t",
                "position": "q{n}",
                "output": {"all": "tau_{name}", **{f"ft.{c}": f"wrench[{k}]" for k, c in enumerate(_COMPONENTS)}},
            },
        },
        "mat",
        forces_and_sensors,
        reading={"every_link": True},
        inside={"tool": '<site name="ft" pos="0 0 0.02" euler="0 0 0.785398163397448279"/>'},
        tail='<sensor><force site="ft"/><torque site="ft"/></sensor>',
    )


_COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")

def _geared() -> System:
    scaled = {"scale": str(CONSTANT)}  # currents, A
    return System(
        "motor side",
        (
            Part("column", "", (0, 0, 0.3), "j1", _Z, 3.0, 0.3),
            Part("upper", "column", (0.1, 0, 0.1), "j2", _Y, 2.5, 0.4),
            Part("fore", "upper", (0.35, 0, 0), "j3", _X, 1.2, 0.25),
            Part("hand", "fore", (0.2, 0, 0), "j4", _Y, 0.8, 0.2),
        ),
        {
            "m1": Drive(6e-4, 0.02, 1e-4, {"j1": 50}),
            "m2": Drive(8e-4, 0.03, 2e-4, {"j2": -60}),
            "m3": Drive(2e-4, 0.008, 2e-5, {"j3": 40}),
            "m4": Drive(2e-4, 0.006, 2e-5, {"j3": 30, "j4": 25}),
        },
        (0.01, 0.015, 0.003, 0.002),
        "mjcf",
        {
            "actuators": {"m1": "50*j1", "m2": "-60*j2", "m3": "40*j3", "m4": "30*j3 + 25*j4"},
            "effects": _FRICTION,
            "log": {
                "position": {"actuators": {"column": "/motors/position/{name}", "unit": "deg"}},
                "output": {"actuators": {"column": "/motors/effort/{name}", **scaled}},
            },
            "preparation": {"still": {"m1": 50 * SLOW, "m2": 60 * SLOW, "m3": 40 * SLOW, "m4": 55 * SLOW}},
        },
        "mcap",
        motor_torques,
        simulated=True,
    )


SYSTEMS: dict[str, System] = {system.name: system for system in (_arm(), _floats(), _five_bar(), _wrist(), _geared())}


def motion_of(system: System, seed: int = 11) -> Motion:
    """A motion of a system, simulated once."""
    return _motion(system.name, seed) if SYSTEMS.get(system.name) is system else system.motion(seed)


@cache
def _motion(name: str, seed: int) -> Motion:
    return SYSTEMS[name].motion(seed)
