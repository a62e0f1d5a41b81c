"""Effects and rotors against independent formulas, and what they do to the base parameters."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.formats.snapping import ReadingOptions
from support.descriptions import read_description
from support.paths import ROOT

ROW = {"joint": "revolute", "alpha": "pi/2", "a": "0.2"}


def arm(joints: int = 2, **entries: object) -> ec.Mechanism:
    data = {"echelon": 1, "name": "arm", "modified_dh": [ROW] * joints, **entries}
    return read_description(json.dumps(data), "arm", ReadingOptions())


def columns(
    robot: ec.Mechanism, q: object, qd: object, qdd: object
) -> dict[str, np.ndarray]:
    x = evaluate_floats(inverse_dynamics_regressor(robot), robot, q, qd, qdd)
    return {name: x[:, :, k] for k, name in enumerate(robot.parameters)}


STATES = np.random.default_rng(5).normal(size=(3, 20, 2))
Q, QD, QDD = STATES

FORMULAS = {
    "viscous": {"Fv": lambda _q, v, _a: v},
    "coulomb": {"Fc": lambda _q, v, _a: np.sign(v)},
    "asymmetric_coulomb": {
        "Fcp": lambda _q, v, _a: np.where(v > 0, 1.0, 0.0),
        "Fcn": lambda _q, v, _a: np.where(v < 0, -1.0, 0.0),
    },
    "offset": {"Fo": lambda _q, v, _a: np.ones_like(v)},
    "rotor_inertia": {"Ia": lambda _q, _v, a: a},
    "spring": {"Ks": lambda q, _v, _a: q, "Ps": lambda q, _v, _a: np.ones_like(q)},
}


@pytest.mark.parametrize("kind", FORMULAS)
def test_ready_made_effects(kind: str) -> None:
    found = columns(arm(effects=[{"type": kind, "at": "all"}]), Q, QD, QDD)
    for symbol, formula in FORMULAS[kind].items():
        expected = formula(Q, QD, QDD)
        for joint in (0, 1):
            column = found[f"{symbol}{joint + 1}"]
            np.testing.assert_allclose(column[:, joint], expected[:, joint], rtol=1e-14)
            assert not column[:, 1 - joint].any()


def test_stribeck() -> None:
    found = columns(
        arm(
            effects=[
                {"type": "stribeck", "at": "j1", "velocity": "0.5", "exponent": "2"}
            ]
        ),
        Q,
        QD,
        QDD,
    )
    v = QD[:, 0]
    np.testing.assert_allclose(
        found["Fs1"][:, 0], np.sign(v) * np.exp(-((np.abs(v) / 0.5) ** 2)), rtol=1e-12
    )


def test_effects_in_the_drive_act_through_the_transmission() -> None:
    drives = {"a": "3*j1 + 2*j2", "b": "-j1 + 5*j2"}
    transmission = np.array([[3.0, 2.0], [-1.0, 5.0]])
    robot = arm(actuators=drives, effects=[{"type": "viscous", "at": ["a", "j2"]}])
    assert robot.effects[1].actions[0].side == "joint"
    found = columns(robot, Q, QD, QDD)
    rates = QD @ transmission.T
    np.testing.assert_allclose(
        found["Fv_a"], np.stack([rates[:, 0], np.zeros(20)], axis=1), rtol=1e-14
    )
    # a joint's friction reaches the motors by the inverse of T, transposed
    joint = np.stack([np.zeros(20), QD[:, 1]], axis=1)
    np.testing.assert_allclose(
        found["Fv2"], joint @ np.linalg.inv(transmission), rtol=1e-12
    )


def test_a_torque_sensor_in_the_joint_does_not_see_the_drive() -> None:
    effects = [
        {"type": "viscous", "at": "j1"},
        {"type": "viscous", "at": "j1", "side": "joint", "label": "bearing"},
    ]
    found = columns(arm(effects=effects, outputs=[{"joint": "j1"}]), Q, QD, QDD)
    assert not found["Fv1"].any()
    np.testing.assert_allclose(found["Fvbearing"][:, 0], QD[:, 0])


def test_a_rotor_on_the_first_link_of_a_planar_arm() -> None:
    """E = I (q̇1 + n q̇2)² / 2, so τ1 = I (q̈1 + n q̈2) and τ2 = n τ1."""
    rows = [{"joint": "revolute"}, {"joint": "revolute", "a": "0.3"}]
    rotors = [{"name": "rotor", "on": "j1", "drives": "50*j2", "label": "r"}]
    data = {"echelon": 1, "name": "arm", "modified_dh": rows, "rotors": rotors}
    robot = read_description(json.dumps(data), "arm", ReadingOptions())
    expected = QDD[:, 0] + 50 * QDD[:, 1]
    np.testing.assert_allclose(
        columns(robot, Q, QD, QDD)["ZZr"],
        np.stack([expected, 50 * expected], 1),
        rtol=1e-12,
    )


def test_gyroscopic_torque_of_a_rotor() -> None:
    """A rotor that spins across the axis of the link that carries it resists with I ω × θ̇."""
    rows = [{"joint": "revolute"}, {"joint": "revolute", "alpha": "pi/2"}]
    rotors = [
        {"name": "rotor", "on": "j2", "drives": "10*j2", "axis": "x", "label": "r"}
    ]
    data = {"echelon": 1, "name": "arm", "modified_dh": rows, "rotors": rotors}
    robot = read_description(json.dumps(data), "arm", ReadingOptions())
    # E = I/2 (ω_x + 10 q̇2)² with ω_x = q̇1 sin q2
    (q2, d1, d2), (a1, a2) = (Q[:, 1], QD[:, 0], QD[:, 1]), (QDD[:, 0], QDD[:, 1])
    spin = d1 * np.sin(q2) + 10 * d2
    rate = a1 * np.sin(q2) + d1 * d2 * np.cos(q2) + 10 * a2
    tau1 = rate * np.sin(q2) + spin * np.cos(q2) * d2
    tau2 = 10 * rate - spin * d1 * np.cos(q2)
    np.testing.assert_allclose(
        columns(robot, Q, QD, QDD)["XXr"], np.stack([tau1, tau2], axis=1), rtol=1e-10
    )


def test_an_effect_with_several_places_and_terms() -> None:
    acts = [
        {"at": "j1", "term": "2*qd[j2]"},
        {"at": "j2", "term": "qd[j1]*sin(q) - q[j1]**2/3"},
    ]
    found = columns(
        arm(effects=[{"parameter": "K", "unit": "N·m", "acts": acts}]), Q, QD, QDD
    )["K"]
    np.testing.assert_allclose(found[:, 0], 2 * QD[:, 1], rtol=1e-14)
    np.testing.assert_allclose(
        found[:, 1], QD[:, 0] * np.sin(Q[:, 1]) - Q[:, 0] ** 2 / 3, rtol=1e-12
    )


def test_friction_of_a_ball() -> None:
    """Each of its three velocities has a parameter, its own power, and no position that a term could use."""
    joint = {"type": "spherical", "name": "b"}
    data = {
        "echelon": 1,
        "name": "ball",
        "bodies": [{"name": "b", "joint": joint}],
        "effects": {"viscous": "all"},
    }
    robot = read_description(json.dumps(data), "ball", ReadingOptions())
    found = columns(
        robot, [[0.5, 0.5, -0.5, 0.5]], [[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0]]
    )
    assert [found[f"Fv1_{k}"][0].tolist() for k in (1, 2, 3)] == [
        [1, 0, 0],
        [0, 2, 0],
        [0, 0, 3],
    ]
    assert ec.base_parameters(robot).rank == 9 + 3
    data["effects"] = {"spring": ["b.x"]}
    with pytest.raises(ec.InputError, match="'q' is unknown"):
        ec.base_parameters(read_description(json.dumps(data), "ball", ReadingOptions()))


@pytest.mark.parametrize(
    ("kinds", "added"),
    [
        (["viscous"], 6),
        (["coulomb"], 6),
        (["offset"], 6),
        # the inertia of the first rotors counts to the links that turn with them
        (["rotor_inertia"], 4),
        (["viscous", "coulomb", "offset", "rotor_inertia"], 22),
        (["coulomb", "asymmetric_coulomb"], 12),
    ],
)
def test_rank_with_effects(kinds: list[str], added: int, tmp_path: Path) -> None:
    root = ROOT
    rows = (root / "examples" / "ur10.yaml").read_text()
    path = tmp_path / "ur10.yaml"
    path.write_text(
        rows
        + "\neffects:\n"
        + "".join(f"  - {{type: {kind}, at: all}}\n" for kind in kinds)
    )
    base = ec.base_parameters(ec.load(path))
    assert base.rank == 36 + added
    assert base.certificate.log10_error < -30


def test_a_spring_across_gravity() -> None:
    """On a vertical slide the weight and a spring's preload are one force."""
    data = {
        "echelon": 1, "name": "slide", "modified_dh": [{"joint": "prismatic"}],
        "effects": [{"type": "spring", "at": "j1"}, {"type": "offset", "at": "j1"}],
    }  # fmt: skip
    base = ec.base_parameters(
        read_description(json.dumps(data), "slide", ReadingOptions())
    )
    assert [str(e) for e in base.expressions] == ["M1", "Ks1", "Ps1 + Fo1"]


