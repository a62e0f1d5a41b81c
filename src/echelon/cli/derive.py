"""The ``derive`` command in all its forms, and ``sensors``: closed forms, formulas, and what only counts."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from echelon.base import BaseModel, LinearBase, base_parameters, to_text
from echelon.cli.destination import Destination, deliver
from echelon.cli.screen import json_text, say_time, steps
from echelon.dynamics import LinearModel
from echelon.formats import load, load_model
from echelon.robot import Assembled, Mechanism, all_symbols
from echelon.shared import InputError, one_line

if TYPE_CHECKING:
    from echelon.base import (
        MimicRanks,
        NumericComparison,
        SensorReport,
        SpecialGeometry,
        SpecialisedMechanism,
    )
    from echelon.excite import SampledRank


def run_derive(
    file: Path,
    output_format: str,
    regressor: str | None,
    read: Mapping[str, Any],
    derivation: Mapping[str, Any],
    output: Destination | None,
    seed: int,
    budget: float,
    *,
    full: bool,
) -> None:
    """Derive, then print or write; of a regressor, which is ``latex`` or ``sympy``, its formulas instead."""
    started = perf_counter()
    title = f"deriving {file.name}"
    with steps(title) as step:
        base = _base(
            file,
            read,
            {**derivation, "seed": seed},
            budget,
            lambda phase: step(f"{title}: {phase}"),
        )
        text = _rendered(
            base,
            output_format if regressor is None else f"regressor as {regressor}",
            full=full,
        )
    on_terminal = output is None and output_format == "text" and regressor is None
    if on_terminal and isinstance(base, BaseModel) and sys.stdout.isatty():
        from echelon.cli.terminal import print_model

        print_model(base, full=full)
    else:
        deliver(text, output)
    if on_terminal:
        say_time(started)


def _base(
    file: Path,
    read: Mapping[str, Any],
    derivation: Mapping[str, Any],
    budget: float,
    say: Callable[[str], None],
) -> BaseModel | LinearBase:
    say("reading robot")
    robot = load_model(file, **read)
    if isinstance(robot, LinearModel):
        return base_parameters(robot, **derivation, budget=budget)
    if _numbers_in_balls(
        robot, symbolic=read["symbolic"], generic=derivation.get("generic", False)
    ):
        budget = 0.0
    return base_parameters(robot, **derivation, budget=budget, progress=say)


def _numbers_in_balls(robot: Mechanism, *, symbolic: bool, generic: bool) -> bool:
    """Whether numbers are asked for throughout, and angles without exact sines are left as symbols."""
    left = all_symbols(robot)
    stated = all(
        name in robot.symbols and robot.symbols[name].value is not None for name in left
    )
    return bool(left) and stated and not generic and not symbolic


def _rendered(base: BaseModel | LinearBase, output_format: str, *, full: bool) -> str:
    if output_format == "text":
        return to_text(base, full=full) + "\n"
    # what the others need is not imported for the most frequent one
    from echelon.base import to_json, to_latex, to_markdown

    if output_format == "json":
        return to_json(base)
    if output_format.startswith("regressor"):
        formulas = base.symbolic_regressor()
        if output_format.endswith("latex"):
            return formulas.latex()
        return formulas.python()
    if output_format == "latex":
        return to_latex(base, full=full)
    return to_markdown(base, full=full)


Read = Mapping[str, Any]  # keyword arguments of ``echelon.load``


def run_rank_only(
    file: Path,
    read: Read,
    output: Destination | None,
    seed: int,
    *,
    generic: bool,
    as_json: bool,
) -> None:
    """Print or write the rank and the representatives."""
    from echelon.algebra import random_generator
    from echelon.base import mimic_ranks, moved_to_close, specialised

    with steps(f"deriving {file.name}"):
        robot, rng = load_model(file, **read), random_generator(seed)
        if isinstance(robot, LinearModel):
            raise InputError(
                "--rank-only is for robots; a linear model is always derived in closed form"
            )
        answer = specialised(robot, rng, generic=generic)
        rank = answer.structure.rank if answer.special is None else answer.special.rank
        mimics, moved = mimic_ranks(robot, rank, rng), moved_to_close(robot)
    deliver(
        _rank_json(answer, mimics, moved, seed)
        if as_json
        else _rank_text(answer, mimics, moved),
        output,
    )


def _rank_json(
    answer: SpecialisedMechanism,
    mimics: MimicRanks | None,
    moved: Assembled | None,
    seed: int,
) -> str:
    robot, structure = answer.mechanism, answer.structure
    optional = {
        "special": answer.special and asdict(answer.special),
        "mimics": mimics and asdict(mimics),
        "assembled": moved and asdict(moved),
    }
    return json_text(
        {
            "schema": "echelon.structure/1",
            "name": robot.name,
            "seed": seed,
            "rank": structure.rank,
            "parameters": list(robot.parameters),
            "representatives": [robot.parameters[p] for p in structure.pivots],
            **{name: value for name, value in optional.items() if value is not None},
        }
    )


def _rank_text(
    answer: SpecialisedMechanism, mimics: MimicRanks | None, moved: Assembled | None
) -> str:
    from echelon.base import doubt_of_loops, mechanism_notes

    robot, structure = answer.mechanism, answer.structure
    lines = [
        f"{robot.name}: {structure.rank} base parameters of {structure.parameters} standard parameters",
        f"representatives: {' '.join(robot.parameters[p] for p in structure.pivots)}",
    ]
    if answer.special is not None:
        lines.append(f"stated values: {answer.special.text('robot')}")
    if mimics is not None:
        lines.append(f"mimic joints: {mimics}")
    if moved is not None:
        lines.append(f"assembly pose: {moved}")
    lines += [f"note: {note}" for note in mechanism_notes(robot)]
    if structure.spectrum is not None and structure.spectrum.note:
        lines.append(f"note: {structure.spectrum.note}")
    if doubt := answer.doubt or doubt_of_loops(robot):
        lines.append(f"doubt: {doubt}")
    return "".join(f"{one_line(line)}\n" for line in lines)


def run_special(
    file: Path, read: Read, output: Destination | None, seed: int, *, as_json: bool
) -> None:
    """Try special geometries, then print or write where the rank changes."""
    from echelon.base import special_geometry

    with steps(f"trying special geometries of {file.name}"):
        robot = load(file, **read)
        found = special_geometry(robot, seed=seed)
    record = {"schema": "echelon.special/1", "name": robot.name, **asdict(found)}
    deliver(json_text(record) if as_json else _special_text(robot.name, found), output)


def _special_text(name: str, found: SpecialGeometry) -> str:
    lines = [
        f"{one_line(name)}: {found.rank} base parameters for generic values of its symbols"
    ]
    width = max((len(case.condition) for case in found.cases), default=0)
    lines += [
        f"  {one_line(case.condition):<{width}}  {case.rank}" for case in found.cases
    ]
    lines.append(
        f"{found.tried} conditions tried, one or two at a time; {len(found.cases)} change the number"
    )
    if found.left_out:
        lines.append(f"{found.left_out} pairs of conditions were not tried")
    return "\n".join(lines) + "\n"


def run_compare_numeric(
    file: Path, read: Read, output: Destination | None, seed: int, *, as_json: bool
) -> None:
    """Count exactly and numerically, then print or write."""
    from echelon.base import compare_numeric

    with steps(f"comparing ranks of {file.name}"):
        robot = load(file, **read)
        found = compare_numeric(robot, seed=seed)
    deliver(
        _comparison_json(robot.name, found)
        if as_json
        else _comparison_text(robot.name, found),
        output,
    )


def _comparison_text(name: str, found: NumericComparison) -> str:
    numeric, rank = found.numeric, found.rank
    literal = (
        f" ({found.literal_rank} for the literal numbers of the file)"
        if found.literal_rank != rank
        else ""
    )
    rows = [
        ("tolerance", [f"{t:.0e}" for t in numeric.tolerances]),
        ("singular values", [str(r) for r in numeric.ranks]),
        ("QR, pivoted", [str(r) for r in numeric.ranks_by_qr]),
    ]
    lines = [
        f"{one_line(name)}: {rank} base parameters of {numeric.columns} standard parameters{literal}"
    ]
    lines += [
        f"  {title:<16}" + "".join(f"{cell:>8}" for cell in cells)
        for title, cells in rows
    ]
    widest = numeric.widest_gap(besides=rank)
    elsewhere = (
        f"; widest elsewhere: {widest[1]:.1e} at {widest[0]}"
        if widest is not None
        else ""
    )
    lines.append(
        f"gap in the singular values at {rank}: {numeric.gap(rank):.1e}{elsewhere}"
    )
    return "\n".join([*lines, found.verdict]) + "\n"


def _comparison_json(name: str, found: NumericComparison) -> str:
    numeric, rank = found.numeric, found.rank
    widest, gap = numeric.widest_gap(besides=rank), numeric.gap(rank)
    return json_text(
        {
            "schema": "echelon.numeric/1",
            "name": name,
            "rank": rank,
            "literal_rank": found.literal_rank,
            "rows": numeric.rows,
            "tolerances": list(numeric.tolerances),
            "svd": list(numeric.ranks),
            "qr": list(numeric.ranks_by_qr),
            "gap": gap if gap < float("inf") else None,
            "widest_gap_elsewhere": None
            if widest is None
            else {"rank": widest[0], "gap": widest[1]},
            "verdict": found.verdict,
            "singular_values": list(numeric.singular),
        }
    )


def run_sensors(
    file: Path, size: int, read: Read, seed: int, budget: float, *, as_json: bool
) -> None:
    """Print what sensors see, alone and in subsets up to a size."""
    from echelon.base import sensor_report

    title = f"comparing the sensors of {file.name}"
    with steps(f"{title}: reading robot") as step:
        robot = load(file, **read)
        report = sensor_report(
            robot,
            size,
            seed=seed,
            budget=budget,
            progress=lambda phase: step(f"{title}: {phase}"),
        )
        driven = None
        if robot.reading is not None and robot.reading.file.motions:
            from echelon.excite import sampled_rank

            step(f"{title}: rows of the motions that were driven")
            driven = sampled_rank(robot, seed=seed)
    if as_json:
        deliver(_sensors_json(report, driven), None)
    else:
        motion = [] if driven is None else ["", f"driven: {driven.to_text()}"]
        deliver("\n".join([_sensors_text(report).rstrip(), *motion]) + "\n", None)


def _sensors_json(report: SensorReport, driven: SampledRank | None) -> str:
    record = asdict(report) | {"schema": "echelon.sensors/1"}
    if driven is not None:
        record["driven"] = driven.to_dict()
    record["ranks"] = [
        {"sensors": list(subset), "rank": rank} for subset, rank in report.ranks.items()
    ]
    for key, steps_taken in (("greedy", report.greedy), ("added", report.added)):
        record[key] = [{"sensor": name, "rank": rank} for name, rank in steps_taken]
    return json_text(record)


def _sensors_text(report: SensorReport) -> str:
    lines = [
        f"all {len(report.sensors)} {report.kind} together see {report.rank} of {report.parameters} parameters",
        "",
    ]
    titles = [" + ".join(one_line(name) for name in subset) for subset in report.ranks]
    width = max(map(len, [report.kind, *titles]))
    lines.append(f"{report.kind:<{width}}  rank")
    lines += [
        f"{title:<{width}}  {rank:>4}"
        for title, rank in zip(titles, report.ranks.values(), strict=True)
    ]
    added, in_order = (
        ", ".join(f"{one_line(name)} → {rank}" for name, rank in taken)
        for taken in (report.greedy, report.added)
    )
    kind = (
        "smallest sufficient set"
        if report.proven_smallest
        else f"sufficient set (a smallest one has at least {report.at_least})"
    )
    smallest = ", ".join(map(one_line, report.smallest)) or "none needed"
    lines += [
        "",
        *([f"in their order: {in_order}"] if report.kind == "experiments" else []),
        f"adding the most informative next: {added or 'nothing'}",
        f"{kind}: {smallest}",
    ]
    return "\n".join(lines) + "\n"
