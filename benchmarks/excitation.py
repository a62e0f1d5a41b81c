"""Exciting trajectories: time and conditioning for robots of several kinds, one start per seed.

python benchmarks/excitation.py               all robots, and write benchmarks/results/excitation.md
python benchmarks/excitation.py ur10 panda    only these, and print

Condition numbers are of the observation matrix of 100 samples per second.  For the UR10 also of the columns that a QR
decomposition keeps of Pinocchio's regressor, which is how FIGAROH chooses its base parameters.
"""

from __future__ import annotations

import platform
import sys
import sysconfig
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import echelon as ec
from echelon.excite.design import designed
from echelon.excite.task import changed, task_of
from echelon.machine.kernel import processors
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
OUTPUT = ROOT / "benchmarks" / "results" / "excitation.md"
FREE = {"acceleration": "none", "jerk": "none"}
PANDA = {
    "position": [2.8973, 1.7628, 2.8973, (-3.0718, -0.0698), 2.8973, (-0.0175, 3.7525), 2.8973],
    "velocity": [2.175] * 4 + [2.61] * 3,
}
"""Limits of the manufacturer's data sheet."""


def urdf(path: str, **reading: Any) -> ec.Setup:
    """A robot of the example-robot-data package, without friction."""
    mechanism = ec.load(ROBOTS / path, **reading)
    return ec.Setup(path, mechanism, robot_file=str(ROBOTS / path))


def talos() -> ec.Setup:
    """The humanoid, standing."""
    return urdf("talos_data/robots/talos_full_v2.urdf")


def upper(setup: ec.Setup) -> list[str]:
    """Joints of torso, head and arms."""
    return [name for name in setup.mechanism.velocities if name.startswith(("torso", "head", "arm"))]


def panda_limits() -> dict[str, Any]:
    """By joint."""
    spans = [p if isinstance(p, tuple) else (-p, p) for p in PANDA["position"]]
    positions = {f"j{k}": span for k, span in enumerate(spans, 1)}
    return {"position": positions, "velocity": {f"j{k}": v for k, v in enumerate(PANDA["velocity"], 1)}, **FREE}


@dataclass(frozen=True)
class Case:
    """A robot with limits."""

    name: str
    setup: Callable[[], ec.Setup]
    changes: dict[str, Any]
    seeds: int = 3
    move: Callable[[ec.Setup], list[str]] | None = None
    peer: Callable[[Any], float] | None = field(default=None)


def kept_columns(found: Any) -> float:
    """Condition number of the UR10's columns that QR keeps of Pinocchio's regressor, from left to right."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(ROBOTS / "ur_description/urdf/ur10_robot.urdf"))
    data = model.createData()

    def observed(q: Any, qd: Any, qdd: Any) -> Any:
        return np.vstack([pin.computeJointTorqueRegressor(model, data, *x) for x in zip(q, qd, qdd, strict=True)])

    rng = np.random.default_rng(0)
    diagonal = np.abs(np.diag(np.linalg.qr(observed(*(rng.uniform(-2, 2, (300, 6)) for _ in range(3))))[1]))
    columns = np.flatnonzero(diagonal > 1e-8 * diagonal.max())
    return float(np.linalg.cond(observed(*found.trajectory.states(np.arange(800) / 100))[:, columns]))


CASES = {
    "ur10": Case(
        "UR10, q within ±2.5, speeds of its URDF, condition number",
        lambda: urdf("ur_description/urdf/ur10_robot.urdf"),
        {"criterion": "condition", "limits": {"position": [-2.5, 2.5], **FREE}},
        10,
        peer=kept_columns,
    ),
    "panda": Case(
        "Panda, limits of the data sheet, condition number",
        lambda: ec.load_setup(ROOT / "examples" / "panda.yaml"),
        {"criterion": "condition", "limits": panda_limits()},
        5,
    ),
    "tx40": Case(
        "TX40, coupled wrist, friction, rotors; 2 rad, 3 rad/s, D-optimal",
        lambda: ec.load_setup(ROOT / "examples" / "tx40.yaml"),
        {"limits": {"position": [-2, 2], "velocity": 3}},
    ),
    "table": Case(
        "UR10 on a table beside a wall, D-optimal",
        lambda: ec.load_setup(ROOT / "examples" / "excite" / "ur10.yaml"),
        {},
    ),
    "leg": Case(
        "a leg of the quadruped A1, base held, D-optimal",
        lambda: urdf("a1_description/urdf/a1.urdf", floating=True),
        {},
        move=lambda _: ["FR_hip_joint", "FR_thigh_joint", "FR_calf_joint"],
    ),
    "talos": Case("upper body of the humanoid Talos, torques of its URDF, D-optimal", talos, {}, 1, move=upper),
}


def measured(case: Case) -> list[Any]:
    """A row of the table."""
    setup = case.setup()
    changes = {**case.changes, "starts": 1, **({} if case.move is None else {"move": case.move(setup)})}
    seconds, founds = [], []
    for seed in range(case.seeds):
        begun = perf_counter()
        founds.append(ec.exciting_trajectory(setup, seed=seed, **changes))
        seconds.append(perf_counter() - begun)
    first = founds[0]
    conditions = [found.shown.condition for found in founds]
    scaled = [found.shown.scaled_condition for found in founds]
    peers = [] if case.peer is None else [case.peer(found) for found in founds]
    done = sum(found.safe and found.starts[0].status == "converged" for found in founds)
    return [
        case.name,
        f"{len(first.trajectory.coordinates)} / {first.base.rank}",
        f"{done} of {case.seeds}",
        f"{np.median(seconds):.1f} … {max(seconds):.1f} s",
        f"{np.median(conditions):.3g} … {max(conditions):.3g}",
        f"{np.median(scaled):.3g} … {max(scaled):.3g}",
        f"{np.median(peers):.3g} … {max(peers):.3g}" if peers else None,
        f"{gradient_seconds(setup, changes) * 1e3:.2g} ms",
    ]


def gradient_seconds(setup: ec.Setup, changes: dict[str, Any]) -> float:
    """Median time of the criterion with its gradient, in one thread."""
    from threadpoolctl import threadpool_limits

    problem = designed(task_of(setup, changed(setup.excitation, changes, setup.source))).problem
    x, times = problem.start(np.random.default_rng(0)), []
    with threadpool_limits(1):
        for _ in range(60):
            begun = perf_counter()
            problem.value_and_gradient(x)[1]()
            times.append(perf_counter() - begun)
    return float(np.median(times[10:]))


HEAD = [
    *("robot", "coordinates / base parameters", "converged, safe", "time", "condition number", "with scaled columns"),
    *("QR's columns", "criterion with gradient"),
]


def page(rows: list[list[Any]]) -> str:
    """The results with what they were measured on."""
    names = ("numpy", "casadi", "mujoco", "pin")
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    return "\n\n".join(
        [
            "# Exciting trajectories",
            "Median … largest over seeds of one start each: from the set-up to margins that hold at every time.",
            table(HEAD, rows),
            f"Echelon {ec.__version__}, Python {platform.python_version()}, {versions}; {processors()} processors.",
            "",
        ]
    )


def main() -> None:
    """Measure what is asked for."""
    wanted = sys.argv[1:] or list(CASES)
    rows = []
    for name in wanted:
        rows.append(measured(CASES[name]))
        print(*rows[-1], sep=" | ", flush=True)
    if len(wanted) == len(CASES):
        OUTPUT.write_text(page(rows), encoding="utf-8")
        print(page(rows))


if __name__ == "__main__":
    main()