def test_coupled_arm_example() -> None:
    root = ROOT
    robot = ec.load(root / "examples" / "coupled_arm.yaml")
    base = ec.base_parameters(robot)
    assert [o.name for o in robot.outputs] == ["m2", "m3", "m4", "m5", "m6", "m7", "j1"]
    friction = [e for e in base.expressions if str(e).startswith("F")]
    assert len(friction) == 14


def test_drive_gains_multiply_measured_currents() -> None:
    base = ec.base_parameters(arm(effects=[{"type": "drive_gain", "at": "all"}]))
    currents = {"j1": np.linspace(1, 2, 20), "j2": np.linspace(-1, 1, 20)}
    x = base.standard_regressor(Q, QD, QDD, inputs=currents)
    np.testing.assert_allclose(x[:, 1, base.parameters.index("Kt2")], -currents["j2"])
    with pytest.raises(ec.InputError, match=r"input i\[j"):
        base.standard_regressor(Q, QD, QDD)


def test_a_point_payload_adds_its_mass_alone() -> None:
    arm_alone = {"name": "link", "joint": {"type": "revolute", "axis": "y"}}
    payload = {
        "name": "load", "parent": "link", "joint": {"type": "fixed", "origin": {"xyz": ["0.3", 0, 0]}},
        "separate": True, "parameters": ["M"], "label": "L",
    }  # fmt: skip
    data = {"echelon": 1, "name": "arm", "bodies": [arm_alone, payload]}
    robot = read_description(json.dumps(data), "arm", ReadingOptions())
    assert robot.parameters[-1] == "ML"
    assert len(robot.parameters) == 11
    assert [str(e) for e in ec.base_parameters(robot).expressions] == [
        "YY1 + 9/100·ML",
        "MX1 + 3/10·ML",
        "MZ1",
    ]


