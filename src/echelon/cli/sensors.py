"""The ``sensors`` command."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from echelon.base.sensors import SensorReport, sensor_report
from echelon.cli.progress import steps
from echelon.cli.show import show
from echelon.errors import one_line
from echelon.formats.load import load
from echelon.seeds import DEFAULT_SEED


def run_sensors(
    robot: Path, size: int, reading: Mapping[str, Any], seed: int | None, budget: float, *, as_json: bool
) -> None:
    """Tabulate and print."""
    with steps() as step:
        title = f"comparing the sensors of {robot.name}"
        step(f"{title}: reading, and closing loops")
        report = sensor_report(
            load(robot, **reading),
            size,
            seed=DEFAULT_SEED if seed is None else seed,
            budget=budget,
            progress=lambda phase: step(f"{title}: {phase}"),
        )
    show(_json(report) if as_json else _text(report))


def _json(report: SensorReport) -> str:
    record = asdict(report) | {"schema": "echelon.sensors/1"}
    record["ranks"] = [{"sensors": list(subset), "rank": rank} for subset, rank in report.ranks.items()]
    record["greedy"] = [{"sensor": name, "rank": rank} for name, rank in report.greedy]
    return json.dumps(record, indent=1, ensure_ascii=False)


def _text(report: SensorReport) -> str:
    lines = [f"all {len(report.sensors)} sensors together see {report.rank} of {report.parameters} parameters", ""]
    titles = [" + ".join(one_line(name) for name in subset) for subset in report.ranks]
    width = max(map(len, ["sensors", *titles]))
    lines.append(f"{'sensors':<{width}}  rank")
    lines += [f"{title:<{width}}  {rank:>4}" for title, rank in zip(titles, report.ranks.values(), strict=True)]
    steps = ", ".join(f"{one_line(name)} → {rank}" for name, rank in report.greedy)
    kind = "smallest sufficient set" if report.proven_smallest else "sufficient set (perhaps not the smallest)"
    chosen = ", ".join(map(one_line, report.smallest)) or "none needed"
    return "\n".join([*lines, "", f"adding the most informative next: {steps or 'nothing'}", f"{kind}: {chosen}"])
