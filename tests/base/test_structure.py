"""Ranks that the literature states, and what they must not depend on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.exact.expressions import Angle
from echelon.algebra.exact.polynomial import Polynomial
from echelon.robot.joint import (
    Body,
    Joint,
    Motion,
    Placement,
    ball,
    floating_motions,
    merge,
    rotate,
    rotation,
    translation,
    turn,
)
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import DegenerateSampleError
from support import textbook_arms as arms
from support.float_regressor import FloatArray, float_regressor, random_states
from support.random_mechanisms import mechanisms
from support.selection import examples

H = "pi/2"


def rank(mechanism: Mechanism, seed: int = 1) -> int:
    return ec.base_structure(mechanism, seed=seed).rank


def serial(alphas: list[str], gravity: str | None = arms.DOWN) -> Mechanism:
    """A serial arm with generic symbolic lengths."""
    rows = [f"R {alpha} a{i} d{i}" for i, alpha in enumerate(alphas)]
    return arms.modified_dh("serial", *rows, gravity=gravity)


PUMA = (
    "R 0 0 0",
    "R -pi/2 0 0",
    "R 0 a2 d3",
    "R -pi/2 a3 d4",
    "R pi/2 0 0",
    "R -pi/2 0 0",
)
STANFORD = (
    "R 0 0 0",
    "R -pi/2 0 d2",
    "P pi/2 0 0",
    "R 0 0 0",
    "R -pi/2 0 0",
    "R pi/2 0 0",
)
PENDULUM = ("R 0 0 0", "R 0 l1 0")
UNIVERSAL_ROBOTS = {
    "generic": ("d1", "a2", "a3", "d4", "d5", "d6"),
    "UR3": ("0.1519", "0.24365", "0.21325", "0.11235", "0.08535", "0.0819"),
    "UR5": ("0.089159", "0.425", "0.39225", "0.10915", "0.09465", "0.0823"),
    "UR10": ("0.1273", "0.612", "0.5723", "0.163941", "0.1157", "0.0922"),
}


@pytest.mark.parametrize(
    ("rows", "gravity", "expected"),
    [
        (PENDULUM, "0 -g 0", 6),
        (PENDULUM, None, 4),
        (PENDULUM, "0 0 -g", 4),
        (PUMA, "0 0 -g", 36),
        (PUMA, "gx gy gz", 38),
        (PUMA, None, 34),
        (STANFORD, "0 0 -g", 33),
        (("P 0 0 0", "P pi/2 0 0", "P pi/2 0 0"), "0 0 -g", 3),
        (("R 0 0 0", "P 0 0 0", "P pi/2 0 0"), "0 0 -g", 5),
        (("P 0 0 0",), None, 1),
        (("R 0 0 0",), "0 0 -g", 1),
        (("R 0 0 0",), "0 -g 0", 3),
    ],
)
def test_published_rank(
    rows: tuple[str, ...], gravity: str | None, expected: int
) -> None:
    assert rank(arms.modified_dh("arm", *rows, gravity=gravity)) == expected


@pytest.mark.parametrize(
    ("robot", "expected"),
    [(arms.rx90, 36), (arms.panda, 43), (arms.cart_pole, 4), (arms.furuta, 8)],
)
def test_rank_of_known_robot(robot: Callable[[], Mechanism], expected: int) -> None:
    assert rank(robot()) == expected


@pytest.mark.parametrize(
    ("d1", "a2", "a3", "d4", "d5", "d6"),
    UNIVERSAL_ROBOTS.values(),
    ids=UNIVERSAL_ROBOTS,
)
def test_universal_robots(d1: str, a2: str, a3: str, d4: str, d5: str, d6: str) -> None:
    rows = (
        f"R 0 0 {d1}",
        "R pi/2 0 0",
        f"R 0 -{a2} 0",
        f"R 0 -{a3} {d4}",
        f"R pi/2 0 {d5}",
        f"R -pi/2 0 {d6}",
    )
    assert rank(arms.modified_dh("ur", *rows)) == 36


@pytest.mark.parametrize("n", range(1, 9))
def test_serial_revolute_with_general_twists(n: int) -> None:
    assert rank(arms.general_arm(n)) == 7 * n - 6
    assert rank(arms.general_arm(n, arms.GENERIC)) == 7 * n - 4


@pytest.mark.parametrize("n", range(1, 8))
def test_serial_revolute_generic(n: int) -> None:
    alphas = ["0"] + ["pi/2" if i % 2 else "-pi/2" for i in range(n - 1)]
    assert rank(serial(alphas)) == 7 * n - 6
    assert rank(serial(alphas, arms.GENERIC)) == 7 * n - 4


@pytest.mark.parametrize(("n", "parallel"), [(3, 2), (5, 2), (6, 3), (7, 4)])
def test_first_axes_parallel(n: int, parallel: int) -> None:
    alphas = ["0"] * parallel + [
        "pi/2" if i % 2 else "-pi/2" for i in range(n - parallel)
    ]
    assert rank(serial(alphas)) == 7 * n - 4 * parallel - 2
    assert rank(serial(alphas, arms.GENERIC)) == 7 * n - 4 * parallel


@pytest.mark.parametrize("n", range(1, 7))
def test_planar(n: int) -> None:
    assert rank(serial(["0"] * n, "0 -g 0")) == 3 * n
    assert rank(serial(["0"] * n, None)) == 3 * n - 2


def test_spherical_joint_on_the_ground() -> None:
    body = arms.body(1, 0, "spherical", ball("s"))
    assert rank(arms.tree("top", body)) == 9
    assert rank(arms.tree("top", body, gravity=None)) == 6


@examples(25)
@given(
    st.lists(
        st.tuples(st.sampled_from("RPS"), st.integers(0, 9), st.integers(0, 2)),
        max_size=6,
    ),
    st.booleans(),
)
def test_floating_tree(joints: list[tuple[str, int, int]], weightless: bool) -> None:
    """Every joint of a floating tree adds a number of its own: 10 + 7 R + 4 P + 9 S."""
    bodies = [arms.body(1, 0, "floating", *floating_motions("base"))]
    for k, (kind, host, axis) in enumerate(joints, start=2):
        make = {
            "R": lambda n, a: rotation(n, a),
            "P": lambda n, a: translation(n, a),
            "S": lambda n, _: ball(n),
        }[kind]
        placed = arms.place(f"x{k} y{k} z{k}", "pi/4 0 pi/3")
        bodies.append(
            arms.body(k, 1 + host % (k - 1), kind, placed, make(f"q{k}", axis))
        )
    expected = 10 + sum({"R": 7, "P": 4, "S": 9}[kind] for kind, _, _ in joints)
    assert (
        rank(arms.tree("tree", *bodies, gravity=None if weightless else arms.DOWN))
        == expected
    )


# -- what the rank must not depend on -------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_seed_does_not_matter(seed: int) -> None:
    arm = arms.modified_dh("puma", *PUMA)
    assert (
        ec.base_structure(arm, seed=seed).pivots
        == ec.base_structure(arm, seed=99).pivots
    )


def test_bad_luck_is_outvoted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A random point where more columns seem dependent than are, or a zero denominator, costs a repetition only."""
    true, unlucky = {1: (0,)}, {1: (0,), 2: ()}
    draws = iter([unlucky, DegenerateSampleError(), true, unlucky, true])

    def draw(*_: object) -> dict[int, tuple[int, ...]]:
        drawn = next(draws)
        if isinstance(drawn, Exception):
            raise drawn
        return drawn

    monkeypatch.setattr("echelon.base.structure.dependent_columns", draw)
    found = ec.base_structure(arms.modified_dh("pendulum", "R 0 0 0"))
    assert found.by_robot == true


