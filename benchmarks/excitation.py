"""Exciting trajectories: time and conditioning for robots of several kinds, one start per seed.

python benchmarks/excitation.py                     everything, and write benchmarks/results/excitation.md
python benchmarks/excitation.py ur10 panda          only these, and print
python benchmarks/excitation.py figaroh             FIGAROH's own search for the UR10, beside ours, and print
python benchmarks/excitation.py --figaroh PYTHON    take FIGAROH from the environment of this interpreter

Condition numbers are of the observation matrix of 100 samples per second.  FIGAROH and its solver are installed on
first use, into an environment of their own in benchmarks/.build; a page without them says so.
"""

from __future__ import annotations

import argparse
import platform
import sysconfig
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import echelon as ec
from anchors.build import UnavailableError
from anchors.figaroh_search import Search, environment, searched, versions
from echelon.compute.machine.kernel import processors
from echelon.excite.problem.task import changed, task_of
from echelon.excite.solve.design import designed
from echelon.formats.robot_file import open_robot
from echelon.formats.snapping import ReadingOptions
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
ROBOTS = (
    Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
)
OUTPUT = ROOT / "benchmarks" / "results" / "excitation.md"
UR10 = "ur_description/urdf/ur10_robot.urdf"
REACH = 2.5
FIGAROH, SEARCHES = "figaroh", 1
FREE = {"acceleration": "none", "jerk": "none"}
PANDA = {
    "position": [
        2.8973,
        1.7628,
        2.8973,
        (-3.0718, -0.0698),
        2.8973,
        (-0.0175, 3.7525),
        2.8973,
    ],
    "velocity": [2.175] * 4 + [2.61] * 3,
}
"""Limits of the manufacturer's data sheet."""


def urdf(path: str, **reading: Any) -> ec.Setup:
    """A robot of the example-robot-data package, without friction."""
    file = open_robot(ROBOTS / path)
    return ec.Setup(path, file.mechanism(ReadingOptions(**reading)), robot_file=file)


def talos() -> ec.Setup:
    """The humanoid, standing."""
    return urdf("talos_data/robots/talos_full_v2.urdf")


def upper(setup: ec.Setup) -> list[str]:
    """Joints of torso, head and arms."""
    return [
        name
        for name in setup.mechanism.velocities
        if name.startswith(("torso", "head", "arm"))
    ]


def panda_limits() -> dict[str, Any]:
    """By joint."""
    spans = [p if isinstance(p, tuple) else (-p, p) for p in PANDA["position"]]
    positions = {f"j{k}": span for k, span in enumerate(spans, 1)}
    return {
        "position": positions,
        "velocity": {f"j{k}": v for k, v in enumerate(PANDA["velocity"], 1)},
        **FREE,
    }


@dataclass(frozen=True)
class Case:
    """A robot with limits."""

    name: str
    setup: Callable[[], ec.Setup]
    changes: dict[str, Any]
    seeds: int = 3
    move: Callable[[ec.Setup], list[str]] | None = None

    def all_changes(self, setup: ec.Setup) -> dict[str, Any]:
        """What a call changes in the set-up."""
        return {
            **self.changes,
            "starts": 1,
            **({} if self.move is None else {"move": self.move(setup)}),
        }


CASES = {
    "ur10": Case(
        "UR10, q within ±2.5, speeds of its URDF",
        lambda: urdf(UR10),
        {
            "criterion": "condition",
            "limits": {"position": [-REACH, REACH], "effort": "none", **FREE},
        },
        10,
    ),
    "panda": Case(
        "Panda, limits of the data sheet",
        lambda: ec.load_setup(ROOT / "examples" / "panda.yaml"),
        {"criterion": "condition", "limits": panda_limits()},
        5,
    ),
    "tx40": Case(
        "TX40, coupled wrist, friction, rotors; 2 rad, 3 rad/s",
        lambda: ec.load_setup(ROOT / "examples" / "tx40.yaml"),
        {"limits": {"position": [-2, 2], "velocity": 3}},
    ),
    "table": Case(
        "UR10 on a table beside a wall",
        lambda: ec.load_setup(ROOT / "examples" / "excite" / "ur10.yaml"),
        {},
    ),
    "leg": Case(
        "a leg of the quadruped A1, base held",
        lambda: urdf("a1_description/urdf/a1.urdf", floating=True),
        {},
        move=lambda _: ["FR_hip_joint", "FR_thigh_joint", "FR_calf_joint"],
    ),
    "talos": Case(
        "upper body of the humanoid Talos, torques of its URDF",
        talos,
        {},
        1,
        move=upper,
    ),
}


