"""Rounded exports of exact mechanisms: their true ranks, or refusals, or doubts that name them, and never silence.

`python -m support.rounded_exports --judge` prints the same tables for any of them.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.rounded_exports.export import Export, some_exports
from support.rounded_exports.table import NAMES, build
from support.rounded_exports.truth import computed, kept
from support.rounded_exports.verdict import RIGHT, SILENT, UNNAMED, Verdict, judged, tables

SMALL = (
    "four_bar", "parallelogram", "slider_crank", "scissor_two", "remote_center", "five_bar-level", "bennett", "cardan",
    "sarrus", "spherical_four_bar", "ankle_two_rods", "three_rps",
)  # fmt: skip
"""Mechanisms of which exports take a second at most."""
FAST, ALL, SLICES = some_exports(12, seed=40, names=SMALL), some_exports(8 * len(NAMES), seed=41), 8
MANY_DIGITS, SHARE_RIGHT = 6, 0.97
"""With so many digits, nearly all exports have to be answered rightly and without a doubt."""


def judge(exports: list[Export], folder: Path) -> None:
    # a set takes longer than a rank: every sixth one
    verdicts = [judged(export, folder, sets=k % 6 == 0) for k, export in enumerate(exports)]
    print(tables(verdicts))  # noqa: T201
    assert not shown([v for v in verdicts if v.kind in (SILENT, UNNAMED)])
    precise = [v for v in verdicts if v.export.digits >= MANY_DIGITS]
    others = [v for v in precise if v.kind != RIGHT]
    assert len(others) <= (1 - SHARE_RIGHT) * len(precise), shown(others)


def shown(verdicts: list[Verdict]) -> str:
    return "\n".join(str(v) for v in verdicts)


def test_some_exports_are_right_or_say_why_not(tmp_path: Path) -> None:
    judge(FAST, tmp_path)


def test_all_mechanisms_have_a_truth() -> None:
    assert set(kept()) == set(NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("part", range(SLICES))
def test_exports_are_right_or_say_why_not(part: int, tmp_path: Path) -> None:
    judge(ALL[part::SLICES], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scissor_two", "bennett", "delta", "ankle_two_rods-floating"])
def test_truths_are_found_again(name: str) -> None:
    found = computed(build(name), seed=7)
    assert (found.freedom, found.rank) == (kept()[name]["freedom"], kept()[name]["rank"])
