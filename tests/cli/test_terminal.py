"""Tables on a terminal of 80 columns: names of outputs stay whole, units stay beside their numbers."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from echelon.cli.terminal import _differences, _scores
from echelon.identification.scores import Fit, Score, Validation

UR = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1")]


def scores(names: list[str], bias: float) -> tuple[Score, ...]:
    whole = Fit(184, 12.3456, bias, 0.0, 15.0, -50.0, 50.0)
    return tuple(Score(name, "N·m", whole, whole, whole) for name in names)


@pytest.mark.parametrize("names", [["j1", "j2"], UR])
def test_names_and_units_do_not_break(names: list[str]) -> None:
    validation = Validation("run2.csv", "validation", scores(names, 0), scores(names, 9), scores(names, 5))  # fmt: skip
    text = io.StringIO()
    console = Console(file=text, width=80)
    for table in _scores(console, validation):
        console.print(table)
    lines = text.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    for name in names:
        assert any(line.startswith(f"{name} ") and "12.35  N·m" in line for line in lines)  # fmt: skip
    models = [line for line in lines if "prior" in line]
    assert len(models) == 1
    assert ("rms" in models[0]) == (names[0] == "j1")


@pytest.mark.parametrize(("width", "tables"), [(80, 2), (120, 1)])
def test_names_do_not_break_where_robots_are_compared(width: int, tables: int) -> None:
    head = ("output", "largest", "at most", "tolerance", "gravity", "acceleration", "velocity", "effects")  # fmt: skip
    row = ("shoulder_lift_joint (N·m)", "12.7", "14.7", "0.012", "4.29", "8.71", "1.04", "0")  # fmt: skip
    output = SimpleNamespace(total=SimpleNamespace(attained=12.7), tolerance=0.012)
    found: Any = SimpleNamespace(outputs=[output], table=lambda: [head, row])
    text = io.StringIO()
    console = Console(file=text, width=width)
    for table in _differences(console, found):
        console.print(table)
    lines = text.getvalue().splitlines()
    assert [line.partition("  ")[0] for line in lines] == ["output", row[0]] * tables
    assert sorted(" ".join(lines).split()) == sorted(
        " ".join(head + row + (("output", row[0]) * (tables - 1))).split()
    )
