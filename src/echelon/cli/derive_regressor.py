"""``derive --regressor``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from echelon.base.derive import base_parameters
from echelon.base.linear_base import LinearBase
from echelon.base.model import BaseModel
from echelon.cli.destination import Destination, deliver
from echelon.cli.progress import progress
from echelon.formats.linear import holds_linear_model, load_linear
from echelon.formats.load import load
from echelon.seeds import DEFAULT_SEED


def run_regressor(
    robot: Path,
    language: str,
    reading: Mapping[str, Any],
    order: str,
    prefer: Sequence[str],
    output: Destination | None,
    seed: int | None,
) -> None:
    """Derive, then print or write the base regressor as formulas."""
    with progress(f"deriving {robot.name}"):
        options: dict[str, Any] = {"order": order, "prefer": prefer, "seed": DEFAULT_SEED if seed is None else seed}
        base: BaseModel | LinearBase
        if holds_linear_model(robot):
            base = base_parameters(load_linear(robot), **options)
        else:
            base = base_parameters(load(robot, **reading), **options)
        found = base.symbolic_regressor()
        text = found.latex() if language == "latex" else found.python()
    deliver(text, output)
