"""The ``derive`` command."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from echelon.base.derive import base_parameters
from echelon.base.display import to_latex, to_markdown, to_text
from echelon.base.model import BaseModel
from echelon.base.own import OwnAnswer, own_answer
from echelon.base.reading_report import MimicRanks, mechanism_notes, mimic_ranks
from echelon.cli.destination import Destination, deliver
from echelon.cli.progress import say_time, steps
from echelon.cli.show import show
from echelon.errors import one_line
from echelon.formats.linear import holds_linear_model
from echelon.formats.load import load
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import all_symbols
from echelon.regressor.loops.assembled import Assembled
from echelon.regressor.loops.closing import assembled
from echelon.results.saved import to_json
from echelon.seeds import DEFAULT_SEED, random_generator


@dataclass(frozen=True)
class DeriveRequest:
    """Arguments of the command."""

    robot: Path
    output_format: str
    output: Destination | None
    reading: Mapping[str, Any]
    order: str
    prefer: tuple[str, ...]
    structure: bool
    generic: bool
    seed: int | None
    budget: float


def run_derive(request: DeriveRequest) -> None:
    """Derive, then print or write."""
    seed = DEFAULT_SEED if request.seed is None else request.seed
    started = perf_counter()
    with steps() as step:
        step(f"deriving {request.robot.name}")
        if holds_linear_model(request.robot):
            _write_linear(request, seed, started)
            return
        step(f"deriving {request.robot.name}: reading, and closing loops")
        robot = load(request.robot, **request.reading)
        if request.structure:
            rng = random_generator(seed)
            answer = own_answer(robot, rng, generic=request.generic)
            rank = answer.structure.rank if answer.special is None else answer.special.rank
            mimics, moved = mimic_ranks(robot, rank, rng), assembled(robot)
            text = _structure_text(answer, mimics, moved, seed, as_json=request.output_format == "json")
            model = None
        else:
            model = base_parameters(
                robot,
                order=request.order,
                prefer=request.prefer,
                generic=request.generic,
                seed=seed,
                budget=_budget(request, robot),
                progress=lambda phase: step(f"deriving {request.robot.name}: {phase}"),
            )
            text = _render(model, request.output_format)
    if request.output is not None:
        request.output.write(text)
    elif model is not None and request.output_format == "text" and sys.stdout.isatty():
        from echelon.cli.terminal import print_model

        print_model(model)
    else:
        show(text)
    if request.output is None and request.output_format == "text":
        say_time(started)


def _budget(request: DeriveRequest, robot: Mechanism) -> float:
    """No budget where numbers are asked for throughout and angles without exact sines are left as symbols."""
    left = all_symbols(robot)
    stated = all(name in robot.symbols and robot.symbols[name].value is not None for name in left)
    in_balls = left and stated and not request.generic
    return 0.0 if in_balls and not request.reading.get("symbolic", True) else request.budget


def _write_linear(request: DeriveRequest, seed: int, started: float) -> None:
    from echelon.cli.derive_linear import linear_text

    text = linear_text(
        request.robot,
        request.output_format,
        request.order,
        request.prefer,
        seed,
        request.budget,
        structure=request.structure,
        generic=request.generic,
    )
    deliver(text, request.output)
    if request.output is None and request.output_format == "text":
        say_time(started)


def _render(model: BaseModel, output_format: str) -> str:
    if output_format == "text":
        return to_text(model) + "\n"
    return {"json": to_json, "latex": to_latex, "markdown": to_markdown}[output_format](model)


def _structure_text(
    answer: OwnAnswer, mimics: MimicRanks | None, moved: Assembled | None, seed: int, *, as_json: bool
) -> str:
    robot, structure = answer.mechanism, answer.structure
    names = [robot.parameters[p] for p in structure.pivots]
    if as_json:
        record: dict[str, Any] = {
            "schema": "echelon.structure/1",
            "name": robot.name,
            "seed": seed,
            "rank": structure.rank,
            "parameters": list(robot.parameters),
            "representatives": names,
        }
        if answer.special is not None:
            record["special"] = asdict(answer.special)
        if structure.modes:
            record["modes"] = list(structure.modes)
        if mimics is not None:
            record["mimics"] = asdict(mimics)
        if moved is not None:
            record["assembled"] = asdict(moved)
        return json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    count = f"{robot.name}: {structure.rank} base parameters of {structure.parameters} standard parameters"
    lines = [one_line(count), f"representatives: {one_line(' '.join(names))}"]
    if answer.special is not None:
        lines.append(f"stated values: {one_line(answer.special.text('robot'))}")
    if mimics is not None:
        lines.append(f"mimic joints: {mimics}")
    if moved is not None:
        lines.append(f"assembly pose: {one_line(str(moved))}")
    lines += [f"note: {one_line(note)}" for note in mechanism_notes(robot)]
    if answer.undecided:
        lines.append(f"doubt: {one_line(answer.undecided)}")
    if len(structure.modes) > 1:
        ranks = ", ".join(map(str, structure.modes))
        lines.append(f"assembly modes: base parameters {ranks}; this is the one with {structure.rank}")
    return "\n".join(lines) + "\n"