@cache
def runs(name: str) -> list[tuple[float, Any]]:
    """Seconds and result for each seed."""
    case = CASES[name]
    setup = case.setup()
    changes, made = case.all_changes(setup), []
    for seed in range(case.seeds):
        begun = perf_counter()
        found = ec.exciting_trajectory(setup, seed=seed, **changes)
        made.append((perf_counter() - begun, found))
    return made


def measured(name: str) -> list[Any]:
    """A row of the table."""
    case = CASES[name]
    setup = case.setup()
    seconds, founds = zip(*runs(name), strict=True)
    first = founds[0]
    done = sum(found.safe and found.starts[0].status == "converged" for found in founds)
    return [
        case.name,
        f"{len(first.trajectory.coordinates)} / {first.base.rank}",
        f"{done} of {case.seeds}",
        spread(seconds, ".1f", " s"),
        spread([found.conditioning.condition for found in founds]),
        spread([found.conditioning.scaled_condition for found in founds]),
        f"{gradient_seconds(setup, case.all_changes(setup)) * 1e3:.2g} ms",
    ]


def spread(values: Sequence[float], digits: str = ".3g", unit: str = "") -> str | None:
    """Median … largest; None of no values."""
    return (
        f"{np.median(values):{digits}} … {max(values):{digits}}{unit}"
        if values
        else None
    )


def gradient_seconds(setup: ec.Setup, changes: dict[str, Any]) -> float:
    """Median time of the criterion with its gradient, in one thread."""
    from threadpoolctl import threadpool_limits

    problem = designed(
        task_of(setup, changed(setup.excitation, changes, setup.source))
    ).problem
    x, times = problem.random(np.random.default_rng(0)), []
    with threadpool_limits(1):
        for _ in range(60):
            begun = perf_counter()
            problem.value_and_gradient(x)[1]()
            times.append(perf_counter() - begun)
    return float(np.median(times[10:]))


def regressors(states: tuple[Any, Any, Any]) -> Any:
    """The UR10's stacked regressor in all columns, by Pinocchio."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(ROBOTS / UR10))
    data = model.createData()
    return np.vstack(
        [
            pin.computeJointTorqueRegressor(model, data, *x)
            for x in zip(*states, strict=True)
        ]
    )


def beside_figaroh(python: str | None) -> list[str]:
    """The UR10 again, beside FIGAROH's own search under the same limits; or why not."""
    try:
        python = environment(python)
    except UnavailableError as error:
        return [f"Not installed, so not measured: {error}."]
    figaroh, ipopt = versions(python)
    searches = []
    for seed in range(SEARCHES):
        searches.append(searched(python, ROBOTS / UR10, REACH, seed))
        print(*their_row(f"FIGAROH, seed {seed}", searches[-1:]), sep=" | ", flush=True)
    return [
        "UR10, 8 s, q within ±2.5, speeds of its URDF; from the model to the motion, median … largest over "
        f"{CASES['ur10'].seeds} seeds of Echelon; FIGAROH searched {SEARCHES} times.",
        table(
            PEER,
            [
                our_row(searches),
                their_row(f"FIGAROH {figaroh}, IPOPT {ipopt}", searches),
            ],
        ),
        "FIGAROH chooses its columns of Pinocchio's regressor by a QR with pivots of a random motion, which gives "
        f"other columns each time ({len(columns(searches))} different sets here): Echelon's motions are judged on all "
        "of them, FIGAROH's on those that it was made for. \"acceptable\" is IPOPT's looser tolerance; at the limit of "
        "iterations FIGAROH keeps the last motion if it is feasible.",
    ]


