"""The ``excite`` and ``check-trajectory`` commands, and what they say on a terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.cli.destination import Destination
from echelon.cli.screen import say_time, say_written, show, steps
from echelon.cli.terminal import plain_table, print_findings
from echelon.errors import one_line
from echelon.excite.excite import ExcitingTrajectory, exciting_trajectory, judged_trajectory
from echelon.excite.files.coefficients import text_of
from echelon.excite.files.trajectory_file import design_to_json, read_trajectory, trajectory_content
from echelon.excite.problem.prior_model import information_of_logs
from echelon.excite.problem.task import UNCHECKED, task_of
from echelon.excite.problem.task import changed as changed_entry
from echelon.excite.verify.margins import when_kept
from echelon.report.preview import preview_html
from echelon.setup.setup import load_setup

TRAJECTORY, PREVIEW = "trajectory.json", "preview.html"
BROKEN = 1
"""Exit code where a limit is broken."""


def run_excite(
    setup_path: Path,
    reading: Mapping[str, Any],
    prior: Path | None,
    changed: Mapping[str, Any],
    logs: Sequence[Path],
    jobs: int | None,
    output: Destination | None,
    samples: tuple[Sequence[str], float, int],
    *,
    as_json: bool,
) -> None:
    """Design a trajectory, write all files, and print the summary; samples have formats, a rate and repeats."""
    started, (formats, rate, repeats) = perf_counter(), samples
    if output is not None:
        output.check((TRAJECTORY, PREVIEW, *(f"trajectory.{name}" for name in formats)))
    setup = load_setup(setup_path, prior=prior, **reading)
    with steps() as step:
        step("reading logs")
        information = information_of_logs(setup, logs) if logs else None
        found = exciting_trajectory(setup, prior_information=information, jobs=jobs, on_step=step, **changed)
        step("writing")
        # nothing is written unless all of it can be
        files: dict[str, str | bytes] = {}
        if output is not None:
            files = {TRAJECTORY: text_of(design_to_json(found)), PREVIEW: preview_html(found)}
            for kind in (f".{name}" for name in formats):
                files[f"trajectory{kind}"] = trajectory_content(found.trajectory, kind, rate, repeats)
    _say(found, [] if output is None else output.write_into(files), started, as_json=as_json)


def run_check(
    setup_path: Path,
    reading: Mapping[str, Any],
    prior: Path | None,
    changed: Mapping[str, Any],
    path: Path,
    output: Destination | None,
    *,
    as_json: bool,
) -> None:
    """Judge a trajectory made elsewhere; exit with 1 if it breaks a limit."""
    started = perf_counter()
    setup = load_setup(setup_path, prior=prior, **reading)
    with steps() as step:
        step("reading")
        task = task_of(setup, changed_entry(setup.excitation, changed, setup.source))
        trajectory = read_trajectory(path, task.mechanism.independent_velocities, task.units)
        step("checking all limits")
        found = judged_trajectory(setup, trajectory, **changed)
    if output is not None:
        output.write(preview_html(found))
    _say(found, [] if output is None else [output.path], started, as_json=as_json)
    if not found.safe:
        raise typer.Exit(BROKEN)


def _say(found: ExcitingTrajectory, paths: Sequence[Path], started: float, *, as_json: bool) -> None:
    if as_json:
        document = {**design_to_json(found), "files": [str(path) for path in paths]}
        show(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))
        return
    print_trajectory(found)
    say_written(paths)
    say_time(started)


# -- on a terminal -----------------------------------------------------------------------------------------------------

_LIMITS = 16
"""Limits that are listed, the nearest first; all are in trajectory.json and on the preview page."""


def print_trajectory(found: ExcitingTrajectory) -> None:
    """Print what a user needs to know before opening the preview."""
    console = Console()
    console.print(Text(_headline(found), style="bold"))
    print_findings(console, found.findings)
    console.print(_limits(found))
    if found.starts:
        console.print(Text(_starts(found)))
    console.print(Text(_conditioning(found)))
    style = "bold green" if found.safe else "bold red"
    console.print(Text(verdict(found), style=style))


def verdict(found: ExcitingTrajectory) -> str:
    """Whether all limits are kept, in a sentence."""
    broken = [margin.label for margin in found.margins if not margin.kept]
    if not broken:
        untouched = any(finding.text.startswith(UNCHECKED) for finding in found.findings)
        kept = f"all {len(found.margins)} limits are kept {when_kept(found.margins)}"
        return f"{kept}; whether bodies touch was not looked at" if untouched else kept
    more = f" and {len(broken) - 6} more" if len(broken) > 6 else ""
    return f"broken limits: {', '.join(map(one_line, broken[:6]))}{more}"


def _headline(found: ExcitingTrajectory) -> str:
    name, trajectory = one_line(found.base.mechanism.name), found.trajectory
    moving = f"{len(trajectory.coordinates)} coordinates move for {trajectory.duration:g} s"
    return f"{name}: {moving} and show {found.base.rank} base parameters"


def _limits(found: ExcitingTrajectory) -> Table:
    table = plain_table("limit", "reaches", "allowed", "margin", "unit", left=("limit", "unit"))
    nearest = sorted(found.margins, key=lambda margin: margin.relative)
    for margin in nearest[:_LIMITS]:
        style = "" if margin.kept else "bold red"
        cells = (_range(margin.least, margin.largest), _range(margin.low, margin.high), f"{margin.relative:.2%}")
        table.add_row(Text(one_line(margin.label)), *cells, Text(one_line(margin.unit)), style=style)
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
    done = [f"{start.status} after {start.iterations} iterations" for start in found.starts]
    return f"starts: {'; '.join(done)}"


def _conditioning(found: ExcitingTrajectory) -> str:
    shown, names = (
        found.conditioning,
        {"d_optimal": "D-optimal", "a_optimal": "A-optimal", "condition": "condition number"},
    )
    numbers = f"condition number {shown.condition:.3g}, with scaled columns {shown.scaled_condition:.3g}"
    return f"{names[found.criterion]}; {numbers}; log det of the information {shown.log_det:.5g}"
