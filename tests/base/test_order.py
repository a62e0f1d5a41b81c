"""Other representatives: tip-to-base order and preferred parameters."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import pytest
import sympy

import echelon as ec
from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.matrix import coefficient_value, column_order
from echelon.formats.snapping import ReadingOptions
from echelon.robot.effect import Side, ready_made
from echelon.robot.mechanism import Mechanism, Parameter
from echelon.shared.conventions import PARAMETERS, UNITS
from support import textbook_arms as arms
from support.descriptions import read_description
from support.selection import one_in, slow_unless

ROBOTS = [
    arms.rx90,
    arms.panda,
    arms.helical,
    arms.coupled,
    arms.branched,
    arms.floating_pair,
    arms.massless,
]


def rational_b(model: ec.BaseModel, order: tuple[int, ...]) -> sympy.Matrix:
    """B at one rational geometry, with its columns in an order."""
    values = {
        name: sympy.Rational(sum(map(ord, name)), 97) for name in model.matrix.symbols
    }
    return sympy.Matrix(model.matrix.sympy(values))[:, list(order)]


@pytest.mark.parametrize("robot", one_in(2, ROBOTS))
@pytest.mark.parametrize(
    "choice", [{"order": "tip-to-base"}, {"prefer": ("M",)}, {"prefer": ("MZ", "YY")}]
)
def test_reduced_echelon_form_of_the_same_space(
    robot: Callable[[], Mechanism], choice: dict[str, object]
) -> None:
    """sympy's rref of the classical set, columns permuted, is the new set."""
    mechanism = robot()
    classical = ec.base_parameters(mechanism)
    other = ec.base_parameters(mechanism, **choice)  # type: ignore[arg-type]
    order = other.matrix.order
    expected, pivots = rational_b(classical, order).rref()
    assert tuple(order[p] for p in pivots) == other.matrix.pivots
    # square roots may stand in another form
    assert (rational_b(other, order) - expected).applyfunc(sympy.radsimp).is_zero_matrix


def test_quotients_that_cancel_are_numbers_all_the_same() -> None:
    """Expanded, both parts are sums of terms 1e18 times as large, which doubles lose."""
    top, bottom = parse("(x - 1)^9"), parse("(x - 51/50)^9*y + x - 51/50")
    x, y = Fraction(1.01), Fraction(0.3)
    expected = (x - 1) ** 9 / ((x - Fraction(51, 50)) ** 9 * y + x - Fraction(51, 50))
    assert coefficient_value(
        RationalFunction(top, bottom), {"x": 1.01, "y": 0.3}
    ) == pytest.approx(float(expected), 1e-14)
    with pytest.raises(ec.InputError, match="is zero at these values"):
        coefficient_value(
            RationalFunction(parse("1"), parse("x - y")), {"x": 0.5, "y": 0.5}
        )


def test_preferred_parameters_become_representatives() -> None:
    model = ec.base_parameters(arms.rx90(), prefer=("M6", "YY2", "MZ4"))
    assert model.pivots[:3] == ("M6", "YY2", "MZ4")
    assert model.rank == 36
    assert (
        ec.base_parameters(arms.rx90(), prefer="M6").pivots[0] == "M6"
    )  # one name is a list of one name


@pytest.mark.parametrize(
    "robot",
    slow_unless(
        [arms.double_pendulum],
        [arms.double_pendulum, arms.stanford, arms.helical],
    ),
)
def test_whatever_is_seen_can_be_a_representative(
    robot: Callable[[], Mechanism],
) -> None:
    """Alone at the head of the order, every parameter with a non-zero column is a pivot; the classes stay the same."""
    mechanism = robot()
    classes = ec.base_parameters(mechanism).classification
    for name, kind in classes.items():
        model = ec.base_parameters(mechanism, prefer=(name,))
        assert (name in model.pivots) is (kind is not ec.Identifiability.UNIDENTIFIABLE)
        assert model.classification == classes


def test_a_kind_gives_as_many_representatives_as_possible() -> None:
    classical = ec.base_parameters(arms.panda())
    masses = [
        c
        for c, name in enumerate(classical.parameters)
        if name.startswith("M") and name[1].isdigit()
    ]
    rank = rational_b(classical, tuple(masses)).rank()
    pivots = ec.base_parameters(arms.panda(), prefer=("M",)).matrix.pivots
    assert len({*pivots} & {*masses}) == rank == 4