def columns(searches: list[Search]) -> list[list[int]]:
    """The different choices of columns."""
    return [list(choice) for choice in sorted({search.columns for search in searches})]


def our_row(searches: list[Search]) -> list[Any]:
    """Echelon's motions."""
    seconds, founds = zip(*runs("ur10"), strict=True)
    stacked = [
        regressors(found.trajectory.states(np.arange(800) / 100)) for found in founds
    ]
    return [
        f"Echelon {ec.__version__}",
        ended([found.starts[0].status for found in founds]),
        spread([found.starts[0].iterations for found in founds], ".0f"),
        spread(seconds, ".1f", " s"),
        spread([found.conditioning.condition for found in founds]),
        spread(
            [
                float(np.linalg.cond(W[:, choice]))
                for W in stacked
                for choice in columns(searches)
            ]
        ),
    ]


def their_row(name: str, searches: list[Search]) -> list[Any]:
    """FIGAROH's motions, where there are any."""
    base = runs("ur10")[0][1].base
    moved = [
        (search.states, list(search.columns))
        for search in searches
        if search.states is not None
    ]
    return [
        name,
        ended(
            [
                search.status if search.states else f"{search.status}, no motion"
                for search in searches
            ]
        ),
        spread([search.iterations for search in searches], ".0f"),
        spread([search.seconds for search in searches], ".1f", " s"),
        spread(
            [
                float(np.linalg.cond(base.regressor(*states).reshape(-1, base.rank)))
                for states, _ in moved
            ]
        ),
        spread(
            [
                float(np.linalg.cond(regressors(states)[:, choice]))
                for states, choice in moved
            ]
        ),
    ]


def ended(statuses: list[str]) -> str:
    """How often a search ended in which way."""
    return ", ".join(
        f"{count} × {status}" for status, count in Counter(statuses).most_common()
    )


HEAD = [
    *(
        "robot",
        "coordinates / base parameters",
        "converged, safe",
        "time",
        "condition number",
        "with scaled columns",
    ),
    "criterion with gradient",
]
PEER = [
    "search",
    "ended",
    "iterations",
    "time",
    "condition number, Echelon's columns",
    "FIGAROH's columns",
]


def page(rows: list[list[Any]], peer: list[str]) -> str:
    """The results with what they were measured on."""
    names = ("numpy", "mujoco", "pin")
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    return "\n\n".join(
        [
            "# Exciting trajectories",
            "Median … largest over seeds of one start each: from the set-up to margins that hold at every time.",
            table(HEAD, rows),
            "## Beside FIGAROH",
            *peer,
            f"Echelon {ec.__version__}, Python {platform.python_version()}, {versions}; {processors()} processors.",
            "",
        ]
    )


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=", ".join([*CASES, FIGAROH])
    )
    parser.add_argument(
        "--figaroh", metavar="PYTHON", help="interpreter that has figaroh and cyipopt"
    )
    arguments = parser.parse_args()
    wanted = arguments.names or [*CASES, FIGAROH]
    if unknown := set(wanted) - {*CASES, FIGAROH}:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    rows, peer = [], []
    for name in wanted:
        if name == FIGAROH:
            peer = beside_figaroh(arguments.figaroh)
            print(*peer, sep="\n", flush=True)
        else:
            rows.append(measured(name))
            print(*rows[-1], sep=" | ", flush=True)
    if {*wanted} == {*CASES, FIGAROH}:
        OUTPUT.write_text(page(rows, peer), encoding="utf-8")
        print(page(rows, peer))


if __name__ == "__main__":
    main()
