"""Sets of mechanisms with loops, which are found at real closed states."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import flint
import numpy as np
import pytest

import echelon as ec
from echelon.algebra.exact.field import random_generator
from echelon.base.ball_spaces import BallSpaces
from echelon.base.ball_tables import rounded
from echelon.base.certificate import certify
from echelon.base.derive import model_at_stated_values, specialised
from echelon.base.elimination import eliminated
from echelon.base.saved.saved import from_json, to_json
from echelon.dynamics.linear_forms import virtual_power_form
from support.closed_states import read, states
from support.derived import base_of
from support.paths import EXAMPLES
from support.published_loops import LOOPS, PUBLISHED
from support.selection import slow_unless
from support.zoo import ZOO

# found by other mechanics at closed states in 75 digits
EXAMPLE = {
    "four_bar": 8, "parallelogram": 3, "three_rps": 25, "sr400": 39, "gough_stewart": 82, "bennett": 9, "delta": 34,
}  # fmt: skip
PUBLISHED_SETS = (
    "cassie_leg",
    "talos_like",
    "reachy_mini",
    "xarm7_gripper",
    "planar_delta",
)
INTENDED = {"planar_delta": 20}


FOUR_BAR = "loops/four_bar"


def check(base: ec.BaseModel, rank: int) -> None:
    """The set has the rank, expresses all columns at closed states, and is as good when it is read back."""
    assert base.rank == rank
    assert base.certificate.in_balls
    assert base.certificate.log10_residual is not None
    assert base.certificate.log10_residual < (
        -30 if not base.certificate.rounding else -4
    )
    state = states(base.mechanism, 20)
    full = base.standard_regressor(*state)
    missed = 1e-3 if base.certificate.rounding else 1e-8
    np.testing.assert_allclose(
        base.regressor(*state) @ base.B_float(), full, atol=missed * np.abs(full).max()
    )
    assert ec.verify(from_json(to_json(base))).rank == rank


@pytest.mark.parametrize("name", slow_unless(("four_bar", "parallelogram"), EXAMPLE))
def test_ranks_of_textbook_loops(name: str) -> None:
    base = base_of(f"loops/{name}")
    assert ec.base_structure(base.mechanism).rank == EXAMPLE[name]
    check(base, EXAMPLE[name])


@pytest.mark.parametrize(
    "name",
    slow_unless(
        ["xarm7_gripper"],
        [m.name for m in PUBLISHED if not m.floating and m.name in PUBLISHED_SETS],
    ),
)
def test_ranks_of_published_loops(name: str) -> None:
    model = next(model for model in PUBLISHED if model.name == name)
    file = (
        model.file if model.file.suffix == ".xml" else model.file.with_suffix(".yaml")
    )
    check(ec.base_parameters(ec.load(file)), INTENDED.get(name, model.rank))


@pytest.mark.parametrize(
    "name", slow_unless(["parallelogram"], ["parallelogram", "four_bar"])
)
def test_representatives_may_be_chosen(name: str) -> None:
    base, usual = (
        base_of(f"loops/{name}", order="tip-to-base"),
        base_of(f"loops/{name}"),
    )
    assert base.rank == usual.rank
    assert base.pivots != usual.pivots
    assert ec.verify(from_json(to_json(base))).rank == base.rank


def test_a_wrong_coefficient_is_refused() -> None:
    text = to_json(
        ec.base_parameters(ec.load(EXAMPLES / "loops/bennett.yaml"), budget=0)
    )
    wrong = re.sub(
        r'("coefficient": "-?\d+/)\d', lambda m: m.group(1) + "7", text, count=1
    )
    assert wrong != text
    with pytest.raises((ec.CertificateError, ec.InputError)):
        ec.verify(from_json(wrong))


def test_too_many_representatives_are_refused() -> None:
    base = base_of(FOUR_BAR)
    dependent = next(
        c
        for c in range(len(base.parameters))
        if c not in base.matrix.pivots and any(c in r for r in base.matrix.rows)
    )
    one = next(row[dependent] for row in base.matrix.rows if dependent in row)
    pivots = tuple(sorted((*base.matrix.pivots, dependent)))
    rows = [
        {k: v for k, v in row.items() if k != dependent} for row in base.matrix.rows
    ]
    by_pivot = dict(zip(base.matrix.pivots, rows, strict=True)) | {
        dependent: {dependent: one / one}
    }
    order = (*pivots, *(c for c in range(len(base.parameters)) if c not in pivots))
    more = replace(
        base.matrix, pivots=pivots, rows=tuple(by_pivot[p] for p in pivots), order=order
    )
    with pytest.raises(ec.CertificateError, match="too large"):
        certify(
            virtual_power_form(base.mechanism),
            more,
            1,
            model_at_stated_values(base.mechanism),
        )


@pytest.mark.parametrize(
    "name",
    slow_unless(
        ["Peaucellier", "screw jack"],
        ["Peaucellier", "car jack", "screw jack", "welded, with slides"],
    ),
)
def test_what_few_motions_change_smoothly_is_not_doubted(name: str) -> None:
    """Near the pose, some of what they show is a billionth of the rest and less."""
    found = specialised(read(ZOO[name].text), random_generator(1))
    assert found.structure.rank == ZOO[name].rank
    assert not found.doubt


@pytest.mark.slow
def test_rounded_relations_are_left_out() -> None:
    """Digits of doubles break relations, which show next to nothing."""
    found = specialised(
        ec.load(LOOPS / "battobot/robot.yaml", snap_tolerance=0), random_generator(1)
    )
    assert found.structure.rank == 154
    assert not found.doubt


def test_signs_are_those_of_random_states() -> None:
    text = (EXAMPLES / "loops/four_bar.yaml").read_text()
    mechanism = ec.load(
        f"{text}\neffects:\n  - {{type: coulomb, at: all, side: joint}}\n"
    )
    base = ec.base_parameters(mechanism)
    assert base.rank == 11
    assert "Regions of signs" in base.certificate.assumptions
    assert "signs at random states" in str(base.certificate)


@pytest.mark.slow
@pytest.mark.parametrize("velocity", ["0.5", "0.002"])
def test_exponentials_show_at_small_speeds(velocity: str) -> None:
    """At others they vanish to hundreds of digits."""
    text = (EXAMPLES / "loops/four_bar.yaml").read_text()
    effects = f"  - {{type: stribeck, velocity: {velocity}, at: all, side: joint}}\n  - {{type: viscous, at: all}}\n"
    base = ec.base_parameters(ec.load(f"{text}\neffects:\n{effects}"))
    assert base.certificate.in_balls
    assert base.rank == 12


def test_rows_may_show_nothing() -> None:
    """As those of a sensor that sees nothing, or of which nothing is left."""
    nothing = np.full((50, 3), flint.arb(0), dtype=object)
    assert [BallSpaces({}, 640).rank(rows) for rows in (nothing, nothing[:0])] == [0, 0]


def test_relations_hold_in_other_rows() -> None:
    """As those of a few poses may not hold elsewhere."""
    table = np.array(
        [[flint.arb(k), flint.arb(2 * k)] for k in range(1, 60)], dtype=object
    )
    alike, others = (
        np.array([[flint.arb(1), flint.arb(x)]], dtype=object) for x in (2, 3)
    )
    with flint.ctx.workprec(64):
        found = eliminated(table, 64)
        assert found is not None
        assert len(found.pivots) == 1
        assert found.holds(alike)
        assert not found.holds(others)


@pytest.mark.slow
def test_a_singular_pose_is_doubted() -> None:
    """Flat parallelograms may go on as others."""
    found = specialised(ec.load(LOOPS / "palletizer.xml"), random_generator(1))
    assert "the assembly pose is singular" in found.doubt


def test_short_fractions_are_recognised_in_balls() -> None:
    with flint.ctx.workprec(512):
        third, root = flint.arb(1) / 3, flint.arb(2).sqrt()
        values, radius = rounded([third * -9, 9 * third / 26, root - root, root])
    assert values[:3] == [-3, Fraction(3, 26), 0]
    assert abs(values[3] ** 2 - 2) < Fraction(1, 10**38)
    assert 0 < radius < 1e-38
