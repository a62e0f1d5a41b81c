"""Mechanisms built in code, from tables as textbooks print them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from echelon.algebra.exact.expressions import parse, parse_angle
from echelon.robot.coupling import Coupling, linear
from echelon.robot.joint import (
    ALL,
    GROUND,
    Body,
    Joint,
    Motion,
    Placement,
    Step,
    Symbol,
    Vector,
    X,
    Y,
    Z,
    ball,
    floating_motions,
    merge,
    planar_motions,
    rotation,
    screw,
    shift,
    translation,
    turn,
)
from echelon.robot.mechanism import Mechanism

DOWN = "0 0 -g"
GENERIC = "gx gy gz"


def cylindrical_motions(name: str, axis: int = Z) -> tuple[Motion, ...]:
    """Independent translation along and rotation about one axis."""
    return (translation(f"{name}.slide", axis), rotation(f"{name}.turn", axis))


def universal_motions(name: str, first: int = X, second: int = Y) -> tuple[Motion, ...]:
    """Two rotations about intersecting perpendicular axes; the first is fixed in the parent."""
    return (rotation(f"{name}.1", first), rotation(f"{name}.2", second))


def vector(text: str | None) -> Vector | None:
    """Three expressions separated by blanks."""
    if text is None:
        return None
    x, y, z = map(parse, text.split())
    return x, y, z


def known(values: Mapping[str, str]) -> dict[str, Symbol]:
    """Symbols with exact values."""
    return {
        name: Symbol(name, float(parse(text).number or 0), text)
        for name, text in values.items()
    }


def place(xyz: str = "0 0 0", rpy: str = "0 0 0") -> Placement:
    """Translation, then turns about z, y and x, as in URDF; angles in units of exact expressions (pi/2, beta)."""
    x, y, z = map(parse, xyz.split())
    roll, pitch, yaw = map(parse_angle, rpy.split())
    return shift(x, y, z) @ turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def body(
    number: int, parent: int, kind: str, *steps: Step, massless: bool = False
) -> Body:
    """Body number 1, 2, … on the body of number ``parent`` (0 is the ground)."""
    joint = Joint(f"j{number}", kind, merge(steps))
    return Body(
        f"link{number}",
        str(number),
        parent - 1 if parent else GROUND,
        joint,
        () if massless else ALL,
    )


def tree(
    name: str,
    *bodies: Body,
    gravity: str | None = DOWN,
    couplings: Mapping[str, Mapping[str, str]] | None = None,
    values: Mapping[str, str] | None = None,
) -> Mechanism:
    """A mechanism; couplings are given as ``{"q3": {"q1": "2"}}``."""
    tied = tuple(
        Coupling(q, tuple((k, linear(parse(r))) for k, r in terms.items()))
        for q, terms in (couplings or {}).items()
    )
    return Mechanism(name, bodies, vector(gravity), tied, known(values or {}))


def modified_dh(
    name: str,
    *rows: str,
    gravity: str | None = DOWN,
    values: Mapping[str, str] | None = None,
) -> Mechanism:
    """A serial arm; a row is ``R alpha a d`` or ``P alpha a d`` (Khalil–Kleinfinger, Craig)."""
    bodies = []
    for i, row in enumerate(rows, start=1):
        kind, alpha, a, d = row.split()
        placed = (
            turn(0, parse_angle(alpha))
            if a == "0"
            else shift(parse(a), 0, 0) @ turn(0, parse_angle(alpha))
        )
        motion = {"R": rotation, "P": translation}[kind](f"q{i}")
        bodies.append(
            body(
                i,
                i - 1,
                {"R": "revolute", "P": "prismatic"}[kind],
                placed,
                shift(0, 0, parse(d)),
                motion,
            )
        )
    return tree(name, *bodies, gravity=gravity, values=values)


# -- arms of the literature -------------------------------------------------------------------------------------------


def double_pendulum(gravity: str | None = "0 -g 0") -> Mechanism:
    return modified_dh(
        "double pendulum",
        "R 0 0 0",
        "R 0 l1 0",
        gravity=gravity,
        values={"l1": "0.5", "g": "9.81"},
    )


def rx90() -> Mechanism:
    rows = (
        "R 0 0 0",
        "R pi/2 0 0",
        "R 0 D3 0",
        "R -pi/2 0 RL4",
        "R pi/2 0 0",
        "R -pi/2 0 0",
    )
    return modified_dh("rx90", *rows, values={"D3": "0.45", "RL4": "0.45", "g": "9.81"})


def puma560(gravity: str | None = DOWN) -> Mechanism:
    rows = (
        "R 0 0 0",
        "R -pi/2 0 0",
        "R 0 a2 d3",
        "R -pi/2 a3 d4",
        "R pi/2 0 0",
        "R -pi/2 0 0",
    )
    values = {
        "a2": "0.4318",
        "a3": "0.0203",
        "d3": "0.15005",
        "d4": "0.4318",
        "g": "9.81",
    }
    return modified_dh("puma560", *rows, gravity=gravity, values=values)


def stanford() -> Mechanism:
    return modified_dh(
        "stanford",
        "R 0 0 0",
        "R -pi/2 0 d2",
        "P pi/2 0 0",
        "R 0 0 0",
        "R -pi/2 0 0",
        "R pi/2 0 0",
    )


PANDA = {"d1": "0.333", "d3": "0.316", "d5": "0.384", "a4": "0.0825", "a7": "0.088"}


def panda(
    gravity: str | None = "0 0 -9.81", lengths: Sequence[str] = tuple(PANDA)
) -> Mechanism:
    """The Franka Panda arm, with symbols or numbers in place of its five lengths."""
    d1, d3, d5, a4, a7 = lengths
    values = {s: PANDA[s] for s in lengths if s in PANDA}
    rows = (
        f"R 0 0 {d1}",
        "R -pi/2 0 0",
        f"R pi/2 0 {d3}",
        f"R pi/2 {a4} 0",
        f"R -pi/2 -{a4} {d5}",
        "R pi/2 0 0",
    )
    return modified_dh("panda", *rows, f"R pi/2 {a7} 0", gravity=gravity, values=values)


def planar(joints: int, gravity: str | None = "0 -g 0") -> Mechanism:
    return modified_dh(
        "planar",
        *(f"R 0 {f'l{i}' if i else 0} 0" for i in range(joints)),
        gravity=gravity,
    )


def general_arm(joints: int, gravity: str | None = "0 0 -9.81") -> Mechanism:
    """Revolute joints with a general twist and offset between any two."""
    rows = [f"R alpha{i} a{i} d{i}" for i in range(1, joints)]
    values = {
        s: v
        for i in range(1, joints)
        for s, v in ((f"alpha{i}", "0.7"), (f"a{i}", "0.2"), (f"d{i}", "0.3"))
    }
    return modified_dh("general arm", "R 0 0 0", *rows, gravity=gravity, values=values)


# -- other joints and couplings ---------------------------------------------------------------------------------------

X_DOWN = place(rpy="0 pi/2 0")
"""The z axis of the placed frame is horizontal."""


def cart_pole() -> Mechanism:
    cart = body(1, 0, "prismatic", translation("x", 0))
    return tree(
        "cart-pole",
        cart,
        body(2, 1, "revolute", place(rpy="pi/2 0 0"), rotation("angle")),
    )


def furuta() -> Mechanism:
    return modified_dh("furuta", "R 0 0 0", "R pi/2 l1 0")


def cylindrical_robot() -> Mechanism:
    return modified_dh("cylindrical robot", "R 0 0 0", "P 0 0 0", "P pi/2 0 0")


def cartesian() -> Mechanism:
    return modified_dh("cartesian", "P 0 0 0", "P pi/2 0 0", "P pi/2 0 0")


def spherical(gravity: str | None = DOWN) -> Mechanism:
    return tree("spherical", body(1, 0, "ball", ball("q")), gravity=gravity)


def floating_pair(gravity: str | None = DOWN) -> Mechanism:
    child = body(2, 1, "revolute", place("px py pz", "0 pi/3 pi/4"), rotation("q2"))
    values = {"px": "0.1", "py": "-0.2", "pz": "0.3", "g": "9.81"}
    return tree(
        "floating pair",
        body(1, 0, "floating", *floating_motions("base")),
        child,
        gravity=gravity,
        values=values,
    )


def helical() -> Mechanism:
    first = body(1, 0, "helical", X_DOWN, screw("q1", parse("h1")))
    return tree(
        "helical",
        first,
        body(2, 1, "helical", place("a 0 b", "pi/2 0 0"), screw("q2", parse("h2"))),
    )


def universal() -> Mechanism:
    first = body(1, 0, "universal", X_DOWN, *universal_motions("q1"))
    return tree(
        "universal",
        first,
        body(2, 1, "universal", place("a b c"), *universal_motions("q2")),
    )


def cylindrical() -> Mechanism:
    first = body(1, 0, "cylindrical", X_DOWN, *cylindrical_motions("q1"))
    return tree(
        "cylindrical",
        first,
        body(2, 1, "planar", place("a b 0", "pi/2 0 0"), *planar_motions("q2")),
    )


def prismatic() -> Mechanism:
    return modified_dh(
        "prismatic", "P pi/2 0 0", "R pi/2 a2 0", "P pi/4 a3 d3", "R -pi/2 0 0"
    )


def coupled() -> Mechanism:
    """Three joints of which the last follows the first two; ratio k is a symbol."""
    bodies = modified_dh("", "R pi/2 0 0", "R 0 l1 0", "R 0 l2 0").bodies
    return tree("coupled", *bodies, couplings={"q3": {"q1": "1", "q2": "-2"}})


def rack() -> Mechanism:
    """A slider that a rotation drives, with the radius of the pinion as a symbol."""
    pinion = body(1, 0, "revolute", place(rpy="pi/2 0 0"), rotation("q1"))
    return tree(
        "rack",
        pinion,
        body(2, 1, "prismatic", place("a 0 0"), translation("x", 0)),
        couplings={"x": {"q1": "r"}},
    )


def massless() -> Mechanism:
    """A gimbal: two axes that do not meet, of which only the last carries a body."""
    first = body(1, 0, "revolute", X_DOWN, rotation("q1"), massless=True)
    second = body(
        2, 1, "revolute", place("a 0 0", "pi/2 0 0"), rotation("q2"), massless=True
    )
    return tree(
        "massless",
        first,
        second,
        body(3, 2, "revolute", place("b 0 c", "pi/2 0 0"), rotation("q3")),
    )


def branched() -> Mechanism:
    left = body(2, 1, "revolute", place("a b 0", "pi/2 0 0"), rotation("q2"))
    right = body(3, 1, "revolute", place("a -b 0", "0 pi/2 0"), rotation("q3"))
    return tree(
        "branched",
        body(1, 0, "revolute", place(), rotation("q1")),
        left,
        right,
        gravity=GENERIC,
    )


def inclined() -> Mechanism:
    """An axis in a general direction of both bodies: the classical order brings true quotients."""
    aim = turn(2, parse_angle("azimuth")) @ turn(1, parse_angle("inclination"))
    second = body(2, 1, "revolute", place("a 0 b"), aim, rotation("q2"), aim.inverse())
    return tree("inclined", body(1, 0, "revolute", rotation("q1")), second)


def slanted() -> Mechanism:
    """Mounts at 45°, 30° and 15°: coefficients in Q(√2, √3)."""
    return modified_dh(
        "slanted", "R pi/4 0 0", "R pi/6 l2 0", "R pi/4 l3 d3", "P pi/12 a4 0"
    )


def rigid() -> Mechanism:
    """A body that cannot move: nothing is identifiable."""
    return tree("rigid", body(1, 0, "fixed", place("a 0 0")))


def free_body() -> Mechanism:
    """A body that moves all ways: everything is identifiable."""
    return tree("free body", body(1, 0, "floating", *floating_motions("base")))


KINDS = (
    helical,
    universal,
    cylindrical,
    coupled,
    rack,
    massless,
    floating_pair,
    inclined,
    slanted,
    rigid,
)
"""Builders of small robots of which each has something that the others do not."""
