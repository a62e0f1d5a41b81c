"""Sets that were made to deceive the checks themselves: each is refused, or named as not checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

import echelon as ec
from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import Certificate, certify
from echelon.base.derive import model_at_stated_values
from echelon.base.matrix import StatedNumbers
from echelon.base.saved.saved import from_json, to_json
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import all_symbols, value_texts
from support.descriptions import read_description
from support.selection import one_in

ARM = """symbols: {l1: 0.5, alpha: 0.3, k: -1}
modified_dh: [{joint: revolute}, {joint: revolute, alpha: alpha, a: l1}]
effects: [{parameter: P, unit: N·m, acts: [{at: j1, term: '%s'}]}]
"""
FOUR_BAR = """gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [0, 0.3, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [0.7, 0, 0]}}}
loops:
  - {joint: revolute, connects: [coupler, rocker], at: {xyz: [0.6, 0.2, 0]}, on_second: {xyz: [-0.1, 0.5, 0]}, axis: z}
effects:
  - {parameter: P, unit: N·m, acts: [{at: crank, term: '%s'}]}
  - {parameter: Q, unit: N·m, acts: [{at: crank, term: '%s'}]}
"""


def robot(text: str) -> Mechanism:
    return read_description(
        f"echelon: 1\nname: robot\n{text}", "robot.yaml", ReadingOptions()
    )


def verified(model: ec.BaseModel) -> Certificate:
    """The certificate of a set that is given one as `derive` would, saved, and read back."""
    stated = None if model.generic else model_at_stated_values(model.mechanism)
    own = certify(virtual_power_form(model.mechanism), model.matrix, model.seed, stated)
    return ec.verify(from_json(to_json(replace(model, certificate=own))))


def rewritten(
    model: ec.BaseModel, change: Callable[[RationalFunction], RationalFunction]
) -> ec.BaseModel:
    rows = tuple(
        {c: change(value) for c, value in row.items()} for row in model.matrix.rows
    )
    return replace(model, matrix=replace(model.matrix, rows=rows))


HALF_TANGENTS: dict[str, dict[str, str]] = {
    "an angle as a number": {
        "cos(alpha)": "(1 - alpha^2)/(1 + alpha^2)",
        "sin(alpha)": "2*alpha/(1 + alpha^2)",
    },
    "a length as an angle": {"l1": "sin(l1)/(1 + cos(l1))"},
}


@pytest.mark.parametrize("case", HALF_TANGENTS)
def test_one_residue_does_not_stand_for_an_angle_and_a_number(case: str) -> None:
    """cos(alpha) is (1 - t²)/(1 + t²) for t = tan(alpha/2), and not for t = alpha."""

    def quotient(text: str) -> RationalFunction:
        above, _, below = text.partition("/")
        return RationalFunction(parse(above), parse(below or "1"))

    others = {name: quotient(text) for name, text in HALF_TANGENTS[case].items()}

    def change(value: RationalFunction) -> RationalFunction:
        known = {
            g: others.get(g, RationalFunction(Polynomial.generator(g)))
            for g in value.generators()
        }
        return value.evaluate(known, RationalFunction)

    with pytest.raises(ec.CertificateError, match="an angle and a plain number"):
        verified(rewritten(ec.base_parameters(robot(ARM % "qd")), change))


@pytest.mark.parametrize("term", ["sin(q)^40", "(1 - cos(q))^20", "qd*sin(q)^30"])
def test_effects_that_are_flat_at_the_pose_are_not_passed_over(term: str) -> None:
    """They show at states away from it."""
    base = ec.base_parameters(robot(FOUR_BAR % ("qd", term)))
    assert "Q" in map(str, base.expressions)


def as_numbers(model: ec.BaseModel, column: str, representative: str) -> ec.BaseModel:
    """A column said to equal another one, all coefficients as numbers."""
    place = model.parameters.index
    dropped = place(column)
    rows = {
        p: dict(row)
        for p, row in zip(model.matrix.pivots, model.matrix.rows, strict=True)
        if p != dropped
    }
    rows[place(representative)][dropped] = RationalFunction(1)
    values = model.B_float()
    for i, pivot in enumerate(model.matrix.pivots):
        for c in model.matrix.rows[i].keys() & rows.get(pivot, {}).keys():
            assert float(values[i, c]) == pytest.approx(
                float(model.matrix.rows[i][c].evaluate({}, float))
            )
    others = tuple(c for c in range(len(model.parameters)) if c not in rows)
    at = value_texts(model.mechanism, all_symbols(model.mechanism))
    pivots = tuple(p for p in model.matrix.order if p in rows)
    matrix = replace(
        model.matrix,
        pivots=pivots,
        rows=tuple(rows[p] for p in pivots),
        numbers=StatedNumbers(others, at, 1e-35, False),
    )
    return replace(model, matrix=matrix)


ROUNDED_PARALLELOGRAM = """gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [0.114726, 0.0966327, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [0.382135, 0.118208, 0]}}}
assembly: {crank: 0.139151, coupler: -0.139151, rocker: -0.260845}
loops:
  - joint: revolute
    connects: [coupler, rocker]
    at: {xyz: [0.382135, 0.118208, 0]}
    on_second: {xyz: [0.0680394, 0.133681, 0]}
    axis: z
