"""The certificate passes right sets and refuses every tampered one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import arms
import echelon as ec
from echelon.base.certificate import certify
from echelon.base.matrix import BaseMatrix
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.newton_euler import inverse_dynamics_regressor
from echelon.regressor.virtual_power import virtual_power_form

Rows = list[dict[int, RationalFunction]]


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return ec.base_parameters(arms.rx90())


@pytest.mark.parametrize("robot", [arms.rx90, arms.panda, arms.stanford, arms.helical, arms.coupled, arms.massless])
@pytest.mark.parametrize("forms", [virtual_power_form, inverse_dynamics_regressor])
def test_right_sets_pass(robot: Callable[[], Mechanism], forms: Callable[[Mechanism], Any]) -> None:
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


@pytest.mark.parametrize("factor", [-1, 2, 1 + Fraction(1, 10**9), Polynomial.generator("D3")])
@pytest.mark.parametrize("where", range(0, 40, 3))
def test_any_changed_coefficient_is_found(base: ec.BaseModel, where: int, factor: Any) -> None:
    places = [(i, c) for i, row in enumerate(base.matrix.rows) for c in row if c != base.matrix.pivots[i]]
    i, column = places[where % len(places)]

    def change(rows: Rows) -> None:
        rows[i][column] = rows[i][column] * RationalFunction(factor)

    assert base.parameters[column] in refuted(base, changed(base.matrix, change))


@pytest.mark.parametrize("where", range(0, 36, 5))
def test_dropped_parameter_is_found(base: ec.BaseModel, where: int) -> None:
    m = base.matrix
    cut = replace(m, pivots=m.pivots[:where] + m.pivots[where + 1 :], rows=m.rows[:where] + m.rows[where + 1 :])
    assert base.pivots[where] in refuted(base, cut)


def test_added_parameters_are_found(base: ec.BaseModel) -> None:
    m = base.matrix
    free = [c for c in range(len(m.parameters)) if not any(c in row for row in m.rows)]  # unidentifiable
    rows = dict(zip((*m.pivots, free[0]), (*m.rows, {free[0]: RationalFunction(1)}), strict=True))
    pivots = tuple(sorted(rows))
    assert "too large" in refuted(base, replace(m, pivots=pivots, rows=tuple(rows[p] for p in pivots)))


def test_a_dependent_parameter_made_a_representative_is_found(base: ec.BaseModel) -> None:
    m = base.matrix
    column = m.parameters.index("YY2")
    rows = {p: {c: x for c, x in row.items() if c != column} for p, row in zip(m.pivots, m.rows, strict=True)}
    rows[column] = {column: RationalFunction(1)}
    pivots = tuple(sorted(rows))
    assert "too large" in refuted(base, replace(m, pivots=pivots, rows=tuple(rows[p] for p in pivots)))


def test_echelon_form_is_checked(base: ec.BaseModel) -> None:
    m = base.matrix
    assert "order" in refuted(base, replace(m, pivots=m.pivots[::-1], rows=m.rows[::-1]))
    assert "permutation" in refuted(base, replace(m, order=(0, *m.order[:-1])))
    assert "before it" in refuted(base, replace(m, order=m.order[::-1], pivots=m.pivots[::-1], rows=m.rows[::-1]))

    def mix(rows: Rows) -> None:
        rows[0][m.pivots[1]] = RationalFunction(1)

    assert "contains the representative" in refuted(base, changed(m, mix))

    def scale(rows: Rows) -> None:
        rows[0] = {c: x * RationalFunction(2) for c, x in rows[0].items()}

    assert "not 1" in refuted(base, changed(m, scale))


def test_the_set_of_another_robot_is_refused(base: ec.BaseModel) -> None:
    assert refuted(base, ec.base_parameters(arms.puma560()).matrix)
    assert "standard parameters" in refuted(base, ec.base_parameters(arms.panda()).matrix)


def test_full_rank_and_rank_zero() -> None:
    free = ec.base_parameters(arms.tree("free", arms.body(1, 0, "floating", *arms.floating_motions("b"))))
    assert (free.rank, len(free.parameters)) == (10, 10)
    still = ec.base_parameters(arms.tree("still", arms.body(1, 0, "fixed")))
    assert still.rank == 0
    wrong = replace(still.matrix, pivots=(0,), rows=({0: RationalFunction(1)},))
    assert "too large" in refuted(still, wrong)


# -- saved files ----------------------------------------------------------------------------------------------------


@pytest.fixture
def saved(base: ec.BaseModel, tmp_path: Path) -> Path:
    file = tmp_path / "base.json"
    ec.save_base(base, file)
    return file


def test_a_saved_set_verifies_with_fresh_points(saved: Path, base: ec.BaseModel) -> None:
    first, second = ec.verify(saved), ec.verify(saved, seed=123)
    assert first.rank == second.rank == 36
    assert not {*first.identity_primes, *second.identity_primes} & {*base.certificate.identity_primes}


def coefficient(data: Any) -> None:
    term = next(t for row in data["base"] for t in row["terms"] if "D3" in t["coefficient"])
    term["coefficient"] = term["coefficient"].replace("D3", "RL4")


TAMPERED: dict[str, Callable[[Any], Any]] = {
    "coefficient": coefficient,
    "row dropped": lambda data: data["base"].pop(3),
    "row dropped and rank adjusted": lambda data: (
        data["base"].pop(3), data["certificate"].update(rank=35), data.update(rank=35),
    ),
    "term dropped": lambda data: data["base"][0]["terms"].pop(),
    "term moved": lambda data: data["base"][0]["terms"][-1].update(parameter="M2"),
    "row added": lambda data: data["base"].insert(
        0, {"name": "XX1", "unit": "", "expression": "", "terms": [{"parameter": "XX1", "coefficient": "1"}]}
    ),
    "rows swapped": lambda data: data["base"].reverse(),
    "another gravity": lambda data: data["model"].update(gravity=[1, 2, 3]),
}  # fmt: skip


@pytest.mark.parametrize("case", TAMPERED)
def test_tampered_files_are_refuted(saved: Path, case: str) -> None:
    data = json.loads(saved.read_text())
    TAMPERED[case](data)
    saved.write_text(json.dumps(data))
    with pytest.raises(ec.CertificateError):
        ec.verify(saved)


DAMAGED: dict[str, Callable[[str], str]] = {
    "truncated": lambda text: text[: len(text) // 2],
    "not json": lambda _: "hello",
    "empty": lambda _: "",
    "list": lambda _: "[]",
    "schema": lambda text: text.replace("base-model/1", "base-model/9"),
    "expression": lambda text: text.replace('"D3^2"', '"__import__(1)"'),
    "unknown parameter": lambda text: text.replace('"parameter": "M6"', '"parameter": "M9"'),
    "extra key": lambda text: text.replace('"seed"', '"sede"', 1),
}


@pytest.mark.parametrize("case", DAMAGED)
def test_damaged_files_are_input_errors(saved: Path, case: str) -> None:
    text = DAMAGED[case](saved.read_text())
    assert text != saved.read_text()
    saved.write_text(text)
    with pytest.raises(ec.InputError, match=r"base\.json"):
        ec.verify(saved)


def test_round_trip_is_exact(base: ec.BaseModel, saved: Path, tmp_path: Path) -> None:
    again = ec.load_base(saved)
    assert again.matrix == base.matrix
    assert again.mechanism.bodies == base.mechanism.bodies
    assert again.mechanism.gravity == base.mechanism.gravity
    assert again.certificate == base.certificate
    ec.save_base(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_text() == saved.read_text()
    np.testing.assert_array_equal(again.B_float(), base.B_float())


@pytest.mark.parametrize(
    "robot",
    [arms.helical, arms.universal, arms.cylindrical, arms.coupled, arms.rack, arms.massless, arms.floating_pair],
)
def test_every_kind_of_robot_is_saved(robot: Callable[[], Mechanism], tmp_path: Path) -> None:
    model = ec.base_parameters(robot())
    ec.save_base(model, tmp_path / "base.json")
    assert ec.verify(tmp_path / "base.json").rank == model.rank
    assert ec.load_base(tmp_path / "base.json").matrix == model.matrix
