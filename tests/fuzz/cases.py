"""One case: a format, a number, and the seed; the same case is the same file and the same command."""

from __future__ import annotations

import json
import pkgutil
import shutil
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
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
        again = (
            f"--only '{self.kind}' --first {self.number} --cases 1 --seed {self.seed}"
        )
        return (
            f"{self.outcome.fault}: {' '.join(self.words)}\n  again: {again}\n  "
            + "\n  ".join(last)
        )


def prepared(folder: Path) -> Material:
    """What is mutated, with everything imported and compiled that commands need."""
    material = make(folder)
    (folder / "motion.json").write_text(
        json.dumps(material.trajectory), encoding="utf-8"
    )
    import_all()
    return material


def import_all() -> None:
    """Whatever commands need, so that no child has to."""
    import echelon

    others = (
        "mcap.reader",
        "mujoco",
        "pyarrow.csv",
        "pyarrow.parquet",
        "rosbags.rosbag1",
        "rosbags.rosbag2",
    )
    ours = (found.name for found in pkgutil.walk_packages(echelon.__path__, "echelon."))
    for name in (
        *others,
        "rosbags.typesys",
        "sympy",
        "h5py",
        "scipy.interpolate",
        "scipy.io",
        *ours,
    ):
        with suppress(ImportError):  # such as what needs an extra
            import_module(name)


def cases(numbers: Iterable[int], only: str = "") -> Iterator[tuple[str, int]]:
    """Formats in turn."""
    kinds = [kind for kind in FORMATS if only in kind]
    for number in numbers:
        yield kinds[number % len(kinds)], number


def run_case(
    material: Material, kind: str, number: int, seed: int, keep: Path | None = None
) -> Fault | None:
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
            shutil.copytree(
                folder, keep / f"{kind} {seed} {number}", dirs_exist_ok=True
            )
        return Fault(kind, number, seed, words, outcome)
    finally:
        shutil.rmtree(folder)
