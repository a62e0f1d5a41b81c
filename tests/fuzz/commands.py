"""Commands of the command line on a mutated file, in this process."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from random import Random

from fuzz.material import Material

COMMANDS: dict[str, tuple[str, ...]] = {
    "description": (
        "derive {file} --rank-only",
        "derive {file} --budget 0.01 --json",
        "derive {file} --budget 0.01 --format latex",
    ),
    "description as JSON": ("derive {file} --rank-only", "generate {file} -o {out} --target python"),
    "linear model": ("derive {file}", "derive {file} --json"),
    "set-up": ("identify {file} {log} --target none -o {out}", "check-trajectory {file} {motion}"),
    "URDF": ("derive {file} --rank-only", "derive {file} --budget 0.01", "check-trajectory {file} {motion}"),
    "URDF of other programs": ("derive {file} --rank-only", "derive {file} --budget 0.01"),
    "SDF": ("derive {file} --rank-only", "derive {file} --budget 0.01 --json"),
    "text of one line": ("text {file}",),
    "MJCF": ("derive {file} --rank-only", "derive {file} --measured file --rank-only"),
    "base model": ("verify {file}", "generate {file} -o {out} --target c", "audit {setup} {file}"),
    "base model with other flags": ("verify {file}", "generate {file} -o {out} --target c"),
    "identified model": (
        "predict {file} {log}",
        "predict {file} {log} --json -o {out}.csv",
        "check-trajectory {setup} {motion} --model {file}",
    ),
    "claims": ("audit {setup} {file}",),
    "values": ("generate {base} -o {out} --parameters {file} --target python",),
    "trajectory": ("motion {file}", "motion {file}", "check-trajectory {setup} {file}"),
    "log": ("read {file}", "setup {robot} {file}", "identify {setup} {file} --target none", "predict {model} {file}"),
}  # fmt: skip


def command(kind: str, file: Path, material: Material, rng: Random) -> list[str]:
    """The words of a command for a file of a format."""
    known = (
        COMMANDS.get(kind)
        or COMMANDS["trajectory" if kind.startswith("trajectory") else "log"]
    )
    folder = material.folder
    places = {
        "file": file,
        "out": file.parent / "out",
        "log": folder / "log.csv",
        "setup": folder / "setup.yaml",
        "motion": folder / "motion.json",
        "base": folder / "base.json",
        "robot": folder / "robot.yaml",
        "model": folder / "model.json",
    }
    return [word.format(**places) for word in rng.choice(known).split()]


def run(words: list[str]) -> int | None:
    """Run a command of ours; ``read`` stands for a log, ``motion`` for a trajectory, ``text`` for a robot's text."""
    if words[0] in ("read", "motion", "text"):
        return _read(*words)
    from echelon.cli import main

    sys.argv = ["echelon", *words]
    os.environ.pop("ECHELON_TRACEBACK", None)
    main()
    return 0


def _read(what: str, name: str) -> int:
    import echelon as ec
    from echelon.excite.files.trajectory_file import read_trajectory
    from echelon.identification.logs.files.open_log import read_table
    from echelon.shared.errors import EchelonError

    try:
        if what == "read":
            read_table(name)
        elif what == "text":
            ec.base_structure(Path(name).read_text(encoding="utf-8", errors="replace"))
        else:
            read_trajectory(name, ("j1", "j2"), ("rad", "rad"))
    except EchelonError as error:
        print(error)
        return 2
    return 0
