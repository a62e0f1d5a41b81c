"""Margins that hold at every time: against many more samples, spikes between them and short dips of distances."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.tape import Program, Scalar
from echelon.excite import verify as cells
from echelon.excite.problem.clearance import Engine, clearance_of
from echelon.excite.problem.robot_shapes import entry_shapes, mesh_shape
from echelon.excite.problem.state_limits import ORDERS, MotionLimit, StateLimits
from echelon.excite.problem.trajectory import Basis, Fourier, Splines, Trajectory
from echelon.excite.verify import (
    ACTIVE,
    LeastClearances,
    Margin,
    MotionBounds,
    loop_margins,
    margins_between,
    motion_margins,
    reach,
    when_kept,
)
from echelon.shared.errors import InputError
from support.excitation_cases import Floats, all_limits, families, random_motion
from support.excitation_loops import limited, motion_of
from support.selection import examples, one_in
from support.shaped_robots import motion, planar, random_arm, spheres

RATE = 10_000
FAMILIES = ("fourier at rest", "bspline at rest", "sum at rest")


def moving(basis: Basis, like: StateLimits, size: float, seed: int = 0) -> Trajectory:
    return random_motion(basis, len(like.function.arguments[0].labels), seed, size)


def reached(motion: Trajectory, limits: StateLimits) -> tuple[Floats, Floats]:
    """The least and the largest of ten thousand samples per second, without smoothing."""
    sharp = StateLimits(
        limits.labels,
        limits.units,
        limits.low,
        limits.high,
        limits.function,
        limits.uniform,
    )
    values = sharp.values(
        *motion.states(np.linspace(0, motion.duration, round(RATE * motion.duration)))
    )
    return values.min(axis=0), values.max(axis=0)


@cache
def limits_of(case: int) -> StateLimits:
    return all_limits()[case][1]


def test_cells_hold_a_parabola_exactly() -> None:
    """Taylor's theorem with the largest second derivative is sharp where that is constant."""
    basis, t = Splines((0.0, 0.5, 1.0)), np.linspace(0, 1, 50)
    coefficients = np.linalg.lstsq(basis.values(t), (t**2)[:, None], rcond=None)[0]
    middles, halves = np.array([0.3, 0.7]), np.array([0.1, 0.2])
    low, high = cells.ranges(
        Trajectory(("j",), ("rad",), basis, coefficients), middles, halves
    )["q"]
    np.testing.assert_allclose(high[:, 0], (middles + halves) ** 2, atol=1e-12)
    assert np.all(low[:, 0] <= (middles - halves) ** 2)


# -- functions of the state --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("case", one_in(3, range(3)))
def test_bounds_contain_all_samples(case: int, name: str) -> None:
    limits = limits_of(case)
    motion = moving(families(2.0)[name], limits, 0.15)
    least, largest = reach(motion, limits)
    low, high = reached(motion, limits)
    slack = 1e-9 * np.maximum(np.abs(low), np.abs(high))
    assert np.all(least <= low + slack)
    assert np.all(largest >= high - slack)


@pytest.mark.parametrize("case", [1, 2])
def test_bounds_are_sharp_where_limits_are_near(case: int) -> None:
    """Within a thousandth of the range, or a quarter of the room, whichever is more."""
    limits = limits_of(case)
    motion = moving(families(2.0)["fourier at rest"], limits, 0.1)
    low, high = reached(motion, limits)
    near = StateLimits(
        limits.labels,
        limits.units,
        low - 1e-4,
        high + 1e-4,
        limits.function,
        limits.uniform,
    )
    least, largest = reach(motion, near)
    allowed = 1.05e-3 * (near.high - near.low) + 1e-4
    assert np.all(low - least <= allowed)
    assert np.all(largest - high <= allowed)
    far = StateLimits(
        limits.labels,
        limits.units,
        low - 50,
        high + 50,
        limits.function,
        limits.uniform,
    )
    least, largest = reach(motion, far)
    assert np.all(low - least <= 0.25 * 50 + 0.2)
    assert np.all(largest - high <= 0.25 * 50 + 0.2)
    assert all(margin.kept for margin in margins_between(far, *reach(motion, far)))