def test_names_do_not_matter() -> None:
    arm = arms.modified_dh("puma", *PUMA)
    renamed = replace(arm, bodies=tuple(map(rename, arm.bodies)))
    assert ec.base_structure(renamed).pivots == ec.base_structure(arm).pivots


def rename(body: Body) -> Body:
    """Other names for the body, its parameters, its joint and its coordinate, in another alphabetical order."""
    steps = tuple(
        replace(s, name=f"{9 - int(body.label)}") if isinstance(s, Motion) else s
        for s in body.joint.steps
    )
    return replace(body, name="", label=f"{body.label}_", joint=Joint("", "", steps))


@pytest.mark.parametrize("parents", [(0, 1, 1, 2, 3), (0, 1, 2, 1, 4)])
def test_order_of_branches_does_not_matter(parents: tuple[int, ...]) -> None:
    """A waist that carries two different arms of two joints, listed side by side, or one after the other."""
    numbers = {(0, 1, 1, 2, 3): (1, 2, 3, 4, 5), (0, 1, 2, 1, 4): (1, 3, 5, 2, 4)}[
        parents
    ]
    assert (
        rank(two_arms(numbers, parents))
        == rank(two_arms((1, 2, 4, 3, 5), (0, 1, 2, 1, 4)))
        == 1 + 4 * 7
    )


