"""The ``check`` command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import Any

from echelon.cli.screen import json_text, say_time, show, steps
from echelon.errors import one_line
from echelon.identification.first_look import FirstLook, first_look
from echelon.identification.result import limited
from echelon.logs.columns.column_map import ColumnMap
from echelon.logs.finding import counted
from echelon.setup.logs import with_logs
from echelon.setup.setup import load_setup


def run_check(setup_file: Path, logs: Sequence[Path], read: Mapping[str, Any], *, as_json: bool) -> None:
    """Look at logs and print what they can show, and what is missing."""
    started = perf_counter()
    with steps("looking at the logs"):
        setup, paths, _ = with_logs(load_setup(setup_file, **read), logs, ())
        found = first_look(setup, paths)
    if as_json:
        show(json_text(_record(found)))
        return
    for line in (*setup.assumed, *_lines(found, len(paths))):
        show(one_line(line))
    say_time(started)


def _lines(found: FirstLook, logs: int) -> Iterator[str]:
    of, seen = found.base.mechanism, found.conditioning
    outputs = counted(len(of.outputs), "output")
    looked = f"{found.seconds:.4g} s of {counted(logs, 'log')} looked at"
    yield f"{of.name}: {counted(found.base.rank, 'base parameter')}, {outputs}; {looked}"
    for columns in found.survey.columns:
        yield from _columns(columns)
    for finding in limited(found.survey.findings):
        yield f"{finding.severity.value}: {finding}"
    for travel in found.travels:
        speed = f", up to {travel.speed:.3g}/s" if isfinite(travel.speed) else ""
        yield f"{travel.coordinate}: from {travel.low:.4g} to {travel.high:.4g}{speed}"
    for name, reason in found.survey.preparation.reasons.items():
        yield f"{name.replace('_', ' ')}: {reason}"
    yield seen.verdict
    for text in found.missing:
        yield f"missing: {text}"


def _columns(columns: ColumnMap) -> Iterator[str]:
    for kind, channels in columns.channels.items():
        if channels:
            shown = ", ".join(f"{name} ← '{channel.column}'" for name, channel in channels.items())
            yield f"{kind}: {shown}"


def _record(found: FirstLook) -> dict[str, Any]:
    seen = found.conditioning
    return {
        "schema": "echelon.check/1",
        "robot": found.base.mechanism.name,
        "base_parameters": found.base.rank,
        "determined": seen.rank,
        "seconds": found.seconds,
        "columns": [asdict(columns) for columns in found.survey.columns],
        "travels": [asdict(travel) for travel in found.travels],
        "preparation": dict(found.survey.preparation.reasons),
        "findings": [asdict(finding) for finding in limited(found.survey.findings)],
        "verdict": seen.verdict,
        "missing": list(found.missing),
    }
