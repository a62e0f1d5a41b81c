"""Five simulated robots: an arm, a floating one, one with loops, one with a sensor in its wrist, one with gears.

Each is measured in another way and logged in another format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np

from support.simulated_logs import CONSTANT
from support.simulated_models import FREE, Drive, Floats, Part
from support.simulated_motions import closure
from support.simulated_robots import SLOW, Measure, Motion, System

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
    for row, (first, count) in enumerate(
        zip(model.tendon_adr, model.tendon_num, strict=True)
    ):
        wrapped = slice(first, first + count)
        ratios[row, model.wrap_objid[wrapped]] = model.wrap_prm[wrapped]
    return np.linalg.solve(ratios.T, data.qfrc_inverse)


def crank_torques(independent: Sequence[int]) -> Measure:
    """Gᵀ Γ, with the forces Γ of the tree."""

    def measure(model: Any, data: Any) -> Floats:
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        forces, dependent = (
            np.array(data.qfrc_inverse),
            [k for k in range(model.nv) if k not in independent],
        )
        J = closure(model, data)[0]
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        G = -np.linalg.lstsq(J[:, dependent], J[:, list(independent)], rcond=None)[0]
        found: Floats = forces[list(independent)] + G.T @ forces[dependent]
        return found

    return measure


# -- the systems -------------------------------------------------------------------------------------------------------

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_FRICTION = [
    {"type": "viscous", "at": "all"},
    {"type": "coulomb", "at": "all"},
    {"type": "rotor_inertia", "at": "all"},
]


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
        {
            "effects": "none",
            "log": {"time": "time", "position": "{name}", "output": "force.{name}"},
        },
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
            "effects": [
                {"type": kind, "at": ["drive1", "drive2"]}
                for kind in ("viscous", "rotor_inertia")
            ],
            "log": {
                "time": {"column": "stamp", "unit": "ms"},
                "position": {
                    "drive1": "angle[0]",
                    "drive2": {"column": "angle[1]", "scale": "-1", "offset": "0.25"},
                },
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
            "effects": "none",
            "outputs": [
                {"joint": "all"},
                {
                    "wrench": "tool",
                    "name": "ft",
                    "frame": {"xyz": [0, 0, "0.02"], "rpy": [0, 0, "pi/4"]},
                },
            ],
            "log": {
                "time": "t",
                "position": "q{n}",
                "output": {
                    "all": "tau_{name}",
                    **{f"ft.{c}": f"wrench[{k}]" for k, c in enumerate(_COMPONENTS)},
                },
            },
        },
        "mat",
        forces_and_sensors,
        reading={"keep_fixed_links": True},
        inside={
            "tool": '<site name="ft" pos="0 0 0.02" euler="0 0 0.785398163397448279"/>'
        },
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
            "actuators": {
                "m1": "50*j1",
                "m2": "-60*j2",
                "m3": "40*j3",
                "m4": "30*j3 + 25*j4",
            },
            "effects": _FRICTION,
            "log": {
                "position": {
                    "actuators": {"column": "/motors/position/{name}", "unit": "deg"}
                },
                "output": {"actuators": {"column": "/motors/effort/{name}", **scaled}},
            },
            "preparation": {
                "still": {
                    "m1": 50 * SLOW,
                    "m2": 60 * SLOW,
                    "m3": 40 * SLOW,
                    "m4": 55 * SLOW,
                }
            },
        },
        "mcap",
        motor_torques,
        simulated=True,
    )


SYSTEMS: dict[str, System] = {
    system.name: system
    for system in (_arm(), _floats(), _five_bar(), _wrist(), _geared())
}


_LONG = SYSTEMS["arm"]
SHORT_ARM = replace(
    _LONG,
    name="short arm",
    parts=_LONG.parts[:3],
    drives={joint: _LONG.drives[joint] for joint in ("j1", "j2", "j3")},
    noise=_LONG.noise[:3],
    simulated=False,
)
"""The first three joints of the arm, which take a quarter of the time."""


def motion_of(system: System, seed: int = 11) -> Motion:
    """A motion of a system, simulated once."""
    known = {SHORT_ARM.name: SHORT_ARM, **SYSTEMS}
    if known.get(system.name) is system:
        return _motion(system.name, seed)
    return system.motion(seed)


@cache
def _motion(name: str, seed: int) -> Motion:
    return {SHORT_ARM.name: SHORT_ARM, **SYSTEMS}[name].motion(seed)
