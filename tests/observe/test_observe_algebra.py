"""Observations merge, weigh, select and travel between processes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echelon.compute.observe.accumulate import Observer
from echelon.compute.observe.observation import Observation
from echelon.shared.errors import InputError
from support.stated_regressors import SERIAL, data_of, observer, random_problem


@pytest.fixture(scope="module")
def watch() -> Observer:
    return observer(SERIAL)


def observed(watch: Observer, seed: int, samples: int = 50) -> Observation:
    W, _, y = random_problem(np.random.default_rng(seed), samples, SERIAL)
    return watch(data_of(W, y, SERIAL), threads=1)


def assert_close(first: Observation, second: Observation) -> None:
    assert first.samples == second.samples
    for R, other in zip(first.factors, second.factors, strict=True):
        np.testing.assert_allclose(R, other, atol=1e-12 * np.abs(R).max())


@given(
    seeds=st.tuples(*[st.integers(0, 1000)] * 3),
    samples=st.tuples(*[st.integers(10, 60)] * 3),
)
def test_merging_is_associative_and_commutative(
    watch: Observer, seeds: tuple[int, int, int], samples: tuple[int, int, int]
) -> None:
    a, b, c = (
        observed(watch, seed, count) for seed, count in zip(seeds, samples, strict=True)
    )
    assert_close((a + b) + c, a + (b + c))
    assert_close(a + b, b + a)


def test_merging_is_observing_both(watch: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(1), 90, SERIAL)
    data = data_of(W, y, SERIAL)
    halves = [
        watch({name: a[part] for name, a in data.items()})
        for part in (slice(31), slice(31, None))
    ]
    assert_close(halves[0] + halves[1], watch(data))


def test_nothing_is_neutral(watch: Observer) -> None:
    a = observed(watch, 2)
    assert_close(a + watch([]), a)


def test_other_layouts_are_not_merged(watch: Observer) -> None:
    with pytest.raises(InputError, match="different outputs or parameters"):
        observed(watch, 3) + observed(watch, 3).select([0, 1])


def test_triangles_are_canonical(watch: Observer) -> None:
    for R in observed(watch, 4).factors:
        assert (np.diagonal(R) >= 0).all()
        assert not np.tril(R, -1).any()
        assert not np.signbit(np.tril(R, -1)).any()


def test_outputs_can_be_left_out(watch: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(5), 80, SERIAL)
    found = watch(data_of(W, y, SERIAL)).combined([1, 0, 0])
    np.testing.assert_allclose(
        found.solve(), np.linalg.lstsq(W[:, 0], y[:, 0], rcond=None)[0], rtol=1e-11
    )
    assert found.rows == 80


def test_residuals_of_single_outputs(watch: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(6), 80, SERIAL)
    found = watch(data_of(W, y, SERIAL)).residuals
    for i, residual in enumerate(found):
        square = np.linalg.lstsq(W[:, i][:, SERIAL[i]], y[:, i], rcond=None)[1][0]
        assert residual == pytest.approx(np.sqrt(square), rel=1e-11)


def test_misfits_of_given_parameters(watch: Observer) -> None:
    W, parameters, y = random_problem(np.random.default_rng(14), 80, SERIAL)
    found = watch(data_of(W, y, SERIAL))
    np.testing.assert_allclose(
        found.misfits(parameters),
        np.linalg.norm(W @ parameters - y, axis=0),
        rtol=1e-12,
    )
    whole = found.combined()
    assert np.linalg.norm(found.misfits(whole.solve())) == pytest.approx(
        whole.residual, rel=1e-12
    )
    with pytest.raises(InputError, match="expected 9 parameters"):
        found.misfits([1.0])


@pytest.mark.parametrize(
    "weights", [[1, 2], [1, -1, 1], [1, np.nan, 1], np.ones((3, 1))]
)
def test_weights_that_make_no_sense(watch: Observer, weights: Any) -> None:
    with pytest.raises(InputError, match="weights"):
        observed(watch, 7).combined(weights)


def test_selection(watch: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(8), 80, SERIAL)
    keep = [7, 0, 4, 3]
    found = watch(data_of(W, y, SERIAL)).select(keep)
    A = W[:, :, keep].reshape(-1, 4)
    np.testing.assert_allclose(
        found.combined().solve(),
        np.linalg.lstsq(A, y.ravel(), rcond=None)[0],
        rtol=1e-11,
    )
    assert found.layout.parameters == ("p8", "p1", "p5", "p4")


@pytest.mark.parametrize("keep", [[0, 0], [9], [-1]])
def test_selections_that_make_no_sense(watch: Observer, keep: list[int]) -> None:
    with pytest.raises(InputError, match="different numbers from 0 to 8"):
        observed(watch, 9).select(keep)


def test_parameters_left_open_are_named(watch: Observer) -> None:
    W, _, y = random_problem(np.random.default_rng(10), 80, SERIAL)
    W[:, :, 6] = 2 * W[:, :, 5]
    found = watch(data_of(W, y, SERIAL)).combined()
    assert found.rank == 8
    with pytest.raises(
        InputError,
        match="8 of 9 parameters; those they leave open involve p6, p7: excite",
    ):
        found.solve()


def test_representations(watch: Observer) -> None:
    a = observed(watch, 13)
    assert repr(a) == "Observation(50 samples × 3 outputs × 9 parameters)"
    assert "150 × 9, 50 samples, condition" in repr(a.combined())