def test_margins_of_states_carry_their_limits() -> None:
    limits = limits_of(2)
    motion = moving(families(2.0)["fourier at rest"], limits, 0.1)
    found, (least, largest) = (
        margins_between(limits, *reach(motion, limits)),
        reach(motion, limits),
    )
    assert [m.label for m in found] == list(limits.labels)
    np.testing.assert_array_equal(
        [(m.low, m.high) for m in found], np.column_stack([limits.low, limits.high])
    )
    np.testing.assert_array_equal(
        [(m.least, m.largest) for m in found], np.column_stack([least, largest])
    )


def function_of(make: Callable[..., Scalar], arguments: str = "q") -> StateLimits:
    """A recorded function of one coordinate with limits ±2."""
    program = Program()
    inputs = {name: program.input(f"{name}[q1]") for name in arguments.split()}
    node = make(**inputs).node
    given = tuple(
        Argument(name, (x.node,), ("q1",), ("rad",)) for name, x in inputs.items()
    )
    function = Function("f", program, given, {(0,): node}, (("f",),))
    return StateLimits(("f",), ("1",), np.array([-2.0]), np.array([2.0]), function, {})


def sweep(rate: float = 1.0, harmonics: int = 1) -> Trajectory:
    """q = sin(2π·rate·t) over one second."""
    coefficients = np.zeros((1 + 2 * harmonics, 1))
    coefficients[2 * round(rate) - 1] = 1.0
    return Trajectory(("q1",), ("rad",), Fourier(1.0, harmonics), coefficients)


SPIKES = [0.3, 0.1234567, -0.77777]


@pytest.mark.parametrize("centre", SPIKES)
@pytest.mark.parametrize("width", [1e-2, 1e-4])
def test_narrow_spikes_are_found(centre: float, width: float) -> None:
    """1/(1 + ((q − c)/w)²) reaches 1 for a moment shorter than any step of a usual grid."""

    def spike(q: Scalar) -> Scalar:
        x = (q - Fraction(centre)) * Fraction(1 / width)
        return 1 / (1 + x * x)

    limits, motion = function_of(spike), sweep()
    samples = limits.values(*motion.states(np.linspace(0, 1, 51)))
    assert samples.max() < (0.5 if width < 1e-3 else 1.0)  # samples do not see it
    _, largest = reach(motion, limits)
    assert 1.0 - 1e-9 <= largest[0] <= 1.3


@pytest.mark.parametrize("arguments", ["qd", "qdd", "q qd qdd"])
def test_spikes_of_rates_are_found(arguments: str) -> None:
    def spike(**state: Scalar) -> Scalar:
        total = sum(list(state.values())[1:], next(iter(state.values())))
        x = 30 * (total - 1)
        return 1 / (1 + x * x)

    limits, motion = function_of(spike, arguments), sweep()
    _, largest = reach(motion, limits)
    assert 1.0 - 1e-9 <= largest[0] <= 1.3


def test_functions_that_jump() -> None:
    """Dry friction: its sign takes all values, and a trajectory that turns meets all of them."""
    limits = function_of(lambda qd: qd.sign() * 3, "qd")
    (margin,) = margins_between(limits, *reach(sweep(), limits))
    assert (margin.least, margin.largest) == pytest.approx((-3, 3))
    assert not margin.kept


def test_poles_are_beyond_all_limits() -> None:
    """1/(q − 1/2) has no bound, and nothing is said to be kept."""
    limits = function_of(lambda q: 1 / (q - 1 / 2))
    (margin,) = margins_between(limits, *reach(sweep(), limits))
    assert margin.least == -np.inf
    assert margin.largest == np.inf
    assert not margin.kept


