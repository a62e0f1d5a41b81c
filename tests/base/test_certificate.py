"""The certificate passes right sets and refuses every tampered one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import sympy

import echelon as ec
from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.exact.rational import RationalFunction
from echelon.base.certificate import _Checks, certify
from echelon.base.derive import model_at_stated_values
from echelon.base.matrix import BaseMatrix
from echelon.dynamics.linear_forms import (
    inverse_dynamics_regressor,
    virtual_power_form,
)
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms
from support.derived import base_of
from support.descriptions import read_description
from support.paths import ROOT
from support.selection import one_in, slow_unless

Rows = list[dict[int, RationalFunction]]


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return base_of(arms.rx90)


@pytest.mark.parametrize(
    "robot",
    [arms.rx90, arms.panda, arms.stanford, arms.helical, arms.coupled, arms.massless],
)
@pytest.mark.parametrize("forms", [virtual_power_form, inverse_dynamics_regressor])
def test_right_sets_pass(
    robot: Callable[[], Mechanism], forms: Callable[[Mechanism], Any]
) -> None:
    """On combinations of rows, and on X itself."""
    model = ec.base_parameters(robot())
    certificate = certify(forms(model.mechanism), model.matrix, seed=7)
    assert certificate.rank == model.rank
    assert certificate.log10_error < -30


def refuted(model: ec.BaseModel, matrix: BaseMatrix) -> str:
    with pytest.raises(ec.CertificateError) as caught:
        certify(virtual_power_form(model.mechanism), matrix, seed=7)
    return str(caught.value)


def changed(matrix: BaseMatrix, change: Callable[[Rows], None]) -> BaseMatrix:
    rows = [dict(row) for row in matrix.rows]
    change(rows)
    return replace(matrix, rows=tuple(rows))


@pytest.mark.parametrize(
    "factor", [-1, 2, 1 + Fraction(1, 10**9), Polynomial.generator("D3")]
)
@pytest.mark.parametrize("where", one_in(4, range(0, 40, 3)))
def test_any_changed_coefficient_is_found(
    base: ec.BaseModel, where: int, factor: Any
) -> None:
    places = [
        (i, c)
        for i, row in enumerate(base.matrix.rows)
        for c in row
        if c != base.matrix.pivots[i]
    ]
    i, column = places[where % len(places)]

    def change(rows: Rows) -> None:
        rows[i][column] = rows[i][column] * RationalFunction(factor)

    assert base.parameters[column] in refuted(base, changed(base.matrix, change))


@pytest.mark.parametrize("where", range(0, 36, 5))
def test_dropped_parameter_is_found(base: ec.BaseModel, where: int) -> None:
    m = base.matrix
    cut = replace(
        m,
        pivots=m.pivots[:where] + m.pivots[where + 1 :],
        rows=m.rows[:where] + m.rows[where + 1 :],
    )
    assert base.pivots[where] in refuted(base, cut)


def test_added_parameters_are_found(base: ec.BaseModel) -> None:
    m = base.matrix
    free = [
        c for c in range(len(m.parameters)) if not any(c in row for row in m.rows)
    ]  # unidentifiable
    rows = dict(
        zip(
            (*m.pivots, free[0]), (*m.rows, {free[0]: RationalFunction(1)}), strict=True
        )
    )
    pivots = tuple(sorted(rows))
    assert "too large" in refuted(
        base, replace(m, pivots=pivots, rows=tuple(rows[p] for p in pivots))
    )


def test_a_dependent_parameter_made_a_representative_is_found(
    base: ec.BaseModel,
) -> None:
    m = base.matrix
    column = m.parameters.index("YY2")
    rows = {
        p: {c: x for c, x in row.items() if c != column}
        for p, row in zip(m.pivots, m.rows, strict=True)
    }
    rows[column] = {column: RationalFunction(1)}
    pivots = tuple(sorted(rows))
    assert "too large" in refuted(
        base, replace(m, pivots=pivots, rows=tuple(rows[p] for p in pivots))
    )


def test_echelon_form_is_checked(base: ec.BaseModel) -> None:
    m = base.matrix
    assert "order" in refuted(
        base, replace(m, pivots=m.pivots[::-1], rows=m.rows[::-1])
    )
    assert "permutation" in refuted(base, replace(m, order=(0, *m.order[:-1])))
    assert "before it" in refuted(
        base, replace(m, order=m.order[::-1], pivots=m.pivots[::-1], rows=m.rows[::-1])
    )

    def mix(rows: Rows) -> None:
        rows[0][m.pivots[1]] = RationalFunction(1)

    assert "contains the representative" in refuted(base, changed(m, mix))

    def scale(rows: Rows) -> None:
        rows[0] = {c: x * RationalFunction(2) for c, x in rows[0].items()}

    assert "not 1" in refuted(base, changed(m, scale))


def test_the_set_of_another_robot_is_refused(base: ec.BaseModel) -> None:
    assert refuted(base, ec.base_parameters(arms.puma560()).matrix)
    assert "standard parameters" in refuted(
        base, ec.base_parameters(arms.panda()).matrix
    )


def test_full_rank_and_rank_zero() -> None:
    free = ec.base_parameters(
        arms.tree("free", arms.body(1, 0, "floating", *arms.floating_motions("b")))
    )
    assert (free.rank, len(free.parameters)) == (10, 10)
    still = ec.base_parameters(arms.tree("still", arms.body(1, 0, "fixed")))
    assert still.rank == 0
    wrong = replace(still.matrix, pivots=(0,), rows=({0: RationalFunction(1)},))
    assert "too large" in refuted(still, wrong)


def test_the_bound_knows_multiples_of_angles() -> None:
    """A coupling by 50 makes sines of degree 50 in the angle that is drawn."""

    def coupled(ratio: str) -> ec.BaseModel:
        bodies = arms.modified_dh("", "R pi/2 0 0", "R 0 l1 0").bodies
        return ec.base_parameters(
            arms.tree("geared", *bodies, couplings={"q2": {"q1": ratio}})
        )

    direct, geared = coupled("1").certificate, coupled("50").certificate
    assert geared.degree > 10 * direct.degree
    assert geared.log10_error < -30


EXAMPLES = sorted((ROOT / "examples").glob("*.*ml"))


@pytest.fixture(scope="module")
def linkage() -> ec.BaseModel:
    return base_of("loops/four_bar")


@pytest.mark.parametrize("step", slow_unless([5], [1, 5]))
def test_along_curves_changed_dropped_and_added_parameters_are_found(
    linkage: ec.BaseModel, step: int
) -> None:
    m = linkage.matrix
    for i, row in list(enumerate(m.rows))[::step]:
        for column in sorted(row.keys() - {m.pivots[i]})[::step]:

            def change(rows: Rows, i: int = i, column: int = column) -> None:
                rows[i][column] = rows[i][column] * RationalFunction(
                    1 + Fraction(1, 10**9)
                )

            assert m.parameters[column] in refuted(linkage, changed(m, change))
        cut = replace(
            m,
            pivots=m.pivots[:i] + m.pivots[i + 1 :],
            rows=m.rows[:i] + m.rows[i + 1 :],
        )
        assert m.parameters[m.pivots[i]] in refuted(linkage, cut)
    free = next(
        c for c in range(len(m.parameters)) if not any(c in row for row in m.rows)
    )
    rows = dict(
        zip((*m.pivots, free), (*m.rows, {free: RationalFunction(1)}), strict=True)
    )
    pivots = tuple(sorted(rows))
    assert "too large" in refuted(
        linkage, replace(m, pivots=pivots, rows=tuple(rows[p] for p in pivots))
    )


@pytest.mark.parametrize(
    "name", slow_unless(["parallelogram"], ["parallelogram", "sr400", "bennett"])
)
def test_residuals_at_closed_states(name: str) -> None:
    certificate = base_of(f"loops/{name}").certificate
    assert certificate.log10_residual is not None
    assert certificate.log10_residual < -60
    assert "minor in ball arithmetic" in str(certificate)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_error_bound_of_the_examples(file: Path) -> None:
    certificate = ec.base_parameters(ec.load(file)).certificate
    assert certificate.log10_error < -30
    assert len(set(certificate.identity_primes)) == 2
    assert all(
        p.bit_length() == 81 and sympy.isprime(p) for p in certificate.identity_primes
    )
    assert sympy.isprime(certificate.minor_prime)
    assert f"rank {certificate.rank} proved" in str(certificate)


@pytest.mark.parametrize("where", range(0, 40, 7))
def test_a_coefficient_in_another_column_is_found(
    base: ec.BaseModel, where: int
) -> None:
    places = [
        (i, c)
        for i, row in enumerate(base.matrix.rows)
        for c in row
        if c != base.matrix.pivots[i]
    ]
    i, column = places[where % len(places)]
    taken = {*base.matrix.rows[i], *base.matrix.pivots}
    other = next(
        c
        for c in range(column + 1, 2 * len(base.parameters))
        if c % len(base.parameters) not in taken
    )

    def change(rows: Rows) -> None:
        rows[i][other % len(base.parameters)] = rows[i].pop(column)

    assert refuted(base, changed(base.matrix, change))


def test_nothing_is_not_enough(base: ec.BaseModel) -> None:
    assert "incomplete" in refuted(base, replace(base.matrix, pivots=(), rows=()))


def test_symbols_of_nobody_are_found(base: ec.BaseModel) -> None:
    """Even one that would vanish if it were drawn as zero."""
    stray = RationalFunction(Polynomial.generator("stray"))

    def change(rows: Rows) -> None:
        rows[0][59] = rows[0][59] + stray

    assert "M6" in refuted(base, changed(base.matrix, change))


def test_a_column_that_no_check_reaches_is_an_error(
    base: ec.BaseModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever check forgets a column: here the identity is asked for all others."""
    asked = _Checks._identity
    monkeypatch.setattr(
        _Checks,
        "_identity",
        lambda checks, forms, columns: asked(checks, forms, sorted(columns)[1:]),
    )
    assert "no check reaches XX1" in refuted(base, base.matrix)


