"""Faults of inertias, and whether torques can show them: against bodies that exist, and proofs that none does."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.robot.inertia import from_pseudo_inertia, pseudo_inertia
from robot_zoo.faults import MISSING, POINT, can_exist, faults, problem_of

SHAPE = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'


def inertial(
    mass: float = 1,
    xx: float = 0.02,
    yy: float = 0.02,
    zz: float = 0.02,
    com: str = "0.1 0 0",
) -> str:
    tensor = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/>'
    return f'<inertial><origin xyz="{com}"/><mass value="{mass}"/>{tensor}</inertial>'


def arm(base: str = "", first: str = "", second: str = "", tool: str = "") -> str:
    """Two links about parallel vertical axes, so that gravity does not move them, with a tool fixed to the second."""
    links = zip(
        ("base", "first", "second", "tool"), (base, first, second, tool), strict=True
    )
    joints = [
        ("a", "base", "first", "continuous", "0 0 0"),
        ("b", "first", "second", "continuous", "0.4 0 0"),
    ]
    joints += [("c", "second", "tool", "fixed", "0.3 0 0")]
    return (
        '<robot name="arm">'
        + "".join(f'<link name="{name}">{content}</link>' for name, content in links)
        + "".join(
            f'<joint name="{n}" type="{kind}"><parent link="{p}"/><child link="{c}"/><origin xyz="{xyz}"/>'
            '<axis xyz="0 0 1"/></joint>'
            for n, p, c, kind, xyz in joints
        )
        + "</robot>"
    )


def found(text: str) -> dict[str, tuple[str, bool | None]]:
    return {
        fault.link: (fault.problem, fault.matters)
        for fault in faults(ec.base_parameters(ec.load(text)))
    }


def test_a_sound_robot_has_none() -> None:
    assert found(arm(inertial(), inertial(), inertial(), inertial())) == {}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (inertial(xx=0.001, yy=0.001, zz=0.02), "triangle inequality by 90 %"),
        (inertial(xx=-0.001), "principal moment of inertia is negative"),
        (inertial(mass=-1), "mass is negative"),
        (inertial(mass=0), "no mass"),
        (inertial(xx=0, yy=0, zz=0), "a point"),
        (inertial(xx=100, yy=100, zz=100), "placeholder"),
    ],
)
def test_each_fault_is_named(content: str, words: str) -> None:
    problem, _ = found(arm(inertial(), inertial(), inertial(), content))["tool"]
    assert words in problem


def test_no_torque_shows_what_it_does_not_contain() -> None:
    """About vertical axes only ZZ matters, so XX and YY can always be large enough."""
    broken = inertial(xx=0.001, yy=0.001, zz=0.02)
    assert found(arm(broken, broken, broken, inertial())) == {
        "base": (found(arm(broken))["base"][0], False),
        "first": (found(arm(first=broken))["first"][0], False),
        "second": (found(arm(first=broken))["first"][0], False),
    }


def test_a_negative_moment_about_the_axis_matters() -> None:
    """ZZ of the last link about its joint is seen alone, and no body has a negative one."""
    assert found(arm(second=inertial(zz=-1)))["second"][1] is True


def test_a_tool_can_be_made_up_for_by_what_carries_it() -> None:
    assert (
        found(arm(second=inertial(mass=5, xx=1, yy=1, zz=1), tool=inertial(zz=-0.001)))[
            "tool"
        ][1]
        is False
    )


def test_a_missing_inertia_matters_where_it_would_be_felt() -> None:
    """A shape beside a link with inertia is decoration, and what never moves is felt nowhere."""
    assert found(arm(SHAPE, inertial(), SHAPE, SHAPE)) == {"second": (MISSING, True)}
    assert found(arm(SHAPE, inertial(), inertial(), SHAPE)) == {}


def test_a_point_lacks_its_rotational_inertia() -> None:
    point = inertial(xx=0, yy=0, zz=0)
    assert found(arm(point, point, inertial())) == {
        "base": (POINT, False),
        "first": (POINT, True),
    }
    assert (
        found(arm(second=inertial(), tool=inertial(mass=1e-9, xx=0, yy=0, zz=0))) == {}
    )


def test_problems_are_those_of_the_body_not_of_its_place() -> None:
    """A sound body far from its frame's origin stays sound."""
    ball = ec.convert([2, 3, -4, 5, 0.01, 0, 0, 0.01, 0, 0.01], "urdf", "echelon")
    assert problem_of(ball, 10.0) == ""


@pytest.mark.parametrize("seed", range(20))
def test_bodies_that_exist_are_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root, free = rng.normal(size=(4, 4)), rng.normal(size=(rng.integers(1, 6), 10))
    body = from_pseudo_inertia(root @ root.T)
    assert can_exist(body + 3 * rng.normal(size=len(free)) @ free, free)


@pytest.mark.parametrize("seed", range(20))
def test_bodies_that_cannot_exist_are_refuted(seed: int) -> None:
    """A matrix P ⪰ 0 with tr(P J) < 0, the same for all that is free, is a proof."""
    rng = np.random.default_rng(seed)
    root, free = rng.normal(size=(4, 4)), rng.normal(size=(rng.integers(1, 6), 10))
    proof = np.einsum("ij,kij->k", root @ root.T, pseudo_inertia(np.eye(10)))
    free -= np.outer(free @ proof, proof) / (proof @ proof)
    body = rng.normal(size=10)
    body -= proof * (body @ proof + 1) / (proof @ proof)
    assert not can_exist(body, free)
