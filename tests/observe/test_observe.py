"""Accumulating samples: the same least squares as with the whole matrix, and the same bits however they arrive."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.compute.machine.target import host
from echelon.compute.observe.accumulate import Observer
from echelon.shared.errors import InputError
from support.small_kernels import LANES, function
from support.stated_regressors import SERIAL, data_of, observer, random_problem, table

Floats = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def serial() -> Observer:
    return observer(SERIAL)


def stacked(W: Floats, y: Floats) -> tuple[Floats, Floats]:
    return W.reshape(-1, W.shape[2]), y.ravel()


@pytest.mark.parametrize("samples", [9, 120, 121, 1000])
def test_solution_of_lstsq(serial: Observer, samples: int) -> None:
    W, _, y = random_problem(np.random.default_rng(samples), samples, SERIAL)
    found = serial(data_of(W, y, SERIAL)).combined()
    A, b = stacked(W, y)
    expected, square, _, values = np.linalg.lstsq(A, b, rcond=None)
    np.testing.assert_allclose(found.solve(), expected, rtol=1e-12)
    assert found.residual == pytest.approx(np.sqrt(square[0]), rel=1e-12)
    np.testing.assert_allclose(found.singular_values, values, rtol=1e-12)
    np.testing.assert_allclose(found.scales, np.linalg.norm(A, axis=0), rtol=1e-13)
    assert found.condition == pytest.approx(np.linalg.cond(A), rel=1e-11)
    assert (found.samples, found.rows, found.rank) == (samples, 3 * samples, 9)


@pytest.mark.parametrize("lanes", LANES)
def test_r_factor_of_lapack(lanes: int) -> None:
    W, _, y = random_problem(np.random.default_rng(1), 700, SERIAL)
    found = observer(SERIAL, target=host(lanes))(data_of(W, y, SERIAL)).combined()
    A, b = stacked(W, y)
    Q, R = np.linalg.qr(A)
    signs = np.sign(np.diagonal(R))
    np.testing.assert_allclose(
        found.R, signs[:, None] * R, atol=1e-12 * np.abs(R).max()
    )
    np.testing.assert_allclose(
        found.qty, signs * (Q.T @ b), atol=1e-12 * np.linalg.norm(b)
    )


def test_weights_are_those_of_rows(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(2), 200, SERIAL)
    weights = np.array([1.0, 0.25, 3.0])
    found = serial(data_of(W, y, SERIAL)).combined(weights)
    A, b = stacked(W * weights[:, None], y * weights)
    np.testing.assert_allclose(
        found.solve(), np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-12
    )
    assert found.residual == pytest.approx(
        np.linalg.norm(A @ found.solve() - b), rel=1e-12
    )


def test_ill_conditioned_data_keep_their_digits() -> None:
    # Läuchli's matrix among other rows: the Gram matrix forgets ε, which the R-factor keeps
    ε, exact = 1e-9, np.array([1.0, -2.0, 3.0])
    rng = np.random.default_rng(3)
    pattern = np.ones((1, 3), dtype=bool)
    W = rng.standard_normal((4000, 1, 1)) * np.ones(3) + ε * rng.standard_normal(
        (4000, 1, 3)
    )
    data = data_of(W, W @ exact, pattern)
    watch = observer(pattern)
    found = watch(data, block=480).combined()
    assert found.condition == pytest.approx(np.linalg.cond(W[:, 0]), rel=1e-5)
    assert np.abs(found.solve() - exact).max() < 1e-5
    with pytest.raises(InputError, match="half the digits"):
        watch.normal_equations(data).solve()


# -- the same bits ---------------------------------------------------------------------------------------------------


def test_threads_and_pieces_change_no_bit(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(4), 2503, SERIAL)
    data = data_of(W, y, SERIAL)
    watch = serial
    reference = watch(data, block=240, threads=1)
    others = [watch(data, block=240, threads=threads) for threads in (1, 2, 4)]
    for cuts in ([100], [240, 480], [1, 2, 3, 500, 2502], list(range(7, 2503, 7))):
        edges = [0, *cuts, 2503]
        pieces = (
            {name: a[i:j] for name, a in data.items()} for i, j in pairwise(edges)
        )
        others.append(watch(pieces, block=240, threads=2))
    for other in others:
        assert other.samples == 2503
        for R, same in zip(reference.factors, other.factors, strict=True):
            np.testing.assert_array_equal(R, same)


def test_pieces_may_be_overwritten_after_they_were_taken(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(5), 600, SERIAL)
    data = data_of(W, y, SERIAL)
    room = {name: np.empty_like(a[:100]) for name, a in data.items()}

    def pieces() -> Iterator[dict[str, Floats]]:
        for start in range(0, 600, 100):
            for name, a in data.items():
                room[name][:] = a[start : start + 100]
            yield room

    found = serial(pieces(), block=240)
    for R, same in zip(found.factors, serial(data, block=240).factors, strict=True):
        np.testing.assert_array_equal(R, same)


def test_strided_and_integer_arrays(serial: Observer) -> None:
    rng = np.random.default_rng(6)
    x = rng.integers(-5, 5, (300, 2 * SERIAL.sum()))
    y = rng.standard_normal((300, 3))
    plain = {"x": x[:, ::2].astype(float).copy(), "y": y}
    for R, same in zip(
        serial(plain).factors,
        serial({"x": x[:, ::2], "y": y[:, :]}).factors,
        strict=True,
    ):
        np.testing.assert_array_equal(R, same)


# -- few samples -----------------------------------------------------------------------------------------------------


def test_no_samples(serial: Observer) -> None:
    found = serial({"x": np.zeros((0, SERIAL.sum())), "y": np.zeros((0, 3))})
    assert found.samples == 0
    assert not any(R.any() for R in found.factors)
    assert found.combined().rank == 0
    assert serial([]).samples == 0


def test_one_sample(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(7), 1, SERIAL)
    found = serial(data_of(W, y, SERIAL))
    whole = np.concatenate([W[0], y.T], axis=1)
    R = found.combined()
    both = np.vstack([np.column_stack([R.R, R.qty]), [*np.zeros(9), R.residual]])
    np.testing.assert_allclose(both.T @ both, whole.T @ whole, atol=1e-12)
    with pytest.raises(InputError, match="3 of 9 parameters: there are only 3 rows"):
        R.solve()


# -- normal equations ------------------------------------------------------------------------------------------------


def test_normal_equations(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(8), 1000, SERIAL)
    watch, data, weights = serial, data_of(W, y, SERIAL), [1.0, 2.0, 0.5]
    found = watch.normal_equations(data, block=240, threads=2)
    A, b = stacked(W * np.array(weights)[:, None], y * weights)
    gram, moment, square = found.combined(weights)
    np.testing.assert_allclose(gram, A.T @ A, atol=1e-11)
    np.testing.assert_allclose(moment, A.T @ b, atol=1e-11)
    assert square == pytest.approx(b @ b)
    np.testing.assert_allclose(
        found.solve(weights), watch(data).combined(weights).solve(), rtol=1e-9
    )
    halves = [
        {name: a[part] for name, a in data.items()}
        for part in (slice(400), slice(400, None))
    ]
    both = watch.normal_equations(halves[0]) + watch.normal_equations(halves[1])
    assert both.samples == 1000
    np.testing.assert_allclose(
        both.combined()[0], found.combined()[0], rtol=1e-12, atol=1e-11
    )


# -- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize(
    ("name", "column", "label"), [("x", 4, "0,4"), ("y", 1, "joint2")]
)
def test_the_first_value_that_is_not_finite_is_named(
    serial: Observer, threads: int, name: str, column: int, label: str
) -> None:
    W, _, y = random_problem(np.random.default_rng(9), 1500, SERIAL)
    data = data_of(W, y, SERIAL)
    data[name][1000, column] = np.nan
    data["y"][1300, 0] = np.inf
    with pytest.raises(InputError, match=f"{name} of '{label}' is nan in sample 1000"):
        serial(data, block=240, threads=threads)
    pieces = [{k: a[i : i + 500] for k, a in data.items()} for i in (0, 500, 1000)]
    with pytest.raises(InputError, match="in sample 1000"):
        serial(pieces, block=240, threads=threads)


def test_values_too_large(serial: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(10), 50, SERIAL)
    with pytest.raises(InputError, match=r"not finite, or too large.* from 0 to 49"):
        serial.normal_equations(data_of(W * 1e300, y, SERIAL))
    whole, huge = (
        serial(data_of(W * scale, y, SERIAL)).combined() for scale in (1.0, 1e300)
    )
    np.testing.assert_allclose(huge.solve() * 1e300, whole.solve(), rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": np.zeros((9, 3))}, "different numbers of samples"),
        ({"y": np.zeros((10, 2))}, "y has shape"),
        ({"x": np.zeros((10, 2))}, "x has shape"),
        ({"y": [["a"] * 3] * 10}, "real numbers"),
    ],
)
def test_arrays_that_do_not_fit(serial: Observer, change: Any, message: str) -> None:
    data = {"x": np.zeros((10, SERIAL.sum())), "y": np.zeros((10, 3))} | change
    with pytest.raises(InputError, match=message):
        serial(data)


def test_uniform_arguments() -> None:
    watch = Observer(
        function(
            lambda x, p: {(0, 0): x[0] * p[0], (0, 1): p[0]}, {"x": 1}, {"p": 1}, (1, 2)
        )
    )
    x = np.linspace(-1, 1, 50)[:, None]
    data = {"x": x, "y": 3 * x - 2, "p": [0.5]}
    np.testing.assert_allclose(watch(data).combined().solve(), [6, -4], rtol=1e-13)
    with pytest.raises(InputError, match="have changed between two pieces"):
        watch([data, data | {"p": [0.25]}])
    with pytest.raises(InputError, match="p of 'p0' is nan"):
        watch(data | {"p": [np.nan]})


def test_missing_outputs_are_named(serial: Observer) -> None:
    with pytest.raises(InputError, match="y is missing"):
        serial({"x": np.zeros((10, SERIAL.sum()))})


@pytest.mark.parametrize("options", [{"block": 0}, {"threads": 0}])
def test_options_that_make_no_sense(serial: Observer, options: dict[str, int]) -> None:
    with pytest.raises(InputError, match="at least 1"):
        serial([], **options)


def test_names_are_checked() -> None:
    with pytest.raises(InputError, match="already has an argument 'x'"):
        Observer(table(SERIAL), outputs="x")


# -- properties ------------------------------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 10**6),
    samples=st.integers(9, 400),
    block=st.sampled_from([120, 240, 10**6]),
)
def test_scaling_parameters_scales_columns(
    serial: Observer, seed: int, samples: int, block: int
) -> None:
    rng = np.random.default_rng(seed)
    W, _, y = random_problem(rng, samples, SERIAL)
    powers = 2.0 ** rng.integers(-60, 60, 9)
    plain = serial(data_of(W, y, SERIAL), block=block).combined()
    scaled = serial(data_of(W * powers, y, SERIAL), block=block).combined()
    np.testing.assert_allclose(
        scaled.R,
        plain.R * powers,
        rtol=1e-9,
        atol=1e-12 * (plain.scales * powers).max(),
    )
    np.testing.assert_allclose(scaled.solve() * powers, plain.solve(), rtol=1e-8)
    assert scaled.scaled_condition == pytest.approx(plain.scaled_condition, rel=1e-9)


@given(seed=st.integers(0, 10**6), samples=st.integers(1, 300))
def test_patterns_of_any_kind(seed: int, samples: int) -> None:
    rng = np.random.default_rng(seed)
    pattern = rng.random((rng.integers(1, 5), rng.integers(1, 12))) < 0.6
    W, _, y = random_problem(rng, samples, pattern)
    data = data_of(W, y, pattern)
    watch = observer(pattern)
    found, grams = watch(data), watch.normal_equations(data)
    for k, (R, gram) in enumerate(zip(found.factors, grams.grams, strict=True)):
        rows = np.column_stack([W[:, k][:, pattern[k]], y[:, k]])
        np.testing.assert_allclose(R.T @ R, rows.T @ rows, atol=1e-10)
        np.testing.assert_allclose(gram, rows.T @ rows, atol=1e-10)
