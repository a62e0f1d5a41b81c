"""Backward elimination: what it drops, when it stops, and that its numbers are those of least squares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

import echelon as ec
from echelon.identification.estimators.essential import essential
from support.observation_rows import ArrayRows
from support.selection import examples

TRUTH = np.array([3.0, 0.0, -2.0, 0.0, 0.5, 0.0])
UNITS = ("kg",) * 6


def problem(
    seed: int,
    rows: int = 300,
    noise: Sequence[float] = (0.3, 3.0),
    truth: np.ndarray = TRUTH,
) -> tuple[np.ndarray, np.ndarray, ec.Observation]:
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(rows, len(noise), len(truth)))
    y = W @ truth + np.array(noise) * rng.normal(size=(rows, len(noise)))
    return W, y, ArrayRows.of(W, y).observation()


def stacked(
    W: np.ndarray, y: np.ndarray, noise: Sequence[float]
) -> tuple[np.ndarray, np.ndarray]:
    scale = 1 / np.array(noise)
    return (W * scale[:, None]).reshape(-1, W.shape[2]), (y * scale).ravel()


def squares(A: np.ndarray, b: np.ndarray, kept: Sequence[int]) -> float:
    if not len(kept):
        return float(b @ b)
    x = np.linalg.lstsq(A[:, kept], b, rcond=None)[0]
    return float(np.sum((A[:, kept] @ x - b) ** 2))


@examples(15)
@given(st.integers(0, 10_000))
def test_what_is_left_is_least_squares_of_what_is_left(seed: int) -> None:
    noise = (0.3, 3.0)
    W, y, seen = problem(seed)
    found = essential(seen, UNITS, noise)
    kept = [seen.layout.parameters.index(name) for name in found.diagnostics["kept"]]
    A, b = stacked(W, y, noise)
    x = np.linalg.lstsq(A[:, kept], b, rcond=None)[0]
    np.testing.assert_allclose(found.values[kept], x, rtol=1e-9)
    variance = squares(A, b, kept) / (len(b) - len(kept))
    np.testing.assert_allclose(
        found.covariance[np.ix_(kept, kept)],
        variance * np.linalg.inv(A[:, kept].T @ A[:, kept]),
    )
    gone = [k for k in range(6) if k not in kept]
    assert not found.values[gone].any()
    assert not found.std[gone].any()
    np.testing.assert_allclose(found.noise, noise, rtol=0.25)


@examples(15)
@given(st.integers(0, 10_000))
def test_every_step_of_the_history_is_the_best_one(seed: int) -> None:
    """Compare with elimination that fits every candidate anew."""
    noise = (0.3, 3.0)
    W, y, seen = problem(seed)
    A, b = stacked(W, y, noise)
    N = len(b)

    def bic(kept: Sequence[int]) -> float:
        return N * np.log(squares(A, b, kept) / N) + len(kept) * np.log(N)

    found = essential(seen, UNITS, noise)
    kept = list(range(6))
    for record in found.diagnostics["history"]:
        options = {k: bic([c for c in kept if c != k]) for k in kept}
        best = min(options, key=options.__getitem__)
        assert record["parameter"] == seen.layout.parameters[best]
        assert record["before"] == pytest.approx(bic(kept))
        assert record["after"] == pytest.approx(options[best])
        kept.remove(best)
        assert record["rms"] == pytest.approx(np.sqrt(squares(A, b, kept) / N))
    assert all(bic([c for c in kept if c != k]) >= bic(kept) for k in kept)


def test_the_true_model_is_found_nearly_always() -> None:
    right = [
        essential(problem(seed)[2], UNITS).diagnostics["kept"] == ["p1", "p3", "p5"]
        for seed in range(60)
    ]
    # a parameter that is zero stays when χ²₁ exceeds ln 600 = 6.4, in 1.1 % of cases, and there are three
    assert np.mean(right) > 0.85


def test_the_f_test_keeps_zeros_at_its_level() -> None:
    kept = [
        essential(problem(seed)[2], UNITS, criterion="f-test") for seed in range(120)
    ]
    zeros = sum(
        len(set(found.diagnostics["kept"]) & {"p2", "p4", "p6"}) for found in kept
    )
    # about binomial with 360 trials at 5 %; elimination one by one raises the rate a little
    assert 0.02 < zeros / 360 < 0.1
    assert all({"p1", "p3"} <= set(found.diagnostics["kept"]) for found in kept)


def test_the_f_test_is_students_test_squared() -> None:
    W, y, seen = problem(3)
    A, b = stacked(W, y, (0.3, 3.0))
    record = essential(seen, UNITS, (0.3, 3.0), criterion="f-test").diagnostics[
        "history"
    ][0]
    x, rest = np.linalg.lstsq(A, b, rcond=None)[:2]
    t = x / np.sqrt(rest[0] / (len(b) - 6) * np.diagonal(np.linalg.inv(A.T @ A)))
    smallest = np.argmin(np.abs(t))
    assert record["parameter"] == f"p{smallest + 1}"
    assert record["before"] == pytest.approx(
        2 * stats.t.sf(abs(t[smallest]), len(b) - 6)
    )


def test_relative_deviations_end_within_the_ratio() -> None:
    _, _, seen = problem(4)
    found = essential(seen, UNITS, criterion="relative_std")
    relative = found.relative_std[found.values != 0]
    assert relative.max() <= 10 * relative.min()
    for record in found.diagnostics["history"]:
        assert record["before"] > 10
    assert found.diagnostics["kept"] == ["p1", "p3", "p5"]


def test_units_do_not_change_what_is_dropped() -> None:
    W, y, seen = problem(5)
    scale = np.array([1e5, 1e-4, 1.0, 10.0, 1e-6, 3.0])
    plain = essential(seen, UNITS)
    scaled = essential(ArrayRows.of(W * scale, y).observation(), UNITS)
    assert plain.diagnostics["eliminated"] == scaled.diagnostics["eliminated"]
    np.testing.assert_allclose(
        plain.values, scaled.values * scale, rtol=1e-8, atol=1e-12
    )


def test_correlated_residuals_count_less() -> None:
    """A parameter that white noise would make significant is dropped when a hundred rows tell as much as one."""
    truth = np.array([3.0, 0.05])
    _, _, seen = problem(7, rows=2000, noise=(0.3,), truth=truth)
    assert essential(seen, UNITS[:2]).diagnostics["kept"] == ["p1", "p2"]
    loose = essential(seen, UNITS[:2], correlation=100.0)
    assert loose.diagnostics["kept"] == ["p1"]
    # rows that are copies: their number must not matter
    W, y, few = problem(8, rows=100, noise=(0.3,), truth=truth)
    copies = ArrayRows.of(
        np.repeat(W, 5, axis=0), np.repeat(y, 5, axis=0)
    ).observation()
    one, many = (
        essential(few, UNITS[:2], (0.3,)),
        essential(copies, UNITS[:2], (0.3,), correlation=5.0),
    )
    np.testing.assert_allclose(one.std, many.std, rtol=1e-9)
    assert one.diagnostics["eliminated"] == many.diagnostics["eliminated"]


def test_parameters_that_the_data_leave_open_go_first() -> None:
    rng = np.random.default_rng(9)
    W = rng.normal(size=(50, 1, 4))
    W[..., 1], W[..., 3] = 2 * W[..., 0], 0
    y = W @ [1.0, 1.0, 1.0, 1.0] + 0.01 * rng.normal(size=(50, 1))
    seen = ArrayRows.of(W, y).observation()
    found = essential(seen, UNITS[:4])
    first, second = found.diagnostics["history"]
    assert first["before"] is None
    assert {first["parameter"], second["parameter"]} in ({"p1", "p4"}, {"p2", "p4"})


def test_friction_without_effect_is_dropped_from_an_arm() -> None:
    base = ec.base_parameters(ec.load("examples/tx40.yaml"))
    rng = np.random.default_rng(11)
    truth = rng.uniform(0.5, 2, base.rank)
    absent = ["fvm6", "Fo2", "Fo5"]
    truth[[base.pivots.index(name) for name in absent]] = 0
    q, qd, qdd = (
        rng.uniform(-2, 2, (400, 6)),
        rng.normal(size=(400, 6)),
        4 * rng.normal(size=(400, 6)),
    )
    y = base.predict(q, qd, qdd, truth) + 0.02 * rng.normal(size=(400, 6))
    found = essential(
        base.accumulate({"q": q, "qd": qd, "qdd": qdd, "y": y}), base.units
    )
    assert set(absent) <= set(found.diagnostics["eliminated"])
    assert len(found.diagnostics["eliminated"]) <= 5
    np.testing.assert_allclose(found.values, truth, atol=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "aic"}, "bic, f-test, relative_std"),
        ({"noise": [0.0, 1.0]}, "positive"),
        ({"noise": [1.0]}, "joint1"),
        ({"units": ("kg",)}, "1 units for 6 parameters"),
    ],
)
def test_wrong_arguments_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ec.InputError, match=message):
        essential(problem(0)[2], **{"units": UNITS, **options})  # type: ignore[arg-type]
