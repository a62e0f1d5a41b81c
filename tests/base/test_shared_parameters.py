"""Bodies that share one set of parameters: identical legs, wheels and links."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

import echelon as ec
from echelon.base.structure import find_structure
from echelon.dynamics.functions import robot_function
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.robot_writer import identified_robot
from echelon.identification.physics.bounds import linear_limits, roles
from echelon.identification.physics.prior_information import prior_from
from support import float_regressor as oracles
from support import shared_parameters as shared
from support.closed_states import read
from support.float_functions import evaluate
from support.paths import ROOT
from support.physical_robots import bounds_of
from support.random_mechanisms import mechanisms
from support.selection import examples, slow_unless
from support.written_robots import random_parameters

FRICTION = """
effects:
  - {type: viscous, at: [w1, w2, w3, w4], label: wheel}
  - {type: coulomb, at: [w1, w2]}
"""
ROTORS = """
rotors:
  - {name: r1, on: base, drives: 50*one, label: rot, axis: z}
  - {name: r2, on: one, drives: 60*two, label: rot, axis: z}
"""
MODELS = {
    "3-RPS": lambda: shared.identical_legs("three_rps"),
    "Gough-Stewart": lambda: shared.identical_legs("gough_stewart"),
    "Delta": lambda: shared.identical_legs("delta"),
    "car": lambda: read(shared.CAR),
    "two links": lambda: read(shared.PENDULUM),
    "chain of equal links": lambda: read(shared.chain(4, 0, 1, 2, 3)),
    "some links of a chain": lambda: read(shared.chain(5, 1, 3)),
    "first and last of a chain": lambda: read(shared.chain(5, 0, 4)),
    "long chain": lambda: read(shared.chain(26, 10, 20)),
}
RANKS = {
    **{
        "3-RPS": 15,
        "Gough-Stewart": 22,
        "Delta": 12,
        "car": 17,
        "two links": 4,
        "chain of equal links": 10,
    },
    **{"some links of a chain": 30, "first and last of a chain": 31, "long chain": 177},
}


@cache
def model(name: str) -> ec.Mechanism:
    return MODELS[name]()


@pytest.mark.parametrize(
    "name",
    slow_unless(["car", "two links", "some links of a chain"], MODELS),
)
def test_the_rank_is_that_of_summed_columns(name: str) -> None:
    mechanism = model(name)
    columns, _ = shared.pinocchio_regressor(
        mechanism, 2 * len(mechanism.parameters) // len(mechanism.outputs)
    )
    structure = find_structure(mechanism, np.random.default_rng(1))
    assert (
        structure.rank
        == RANKS[name]
        == shared.rank_of(columns.reshape(-1, columns.shape[2]))
    )


@pytest.mark.parametrize(
    "name",
    slow_unless(
        ["car", "two links"],
        [
            "3-RPS",
            "car",
            "two links",
            "some links of a chain",
            "first and last of a chain",
        ],
    ),
)
def test_base_parameters_express_all_forces(name: str) -> None:
    columns, state = shared.pinocchio_regressor(model(name), 10)
    base = ec.base_parameters(model(name))
    assert not base.reading.doubt
    np.testing.assert_allclose(
        base.regressor(*state) @ base.B_float(),
        columns,
        atol=1e-8 * np.abs(columns).max(),
    )


def test_closed_forms_count_the_bodies() -> None:
    base = ec.base_parameters(model("car"))
    assert str(base.expressions[0]) == "XX1 + 4·ZZwheel + 4·b²·Mwheel"
    assert any(
        "bodies w1, w2, w3, w4 share the parameters of label 'wheel'" in note
        for note in base.reading.notes
    )


@given(mechanisms())
@examples(20)
def test_any_mechanism(mechanism: ec.Mechanism) -> None:
    """Bodies that carry the same share a label here; columns of X are sums then, as are parameters everywhere else."""
    alike = [
        replace(body, label=f"c{sum(1 << k for k in body.carried)}")
        for body in mechanism.bodies
    ]
    effects = tuple(
        replace(e, parameter=f"own_{e.parameter}") for e in mechanism.effects
    )
    tied = replace(mechanism, bodies=tuple(alike), effects=effects)
    state = oracles.random_states(mechanism, 3)
    apart, found = (
        oracles.float_regressor(mechanism, *state),
        oracles.float_regressor(tied, *state),
    )
    expected = np.zeros_like(found)
    for k, column in enumerate(mechanism.columns):
        at = (
            k - len(mechanism.columns)
            if column.body is None
            else tied.first_column[column.body]
        )
        kind = (
            0
            if column.kind is None
            else mechanism.bodies[column.body or 0].carried.index(column.kind)
        )
        expected[..., at + kind] += apart[..., k]
    np.testing.assert_allclose(
        found, expected, atol=1e-12 * (1 + np.abs(expected).max(initial=0))
    )
    zeta = np.random.default_rng(1).normal(size=len(tied.parameters))
    values = {"q": state[0], "qd": state[1], "qdd": state[2], "parameters": zeta}
    forces = evaluate(
        robot_function("inverse_dynamics", tied, range(len(zeta))), tied, values
    )
    np.testing.assert_allclose(
        forces, expected @ zeta, atol=1e-11 * (1 + np.abs(expected).max(initial=0))
    )


@pytest.mark.parametrize("text", [shared.CAR + FRICTION, shared.PENDULUM + ROTORS])
def test_saved_sets_are_verified(text: str, tmp_path: Path) -> None:
    base = ec.base_parameters(read(text))
    ec.save_base(base, tmp_path / "set.json")
    again = ec.load_base(tmp_path / "set.json")
    assert again.mechanism == base.mechanism
    assert again.expressions == base.expressions
    ec.verify(again)
    command = [
        sys.executable,
        str(ROOT / "verifier" / "echelon_verify.py"),
        str(tmp_path / "set.json"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout[:6]) == (0, "valid:")
    label = base.mechanism.bodies[1].label
    forged = (
        (tmp_path / "set.json")
        .read_text()
        .replace(f'"label": "{label}"', '"label": "other"', 1)
    )
    (tmp_path / "set.json").write_text(forged)
    assert subprocess.run(command, capture_output=True, check=False).returncode == 1


def test_one_parameter_of_an_effect_at_several_places() -> None:
    car = read(shared.CAR + FRICTION)
    assert car.parameters[-3:] == (
        "Fvwheel",
        "Fc_w1",
        "Fc_w2",
    )  # those without a label are told apart
    q, qd, qdd = oracles.random_states(car, 5)
    column = oracles.float_regressor(car, q, qd, qdd)[..., -3]
    np.testing.assert_allclose(column, np.where(np.arange(10) < 6, 0, qd))
    mixed = "bodies: [{name: a, joint: {type: revolute, axis: z}}, {name: b, joint: {type: prismatic, axis: z}}]\n"
    with pytest.raises(
        ec.InputError,
        match=r"effects\[0\]\.label: places that share a label must have the same unit",
    ):
        read(mixed + "effects: [{type: viscous, at: [a, b], label: x}]\n")


def test_every_body_is_written() -> None:
    car = read(shared.CAR + FRICTION)
    zeta = random_parameters(car)
    description, generated = identified_robot(car, zeta)
    again = RobotFile.of(description.text.encode(), "robot.yaml").mechanism(
        ReadingOptions(keep_fixed_links=True)
    )
    np.testing.assert_allclose(np.array(again.standard_values(), dtype=float), zeta)
    inertial = {body.name: body.inertial for body in again.bodies}
    assert inertial["w1"] == inertial["w2"] == inertial["w3"] == inertial["w4"]
    plain = RobotFile.of(generated.text.encode(), "robot.urdf").mechanism(
        ReadingOptions(floating=True)
    )
    masses = [body.inertial[9] for body in plain.bodies if body.inertial]
    assert masses == pytest.approx([zeta[9], *[zeta[19]] * 4])
    assert generated.text.count(f'damping="{float(zeta[20])!r}"') == 4


def test_physical_consistency_of_shared_bodies() -> None:
    car = read(shared.CAR)
    role = roles(car)
    assert role.bodies == (("chassis", 0), ("w1", 10))
    limits = linear_limits(
        role, bounds_of({"total_mass": [1, 2], "bodies": {"w3": {"mass": [0.1, 0.2]}}})
    )
    total = limits.least[[name.startswith("total mass") for name in limits.names]][0]
    assert (abs(total[9]), abs(total[19])) == (1, 4)
    own = limits.least[[name == "mass of w3" for name in limits.names]]
    assert own[:, 19].any()


def test_a_prior_gives_the_mean_of_shared_bodies() -> None:
    standard = "[0.3, 0, 0, 0.3, 0, 0.3, 0, 0, 0, {mass}]"
    links = [
        f"inertial: {{standard: {standard.replace('{mass}', mass)}}}"
        for mass in ("1", "3")
    ]
    apart = shared.PENDULUM.replace("label: link, joint", f"{links[0]}, joint")
    apart = apart.replace("label: link, parent", f"{links[1]}, parent")
    found = prior_from(ec.base_parameters(read(shared.PENDULUM)), read(apart))
    assert found.values[9] == pytest.approx(2)


def test_labels_of_a_robot_file(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "two_link.xml").read_text()
    (tmp_path / "two_link.xml").write_text(text)
    apart = ec.load(tmp_path / "two_link.xml")
    file, labels = (
        tmp_path / "tied.yaml",
        ", ".join(f"{body.name}: link" for body in apart.bodies),
    )
    file.write_text(
        f"echelon: 1\nrobot: {{file: two_link.xml}}\nlabels: {{{labels}}}\n"
    )
    tied = ec.load(file)
    state = oracles.random_states(apart, 5)
    found, columns = (
        oracles.float_regressor(tied, *state),
        oracles.float_regressor(apart, *state),
    )
    np.testing.assert_allclose(
        found[..., :10], columns[..., :10] + columns[..., 10:20], atol=1e-12
    )
    both = np.array([body.inertial for body in apart.bodies])
    np.testing.assert_allclose(
        np.array(tied.standard_values()[:10], dtype=float), both.mean(axis=0)
    )
    assert any(
        "the mean of their stated inertial values" in note
        for note in tied.reading.notes
    )
    file.write_text("echelon: 1\nrobot: {file: two_link.xml}\nlabels: {nobody: link}\n")
    with pytest.raises(
        ec.InputError, match=r"tied\.yaml: labels\.nobody: there is no body 'nobody'"
    ):
        ec.load(file)


def test_contradicting_inertial_values_are_refused() -> None:
    stated = (
        "label: link, inertial: {{standard: [1, 0, 0, 1, 0, 1, 0, 0, 0, {mass}]}}, "
    )
    text = shared.PENDULUM.replace(
        "label: link, joint", stated.format(mass=1) + "joint"
    )
    assert read(text).standard_values()[9] == 1
    with pytest.raises(
        ec.InputError,
        match=r"shares the label 'link', .*other inertial values are stated",
    ):
        read(text.replace("label: link, parent", stated.format(mass=2) + "parent"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("label: link, parent", "label: link, massless: true, parent"),
            "shares the label 'link'.*others of the ten",
        ),
        (
            ("bodies:", "labels: {one: link}\nbodies:"),
            "labels: is for bodies of a robot file",
        ),
    ],
)
def test_what_cannot_be_shared_is_refused(
    change: tuple[str, str], message: str
) -> None:
    with pytest.raises(ec.InputError, match=message):
        read(shared.PENDULUM.replace(*change))
