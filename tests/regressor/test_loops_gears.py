"""Gears and cams in mechanisms with loops: ratios are numbers, or symbols with exact values."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from support import loop_oracle
from support.closed_states import check, read, states
from support.described_linkage import described
from support.pinocchio_loops import Constrained
from support.selection import slow_unless

BAR = """
symbols: {{l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3, {symbols}}}
gravity: [0, -9.81, 0]
modified_dh:
  - {{name: crank, joint: revolute}}
  - {{name: coupler, joint: revolute, a: l2}}
  - {{name: rocker, joint: revolute, parent: base, a: l1}}
  - {{name: wheel, joint: revolute, parent: {carrier}, a: {offset}}}
couplings: [{{wheel: {ratio}}}]
loops:
  - name: pin
    joint: revolute
    connects: [{carried}, rocker]
    at: {{xyz: [l3, 0, 0]}}
    on_second: {{xyz: [l4, 0, 0]}}
assembly: {{crank: 1.0, coupler: -0.4816, rocker: 1.6206}}
"""
OUTSIDE = {"carrier": "rocker", "offset": "0.1", "carried": "coupler"}
INSIDE = {"carrier": "coupler", "offset": "l3", "carried": "wheel"}


def geared(
    ratio: str, symbols: str = "n: 1", place: dict[str, str] = OUTSIDE
) -> ec.Mechanism:
    return read(BAR.format(ratio=ratio, symbols=symbols, **place))


def rank_in_pinocchio(mechanism: ec.Mechanism) -> int:
    """Rank of the regressor whose columns are what one more unit of each standard parameter adds to the forces."""
    ones = np.ones(len(mechanism.parameters))
    models = [
        Constrained(mechanism, zeta) for zeta in (ones, *(ones + np.eye(len(ones))))
    ]
    rows = [
        [model.dynamics(*state)[0] for model in models]
        for state in zip(*states(mechanism, 20), strict=True)
    ]
    forces = np.array(rows).transpose(0, 2, 1).reshape(-1, len(models))
    matrix = forces[:, 1:] - forces[:, :1]
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int((singular > 1e-8 * singular[0]).sum())


@pytest.mark.parametrize(
    ("ratio", "symbols", "place", "rank"),
    [
        pytest.param("2*rocker", "n: 1", OUTSIDE, 10, marks=pytest.mark.slow),
        pytest.param("1/2*rocker", "n: 1", OUTSIDE, 10, marks=pytest.mark.slow),
        pytest.param("-50.7*rocker", "n: 1", OUTSIDE, 10, marks=pytest.mark.slow),
        pytest.param("n*rocker", "n: 3/4", OUTSIDE, 10, marks=pytest.mark.slow),
        pytest.param("(n + 1)*rocker", "n: -2.5", OUTSIDE, 10, marks=pytest.mark.slow),
        pytest.param("n*crank", "n: -2", INSIDE, 11, marks=pytest.mark.slow),
        pytest.param("n*crank", "n: 1/2", INSIDE, 11, marks=pytest.mark.slow),
        ("-n*crank + rocker", "n: 1/2", INSIDE, 11),
    ],
)
def test_ratios_of_gears(
    ratio: str, symbols: str, place: dict[str, str], rank: int
) -> None:
    mechanism = geared(ratio, symbols, place)
    check(mechanism, rank)
    assert rank_in_pinocchio(mechanism) == rank


@pytest.mark.slow
def test_a_symbol_in_a_ratio_is_taken_at_its_value() -> None:
    base = ec.base_parameters(geared("n*rocker", "n: 3/4"))
    assert "the symbol 'n' is replaced by its value everywhere" in base.reading.notes[0]
    state = states(base.mechanism, 5)
    full = base.standard_regressor(*state)
    np.testing.assert_allclose(
        base.regressor(*state) @ base.B_float(), full, atol=1e-8 * np.abs(full).max()
    )


def test_a_ratio_without_a_value_is_refused() -> None:
    with pytest.raises(
        ec.InputError,
        match=r"coupling of 'wheel': with loops, the ratio n is not a rational number",
    ):
        geared("n*rocker", "n: null")


RACK = BAR.replace("wheel, joint: revolute", "wheel, joint: prismatic").replace(
    "wheel: {ratio}", "{ratio}"
)
INEXACT = {
    "irrational": BAR.format(ratio="n*crank", symbols="n: sqrt(2)", **INSIDE),
    "approximate": BAR.format(
        ratio="n*rocker", symbols="n: {approximate: 0.3141}", **OUTSIDE
    ),
    "a cam": BAR.format(ratio="0.2*rocker^2 - 0.02*rocker", symbols="n: 1", **OUTSIDE),
    "a cam in the loop": BAR.format(
        ratio="0.1*crank^2 - crank + 0.1*rocker^3", symbols="n: 1", **INSIDE
    ),
    "a pinion": RACK.replace(", rocker: 1.6206", ", wheel: 0.32412").format(
        ratio="rocker: 5*wheel", symbols="n: 1", **{**OUTSIDE, "carrier": "base"}
    ),
    "a lift": RACK.format(ratio="wheel: 0.1*rocker^2 + 0.3", symbols="n: 1", **OUTSIDE),
}


@pytest.mark.parametrize("name", slow_unless(["a cam"], INEXACT))
def test_couplings_without_exact_sines_are_answered_in_balls(name: str) -> None:
    """Against other mechanics with 75 digits; forces in independent coordinates are those of all rows."""
    base = ec.base_parameters(read(INEXACT[name]))
    assert base.rank == loop_oracle.rank(described(INEXACT[name])).rank
    assert base.certificate.in_balls
    state = states(base.mechanism, 5)
    full = base.standard_regressor(*state)
    np.testing.assert_allclose(
        base.regressor(*state) @ base.B_float(), full, atol=1e-8 * np.abs(full).max()
    )


@pytest.mark.slow
def test_formulas_in_lengths_beside_a_gear_with_an_irrational_ratio() -> None:
    """A geared wheel changes nothing of the four-bar that carries it."""
    base = ec.base_parameters(
        read(BAR.format(ratio="n*crank", symbols="n: sqrt(2)", **OUTSIDE))
    )
    assert str(base.expressions[4]).startswith("MX2 + (l3/l4)·MX3")
    assert base.matrix.numbers is None
