"""Benchmarks: start-up, robots and linkages beside numeric tools, and the cost of growing chains.

python benchmarks/bench.py            measure, print, and write benchmarks/results
python benchmarks/bench.py --json     print JSON instead of tables
python benchmarks/bench.py --quick    a smoke run that writes nothing unless --output is given
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import linkages
import measure
from report import environment, plot_chains, to_markdown
from robots import Robot, panda, published

RESULTS = Path(__file__).parent / "results"
TARGETS = (
    ("panda, symbolic lengths, closed forms", "panda", "closed_forms", 0.15),
    ("talos_full_v2, floating, closed forms", "talos_full_v2", "closed_forms", 5.0),
    ("tiago_dual, floating, closed forms", "tiago_dual", "closed_forms", 15.0),
    ("tiago_dual, floating, structure only", "tiago_dual", "structure", 1.5),
    ("four-bar linkage, closed forms", "four_bar", "closed_forms", 0.5),
    ("SR400 (arm with a parallelogram), structure only", "sr400", "structure", 0.3),
    ("SR400 (arm with a parallelogram), closed forms", "sr400", "closed_forms", 5.0),
    ("Gough–Stewart platform, structure only", "gough_stewart", "structure", 1.0),
    ("biped with rods, floating, closed forms", "biped", "closed_forms", 3.0),
)
START_UP_TARGETS = (("import echelon", 0.3), ("echelon --help", 0.5))
CHAINS = (2, 5, 10, 20, 50, 100)


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


def run(quick: bool, repeats: int, report: Callable[[str], None]) -> dict[str, Any]:
    """All measurements."""
    start_up = {name: t.as_dict() for name, t in measure.start_up(repeats, report).items()}
    rows = measure.robots(chosen_robots(quick), repeats, report)
    looped = linkages.measured(linkages.chosen_linkages(quick), repeats, report)
    chains = measure.chains(CHAINS[:2] if quick else CHAINS, repeats, report)
    return {
        "environment": environment(repeats),
        "targets": judged(start_up, rows, looped),
        "start_up": start_up,
        "robots": rows,
        "linkages": looped,
        "chains": chains,
        "chain_exponents": measure.exponents(chains),
    }


def judged(
    start_up: dict[str, dict[str, float]], rows: list[dict[str, Any]], looped: list[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Targets that this run can judge, by median."""
    by_name = {row["robot"]: row["seconds"] for row in rows} | {row["linkage"]: row["seconds"] for row in looped}
    medians = [(f"{name}, fresh process", start_up[name]["median"], limit) for name, limit in START_UP_TARGETS]
    medians += [(text, by_name[n][part]["median"], limit) for text, n, part, limit in TARGETS if n in by_name]
    return [{"target": n, "median": m, "limit": limit, "passed": m <= limit} for n, m, limit in medians]


def write(results: dict[str, Any], folder: Path) -> None:
    """Write the three files of results."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.json").write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    (folder / "bench.md").write_text(to_markdown(results), encoding="utf-8")
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
    parser = argparse.ArgumentParser(description="Benchmarks of Echelon beside a numeric tool.")
    parser.add_argument("--quick", action="store_true", help="few repeats, small robots, one linkage, short chains")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--repeats", type=int, help="repeats of every measurement (default 7, with --quick 1)")
    parser.add_argument("--output", type=Path, help="folder of the results (default benchmarks/results)")
    options = parser.parse_args()
    if importlib.util.find_spec("pinocchio") is None:
        parser.error("Pinocchio is not installed: pip install 'echelon[bench]'")
    with progress() as report:
        results = run(options.quick, options.repeats or (1 if options.quick else 7), report)
    folder = options.output or (None if options.quick else RESULTS)
    if folder is not None:
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
