"""Tables on a terminal of 80 columns: names of outputs stay whole, units stay beside their numbers."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from echelon.cli.terminal import _scores
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
