"""Terminal output of the ``excite`` and ``check-trajectory`` commands."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.cli.screen import say_time, say_written, show
from echelon.cli.terminal import plain_table, print_findings
from echelon.excite import ExcitingTrajectory, design_to_json, when_kept
from echelon.shared import one_line


def say(
    found: ExcitingTrajectory, paths: Sequence[Path], started: float, *, as_json: bool
) -> None:
    """Print the summary of a trajectory, as JSON or on a terminal."""
    if as_json:
        document = {**design_to_json(found), "files": [str(path) for path in paths]}
        show(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))
        return
    print_trajectory(found)
    say_written(paths)
    say_time(started)


_LIMITS = 16  # limits that are listed, the nearest first; all are in trajectory.json and on the preview page


def print_trajectory(found: ExcitingTrajectory) -> None:
    """Print what a user needs to know before opening the preview."""
    console = Console()
    console.print(Text(_headline(found), style="bold"))
    print_findings(console, found.findings)
    console.print(_limits(found))
    if found.starts:
        console.print(Text(_starts(found)))
    console.print(Text(_conditioning(found)))
    kept = "bold yellow" if found.unchecked else "bold green"
    style = kept if found.safe else "bold red"
    console.print(Text(verdict(found), style=style))


def verdict(found: ExcitingTrajectory) -> str:
    """Whether all limits are kept, in a sentence."""
    broken = [margin.label for margin in found.margins if not margin.kept]
    if not broken:
        kept = f"all {len(found.margins)} limits are kept {when_kept(found.margins)}"
        return one_line("; ".join((kept, *found.unchecked)))
    more = f" and {len(broken) - 6} more" if len(broken) > 6 else ""
    return f"broken limits: {', '.join(map(one_line, broken[:6]))}{more}"


def _headline(found: ExcitingTrajectory) -> str:
    name, trajectory = one_line(found.base.mechanism.name), found.trajectory
    moving = (
        f"{len(trajectory.coordinates)} coordinates move for {trajectory.duration:g} s"
    )
    return f"{name}: {moving} and show {found.base.rank} base parameters"


def _limits(found: ExcitingTrajectory) -> Table:
    is_sampled = any(margin.sampled for margin in found.margins)
    # enclosures of all times are a little wider than what is attained
    range_ = "reaches" if is_sampled else "stays within"
    table = plain_table(
        "limit", range_, "allowed", "margin", "unit", left=("limit", "unit")
    )
    nearest = sorted(found.margins, key=lambda margin: margin.relative)
    for margin in nearest[:_LIMITS]:
        style = "" if margin.kept else "bold red"
        cells = (
            _range(margin.least, margin.largest),
            _range(margin.low, margin.high),
            f"{margin.relative:.2%}",
        )
        table.add_row(
            Text(one_line(margin.label)),
            *cells,
            Text(one_line(margin.unit)),
            style=style,
        )
    if len(nearest) > _LIMITS:
        table.add_row(Text(f"… and {len(nearest) - _LIMITS} more"), "", "", "", "")
    return table


def _range(low: float, high: float) -> Text:
    if not math.isfinite(high):
        return Text(f"≥ {low:.4g}")
    if not math.isfinite(low):
        return Text(f"≤ {high:.4g}")
    return Text(f"{low:.4g} … {high:.4g}")


def _starts(found: ExcitingTrajectory) -> str:
    """How each start ended."""
    words = {"iterations": "ended", "budget": "ended by the budget"}
    done = [
        f"{words.get(start.status, start.status)} after {start.iterations} iterations"
        for start in found.starts
    ]
    return f"starts: {'; '.join(done)}"


def _conditioning(found: ExcitingTrajectory) -> str:
    shown = found.conditioning
    names = {
        "d_optimal": "D-optimal",
        "a_optimal": "A-optimal",
        "condition": "smallest condition number",
    }
    numbers = f"condition number {shown.condition:.3g}; log det of the information {shown.log_det:.5g}"
    text = f"criterion: {names[found.criterion]}; {numbers}\n{_figures(shown.scaled_condition, max(shown.std))}"
    worst = one_line(found.base.expressions[shown.worst].name)
    text += f" {one_line(found.base.units[shown.worst])} ({worst})"
    if found.chance is None:
        return text
    by_chance = _figures(found.chance.scaled_condition, found.chance.worst_std)
    return f"{text}\nbest of {found.chance.count} random motions: {by_chance}"


def _figures(scaled_condition: float, worst_std: float) -> str:
    return f"scaled condition number {scaled_condition:.3g}, worst standard deviation {worst_std:.3g}"