def test_first_cells_may_be_coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """One cell at first is enough: it is halved until it says enough."""
    motion, limits = sweep(3.0, 3), function_of(lambda q: (4 * q).sin() * q)
    expected = reached(motion, limits)
    for count in (1e-9, 100):
        monkeypatch.setattr(cells, "CELLS_PER_PERIOD", count)
        least, largest = reach(motion, limits)
        assert expected[0][0] - 0.4 <= least[0] <= expected[0][0] + 1e-9
        assert expected[1][0] - 1e-9 <= largest[0] <= expected[1][0] + 0.4


# -- the motion itself -------------------------------------------------------------------------------------------------


@examples(40)
@given(
    st.sampled_from(sorted(families())), st.integers(0, 3), st.integers(0, 2**32 - 1)
)
def test_margins_of_motions_contain_all_samples(
    name: str, order: int, seed: int
) -> None:
    motion = random_motion(families(2.0)[name], 3, seed)
    weights = np.random.default_rng(seed).normal(size=3)
    values = (
        motion(np.linspace(0, motion.duration, round(RATE * motion.duration)), order)
        @ weights
    )
    span = np.ptp(values)
    limit = MotionLimit(
        "m",
        "rad",
        order,
        weights,
        values.min() - 0.01 * span,
        values.max() + 0.01 * span,
    )
    (margin,) = motion_margins(motion, [limit])
    assert margin.least <= values.min()
    assert margin.largest >= values.max()
    # sharp within a thousandth of the range of the limit
    assert max(
        values.min() - margin.least, margin.largest - values.max()
    ) <= 1.01e-3 * (limit.high - limit.low)
    assert margin.kept
    assert margin.label == f"{ORDERS[limit.order]} of m"


@pytest.mark.parametrize("ends", [(-np.inf, 5.0), (-5.0, np.inf)])
def test_limits_with_one_end(ends: tuple[float, float]) -> None:
    (margin,) = motion_margins(
        sweep(), [MotionLimit("q1", "rad", 0, np.ones(1), *ends)]
    )
    assert margin.margin == pytest.approx(4.0, abs=0.01)
    assert margin.relative == pytest.approx(0.8, abs=0.01)


def test_peaks_between_samples_count() -> None:
    """Amplitude 1 is reached between samples of the grid; a limit just below it is broken."""
    motion = sweep(3.0, 3)
    for level, kept in ((0.99999, False), (1.01, True)):
        (margin,) = motion_margins(
            motion, [MotionLimit("q1", "rad", 0, np.ones(1), -level, level)]
        )
        assert margin.kept is kept


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_splines_of_low_degree_are_refused(degree: int) -> None:
    """Their accelerations or jerks jump at breaks, where no curvature bounds them."""
    with pytest.raises(InputError, match="degree"):
        Splines((0.0, 1.0, 2.0), degree)


def test_coordinates_at_rest() -> None:
    still = Trajectory(
        ("q1",), ("rad",), Fourier(1.0, 1), np.array([[0.3], [0.0], [0.0]])
    )
    (margin,) = motion_margins(
        still, [MotionLimit("q1", "rad", 0, np.ones(1), 0.0, 1.0)]
    )
    assert (margin.least, margin.largest) == (0.3, 0.3)
    least, largest = reach(still, function_of(lambda q: 2 * q))
    np.testing.assert_allclose([least[0], largest[0]], 0.6, rtol=1e-12)


# -- one margin --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ends", [(np.nan, np.nan), (0.0, np.nan), (np.nan, 0.0)])
def test_what_is_not_known_is_not_kept(ends: tuple[float, float]) -> None:
    assert not Margin("f", "m", -1.0, 1.0, *ends).kept


