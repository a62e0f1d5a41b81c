"""Random mechanisms for properties that hold for all of them."""

from __future__ import annotations

from collections.abc import Callable

from hypothesis import strategies as st

from echelon.algebra.exact.polynomial import Polynomial
from echelon.robot.joint import (
    Body,
    Motion,
    ball,
    floating_motions,
    planar_motions,
    rotation,
    screw,
    translation,
)
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms

VALUES = {"a": "0.3", "b": "-0.45", "c": "0.2", "h": "0.05", "g": "9.81"}
"""Lengths, pitch and gravity of the mechanisms of this file."""

MOTIONS: dict[str, Callable[[str, int, int], tuple[Motion, ...]]] = {
    "revolute": lambda name, axis, sign: (rotation(name, axis, sign),),
    "prismatic": lambda name, axis, sign: (translation(name, axis, sign),),
    "helical": lambda name, axis, sign: (
        screw(name, Polynomial.generator("h"), axis, sign),
    ),
    "cylindrical": lambda name, axis, _: arms.cylindrical_motions(name, axis),
    "universal": lambda name, axis, _: arms.universal_motions(
        name, axis, (axis + 1) % 3
    ),
    "spherical": lambda name, _, __: (ball(name),),
    "planar": lambda name, axis, _: planar_motions(name, axis),
    "floating": lambda name, _, __: floating_motions(name),
}
"""Motions of every joint type by coordinate name, axis and sign."""

_TURNS = st.sampled_from(["0", "pi/2", "-pi/4", "pi/6", "2*pi/3"])


@st.composite
def _bodies(draw: st.DrawFn, number: int) -> Body:
    kind = draw(st.sampled_from(sorted(MOTIONS)))
    motions = MOTIONS[kind](
        f"q{number}", draw(st.integers(0, 2)), draw(st.sampled_from([1, -1]))
    )
    xyz = draw(st.sampled_from(["0 0 0", "a 0 0", "0 b c", "a -b c"]))
    placed = arms.place(xyz, f"{draw(_TURNS)} {draw(_TURNS)} {draw(_TURNS)}")
    massless = draw(st.integers(0, 4)) == 0
    return arms.body(
        number,
        draw(st.integers(0, number - 1)),
        kind,
        placed,
        *motions,
        massless=massless,
    )


@st.composite
def mechanisms(draw: st.DrawFn, most: int = 4) -> Mechanism:
    """Trees and forests with joints of all types, some bodies massless, and one coordinate that may follow others."""
    bodies = [
        draw(_bodies(number)) for number in range(1, 1 + draw(st.integers(1, most)))
    ]
    single = [
        m.name for body in bodies for m in body.joint.motions if len(m.positions) == 1
    ]
    couplings = {}
    if len(single) > 2 and draw(st.booleans()):
        follower, *leaders = draw(st.permutations(single))[:3]
        couplings = {follower: dict(zip(leaders, ("-2", "1/3"), strict=True))}
    gravity = draw(st.sampled_from([arms.DOWN, "1 -2 -9", None]))
    return arms.tree(
        "random", *bodies, gravity=gravity, couplings=couplings, values=VALUES
    )