def test_the_certificate_counts_the_columns_that_each_check_reached(
    base: ec.BaseModel, linkage: ec.BaseModel
) -> None:
    assert base.certificate.columns == {"minor": 36, "identity": 24}
    assert linkage.certificate.columns == {"minor": 8, "balls": 22}
    assert base.certificate.holds == "at the stated values"
    assert linkage.certificate.holds == "at the stated values, near the assembly pose"
    general = ec.base_parameters(arms.rx90(), generic=True).certificate
    assert general.holds == "for general values of the symbols"


@pytest.mark.slow
def test_special_lengths_of_loops_count_in_the_minor() -> None:
    """A parallelogram whose lengths are four symbols: the general set has 8, at the stated values there are 3."""
    text = """echelon: 1
name: parallelogram
symbols: {l1: 0.4, l2: 0.15, l3: 0.4, l4: 0.15}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [l2, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [l1, 0, 0]}}}
loops:
  - {joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}, axis: z}
assembly: {crank: 1.0, coupler: -1.0, rocker: 1.0}
"""
    mechanism = read_description(text, "parallelogram.yaml", ReadingOptions())
    general = ec.base_parameters(mechanism, generic=True)
    assert (general.rank, ec.base_structure(mechanism).rank) == (8, 3)
    forms = virtual_power_form(mechanism)
    assert certify(forms, general.matrix, seed=7).rank == 8
    with pytest.raises(
        ec.CertificateError, match="span only 3 dimensions at the stated values"
    ):
        certify(forms, general.matrix, 7, model_at_stated_values(mechanism))
