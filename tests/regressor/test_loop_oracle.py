"""The oracle for loops, held against textbook ranks; the ranks it finds for published models."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from flint import arb

from support import loop_readers
from support.described_linkage import described
from support.loop_linkage import (
    ONE,
    Body,
    Linkage,
    Loop,
    matrix,
    number,
    sliding,
    turning,
)
from support.loop_oracle import Rank, UnsettledError, rank
from support.paths import TESTS
from support.published_loops import LITERAL, LOCKED, PUBLISHED, Published
from support.selection import one_in
from support.zoo import ZOO
from support.zoo.platforms import PLATFORMS

X, Y, Z = loop_readers.AXES
IN_PLANE, ACROSS = (0, "-9.81", 0), (0, 0, "-9.81")
SMALL = ("planar_2dof",)


def at(x: str = "0", y: str = "0", z: str = "0") -> object:
    return matrix(
        [[1, 0, 0, number(x)], [0, 1, 0, number(y)], [0, 0, 1, number(z)], [0, 0, 0, 1]]
    )


def four_bar(
    lengths: str,
    start: tuple[float, ...],
    gravity: tuple[object, ...] = IN_PLANE,
    kind: str = "revolute",
) -> Linkage:
    ground, crank, coupler, rocker = lengths.split()
    turn = (turning(Z),)
    bodies = (
        Body("crank", -1, ONE, turn),
        Body("coupler", 0, at(crank), turn),
        Body("rocker", -1, at(ground), turn),
    )
    return Linkage(
        bodies, (Loop(kind, 1, 2, at(coupler), at(rocker)),), start, gravity=gravity
    )


def bennett() -> Linkage:
    """Lengths 2, 1 with twists of 90 and 30 degrees; the last joint is the closure."""

    def link(length: str, twelfths: int) -> object:
        turn = loop_readers.turned(arb.pi() * twelfths / 12, arb(0), arb(0))
        return loop_readers.placed(turn, (number(length), arb(0), arb(0)))

    turn = (turning(Z),)
    bodies = (
        Body("1", -1, ONE, turn),
        Body("2", 0, link("0.8", 6), turn),
        Body("3", 1, link("0.4", 2), turn),
    )
    closure = Loop("revolute", 2, -1, link("0.8", 6), link("-0.4", -2))
    start = (float(arb.pi() / 2), float(-arb.pi() * 2 / 3), float(-arb.pi() / 2))
    return Linkage(bodies, (closure,), start, gravity=(1, -2, "-9.81"))


BARS, EQUAL = "0.4 0.15 0.35 0.3", "0.4 0.3 0.4 0.3"
CLOSED, PARALLEL, CROSSED = (1.0, -0.48, 1.62), (1.0, -1.0, 1.0), (1.0, -2.63, -2.63)
TREES = {
    "double pendulum": (
        Linkage(
            (Body("1", -1, ONE, (turning(Z),)), Body("2", 0, at("0.3"), (turning(Z),))),
            (),
            (0, 0),
            gravity=IN_PLANE,
        ),
        2,
        6,
    ),
    "ball": (
        Linkage(
            (Body("1", -1, ONE, (turning(X), turning(Y), turning(Z))),), (), (0, 0, 0)
        ),
        3,
        9,
    ),
    "cart-pole": (
        Linkage(
            (Body("1", -1, ONE, (sliding(X),)), Body("2", 0, ONE, (turning(Y),))),
            (),
            (0, 0),
        ),
        2,
        4,
    ),
}


@pytest.mark.parametrize(("tree", "freedom", "count"), TREES.values(), ids=TREES)
def test_textbook_trees(tree: Linkage, freedom: int, count: int) -> None:
    found = rank(tree)
    assert (found.freedom, found.rank) == (freedom, count)


@pytest.mark.parametrize(
    "kind", ["revolute", pytest.param("point", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    ("lengths", "start", "gravity", "count"),
    one_in(
        2,
        [
            (BARS, CLOSED, IN_PLANE, 8),
            (BARS, CLOSED, ACROSS, 4),
            (EQUAL, PARALLEL, IN_PLANE, 3),
            (EQUAL, PARALLEL, ACROSS, 1),
            (EQUAL, CROSSED, IN_PLANE, 8),
        ],
    ),
)
def test_four_bars(
    lengths: str,
    start: tuple[float, ...],
    gravity: tuple[object, ...],
    count: int,
    kind: str,
) -> None:
    found = rank(four_bar(lengths, start, gravity, kind))
    assert (found.freedom, found.rank) == (1, count)
    assert found.gap > 1e40


def test_a_linkage_that_moves_against_the_count_of_freedoms() -> None:
    found = rank(bennett())
    assert (found.freedom, found.rank) == (1, 9)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLATFORMS)
def test_platforms(name: str, tmp_path: Path) -> None:
    file = tmp_path / "platform.xml"
    file.write_text(PLATFORMS[name].text)
    found = rank(loop_readers.mjcf(file))
    assert (found.freedom, found.rank) == (
        PLATFORMS[name].freedom,
        PLATFORMS[name].rank,
    )


def test_a_closure_that_cannot_be_met_is_an_error() -> None:
    with pytest.raises(ArithmeticError, match="no closed pose"):
        rank(four_bar(BARS, CLOSED, kind="weld"))


def test_rounded_geometry_is_an_error_and_no_answer() -> None:
    rounded = four_bar("0.4 0.3 0.4000000000000001 0.3", PARALLEL)
    with pytest.raises(UnsettledError, match="pivots fall"):
        rank(rounded)


def test_the_oracle_shares_nothing_with_the_package() -> None:
    modules = (
        "sys, support.described_linkage, support.loop_readers, support.loop_oracle"
    )
    code = f"import {modules}; print(any(name.split('.')[0] == 'echelon' for name in sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=TESTS,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "False"


def found_in(model: Published, literal: bool = False) -> Rank:
    read = (
        loop_readers.mjcf(model.file, literal) if model.file.suffix == ".xml" else None
    )
    return rank(read or loop_readers.urdf(model.file, model.floating, literal))


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(m, marks=[pytest.mark.slow] * (m.name not in SMALL))
        for m in PUBLISHED
    ],
    ids=str,
)
def test_published_models(model: Published) -> None:
    found = found_in(model)
    assert (found.freedom, found.rank) == (model.freedom, model.rank)
    assert found.gap > 1e30


DESCRIBED = [
    n for n, c in ZOO.items() if "bodies:" in c.text or "modified_dh:" in c.text
]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in DESCRIBED if "floating" not in name])
def test_mechanisms_of_the_zoo(name: str) -> None:
    found = rank(described(ZOO[name].text))
    assert (found.freedom, found.rank) == (ZOO[name].freedom, ZOO[name].rank)


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [m for m in PUBLISHED if m.name in LITERAL and not m.floating], ids=str
)
def test_published_models_to_the_letter(model: Published) -> None:
    assert found_in(model, literal=True).rank == LITERAL[model.name]


@pytest.mark.parametrize("name", LOCKED)
def test_models_that_close_within_rounding_only(name: str) -> None:
    with pytest.raises(ArithmeticError, match="no closed pose"):
        found_in(Published(name, 0, 0))
