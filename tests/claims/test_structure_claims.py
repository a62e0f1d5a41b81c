"""Structure against one elimination of the whole virtual power form, where nothing is taken to be without influence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.algebra.exact.field import PrimeField, reduced_echelon
from echelon.algebra.exact.polynomial import Polynomial
from echelon.base import structure
from echelon.base.structure import find_structure
from echelon.dynamics import linear_forms
from echelon.dynamics.linear_forms import FEW_COLUMNS, virtual_power_form
from echelon.robot.effect import Side, ready_made
from echelon.robot.joint import (
    ALL,
    GROUND,
    MotionKind,
    ball,
    floating_motions,
    rotation,
    translation,
)
from echelon.robot.mechanism import Actuator, Cut, Force, Mechanism, Output
from support import textbook_arms as arms
from support.random_mechanisms import mechanisms
from support.selection import examples, one_in

KINDS = ("XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M")
ONE = Polynomial.constant(1)


def pivots_by_one_elimination(mechanism: Mechanism, seed: int = 5) -> list[int]:
    """Pivots of uᵀX at random states of one random geometry, all columns at once."""
    forms = virtual_power_form(mechanism)
    if not forms.rational:  # at real states
        return list(
            structure.linear_structure(forms, np.random.default_rng(seed)).pivots
        )
    sampler, rng = forms.sampler(), np.random.default_rng(seed)
    found: list[list[int]] = []
    for _ in range(2):
        field = PrimeField.random(rng)
        geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}
        values = sampler.evaluate(field, rng, forms.shape[1] + 8, geometry)
        found.append(reduced_echelon(forms.stacked(values)[0], field)[1])
    return max(found, key=len)


def agree(mechanism: Mechanism) -> None:
    """However few columns it takes for structure to be found block by block."""
    expected = pivots_by_one_elimination(mechanism)
    for few in (FEW_COLUMNS, -1):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(structure, "FEW_COLUMNS", few)
            patch.setattr(linear_forms, "FEW_COLUMNS", few)
            assert (
                list(find_structure(mechanism, np.random.default_rng(1)).pivots)
                == expected
            )


def carrying(mechanism: Mechanism, *carried: str) -> Mechanism:
    """Copy of a mechanism whose bodies carry the named parameters, ``*`` for all ten."""
    kinds = [
        ALL if text == "*" else tuple(map(KINDS.index, text.split()))
        for text in carried
    ]
    bodies = zip(mechanism.bodies, kinds, strict=True)
    return replace(
        mechanism, bodies=tuple(replace(body, carried=some) for body, some in bodies)
    )


# -- where a joint is mounted ---------------------------------------------------------------------------------------


def two_carts(first: str, second: str) -> Mechanism:
    """Two spinning carts, each with a free-turning body somewhere on it."""
    bodies = []
    for number, xyz in ((1, first), (3, second)):
        bodies.append(
            arms.body(number, 0, "floating", *floating_motions(f"base{number}"))
        )
        bodies.append(
            arms.body(
                number + 1, number, "spherical", arms.place(xyz), ball(f"s{number}")
            )
        )
    return arms.tree("two carts", *bodies, gravity=None)


@pytest.mark.parametrize(
    "mounts",
    [("0 0 0", "a 0 0"), ("a 0 0", "0 0 0"), ("a 0 0", "0 b 0"), ("0 0 0", "0 0 0")],
)
@pytest.mark.parametrize("parent", ["M", "MX M", "XX YY ZZ M", "MX MY MZ M", "*"])
@pytest.mark.parametrize("child", ["M", "*"])
def test_mount_on_a_parent_that_carries_some_parameters(
    mounts: tuple[str, str], parent: str, child: str
) -> None:
    agree(carrying(two_carts(*mounts), parent, child, parent, child))


@pytest.mark.parametrize("some", ["M", "MX MY MZ M", "ZZ", "XX YY ZZ", ""])
@pytest.mark.parametrize("others", one_in(2, ["*", "MX M"]))
@pytest.mark.parametrize("which", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_equal_joints_on_bodies_that_carry_different_parameters(
    some: str, others: str, which: int
) -> None:
    """One parent, or one child, carries something else than its twin."""
    first, second = [others, others], [others, others]
    second[which] = some
    for mechanism in (two_carts("0 0 0", "0 0 0"), two_carts("a 0 0", "a 0 0")):
        agree(carrying(mechanism, *first, *second))
        agree(carrying(mechanism, *second, *first))


def test_two_point_masses_of_which_one_is_offset() -> None:
    """Mass can move to the parent only where it hangs in the parent's own centre."""
    mechanism = carrying(two_carts("0 0 0", "a 0 0"), "M", "M", "M", "M")
    base = ec.base_parameters(mechanism)
    assert base.rank == 3
    assert [str(e) for e in base.expressions] == ["M1 + M2", "M3", "M4"]


