"""Contacts with unknown forces: what a robot on its feet shows."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.exact.polynomial import as_polynomial
from echelon.robot.contact import Contact, ContactKind
from echelon.robot.joint import shift
from support.robot_files import robot_file
from support.stacked_rows import Observed, Touch, agrees, random_urdf

LEGS = ("FL", "FR", "RL", "RR")


def a1(*feet: str) -> str:
    contacts = ", ".join(f"{{body: {leg}_foot}}" for leg in feet)
    return f"echelon: 1\nrobot: {robot_file('a1')}\ncontacts: [{contacts}]\n"


@pytest.fixture(scope="module")
def quadruped(tmp_path_factory: pytest.TempPathFactory) -> ec.Mechanism:
    file = tmp_path_factory.mktemp("a1") / "a1.yaml"
    file.write_text(a1(*LEGS))
    return ec.load(file, floating=True)


@pytest.mark.parametrize(("feet", "rank"), [(1, 93), (2, 92), (4, 90)])
def test_feet_of_a_quadruped_hide_a_few(
    quadruped: ec.Mechanism, feet: int, rank: int
) -> None:
    names = [f"{leg}_foot" for leg in ("FL", "RR", "FR", "RL")[:feet]]
    assert (
        ec.base_structure(ec.joined([ec.Experiment(quadruped, contacts=names)])).rank
        == rank
    )


def test_a_trot_shows_all(quadruped: ec.Mechanism) -> None:
    one = ec.Experiment(quadruped, "one", contacts=["FL_foot", "RR_foot"])
    other = ec.Experiment(quadruped, "other", contacts=["FR_foot", "RL_foot"])
    base = ec.base_parameters([one, other])
    assert base.rank == 94
    assert not base.certificate.unchecked


def test_force_plates_show_what_the_feet_hide(quadruped: ec.Mechanism) -> None:
    plates = tuple(replace(c, measured=("fx", "fy", "fz")) for c in quadruped.contacts)
    assert ec.base_structure(replace(quadruped, contacts=plates)).rank == 94


def check_random(seed: int) -> None:
    """A floating tree with random contacts against projected rows of Pinocchio."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    joints = int(rng.integers(2, 7))
    text = random_urdf(rng, joints)
    robot = ec.load(text, floating=True, snap_tolerance=0)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    names = ["root_joint", *(body.joint.name for body in robot.bodies[1:])]
    contacts, touches, held = list[Contact](), list[Touch](), 0
    for k in range(3):
        kind = str(rng.choice(["point", "point", "line", "surface"]))
        body = int(rng.integers(0, len(robot.bodies)))
        held += {"point": 3, "line": 5, "surface": 6}[kind]
        if held > joints + 4 or any(c.body == body for c in contacts):
            break
        place = [Fraction(int(x), 8) for x in rng.integers(-8, 9, 3)]
        frame = shift(*map(as_polynomial, place))
        measured = tuple(c for c in ("fx", "fy", "fz") if rng.random() < 0.15)
        contacts.append(
            Contact(f"c{k}", ContactKind(kind), body, frame, measured=measured)
        )
        known = tuple(("fx", "fy", "fz").index(c) for c in measured)
        touches.append(Touch(names[body], np.array(place, dtype=float), kind, known))
    base = ec.base_parameters(replace(robot, contacts=tuple(contacts)), budget=0)
    assert agrees(base, Observed(model, names).standing(rng, touches, samples=80))


@pytest.mark.parametrize("seed", range(3))
def test_random_trees_agree_with_projected_rows_of_pinocchio(seed: int) -> None:
    check_random(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3, 40))
def test_more_random_trees_agree_with_projected_rows_of_pinocchio(seed: int) -> None:
    check_random(seed)


@pytest.mark.slow
def test_a_humanoid_shows_all_as_it_walks(tmp_path: Path) -> None:
    soles = [
        f"  - {{body: leg_{side}_6_link, type: surface, name: {side}}}\n"
        for side in ("left", "right")
    ]
    file = tmp_path / "talos.yaml"
    file.write_text(
        f"echelon: 1\nrobot: {robot_file('talos_full_v2')}\ncontacts:\n{''.join(soles)}"
    )
    robot = ec.load(file, floating=True)
    choices: list[list[str]] = [[], ["left"], ["left", "right"]]
    experiments = [ec.Experiment(robot, contacts=names) for names in choices]
    ranks = [ec.base_structure(ec.joined([e])).rank for e in experiments]
    assert ranks == [260, 246, 232]
    steps = [ec.Experiment(robot, contacts=[name]) for name in ("left", "right")]
    assert ec.base_structure(ec.joined(steps)).rank == 260


@pytest.mark.parametrize(
    "seed",
    [
        1,
        pytest.param(2, marks=pytest.mark.slow),
        pytest.param(3, marks=pytest.mark.slow),
    ],
)
def test_wheels_roll_on_level_ground(seed: int) -> None:
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    text = random_urdf(rng, 3)
    robot = ec.load(text, floating=True, snap_tolerance=0)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    names = ["root_joint", *(body.joint.name for body in robot.bodies[1:])]
    body, radius = int(rng.integers(0, 4)), Fraction(1, 8)
    wheel = Contact(
        "wheel", ContactKind.ROLLING, body, shift(0, 0, 0), as_polynomial(radius)
    )
    base = ec.base_parameters(replace(robot, contacts=(wheel,)), budget=0)
    touch = Touch(names[body], np.zeros(3), "rolling", radius=float(radius))
    assert agrees(base, Observed(model, names).standing(rng, [touch]))


def touching(extra: str = "") -> ec.Mechanism:
    """A small arm that touches something with its last link."""
    return ec.load(
        "{echelon: 1, gravity: [0, 0, -9.81], modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2, a: '0.1'},"
        " {joint: revolute, a: '0.3'}, {joint: revolute, a: '0.2', alpha: pi/2}, {joint: revolute, a: '0.1', alpha: -pi/2}],"
        f" contacts: [{{body: j5, at: {{xyz: [0.1, 0.2, 0.3]}}}}{extra}]}}"
    )


def test_contacts_have_names_of_their_own() -> None:
    with pytest.raises(ec.InputError, match="two contacts have this name"):
        touching(", {body: j5}")


def test_base_parameters_of_contacts_are_no_full_model() -> None:
    base = ec.base_parameters(touching())
    q = np.zeros((1, 5))
    with pytest.raises(ec.InputError, match="leave the contacts out"):
        base.mass_matrix(q, np.ones(base.rank))
    with pytest.raises(ec.InputError, match="without_contact_forces"):
        base.accumulate({"q": q, "qd": q, "qdd": q, "y": q})
    assert "mass_matrix" not in "".join(ec.generate(base, "c").values())
    with pytest.raises(ec.InputError, match="several sensors together"):
        ec.sensor_report(base.mechanism)
    with pytest.raises(ec.InputError, match="contacts or consists of experiments"):
        ec.compare(base.mechanism, base.mechanism)
