"""The ``derive`` command: base parameters in closed form, of robots and of linear models."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

from echelon.base.derive import base_parameters
from echelon.base.display import to_latex, to_markdown, to_text
from echelon.base.linear_base import LinearBase
from echelon.base.model import BaseModel
from echelon.cli.destination import Destination, deliver
from echelon.cli.screen import say_time, steps
from echelon.formats.robot_file import load_model
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import all_symbols
from echelon.models.linear_model import LinearModel
from echelon.results.saved import to_json
from echelon.seeds import DEFAULT_SEED


def run_derive(
    file: Path,
    output_format: str,
    read: Mapping[str, Any],
    derivation: Mapping[str, Any],
    output: Destination | None,
    seed: int | None,
    budget: float,
) -> None:
    """Derive, then print or write."""
    started = perf_counter()
    title = f"deriving {file.name}"
    with steps(title) as step:
        base = _base(file, read, {**derivation, "seed": _seed(seed)}, budget, lambda phase: step(f"{title}: {phase}"))
        text = _rendered(base, output_format)
    on_terminal = output is None and output_format == "text"
    if on_terminal and isinstance(base, BaseModel) and sys.stdout.isatty():
        from echelon.cli.terminal import print_model

        print_model(base)
    else:
        deliver(text, output)
    if on_terminal:
        say_time(started)


def run_regressor(
    file: Path,
    language: str,
    read: Mapping[str, Any],
    derivation: Mapping[str, Any],
    output: Destination | None,
    seed: int | None,
) -> None:
    """Derive, then print or write the base regressor as formulas."""
    with steps(title := f"deriving {file.name}") as step:
        base = _base(file, read, {**derivation, "seed": _seed(seed)}, 1.0, lambda phase: step(f"{title}: {phase}"))
        found = base.symbolic_regressor()
        text = found.latex() if language == "latex" else found.python()
    deliver(text, output)


def _seed(seed: int | None) -> int:
    return DEFAULT_SEED if seed is None else seed


def _base(
    file: Path, read: Mapping[str, Any], derivation: Mapping[str, Any], budget: float, say: Callable[[str], None]
) -> BaseModel | LinearBase:
    say("reading, and closing loops")
    robot = load_model(file, **read)
    if isinstance(robot, LinearModel):
        return base_parameters(robot, **derivation, budget=budget)
    if _numbers_in_balls(robot, symbolic=read["symbolic"], generic=derivation.get("generic", False)):
        budget = 0.0
    return base_parameters(robot, **derivation, budget=budget, progress=say)


def _numbers_in_balls(robot: Mechanism, *, symbolic: bool, generic: bool) -> bool:
    """Whether numbers are asked for throughout, and angles without exact sines are left as symbols."""
    left = all_symbols(robot)
    stated = all(name in robot.symbols and robot.symbols[name].value is not None for name in left)
    return bool(left) and stated and not generic and not symbolic


def _rendered(base: BaseModel | LinearBase, output_format: str) -> str:
    if output_format == "json":
        return to_json(base)
    if output_format == "text":
        return to_text(base) + "\n"
    return to_latex(base) if output_format == "latex" else to_markdown(base)
