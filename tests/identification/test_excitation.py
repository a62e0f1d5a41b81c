"""Excitation by data: conditioning, variance inflation and open combinations, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.identification.conditioning import conditioning, sensitivities
from echelon.identification.estimators.estimate import sparse_basis
from echelon.robot.effect import Side, ready_made
from support.derived import base_of
from support.linkages import four_bar
from support.observation_rows import ArrayRows
from support.selection import examples
from support.textbook_arms import double_pendulum, spherical


def observed(W: np.ndarray, noise: float = 0.0, seed: int = 0) -> ec.Observation:
    rng = np.random.default_rng(seed)
    y = W @ np.ones(W.shape[-1]) + noise * rng.normal(size=W.shape[:-1])
    return ArrayRows.of(W, y).observation()


@pytest.fixture(scope="module")
def pendulum() -> ec.BaseModel:
    return ec.base_parameters(ec.load("examples/double_pendulum.yaml"))


def swings(
    base: ec.BaseModel, first: float, second: float, noise: float = 0.0
) -> ec.Observation:
    """A log in which the joints swing with the given amplitudes."""
    t = np.linspace(0, 10, 500)
    amplitude, rate = np.array([first, second]), np.array([2.0, 3.1])
    phase = np.outer(t, rate)
    state = {"q": amplitude * np.sin(phase), "qd": amplitude * rate * np.cos(phase)}
    state["qdd"] = -(rate**2) * state["q"]
    y = base.predict(
        *state.values(), np.arange(1.0, 7.0)
    ) + noise * np.random.default_rng(1).normal(size=(500, 2))
    return base.accumulate({**state, "y": y})


@examples(30)
@given(st.integers(0, 1000), st.integers(2, 6))
def test_independent_share_is_the_share_that_other_columns_do_not_explain(
    seed: int, n: int
) -> None:
    W = np.random.default_rng(seed).normal(size=(40, 1, n)) @ np.random.default_rng(
        seed + 1
    ).normal(size=(n, n))
    found = conditioning(observed(W))
    A = W[:, 0]
    for j in range(n):
        others = np.delete(A, j, axis=1)
        rest = A[:, j] - others @ np.linalg.lstsq(others, A[:, j], rcond=None)[0]
        assert found.independent_share[j] == pytest.approx(
            np.linalg.norm(rest) / np.linalg.norm(A[:, j]), rel=1e-6
        )
    scaled = A / np.linalg.norm(A, axis=0)
    np.testing.assert_allclose(
        found.singular_values, np.linalg.svd(scaled)[1], rtol=1e-9, atol=1e-13
    )
    assert found.condition == pytest.approx(np.linalg.cond(A), rel=1e-6)
    assert found.rank == n


def test_independent_share_of_two_columns_is_the_sine_of_their_angle() -> None:
    angle = 0.02
    W = np.zeros((3, 1, 3))
    W[:, 0] = [[1, np.cos(angle), 0], [0, np.sin(angle), 0], [0, 0, 7]]
    found = conditioning(observed(W))
    np.testing.assert_allclose(
        found.independent_share, [np.sin(angle), np.sin(angle), 1], rtol=1e-10
    )
    # singular values of two unit vectors are √(1 ± cos)
    np.testing.assert_allclose(
        found.singular_values[[0, -1]], np.sqrt([1 + np.cos(angle), 1 - np.cos(angle)])
    )
    assert not found.weak
    W[:2, 0, 1] = [np.cos(0.01), np.sin(0.01)]
    (weak,) = conditioning(observed(W)).weak
    assert weak.singular_value == pytest.approx(
        np.tan(0.005), rel=1e-6
    )  # √((1 − cos)/(1 + cos))
    assert {name for name, _ in weak.weights} == {"p1", "p2"}
    assert sum(share for _, share in weak.weights) == pytest.approx(0, abs=1e-6)


def test_scale_of_columns_and_order_of_outputs_do_not_matter() -> None:
    rng = np.random.default_rng(3)
    W = rng.normal(size=(30, 2, 4))
    W[:, :, 3] = W[:, :, 2] + 1e-3 * W[:, :, 3]
    scale = np.array([1e-6, 1.0, 1e4, 1e-3])
    plain, scaled = conditioning(observed(W)), conditioning(observed(W * scale))
    np.testing.assert_allclose(
        plain.independent_share, scaled.independent_share, rtol=1e-6
    )
    (first,), (second,) = plain.weak, scaled.weak
    assert dict(first.weights) == pytest.approx(dict(second.weights), rel=1e-6) or dict(
        first.weights
    ) == pytest.approx({name: -share for name, share in second.weights}, rel=1e-6)
    swapped = conditioning(observed(W[:, ::-1]))
    np.testing.assert_allclose(
        plain.singular_values, swapped.singular_values, rtol=1e-9
    )


def test_noise_makes_a_direction_weak_that_is_not_ill_conditioned() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 50, 1))
    W = np.stack([a, a + 0.05 * b], axis=2)
    assert not conditioning(observed(W, 1e-3)).weak
    assert len(conditioning(observed(W, 50.0)).weak) == 1


def test_an_open_direction_is_given_with_its_combination() -> None:
    a, b = np.random.default_rng(6).normal(size=(2, 20, 1))
    found = conditioning(observed(np.stack([a, b, 2 * a, 0 * a], axis=2)))
    assert found.rank == 2
    assert found.scaled_condition == np.inf
    first, second = found.weak
    # p1 and p3 in columns of norm 1: the data see p1 + 2·p3 only
    assert {name: round(share, 6) for name, share in first.weights} in (
        {"p1": 0.707107, "p3": -0.707107},
    )
    assert second.weights == (("p4", 1.0),)
    assert list(found.independent_share > 0) == [False, True, False, False]
    assert "do not tell p1 and p3 apart" in first.advice
    assert "2 of 4" in found.verdict


def test_weights_leave_outputs_out() -> None:
    W = np.random.default_rng(7).normal(size=(20, 2, 2))
    W[:, 0, 1] = 0
    assert conditioning(observed(W)).rank == 2
    assert conditioning(observed(W), [1.0, 0.0]).rank == 1


def test_a_sparse_basis_spans_the_same_space() -> None:
    rng = np.random.default_rng(8)
    wanted = np.array([[1, 0, 0, 2.0, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, -1]])
    mixed = np.linalg.qr((rng.normal(size=(3, 3)) @ wanted).T)[0].T
    found, _ = sparse_basis(mixed)
    assert sorted(int(np.sum(np.abs(row) > 1e-9)) for row in found) == [1, 2, 2]
    assert np.linalg.matrix_rank(np.vstack([found, wanted]), tol=1e-9) == 3


# -- advice -----------------------------------------------------------------------------------------------------------


def test_a_joint_at_rest_is_told_to_move(pendulum: ec.BaseModel) -> None:
    found = conditioning(swings(pendulum, 0.0, 1.0), base=pendulum)
    advice = {d.weights[0][0]: d.advice for d in found.weak}
    assert advice["ZZ1"].endswith("move j1 with larger and more varied accelerations")
    assert advice["MY1"].endswith("move j1 over more of the range")
    assert not conditioning(swings(pendulum, 1.0, 1.0), base=pendulum).weak


def test_following_the_advice_helps(pendulum: ec.BaseModel) -> None:
    before = conditioning(swings(pendulum, 0.01, 0.01), base=pendulum)
    after = conditioning(swings(pendulum, 1.5, 1.5), base=pendulum)
    assert before.scaled_condition > 100 * after.scaled_condition
    assert len(before.weak) > len(after.weak)


def test_sensitivities_of_a_single_term(pendulum: ec.BaseModel) -> None:
    """ZZ1 multiplies the first acceleration alone; gravity on MX1 depends on the first position alone."""
    first = sensitivities(pendulum, np.eye(6)[0])
    # the variance that two independent draws share is estimated from 256 states
    assert first["qdd"]["j1"] == pytest.approx(1, abs=0.2)
    assert first["qdd"]["j2"] == first["q"]["j1"] == first["qd"]["j1"] == 0
    moment = sensitivities(pendulum, np.eye(6)[1])
    assert moment["q"]["j1"] == pytest.approx(1, abs=0.2)
    assert moment["qdd"]["j1"] == 0


def test_friction_is_told_by_speed_and_gains_by_currents() -> None:
    effects = [
        effect
        for kind in ("viscous", "drive_gain")
        for i in (1, 2)
        for effect in ready_made(kind, f"q{i}", Side.ACTUATOR, str(i), sliding=False)
    ]
    base = ec.base_parameters(replace(double_pendulum(), effects=tuple(effects)))
    friction = sensitivities(base, np.eye(base.rank)[base.pivots.index("Fv2")])
    assert max(friction["qd"], key=friction["qd"].__getitem__) == "q2"
    gain = sensitivities(base, np.eye(base.rank)[base.pivots.index("Kt1")])
    assert gain["inputs"]["q1"] == pytest.approx(1, abs=0.2)
    assert not any(gain["qd"].values())


def test_loops_get_advice() -> None:
    base = base_of(four_bar)
    x = np.linspace(0.9, 1.1, 30)[:, None]
    y = np.zeros((30, len(base.mechanism.outputs)))
    found = conditioning(
        base.accumulate({"q": x, "qd": 0 * x, "qdd": 0 * x, "y": y}), base=base
    )
    assert found.rank < base.rank
    assert all(
        d.advice.endswith("faster and with larger accelerations") for d in found.weak
    )


def test_balls_get_advice() -> None:
    base = ec.base_parameters(spherical("0 0 -9.81"))
    N = 5
    log = {
        "q": np.tile([1.0, 0, 0, 0], (N, 1)),
        "qd": np.zeros((N, 3)),
        "qdd": np.zeros((N, 3)),
        "y": np.zeros((N, 3)),
    }
    found = conditioning(base.accumulate(log), base=base)
    assert found.weak
    assert all("move" in d.advice for d in found.weak)


def test_another_model_is_refused(pendulum: ec.BaseModel) -> None:
    with pytest.raises(ec.InputError, match="different parameters"):
        conditioning(observed(np.ones((3, 1, 1))), base=pendulum)
