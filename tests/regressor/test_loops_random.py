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
from support.rounded_exports.verdict import names
from support.selection import slow_unless

SEEDS = range(160)
FRAMED = [seed for seed in SEEDS if may_be_turned(RandomLinkage(seed).text())]
SAID = (
    dict.fromkeys(
        (6, 9, 33, 63, 93, 94, 96, 107, 142),
        "can move infinitesimally, but not really|not proved to close",
    )
    | dict.fromkeys((74, 150), "leave no motion")
    | {41: "last decimals do not decide"}
    | dict.fromkeys(
        (32, 52), "the assembly pose is singular, .* state a pose away from it"
    )
    | dict.fromkeys((15, 47), "follows from the others .*  Write  independent: ")
    | {129: "can move infinitesimally, but not really"}
    | dict.fromkeys(
        (
            13,
            28,
            39,
            43,
            48,
            68,
            85,
            90,
            99,
            100,
            101,
            102,
            111,
            114,
            117,
            137,
            139,
            149,
        ),
        "constrain no joint: leave them out",
    )
)
"""What is said of linkages that are locked, move in more ways at zero than near it, or have loops that hold nothing."""
SAID_OF_ROUNDED = (
    SAID
    | {18: "0 coordinates are independent", 55: "last decimals do not decide"}
    | dict.fromkeys((113, 146), "constrain no joint: leave them out")
)
"""With six digits the first of these seems locked, and the second to show more."""


def answer(file: Path) -> tuple[int, int] | str:
    """Degrees of freedom and rank, or why there is no answer without a doubt."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", ec.DoubtWarning)
            mechanism = ec.load(file)
            return mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank
    except (ec.EchelonError, ec.DoubtWarning) as said:
        return str(said)


def check(text: str, exact: str, file: Path, said: str | None) -> None:
    """The answer to a description is that of other mechanics to the exact one, unless something is said instead."""
    file.write_text(f"echelon: 1\n{text}", encoding="utf-8")
    found = answer(file)
    if said is not None:
        assert isinstance(found, str)
        assert re.search(said, found)
    else:
        truth = rank(described(exact))
        assert found == (truth.freedom, truth.rank) or (
            isinstance(found, str) and names(found, truth.rank)
        )


@pytest.mark.parametrize("seed", slow_unless((1, 2, 6, 7, 9), SEEDS))
def test_the_rank_is_that_of_closed_states(seed: int, tmp_path: Path) -> None:
    text = RandomLinkage(seed).text()
    check(text, text, tmp_path / "robot.yaml", SAID.get(seed))


@pytest.mark.parametrize("seed", slow_unless((2, 6), FRAMED))
def test_rounded_numbers_in_random_frames_are_read_as_they_are_meant(
    seed: int, tmp_path: Path
) -> None:
    text = RandomLinkage(seed).text()
    check(
        in_random_frames(text, seed, 6),
        text,
        tmp_path / "robot.yaml",
        SAID_OF_ROUNDED.get(seed),
    )