def acting(parameter: str, **terms: str) -> dict[str, object]:
    return {
        "parameter": parameter,
        "unit": "N·m",
        "acts": [{"at": at, "term": term} for at, term in terms.items()],
    }


REGIONS: dict[str, tuple[list[dict[str, object]], int, int]] = {
    "end stop": ([acting("K", j1="max(0, q - 200)"), acting("S", j1="q")], 2, 2),
    "backlash": (
        [acting("K", j1="max(0, q - d) + min(0, q + d)"), acting("S", j1="q")],
        2,
        3,
    ),
    # max(0, v) − max(0, −v) = v, but only together
    "viscous, by sides": (
        [
            acting("A", j1="max(0, qd)"),
            acting("B", j1="min(0, qd)"),
            acting("V", j1="qd"),
        ],
        2,
        2,
    ),
    "dead zone": (
        [
            acting("A", j1="max(0, qd - d)"),
            acting("B", j1="max(0, qd)"),
            acting("V", j1="qd"),
        ],
        3,
        3,
    ),
    "corner": (
        [
            acting(
                "A", j1="(1 + sign(q - 30))*(1 + sign(qd - 99))*(1 + sign(q[j2] + 9))"
            )
        ],
        1,
        8,
    ),
    "no such corner": ([acting("A", j1="(1 + sign(qd - 9))*(1 - sign(qd - d))")], 0, 3),
    "friction": (
        [{"type": "coulomb", "at": "all"}, {"type": "asymmetric_coulomb", "at": "all"}],
        4,
        3,
    ),
}


@pytest.mark.parametrize("case", REGIONS.values(), ids=REGIONS)
def test_small_and_distant_regions(
    case: tuple[list[dict[str, object]], int, int],
) -> None:
    effects, added, regions = case
    base = ec.base_parameters(
        arm(effects=effects, symbols={"d": {"value": 0.001, "meaning": "half width"}})
    )
    assert base.rank == 10 + added
    assert base.certificate.regions == regions
    assert base.certificate.log10_error < -30


def test_friction_of_many_joints_needs_no_combinations() -> None:
    base = ec.base_parameters(arm(30, effects=[{"type": "coulomb", "at": "all"}]))
    assert base.rank == ec.base_parameters(arm(30)).rank + 30
    assert base.certificate.regions == 31  # of 2^30
    assert "enough for all products" in str(base.certificate)


@pytest.mark.slow
def test_dead_zones_of_speed_in_a_loop() -> None:
    """Closed states are drawn at all speeds; that they reach all regions of signs is a claim that nothing checks."""
    path = ROOT / "examples" / "loops" / "four_bar.yaml"
    data = yaml.safe_load(path.read_text())
    doubt = "regions of signs that random closed states miss"

    def derived(**terms: str) -> ec.BaseModel:
        data["effects"] = [acting(name, crank=term) for name, term in terms.items()]
        text = json.dumps(data)
        return ec.base_parameters(read_description(text, "four bar", ReadingOptions()))

    base = derived(A="max(0, qd - 0.001)", B="max(0, qd)", V="qd")
    assert base.rank == 8 + 3
    assert base.certificate.unchecked == (doubt,)
    assert derived(A="max(0, qd - 20000)").rank == 8 + 1
    stop = derived(A="max(0, q - 2000)")
    assert stop.rank == 8
    assert stop.certificate.unchecked == (doubt,)
