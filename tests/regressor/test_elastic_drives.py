"""Elastic drives: rows against Lagrange's equations, exact ranks against singular values of those, what sensors add."""

from __future__ import annotations

import json

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from support.descriptions import read_description
from support.elastic_lagrangians import ElasticChain

GAP = 1e6  # of singular values, from which on a numerical rank counts
SAMPLES = 60
LITERAL = ReadingOptions(snap_tolerance=0)
PLANE = """
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}, {joint: revolute, a: 0.4}]
rotors:
  - {name: m1, on: base, drives: 100*j1, elastic: true}
  - {name: m2, on: base, drives: 50*j2, elastic: true}
"""


def robot(text: str) -> ec.Mechanism:
    return read_description(f"echelon: 1\n{text}", "arm", LITERAL)


@pytest.mark.parametrize("seed", range(30))
def test_random_arms_obey_lagrange(seed: int) -> None:
    chain = ElasticChain.random(seed)
    mechanism = read_description(chain.description, "arm", LITERAL)
    q, qd, qdd = np.random.default_rng(seed).normal(
        size=(3, SAMPLES, 2 * len(chain.rows))
    )
    names, expected = chain.regressor(q, qd, qdd)
    order = [names.index(output.name) for output in mechanism.outputs]
    columns = [chain.parameters.index(name) for name in mechanism.parameters]
    found = evaluate_floats(
        inverse_dynamics_regressor(mechanism), mechanism, q, qd, qdd
    )
    expected = expected[:, order][:, :, columns]
    np.testing.assert_allclose(
        found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max()
    )

    table = expected.reshape(-1, len(columns))
    sizes = np.linalg.norm(table, axis=0)
    seen = table[:, sizes > sizes.max() / GAP**2] / sizes[sizes > sizes.max() / GAP**2]
    values = np.append(np.linalg.svd(seen, compute_uv=False), 0.0)
    rank = ec.base_parameters(mechanism).rank
    assert values[rank - 1] > GAP * values[rank]
    assert values[rank - 1] > values[0] / GAP


def test_both_encoders_show_the_springs_and_the_links_as_rigid_drives_do() -> None:
    base = ec.base_parameters(robot(PLANE))
    rigid = ec.base_parameters(robot(PLANE.replace(", elastic: true", "")))
    links = [e for e in base.expressions if e.name[:2] in ("ZZ", "MX", "MY")]
    assert [str(e) for e in links[:2]] == ["ZZ1 + 4/25·M2", "MX1 + 2/5·M2"]
    assert {"Ks1", "Ds1", "Ps1", "Ks2", "Ds2", "Ps2"} <= set(base.pivots)
    # the rotors' inertia is apart from that of the links, which it is not where both move as one
    assert {"ZZ_m1", "ZZ_m2"} <= set(base.pivots)
    assert base.rank == 6 + 2 + 6
    assert "ZZ_m1" not in rigid.pivots


def test_torque_sensors_add_no_parameter_and_give_the_spring_alone() -> None:
    sensed = robot(PLANE + "outputs: [{actuator: all}, {joint: j1}, {joint: j2}]\n")
    spring = sensed.outputs[-1]
    assert (spring.name, spring.reads, spring.sensor) == ("m2.spring", "j2", "j2")
    base = ec.base_parameters(sensed)
    assert base.rank == ec.base_parameters(robot(PLANE)).rank
    rows, columns = base.sparsity
    seen = {base.pivots[c] for c in columns[rows == len(sensed.outputs) - 1]}
    assert seen == {"Ks2", "Ds2", "Ps2"}


def test_stiffness_of_third_order_is_seen_as_well() -> None:
    third = '{parameter: K3, unit: N·m/rad³, acts: [{at: m1.spring, term: "q**3"}]}'
    base = ec.base_parameters(robot(PLANE + f"effects: [{third}]\n"))
    assert "K3" in base.pivots
    assert base.rank == ec.base_parameters(robot(PLANE)).rank + 1


def test_friction_in_all_drives_is_that_of_the_motors() -> None:
    found = robot(
        PLANE
        + "effects: [{type: viscous, at: all}, coulomb]\n".replace(
            "coulomb", "{type: coulomb, at: all, side: joint, label: c}"
        )
    )
    places = {e.parameter: [a.at for a in e.actions] for e in found.effects}
    assert places["Fv1"] == ["m1"]
    assert places["Fcc"] == ["j1", "j2"]


def test_a_wrench_alone_still_gets_the_row_of_the_spring() -> None:
    found = robot(PLANE + "outputs: [{wrench: base}]\n")
    assert {"m1.spring", "m2.spring"} < {o.name for o in found.outputs}
    assert {"Ks1", "Ks2"} <= set(ec.base_parameters(found).pivots)


@pytest.mark.parametrize("drives", ["100*j1 + 2*j2", "n*j1"])
def test_what_an_elastic_drive_cannot_move(drives: str) -> None:
    text = PLANE.replace("100*j1", drives) + "symbols: {n: null}\n"
    with pytest.raises(
        ec.InputError, match="moves one joint, by a ratio that is a number"
    ):
        robot(text)


def test_springs_are_no_sensors() -> None:
    with pytest.raises(ec.InputError, match=r"m1\.spring"):
        robot(PLANE + "outputs: [{actuator: m1.spring}]\n")


def test_descriptions_come_back_as_they_were_written() -> None:
    mechanism = robot(
        PLANE + "effects: [{type: lugre, at: m1, stiffness: 900, velocity: 0.1}]\n"
    )
    again = read_description(json.dumps(write_description(mechanism)), "again", LITERAL)
    assert again.outputs == mechanism.outputs
    assert again.effects == mechanism.effects
    assert again.actuators == mechanism.actuators