def two_arms(numbers: tuple[int, ...], parents: tuple[int, ...]) -> Mechanism:
    """Bodies with even numbers are one arm, 3 and 5 the other; each keeps its own joint wherever it is listed."""
    poses = {1: "0 0 0", 2: "pi/2 0 0", 3: "pi/6 0 pi/4", 4: "0 pi/2 0", 5: "pi/3 0 0"}
    bodies = [
        arms.body(
            at,
            parent,
            "revolute",
            arms.place(f"x{k} y{k} z{k}", poses[k]),
            rotation(f"q{k}"),
        )
        for at, (k, parent) in enumerate(zip(numbers, parents, strict=True), start=1)
    ]
    return arms.tree("two arms", *bodies)


@pytest.mark.parametrize("unit", ["1", "1000", "0.001"])
def test_unit_of_length_does_not_matter(unit: str) -> None:
    rows = [
        row.replace("a2", f"{unit}*0.4318").replace("a3", f"{unit}*0.0203")
        for row in PUMA
    ]
    rows = [
        row.replace("d3", f"{unit}*0.15005").replace("d4", f"{unit}*0.4318")
        for row in rows
    ]
    assert rank(arms.modified_dh("puma", *rows, gravity=f"0 0 -9.81*{unit}")) == 36


@pytest.mark.parametrize(("axis", "steps"), [(0, 1), (1, 3), (2, 5), (0, 12)])
def test_base_frame_does_not_matter(axis: int, steps: int) -> None:
    """Turning the base frame turns gravity and the first joint's mounting alike."""
    arm = arms.modified_dh("puma", *PUMA)
    back = turn(axis, Angle(Fraction(steps, 12)))
    joint = arm.bodies[0].joint
    first = replace(
        arm.bodies[0], joint=replace(joint, steps=merge((back, *joint.steps)))
    )
    assert arm.gravity is not None
    moved = replace(
        arm, bodies=(first, *arm.bodies[1:]), gravity=rotate(back.rotation, arm.gravity)
    )
    assert rank(moved) == rank(arm)


# -- against floating point -------------------------------------------------------------------------------------------


def svd_rank(mechanism: Mechanism) -> int:
    return singular_value_rank(
        float_regressor(mechanism, *random_states(mechanism, 60))
    )


def singular_value_rank(x: FloatArray) -> int:
    matrix = x.reshape(-1, x.shape[2])
    norms = np.linalg.norm(matrix, axis=0)
    seen = norms > 1e-9 * norms.max()
    values = np.linalg.svd(matrix[:, seen] / norms[seen], compute_uv=False)
    found = int((values > 1e-9 * values[0]).sum())
    gap = values[found - 1] / max(values[found] if found < len(values) else 0.0, 1e-300)
    assert gap > 1e3, "the singular values leave no doubt in these examples"
    return found


LENGTHS = {"a": "0.3", "b": "0.45", "c": "0.2", "h": "0.05", "g": "9.81"}
PLACED = arms.place("a b c", "pi/6 0 pi/4")


@pytest.mark.parametrize(
    "kind", ["helical", "cylindrical", "universal", "planar", "spherical"]
)
@pytest.mark.parametrize("gravity", [arms.DOWN, None])
def test_other_joints_against_singular_values(kind: str, gravity: str | None) -> None:
    steps = {
        "helical": (arms.screw("x", Polynomial.generator("h")),),
        "cylindrical": arms.cylindrical_motions("x"),
        "universal": arms.universal_motions("x"),
        "planar": arms.planar_motions("x"),
        "spherical": (ball("x"),),
    }[kind]
    bodies = (
        arms.body(1, 0, kind, *steps),
        arms.body(2, 1, "revolute", PLACED, rotation("q2")),
        arms.body(
            3,
            2,
            kind,
            Placement(),
            *(replace(s, name=f"y{k}") for k, s in enumerate(steps)),
        ),
    )
    mechanism = arms.tree(kind, *bodies, gravity=gravity, values=LENGTHS)
    assert rank(mechanism) == svd_rank(mechanism)


