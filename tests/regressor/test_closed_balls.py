"""Closed states in ball arithmetic, and columns of B as numbers."""

from __future__ import annotations

import re

import flint
import numpy as np
import pytest

import echelon as ec
from echelon.algebra.program.schedule import StagedSchedule
from echelon.base.ball_rows import ball_rows
from echelon.base.saved.saved import from_json, to_json
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.snapping import ReadingOptions
from echelon.loops.assembly import Assembly
from echelon.loops.closed_balls import closed_states
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import known_values, value_texts
from echelon.shared.errors import DegenerateSampleError
from support.derived import base_of
from support.descriptions import read_description
from support.paths import ROOT
from support.selection import slow_unless

LOOPS = ROOT / "examples/loops"
NAMES = ("four_bar", "parallelogram", "delta", "three_rps", "bennett", "sr400")

TILTED = """echelon: 1
name: tilted four bar with a tool
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [l2, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [l1, 0, 0]}}}
  - name: tool
    parent: coupler
    joint: {type: revolute, axis: z, origin: {xyz: [0.1, 0.2, 0.05], rpy: [0.3, 0.41, -0.7]}}
  - {name: tip, parent: tool, joint: {type: prismatic, axis: x, origin: {xyz: [0.1, 0, 0.02], rpy: [0.1234, 0, 0.55]}}}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
independent: [crank, tool, tip]
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206}
"""


def read(text: str) -> Mechanism:
    return read_description(text.encode(), "robot.yaml", ReadingOptions())


def states(
    mechanism: Mechanism, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Midpoints of closed states, all balls of which are small."""
    forms = virtual_power_form(mechanism)
    assert forms.loops is not None
    program, rng = forms.program, np.random.default_rng(3)
    kinds = (
        ("q", mechanism.positions),
        ("qd", mechanism.velocities),
        ("qdd", mechanism.velocities),
    )
    names = [[f"{kind}[{name}]" for name in some] for kind, some in kinds]
    node = {program.inputs[n].name: n for n in program.inputs}
    inputs = [node[name] for some in names for name in some if name in node]
    with flint.ctx.workprec(400):
        closed = closed_states(forms.loops, [{}], forms.loops.known_poses(0, count))
        leaves = closed.leaves(StagedSchedule(program, inputs), rng)
        assert all(float(x.rad()) < 1e-90 for values in leaves.values() for x in values)
        q, qd, qdd = (
            np.array(
                [
                    [
                        float(leaves[node[n]][k].mid()) if n in node else 0.0
                        for n in some
                    ]
                    for k in range(count)
                ]
            )
            for some in names
        )
    return q, qd, qdd


@pytest.mark.parametrize("name", NAMES)
def test_states_are_closed(name: str) -> None:
    mechanism = ec.load(LOOPS / f"{name}.yaml")
    q, qd, qdd = states(mechanism, 3)
    assembly = Assembly(mechanism)
    values, jacobian = assembly.closures.at(q)
    units = assembly.closures.units[: qd.shape[1]]
    slopes = jacobian[:, :, : qd.shape[1]]
    np.testing.assert_allclose(values, 0, atol=1e-13)
    np.testing.assert_allclose(slopes @ (qd / units)[:, :, None], 0, atol=1e-12)
    bias = assembly.closures.bias(q, qd)
    np.testing.assert_allclose(
        (slopes @ (qdd / units)[:, :, None])[..., 0] + bias, 0, atol=1e-11
    )
    assert np.abs(qd).max() > 0.1
    assert np.abs(qdd).max() > 0.1


@pytest.mark.parametrize(
    "name", slow_unless(["four_bar"], ["four_bar", "delta", "bennett"])
)
def test_rows_have_the_null_space_of_the_closed_forms(name: str) -> None:
    base = base_of(f"loops/{name}")
    forms = virtual_power_form(base.mechanism)
    with flint.ctx.workprec(400):
        at = value_texts(base.mechanism, known_values(base.mechanism))
        rows = np.array(
            [
                [float(x.mid()) for x in row]
                for row in ball_rows(forms, at, 4, np.random.default_rng(1))
            ]
        )
    reduced = rows[:, list(base.matrix.pivots)]
    np.testing.assert_allclose(
        reduced @ base.B_float(), rows, atol=1e-12 * np.abs(rows).max()
    )


OUTPUTS = ["outputs: [{joint: crank}, {wrench: tool}]\n", ""]


@pytest.mark.parametrize("outputs", slow_unless(OUTPUTS[:1], OUTPUTS))
def test_numbers_are_verified(outputs: str) -> None:
    found = ec.base_parameters(read(TILTED + outputs), budget=0)
    assert found.matrix.numbers is not None
    assert 0 < found.matrix.numbers.radius < 1e-35
    again = from_json(to_json(found))
    assert ec.verify(again).log10_residual is not None


@pytest.mark.slow
@pytest.mark.parametrize("outputs", OUTPUTS)
def test_numbers_are_values_of_closed_forms(outputs: str) -> None:
    mechanism = read(TILTED + outputs)
    closed = ec.base_parameters(mechanism)
    numbers = ec.base_parameters(mechanism, budget=0)
    assert closed.matrix.numbers is None
    assert numbers.pivots == closed.pivots
    np.testing.assert_allclose(numbers.B_float(), closed.B_float(), atol=1e-13)


def test_a_wrong_number_is_refused() -> None:
    text = to_json(ec.base_parameters(read(TILTED), budget=0))
    wrong = re.sub(
        r'("coefficient": "-?\d{25})\d',
        lambda m: m.group(1) + str((int(m.group()[-1]) + 1) % 10),
        text,
    )
    assert wrong != text
    with pytest.raises(ec.CertificateError):
        ec.verify(from_json(wrong))


def test_a_box_without_a_solution_is_refused() -> None:
    mechanism = read(TILTED)
    forms = virtual_power_form(mechanism)
    assert forms.loops is not None
    at = {**value_texts(mechanism, known_values(mechanism)), "l4": "0.95"}
    with (
        flint.ctx.workprec(400),
        pytest.raises(DegenerateSampleError, match="do not close"),
    ):
        ball_rows(forms, at, 1, np.random.default_rng(1))
