"""What a BaseModel offers: B in three forms, numbers, classification and regressors."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest

import echelon as ec
from echelon.base.display import to_html, to_latex, to_markdown, to_text
from support import textbook_arms as arms
from support.float_regressor import random_states
from support.robot_files import robot_file


@pytest.fixture(scope="module")
def base() -> ec.BaseModel:
    return ec.base_parameters(arms.panda())


@pytest.fixture(scope="module")
def zeta(base: ec.BaseModel) -> np.ndarray:
    return np.random.default_rng(1).uniform(-1, 1, len(base.parameters))


# -- B and numbers ---------------------------------------------------------------------------------


def test_three_forms_of_b_agree(base: ec.BaseModel) -> None:
    values = {name: float(text) for name, text in arms.PANDA.items()}
    from_symbols = np.array(base.B.subs(values).tolist(), dtype=float)
    from_exact = np.array(base.B_exact.tolist(), dtype=float)
    np.testing.assert_allclose(from_symbols, base.B_float(), rtol=1e-14)
    np.testing.assert_allclose(from_exact, base.B_float(), rtol=1e-14)
    assert base.B.shape == base.B_float().shape == (43, 70)
    assert all(entry.is_Rational for entry in base.B_exact.todok().values())


def test_values(base: ec.BaseModel, zeta: np.ndarray) -> None:
    np.testing.assert_allclose(base.values(zeta), base.B_float() @ zeta)
    longer = {"a4": 0.1}
    np.testing.assert_allclose(base.values(zeta, longer), base.B_float(longer) @ zeta)
    assert not np.allclose(base.values(zeta, longer), base.values(zeta))


def test_values_of_a_file() -> None:
    base = ec.base_parameters(ec.load(robot_file("ur10_robot")))
    np.testing.assert_allclose(base.values(), base.B_float() @ base.standard_values())
    q, qd, qdd = random_states(base.mechanism, 5)
    full = base.standard_regressor(q, qd, qdd) @ base.standard_values()
    np.testing.assert_allclose(
        base.regressor(q, qd, qdd) @ base.values(), full, rtol=1e-10, atol=1e-10
    )


def test_missing_numbers_are_named(base: ec.BaseModel) -> None:
    with pytest.raises(ec.InputError, match="no values for 7 bodies"):
        base.values()
    with pytest.raises(ec.InputError, match="shape"):
        base.values([1.0, 2.0])
    unknown = ec.base_parameters(arms.stanford())
    with pytest.raises(ec.InputError, match="'d2' has no value"):
        unknown.B_float()
    with pytest.raises(ec.InputError, match="'d2' has no value"):
        _ = unknown.B_exact
    assert unknown.B_float({"d2": 0.1}).shape == unknown.B.shape


def test_misspelt_symbols_are_refused(base: ec.BaseModel) -> None:
    """Also those that B does not need are known: d1 and gravity occur in X or in the mechanism only."""
    states = random_states(base.mechanism, 2)
    with pytest.raises(
        ec.InputError, match=r"'a44' is not a symbol .*valid: a4, a7, d1, d3, d5"
    ):
        base.B_float({"a44": 0.1})
    with pytest.raises(ec.InputError, match="'a44'"):
        base.regressor(*states, {"a44": 0.1})
    np.testing.assert_array_equal(base.B_float({"d1": 9.0}), base.B_float())
    pendulum = ec.base_parameters(arms.double_pendulum())
    moon, earth = (
        pendulum.regressor([1, 1], [0, 0], [0, 0], {"g": g}) for g in (1.6, 9.6)
    )
    np.testing.assert_allclose(6 * moon, earth)


def test_units(base: ec.BaseModel) -> None:
    units = dict(zip(base.pivots, base.units, strict=True))
    assert (units["ZZ1"], units["MX2"]) == ("kg·m²", "kg·m")
    assert ec.base_parameters(arms.cartesian()).units == ("kg",) * 3


def test_classification_follows_its_definition(base: ec.BaseModel) -> None:
    b = base.B_float({name: 0.1 + 0.37 * i for i, name in enumerate(arms.PANDA)})
    for column, (name, kind) in enumerate(base.classification.items()):
        rows = np.flatnonzero(b[:, column])
        if not len(rows):
            assert kind is ec.Identifiability.UNIDENTIFIABLE, name
        elif len(rows) == 1 and np.count_nonzero(b[rows[0]]) == 1:
            assert kind is ec.Identifiability.ALONE, name
        else:
            assert kind is ec.Identifiability.COMBINATION, name


def test_frozen(base: ec.BaseModel) -> None:
    with pytest.raises(FrozenInstanceError):
        base.seed = 3  # type: ignore[misc]


# -- regressors ------------------------------------------------------------------------------------


def test_reduced_regressor_is_the_pivot_columns(base: ec.BaseModel) -> None:
    states = random_states(base.mechanism, 3)
    full, reduced = base.standard_regressor(*states), base.regressor(*states)
    assert full.shape == (3, 7, 70)
    np.testing.assert_allclose(
        reduced, full[:, :, list(base.matrix.pivots)], rtol=1e-13, atol=1e-13
    )
    np.testing.assert_allclose(
        reduced @ base.B_float(), full, atol=1e-12 * np.abs(full).max()
    )
    assert sum(base.reduced.operations().values()) < sum(
        base.standard_forms.operations().values()
    )


def test_blocks_of_samples_join(base: ec.BaseModel) -> None:
    states = random_states(base.mechanism, 1500)
    whole = base.regressor(*states)
    np.testing.assert_array_equal(
        whole[1020:1030], base.regressor(*(x[1020:1030] for x in states))
    )
    assert base.regressor(*(x[:0] for x in states)).shape == (0, 7, 43)


def test_shapes_are_checked(base: ec.BaseModel) -> None:
    q, qd, qdd = random_states(base.mechanism, 4)
    with pytest.raises(ec.InputError, match="q has shape"):
        base.regressor(q[:, :3], qd, qdd)
    with pytest.raises(ec.InputError, match="different numbers of samples"):
        base.regressor(q, qd[:2], qdd)


# -- showing ---------------------------------------------------------------------------------------


def test_repr(base: ec.BaseModel) -> None:
    assert repr(base) == "BaseModel(panda: 43 base parameters of 70)"


def test_an_empty_answer() -> None:
    still = ec.base_parameters(arms.tree("still"))
    for show in (to_text, to_markdown, to_latex, to_html):
        assert "0 base parameters of 0" in show(still)
    assert still.values([]).shape == (0,)
    assert still.lift([]).shape == (0,)
    assert still.B.shape == (0, 0)


def test_negative_seeds_are_refused() -> None:
    with pytest.raises(ec.InputError, match="the seed -1 is negative"):
        ec.base_parameters(ec.load("examples/double_pendulum.yaml"), seed=-1)
