"""Benchmarks: base parameters beside numeric tools, and machine code beside compiled ones.

python benchmarks/bench.py                 measure, print, and write benchmarks/results
python benchmarks/bench.py --only machine  some parts; the others keep their results
python benchmarks/bench.py --json          print JSON instead of tables
python benchmarks/bench.py --quick         a smoke run that writes nothing unless --output is given

Anchors in C++ are compiled on first use, and FIGAROH is fetched, into benchmarks/.build.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import linkages
import measure
from machine.facts import facts
from machine.judged import judged as judged_machine
from machine.parts import PARTS
from report import environment, plot_chains, to_markdown
from robots import Robot, panda, published
from targets import Target

RESULTS = Path(__file__).parent / "results"
TARGETS = (
    ("panda, symbolic lengths, closed forms", "panda", "closed_forms", 0.04),
    ("talos_full_v2, floating, closed forms", "talos_full_v2", "closed_forms", 5.0),
    ("tiago_dual, floating, closed forms", "tiago_dual", "closed_forms", 15.0),
    ("tiago_dual, floating, structure only", "tiago_dual", "structure", 1.5),
    ("four-bar linkage, closed forms", "four_bar", "closed_forms", 0.5),
    ("SR400 (arm with a parallelogram), structure only", "sr400", "structure", 0.3),
    ("SR400 (arm with a parallelogram), closed forms", "sr400", "closed_forms", 5.0),
    ("Gough–Stewart platform, structure only", "gough_stewart", "structure", 1.0),
    ("biped with rods, floating, closed forms", "biped", "closed_forms", 3.0),
)
START_UP_TARGETS = (
    ("import echelon", 0.15),
    ("echelon --help", 0.5),
    ("echelon derive examples/panda.yaml", 0.5),
)
LARGE_TARGETS = (("chain of 500", 10.0), ("binary tree of 255", 4.0))
CHAINS = (2, 5, 10, 20, 50, 100)
BASE, MACHINE = "base", "machine"
_ONLY = f"parts to run: {BASE}, {MACHINE}, or of the latter {', '.join(PARTS)}"


def chosen_robots(quick: bool) -> list[Robot]:
    """The robots of a run."""
    small = [panda(), published("ur10", "ur10_robot.urdf", floating=False)]
    if quick:
        return small
    return [
        *small,
        published("so100", "so100.urdf", floating=False),
        published("icub", "icub.urdf", floating=False),
        published("talos_full_v2", "talos_full_v2.urdf", floating=True),
        published("tiago_dual", "tiago_dual.urdf", floating=True),
    ]


def run(
    parts: Collection[str], quick: bool, repeats: int, report: Callable[[str], None]
) -> dict[str, Any]:
    """The measurements of some parts."""
    found: dict[str, Any] = {"environment": environment(repeats)}
    if BASE in parts:
        found |= run_base(quick, repeats, report)
    measured: dict[str, Any] = {}
    for name, part in PARTS.items():
        if name in parts:
            measured |= part(quick, repeats, report)
    if measured:
        found["machine"] = measured | {"facts": facts(repeats)}
    return judge_machine(found)


def run_base(
    quick: bool, repeats: int, report: Callable[[str], None]
) -> dict[str, Any]:
    """Start-up, robots, linkages, chains and large mechanisms."""
    start_up = {
        name: t.as_dict() for name, t in measure.start_up(repeats, report).items()
    }
    rows = measure.robots(chosen_robots(quick), repeats, report)
    looped = linkages.measured(linkages.chosen_linkages(quick), repeats, report)
    chains = measure.chains(CHAINS[:2] if quick else CHAINS, repeats, report)
    large = [] if quick else measure.large(min(repeats, 3), report)
    return {
        "targets": judged(start_up, rows, looped, large),
        "start_up": start_up,
        "robots": rows,
        "linkages": looped,
        "chains": chains,
        "large": large,
        "chain_exponents": measure.exponents(chains),
    }


def judge_machine(found: dict[str, Any]) -> dict[str, Any]:
    """Results with the targets of machine code judged."""
    if "machine" not in found:
        return found
    return found | {
        "machine": found["machine"] | {"targets": judged_machine(found["machine"])}
    }


def completed(found: dict[str, Any], folder: Path) -> dict[str, Any]:
    """New results, and those of an earlier run in a folder for the parts that were not run now."""
    path = folder / "bench.json"
    if not path.exists():
        return found
    earlier = json.loads(path.read_text(encoding="utf-8"))
    merged = earlier | found
    if "robots" in earlier and "robots" not in found:
        merged["environment"] = earlier["environment"]
    if "machine" in earlier and "machine" in found:
        merged["machine"] = earlier["machine"] | found["machine"]
    return judge_machine(merged)


def judged(
    start_up: dict[str, dict[str, float]],
    rows: list[dict[str, Any]],
    looped: list[dict[str, Any]],
    large: list[dict[str, Any]],
) -> list[dict[str, Any]]:
    """Targets that this run can judge, by median."""
    by_name = {row["robot"]: row["seconds"] for row in rows} | {
        row["linkage"]: row["seconds"] for row in looped
    }
    medians = [
        (f"{name}, fresh process", start_up[name]["median"], limit)
        for name, limit in START_UP_TARGETS
    ]
    medians += [
        (text, by_name[n][part]["median"], limit)
        for text, n, part, limit in TARGETS
        if n in by_name
    ]
    derived = {row["mechanism"]: row["seconds"]["median"] for row in large}
    medians += [
        (f"{name}, closed forms", derived[name], limit)
        for name, limit in LARGE_TARGETS
        if name in derived
    ]
    return [Target(*median).as_dict() for median in medians]


def write(results: dict[str, Any], folder: Path) -> None:
    """Write the three files of results."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.json").write_text(
        json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    (folder / "bench.md").write_text(to_markdown(results), encoding="utf-8")
    if "chains" in results:
        plot_chains(results, folder / "chain.png")


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Says on a terminal what is being measured; silent in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("measuring") as status:
        yield lambda name: status.update(f"measuring {name}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description="Benchmarks of Echelon beside other tools."
    )
    parser.add_argument(
        "--quick",
        action="store_true",
        help="few repeats, small robots, one linkage, short chains",
    )
    parser.add_argument(
        "--only", nargs="+", choices=(BASE, MACHINE, *PARTS), metavar="PART", help=_ONLY
    )
    parser.add_argument(
        "--json", action="store_true", help="print JSON instead of tables"
    )
    parser.add_argument(
        "--repeats",
        type=int,
        help="repeats of every measurement (default 7, with --quick 1)",
    )
    parser.add_argument(
        "--output", type=Path, help="folder of the results (default benchmarks/results)"
    )
    options = parser.parse_args()
    if importlib.util.find_spec("pinocchio") is None:
        parser.error(
            "Pinocchio is not installed: pip install 'echelon-robotics[bench]'"
        )
    chosen = set(options.only or (BASE, MACHINE))
    parts = chosen | set(PARTS) if MACHINE in chosen else chosen
    with progress() as report:
        results = run(
            parts, options.quick, options.repeats or (1 if options.quick else 7), report
        )
    folder = options.output or (None if options.quick else RESULTS)
    if folder is not None:
        results = completed(results, folder) if options.only else results
        write(results, folder)
    show(results, as_json=options.json)


def show(results: dict[str, Any], *, as_json: bool) -> None:
    """Print JSON, or tables: rendered on a terminal, as Markdown in a pipe."""
    if as_json:
        print(json.dumps(results, ensure_ascii=False))
    elif sys.stdout.isatty():
        from rich.console import Console
        from rich.markdown import Markdown

        Console().print(Markdown(to_markdown(results)))
    else:
        print(to_markdown(results), end="")


if __name__ == "__main__":
    main()
