"""Sets in ball arithmetic, where no closed pose modulo a prime is known."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction

import flint
import numpy as np
import pytest
from echelon.base.ball_relations import Elimination

import echelon as ec
from echelon.base import derive
from echelon.base.ball_spaces import BallSpaces
from echelon.base.ball_tables import rounded
from echelon.base.certificate import certify
from echelon.base.derive import model_at_stated_values, specialised
from echelon.errors import SingularPoseError
from echelon.exact.field import random_generator
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.linear_forms import virtual_power_form
from echelon.regressor.loops import closing
from echelon.results.saved import from_json, to_json
from support.closed_states import read, states
from support.paths import EXAMPLES
from support.published_loops import LOOPS, PUBLISHED
from support.selection import slow_unless
from support.zoo import ZOO

EXAMPLE = ("four_bar", "parallelogram", "three_rps", "sr400", "gough_stewart", "bennett", "delta")


def in_balls(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, closed_in_balls=True)


def check(mechanism: Mechanism, rank: int) -> None:
    """The set has the rank, expresses all columns at closed states, and is as good when it is read back."""
    base = ec.base_parameters(in_balls(mechanism))
    assert base.rank == rank
    assert base.certificate.in_balls
    assert base.certificate.log10_residual is not None
    assert base.certificate.log10_residual < -30
    state = states(base.mechanism, 20)
    full = base.standard_regressor(*state)
    np.testing.assert_allclose(base.regressor(*state) @ base.B_float(), full, atol=1e-8 * np.abs(full).max())
    again = from_json(to_json(base))
    assert again.mechanism.closed_in_balls
    assert ec.verify(again).rank == rank


@pytest.mark.parametrize("name", slow_unless(("four_bar", "parallelogram", "sr400"), EXAMPLE))
def test_ranks_of_textbook_loops(name: str) -> None:
    mechanism = ec.load(EXAMPLES / f"loops/{name}.yaml")
    check(mechanism, ec.base_structure(mechanism).rank)


@pytest.mark.parametrize(
    ("name", "rank"),
    slow_unless(
        [("xarm7_gripper", 3)],
        [
            (m.name, m.rank)
            for m in PUBLISHED
            if not m.floating and m.name in ("cassie_leg", "talos_like", "reachy_mini")
        ]
        + [("xarm7_gripper", 3), ("planar_delta", 20)],
    ),
)
def test_ranks_of_published_loops(name: str, rank: int) -> None:
    file = next(model.file for model in PUBLISHED if model.name == name)
    check(ec.load(file if file.suffix == ".xml" else file.with_suffix(".yaml")), rank)


def test_representatives_may_be_chosen() -> None:
    mechanism = in_balls(ec.load(EXAMPLES / "loops/four_bar.yaml"))
    base = ec.base_parameters(mechanism, order="tip-to-base")
    assert base.rank == ec.base_parameters(mechanism).rank
    assert base.pivots != ec.base_parameters(mechanism).pivots
    assert ec.verify(from_json(to_json(base))).rank == base.rank


def test_a_wrong_number_is_refused() -> None:
    text = to_json(ec.base_parameters(in_balls(ec.load(EXAMPLES / "loops/four_bar.yaml"))))
    wrong = re.sub(r'("coefficient": "-?\d+/)\d', lambda m: m.group(1) + "7", text, count=1)
    assert wrong != text
    with pytest.raises((ec.CertificateError, ec.InputError)):
        ec.verify(from_json(wrong))


def test_too_many_representatives_are_refused() -> None:
    mechanism = in_balls(ec.load(EXAMPLES / "loops/four_bar.yaml"))
    base = ec.base_parameters(mechanism)
    dependent = next(
        c for c in range(len(base.parameters)) if c not in base.matrix.pivots and any(c in r for r in base.matrix.rows)
    )
    one = next(row[dependent] for row in base.matrix.rows if dependent in row)
    pivots = tuple(sorted((*base.matrix.pivots, dependent)))
    rows = [{k: v for k, v in row.items() if k != dependent} for row in base.matrix.rows]
    by_pivot = dict(zip(base.matrix.pivots, rows, strict=True)) | {dependent: {dependent: one / one}}
    order = (*pivots, *(c for c in range(len(base.parameters)) if c not in pivots))
    more = replace(base.matrix, pivots=pivots, rows=tuple(by_pivot[p] for p in pivots), order=order)
    with pytest.raises(ec.CertificateError, match="too large"):
        certify(virtual_power_form(mechanism), more, 1, model_at_stated_values(mechanism))


@pytest.mark.parametrize("name", ["Peaucellier", "car jack", "screw jack", "welded, with slides"])
def test_what_few_motions_change_smoothly_is_not_doubted(name: str) -> None:
    """Near the pose, some of what they show is a billionth of the rest and less."""
    found = specialised(in_balls(read(ZOO[name].text)), random_generator(1))
    assert found.structure.rank == ZOO[name].rank
    assert not found.doubt


@pytest.mark.slow
def test_rounded_relations_are_doubted() -> None:
    """To the letter, digits of doubles break relations that are kept where fourteen digits count."""
    mechanism = ec.load(LOOPS / "battobot/robot.yaml")
    assert not specialised(in_balls(mechanism), random_generator(1)).doubt
    to_the_letter = specialised(in_balls(ec.load(LOOPS / "battobot/robot.yaml", snap_tolerance=0)), random_generator(1))
    assert to_the_letter.structure.rank > 154
    assert "base parameters hardly show" in to_the_letter.doubt
    assert "there are 154" in to_the_letter.doubt


def test_loops_without_a_pose_modulo_primes_are_accepted(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: object) -> object:
        raise ec.InputError("none is found")

    monkeypatch.setattr(closing, "_jacobian", none)
    mechanism = ec.load(EXAMPLES / "loops/four_bar.yaml")
    assert mechanism.closed_in_balls
    assert ec.base_parameters(mechanism).rank == 8


def test_a_long_search_ends_in_balls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(derive, "SEARCH", 1.0)
    base = ec.base_parameters(ec.load(LOOPS / "five_bar/robot.yaml"))
    assert base.rank == 14
    assert base.certificate.in_balls


def test_signs_are_those_of_random_states() -> None:
    text = (EXAMPLES / "loops/four_bar.yaml").read_text()
    mechanism = ec.load(f"{text}\neffects:\n  - {{type: coulomb, at: all, side: joint}}\n")
    base = ec.base_parameters(in_balls(mechanism))
    assert base.rank == ec.base_parameters(mechanism).rank
    assert "Regions of signs" in base.certificate.assumptions
    assert "signs as they are at random states" in str(base.certificate)


@pytest.mark.parametrize("velocity", ["0.5", "0.002"])
def test_exponentials_show_at_small_speeds(velocity: str) -> None:
    """At others they vanish to hundreds of digits."""
    text = (EXAMPLES / "loops/four_bar.yaml").read_text()
    effects = f"  - {{type: stribeck, velocity: {velocity}, at: all, side: joint}}\n  - {{type: viscous, at: all}}\n"
    mechanism = ec.load(f"{text}\neffects:\n{effects}")
    base = ec.base_parameters(in_balls(mechanism))
    assert base.certificate.in_balls
    assert base.rank == ec.base_parameters(mechanism).rank


@pytest.mark.parametrize("name", slow_unless(("four_bar", "parallelogram"), EXAMPLE))
def test_sensors_see_what_they_do_modulo_primes(name: str) -> None:
    mechanism = ec.load(EXAMPLES / f"loops/{name}.yaml")
    exact, balls = (ec.sensor_report(m, 2) for m in (mechanism, in_balls(mechanism)))
    assert (exact.ranks, exact.greedy, exact.smallest) == (balls.ranks, balls.greedy, balls.smallest)


def test_rows_may_show_nothing() -> None:
    """As those of a sensor that sees nothing, or of which nothing is left."""
    nothing = np.full((50, 3), flint.arb(0), dtype=object)
    assert [BallSpaces({}, 640).rank(rows) for rows in (nothing, nothing[:0])] == [0, 0]


def test_row_spaces_modulo_primes_are_not_known() -> None:
    with pytest.raises(SingularPoseError, match="no exact closed pose is known for the loops closed by"):
        ec.same_row_space(*[in_balls(ec.load(EXAMPLES / "loops/four_bar.yaml"))] * 2)


def test_relations_hold_in_other_rows() -> None:
    """As those of a few poses may not hold elsewhere."""
    table = np.array([[flint.arb(k), flint.arb(2 * k)] for k in range(1, 60)], dtype=object)
    alike, others = (np.array([[flint.arb(1), flint.arb(x)]], dtype=object) for x in (2, 3))
    with flint.ctx.workprec(64):
        eliminate = Elimination(table, 64).done
        found = eliminate(range(2), alike)
        assert found is not None
        assert found.pivots == [0]
        assert eliminate(range(2), others) is None


def test_a_singular_pose_is_doubted() -> None:
    """Flat parallelograms may go on as others."""
    found = specialised(in_balls(ec.load(LOOPS / "palletizer.xml")), random_generator(1))
    assert "the assembly pose is singular" in found.doubt


def test_short_fractions_are_recognised_in_balls() -> None:
    with flint.ctx.workprec(512):
        third, root = flint.arb(1) / 3, flint.arb(2).sqrt()
        values, radius = rounded([third * -9, 9 * third / 26, root - root, root])
    assert values[:3] == [-3, Fraction(3, 26), 0]
    assert abs(values[3] ** 2 - 2) < Fraction(1, 10**38)
    assert 0 < radius < 1e-38