def test_tip_to_base_takes_the_last_bodies_first() -> None:
    model = ec.base_parameters(arms.rx90(), order="tip-to-base")
    assert [model.parameters[c] for c in model.matrix.order[:10]] == list(
        model.parameters[-10:]
    )
    assert [name[-1] for name in model.pivots] == sorted(
        (name[-1] for name in model.pivots), reverse=True
    )


def test_parameters_of_effects_stay_last() -> None:
    """From the tip, too: friction is a representative of nothing but itself unless it is preferred."""
    row = {"joint": "revolute", "alpha": "pi/2", "a": "0.2"}
    effects = [{"type": kind, "at": "all"} for kind in ("viscous", "rotor_inertia")]
    data = {"echelon": 1, "name": "arm", "modified_dh": [row] * 2, "effects": effects}
    arm = read_description(json.dumps(data), "arm", ReadingOptions())
    order = column_order(arm.columns, "tip-to-base")
    assert [arm.parameters[c] for c in order[-4:]] == ["Fv1", "Fv2", "Ia1", "Ia2"]
    assert [arm.parameters[c][-1] for c in order[:20]] == ["2"] * 10 + ["1"] * 10
    assert [
        arm.parameters[c] for c in column_order(arm.columns, "tip-to-base", ["Ia2"])[:2]
    ] == ["Ia2", "XX2"]
    # the inertia of the first rotor cannot be told from those of links, among which are the representatives
    assert "Ia1" not in ec.base_parameters(arm, order="tip-to-base").pivots


def test_what_cannot_be_seen_cannot_be_a_representative() -> None:
    assert "M1" not in ec.base_parameters(arms.rx90(), prefer=("M1",)).pivots


def test_denominators_are_in_lowest_terms() -> None:
    model = ec.base_parameters(arms.double_pendulum(), prefer=("M2",))
    row = model.matrix.rows[0]
    assert {model.parameters[c]: str(x) for c, x in row.items()} == {
        "M2": "1",
        "MX1": "(1)/(l1)",
    }


@pytest.mark.parametrize(
    ("order", "prefer"),
    [("sideways", ()), ("base-to-tip", ("M9",)), ("base-to-tip", ("mass",))],
)
def test_unknown_choices_are_refused(order: str, prefer: tuple[str, ...]) -> None:
    with pytest.raises(ec.InputError):
        ec.base_parameters(arms.rx90(), order=order, prefer=prefer)


@pytest.mark.parametrize("order", ["base-to-tip", "tip-to-base"])
def test_parameters_of_effects_stay_behind_those_of_bodies(order: str) -> None:
    """Unless a user prefers one: then it comes first, and the rest keeps its order."""
    bodies = [
        Parameter(f"{PARAMETERS[kind]}{body + 1}", UNITS[kind], body, kind)
        for body in range(2)
        for kind in (5, 9)
    ]
    columns = (*bodies, Parameter("Fv1", "N·m·s/rad"), Parameter("Fc1", "N·m"))
    expected = (0, 1, 2, 3, 4, 5) if order == "base-to-tip" else (2, 3, 0, 1, 4, 5)
    assert column_order(columns, order) == expected
    assert column_order(columns, order, ("Fc1",)) == (
        5,
        *(c for c in expected if c != 5),
    )


def test_an_effect_is_a_representative_only_where_no_body_can_be() -> None:
    """A rotor on the joint's side of a pendulum does what ZZ does: in both orders the body represents them."""
    pendulum = arms.modified_dh("pendulum", "R 0 0 0", "R 0 l1 0", gravity="0 -g 0")
    rotors = tuple(
        ready_made("rotor_inertia", q, Side.JOINT, q[1], sliding=False)[0]
        for q in ("q1", "q2")
    )
    for order in ("base-to-tip", "tip-to-base"):
        pivots = ec.base_parameters(
            replace(pendulum, effects=rotors), order=order
        ).pivots
        assert pivots[-1] == "Ia2"
        assert "Ia1" not in pivots
