"""An arm on a table and on a wall, with a load and without, whose torques Pinocchio computes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
JOINTS = 3
LOAD = (0.8, (0.05, -0.02, 0.1), (0.004, 0.006, 0.005))
"""Mass, kg, centre of mass, m, and principal moments about it, kg·m², in the frame of the last link."""

URDF = """<robot name="arm"><link name="base"/>
{}</robot>"""
LINK = """<joint name="j{k}" type="revolute"><parent link="{parent}"/><child link="l{k}"/>
<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="99" velocity="9"/></joint>
<link name="l{k}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
<inertia ixx="{a}" iyy="{b}" izz="{c}" ixy="0.001" ixz="-0.002" iyz="0.0015"/></inertial></link>
"""
GEOMETRY = (
    ("0 0 0.3", "0 0 0", "0.02 -0.05 0.1", 3.0, (0.04, 0.05, 0.03)),
    ("0 0 0.1", "1.5707963267948966 0 0", "0.15 0.02 0.03", 2.0, (0.02, 0.06, 0.05)),
    ("0.4 0 0", "0 1.5707963267948966 0", "-0.03 0.04 0.1", 1.0, (0.01, 0.02, 0.02)),
)


def urdf() -> str:
    """The arm, without its load."""
    links = [
        LINK.format(
            k=k, parent=f"l{k - 1}" if k > 1 else "base", xyz=xyz, rpy=rpy, com=com,
            mass=mass, a=spins[0], b=spins[1], c=spins[2],
        )
        for k, (xyz, rpy, com, mass, spins) in enumerate(GEOMETRY, start=1)
    ]  # fmt: skip
    return URDF.format("".join(links))


def load_values() -> Floats:
    """Standard parameters of the load about the origin of the last link's frame."""
    mass, centre, spins = LOAD
    r = np.array(centre)
    inertia = np.diag(spins) + mass * (r @ r * np.eye(3) - np.outer(r, r))
    places = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    return np.array([*(inertia[p] for p in places), *(mass * r), mass])


def log(
    gravity: Sequence[float],
    seed: int,
    *,
    loaded: bool = False,
    held: Mapping[int, float] | None = None,
    seconds: float = 20.0,
) -> dict[str, Floats]:
    """Columns of a log: t, q_1 …, tau_1 …; joints may be held, and then have no torque."""
    import pinocchio as pin

    model: Any = pin.buildModelFromXML(urdf())
    model.gravity.linear = np.array(gravity, dtype=float)
    if loaded:
        mass, centre, spins = LOAD
        load = pin.Inertia(mass, np.array(centre), np.diag(spins))
        model.inertias[JOINTS] = model.inertias[JOINTS] + load
    data, rng = model.createData(), np.random.default_rng(seed)
    time = np.arange(0, seconds, 0.005)
    signals = np.zeros((3, len(time), JOINTS))
    for joint in range(JOINTS):
        for k in range(1, 6):
            wave = 0.2 * np.pi * k
            phase, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.0) / k
            turn = wave * time + phase
            signals[:, :, joint] += size * np.stack(
                [np.sin(turn), wave * np.cos(turn), -(wave**2) * np.sin(turn)]
            )
    for joint, at in (held or {}).items():
        signals[:, :, joint] = np.array([at, 0.0, 0.0])[:, None]
    q, v, a = signals
    tau = np.array(
        [pin.rnea(model, data, *state) for state in zip(q, v, a, strict=True)]
    )
    noisy = tau + 0.05 * rng.normal(size=tau.shape)
    columns = {"t": time}
    for joint in range(JOINTS):
        columns[f"q_{joint + 1}"] = q[:, joint] + 1e-5 * rng.normal(size=len(time))
        columns[f"tau_{joint + 1}"] = noisy[:, joint]
    return columns


def write(columns: Mapping[str, Floats], path: Path) -> Path:
    """A CSV file of a log."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="")
    return path
