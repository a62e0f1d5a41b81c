"""``derive --special``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from echelon.base.special import special_geometry
from echelon.cli.destination import Destination, deliver
from echelon.cli.progress import progress
from echelon.errors import one_line
from echelon.formats.load import load
from echelon.seeds import DEFAULT_SEED


def run_special(
    robot: Path, reading: Mapping[str, Any], output: Destination | None, seed: int | None, *, as_json: bool
) -> None:
    """Try special geometries, then print or write where the rank changes."""
    with progress(f"trying special geometries of {robot.name}"):
        mechanism = load(robot, **reading)
        found = special_geometry(mechanism, seed=DEFAULT_SEED if seed is None else seed)
    if as_json:
        text = json.dumps({"schema": "echelon.special/1", "name": mechanism.name, **asdict(found)}, indent=1)
    else:
        lines = [f"{one_line(mechanism.name)}: {found.rank} base parameters for generic values of its symbols"]
        width = max((len(case.condition) for case in found.cases), default=0)
        lines += [f"  {one_line(case.condition):<{width}}  {case.rank}" for case in found.cases]
        lines.append(f"{found.tried} conditions tried, one or two at a time; {len(found.cases)} change the number")
        if found.left_out:
            lines.append(f"{found.left_out} pairs of conditions were not tried")
        text = "\n".join(lines)
    deliver(text + "\n", output)
