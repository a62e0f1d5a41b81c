"""Mechanisms with loops, built in code: chains that every kind of closure closes, and textbook linkages."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache

from echelon.algebra.exact.expressions import parse
from echelon.robot.closure import Closure, ClosureKind
from echelon.robot.joint import (
    GROUND,
    Body,
    Placement,
    ball,
    rotation,
    screw,
    shift,
    translation,
)
from echelon.robot.mechanism import Mechanism
from support import textbook_arms as arms

LENGTHS = {"a": "0.3", "b": "-0.45", "c": "0.2", "h": "0.05", "g": "9.81"}
FOUR_BAR = {"l1": "0.4", "l2": "0.15", "l3": "0.35", "l4": "0.3", "g": "9.81"}


def at_zero(bodies: Sequence[Body], index: int) -> Placement:
    """A body's frame in the world while all coordinates are zero."""
    pose = Placement()
    while index != GROUND:
        here = Placement()
        for step in bodies[index].joint.steps:
            here = here @ step if isinstance(step, Placement) else here
        pose, index = here @ pose, bodies[index].parent
    return pose


def closing(
    bodies: Sequence[Body], kind: ClosureKind, first: int, second: int, frame: Placement
) -> Closure:
    """A closure that is closed while all coordinates are zero."""
    other = at_zero(bodies, second).inverse() @ at_zero(bodies, first) @ frame
    return Closure(f"{kind.value} loop", kind, first, second, frame, other)


@cache
def closed_chain(
    kind: ClosureKind, branched: bool = False, coupled: bool = False
) -> Mechanism:
    """A chain of seven freedoms whose end is closed against the ground, or against another body on its first one."""
    bodies = [
        arms.body(1, 0, "revolute", arms.place("0 b 0", "pi/6 0 0"), rotation("q1")),
        arms.body(
            2, 1, "prismatic", arms.place("a 0 c", "0 pi/4 0"), translation("q2", 0, -1)
        ),
        arms.body(3, 2, "spherical", arms.place("a b 0", "0 0 pi/3"), ball("q3")),
        arms.body(
            4, 3, "revolute", arms.place("c a -b", "pi/4 pi/6 0"), rotation("q4", 1, -1)
        ),
        arms.body(
            5,
            4,
            "helical",
            arms.place("a 0 c", "0 -pi/3 pi/4"),
            screw("q5", parse("h"), 0),
        ),
    ]
    if branched:
        bodies.append(
            arms.body(
                6, 1, "revolute", arms.place("0 a c", "0 pi/4 pi/3"), rotation("q6")
            )
        )
    closure = closing(
        bodies,
        kind,
        4,
        5 if branched else GROUND,
        arms.place("c b a", "pi/6 pi/3 pi/4"),
    )
    couplings = {"q2": {"q1": "1/2"}} if coupled else {}
    name = " ".join((kind.value, *["branched"] * branched, *["coupled"] * coupled))
    tree = arms.tree(
        name, *bodies, gravity="1 -2 -g", values=LENGTHS, couplings=couplings
    )
    freedoms = len(tree.velocities) - 6 + kind.freedoms
    return replace(tree, closures=(closure,), independent=tree.velocities[:freedoms])


def everything() -> Iterator[Mechanism]:
    """All mechanisms of this file."""
    for kind in ClosureKind:
        yield closed_chain(kind)
        yield closed_chain(kind, branched=True)
        if kind.freedoms:  # the coupled chain that a weld closes cannot move
            yield closed_chain(kind, coupled=True)
    yield from (four_bar(), slider_crank(), rssr())


def four_bar(independent: str = "crank") -> Mechanism:
    """A planar crank-rocker with revolute joints: three of its constraints in space are redundant."""
    bodies = (
        arms.body(1, 0, "revolute", rotation("crank")),
        arms.body(2, 1, "revolute", shift(parse("l2"), 0, 0), rotation("coupler")),
        arms.body(3, 0, "revolute", shift(parse("l1"), 0, 0), rotation("rocker")),
    )
    ends = shift(parse("l3"), 0, 0), shift(parse("l4"), 0, 0)
    pin = Closure("pin", ClosureKind.REVOLUTE, 1, 2, *ends)
    pose = {"crank": 1.0, "coupler": -0.4816, "rocker": 1.6206}
    tree = arms.tree("four-bar", *bodies, gravity="0 -g 0", values=FOUR_BAR)
    return replace(tree, closures=(pin,), independent=(independent,), assembly=pose)


def slider_crank() -> Mechanism:
    """A crank of length r, a rod of length l whose end slides on the x axis, and a piston."""
    bodies = (
        arms.body(1, 0, "revolute", rotation("crank")),
        arms.body(2, 1, "revolute", shift(parse("r"), 0, 0), rotation("rod")),
        arms.body(3, 0, "prismatic", translation("piston", 0)),
    )
    pin = Closure(
        "pin", ClosureKind.REVOLUTE, 1, 2, shift(parse("l"), 0, 0), Placement()
    )
    tree = arms.tree(
        "slider-crank", *bodies, gravity=None, values={"r": "0.2", "l": "0.5"}
    )
    return replace(
        tree, closures=(pin,), independent=("crank",), assembly={"piston": 0.7}
    )


def rssr() -> Mechanism:
    """Two cranks on skew axes, joined by a rod with a ball at each end, which can spin."""
    bodies = (
        arms.body(1, 0, "revolute", rotation("q1")),
        arms.body(2, 1, "spherical", arms.place("c 0 0"), ball("rod")),
        arms.body(3, 0, "revolute", arms.place("a b 0", "pi/2 0 pi/6"), rotation("q2")),
    )
    joined = closing(bodies, ClosureKind.SPHERICAL, 1, 2, arms.place("a -b c"))
    tree = arms.tree("rssr", *bodies, gravity="1 -2 -g", values=LENGTHS)
    return replace(tree, closures=(joined,), independent=("q1", "rod.x"))