@examples(10)
@given(mechanisms(4), st.data())
def test_random_trees_that_carry_some_parameters(
    mechanism: Mechanism, data: st.DataObject
) -> None:
    some = st.sampled_from([ALL, ALL, (9,), (6, 7, 8, 9), (5,), (0, 3, 5, 9), ()])
    agree(
        replace(
            mechanism,
            bodies=tuple(replace(b, carried=data.draw(some)) for b in mechanism.bodies),
        )
    )


# -- sensors, effects, massless bodies, couplings, ground, gravity ----------------------------------------------------


@st.composite
def sensed(draw: st.DrawFn) -> Mechanism:
    """A tree with some joint forces, and some components of wrenches at sensors anywhere."""
    mechanism = draw(mechanisms(4))
    outputs = [
        Force(name, Side.JOINT).output(f"joint {name}", "N·m")
        for name in mechanism.independent_velocities
        if draw(st.booleans())
    ]
    for k in range(draw(st.integers(0, 4))):
        body = draw(st.integers(GROUND, len(mechanism.bodies) - 1))
        frame = arms.place(draw(st.sampled_from(["0 0 0", "a 0 b"])), "0 pi/6 pi/4")
        cut = Cut(
            body,
            frame,
            draw(st.booleans()),
            draw(st.integers(0, 2)),
            draw(st.booleans()),
        )
        outputs.append(cut.output(f"sensor {k}", "N"))
    return replace(mechanism, measured=tuple(outputs))


@examples(10)
@given(sensed())
def test_random_trees_with_sensors(mechanism: Mechanism) -> None:
    agree(mechanism)


@pytest.mark.parametrize("on_parent", [True, False])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angular", [True, False])
def test_sensor_between_a_body_and_its_parent_sees_what_would_move(
    on_parent: bool, axis: int, angular: bool
) -> None:
    arm = arms.rx90()
    outputs = (
        *arm.outputs,
        Cut(3, arms.place("0 0 h"), on_parent, axis, angular).output("sensor", "N"),
    )
    sensing = replace(arm, measured=outputs)
    agree(sensing)
    if not angular or axis != 2:  # the moment about the joint's own axis is its torque
        assert find_structure(sensing, np.random.default_rng(1)).rank > 36


def test_sensor_in_a_weighted_sum_is_watched_too() -> None:
    arm = arms.rx90()
    cut = Cut(4, arms.place(), False, 2, False)
    total = Output(
        "sum", "N·m", forces=((Force("q1", Side.JOINT), ONE),), cuts=((cut, ONE),)
    )
    agree(replace(arm, measured=(total, *arm.outputs[1:])))


@st.composite
def affected(draw: st.DrawFn) -> Mechanism:
    """A tree with friction, springs and rotors in some joints, on either side of a transmission."""
    mechanism = draw(mechanisms(3))
    single = {m.name for m in mechanism.motions if m.kind is not MotionKind.BALL}
    free = [name for name in mechanism.velocities if name in single]
    actuators: tuple[Actuator, ...] = ()
    if len(free) > 1 and draw(st.booleans()):
        first, second = free[:2]
        rows = (
            ("A", ((first, ONE), (second, ONE))),
            ("B", ((first, ONE), (second, ONE * -1))),
        )
        actuators = tuple(Actuator(name, terms) for name, terms in rows)
    mechanism = replace(mechanism, actuators=actuators)
    drives = [
        a.name
        for a in mechanism.transmission.actuators
        if all(name in single for name, _ in a.terms)
    ]
    effects = []
    for k in range(draw(st.integers(1, 4))):
        side = draw(st.sampled_from([Side.JOINT, Side.ACTUATOR]))
        at = (
            draw(st.sampled_from(drives if side is Side.ACTUATOR else free))
            if free
            else None
        )
        if at is not None:
            kind = draw(
                st.sampled_from(
                    ["viscous", "coulomb", "offset", "rotor_inertia", "spring"]
                )
            )
            effects += ready_made(kind, at, side, f"_{k}", sliding=False)
    return replace(mechanism, effects=tuple(effects))


