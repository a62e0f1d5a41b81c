"""A zoo of mechanisms with loops, as users write them: exact ranks against singular values at closed states."""

from __future__ import annotations

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.base.structure import find_structure
from echelon.formats.writers.description_writer import write_description
from support import loop_oracle
from support.closed_states import check, read, states
from support.described_linkage import described
from support.selection import one_in
from support.zoo import ZOO, Case
from support.zoo.linkages import ROOTS, delta

SUBSETS = {
    "four bar, floating base": {
        "{joint: crank}": 18,
        "{wrench: coupler, components: [fx, fy]}": 14,
    },
    "five bar": {
        "{joint: left}": 8,
        "{wrench: base}": 20,
        "{wrench: left2, components: [fx, fy]}": 6,
    },
    "whitworth": {
        "{wrench: ram, components: [fy]}": 3,
        "{wrench: lever, components: [fx, fy]}": 7,
    },
    "watt II": {
        "{wrench: link6, components: [fx, fy]}": 6,
        "{wrench: base, components: [fx, fy, tz]}": 15,
    },
    "RSUR": {"{wrench: rocker}": 15, "{wrench: rod}": 12, "{wrench: base}": 21},
    "hooke": {"{wrench: base}": 18},
    "sarrus": {"{wrench: base}": 17},
    "sr400": {
        "{joint: j2}": 16,
        "{joint: j7}": 31,
        "{wrench: j5}": 17,
        "{wrench: base}": 44,
    },
    "excavator": {"{joint: rod3}": 27, "{wrench: bucket, components: [fx, fz]}": 14},
    "gripper": {"{joint: crankL}": 8, "{wrench: palm}": 23},
    "two arms carrying": {"{joint: l1}": 34, "{wrench: r3}": 17},
}


LONG = (
    "biped on a stand mjcf",
    "delta mjcf",
    "stewart mjcf",
    "excavator",
    "planar with a ball, the ball first",
    "Delta, crosses",
    "spherical five bar",
    "Peaucellier, moved",
    "scissor lift",
    "leg mjcf",
)


def cases() -> list[object]:
    return [
        pytest.param(c, id=n, marks=[pytest.mark.slow] * (c.slow or n in LONG))
        for n, c in ZOO.items()
    ]


UNCLEAR = [
    ZOO[name]
    for name in (
        "screw jack",
        "delta connect mjcf",
        "3-UPU",
        "Jansen, three legs",
        "welded, seven revolutes",
        "welded, with slides",
    )
]
"""Doubles do not tell their ranks; the oracle's 75 digits do.

With one freedom, dozens of smooth functions of one number are compared on the short way that random walks go.
"""


@pytest.mark.parametrize("case", one_in(4, cases()))
def test_the_rank_is_that_of_closed_states(case: Case) -> None:
    mechanism = read(case.text)
    assert len(mechanism.independent_velocities) == case.freedom
    if case in UNCLEAR:
        assert find_structure(mechanism, np.random.default_rng(1)).rank == case.rank
    else:
        check(mechanism, case.rank)


@pytest.mark.parametrize(
    ("name", "output", "rank"),
    one_in(
        4,
        (
            (name, *subset)
            for name, subsets in SUBSETS.items()
            for subset in subsets.items()
        ),
    ),
)
def test_the_rank_of_some_measurements(name: str, output: str, rank: int) -> None:
    check(read(f"{ZOO[name].text}outputs: [{output}]\n"), rank)


