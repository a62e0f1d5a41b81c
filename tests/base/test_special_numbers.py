"""Exact ranks of robots with special numbers against the truth in 1024-bit arithmetic, in both readings of their files.

The literal reading is compared with the rank of the numbers as they are written, the default reading with the rank of
what they were rounded from.
"""

from __future__ import annotations

from pathlib import Path

import flint
import pytest
from flint import arb

import echelon as ec
from support import ball_rank as truth
from support.ball_rank import BITS, Body, Place, number, unit, vector
from support.special_numbers import FAMILIES, HALF, moves, robot

FEW, MANY = 1, 22
"""Robots of each family in every run, and in the long one."""


def check(tmp_path: Path, family: str, seed: int, reading: str) -> None:
    planted = robot(family, seed)
    file = tmp_path / f"robot{planted.suffix}"
    file.write_text(planted.text)
    mechanism = (
        ec.load(file, snap_tolerance=0) if reading == "literal" else ec.load(file)
    )
    assert ec.base_structure(mechanism).rank == planted.rank(reading == "intended"), (
        planted.text
    )


def cases(first: int, last: int) -> list[tuple[str, int, str]]:
    return [
        (family, seed, reading)
        for family in FAMILIES
        for seed in range(first, last)
        for reading in ("literal", "intended")
    ]


@pytest.mark.parametrize(("family", "seed", "reading"), cases(0, FEW))
def test_the_rank_is_the_true_one(
    tmp_path: Path, family: str, seed: int, reading: str
) -> None:
    check(tmp_path, family, seed, reading)


@pytest.mark.slow
@pytest.mark.parametrize(("family", "seed", "reading"), cases(FEW, MANY))
def test_the_rank_of_many_is_the_true_one(
    tmp_path: Path, family: str, seed: int, reading: str
) -> None:
    check(tmp_path, family, seed, reading)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", range(3))
def test_both_ranks_are_reported_and_certified(
    tmp_path: Path, family: str, seed: int
) -> None:
    planted = robot(family, seed)
    file = tmp_path / f"robot{planted.suffix}"
    file.write_text(planted.text)
    base = ec.base_parameters(ec.load(file))
    literal = (
        base.rank if base.reading.literal_rank is None else base.reading.literal_rank
    )
    assert (base.rank, literal) == (planted.rank(True), planted.rank(False))


# -- the truth itself against the literature ---------------------------------------------------------------------------


def arm(*rows: tuple[str, int, str, str]) -> list[Body]:
    """Rows kind, α in quarter turns, a, d of a modified table."""
    with flint.ctx.workprec(BITS):
        return [
            Body(
                k - 1,
                (
                    Place(vector(number(a), 0, 0), vector(HALF * quarters, 0, 0)),
                    Place(vector(0, 0, number(d)), vector(0, 0, 0)),
                    *moves(kind, vector(0, 0, 1), arb("0.05")),
                ),
            )
            for k, (kind, quarters, a, d) in enumerate(rows)
        ]


R, P = "revolute", "prismatic"
WRIST = (R, 1, "0", "0"), (R, -1, "0", "0")
PUMA = (
    (R, 0, "0", "0"),
    (R, -1, "0", "0"),
    (R, 0, "0.4318", "0.15"),
    (R, -1, "0.0203", "0.4318"),
    *WRIST,
)
STANFORD = (
    (R, 0, "0", "0"),
    (R, -1, "0", "0.2"),
    (P, 1, "0", "0"),
    (R, 0, "0", "0"),
    (R, -1, "0", "0"),
    (R, 1, "0", "0"),
)
PENDULUM = (R, 1, "0", "0"), (R, 0, "0.5", "0")


@pytest.mark.parametrize(
    ("rows", "gravity", "expected"),
    [
        (PUMA, "0 0 -9.81", 36),
        (PUMA, "1 -2 -9", 38),
        (PUMA, "0 0 0", 34),
        (STANFORD, "0 0 -9.81", 33),
        (PENDULUM, "0 0 -9.81", 6),
        (PENDULUM, "0 0 0", 4),
        (((P, 0, "0", "0"), (P, 1, "0", "0"), (P, 1, "0", "0")), "0 0 -9.81", 3),
        (((R, 0, "0", "0"), (P, 0, "0", "0"), (P, 1, "0", "0")), "0 0 -9.81", 5),
        ((("spherical", 0, "0", "0"),), "0 0 -9.81", 9),
        ((("spherical", 0, "0", "0"),), "0 0 0", 6),
        (
            (("floating", 0, "0", "0"), (R, 1, "0.3", "0.2"), (P, 1, "0.1", "0")),
            "0 0 -9.81",
            21,
        ),
        ((("planar", 0, "0", "0"),), "0 0 0", 4),
    ],
)
def test_ranks_of_the_literature(
    rows: tuple[tuple[str, int, str, str], ...], gravity: str, expected: int
) -> None:
    assert truth.rank(arm(*rows), vector(*map(number, gravity.split()))) == expected


def test_a_difference_in_the_ninth_digit_counts() -> None:
    """Two hinges on one line, and a hair beside it."""
    with flint.ctx.workprec(BITS):
        down = vector(0, 0, number("-9.81"))
        for aside, expected in (("0", 2), ("0.000000001", 4)):
            assert (
                truth.rank(arm((R, 0, "0", "0"), (R, 0, aside, "0")), down) == expected
            )
        direction = unit(vector(1, 2, 3))
        assert (direction @ direction - 1).contains(arb(0))
