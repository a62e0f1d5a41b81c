"""Ranks of random mechanisms with loops against other mechanics with 75 digits."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import pytest

import echelon as ec
from support.described_linkage import described
from support.loop_oracle import rank
from support.random_linkages import RandomLinkage
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