@pytest.mark.slow
def test_directions_without_exact_values_are_known_in_balls(tmp_path: Path) -> None:
    """Arms along (1, 2, 0): their angles are no fractions of π, and as doubles they are rounded."""
    text = delta("universal, axis: x, axis2: y", ROOTS)
    mechanism = read(text)
    assert (
        ec.base_structure(mechanism).rank
        == loop_oracle.rank(described(text)).rank
        == 34
    )
    arcs = {name: symbol.tangent_squared for name, symbol in mechanism.symbols.items()}
    assert set(arcs.values()) == {Fraction(1, 4), Fraction(1, 9)}
    (tmp_path / "delta.json").write_text(
        json.dumps(write_description(mechanism)), encoding="utf-8"
    )
    again = ec.load(tmp_path / "delta.json")
    assert {
        name: symbol.tangent_squared for name, symbol in again.symbols.items()
    } == arcs
    doubles = {
        name: replace(symbol, tangent_squared=None)
        for name, symbol in mechanism.symbols.items()
    }
    assert (
        ec.base_structure(replace(mechanism, symbols=doubles, rounding=1e-15)).rank
        == 34
    )


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) for n in ZOO])
def test_closed_forms_express_all_columns(name: str) -> None:
    base = ec.base_parameters(read(ZOO[name].text))
    assert base.rank == ZOO[name].rank
    state = states(base.mechanism, 20)
    full = base.standard_regressor(*state)
    np.testing.assert_allclose(
        base.regressor(*state) @ base.B_float(), full, atol=1e-8 * np.abs(full).max()
    )


@pytest.mark.parametrize("seed", one_in(3, range(2, 5)))
@pytest.mark.parametrize(
    "name", ["stephenson II", "gripper", "sarrus", "scissors mjcf"]
)
def test_the_rank_does_not_depend_on_chance(name: str, seed: int) -> None:
    assert (
        find_structure(read(ZOO[name].text), np.random.default_rng(seed)).rank
        == ZOO[name].rank
    )


CHOICES = {
    "five bar": ["[left, left2]", "[left2, right2]", "[right, left2]"],
    "watt II": ["[rocker]", "[link6]"],
    "scotch yoke": ["[yoke]"],
    "hydraulic triangle": ["[boom]", "[barrel]"],
    "sr400": [
        "[j1, j2, j3, j4, j5, j6]",
        "[j1, j7, j3, j4, j5, j6]",
        "[j1, j8, j7, j4, j5, j6]",
    ],
}


@pytest.mark.parametrize(
    ("name", "choice"),
    one_in(4, ((name, c) for name, choices in CHOICES.items() for c in choices)),
)
def test_the_rank_does_not_depend_on_the_independent_coordinates(
    name: str, choice: str
) -> None:
    text = "".join(
        line
        for line in ZOO[name].text.splitlines(True)
        if not line.startswith("independent")
    )
    check(read(f"{text}independent: {choice}\n"), ZOO[name].rank)


MISTAKES = {
    "crank too long": (
        "watt II",
        "l1: 0.4",
        "l1: 2",
        "do not close near the assembly pose: closure 'pin' is off by",
    ),
    "too few": (
        "five bar",
        "[left, right]",
        "[left]",
        "2 coordinates are independent, not 1; add for example right",
    ),
    "too many": (
        "watt II",
        "[crank]",
        "[crank, link6]",
        "follows from the others through .*'pin2' .link5 and link6.*"
        r"0\.\d+ times that of 'crank'.*Write  independent: .crank.",
    ),
    "misspelt": ("five bar", "[left, right]", "[left, rigt]", "did you mean 'right'"),
    "by coupling": (
        "geared five bar",
        "[left]",
        "[right]",
        "there is no coordinate 'right'",
    ),
    "same body": (
        "five bar",
        "[left2, right2]",
        "[left2, left2]",
        "do not move against each other",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(mistake: str) -> None:
    name, old, new, message = MISTAKES[mistake]
    with pytest.raises(ec.InputError, match=message):
        read(ZOO[name].text.replace(old, new))


def test_screws_may_be_turned_where_loops_close() -> None:
    pose = "{left0: -0.3618, right0: -0.363, screw1: -0.0006, screw2: -0.1814, screw3: 0.1814}"
    mechanism = read(
        ZOO["car jack"].text.replace("loops:", f"assembly: {pose}\nloops:")
    )
    assert ec.base_structure(mechanism).rank == ZOO["car jack"].rank


def test_drives_and_sensors_are_at_independent_coordinates() -> None:
    for more in ("outputs: [{joint: left2}]\n", "actuators: {m: 2*left2}\n"):
        with pytest.raises(ec.InputError, match="left2"):
            read(ZOO["five bar"].text + more)