def test_what_margins_say() -> None:
    inside = Margin("f", "m", -1.0, 3.0, -0.5, 2.0)
    assert (inside.margin, inside.relative, inside.kept, inside.active) == (
        0.5,
        0.125,
        True,
        False,
    )
    near = Margin("f", "m", 0.0, 10.0, 1.0, 10.0 - 0.5 * ACTIVE * 10)
    assert near.active
    beyond = Margin("f", "m", -1.0, 1.0, -2.0, 0.0)
    assert (beyond.margin, beyond.kept, beyond.active) == (-1.0, False, False)
    below = Margin("f", "m", -np.inf, 4.0, -100.0, 3.0)
    assert (below.margin, below.relative) == (1.0, 0.25)
    above = Margin("f", "m", -2.0, np.inf, -1.0, np.inf)
    assert (above.margin, above.relative) == (1.0, 0.5)
    free = Margin("f", "m", -np.inf, np.inf, -1.0, 1.0)
    assert free.kept


@pytest.mark.parametrize(
    "name", ["four-bar", "slider-crank", pytest.param("delta", marks=pytest.mark.slow)]
)
def test_margins_of_loops_are_extremes_of_dense_samples(name: str) -> None:
    limits = limited(name, np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    margins = loop_margins(trajectory, limits)
    assert [margin.label for margin in margins] == list(limits.labels)
    assert all(margin.sampled for margin in margins)
    assert "at samples" in when_kept(margins)
    values = limits.values(*trajectory.states(np.linspace(0, 2, 20_001)))
    for margin, samples in zip(margins, values.T, strict=True):
        near = 1e-5 * np.ptp(samples) + 1e-12
        assert margin.least == pytest.approx(samples.min(), abs=near)
        assert margin.largest == pytest.approx(samples.max(), abs=near)


@pytest.mark.parametrize("seed", one_in(2, range(8)))
def test_no_sample_is_below_the_bound(seed: int) -> None:
    mechanism, shapes = random_arm(seed)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, seed, 0.35)
    found = LeastClearances(clearance, trajectory, 2e-3)
    t = np.linspace(0, trajectory.duration, 8001)
    q = trajectory(t)
    least = clearance.values(q, q, q).min(axis=0)
    assert np.all(found.bounds <= least + 1e-9)
    assert np.all(found.bounds <= found.found)
    # they are as sharp as was promised
    assert np.all(
        found.bounds >= least - np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) - 1e-3
    )
    assert np.all(
        np.abs(found.found - least)
        < np.maximum(2e-3, 0.26 * np.abs(least - 0.03)) + 1e-3
    )
    for k in np.flatnonzero(found.found < clearance.reach):
        state = trajectory(found.times[k])
        assert clearance.values(state, state, state)[0, k] == pytest.approx(
            found.found[k], abs=1e-6
        )


