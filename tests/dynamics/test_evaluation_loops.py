"""Base models of mechanisms with loops at states: machine code against plain NumPy and against one another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import echelon as ec
from echelon.base.model import BaseModel
from echelon.compute.machine import kernel as kernel_module
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.loops.assembly import Assembly
from echelon.loops.closed_motion import normalised, position_rates
from echelon.robot.effect import Action, Effect, Side
from echelon.shared.errors import InputError
from support import linkages
from support.closed_motion import completed
from support.derived import base_of
from support.described_robots import sensed
from support.float_regressor import FloatArray
from support.paths import ROOT
from support.selection import slow_unless
from support.small_kernels import same_bits

LOOPS = ROOT / "examples" / "loops"
FILES = (
    "bennett",
    "delta",
    "four_bar",
    "gough_stewart",
    "parallelogram",
    "sr400",
    "three_rps",
)
SAMPLES = 11


def closed_well(mechanism: ec.Mechanism) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States closed to rounding, not to 1e-12 of the size: functions mend the pose, and would differ from rows."""
    assembly = Assembly(mechanism)
    q, qd, qdd = assembly.random_closed_states(np.random.default_rng(5), SAMPLES)
    free = [
        mechanism.velocities.index(name) for name in mechanism.independent_velocities
    ]
    values, jacobian = assembly.closures.at(q)
    change = (
        -(np.linalg.pinv(jacobian, rcond=1e-9) @ values[:, :, None])[:, :, 0]
        * assembly.closures.units
    )
    q = normalised(mechanism, q + position_rates(mechanism, q, change))
    return completed(assembly, q, qd[:, free], qdd[:, free])


class Case:
    """A base model, closed states with random motions, and random base parameters."""

    def __init__(self, base: BaseModel) -> None:
        self.mechanism, self.base = base.mechanism, base
        self.state = self.q, self.qd, self.qdd = closed_well(self.mechanism)
        self.values = np.random.default_rng(6).normal(size=self.base.rank)


@cache
def made(name: str) -> Case:
    return Case(base_of(f"loops/{name}"))


def cases(*names: str) -> list[object]:
    return slow_unless(
        ["four_bar", "parallelogram"],
        names,
    )


@pytest.fixture(params=cases(*FILES))
def case(request: pytest.FixtureRequest) -> Case:
    return made(request.param)


@pytest.fixture
def four_bar() -> Case:
    return made("four_bar")


def check(found: FloatArray, expected: FloatArray, tolerance: float = 1e-12) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )


def test_all_files_are_here() -> None:
    assert sorted(FILES) == sorted(file.stem for file in LOOPS.glob("*.yaml"))


def test_regressors(case: Case) -> None:
    x = evaluate_floats(virtual_power_form(case.mechanism), case.mechanism, *case.state)
    check(case.base.standard_regressor(*case.state), x)
    reduced = case.base.regressor(*case.state)
    check(reduced, x[:, :, list(case.base.matrix.pivots)])
    # closed to rounding only, so that X = X̄ B holds to the accuracy of the states
    check(reduced @ case.base.B_float(), x, 1e-8)


def test_predictions(case: Case) -> None:
    expected = case.base.regressor(*case.state) @ case.values
    check(case.base.predict(*case.state, case.values), expected, 1e-11)


def test_gravity_is_what_a_robot_at_rest_needs(case: Case) -> None:
    still = np.zeros_like(case.qd)
    check(
        case.base.gravity(case.q, case.values),
        case.base.predict(case.q, still, still, case.values),
        1e-11,
    )


@pytest.mark.parametrize("name", cases("four_bar", "delta", "gough_stewart"))
def test_independent_coordinates_are_enough(name: str) -> None:
    """The others follow from the pose in which the mechanism is assembled."""
    mechanism, base = made(name).mechanism, made(name).base
    rng, count = np.random.default_rng(7), len(mechanism.independent_velocities)
    few = [rng.uniform(-0.05, 0.05, (SAMPLES, count)) for _ in range(3)]
    assembly = Assembly(mechanism)
    places = [mechanism.positions.index(n) for n in assembly.independent_positions]
    few[0] += assembly.pose[places]
    full = completed(assembly, *few)
    chosen = [mechanism.velocities.index(n) for n in mechanism.independent_velocities]
    for given, found, columns in zip(few, full, (places, chosen, chosen), strict=True):
        np.testing.assert_allclose(found[:, columns], given, rtol=0, atol=1e-12)
    check(base.regressor(*few), base.regressor(*full), 1e-9)
    one = base.regressor(*(array[0] for array in few))
    assert one.shape == (len(mechanism.outputs), base.rank)