COUPLINGS: dict[str, Mapping[str, Mapping[str, str]]] = {
    "equal": {"q3": {"q1": "1"}},
    "opposite": {"q3": {"q1": "-1"}},
    "geared": {"q3": {"q1": "2"}},
    "fraction": {"q3": {"q1": "1/3"}},
    "decimal": {"q3": {"q1": "0.7"}},
    "parallelogram": {"q3": {"q2": "-1"}},
    "differential": {"q3": {"q1": "1", "q2": "-1/2"}, "q4": {"q1": "1", "q2": "1/2"}},
    "rack": {"x": {"q2": "0.05"}},
    "spindle": {"q1": {"x": "20"}},
    "frozen": {"q3": {}},
}


@pytest.mark.parametrize("name", COUPLINGS)
def test_couplings_against_projected_regressor(name: str) -> None:
    """With q = T θ the regressor is Tᵀ X(T θ), and it cannot show more than X."""
    free = coupled_arm({})
    arm = coupled_arm(COUPLINGS[name])
    map_ = np.array(
        [[ratio(arm, q, k) for k in arm.velocities] for q in free.velocities]
    )
    states = random_states(arm, 60)
    projected = np.einsum(
        "ij,sik->sjk", map_, float_regressor(free, *(x @ map_.T for x in states))
    )
    np.testing.assert_allclose(
        float_regressor(arm, *states), projected, rtol=1e-11, atol=1e-11
    )
    assert rank(arm) == singular_value_rank(projected) <= rank(free)


def coupled_arm(couplings: Mapping[str, Mapping[str, str]]) -> Mechanism:
    """Four revolute joints, the second and third parallel, with a slider at the end, some of them coupled."""
    poses = (
        arms.place(),
        arms.place("a 0 c", "pi/2 0 0"),
        arms.place("a b 0"),
        arms.place("a 0 c", "pi/2 0 0"),
    )
    turns = [
        arms.body(k, k - 1, "revolute", placed, rotation(f"q{k}"))
        for k, placed in enumerate(poses, start=1)
    ]
    slide = arms.body(5, 4, "prismatic", poses[1], translation("x"))
    return arms.tree("coupled", *turns, slide, couplings=couplings, values=LENGTHS)


def ratio(arm: Mechanism, coordinate: str, leader: str) -> float:
    if coordinate not in arm.dependent:
        return float(coordinate == leader)
    (terms,) = (c.terms for c in arm.couplings if c.coordinate == coordinate)
    return sum(f.floats(0, {})[1] for name, f in terms if name == leader)


@examples(30)
@given(mechanisms(3))
def test_random_mechanisms_against_singular_values(mechanism: Mechanism) -> None:
    if mechanism.velocities and mechanism.parameters:
        assert rank(mechanism) == svd_rank(mechanism)


def test_gimbal_is_a_universal_joint() -> None:
    """Two revolute joints with a massless ring between them see what one universal joint sees."""
    ring = arms.body(1, 0, "revolute", rotation("q1", 0), massless=True)
    gimbal = arms.tree("gimbal", ring, arms.body(2, 1, "revolute", rotation("q2", 1)))
    universal = arms.tree(
        "universal", arms.body(2, 0, "universal", *arms.universal_motions("q"))
    )
    assert gimbal.parameters == universal.parameters
    assert ec.base_structure(gimbal).pivots == ec.base_structure(universal).pivots


def test_massless_body_has_no_parameters() -> None:
    arm = arms.modified_dh(
        "puma",
        *PUMA,
        values={"a2": "0.4", "a3": "0.1", "d3": "0.2", "d4": "0.5", "g": "9.81"},
    )
    bodies = (
        replace(b, carried=() if i in (2, 4) else b.carried)
        for i, b in enumerate(arm.bodies)
    )
    arm = replace(arm, bodies=tuple(bodies))
    assert len(arm.parameters) == 40
    assert rank(arm) == svd_rank(arm)


def test_robot_without_freedom() -> None:
    still = arms.tree("still", arms.body(1, 0, "fixed", arms.place("a b c")))
    base = ec.base_parameters(still)
    assert (base.rank, len(base.parameters)) == (0, 10)
    assert {kind.value for kind in base.classification.values()} == {"unidentifiable"}


def test_robot_without_bodies() -> None:
    base = ec.base_parameters(arms.tree("nothing"))
    assert (base.rank, base.parameters) == (0, ())


def test_joint_names_cannot_clash_with_our_own() -> None:
    bodies = (
        arms.body(1, 0, "floating", *floating_motions("free_")),
        arms.body(2, 1, "floating", arms.place("a b c"), *floating_motions("free")),
    )
    assert rank(arms.tree("two free bodies", *bodies)) == 20