@examples(10)
@given(affected())
def test_random_trees_with_effects(mechanism: Mechanism) -> None:
    agree(mechanism)


@examples(10)
@given(mechanisms(5))
def test_random_trees_with_couplings_and_massless_bodies(mechanism: Mechanism) -> None:
    agree(mechanism)


def fingers(ratio: str) -> Mechanism:
    """A hand with two fingers that move together, on a wrist of which two bodies carry nothing."""
    wrist = [
        arms.body(1, 0, "floating", *floating_motions("base")),
        arms.body(
            2, 1, "revolute", arms.place("a 0 0"), rotation("w1", 0), massless=True
        ),
        arms.body(3, 2, "revolute", rotation("w2", 1), massless=True),
        arms.body(4, 3, "revolute", rotation("w3", 2)),
    ]
    slides = [
        arms.body(k, 4, "prismatic", arms.place("0 b c"), translation(f"f{k}", 1))
        for k in (5, 6)
    ]
    return arms.tree("hand", *wrist, *slides, couplings={"f6": {"f5": ratio}})


def shoulder_and_elbow() -> Mechanism:
    """A coupling across two joints, whose follower's symbols occur elsewhere too."""
    bodies = [
        arms.body(
            k, k - 1, "revolute", arms.place("a 0 b", "pi/2 0 0"), rotation(f"q{k}")
        )
        for k in range(1, 6)
    ]
    return arms.tree(
        "shoulder and elbow", *bodies, couplings={"q4": {"q1": "a", "q3": "1"}}
    )


def frozen() -> Mechanism:
    """A joint that a coupling holds still."""
    return replace(arms.tree("frozen", *arms.rx90().bodies, couplings={"q4": {}}))


def on_ground() -> Mechanism:
    """Bodies on the ground: one that cannot move, one that can, and two on those."""
    bodies = (
        arms.body(1, 0, "fixed", arms.place("a b c")),
        arms.body(2, 1, "revolute", arms.place("a 0 0", "pi/6 0 0"), rotation("q2")),
        arms.body(
            3, 0, "prismatic", arms.place("0 0 0", "pi/2 0 0"), translation("q3")
        ),
        arms.body(4, 3, "fixed", arms.place("0 b 0")),
    )
    return arms.tree("on ground", *bodies)


def long_arm() -> Mechanism:
    """Many equal joints, so that almost every one is settled on its own."""
    twists = ["0", *(["pi/2", "-pi/2", "pi/4"] * 4)]
    return arms.modified_dh(
        "long", *(f"R {twist} a{i} d{i}" for i, twist in enumerate(twists))
    )


CASES = [
    lambda: fingers("1"), lambda: fingers("-1"), lambda: fingers("k"), shoulder_and_elbow, frozen, on_ground, long_arm,
    arms.stanford, arms.massless, arms.rack, arms.coupled, arms.branched, arms.helical, arms.universal, arms.planar,
]  # fmt: skip


@pytest.mark.parametrize("make", CASES)
@pytest.mark.parametrize("gravity", one_in(2, [arms.DOWN, arms.GENERIC, None]))
def test_special_trees(make: Callable[..., Mechanism], gravity: str | None) -> None:
    mechanism = arms.planar(4) if make is arms.planar else make()
    agree(replace(mechanism, gravity=arms.vector(gravity)))


@pytest.mark.parametrize("make", CASES[:7])
def test_special_trees_with_friction(make: Callable[..., Mechanism]) -> None:
    mechanism = make()
    effects = [ready_made("viscous", name, Side.ACTUATOR, f"_{k}", sliding=False)
               for k, name in enumerate(mechanism.velocities) if "." not in name]  # fmt: skip
    agree(replace(mechanism, effects=tuple(e for some in effects for e in some)))