def test_other_lengths(four_bar: Case) -> None:
    """Other values of symbols are those of another mechanism."""
    symbols = {"l2": 0.12, "l3": 0.33}
    changed = {
        n: replace(s, value=symbols.get(n, s.value), exact=None)
        for n, s in four_bar.mechanism.symbols.items()
    }
    other = replace(four_bar.mechanism, symbols=changed)
    states = Assembly(other).random_closed_states(np.random.default_rng(3), SAMPLES)
    expected = evaluate_floats(virtual_power_form(other), other, *states)
    check(four_bar.base.standard_regressor(*states, symbols=symbols), expected)
    with pytest.raises(InputError, match="do not keep the loops closed"):
        four_bar.base.standard_regressor(*states)


@pytest.mark.slow
def test_effects_and_sensors() -> None:
    """Friction at a joint that is not driven, and the wrench in a bearing."""
    mechanism = sensed(linkages.rssr())
    friction = Effect(
        "Fv", "N·m·s/rad", (Action(mechanism.velocities[-1], Side.JOINT, "qd"),)
    )
    case = Case(ec.base_parameters(replace(mechanism, effects=(friction,))))
    x = evaluate_floats(virtual_power_form(case.mechanism), case.mechanism, *case.state)
    check(
        case.base.standard_regressor(*case.state), x, 1e-9
    )  # of states that are closed to rounding
    check(
        case.base.predict(*case.state, case.values),
        x[:, :, list(case.base.matrix.pivots)] @ case.values,
        1e-9,
    )


def test_results_and_threads(four_bar: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_module, "_FEWEST", 1)
    base, values = four_bar.base, four_bar.values
    for call in (
        base.regressor,
        base.standard_regressor,
        lambda *s, **k: base.predict(*s, values, **k),
    ):
        whole = call(*four_bar.state)
        out = np.full(whole.shape, 7.0)
        assert call(*four_bar.state, out=out, threads=2) is out
        assert same_bits(out, whole)
        assert same_bits(call(*four_bar.state, threads=1), whole)
        with pytest.raises(InputError, match="out has shape"):
            call(*(array[:3] for array in four_bar.state), out=out)
        assert same_bits(out, whole)


MISTAKES: dict[str, tuple[Callable[[Case], object], str]] = {
    "open loops": (
        lambda c: c.base.regressor(c.q + 0.1, c.qd, c.qdd),
        "positions of sample 0 do not keep the loops closed",
    ),
    "open speeds": (
        lambda c: c.base.regressor(c.q, c.qd + 0.1, c.qdd),
        "velocities of sample 0 do not keep the loops closed",
    ),
    "open accelerations": (
        lambda c: c.base.regressor(*c.state[:2], c.qdd + 0.1),
        "accelerations of sample 0 do not",
    ),
    "shape": (
        lambda c: c.base.regressor(c.q[:, :2], c.qd, c.qdd),
        r"q has shape \(11, 2\)",
    ),
    "samples": (
        lambda c: c.base.regressor(c.q[:5], c.qd, c.qdd),
        r"of each kind; got q \(5, 3\), qd \(11, 3\)",
    ),
    "axes": (
        lambda c: c.base.regressor(*(a[:, None] for a in c.state)),
        r"got q \(11, 1, 3\), qd \(11, 1, 3\)",
    ),
    "text": (
        lambda c: c.base.regressor([["a"] * 3], c.qd, c.qdd),
        "argument 'q' of regressor: needs an array of numbers",
    ),
    "parameters": (
        lambda c: c.base.predict(*c.state, c.values[1:]),
        r"parameters has shape \(7,\); expected \(8,\)",
    ),
    "no threads": (
        lambda c: c.base.regressor(*c.state, threads=0),
        "threads is 0; expected at least 1",
    ),
}


@pytest.mark.parametrize(("call", "message"), MISTAKES.values(), ids=MISTAKES.keys())
def test_mistakes(four_bar: Case, call: Callable[[Case], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call(four_bar)


def test_no_samples(four_bar: Case) -> None:
    assert four_bar.base.regressor(*(np.zeros((0, 3)) for _ in range(3))).shape == (
        0,
        1,
        four_bar.base.rank,
    )
