"""How long it takes until machine code runs: from a robot's file to compiled C, and to a first regressor."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import echelon as ec
from anchors import build
from anchors.build import UnavailableError
from anchors.generated_c import FLAGS
from anchors.process import probe
from echelon.codegen import generate
from machine.inverse_dynamics import FUNCTION
from ratios import Spread
from robots import PANDA_FILE, find_urdf

_FIRST_USES = {
    "panda": "Panda, base regressor",
    "talos": "Talos, floating, base regressor",
}
_PROCESSES = 3  # a fresh process for each


def to_compiled_c(repeats: int, report: Callable[[str], None]) -> list[dict[str, Any]]:
    """Reading, deriving, writing and compiling inverse dynamics in C, step by step."""
    rows = []
    for label, path in {
        "UR10": find_urdf("ur10_robot.urdf"),
        "Panda": PANDA_FILE,
    }.items():
        report(f"{label} from its file to compiled C")
        try:
            runs = [_steps(path) for _ in range(repeats + 1)][1:]
        except UnavailableError as error:
            return [{"robot": label, "skipped": str(error)}]
        parts = {
            part: Spread.of([run[part] for run in runs]).as_dict() for part in runs[0]
        }
        rows.append({"robot": label, "seconds": parts})
    return rows


def _steps(path: Path) -> dict[str, float]:
    times = [perf_counter()]
    mechanism = ec.load(path)
    times.append(perf_counter())
    base = ec.base_parameters(mechanism)
    times.append(perf_counter())
    files = generate(base, "c", functions=(FUNCTION,))
    times.append(perf_counter())
    with tempfile.TemporaryDirectory() as folder:
        for name, text in files.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        sources = sorted(Path(folder).glob("*.c"))
        build.compiled_afresh(sources, FLAGS, Path(folder) / "library.so", "c")
    times.append(perf_counter())
    names = ("read", "derive", "write C", "compile C")
    steps = {name: b - a for name, a, b in zip(names, times, times[1:], strict=False)}
    return steps | {"all": times[-1] - times[0]}


def first_uses(quick: bool, report: Callable[[str], None]) -> list[dict[str, Any]]:
    """A first regressor without a cache, and again from the cache in a process that runs already."""
    rows = []
    for name, label in list(_FIRST_USES.items())[: 1 if quick else None]:
        report(f"first use of {label}")
        cold, cached = [], []
        for _ in range(1 if quick else _PROCESSES):
            folder = tempfile.mkdtemp(prefix="echelon-bench-")
            try:
                cold.append(
                    probe("first_use", name, environment={"ECHELON_CACHE": folder})[
                        "seconds"
                    ]
                )
                again = probe(
                    "first_use",
                    name,
                    "--running",
                    environment={"ECHELON_CACHE": folder},
                )
                cached.append(again["seconds"])
            finally:
                shutil.rmtree(folder, ignore_errors=True)
        seconds = {
            "cold": Spread.of(cold).as_dict(),
            "cached": Spread.of(cached).as_dict(),
        }
        rows.append({"what": label, "name": name, "seconds": seconds})
    return rows