def test_a_short_dip_is_found() -> None:
    """A tip that rushes past a thin post between all samples of a coarse grid."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(
        mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}]
    )
    clearance = clearance_of(mechanism, shapes, 0.0)
    coefficients = np.zeros((3, 2))
    phase = np.pi / 20  # q1 = 2 sin(2πt + phase) is zero between two of 20 samples
    coefficients[1:, 0] = 2 * np.cos(phase), 2 * np.sin(phase)
    trajectory = Trajectory(
        mechanism.positions, ("rad", "rad"), Fourier(1.0, 1), coefficients
    )
    found = LeastClearances(clearance, trajectory, 1e-4)
    # link 1 is the first moving body, so only link 2 and the post are checked
    assert found.found[0] == pytest.approx(0.04, abs=2e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12
    coarse = trajectory(np.linspace(0, 1, 21))
    assert clearance.values(coarse, coarse, coarse).min() > 0.1
    assert np.sin(2 * np.pi * found.times[0] + phase) == pytest.approx(0, abs=0.02)


def test_motions_that_rest_at_every_first_sample_are_seen_through() -> None:
    """The arm swings once per interval and is at rest, far from the post, in the middle of each."""
    mechanism = planar(2)
    post = {"body": "world", "capsule": 0.01, "from": [2.1, 0, -1], "to": [2.1, 0, 1]}
    shapes = entry_shapes(
        mechanism, [post, {"body": "link2", "sphere": 0.05, "at": [1, 0, 0]}]
    )
    coefficients = np.zeros((129, 2))
    coefficients[0, 0], coefficients[128, 0] = 0.3, -0.3  # q1 = 0.3 (1 − cos(128πt))
    trajectory = Trajectory(
        mechanism.positions, ("rad", "rad"), Fourier(1.0, 64), coefficients
    )
    found = LeastClearances(clearance_of(mechanism, shapes, 0.0), trajectory, 1e-3)
    assert 0.03 - 1e-3 < found.bounds[0] <= 0.04 + 1e-12


def test_faulty_distances_do_not_weaken_a_certificate(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mechanism, shapes = random_arm(1)
    clearance = clearance_of(mechanism, shapes, 0.03)
    trajectory = motion(mechanism, 1, 0.35)
    sound = LeastClearances(clearance, trajectory, 5e-3)
    true = Engine.measure

    def faulty(
        engine: Engine, places: Floats, asked: npt.NDArray[np.intp], reach: float
    ) -> Any:
        found = true(engine, places, asked, reach)
        found.distances[:] += 0.1
        found.points[:] += (
            np.random.default_rng(0).normal(size=found.points.shape) * 0.02
        )
        return found

    monkeypatch.setattr(Engine, "measure", faulty)
    assert np.all(
        LeastClearances(clearance, trajectory, 5e-3).bounds <= sound.found + 1e-12
    )


def test_arguments_are_checked() -> None:
    mechanism = planar()
    shapes = spheres(mechanism)
    with pytest.raises(InputError, match="reach must be larger than the clearance"):
        clearance_of(mechanism, shapes, 0.1, reach=0.05)
    with pytest.raises(InputError, match="0 or more"):
        clearance_of(mechanism, shapes, -0.1)
    with pytest.raises(InputError, match="rotates freely"):
        clearance_of(ec.load("examples/floating_tree.yaml"), (), 0.1)
    with pytest.raises(InputError, match="must move the positions q1, q2, q3"):
        LeastClearances(
            clearance_of(mechanism, shapes, 0.1), motion(planar(2), 0), 1e-3
        )
    with pytest.raises(InputError, match="lie in a plane"):
        mesh_shape(
            "flat",
            -1,
            np.eye(4),
            np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]),
        )


@pytest.mark.parametrize("seed", range(4))
def test_levers_bound_speeds(seed: int) -> None:
    """Points of shapes never move faster than the levers say."""
    mechanism, shapes = random_arm(seed)
    rng = np.random.default_rng(seed)
    trajectory = motion(mechanism, seed, 0.35)
    levers = MotionBounds(
        mechanism, trajectory.basis.bounds(trajectory.coefficients, 0)
    )
    slopes = clearance_of(mechanism, shapes, 0.0).kinematics.slopes(
        trajectory(rng.uniform(0, trajectory.duration, 400))
    )
    ratios = []
    stone = shapes[-1]  # against the world, velocities are absolute
    for shape in shapes[:5]:
        centre = shape.placement[:3, 3]
        moved = slopes[:, shape.body]
        speeds = np.linalg.norm(
            np.einsum("ncik,i->nck", moved[:, :, :3], centre) + moved[:, :, 3], axis=1
        )
        bound = levers.between(stone, shape)
        assert np.all(speeds <= bound + 1e-12)
        ratios.append(speeds.max(axis=0)[bound > 0] / bound[bound > 0])
    assert 0.3 < np.concatenate(ratios).max() <= 1 + 1e-12


def test_levers_of_a_branch_do_not_count_what_carries_both() -> None:
    mechanism = planar(4)
    shapes = spheres(mechanism)
    levers = MotionBounds(mechanism, np.full(4, np.pi))
    np.testing.assert_allclose(levers.between(shapes[1], shapes[4]), [0, 2.1, 1.1, 0.1])
    np.testing.assert_allclose(levers.between(shapes[0], shapes[3]), [2.1, 1.1, 0.1, 0])
