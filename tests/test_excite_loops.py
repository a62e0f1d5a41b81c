"""Exciting trajectories of mechanisms with loops: the motion of the independent coordinates decides everything.

Derivatives are compared with differences of fourth order, states and regressors with those that the library finds in
another way (interpreted, with singular values), and trajectories with random ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields as fields_of
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import echelon as ec
import linkages
from echelon.excite.cells import ranges
from echelon.excite.constraints.effort_bounds import EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.frames import PointLimit, point_limits
from echelon.excite.design import designed
from echelon.excite.families.basis import resting_ends
from echelon.excite.families.fourier import Fourier
from echelon.excite.loops.enclosures import LoopEnclosures
from echelon.excite.loops.limits import LoopLimits
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.loops.parts import LoopEfforts, LoopPart
from echelon.excite.loops.positions import Closed
from echelon.excite.loops.regressor import LoopRegressor, state_regressor
from echelon.excite.loops.verification import loop_margins
from echelon.excite.loops.whole import WholeMotion
from echelon.excite.showing import shown
from echelon.excite.task import changed, task_of
from echelon.excite.trajectory import Trajectory
from echelon.mechanism.closure import ClosureKind
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.loops.assembly import Assembly
from exciting import slopes_by_state

Floats = npt.NDArray[np.float64]
LOOPS = Path(__file__).parent.parent / "examples" / "loops"

# in-plane loops with and without redundant equations, spatial ones, balls and couplings among the dependent coordinates
FILES = ("four_bar", "parallelogram", "delta", "three_rps", "gough_stewart")
BUILT = {
    "four-bar": linkages.four_bar,
    "slider-crank": linkages.slider_crank,
    "chain": lambda: linkages.closed_chain(ClosureKind.REVOLUTE),
    "coupled chain": lambda: linkages.closed_chain(ClosureKind.REVOLUTE, coupled=True),
}
MECHANISMS = (*BUILT, *FILES)
REDUNDANT = {"four-bar", "slider-crank", "four_bar", "parallelogram"}


@cache
def mechanism(name: str) -> Mechanism:
    return BUILT[name]() if name in BUILT else ec.load(LOOPS / f"{name}.yaml")


@cache
def base(name: str) -> ec.BaseModel:
    return ec.base_parameters(mechanism(name))


@cache
def regressor(name: str, smooth: float | None = None) -> LoopRegressor:
    made = state_regressor(mechanism(name), base(name).matrix.pivots, smooth)
    assert isinstance(made, LoopRegressor)
    return made


def states(motion: LoopMotion, count: int = 4, reach: float = 0.02) -> dict[str, Floats]:
    """Random states of the independent coordinates near the assembly pose."""
    rng, units = np.random.default_rng(5), motion.independent_units
    names = motion.mechanism.positions
    centre = motion.pose[[names.index(name) for name in motion.independent_positions]]
    q = centre + reach * units * rng.uniform(-1, 1, (count, len(units)))
    return {"q": q, "qd": units * rng.uniform(-1, 1, q.shape), "qdd": units * rng.uniform(-2, 2, q.shape)}


def full(found: Floats, made: LoopRegressor, rank: int) -> Floats:
    """Entries as X, shape (N, outputs, parameters)."""
    X = np.zeros((len(found), len(made.rows), rank))
    for row, rows in enumerate(made.rows):
        X[:, row, rows.columns] = found[:, rows.entries]
    return X


def assert_slopes(found: Floats, expected: Floats, size: float) -> None:
    assert np.abs(found - expected).max() < 1e-6 * max(np.abs(expected).max(), size)


# -- states and regressors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MECHANISMS)
def test_states_are_those_of_the_assembly(name: str) -> None:
    motion, reference = LoopMotion(mechanism(name)), Assembly(mechanism(name))
    state = states(motion)
    closed = motion.at(*state.values())
    assert closed.done.all()
    for mine, other in zip((closed.q, closed.qd, closed.qdd), reference.completed(*state.values()), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-8 * max(np.abs(other).max(), 1.0))
    velocities = closed.qd.shape[1]
    virtual = motion.virtual(closed, motion.given_speeds())[:, :velocities] * motion.speed_units[:, None]
    np.testing.assert_allclose(virtual, reference.virtual_velocities(closed.q), atol=1e-9 * np.abs(virtual).max())


@pytest.mark.parametrize("name", MECHANISMS)
def test_entries_are_those_of_the_base_model(name: str) -> None:
    made = regressor(name)
    state = states(made.motion)
    expected = base(name).regressor(*state.values())
    X = full(made.entries(state), made, base(name).rank)
    np.testing.assert_allclose(X, expected, atol=1e-9 * np.abs(expected).max())
    assert made.size == sum(rows.entries.stop - rows.entries.start for rows in made.rows)


def test_redundant_equations_are_among_the_cases() -> None:
    for name in MECHANISMS:
        motion = LoopMotion(mechanism(name))
        closed = motion.at(*states(motion).values())
        dependent = closed.inverse.shape[1]
        assert (closed.jacobian.shape[1] > dependent) == (name in REDUNDANT or name.endswith("chain")), name


# -- derivatives -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MECHANISMS)
def test_pulled_derivatives_are_those_of_differences(name: str) -> None:
    made = regressor(name, 0.02)
    state = states(made.motion)
    adjoint = np.random.default_rng(6).normal(size=(len(state["q"]), made.size))

    def total(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return np.sum(adjoint * made.entries({"q": q, "qd": qd, "qdd": qdd}), axis=1)

    found = dict(zip(state, made.pulled(state, adjoint), strict=True))
    for kind, step in (("q", 1e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(total, state, kind, step)
        assert_slopes(found[kind], expected, 1e-3)


def certain(name: str, rng: np.random.Generator) -> EffortModel:
    return EffortModel(rng.uniform(0.5, 1.0, len(mechanism(name).parameters)))


def identified(name: str, rng: np.random.Generator) -> EffortModel:
    """Base parameters with a covariance."""
    found = base(name)
    spread = rng.normal(size=(found.rank, found.rank - 1))
    values = found.values(certain(name, rng).values)
    return EffortModel(values, found.matrix.pivots, 0.01 * spread @ spread.T, 2.0)


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("four-bar", certain),
        ("four-bar", identified),
        ("slider-crank", certain),
        ("delta", certain),
        ("delta", identified),
        ("gough_stewart", certain),
    ],
)
def test_slopes_of_limits_are_those_of_differences(name: str, made: Callable[..., EffortModel]) -> None:
    robot, rng = mechanism(name), np.random.default_rng(7)
    efforts = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    points = [PointLimit("p", body.name, (0.1, 0.2, 0.3), (0.6, 0.0, 0.8), -1.0, 1.0) for body in robot.bodies[-2:]]
    limits = LoopLimits(
        LoopMotion(robot),
        [LoopEfforts(robot, efforts, made(name, rng), 0.1, 0.02), LoopPart(point_limits(robot, points))],
    )
    state = states(limits.motion)
    found = dict(zip(state, limits.slopes(*state.values()), strict=True))
    for kind, step in (("q", 2e-4), ("qd", 1e-2), ("qdd", 1e-2)):
        expected = slopes_by_state(limits.values, state, kind, step)
        for row in range(len(limits.labels)):
            assert_slopes(found[kind][:, row], expected[:, row], 1e-3)
    assert np.abs(found["q"][:, 0]).max() > 1e-3  # openness does change


def test_uncertain_efforts_are_those_of_the_base_model() -> None:
    robot, model = mechanism("delta"), identified("delta", np.random.default_rng(8))
    limited = [EffortLimit(output.name, output.unit, 10.0) for output in robot.outputs]
    limits = LoopLimits(LoopMotion(robot), [LoopEfforts(robot, limited, model, 0.1, None)])
    state = states(limits.motion)
    X = base("delta").regressor(*state.values())
    std = np.sqrt(np.einsum("nik,kl,nil->ni", X, model.covariance, X))
    found = limits.values(*state.values())[:, 1:]
    np.testing.assert_allclose(found[:, ::2], X @ model.values + 2 * std, rtol=1e-6)
    np.testing.assert_allclose(found[:, 1::2], X @ model.values - 2 * std, rtol=1e-6, atol=1e-6)


def test_efforts_are_those_of_the_base_model() -> None:
    """Inverse dynamics with standard parameters, and X with the base parameters that belong to them."""
    robot = mechanism("gough_stewart")
    standard = np.random.default_rng(8).uniform(0.5, 1.0, len(robot.parameters))
    efforts = LoopEfforts(
        robot, [EffortLimit(o.name, o.unit, 10.0) for o in robot.outputs], EffortModel(standard), 0.1, None
    )
    limits = LoopLimits(LoopMotion(robot), [efforts])
    state = states(limits.motion)
    model = base("gough_stewart")
    expected = model.predict(*state.values(), model.values(standard))
    np.testing.assert_allclose(limits.values(*state.values())[:, 1:], expected, rtol=1e-9)
    np.testing.assert_allclose(limits.high[1:], 9.0)


# -- what cannot be closed ---------------------------------------------------------------------------------------------


def beyond() -> tuple[LoopRegressor, dict[str, Floats]]:
    """A crank-rocker driven at the rocker, which only swings: from the assembly pose to where it cannot go."""
    robot = linkages.four_bar("rocker")
    made = LoopRegressor(robot, ec.base_parameters(robot).matrix.pivots, 0.02)
    q = np.linspace(1.62, 3.0, 60)[:, None]
    return made, {"q": q, "qd": np.ones_like(q), "qdd": np.ones_like(q)}


def end_of_rocker() -> float:
    """Where crank and coupler are in line, one on the other: their ends are l3 − l2 apart (law of cosines)."""
    l1, l4, far = 0.4, 0.3, 0.35 - 0.15
    return float(np.pi - np.arccos((l1**2 + l4**2 - far**2) / (2 * l1 * l4)))


def test_what_cannot_be_closed_counts_nothing() -> None:
    made, state = beyond()
    closed = made.motion.at(*state.values())
    np.testing.assert_array_equal(closed.done, np.abs(state["q"][:, 0]) < end_of_rocker())
    entries = made.entries(state)
    assert np.isfinite(entries).all()
    assert not entries[~closed.done].any()
    assert entries[0].any()
    for part in made.pulled(state, np.ones_like(entries)):
        assert np.isfinite(part).all()
        assert not part[~closed.done].any()


def test_samples_fade_out_towards_singular_poses() -> None:
    """Entries do not jump where the loops cease to close, and their derivatives are exact where they fade."""
    made, _ = beyond()
    q = np.linspace(end_of_rocker() - 0.05, end_of_rocker() + 0.01, 400)[:, None]
    state = {"q": q, "qd": np.ones_like(q), "qdd": np.ones_like(q)}
    entries, openness = made.entries(state), made.motion.at(*state.values()).openness / made.motion.reference
    fading = (openness > 0.055) & (openness < 0.095)
    assert fading.sum() > 2
    assert not entries[openness < 0.05].any()
    chosen = {name: part[fading] for name, part in state.items()}
    found = made.pulled(chosen, np.ones((int(fading.sum()), made.size)))[0]
    expected = slopes_by_state(
        lambda q, qd, qdd: made.entries({"q": q, "qd": qd, "qdd": qdd}).sum(axis=1), chosen, "q", 1e-6
    )
    assert_slopes(found, expected, 1.0)


def test_the_way_back_is_told() -> None:
    made, state = beyond()
    limits = LoopLimits(made.motion)
    values, slopes = limits.values(*state.values())[:, 0], limits.slopes(*state.values())[0]
    assert slopes is not None
    outside = state["q"][:, 0] > end_of_rocker()
    assert (values[outside] < 0).all()
    assert (np.diff(values[outside]) < 0).all()
    assert (slopes[outside, 0, 0] < 0).all()
    np.testing.assert_allclose(np.diff(values[outside]), slopes[outside, 0, 0][1:] * np.diff(state["q"][outside, 0]))


def test_what_was_found_does_not_depend_on_what_was_asked_before() -> None:
    made, state = beyond()
    fresh = made.motion.at(*state.values())
    made.motion.at(state["q"] - 0.3, state["qd"], state["qdd"])
    again = made.motion.at(*state.values())
    np.testing.assert_array_equal(fresh.done, again.done)
    np.testing.assert_allclose(again.qdd[again.done], fresh.qdd[fresh.done], rtol=1e-6)


def test_a_motion_through_a_flat_parallelogram_is_not_safe() -> None:
    robot = mechanism("parallelogram")
    limits, basis = LoopLimits(LoopMotion(robot)), resting_ends(Fourier(4.0, 2))
    coefficients = np.zeros((basis.size, 1))
    rest = np.linalg.lstsq(basis.values(np.linspace(0, 4, 50), 0), np.ones(50), rcond=None)[0]
    swing = np.random.default_rng(1).normal(size=(basis.size, 1))
    for size, safe in ((0.05, True), (1.0, False)):
        q = basis.values(np.linspace(0, 4, 500), 0) @ swing
        coefficients = np.pi / 3 * rest[:, None] + size * 2.0 / np.abs(q).max() * swing
        (margin,) = loop_margins(Trajectory(("crank",), ("rad",), basis, coefficients), limits)
        assert margin.kept is safe


class HalfMirrored(LoopMotion):
    """Finds the second half of all samples in the other way of assembly, as one might that follows them one by one."""

    def positioned(self, wanted: Floats) -> Closed:
        flipped = {"crank": 1.0, "coupler": -2.9, "rocker": -2.0}
        other = LoopMotion(replace(linkages.four_bar(), assembly=flipped))
        mine, theirs = super().positioned(wanted), other.positioned(wanted)
        half = len(wanted) // 2
        fields = (
            np.concatenate([getattr(mine, f.name)[:half], getattr(theirs, f.name)[half:]]) for f in fields_of(mine)
        )
        return Closed(*fields)


def test_another_way_of_assembly_counts_as_open_loops() -> None:
    basis = resting_ends(Fourier(1.0, 2))
    trajectory = Trajectory(("crank",), ("rad",), basis, 0.1 * np.ones((basis.size, 1)))
    for motion, kept in ((LoopMotion(linkages.four_bar()), True), (HalfMirrored(linkages.four_bar()), False)):
        (margin,) = loop_margins(trajectory, LoopLimits(motion))
        assert margin.kept is kept


# -- between samples ---------------------------------------------------------------------------------------------------


def limited(name: str, rng: np.random.Generator) -> LoopLimits:
    """Torques and a point, by a model that is not certain."""
    robot = mechanism(name)
    efforts = [EffortLimit(output.name, output.unit, 500.0) for output in robot.outputs]
    points = [PointLimit("p", robot.bodies[-1].name, (0.1, 0.2, 0.3), (0.6, 0.0, 0.8), -3.0, 3.0)]
    return LoopLimits(
        LoopMotion(robot),
        [LoopEfforts(robot, efforts, identified(name, rng), 0.1, None), LoopPart(point_limits(robot, points))],
    )


def motion_of(limits: LoopLimits, size: float) -> Trajectory:
    """A small motion about the pose of the assembly."""
    motion, basis = limits.motion, resting_ends(Fourier(2.0, 2))
    rest = np.linalg.lstsq(basis.values(np.linspace(0, 2, 50), 0), np.ones(50), rcond=None)[0]
    centre = motion.pose[[motion.mechanism.positions.index(name) for name in motion.independent_positions]]
    swing = np.random.default_rng(3).normal(size=(basis.size, len(centre)))
    swing *= size / np.abs(basis.values(np.linspace(0, 2, 500), 0) @ swing).max()
    units = ("rad",) * len(centre)
    return Trajectory(motion.mechanism.independent_velocities, units, basis, np.outer(rest, centre) + swing)


@pytest.mark.parametrize("name", ["four-bar", "slider-crank", "delta", "gough_stewart"])
def test_whole_states_stay_in_their_boxes(name: str) -> None:
    limits = LoopLimits(LoopMotion(mechanism(name)))
    size = 0.03 if name == "gough_stewart" else 0.15  # its legs slide
    trajectory, enclosures = motion_of(limits, size), LoopEnclosures(limits.motion)
    edges = np.linspace(0, 2, {"four-bar": 100, "slider-crank": 100}.get(name, 2000))
    cells = ranges(trajectory, (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2)
    located = enclosures.located(cells)
    some = located.found
    assert some.mean() > 0.9
    boxes, openness = enclosures.states(located, cells), enclosures.openness(located)
    for share in np.random.default_rng(5).random(10):
        closed = limits.motion.at(*trajectory.states((1 - share) * edges[:-1] + share * edges[1:]))
        for key, values in (("q", closed.q), ("qd", closed.qd), ("qdd", closed.qdd)):
            slack = 1e-9 * np.abs(values).max()
            assert np.all((values >= boxes[key][0] - slack)[some])
            assert np.all((values <= boxes[key][1] + slack)[some])
        assert np.all((closed.openness >= openness[0] * (1 - 1e-9))[some])
        assert np.all((closed.openness <= openness[1] * (1 + 1e-9))[some])


@pytest.mark.parametrize("name", ["four-bar", "slider-crank", "delta"])
def test_margins_of_loops_contain_all_samples(name: str) -> None:
    limits = limited(name, np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    margins = loop_margins(trajectory, limits)
    assert [margin.label for margin in margins] == list(limits.labels)
    values = limits.values(*trajectory.states(np.linspace(0, 2, 20_001)))
    for margin, samples in zip(margins, values.T, strict=True):
        slack = 1e-9 * np.abs(samples).max()
        assert -np.inf < margin.least <= samples.min() + slack
        assert samples.max() - slack <= margin.largest < np.inf


def test_speeds_of_all_coordinates_are_bounded() -> None:
    limits = limited("delta", np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    whole = WholeMotion(limits.motion, trajectory)
    t = np.linspace(0, 2, 5000)
    closed = limits.motion.at(*trajectory.states(t))
    np.testing.assert_array_equal(whole(t), closed.q)
    np.testing.assert_array_equal(whole(t, 1), closed.qd)
    for order, values in ((1, closed.qd), (2, closed.qdd)):
        most = np.abs(values).max(axis=0)
        assert np.all(whole.bounds(order) >= most)
        assert np.all(whole.bounds(order) <= 2.1 * most + 1e-2)


# -- trajectories ------------------------------------------------------------------------------------------------------

FOUR_BAR = {"limits": {"velocity": 5, "acceleration": 50, "jerk": "none"}, "duration": 6, "starts": 1}


def test_a_trajectory_of_a_four_bar_beats_random_motions() -> None:
    pytest.importorskip("casadi")
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    found = ec.exciting_trajectory(setup, **FOUR_BAR)
    assert found.safe
    assert found.trajectory.coordinates == ("crank",)
    assert any("loops" in margin.label for margin in found.margins)
    task = task_of(setup, changed(setup.excitation, FOUR_BAR, ""))
    design = designed(task)
    random = [design.trajectory(design.problem.start(np.random.default_rng(k), 0.95)) for k in range(30)]
    assert found.shown.log_det > max(shown(task, motion).log_det for motion in random)
    assert found.shown.condition < np.median([shown(task, motion).condition for motion in random])
    # the observation matrix of the library, at the same samples
    t = np.arange(600) / 100
    W = base("four_bar").regressor(*found.trajectory.states(t)).reshape(600, -1)
    assert found.shown.condition == pytest.approx(np.linalg.cond(W), rel=1e-6)


def test_torque_limits_hold_with_loops() -> None:
    pytest.importorskip("casadi")
    setup = ec.load_setup(LOOPS / "four_bar.xml")
    limits = {**FOUR_BAR["limits"], "effort": 1.5}  # type: ignore[dict-item]
    found = ec.exciting_trajectory(setup, **{**FOUR_BAR, "limits": limits})
    assert found.safe
    (torque,) = [margin for margin in found.margins if "torque" in margin.label]
    model = ec.base_parameters(setup.mechanism)
    standard = np.array([x if x is not None else 0.0 for x in setup.mechanism.standard_values()])
    tau = model.predict(*found.trajectory.states(np.linspace(0, 6, 5000)), model.values(standard))
    assert np.abs(tau).max() <= 0.9 * 1.5
    assert torque.active
    assert torque.least <= tau.min()
    assert torque.largest >= tau.max()
    assert max(torque.largest, -torque.least) < np.abs(tau).max() + 2e-3 * 3.0  # bounds are sharp where it matters


def test_a_parallelogram_starts_where_it_is_not_flat() -> None:
    pytest.importorskip("casadi")
    found = ec.exciting_trajectory(ec.load_setup(LOOPS / "parallelogram.yaml"), **FOUR_BAR)
    assert found.safe
    q = found.trajectory(np.linspace(0, 6, 2000))
    assert np.abs(np.sin(q)).min() > 0.05


@pytest.mark.parametrize(
    ("changes", "problem"),
    [({"hold": {"coupler": 0.1}}, "leave out move and hold"), ({"move": ["rocker"]}, "leave out move and hold")],
)
def test_coordinates_of_loops_are_not_held(changes: dict[str, object], problem: str) -> None:
    setup = ec.load_setup(LOOPS / "four_bar.yaml")
    with pytest.raises(ec.InputError, match=problem):
        task_of(setup, changed(setup.excitation, changes, ""))


def test_a_floating_base_with_loops_is_refused() -> None:
    setup = ec.load_setup(LOOPS / "biped.xml")
    with pytest.raises(ec.InputError, match="not driven by a motor of its own"):
        task_of(setup, setup.excitation)
