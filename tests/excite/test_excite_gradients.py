"""The information of a motion, and its exact derivatives, against regressors and differences."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.excite.problem.information import (
    ADJOINT,
    Information,
    OptimalityCriterion,
    StateRegressor,
    pullback,
)
from echelon.excite.problem.trajectory import (
    Basis,
    Fourier,
    resting_ends,
    uniform_splines,
)
from echelon.shared.choices import Optimality
from echelon.shared.errors import InputError
from support.excitation_cases import Floats, slope_along, slopes_by_state
from support.paths import EXAMPLES
from support.selection import slow_unless

SMOOTH = 0.1

WRENCH = """
echelon: 1
name: sensed
symbols: {l1: 0.4, l2: 0.3}
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2, a: l1}
  - {joint: prismatic, alpha: -pi/2, a: l2}
outputs: [{wrench: base}, {joint: all}]
effects: [{type: viscous, at: all}]
"""
STANFORD = """
echelon: 1
name: stanford
symbols: {d2: 0.15}
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: -pi/2, d: d2}
  - {joint: prismatic, alpha: pi/2}
  - {joint: revolute}
effects: [{type: coulomb, at: all}, {type: viscous, at: all}]
"""
ROBOTS = slow_unless(
    lambda name: name not in ("ur10", "panda"),
    ("ur10", "panda", "tx40", "scara", "stanford", "wrench"),
)


@cache
def base_of(name: str) -> BaseModel:
    texts = {"wrench": WRENCH, "stanford": STANFORD}
    if name in texts:
        return ec.base_parameters(loaded(texts[name]))
    return ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml"))


def loaded(text: str) -> ec.Mechanism:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.yaml"
        file.write_text(text, encoding="utf-8")
        return ec.load(file)


@cache
def regressor_of(name: str, smooth: float | None) -> StateRegressor:
    base = base_of(name)
    return StateRegressor(base.mechanism, base.matrix.pivots, smooth)


def states(base: BaseModel, count: int = 7, seed: int = 0) -> dict[str, Floats]:
    rng = np.random.default_rng(seed)
    n = len(base.mechanism.positions)
    return {name: rng.uniform(-2, 2, (count, n)) for name in ("q", "qd", "qdd")}


def dense(base: BaseModel, regressor: StateRegressor, entries: Floats) -> Floats:
    """The observation matrix of every sample from its entries."""
    found = np.zeros((len(entries), len(base.mechanism.outputs), base.rank))
    for output, rows in enumerate(regressor.rows):
        found[:, output, rows.columns] = entries[:, rows.entries]
    return found


# -- entries -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_entries_are_those_of_the_regressor(name: str) -> None:
    base, regressor = base_of(name), regressor_of(name, None)
    state = states(base)
    expected = base.regressor(**state)
    found = dense(base, regressor, regressor.entries(state))
    np.testing.assert_allclose(
        found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max()
    )
    assert regressor.size == sum(
        rows.entries.stop - rows.entries.start for rows in regressor.rows
    )


def test_smooth_entries_differ_near_standstill_only() -> None:
    base = base_of("tx40")
    smooth = regressor_of("tx40", SMOOTH)
    state = states(base)
    state["qd"] = np.where(np.abs(state["qd"]) < 1.0, 1.0, state["qd"])
    state["qd"][:, 5] = 2.0  # the sum of the wrist's speeds has a sign of its own
    fast = np.abs(state["qd"][:, 4] + state["qd"][:, 5]) > 1.0
    expected = base.regressor(**state)
    found = dense(base, smooth, smooth.entries(state))
    np.testing.assert_allclose(found[fast], expected[fast], atol=1e-6)
    state["qd"] *= 0.05
    slow = dense(base, smooth, smooth.entries(state)) - base.regressor(**state)
    assert np.abs(slow).max() > 0.05


def test_signs_become_hyperbolic_tangents() -> None:
    base, smooth = base_of("stanford"), regressor_of("stanford", SMOOTH)
    state = states(base)
    found = dense(base, smooth, smooth.entries(state))
    names = [base.parameters[p] for p in base.matrix.pivots]
    for joint in range(4):
        column = names.index(f"Fc{joint + 1}")
        np.testing.assert_allclose(
            found[:, joint, column], np.tanh(state["qd"][:, joint] / SMOOTH), rtol=1e-12
        )


# -- pullback ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ROBOTS)
def test_pullback(name: str) -> None:
    """Σ G · X with constant G, differentiated by every coordinate."""
    base, regressor = base_of(name), regressor_of(name, SMOOTH)
    state = states(base, 4)
    adjoint = np.random.default_rng(1).normal(size=(4, regressor.size))
    found = regressor.pulled(state, adjoint)

    def total(**moved: Floats) -> Floats:
        return np.asarray(np.sum(regressor.entries(moved) * adjoint, axis=1))

    for part, which in zip(found, ("q", "qd", "qdd"), strict=True):
        expected = slopes_by_state(total, state, which)
        np.testing.assert_allclose(
            part, expected, rtol=1e-6, atol=1e-7 * max(np.abs(f).max() for f in found)
        )


def test_pullback_has_one_more_argument() -> None:
    function = regressor_of("scara", SMOOTH).function
    found = pullback(function)
    assert [a.name for a in found.arguments] == [
        *(a.name for a in function.arguments),
        ADJOINT,
    ]
    assert found.shape == (9,)
    assert len(found.arguments[-1]) == len(function.entries)


# -- information -------------------------------------------------------------------------------------------------------


def family(name: str) -> Basis:
    return resting_ends(
        Fourier(2.0, 3)
        if name in ("ur10", "tx40", "wrench")
        else uniform_splines(2.0, 5)
    )


def information(name: str, smooth: float | None, prior: float = 0.0) -> Information:
    base = base_of(name)
    weights = np.random.default_rng(2).uniform(0.5, 2, len(base.mechanism.outputs))
    times = np.arange(60) / 30
    return Information(
        regressor_of(name, smooth),
        family(name),
        times,
        weights,
        prior * np.eye(base.rank),
    )


@pytest.mark.parametrize("name", ROBOTS)
def test_information_is_the_weighted_sum_of_squares(name: str) -> None:
    base, basis = base_of(name), family(name)
    found = information(name, None, prior=0.3)
    C = np.random.default_rng(0).normal(
        size=(basis.size, len(base.mechanism.velocities))
    )
    times = np.arange(60) / 30
    q, qd, qdd = (basis.values(times, order) @ C for order in range(3))
    X = base.regressor(q, qd, qdd)
    expected = 0.3 * np.eye(base.rank) + np.einsum("nor,o,nos->rs", X, found.weights, X)
    np.testing.assert_allclose(
        found(C).F, expected, rtol=1e-10, atol=1e-11 * np.abs(expected).max()
    )


@pytest.mark.parametrize("criterion", ["d_optimal", "a_optimal", "condition"])
@pytest.mark.parametrize("name", ROBOTS)
def test_gradients(name: str, criterion: Optimality) -> None:
    """Along random directions and by single coefficients, as fourth-order differences have them."""
    base, seen = base_of(name), information(name, SMOOTH, prior=0.1)
    rng = np.random.default_rng(3)
    measure = OptimalityCriterion(criterion, 10 ** rng.uniform(-0.5, 0.5, base.rank))
    C = rng.normal(size=(family(name).size, len(base.mechanism.velocities))) * 0.5

    def value(moved: Floats) -> float:
        return measure.evaluate(seen(moved).F)[0]

    at = seen(C)
    gradient = at.gradient(measure.evaluate(at.F)[1])
    assert gradient.shape == C.shape
    directions = [rng.normal(size=C.shape) for _ in range(2)]
    for _ in range(2):
        single = np.zeros(C.shape)
        single[rng.integers(C.shape[0]), rng.integers(C.shape[1])] = 1
        directions.append(single)
    for D in directions:
        D = D / np.linalg.norm(D)
        expected = float(slope_along(lambda t, D=D: value(C + t * D), 5e-4))
        found = float(np.sum(gradient * D))
        assert found == pytest.approx(
            expected, rel=1e-6, abs=1e-6 * float(np.linalg.norm(gradient))
        )


def test_more_samples_of_one_motion_add_up() -> None:
    base, basis = base_of("scara"), family("scara")
    C = np.random.default_rng(0).normal(size=(basis.size, 3))
    regressor, weights, zero = (
        regressor_of("scara", None),
        np.ones(3),
        np.zeros((base.rank, base.rank)),
    )
    times = np.linspace(0, 2, 50)
    parts = [
        Information(regressor, basis, t, weights, zero)(C).F
        for t in (times, times[:20], times[20:])
    ]
    np.testing.assert_allclose(
        parts[0], parts[1] + parts[2], rtol=1e-12, atol=1e-12 * np.abs(parts[0]).max()
    )


# -- what cannot be designed -------------------------------------------------------------------------------------------


def test_measured_inputs_are_refused() -> None:
    base = ec.base_parameters(
        loaded(STANFORD.replace("type: coulomb", "type: drive_gain"))
    )
    with pytest.raises(
        InputError,
        match=r"need the measured inputs of .*, which a trajectory does not determine",
    ):
        StateRegressor(base.mechanism, base.matrix.pivots)


def test_symbols_without_values_are_refused() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "stanford.yaml"))
    with pytest.raises(InputError, match="d2"):
        StateRegressor(base.mechanism, base.matrix.pivots)
