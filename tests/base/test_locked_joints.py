"""Joints that loops lock are named: a leg whose rod is welded to its shank cannot bend."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import echelon as ec
from echelon.loops.closing import locked_joints

LEG = """<mujoco><worldbody>
  <body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0"/>
    <inertial pos="0.01 0 -0.2" mass="2" diaginertia="0.02 0.02 0.004"/>
    <body name="shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0"/>
      <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.002"/></body>
    <body name="crank" pos="0.05 0 -0.1"><joint name="motor" axis="0 1 0"/>
      <inertial pos="0.03 0 0" mass="0.2" diaginertia="0.001 0.001 0.001"/>
      <body name="rod" pos="0.08 0 0"><joint name="rod" axis="0 1 0"/>
        <inertial pos="0 0 -0.15" mass="0.1" diaginertia="0.001 0.001 0.0001"/></body></body></body></worldbody>
  <equality><weld body1="rod" body2="shank" anchor="-0.07 0 -0.32"/></equality>
  <actuator><motor joint="hip"/><motor joint="motor"/></actuator></mujoco>"""
FREE = LEG.replace("<weld", "<connect").replace("-0.07 0 -0.32", "-0.2 0 -0.3")


def still_in_mujoco(text: str) -> set[str]:
    """Joints that no velocity moves which the constraints allow, by MuJoCo's constraint Jacobian."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((data.nefc, model.nv))
    jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
    _, singular, turned = np.linalg.svd(jacobian)
    allowed = turned[(singular > 1e-9).sum() :]
    return {
        model.joint(k).name
        for k in range(model.njnt)
        if np.abs(allowed[:, k]).max(initial=0.0) < 1e-9
    }


@pytest.mark.parametrize("text", [LEG, FREE])
def test_locked_joints_are_those_that_mujoco_cannot_move(text: str) -> None:
    assert set(locked_joints(ec.load(text))) == still_in_mujoco(text)


def test_locked_joints_are_named_with_the_result_and_drives_that_are_locked_doubted() -> (
    None
):
    base = ec.base_parameters(ec.load(LEG))
    assert base.rank == 3
    (note,) = [note for note in base.reading.notes if note.startswith("cannot move")]
    assert note.endswith("'knee', 'motor', 'rod'")
    assert "'motor'" in base.reading.doubt
    with pytest.warns(
        ec.DoubtWarning, match="the loops lock joints that have drives: 'motor'"
    ):
        ec.base_structure(ec.load(LEG))


def test_locked_joints_without_drives_are_no_doubt() -> None:
    base = ec.base_parameters(ec.load(LEG.replace('<motor joint="motor"/>', "")))
    assert base.reading.doubt == ""


NAMED = """
echelon: 1
name: named
symbols: {l1: null, l2: null}
modified_dh: [{name: a, joint: revolute}, {name: b, joint: revolute, a: l1}, {name: c, joint: revolute, a: l2}]
loops: [{joint: weld, connects: [a, b], at: {xyz: [l1, 0, 0]}, on_second: {}}]
couplings: [{c: 2*b}]
"""


def test_joints_are_locked_in_any_geometry_where_lengths_have_no_values() -> None:
    assert locked_joints(ec.load(NAMED)) == ("b", "c")
    assert locked_joints(
        ec.load(NAMED.replace("l1: null, l2: null", "l1: 0.3, l2: 0.2"))
    ) == ("b", "c")
