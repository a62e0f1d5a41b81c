"""The minimal task of the docs on stock arms and legs: what each reaches, beside random motions, and the time it takes.

python benchmarks/minimal_tasks.py [NAME ...]

Robots are those of the package example-robot-data, and of robot_descriptions as far as they are on this machine.  Each
has its file, a table under its base where it stands on one, its own collisions, and nothing else.  CPU times are of the
whole, from the file to margins at every time.
"""

from __future__ import annotations

import os
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import echelon as ec
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
STOCK = (
    Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
)
DESCRIPTIONS = Path(
    os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")
).expanduser()
TABLE: dict[str, Any] = {"obstacles": [{"name": "table", "plane": [0, 0, 1]}]}
LEG = ["FR_hip_joint", "FR_thigh_joint", "FR_calf_joint"]
HEAD = (
    "robot",
    "ends",
    "coordinates / base",
    "condition",
    "scaled",
    "worst deviation",
    "random's best",
    "CPU time",
)


@dataclass(frozen=True)
class Task:
    """A robot with what a user has to add to it."""

    file: str  # in the stock, in the examples, or the name of a description
    changes: dict[str, Any]

    def path(self) -> Path:
        """The file, or an error that says why there is none."""
        for folder in (STOCK, ROOT / "examples"):
            if (folder / self.file).is_file():
                return folder / self.file
        if not DESCRIPTIONS.is_dir():
            raise FileNotFoundError(f"{self.file} is not on this machine")
        from importlib import import_module

        return Path(import_module(f"robot_descriptions.{self.file}").URDF_PATH)


STANFORD = {
    "limits": {"position": {"j3": [0.2, 0.6]}, "velocity": {"all": 2, "j3": 0.5}}
}
TASKS = {
    "UR3": Task("ur_description/urdf/ur3_robot.urdf", {"collisions": TABLE}),
    "UR5": Task("ur_description/urdf/ur5_robot.urdf", {"collisions": TABLE}),
    "UR10": Task("ur_description/urdf/ur10_robot.urdf", {"collisions": TABLE}),
    "Panda": Task("panda_description/urdf/panda.urdf", {"collisions": TABLE}),
    "xArm7": Task("xarm_description/urdf/xarm7.urdf", {"collisions": TABLE}),
    "Kinova": Task("kinova_description/robots/kinova.urdf", {"collisions": TABLE}),
    "Kinova, boxes": Task(
        "kinova_description/robots/kinova.urdf",
        {"collisions": {**TABLE, "unreadable": "boxes"}},
    ),
    "SO-101": Task("so_arm_description/urdf/so101.urdf", {"collisions": TABLE}),
    "Z1": Task("z1_description/urdf/z1.urdf", {"collisions": TABLE}),
    "Talos arm": Task("talos_data/robots/talos_left_arm.urdf", {"collisions": {}}),
    "A1 leg": Task("a1_description/urdf/a1.urdf", {"collisions": {}, "move": LEG}),
    "iiwa": Task("iiwa14_description", {"collisions": TABLE}),
    "TX40": Task("tx40.yaml", {}),
    "Stanford": Task("stanford.yaml", STANFORD),
}


def measured(name: str) -> list[Any]:
    """A row of the table."""
    begun, task = process_time(), TASKS[name]
    try:
        found = ec.exciting_trajectory(opened(task.path()), **task.changes)
    except (ec.EchelonError, ImportError, OSError) as error:
        return [
            name,
            str(error).split(": ", 1)[-1][:90],
            *[""] * 5,
            f"{process_time() - begun:.1f} s",
        ]
    shown, chance = found.conditioning, found.chance
    worst = f"{max(shown.std):.2g} {found.base.units[shown.worst]}"
    return [
        name,
        "safe" if found.safe else "broken",
        f"{len(found.trajectory.coordinates)} / {found.base.rank}",
        f"{shown.condition:.3g}",
        f"{shown.scaled_condition:.3g}",
        worst,
        ""
        if chance is None
        else f"{chance.scaled_condition:.3g}, {chance.worst_std:.2g}",
        f"{process_time() - begun:.1f} s",
    ]


def opened(path: Path) -> ec.Setup:
    """A set-up of a robot file as a task refers to it; open lengths get a value."""
    if path.suffix == ".urdf":
        with TemporaryDirectory() as folder:
            task = Path(folder) / "task.yaml"
            task.write_text(
                f"echelon: 1\nname: {path.stem}\nrobot: {path}\n", encoding="utf-8"
            )
            return ec.load_setup(task)
    if "d2: null" not in path.read_text(encoding="utf-8"):
        return ec.load_setup(path)
    with TemporaryDirectory() as folder:
        stated = Path(folder) / path.name
        stated.write_text(
            path.read_text(encoding="utf-8").replace("d2: null", "d2: 0.15"),
            encoding="utf-8",
        )
        return ec.load_setup(stated)


def main() -> None:
    """Measure what is asked for, or all."""
    rows = []
    for name in sys.argv[1:] or TASKS:
        rows.append(measured(name))
        print(*rows[-1], sep=" | ", flush=True)
    print(table(list(HEAD), rows))


if __name__ == "__main__":
    main()
