"""A designed trajectory on a terminal, with rich: warnings, conditioning, limits, starts."""

from __future__ import annotations

import math

from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.errors import one_line
from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.logs.finding import Severity

_LIMITS = 16
"""Limits that are listed, the nearest first; all are in trajectory.json and on the preview page."""


def print_trajectory(found: ExcitingTrajectory) -> None:
    """Print what a user needs to know before opening the preview."""
    console = Console()
    console.print(Text(_headline(found), style="bold"))
    for finding in found.findings:
        style = "yellow" if finding.severity is Severity.WARNING else "dim"
        console.print(Text(f"{finding.severity.value}: {one_line(str(finding))}", style=style))
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
        return f"all {len(found.margins)} limits are kept at every time"
    more = f" and {len(broken) - 6} more" if len(broken) > 6 else ""
    return f"broken limits: {', '.join(map(one_line, broken[:6]))}{more}"


def _headline(found: ExcitingTrajectory) -> str:
    name, trajectory = one_line(found.base.mechanism.name), found.trajectory
    moving = f"{len(trajectory.coordinates)} coordinates move for {trajectory.duration:g} s"
    return f"{name}: {moving} and show {found.base.rank} base parameters"


def _limits(found: ExcitingTrajectory) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("limit", "reaches", "allowed", "margin", "unit"):
        table.add_column(column, justify="left" if column in ("limit", "unit") else "right", overflow="fold")
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