"""
"""Bars of 0.4 m and 0.15 m whose ends are given with six digits."""


@pytest.fixture(scope="module")
def parallelogram() -> ec.BaseModel:
    return ec.base_parameters(robot(ROUNDED_PARALLELOGRAM))


def test_sets_of_rounded_files_are_verified_as_such(
    parallelogram: ec.BaseModel,
) -> None:
    numbers = parallelogram.matrix.numbers
    assert parallelogram.rank == 3
    assert numbers is not None
    assert numbers.rounded
    assert "to the last decimals of the file" in str(verified(parallelogram))


def test_only_loops_of_rounded_files_may_have_sets_that_are_rounded() -> None:
    base = ec.base_parameters(robot(FOUR_BAR % ("qd", "qd + q")))
    claimed = as_numbers(base, "Q", "P")
    numbers = claimed.matrix.numbers
    assert numbers is not None
    coarse = replace(numbers, radius=1.0, rounded=True)
    mechanism = replace(claimed.mechanism, rounding=0.0)
    with pytest.raises(ec.CertificateError, match=r"errors of 1e\+00 prove nothing"):
        verified(
            replace(
                claimed,
                mechanism=mechanism,
                matrix=replace(claimed.matrix, numbers=coarse),
            )
        )


def test_a_rounded_set_may_not_leave_more_than_rounding_explains(
    parallelogram: ec.BaseModel,
) -> None:
    rows = [dict(row) for row in parallelogram.matrix.rows]
    column = parallelogram.parameters.index("MX3")
    rows[1][column] = rows[1][column] * RationalFunction(2)
    matrix = replace(parallelogram.matrix, rows=tuple(rows))
    with pytest.raises(ec.CertificateError, match="incomplete or wrong"):
        verified(replace(parallelogram, matrix=matrix))


def test_tiny_terms_are_not_lost_beside_others_in_ball_arithmetic() -> None:
    with pytest.raises(ec.CertificateError, match="effect of Q"):
        ec.base_parameters(robot(FOUR_BAR % ("qd", "qd + 1e-200*q")))


def test_regions_that_closed_states_hardly_meet_are_named() -> None:
    base = ec.base_parameters(robot(FOUR_BAR % ("sign(q)", "sign(q - 1e-3)")))
    try:
        found = verified(as_numbers(base, "Q", "P"))
    except ec.CertificateError:
        return
    assert any("regions of signs" in what for what in found.unchecked)


def test_friction_in_loops_is_checked_as_a_whole() -> None:
    """Both signs of speeds are met at random closed states."""
    assert (
        ec.verify(ec.base_parameters(robot(FOUR_BAR % ("qd", "sign(qd)")))).unchecked
        == ()
    )


@pytest.mark.slow
def test_regions_that_no_search_reaches_are_named() -> None:
    base = ec.base_parameters(robot(ARM % "max(exp(-1e5*(q - 0.234)^2) - 0.5, 0)"))
    assert any("regions of signs" in what for what in ec.verify(base).unchecked)


def test_functions_that_span_too_much_are_refused() -> None:
    with pytest.raises(ec.InputError, match="binary digits"):
        ec.base_parameters(robot(ARM % "max(exp(-1e6*(q - 0.234)^2) - 0.5, 0)"))


def test_signs_of_constants_are_not_general() -> None:
    """max(k, 0) is nothing at k = -1, and something in general."""
    base = ec.base_parameters(robot(ARM % "max(k, 0)*qd"), generic=True)
    assert any("depends on k" in what for what in ec.verify(base).unchecked)


@pytest.mark.parametrize(
    "pose",
    one_in(
        2,
        [
            "crank: 0, coupler: 0, rocker: 0",
            "crank: 1e-9, coupler: -1e-9, rocker: 1e-9",
        ],
    ),
)
def test_a_flat_parallelogram_is_told_as_a_doubt(pose: str) -> None:
    """Two ways of assembly meet there: that of parallel cranks was taken, from a pose beside it."""
    text = f"""symbols: {{l1: 0.4, l2: 0.15, l3: 0.4, l4: 0.15}}
gravity: [0, -9.81, 0]
bodies:
  - {{name: crank, joint: {{type: revolute, axis: z}}}}
  - {{name: coupler, parent: crank, joint: {{type: revolute, axis: z, origin: {{xyz: [l2, 0, 0]}}}}}}
  - {{name: rocker, joint: {{type: revolute, axis: z, origin: {{xyz: [l1, 0, 0]}}}}}}
loops:
  - {{joint: revolute, connects: [coupler, rocker], at: {{xyz: [l3, 0, 0]}}, on_second: {{xyz: [l4, 0, 0]}}, axis: z}}
assembly: {{{pose}}}
"""
    base = ec.base_parameters(robot(text))
    assert base.rank == 3
    assert "singular" in base.reading.doubt


def test_a_largest_coefficient_that_is_another_is_refused() -> None:
    text = to_json(ec.base_parameters(robot(ARM % "qd")))
    with pytest.raises(ec.CertificateError, match="largest_coefficient"):
        from_json(
            text.replace(
                '"largest_coefficient": 1.0', '"largest_coefficient": 1000000000.0'
            )
        )
