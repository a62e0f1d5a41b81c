"""Exact ranks beside numeric ones, and the verdict in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import echelon as ec
from echelon.base.numeric_comparison import NumericComparison, compare_numeric
from echelon.base.numeric_ranks import NumericRanks
from echelon.cli.commands import app
from support.paths import ROOT
from support.robot_files import robot_file


def planted(rank: int, literal: int, *singular: float) -> NumericComparison:
    return NumericComparison(
        rank,
        literal,
        NumericRanks(len(singular), 40, (1e-6, 1e-12), singular, singular),
    )


@pytest.mark.parametrize(
    ("found", "right", "words"),
    [
        (
            planted(2, 2, 1.0, 0.5, 1e-15),
            (1e-6, 1e-12),
            "right here, at every tolerance",
        ),
        (
            planted(2, 2, 1.0, 0.5, 1e-9),
            (1e-6,),
            "at 1e-06 only: the tolerance must lie between 1.0e-09 and",
        ),
        (
            planted(1, 2, 1.0, 0.5, 1e-15),
            (),
            "wrong at every tolerance: rounded numbers in the file give 2",
        ),
        (
            planted(2, 2, 1.0, 1e-9, 1e-10),
            (),
            "the widest gap is a ratio of 1e+09 at 1, beside 1e+01 at 2",
        ),
    ],
)
def test_verdicts(
    found: NumericComparison, right: tuple[float, ...], words: str
) -> None:
    assert found.right == right
    assert words in found.verdict


def test_the_file_that_rounds_its_angles() -> None:
    found = compare_numeric(ec.load(robot_file("so100")))
    assert (found.rank, found.literal_rank) == (36, 38)
    assert found.numeric.ranks[0] == 38
    assert "rounded numbers in the file give 38" in found.verdict


def test_command(tmp_path: Path) -> None:
    pendulum = str(ROOT / "examples/double_pendulum.yaml")
    done = CliRunner().invoke(app, ["derive", pendulum, "--compare-numeric"])
    assert done.exit_code == 0
    assert done.stdout.startswith(
        "double pendulum: 6 base parameters of 20 standard parameters\n"
    )
    assert done.stdout.endswith("a numeric rank is right here, at every tolerance\n")
    file = tmp_path / "numeric.json"
    assert (
        CliRunner()
        .invoke(
            app, ["derive", pendulum, "--compare-numeric", "--json", "-o", str(file)]
        )
        .exit_code
        == 0
    )
    record = json.loads(file.read_text())
    assert (record["rank"], record["svd"], record["qr"]) == (6, [6] * 4, [6] * 4)
    assert record["gap"] > 1e10
    assert len(record["singular_values"]) == 20


def test_command_takes_no_other_choice() -> None:
    pendulum = str(ROOT / "examples/double_pendulum.yaml")
    assert (
        CliRunner()
        .invoke(app, ["derive", pendulum, "--compare-numeric", "--rank-only"])
        .exit_code
        == 2
    )
