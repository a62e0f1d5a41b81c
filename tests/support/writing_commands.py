"""Commands that write, and a folder of a user to write into."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from echelon.cli.destination import MANIFEST
from support.command_line import run

SLIDE = """\
# the user's own comment
echelon: 1
name: slide
gravity: none
bodies:
  - {name: slide, joint: {type: prismatic, axis: x}}
effects:
  - {type: viscous, at: all}
log: {time: t, position: {slide: x}, output: {slide: f}}
preparation: {band: 10}
excitation:
  duration: 2
  starts: 1
  harmonics: 3
  family: fourier
  limits: {position: [-1, 1], velocity: 2, acceleration: 20, jerk: 900}
"""
COMMANDS: dict[str, tuple[str, ...]] = {
    "derive": ("derive", "slide.yaml", "-o", "set.txt"),
    "special": ("derive", "slide.yaml", "--special", "-o", "special.txt"),
    "compare-numeric": (
        "derive",
        "slide.yaml",
        "--compare-numeric",
        "-o",
        "numeric.txt",
    ),
    "regressor": ("derive", "slide.yaml", "--regressor", "sympy", "-o", "regressor.py"),
    "audit": ("audit", "slide.yaml", "claims.txt", "-o", "audit.txt"),
    "generate": ("generate", "slide.yaml", "-o", "."),
    "identify": ("identify", "slide.yaml", "run.csv", "-o", "."),
    "predict": ("predict", "earlier/model.json", "run.csv", "-o", "predicted.csv"),
    "excite": ("excite", "slide.yaml", "-o", "."),
    "check-trajectory": (
        "check-trajectory",
        "slide.yaml",
        "motion.csv",
        "-o",
        "judged.html",
    ),
}
"""With relative paths, in a folder of :func:`workplace`."""


OUTPUTS: dict[str, set[str]] = {
    "derive": {"set.txt"},
    "special": {"special.txt"},
    "compare-numeric": {"numeric.txt"},
    "regressor": {"regressor.py"},
    "audit": {"audit.txt"},
    "generate": {"slide.c", "slide.h"},
    "identify": {
        "model.json",
        "report.html",
        "identified.yaml",
        "identified.urdf",
        "model.c",
        "model.h",
    },
    "predict": {"predicted.csv"},
    "excite": {"trajectory.json", "trajectory.csv", "preview.html"},
    "check-trajectory": {"judged.html"},
}


@cache
def _template() -> TemporaryDirectory[str]:
    kept = TemporaryDirectory()
    folder = Path(kept.name)
    t = np.arange(600) / 200
    x, v, a = (
        sum(A * w**k * wave(w * t) for A, w in ((0.2, 3), (0.05, 7)))
        for k, wave in enumerate(_WAVES)
    )
    force = 2.5 * a + 0.7 * v + np.random.default_rng(3).normal(0, 0.05, t.size)
    _table(folder / "run.csv", {"t": t, "x": x, "f": force})
    _table(
        folder / "motion.csv",
        {"t": t[:401], "q_slide": 0.05 * (1 - np.cos(np.pi * t[:401])) ** 2},
    )
    (folder / "slide.yaml").write_text(SLIDE)
    (folder / "claims.txt").write_text("M1\nFv1\n")
    done = run(
        "identify",
        folder / "slide.yaml",
        folder / "run.csv",
        "-o",
        folder / "earlier",
        "-t",
        "none",
    )
    assert done.returncode == 0, done.stderr
    return kept


def workplace(folder: Path) -> Path:
    """A user's folder: a robot, claims about it, a log, a motion, and an earlier result."""
    return Path(shutil.copytree(_template().name, folder, dirs_exist_ok=True))


_WAVES: Any = (np.sin, np.cos, lambda s: -np.sin(s))


def _table(path: Path, columns: dict[str, Any]) -> None:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(
        path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.12g"
    )


Contents = dict[str, bytes]


def contents(folder: Path) -> Contents:
    """Everything in a folder but its manifest, hidden files too."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != MANIFEST
    }
