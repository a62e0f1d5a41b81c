"""Effects in all ways of writing them, robot files by name, and errors that show the line to write."""

from __future__ import annotations

from pathlib import Path

import pytest

import echelon as ec

ARM = """echelon: 1
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.5}]
actuators: {m1: 50*j1}
"""


@pytest.mark.parametrize(
    ("effects", "parameters"),
    [
        ("[{type: viscous, at: all}]", ["Fv1", "Fv2"]),
        ("[viscous, {type: offset, at: j2}]", ["Fv1", "Fv2", "Fo2"]),
        ("viscous", ["Fv1", "Fv2"]),
        ("none", []),
        ("{j2: viscous, all: [offset]}", ["Fv2", "Fo1", "Fo2"]),
        ("{j2: [coulomb, {type: stribeck, velocity: 0.1}]}", ["Fc2", "Fs2"]),
        (
            "{j2: {viscous: , stribeck: {velocity: 0.1}}, m1: {type: offset}}",
            ["Fv2", "Fs2", "Fo1"],
        ),
        (
            "{viscous: all, coulomb: [m1], offset: {at: j2, side: joint}}",
            ["Fv1", "Fv2", "Fc1", "Fo2"],
        ),
        ('{j2: {parameter: k, acts: [{term: "sin(q)"}]}}', ["k"]),
    ],
)
def test_effects_by_place_by_type_or_in_a_list(
    effects: str, parameters: list[str]
) -> None:
    assert [
        effect.parameter for effect in ec.load(f"{ARM}effects: {effects}\n").effects
    ] == parameters


def test_a_robot_file_is_its_name(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text('<robot name="arm"><link name="a"/></robot>')
    for number, robot in enumerate(("arm.urdf", "{file: arm.urdf}")):
        (tmp_path / f"{number}.yaml").write_text(f"echelon: 1\nrobot: {robot}\n")
    assert ec.load(tmp_path / "0.yaml") == ec.load(tmp_path / "1.yaml")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "log: {positions: q}",
            r"log.positions: unknown key.*write +position: 'q_\{n\}' \(line 4\)",
        ),
        (
            "log: q",
            r"log: needs a mapping.*write +log: \{time: t, position: 'q_\{n\}', output: 'tau_\{n\}'\}",
        ),
        (
            "efects: [viscous]",
            r"efects: unknown key.*write +effects: \[\{type: viscous, at: all\}\]",
        ),
        (
            "effects: {j1: [viscus]}",
            r"'viscus' is not valid; did you mean 'viscous'.*write +type: viscous",
        ),
        ("effects: {jx: viscous}", r"effects\[0\].at: there is no coordinate 'jx'"),
        (
            "outputs: [{joints: all}]",
            r"needs one of the keys joint, actuator, wrench and sum.*write +outputs: ",
        ),
        (
            "preparation: {band: x}",
            r"needs a number or an expression of numbers and pi, found 'x'; write +band: 5",
        ),
        ("identification: {prior: arm.urdf}", r"write +prior: \{file: arm.urdf"),
        (
            "identification: {bodies: {j1: {mas: 3}}}",
            r"bodies.j1.mas: .*write +mass: \[1, 5\]",
        ),
    ],
)
def test_errors_about_keys_show_the_line_to_write(text: str, problem: str) -> None:
    with pytest.raises(ec.InputError, match=problem):
        ec.load_setup(f"{ARM}{text}\n")


def test_errors_about_a_whole_sensor_are_not_about_its_key() -> None:
    """The kinds of sensors have the names of keys."""
    problem = r"outputs\[0\]: needs one of the keys joint, .*; write outputs: "
    with pytest.raises(ec.InputError, match=problem):
        ec.load_setup(f"{ARM}outputs: [{{force: j1}}]\n")


def test_two_effects_of_one_name_are_both_named() -> None:
    effects = "effects: [viscous, {parameter: Fv1, acts: [{at: j1, term: qd**3}]}]"
    with pytest.raises(ec.InputError, match=r"'Fv1'.*another parameter \(qd at m1\)"):
        ec.load_setup(f"{ARM}{effects}\n")


def test_a_body_without_a_joint_learns_what_to_write() -> None:
    bodies = "bodies: [{name: a, joint: {name: j, type: revolute, axis: z}}, {name: b, parent: a}]"
    with pytest.raises(
        ec.InputError, match=r"needs a joint.*joint: {type: fixed, orig"
    ):
        ec.load(f"echelon: 1\nname: arm\n{bodies}\n")


def test_patterns_of_columns_do_arithmetic() -> None:
    log = 'log: {time: t, position: "{n+12}", velocity: "v{2*n-1}", output: "{name}{i+1}{x}"}'
    (columns,) = ec.load_setup(f"{ARM}{log}\n").columns
    named = [
        [c.column for c in group.values()]
        for group in (columns.positions, columns.velocities, columns.outputs)
    ]
    assert named == [["13", "14"], ["v1", "v3"], ["m11{x}", "j22{x}"]]
