"""Effects in what sensors read, such as the zeros of force/torque sensors: exact sets, rows, names and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.base.saved.echelon_verify import judge
from echelon.base.saved.saved import to_json
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.locking import lock_joints
from support.descriptions import read_description

ARM = """
echelon: 1
modified_dh:
  - {joint: revolute}
  - {joint: revolute, alpha: pi/2}
  - {joint: revolute, a: 0.4}
gravity: [0, 0, -9.81]
"""
HAND = ARM + "outputs: [{wrench: j3, name: ft}]\n"
COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")
ZEROS = [f"Fo_ft_{component}" for component in COMPONENTS]


def robot(text: str) -> ec.Mechanism:
    return read_description(text, "arm", ReadingOptions())


def derived(text: str) -> ec.BaseModel:
    """The set, which the independent verifier accepts."""
    base = ec.base_parameters(robot(text))
    code, sentence = judge(to_json(base))
    assert code == 0, sentence
    return base


@pytest.mark.parametrize(
    "at", ["ft", "outputs", "[ft.fx, ft.fy, ft.fz, ft.tx, ft.ty, ft.tz]"]
)
def test_zeros_of_a_sensor_in_the_hand_are_told_from_the_load(at: str) -> None:
    base = derived(HAND + f"effects: [{{type: offset, at: {at}}}]")
    assert base.pivots[-6:] == tuple(ZEROS)
    assert base.rank == ec.base_parameters(robot(HAND)).rank + 6
    assert [str(e) for e in base.expressions[-6:]] == ZEROS
    units = [base.units[base.pivots.index(name)] for name in ZEROS]
    assert units == ["N"] * 3 + ["N·m"] * 3


def test_the_zero_of_the_vertical_force_under_a_fixed_base_is_a_mass() -> None:
    """All that stands on it weighs the same in every pose: a scale that shows 9.81 N too much shows 1 kg too much."""
    base = derived(ARM + "outputs: [{wrench: base}]\neffects: {offset: base}")
    assert "M1 + M2 + M3 + 100/981·Fo_base_fz" in map(str, base.expressions)
    alone = {"Fo_base_fx", "Fo_base_fy", "Fo_base_tx", "Fo_base_ty", "Fo_base_tz"}
    assert alone <= set(map(str, base.expressions))


@pytest.mark.parametrize(
    "text",
    [
        "outputs: [{joint: all}, {wrench: j2, name: s}]\neffects: [{type: offset, at: all, side: output}]",
        "outputs: [{name: pin, unit: N, sum: [{wrench: j3, component: fx, weight: 3/5}, {joint: j1}]}, {joint: j2}]\n"
        "effects: [{type: offset, at: pin}, {type: viscous, at: all}]",
        "outputs: [{wrench: j3, name: s}]\neffects: [{parameter: drift, unit: N, acts: [{at: s.fx, term: 'q[j1]**2'}, "
        "{at: s.tz, term: '2*qd[j2]'}, {at: j1, term: qd}]}]",
        "outputs: [{actuator: all}, {wrench: j3, name: s}]\nactuators: {m2: 50*j2}\neffects: [{type: offset, at: s}, "
        "{type: coulomb, at: m2}]",
    ],
    ids=["every output", "load pin", "terms", "behind gears"],
)
def test_rows_differ_by_what_the_effects_say(text: str) -> None:
    """A unit of each parameter adds its term to the rows of its outputs, and to no other row."""
    base = derived(ARM + text)
    mechanism = base.mechanism
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.normal(size=(3, 20, 3))
    names = [output.name for output in mechanism.outputs]
    bare = np.zeros(len(base.parameters))
    rest = base.predict(q, qd, qdd, base.values(bare))
    np.testing.assert_allclose(rest, 0, atol=1e-12)
    for effect in mechanism.effects:
        if all(action.side != "output" for action in effect.actions):
            continue
        unit = bare.copy()
        unit[base.parameters.index(effect.parameter)] = 1.0
        expected = np.zeros((20, len(names)))
        for action in effect.actions:
            if action.side == "output":
                term = {
                    "1": np.ones(20),
                    "2*qd[j2]": 2 * qd[:, 1],
                    "q[j1]**2": q[:, 0] ** 2,
                }[action.term]
                expected[:, names.index(action.at)] += term
        found = base.predict(q, qd, qdd, base.values(unit))
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_closed_loops_have_sensors_with_zeros() -> None:
    text = """
