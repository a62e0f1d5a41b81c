"""Traps in logs of simulated arms: how often `identify` names what is wrong, and what it says where nothing is.

python benchmarks/traps.py                             all traps on ur10, ur5 and xarm7 with one seed each
python benchmarks/traps.py --robots all --seeds 3      on all arms
python benchmarks/traps.py --traps tilt gain --robots panda --first 4

One line per run is printed at once, and added to the file that --lines names.  The tables are written to
benchmarks/results/traps.md if all traps ran.
"""

from __future__ import annotations

import argparse
import platform
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from time import process_time
from typing import Any

import echelon as ec
from tabular import table

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from support.robot_files import robot_file  # noqa: E402
from support.trap_logs import ROBOTS, TRAPS, judged, trap_log  # noqa: E402

OUTPUT = ROOT / "benchmarks" / "results" / "traps.md"
_TEXT = 110  # characters of a finding in a line


@dataclass(frozen=True)
class Run:
    """What was made of one log.

    Attributes
    ----------
    trap, robot : str
    seed : int
    named : bool, optional
        Whether what is wrong is said; None where nothing is.
    first : bool
        Whether it is the first thing that is said.
    wrong : int
        Number of causes that are named and are none.
    covered, parameters : int
        True base parameters within their intervals of 95 %, and all of them; 0 where the model cannot be right.
    verdict : str
        The badge of the verdict.
    seconds : float
        Time of the processor.
    said : tuple of str
        What is named, and what of it is wrong.
    judged : tuple of str
        Hypotheses with their gains, those that were taken and the next best.
    """

    trap: str
    robot: str
    seed: int
    named: bool | None
    first: bool
    wrong: int
    covered: int
    parameters: int
    verdict: str
    seconds: float
    said: tuple[str, ...] = ()
    judged: tuple[str, ...] = ()

    def __str__(self) -> str:
        outcome = (
            "-"
            if self.named is None
            else "FIRST"
            if self.first
            else "named"
            if self.named
            else "MISSED"
        )
        coverage = f"{self.covered}/{self.parameters}" if self.parameters else "-"
        head = f"{self.trap:<11} {self.robot:<6} {self.seed:>2} {outcome:<6} wrong {self.wrong} {coverage:>6}"
        return " | ".join(
            [f"{head} {self.verdict:<11} {self.seconds:5.1f} s", *self.said]
        )


def run(trap: str, robot: str, seed: int) -> Run:
    """Simulate and identify."""
    log = trap_log(trap, robot, seed)
    begin = process_time()
    try:
        result = ec.identify(robot_file(ROBOTS[robot]), log.columns)
    except ec.EchelonError as error:
        seconds = process_time() - begin
        return Run(
            trap,
            robot,
            seed,
            None if log.names is None else False,
            False,
            0,
            0,
            0,
            "error",
            seconds,
            (str(error),),
        )
    seconds = process_time() - begin
    wrong, (covered, count) = log.wrong(result), log.coverage(result) or (0, 0)
    said = [
        f"{'WRONG ' * (f in wrong)}{f.severity} {f.kind}: {f.text[:_TEXT]}"
        for f in judged(result)
    ]
    named = None if log.names is None else log.named(result)
    first, scored = log.named_first(result), tuple(map(in_line, result.hypotheses))
    return Run(
        trap,
        robot,
        seed,
        named,
        first,
        len(wrong),
        covered,
        count,
        result.judgement.badge,
        seconds,
        tuple(said),
        scored,
    )


def in_line(some: Any) -> str:
    """A hypothesis with its gain and places."""
    taken, gain = (
        "taken" if some.taken else "not taken",
        f"{some.gain.mean:.3g} ± {some.gain.error:.2g}",
    )
    return f"{taken}: {some.words} ({', '.join(some.places)}), gain {gain}"


def counted(runs: Sequence[Run]) -> list[str]:
    """Cells of a table: named, named first, wrong names, coverage, verdicts and time."""
    asked = [some for some in runs if some.named is not None]
    named = (
        f"{sum(bool(some.named) for some in asked)} / {len(asked)}" if asked else "–"
    )
    first = f"{sum(some.first for some in asked)}" if asked else "–"
    covered, parameters = (
        sum(some.covered for some in runs),
        sum(some.parameters for some in runs),
    )
    coverage = f"{covered / parameters:.1%}" if parameters else "–"
    words = sorted(
        {some.verdict for some in runs},
        key=lambda word: -sum(some.verdict == word for some in runs),
    )
    verdicts = ", ".join(
        f"{word} {sum(some.verdict == word for some in runs)}" for word in words
    )
    seconds = sum(some.seconds for some in runs) / len(runs)
    return [
        named,
        first,
        str(sum(some.wrong for some in runs)),
        coverage,
        verdicts,
        f"{seconds:.1f}",
    ]


def page(runs: Sequence[Run], seeds: range) -> str:
    """All as Markdown."""
    robots = list(dict.fromkeys(some.robot for some in runs))
    head = ["named", "first", "wrong names", "coverage", "verdicts", "CPU s"]
    traps = [
        [trap, *counted([some for some in runs if some.trap == trap])] for trap in TRAPS
    ]
    arms = [
        [robot, *counted([some for some in runs if some.robot == robot])]
        for robot in robots
    ]
    versions = {"Echelon": ec.__version__, "Python": platform.python_version()}
    versions |= {name: version(name) for name in ("numpy", "scipy", "clarabel", "pin")}
    stated = ", ".join(f"{name} {text}" for name, text in versions.items())
    text = (
        f"{stated}.  Arms: {', '.join(robots)}; seeds {seeds.start} to {seeds.stop - 1}.  Of every trap: how often it "
        "is named and how often before all else, how many other causes are named, how many true base parameters are in "
        "their intervals of 95 % where the model can have them, badges of verdicts, and mean time."
    )
    every = table(["trap", *head], [*traps, ["all", *counted(runs)]])
    return (
        "\n\n".join(
            ["# Traps in simulated logs", text, every, table(["arm", *head], arms)]
        )
        + "\n"
    )


def every_run(
    traps: Sequence[str], robots: Sequence[str], seeds: range
) -> Iterator[Run]:
    """All runs, seed by seed."""
    for seed in seeds:
        for robot in robots:
            for trap in traps:
                yield run(trap, robot, seed)


def main() -> None:
    """Run all, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--robots",
        nargs="*",
        default=["ur10", "ur5", "xarm7"],
        choices=[*ROBOTS, "all"],
    )
    parser.add_argument("--traps", nargs="*", default=list(TRAPS), choices=list(TRAPS))
    parser.add_argument("--seeds", type=int, default=1, help="how many")
    parser.add_argument("--first", type=int, default=1, help="the first one")
    parser.add_argument("--lines", type=Path, help="a file that every line is added to")
    chosen = parser.parse_args()
    robots = list(ROBOTS) if "all" in chosen.robots else chosen.robots
    seeds, runs = range(chosen.first, chosen.first + chosen.seeds), []
    for some in every_run(chosen.traps, robots, seeds):
        print(some, flush=True)
        runs.append(some)
        if chosen.lines is not None:
            with chosen.lines.open("a", encoding="utf-8") as lines:
                lines.write(
                    "".join(
                        f"{line}\n"
                        for line in [
                            str(some),
                            *(f"    {text}" for text in some.judged),
                        ]
                    )
                )
    if set(chosen.traps) == set(TRAPS):
        text = page(runs, seeds)
        OUTPUT.write_text(text, encoding="utf-8")
        print(text)


if __name__ == "__main__":
    main()
