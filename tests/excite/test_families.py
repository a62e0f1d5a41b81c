"""Families of motions: their derivatives, their bounds, and motions that begin and end at rest."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space, orth, subspace_angles

from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Splines,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from support.excitation_cases import Floats, families, random_motion, slope_along
from support.selection import examples

NAMES = sorted(families())
ORDERS = range(5)


@pytest.fixture(params=NAMES)
def basis(request: pytest.FixtureRequest) -> Basis:
    return families()[request.param]


# -- values ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_series_are_powers_of_one_complex_exponential(order: int) -> None:
    """d^k/dt^k e^{ijωt} = (ijω)^k e^{ijωt}, whose imaginary and real parts are sine and cosine."""
    series, t = Fourier(3.0, 4), np.linspace(-1, 7, 101)
    found = series.values(t, order)
    assert found.shape == (101, 9)
    np.testing.assert_array_equal(found[:, 0], float(order == 0))
    for j in range(1, 5):
        rate = 2j * np.pi * j / 3.0
        wave = rate**order * np.exp(rate * t)
        np.testing.assert_allclose(
            found[:, 2 * j - 1], wave.imag, atol=1e-13 * abs(rate) ** order
        )
        np.testing.assert_allclose(
            found[:, 2 * j], wave.real, atol=1e-13 * abs(rate) ** order
        )


def recursion(knots: Floats, degree: int, i: int, t: Floats) -> Floats:
    """One B-spline by the recursion of de Boor, Cox and Mansfield."""
    if degree == 0:
        return ((knots[i] <= t) & (t < knots[i + 1])).astype(float)
    total = np.zeros_like(t)
    if knots[i + degree] > knots[i]:
        total += (
            (t - knots[i])
            / (knots[i + degree] - knots[i])
            * recursion(knots, degree - 1, i, t)
        )
    if knots[i + degree + 1] > knots[i + 1]:
        rest = (knots[i + degree + 1] - t) / (knots[i + degree + 1] - knots[i + 1])
        total += rest * recursion(knots, degree - 1, i + 1, t)
    return total


@pytest.mark.parametrize(
    "splines",
    [uniform_splines(2.0, 4), Splines((0.0, 0.2, 0.5, 2.0)), Splines((0.0, 1.0), 6)],
)
def test_splines_follow_their_recursion(splines: Splines) -> None:
    t = np.linspace(0, splines.duration, 57)[:-1]
    knots = np.array(
        [0.0] * splines.degree
        + list(splines.breaks)
        + [splines.duration] * splines.degree
    )
    expected = np.column_stack(
        [recursion(knots, splines.degree, i, t) for i in range(splines.size)]
    )
    np.testing.assert_allclose(splines.values(t), expected, atol=1e-14)
    np.testing.assert_allclose(
        splines.values(np.array([splines.duration]))[0],
        np.eye(splines.size)[-1],
        atol=1e-15,
    )


def test_splines_are_polynomials_between_breaks() -> None:
    """Six points of a piece fix its polynomial, whose derivatives are those of the spline."""
    splines = Splines((0.0, 0.3, 1.1, 2.0))
    motion = random_motion(splines, 2)
    for first, end in ((0.0, 0.3), (0.3, 1.1), (1.1, 2.0)):
        t = np.linspace(first, end, 8)
        scaled = 2 * (t - first) / (end - first) - 1
        for column in range(2):
            piece = np.polynomial.Polynomial.fit(
                t[1:-1], motion(t[1:-1])[:, column], 5, domain=[first, end]
            )
            for order in ORDERS:
                expected = piece.deriv(order)(t[1:-1]) if order else piece(t[1:-1])
                size = (
                    np.abs(expected).max()
                    + (2 / (end - first)) ** order * np.abs(scaled).max()
                )
                np.testing.assert_allclose(
                    motion(t[1:-1], order)[:, column], expected, atol=1e-9 * size
                )


@pytest.mark.parametrize("order", range(4))
def test_derivatives_are_differences_of_the_order_below(
    basis: Basis, order: int
) -> None:
    t = np.linspace(0.02, 0.98, 40) * basis.duration  # no break is within a step
    expected = slope_along(lambda h: basis.values(t + h, order), 1e-3)
    found = basis.values(t, order + 1)
    np.testing.assert_allclose(
        found, expected, atol=1e-6 * np.abs(found).max(initial=1.0)
    )


@pytest.mark.parametrize("order", range(3))
def test_motions_combine_functions(basis: Basis, order: int) -> None:
    motion = random_motion(basis, 3)
    t = np.linspace(0, basis.duration, 31)
    expected = basis.values(t, order) @ motion.coefficients
    np.testing.assert_allclose(
        motion(t, order), expected, atol=1e-12 * np.abs(expected).max()
    )
    assert basis.values(t, order).shape == (31, basis.size)


def test_splines_beyond_their_degree_vanish() -> None:
    splines = uniform_splines(1.0, 3)
    assert not splines.values(np.linspace(0, 1, 5), 6).any()
    assert splines.values(np.linspace(0, 1, 5), 5).any()


# -- periods -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", ORDERS)
def test_only_periodic_families_follow_themselves(basis: Basis, order: int) -> None:
    motion, ends = random_motion(basis, 2), [0.0, basis.duration]
    jump = np.abs(np.diff(motion(ends, order), axis=0)).max()
    if basis.periodic:
        t = np.linspace(0, basis.duration, 20)
        size = basis.bounds(motion.coefficients, order).max()
        np.testing.assert_allclose(
            motion(t + 3 * basis.duration, order), motion(t, order), atol=1e-11 * size
        )
        assert jump < 1e-12 * size
    elif order == 0:
        assert jump > 1e-3


def test_what_families_say_of_themselves() -> None:
    found = {
        name: (b.size, b.periodic, round(b.frequency, 12), b.duration)
        for name, b in families(4.0).items()
    }
    assert found["fourier"] == (7, True, 0.75, 4.0)
    assert found["bspline"] == (11, False, 0.75, 4.0)
    assert found["uneven"][0] == 9
    assert found["uneven"][2] == pytest.approx(0.5 / 0.2)
    assert found["sum"] == (18, False, 0.75, 4.0)
    assert found["recombined"] == (4, True, 0.75, 4.0)


# -- bounds ------------------------------------------------------------------------------------------------------------


@examples(60)
@given(
    st.sampled_from(NAMES),
    st.integers(0, 4),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.3, 2.0, 7.1, 30.0]),
)
def test_bounds_hold_everywhere(
    name: str, order: int, seed: int, duration: float
) -> None:
    basis = families(duration)[name]
    rng = np.random.default_rng(seed)
    # some are sparse, so that single functions, which reach their bounds, occur too
    coefficients = rng.normal(size=(basis.size, 3)) * (
        rng.random((basis.size, 3)) < rng.uniform(0.1, 1)
    )
    bounds = basis.bounds(coefficients, order)
    reached = np.abs(
        basis.motion(np.linspace(0, duration, 2001), coefficients, order)
    ).max(axis=0)
    assert bounds.shape == (3,)
    assert np.all(reached <= bounds * (1 + 1e-12) + 1e-300)


@pytest.mark.parametrize("order", ORDERS)
def test_bounds_of_single_waves_are_reached(order: int) -> None:
    series = Fourier(2.0, 3)
    coefficients = np.zeros((7, 3))
    coefficients[1, 0], coefficients[2, 0] = 3.0, -4.0  # amplitude 5
    coefficients[6, 1] = 2.0
    coefficients[0, 2] = -1.5
    expected = [5 * np.pi**order, 2 * (3 * np.pi) ** order, 1.5 * (order == 0)]
    np.testing.assert_allclose(series.bounds(coefficients, order), expected, rtol=1e-14)


def test_bounds_of_splines_tend_to_what_is_reached() -> None:
    """Control points of ever more pieces come near to the curve: quadratically."""
    gaps = []
    for pieces in (20, 40):
        splines = uniform_splines(1.0, pieces)
        t = np.linspace(0, 1, 4001)
        wave = np.sin(6 * t)
        coefficients = np.linalg.lstsq(splines.values(t), wave, rcond=None)[0][:, None]
        for order, peak in ((0, 1.0), (1, 6.0), (2, 36.0)):
            gaps.append(splines.bounds(coefficients, order)[0] / peak - 1)
    assert 0 < max(gaps[:3]) < 0.1
    assert max(gaps[3:]) < 0.35 * max(gaps[:3])


# -- from rest to rest -------------------------------------------------------------------------------------------------

DIMENSIONS = {"fourier": 5, "bspline": 7, "uneven": 5, "sum": 14}
"""Functions less independent conditions: the two ends of a period are one."""


@pytest.mark.parametrize("name", DIMENSIONS)
def test_motions_from_rest_to_rest(name: str) -> None:
    basis = families()[name]
    free = resting_ends(basis)
    assert free.size == DIMENSIONS[name]
    ends = [0.0, basis.duration]
    for order in (1, 2):
        scale = np.abs(free.values(np.linspace(0, basis.duration, 200), order)).max()
        np.testing.assert_allclose(
            random_motion(free, 3)(ends, order), 0, atol=1e-11 * scale
        )
    # nothing is lost: the same space as by singular values
    conditions = np.vstack([basis.values(np.array(ends), order) for order in (1, 2)])
    conditions /= np.abs(conditions).max(axis=1, keepdims=True)
    expected = null_space(conditions, rcond=1e-10)
    assert expected.shape[1] == free.size
    assert subspace_angles(orth(free.matrix), expected).max() < 1e-7


@pytest.mark.parametrize("name", DIMENSIONS)
def test_functions_from_rest_to_rest_move_alike(name: str) -> None:
    free = resting_ends(families()[name])
    t = np.linspace(0, free.duration, 20001)
    speeds = np.sqrt(np.mean(free.values(t, 1) ** 2, axis=0))
    still = speeds < 1e-9
    # only a constant has no velocity
    np.testing.assert_allclose(np.ptp(free.values(t)[:, still], axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(speeds[~still], 1, atol=0.2)
    assert np.sum(still) == (name in ("fourier", "sum"))


@pytest.mark.parametrize("duration", [0.5, 8.0, 300.0])
@pytest.mark.parametrize("harmonics", [1, 2, 5, 12])
def test_dimension_does_not_depend_on_units(duration: float, harmonics: int) -> None:
    series = Fourier(duration, harmonics)
    assert resting_ends(series).size == 2 * harmonics - 1
    assert resting_ends(uniform_splines(duration, harmonics + 4)).size == harmonics + 5
    assert (
        resting_ends(Combined((series, uniform_splines(duration, 4)))).size
        == 2 * harmonics + 1 + 9 - 4
    )


def test_the_same_every_time() -> None:
    for name in DIMENSIONS:
        first, second = (resting_ends(families()[name]).matrix for _ in range(2))
        np.testing.assert_array_equal(first, second)


def test_any_rest_is_among_the_motions(basis: Basis) -> None:
    """Every family holds still anywhere, so that searches can begin there."""
    if basis.size == 4:
        return  # four random functions need not
    t = np.linspace(0, basis.duration, 100)
    ones = np.linalg.lstsq(basis.values(t), np.ones(100), rcond=None)[0]
    np.testing.assert_allclose(basis.values(t) @ ones, 1, atol=1e-10)


# -- trajectories ------------------------------------------------------------------------------------------------------


def test_trajectories() -> None:
    motion = random_motion(Fourier(2.0, 2), 3)
    assert motion.duration == 2.0
    times = np.linspace(0, 2, 201)
    for order, values in enumerate(motion.states(times)):
        assert values.shape == (201, 3)
        np.testing.assert_array_equal(values, motion(times, order))
    assert motion(0.5).shape == (3,)
    np.testing.assert_allclose(
        motion.states(times)[1], np.gradient(motion(times), 0.01, axis=0), atol=0.2
    )


def test_recombinations_can_be_recombined() -> None:
    rng = np.random.default_rng(0)
    series = Fourier(2.0, 2)
    first, second = rng.normal(size=(5, 4)), rng.normal(size=(4, 3))
    twice = Combined((Combined((series,), first),), second)
    t = np.linspace(0, 2, 9)
    np.testing.assert_allclose(
        twice.values(t, 1), series.values(t, 1) @ (first @ second), atol=1e-12
    )
    coefficients = rng.normal(size=(3, 2))
    np.testing.assert_allclose(
        twice.bounds(coefficients, 2), series.bounds(first @ second @ coefficients, 2)
    )
    assert Trajectory(("a", "b"), ("m", "m"), twice, coefficients).duration == 2.0