echelon: 1
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [0.2, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [0.5, 0, 0]}}}
loops: [{joint: revolute, connects: [coupler, rocker], at: {xyz: [0.4, 0, 0]}, on_second: {xyz: [0.3, 0, 0]}}]
independent: [crank]
outputs: [{joint: crank}, {wrench: coupler, name: s, components: [fx, fy]}]
"""
    plain, zeros = (
        ec.base_parameters(robot(text + more))
        for more in ("", "effects: [{type: offset, at: s}]")
    )
    assert zeros.rank == plain.rank + 2
    assert zeros.pivots[-2:] == ("Fo_s_fx", "Fo_s_fy")


def test_the_row_of_an_elastic_drive_has_the_zero_of_the_sensor_that_it_reads() -> None:
    text = """
echelon: 1
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.4}]
rotors: [{name: m1, on: base, drives: 100*j1, elastic: true}]
outputs: [{joint: j1, name: tau1}, {wrench: j2, name: s}]
effects: [{type: offset, at: tau1}]
"""
    mechanism = robot(text)
    reads = {o.name: o.reads or o.name for o in mechanism.outputs}
    assert list(reads.values()).count("tau1") == 2
    base = derived(text)
    unit = np.zeros(len(base.parameters))
    unit[base.parameters.index("Fo_tau1")] = 1.0
    zeros = np.zeros((1, len(mechanism.velocities)))
    found = base.predict(zeros, zeros, zeros, base.values(unit))[0]
    shown = dict(zip(reads, found, strict=True))
    assert {name for name, value in shown.items() if value} == {
        name for name, read in reads.items() if read == "tau1"
    }


def test_descriptions_carry_them() -> None:
    mechanism = robot(HAND + "effects: [{type: offset, at: ft}]")
    again = robot(json.dumps(write_description(mechanism)))
    assert again.effects == mechanism.effects


def test_zeros_go_with_the_outputs_of_held_joints() -> None:
    text = ARM + "outputs: [{joint: all}, {wrench: j3, name: ft}]\n"
    mechanism = robot(text + "effects: [{type: offset, at: all, side: output}]")
    held = lock_joints(mechanism, {"j2": 0.3})
    assert [e.parameter for e in held.effects] == ["Fo_j1", "Fo_j3", *ZEROS]
    assert ec.base_parameters(held).rank > 0


def test_effects_of_sensors_that_an_experiment_leaves_out_act_nowhere() -> None:
    text = ARM + "outputs: [{joint: all}, {wrench: j3, name: ft}]\n"
    mechanism = robot(
        text + "effects: [{type: offset, at: ft}, {type: viscous, at: j1}]"
    )
    experiment = ec.Experiment(mechanism, name="torques", sensors=["j1", "j2", "j3"])
    acting = {e.parameter: e.actions for e in experiment.mechanism.effects}
    assert all(acting[name] == () for name in ZEROS)
    assert acting["Fv1"]
    both = ec.Experiment(mechanism, name="both")
    assert (
        ec.base_parameters([experiment, both]).rank
        == ec.base_parameters(mechanism).rank
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{viscous: ft}", r"effects\[0\].type: a sensor has no viscous"),
        ("{offset: fd.fx}", "no coordinate or output 'fd.fx'; did you mean 'ft.fx'"),
        ("[{type: offset, at: ft, side: actuator}]", "there is no actuator 'ft'"),
        ("[{type: offset, at: ft, label: x}]", "must have the same unit"),
        (
            "[{parameter: d, unit: N, acts: [{at: ft.fx, term: qd}]}]",
            r"the output 'ft.fx' has no qd of its own: .* such as qd\[j1\]",
        ),
    ],
)
def test_refusals_say_what_to_write(text: str, message: str) -> None:
    with pytest.raises(ec.InputError, match=message):
        robot(HAND + f"effects: {text}")


def test_a_name_of_a_joint_and_a_sensor_is_not_guessed() -> None:
    text = ARM + "outputs: [{wrench: j3}]\n"
    with pytest.raises(ec.InputError, match="side: output or side: actuator"):
        robot(text + "effects: {offset: j3}")
    found = robot(text + "effects: [{type: offset, at: j3, side: output}]")
    assert len(found.effects) == len(COMPONENTS)
    assert len(robot(text + "effects: {viscous: j3}").effects) == 1
    with pytest.raises(ec.InputError, match="no coordinate 'outputs'"):
        robot(ARM + "effects: {offset: outputs}")


def test_a_sensor_without_joints_has_no_state_to_name(tmp_path: Path) -> None:
    file = tmp_path / "post.yaml"
    file.write_text(
        "echelon: 1\nname: post\nbodies: [{name: a, joint: {type: fixed}, separate: true}]\n"
        "outputs: [{wrench: a}]\neffects: [{parameter: P, unit: N, acts: [{at: a.fx, term: qd}]}]\n"
    )
    with pytest.raises(ec.InputError, match=r"name a joint or an actuator$"):
        ec.load(file)
