"""Ranks of random mechanisms with loops against other mechanics with 75 digits."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import pytest

import echelon as ec
from support.described_linkage import described
from support.loop_oracle import rank
from support.random_linkages import RandomLinkage, in_random_frames, may_be_turned
from support.selection import slow_unless

SAID = "leave no motion|can move infinitesimally, but not really|the assembly pose is singular"


def answer(file: Path) -> tuple[int, int] | str:
    """Degrees of freedom and rank, or why there is no answer without a doubt."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", ec.DoubtWarning)
            mechanism = ec.load(file)
            return mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank
    except (ec.InputError, ec.DoubtWarning) as said:
        return str(said)


@pytest.mark.parametrize("seed", slow_unless(range(10), range(160)))
def test_the_rank_is_that_of_closed_states(seed: int, tmp_path: Path) -> None:
    """What is not refused as locked, or doubted because more motions are possible at zero, is right."""
    text, file = RandomLinkage(seed).text(), tmp_path / "robot.yaml"
    file.write_text(f"echelon: 1\n{text}", encoding="utf-8")
    found = answer(file)
    if isinstance(found, str):
        assert re.search(SAID, found)
    else:
        truth = rank(described(text))
        assert found == (truth.freedom, truth.rank)


FRAMED = [seed for seed in range(160) if may_be_turned(RandomLinkage(seed).text())]
ROUNDED = f"{SAID}|nearly allow a motion|hardly show"


@pytest.mark.parametrize("seed", slow_unless(FRAMED[:5], FRAMED))
def test_rounded_numbers_in_random_frames_are_read_as_they_are_meant(seed: int, tmp_path: Path) -> None:
    text, file = RandomLinkage(seed).text(), tmp_path / "robot.yaml"
    file.write_text(f"echelon: 1\n{in_random_frames(text, seed, 6)}", encoding="utf-8")
    found = answer(file)
    if isinstance(found, str):
        assert re.search(ROUNDED, found)
    else:
        truth = rank(described(text))
        assert found == (truth.freedom, truth.rank)
