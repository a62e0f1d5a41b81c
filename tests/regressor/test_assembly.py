"""Closed configurations and motions of mechanisms with loops in double precision."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import echelon as ec
from echelon.base.display import to_text
from echelon.base.reading_report import moved_to_close
from echelon.base.saved.saved import from_json, to_json
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.evaluator import ClosedStates
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.loops.assembly import Assembly
from echelon.loops.closed_motion import ClosureValues, normalised, position_rates
from echelon.loops.closing import close
from echelon.robot.closure import ClosureKind
from echelon.robot.joint import Placement, floating_motions
from echelon.robot.mechanism import Cut, Mechanism
from support import float_regressor as oracles
from support import linkages
from support import textbook_arms as arms
from support.closed_motion import accelerations, velocities
from support.float_regressor import FloatArray
from support.paths import ROOT
from support.pinocchio_loops import Constrained
from support.selection import one_in

EXAMPLES = ROOT / "examples" / "loops"

ALL = [pytest.param(m, id=m.name) for m in linkages.everything()]


def accepted(
    mechanism: Mechanism, *state: FloatArray, **symbols: float
) -> dict[str, FloatArray]:
    return ClosedStates(mechanism).independent_state(
        dict(zip(("q", "qd", "qdd"), state, strict=True)), symbols
    )


def closed_states(
    mechanism: Mechanism, count: int = 6
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return Assembly(mechanism).random_closed_states(np.random.default_rng(5), count)


def independent_columns(mechanism: Mechanism) -> list[int]:
    return [
        mechanism.velocities.index(name) for name in mechanism.independent_velocities
    ]


# -- closure equations -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mechanism", one_in(2, ALL))
def test_the_jacobian_is_the_derivative_everywhere(mechanism: Mechanism) -> None:
    closures = ClosureValues(mechanism)
    q, qd, _ = oracles.random_states(mechanism, 4)
    _, jacobian = closures.at(q)
    moving = (jacobian @ (qd / closures.units)[:, :, None])[:, :, 0]

    def moved(step: float) -> FloatArray:
        return closures.at(
            normalised(mechanism, q + step * position_rates(mechanism, q, qd))
        )[0]

    h = 1e-3
    difference = (8 * (moved(h) - moved(-h)) - (moved(2 * h) - moved(-2 * h))) / (
        12 * h
    )
    np.testing.assert_allclose(moving, difference, atol=1e-8 * np.abs(moving).max())


@pytest.mark.parametrize("mechanism", one_in(3, ALL))
def test_random_states_are_closed_in_pinocchio(mechanism: Mechanism) -> None:
    model = Constrained(mechanism, np.ones(len(mechanism.parameters)))
    states = closed_states(mechanism)
    for q, qd, _ in zip(*states, strict=True):
        model.closing(q)
        for closure in mechanism.closures:
            seen, _ = model.basis(closure)
            assert all(abs(seen.translation[k]) < 1e-11 for k in closure.kind.positions)
            assert all(
                abs(seen.rotation[i, j] - value) < 1e-11
                for i, j, value in closure.kind.directions
            )
        assert np.abs(model.closing(q) @ qd).max() < 1e-10
    assert np.ptp(states[0], axis=0).max() > 0.3


def test_accelerations_follow_from_motions_in_time() -> None:
    assembly = Assembly(linkages.rssr())
    q, qd, _ = assembly.random_closed_states(np.random.default_rng(1), 3)
    h = 1e-4

    def speed(time: float) -> FloatArray:
        way = time * position_rates(assembly.mechanism, q, qd)
        there, done = assembly.closed(
            normalised(assembly.mechanism, q + way), assembly.mechanism.independent
        )
        assert done.all()
        chosen = independent_columns(assembly.mechanism)
        return velocities(assembly, there, qd[:, chosen])

    found = accelerations(assembly, q, qd, np.zeros((3, 2)))
    difference = (8 * (speed(h) - speed(-h)) - (speed(2 * h) - speed(-2 * h))) / (
        12 * h
    )
    np.testing.assert_allclose(found, difference, rtol=1e-7, atol=1e-7)


def test_velocities_and_accelerations_come_back_from_independent_ones() -> None:
    for mechanism in (
        linkages.four_bar(),
        linkages.rssr(),
        linkages.closed_chain(ClosureKind.PRISMATIC),
    ):
        assembly, chosen = Assembly(mechanism), independent_columns(mechanism)
        q, qd, qdd = closed_states(mechanism)
        np.testing.assert_allclose(
            velocities(assembly, q, qd[:, chosen]), qd, atol=1e-9
        )
        np.testing.assert_allclose(
            accelerations(assembly, q, qd, qdd[:, chosen]), qdd, atol=1e-9
        )
        assert (assembly.mobility(q) == len(chosen)).all()


def test_the_crank_turns_all_the_way_without_changing_over() -> None:
    assembly = Assembly(linkages.four_bar())
    angles = np.linspace(-7, 7, 40)[:, None]
    q = assembly.from_independent(angles)
    assert np.abs(assembly.closures.at(q)[0]).max() < 1e-11
    np.testing.assert_array_equal(q[:, :1], angles)
    # the rocker swings within its range, and the coupler never folds over
    assert np.ptp(q[:, 2]) < np.pi / 2
    assert (np.sin(q[:, 1] + q[:, 0] - q[:, 2]) < 0).all()


def test_configurations_stay_in_the_way_of_assembly() -> None:
    bars = ec.load(EXAMPLES / "parallelogram.yaml")
    q, _, _ = closed_states(bars, 200)
    np.testing.assert_allclose(q[:, [1, 2]], q[:, [0]] * [-1, 1], atol=1e-10)
    assert np.ptp(q[:, 0]) > 1
    # flat, the parallelogram could fold over, but it goes straight on
    angles = np.array([[0.01], [-0.4], [-1.0], [-2.7], [3.0], [4.0]])
    np.testing.assert_allclose(
        Assembly(bars).from_independent(angles), angles * [1, -1, 1], atol=1e-9
    )
    crank = linkages.four_bar()
    q, _, _ = closed_states(crank, 50)
    np.testing.assert_allclose(Assembly(crank).from_independent(q[:, :1]), q, atol=1e-9)


def test_a_stated_pose_in_line_is_left() -> None:
    flat = replace(linkages.four_bar(), assembly={})
    q = Assembly(flat).pose
    assert np.abs(Assembly(flat).closures.at(q[None])[0]).max() < 1e-11
    assert np.abs(q).max() < 3


def test_a_linkage_that_floats() -> None:
    bar, base = (
        linkages.four_bar(),
        arms.body(4, 0, "floating", *floating_motions("base")),
    )
    carried = [replace(body, parent=body.parent + 1) for body in bar.bodies]
    closures = tuple(
        replace(c, first=c.first + 1, second=c.second + 1) for c in bar.closures
    )
    free = (
        "base.tx",
        "base.ty",
        "base.tz",
        "base.r.x",
        "base.r.y",
        "base.r.z",
        "crank",
    )
    mechanism = replace(
        bar, bodies=(base, *carried), closures=closures, independent=free
    )
    assembly = Assembly(mechanism)
    assert assembly.independent_positions == (
        *free[:3],
        *(f"base.r.{c}" for c in "wxyz"),
        "crank",
    )
    q, _, _ = oracles.random_states(mechanism, 20)
    found = assembly.from_independent(q[:, :8])
    alone = Assembly(bar).from_independent(q[:, 7:8])
    np.testing.assert_allclose(found[:, 7:], alone, atol=1e-11)
    np.testing.assert_allclose(np.abs((found[:, 3:7] * q[:, 3:7]).sum(axis=1)), 1)


def test_far_guesses_close_somewhere() -> None:
    mechanism = linkages.closed_chain(ClosureKind.REVOLUTE, branched=True)
    assembly = Assembly(mechanism)
    guesses, _, _ = oracles.random_states(mechanism, 50)
    q, done = assembly.closed(guesses)
    assert done.mean() > 0.5
    assert np.abs(assembly.closures.at(q[done])[0]).max() < 1e-11
    np.testing.assert_allclose(np.linalg.norm(q[:, 2:6], axis=1), 1, rtol=1e-12)


def test_every_configuration_closes_at_its_own_values_of_symbols() -> None:
    """Configurations at the stated values close at once; the others go on."""
    bar, count = linkages.four_bar(), 40
    factors = np.where(
        np.arange(count) % 2, 1.0, np.random.default_rng(1).uniform(0.9, 1.1, count)
    )
    lengths = {
        name: float(value) * factors**k
        for k, (name, value) in enumerate(linkages.FOUR_BAR.items())
    }
    q, done = (
        Assembly(bar)
        .at(lengths)
        .closed(np.repeat(Assembly(bar).pose[None], count, axis=0))
    )
    assert done.all()
    for k, pose in enumerate(q):
        own = Assembly(
            bar, {name: float(values[k]) for name, values in lengths.items()}
        )
        assert np.abs(own.closures.at(pose[None])[0]).max() < 1e-11


# -- errors ------------------------------------------------------------------------------------------------------------


def zeros(*widths: int) -> tuple[FloatArray, ...]:
    return tuple(np.zeros((1, width)) for width in widths)


def test_what_cannot_close_is_named() -> None:
    rocker = linkages.four_bar("rocker")
    with pytest.raises(
        ec.InputError, match=r"sample 1: closure 'pin' is off by 0\.\d+ m"
    ):
        accepted(rocker, np.array([[1.6], [0.3]]), np.zeros((2, 1)), np.zeros((2, 1)))
    with pytest.raises(
        ec.InputError,
        match="do not close near the assembly pose: closure 'pin' is off by",
    ):
        accepted(linkages.four_bar(), *zeros(1, 1, 1), l1=2.0)
    with pytest.raises(
        ec.InputError,
        match="the positions of sample 0 do not keep the loops closed: closure 'pin'",
    ):
        accepted(linkages.four_bar(), np.ones((1, 3)), *zeros(3, 3))
    closed = Assembly(linkages.four_bar()).pose[None]
    with pytest.raises(ec.InputError, match="the velocities of sample 0 do not keep"):
        accepted(linkages.four_bar(), closed, np.ones((1, 3)), np.zeros((1, 3)))
    with pytest.raises(
        ec.InputError, match="the accelerations of sample 0 do not keep"
    ):
        accepted(linkages.four_bar(), closed, np.zeros((1, 3)), np.ones((1, 3)))


def test_what_does_not_fit_is_named() -> None:
    with pytest.raises(
        ec.InputError,
        match=r"q has shape \(1, 2\); expected \(samples, 3\) for all coordinates",
    ):
        accepted(linkages.four_bar(), *zeros(2, 1, 1))
    with pytest.raises(ec.InputError, match=r"qdd has shape \(1, 2\)"):
        accepted(linkages.four_bar(), *zeros(1, 1, 2))
    with pytest.raises(
        ec.InputError, match=r"'rod\.x' is one velocity of a free rotation"
    ):
        accepted(linkages.rssr(), *zeros(2, 2, 2))
    with pytest.raises(ec.InputError, match="as many of each kind"):
        accepted(linkages.four_bar(), np.zeros((2, 1)), *zeros(1, 1))


def test_what_the_motion_does_not_determine_is_named() -> None:
    mechanism = linkages.four_bar()
    sideways = Cut(2, Placement(), False, 0, True).output("mx", "N·m")
    with pytest.raises(
        ec.InputError,
        match=r"output 'mx' is not determined by the motion: the loops closed by .* redundant",
    ):
        accepted(replace(mechanism, measured=(sideways,)), *zeros(1, 1, 1))
    inward = Cut(2, Placement(), False, 0, False).output("fx", "N")
    assert np.isfinite(
        accepted(replace(mechanism, measured=(inward,)), *zeros(1, 1, 1))["q"]
    ).all()
    locked, pose = (
        replace(mechanism, independent=("crank", "rocker")),
        Assembly(mechanism).pose[None],
    )
    with pytest.raises(ec.InputError, match="crank, rocker are not independent"):
        evaluate_floats(virtual_power_form(locked), locked, pose, *zeros(3, 3))
    with pytest.raises(ec.InputError, match="crank, rocker are not independent"):
        ClosedStates(locked).independent_state({"q": pose}, None)


def test_singular_configurations_are_named() -> None:
    # the rocker stops where crank and coupler are in line
    straight = Assembly(linkages.four_bar("rocker"))
    crank = np.arccos((0.4**2 + 0.5**2 - 0.3**2) / (2 * 0.4 * 0.5))
    q, done = straight.closed(np.array([[crank, 0.0, 2.0]]), ("crank", "coupler"))
    assert done.all()
    with pytest.raises(
        ec.InputError,
        match=r"sample 0 is a singular configuration of the loops closed by .*: the independent coordinates",
    ):
        straight.virtual_velocities(q)


# -- how far the pose is from the stated one ---------------------------------------------------------------------------


def all_poses_of_the_four_bar(count: int = 20001) -> FloatArray:
    """Closed poses by the law of cosines, for all angles of the crank and both ways of assembly."""
    l1, l2, l3, l4 = (
        float(linkages.FOUR_BAR[name]) for name in ("l1", "l2", "l3", "l4")
    )
    crank = np.linspace(-np.pi, np.pi, count)
    pin = l2 * np.exp(1j * crank)
    reach, direction = np.abs(pin - l1), np.angle(pin - l1)
    bend = np.arccos((l4**2 + reach**2 - l3**2) / (2 * l4 * reach))
    poses = []
    for rocker in (direction + bend, direction - bend):
        coupler = np.angle(l1 + l4 * np.exp(1j * rocker) - pin) - crank
        poses.append(np.stack([crank, coupler, rocker], axis=1))
    return np.concatenate(poses)


@pytest.mark.parametrize("size", [0.05, 0.3, 1.0])
def test_the_nearest_closed_pose_is_taken(size: float) -> None:
    closed, rng = all_poses_of_the_four_bar(), np.random.default_rng(1)
    bar = linkages.four_bar()
    for start in closed[rng.integers(len(closed), size=5)]:
        stated = start + rng.uniform(-size, size, 3)
        away = (closed - stated + np.pi) % (2 * np.pi) - np.pi
        found = Assembly(
            replace(bar, assembly=dict(zip(bar.positions, stated, strict=True)))
        ).pose
        assert (
            np.linalg.norm(found - stated)
            < 1.01 * np.linalg.norm(away, axis=1).min() + 1e-3
        )


def assembled_at(**pose: float) -> Mechanism:
    return close(replace(linkages.four_bar(), independent=(), assembly=pose))


def test_what_moved_is_known_and_said() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        base = ec.base_parameters(assembled_at(crank=1.0, coupler=-0.43, rocker=1.62))
    found = base.reading.assembled
    assert found is not None
    assert not found.large
    assert (found.closure, found.unit, {m.unit for m in found.moved}) == (
        "pin",
        "m",
        {"rad"},
    )
    stated = {"crank": 1.0, "coupler": -0.43, "rocker": 1.62}
    away = {name: abs(found.pose[name] - value) for name, value in stated.items()}
    assert {m.coordinate: m.distance for m in found.moved} == pytest.approx(away)
    assert (
        found.moved[0].distance == max(away.values()) == pytest.approx(0.03, abs=0.02)
    )
    assert found.opening == pytest.approx(
        0.35 * 0.0516, rel=0.2
    )  # the coupler's end; one of its two components
    assert str(found) in to_text(base)
    assert from_json(to_json(base)).reading.assembled == found
    exact = dict(
        zip(
            ("crank", "coupler", "rocker"),
            Assembly(assembled_at(crank=1.0)).pose.tolist(),
            strict=True,
        )
    )
    assert moved_to_close(assembled_at(**exact)) is None


def test_large_moves_are_warned_of() -> None:
    with pytest.warns(
        ec.AssemblyWarning,
        match=r"at zero closure 'pin' is open by 0\.2 m.*write  assembly: \{crank:",
    ):
        assembled_at()
    with pytest.warns(ec.AssemblyWarning, match="'rocker' by 1.57 rad"):
        assembled_at(crank=1.0)


def test_poses_that_are_far_from_closing_are_refused() -> None:
    far = replace(linkages.slider_crank(), independent=(), assembly={"piston": 2.0})
    with pytest.raises(
        ec.InputError,
        match=r"assembly: at the stated .*'piston' by 1\.3 m.*write  assembly: \{crank: ",
    ):
        close(far)


@pytest.mark.parametrize("gravities", [("generic", "file"), ("file", "generic")])
def test_a_robot_with_loops_is_read_after_one_with_another_gravity(
    gravities: tuple[str, str],
) -> None:
    """Random values of symbols without one are kept for the loops that they close."""
    for gravity in gravities:
        robot = ec.load(ROOT / "examples/loops/four_bar.yaml", gravity=gravity)
        assert ec.base_structure(robot).rank == 8
