"""One case: a format, a number, and the seed; the same case is the same file and the same command."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random

from fuzz.child import Outcome, run_alone
from fuzz.commands import command, run
from fuzz.formats import FORMATS
from fuzz.material import Material, make


@dataclass(frozen=True)
class Fault:
    """A case that went wrong."""

    kind: str
    number: int
    seed: int
    words: list[str]
    outcome: Outcome

    def __str__(self) -> str:
        last = self.outcome.text.strip().splitlines()[-3:]
        again = f"--only '{self.kind}' --first {self.number} --cases 1 --seed {self.seed}"
        return f"{self.outcome.fault}: {' '.join(self.words)}\n  again: {again}\n  " + "\n  ".join(last)


def prepared(folder: Path) -> Material:
    """What is mutated, with everything imported and compiled that commands need."""
    material = make(folder)
    (folder / "motion.json").write_text(json.dumps(material.trajectory), encoding="utf-8")
    for kind in FORMATS:
        for number in range(3):
            run_case(material, kind, -1 - number, 0)
    import_all()
    return material


def import_all() -> None:
    """So that no child has to."""
    import casadi  # noqa: F401
    import mcap.reader  # noqa: F401
    import mujoco  # noqa: F401
    import pyarrow.parquet  # noqa: F401
    import rosbags.rosbag2
    import rosbags.typesys  # noqa: F401
    import scipy.interpolate  # noqa: F401

    import echelon.cli.main  # noqa: F401


def cases(numbers: Iterable[int], only: str = "") -> Iterator[tuple[str, int]]:
    """Formats in turn."""
    kinds = [kind for kind in FORMATS if only in kind]
    for number in numbers:
        yield kinds[number % len(kinds)], number


def run_case(material: Material, kind: str, number: int, seed: int, keep: Path | None = None) -> Fault | None:
    """Make the file of a case and run its command on it; what went wrong, if anything."""
    rng = Random(f"{seed} {kind} {number}")
    folder = material.folder / "case"
    folder.mkdir()
    try:
        file = FORMATS[kind](material, rng, folder)
        words = command(kind, file, material, rng)
        outcome = run_alone(lambda: run(words), material.folder / "printed")
        if not outcome.fault:
            return None
        if keep is not None:
            shutil.copytree(folder, keep / f"{kind} {seed} {number}", dirs_exist_ok=True)
        return Fault(kind, number, seed, words, outcome)
    finally:
        shutil.rmtree(folder)
