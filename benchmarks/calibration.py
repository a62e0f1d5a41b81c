"""Calibration of a measured arm by 114 camera poses, beside FIGAROH's on the same rows.

python benchmarks/calibration.py                     calibrate, print, and write benchmarks/results/calibration.md
python benchmarks/calibration.py --figaroh PYTHON    take FIGAROH from the environment of this interpreter

The log is not part of the project.  It is looked for in the folder that ECHELON_DATA names, by default ../shared/data
beside the project; without it nothing is done.  FIGAROH is installed on first use, unless an interpreter is named.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pyarrow.parquet as pq

import echelon as ec
from anchors.build import HERE, UnavailableError
from anchors.figaroh_search import environment, run_isolated
from echelon.robot import known_values, placement_matrix
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("ECHELON_DATA", ROOT.parent / "shared" / "data"))
LOG = DATA / "panda_calibration" / "panda_camera_poses.parquet"
OUTPUT = ROOT / "benchmarks" / "results" / "calibration.md"
PANDA = ROOT / "examples" / "panda.yaml"
METHODS = ("structural", "map", "excitation")
NEEDED = "import figaroh.calibration.base_calibration"


def own(repeats: int = 3) -> list[str]:
    """Echelon's row: the shortest of a few times, warm."""
    seconds = []
    for _ in range(repeats + 1):
        started = perf_counter()
        found = ec.calibrate(PANDA, LOG)
        seconds.append(perf_counter() - started)
    place, turn = found.scores
    count = f"{found.base.rank} combinations"
    return row("Echelon", count, min(seconds[1:]), place.after, turn.after)


def row(name: str, count: str, seconds: float, place: float, turn: float) -> list[str]:
    """Cells of a line."""
    angle = f"{np.degrees(turn):.4f}°"
    return [name, count, f"{seconds:.1f}", f"{place * 1e3:.3f} mm", angle]


def problem() -> dict[str, Any]:
    """The arm and its rows, every second held out, as plain data."""
    arm = ec.load(PANDA)
    known = known_values(arm)
    placements = []
    for body in arm.bodies:
        (step,) = (s for s in body.joint.steps if s not in body.joint.motions)
        placements.append(placement_matrix(step, known).tolist())
    columns = {k: np.array(v) for k, v in pq.read_table(LOG).to_pydict().items()}
    q = np.column_stack([columns[f"q{k}"] for k in range(1, 8)])
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    for i, axis in enumerate("xyz"):
        poses[:, i, 3] = columns[axis]
        for j in range(3):
            poses[:, i, j] = columns[f"r{i + 1}{j + 1}"]
    halves = {"": slice(0, None, 2), "_held": slice(1, None, 2)}
    rows = {f"q{name}": q[part].tolist() for name, part in halves.items()}
    rows |= {f"poses{name}": poses[part].tolist() for name, part in halves.items()}
    return {"placements": placements, **rows}


def peer(python: str, stated: Mapping[str, Any], method: str) -> list[str]:
    """FIGAROH's row, by one of its methods."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.json"
        path.write_text(json.dumps({**stated, "method": method}), encoding="utf-8")
        script = HERE.parent / "probes" / "figaroh_calibration.py"
        done = run_isolated(python, str(script), str(path))
    if done.returncode:
        raise RuntimeError(f"FIGAROH's calibration failed:\n{done.stderr[-2000:]}")
    told = json.loads(done.stdout)
    count = f"{told['parameters']} parameters"
    return row(f"FIGAROH, {method}", count, told["seconds"], *told["after"])


def main() -> None:
    """Calibrate with both, print, and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--figaroh", metavar="PYTHON", help="interpreter that has figaroh"
    )
    arguments = parser.parse_args()
    if not LOG.is_file():
        raise SystemExit(f"{LOG.name} is not there: name its folder by ECHELON_DATA")
    rows = [own()]
    absent = ""
    try:
        python = environment(arguments.figaroh, NEEDED)
        stated = problem()
        rows += [peer(python, stated, method) for method in METHODS]
    except UnavailableError as error:
        absent = f"FIGAROH is absent: {error}."
    head = ["", "fitted", "seconds", "held-out position", "held-out rotation"]
    lines = [
        "# Calibration of a measured arm",
        "",
        "114 poses of a Franka arm's camera beside a board, every second one held out (root mean squares of 57). Echelon's",
        "time is that of the whole command's work: reading, frames, the certified set, a fit to half of the rows and one to",
        "all. FIGAROH's is that of one fit to half of the rows, with all parameters of joints, base and tool, angles weighed",
        "by 0.3 m, by three of its methods. Written by `benchmarks/calibration.py`.",
        "",
        table(head, rows),
        *([absent] if absent else []),
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if not absent:
        OUTPUT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
