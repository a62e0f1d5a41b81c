"""Where loops cannot be closed, or only in another way of assembly."""

from __future__ import annotations

from dataclasses import fields as fields_of
from dataclasses import replace

import numpy as np

import echelon as ec
from echelon.excite.problem.closed_loops import Closed, LoopMotion, LoopRegressor, loop_limits
from echelon.excite.problem.trajectory import Fourier, Trajectory, resting_ends
from echelon.excite.verify.margins import loop_margins
from support import linkages
from support.excitation_cases import slopes_by_state
from support.excitation_loops import Floats, assert_slopes, mechanism


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
    limits = loop_limits(made.motion)
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
    limits, basis = loop_limits(LoopMotion(robot)), resting_ends(Fourier(4.0, 2))
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
        (margin,) = loop_margins(trajectory, loop_limits(motion))
        assert margin.kept is kept
