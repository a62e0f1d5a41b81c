"""Spherical linkages, and spatial ones that move although counting says that they cannot."""

from __future__ import annotations

from flint import arb

from support.rounded_exports.geometry import (
    Vec,
    X,
    Y,
    Z,
    about,
    cross,
    degrees,
    exactly,
    half_turned,
    rotation,
    vec,
)
from support.rounded_exports.mechanism import GROUND, Draft

CENTER = vec(0, 0, 0)


def spherical_four_bar(d: Draft) -> None:
    d.hinge("crank", GROUND, CENTER, Z)
    d.hinge("coupler", "crank", CENTER, vec(0.5, 0.2, 0.8))
    d.hinge("rocker", GROUND, CENTER, vec(0.9, -0.3, 0.4))
    d.pin("coupler", "rocker", CENTER, vec(0.6, 0.7, 0.3))


def cardan(d: Draft) -> None:
    """Two shafts and a cross whose axes are perpendicular to each other and to the shafts."""
    shaft2 = about(Y, 25, X)
    d.hinge("shaft", GROUND, CENTER, X)
    d.hinge("cross", "shaft", CENTER, Y)
    d.hinge("shaft2", "cross", CENTER, cross(Y, shaft2))
    d.pin("shaft2", GROUND, CENTER + shaft2 * exactly(0.3), shaft2)


def agile_eye(d: Draft) -> None:
    """A camera on three spherical legs with right angles."""
    turn = rotation(vec(1, 2, -1), degrees(20))
    tips = [turn @ v for v in (Y, Z, X)]
    for k, (foot, tip) in enumerate(zip((X, Y, Z), tips, strict=True)):
        d.hinge(f"arm{k}", GROUND, CENTER, foot)
        # the axis across the foot's and the platform's
        d.hinge(f"fore{k}", f"arm{k}", CENTER, cross(foot, tip))
    d.hinge("platform", "fore0", CENTER, tips[0])
    d.pin("platform", "fore1", CENTER, tips[1])
    d.pin("platform", "fore2", CENTER, tips[2])


def spherical_3rrr(d: Draft) -> None:
    """Three spherical legs with general angles."""
    feet, mid = (
        ((1, 0.1, 0), (-0.2, 1, 0.3), (0, -0.3, 1)),
        ((0.7, -0.6, 0.2), (0.4, 0.6, -0.7), (-0.8, 0.1, 0.6)),
    )
    tips = ((0.3, 0.1, 0.9), (0.9, 0.4, -0.1), (-0.1, 0.9, 0.2))
    for k in range(3):
        d.hinge(f"arm{k}", GROUND, CENTER, vec(*feet[k]))
        d.hinge(f"fore{k}", f"arm{k}", CENTER, vec(*mid[k]))
    d.hinge("platform", "fore0", CENTER, vec(*tips[0]))
    d.pin("platform", "fore1", CENTER, vec(*tips[1]))
    d.pin("platform", "fore2", CENTER, vec(*tips[2]))


def ring(d: Draft, lines: list[tuple[Vec, Vec]], name: str = "link") -> None:
    """One loop of hinges about lines, each a point and an axis; the ground is between the last and the first."""
    parent = GROUND
    for k, (point, axis) in enumerate(lines[:-1]):
        parent = d.hinge(f"{name}{k}", parent, point, axis)
    d.pin(parent, GROUND, *lines[-1])


def sarrus(d: Draft) -> None:
    """Two planes of three parallel hinges lift a plate along a line."""
    points = [vec(0, 0, 0), vec(0.2, 0, 0.25), vec(0.1, 0, 0.5)]
    other = [vec(0.4, 0.3, 0.5), vec(0.4, 0.55, 0.3), vec(0.4, 0.4, 0)]
    ring(d, [*((p, Y) for p in points), *((p, X) for p in other)])


def sarrus_oblique(d: Draft) -> None:
    axis = vec(0.8, 0.6, 0)
    points = [vec(0, 0, 0), vec(0.2, 0, 0.25), vec(0.1, 0, 0.5)]
    other = [vec(0.4, 0.3, 0.5), vec(0.4, 0.55, 0.3), vec(0.4, 0.4, 0)]
    ring(d, [*((p, Y) for p in points), *((p, axis) for p in other)])


def dh_lines(rows: list[tuple[arb, arb, arb, arb]]) -> list[tuple[Vec, Vec]]:
    """The axes of hinges by rows theta, d, a, alpha: turn and shift along z, shift and turn along x."""
    point, x, z, lines = CENTER, X, Z, []
    for theta, d, a, alpha in rows:
        lines.append((point, z))
        x = rotation(z, theta) @ x
        point = point + z * d + x * a
        z = rotation(x, alpha) @ z
    return lines


def bennett_turns(alpha: arb, beta: arb, theta: arb) -> arb:
    """The other angle of a Bennett linkage with twists alpha and beta."""
    ratio = ((beta + alpha) / 2).sin() / ((beta - alpha) / 2).sin()
    return 2 * (ratio / (theta / 2).tan()).atan()


def bennett_rows(
    alpha: float, beta: float, a: float, theta: float
) -> list[tuple[arb, arb, arb, arb]]:
    """Opposite sides are equal, and lengths are as the sines of twists."""
    first, second, angle, zero = degrees(alpha), degrees(beta), degrees(theta), arb(0)
    b = exactly(a) * second.sin() / first.sin()
    other = bennett_turns(first, second, angle)
    rows = [(angle, zero, exactly(a), first), (other, zero, b, second)]
    return [*rows, (-angle, zero, exactly(a), first), (-other, zero, b, second)]


def bennett(d: Draft) -> None:
    ring(d, dh_lines(bennett_rows(40, 75, 0.3, 70)))


def goldberg(d: Draft) -> None:
    """Two Bennett linkages without the link they had in common: at its one end their neighbours are one body."""

    def from_common(beta: float, angle: float) -> list[tuple[Vec, Vec]]:
        back = rotation(Z, degrees(-angle))
        return [
            (back @ p, back @ axis)
            for p, axis in dh_lines(bennett_rows(40, beta, 0.3, angle))
        ]

    (_, joint, third, fourth), (_, _, third2, fourth2) = (
        from_common(75, 70),
        from_common(55, 100),
    )
    ring(d, [third, fourth, fourth2, third2, joint])


def threefold_bricard(d: Draft) -> None:
    """Six equal links with twists of plus and minus 90 degrees, symmetric about an axis."""
    angle, side, zero = degrees(75), exactly(0.2), arb(0)
    other = (-angle.cos() / (1 + angle.cos())).acos()
    pair = [(angle, zero, side, degrees(90)), (other, zero, side, degrees(-90))]
    ring(d, dh_lines(pair * 3))


def double_cardan(d: Draft) -> None:
    """Parallel shafts with a shaft between them, whose forks lie in one plane."""
    between = about(Y, 30, X)
    fork, far = cross(Y, between), between * exactly(0.4)
    d.hinge("shaft", GROUND, CENTER, X)
    d.hinge("cross", "shaft", CENTER, Y)
    d.hinge("between", "cross", CENTER, fork)
    d.hinge("cross2", "between", far, fork)
    d.hinge("shaft2", "cross2", far, Y)
    d.pin("shaft2", GROUND, far + X * exactly(0.2), X)


def line_symmetric_bricard(d: Draft) -> None:
    """Six hinges, of which three are the others turned half about a line, here z."""
    half = [
        (vec(0.3, 0.1, 0), vec(0.2, 1, 0.3)),
        (vec(0.25, 0.4, 0.2), vec(1, 0.3, -0.2)),
        (vec(0, 0.3, 0.4), vec(0.1, 0.4, 1)),
    ]
    ring(d, [*half, *((half_turned(p, Z), half_turned(a, Z)) for p, a in half)])


def plane_symmetric_bricard(d: Draft) -> None:
    """Six hinges: two in a plane, here y = 0, and two on either side that are mirror images."""

    def mirrored(line: tuple[Vec, Vec]) -> tuple[Vec, Vec]:
        (px, py, pz), (ax, ay, az) = line
        return vec(px, -py, pz), vec(ax, -ay, az)

    first, last = (vec(0, 0, 0), vec(0.3, 0, 1)), (vec(0.5, 0, 0.3), vec(1, 0, 0.4))
    one, two = (
        (vec(0.1, 0.3, 0.2), vec(0.6, 0.5, 0.3)),
        (vec(0.4, 0.35, 0.1), vec(-0.2, 0.8, 0.5)),
    )
    ring(d, [first, one, two, last, mirrored(two), mirrored(one)])


def four_bar_across(d: Draft) -> None:
    """A four-bar on the coupler of another one, in a plane across it."""
    ring(
        d,
        [
            (vec(0, 0, 0), Y),
            (vec(0.1, 0, 0.3), Y),
            (vec(0.4, 0, 0.35), Y),
            (vec(0.5, 0, 0.02), Y),
        ],
        "plane",
    )
    ring_on = [
        (vec(0.2, 0.1, 0.4), X),
        (vec(0.2, 0.25, 0.55), X),
        (vec(0.2, 0.5, 0.5), X),
        (vec(0.2, 0.45, 0.33), X),
    ]
    parent = "plane1"
    for k, (point, axis) in enumerate(ring_on[:-1]):
        parent = d.hinge(f"across{k}", parent, point, axis)
    d.pin(parent, "plane1", *ring_on[-1])


def double_wishbone(d: Draft) -> None:
    """Two wishbones on oblique axes, an upright between balls, and a tie rod to the rack."""
    d.hinge("lower", GROUND, vec(0.02, 0.2, 0.15), vec(1, 0.05, 0.02))
    d.ball("upright", "lower", vec(0.01, 0.65, 0.12))
    d.hinge("upper", GROUND, vec(-0.01, 0.25, 0.4), vec(1, -0.04, 0.03))
    d.meet("upper", "upright", vec(-0.02, 0.58, 0.42))
    d.slide("rack", GROUND, vec(-0.1, 0, 0.2), Y)
    start, end = vec(-0.1, 0.22, 0.2), vec(-0.12, 0.6, 0.19)
    d.rod("tie", "rack", start, end, Z)
    d.meet("tie", "upright", end)
    d.hinge("wheel", "upright", vec(0.01, 0.7, 0.28), vec(0.02, 1, -0.03))


def rssr(d: Draft) -> None:
    """A spatial four-bar of two cranks and a rod between balls."""
    start, end = vec(0.1, 0.2, 0.1), vec(0.5, 0.3, 0.45)
    d.hinge("crank", GROUND, vec(0, 0, 0), Z)
    d.rod("rod", "crank", start, end)
    d.hinge("rocker", GROUND, vec(0.6, 0.1, 0), vec(0.3, 1, 0.2))
    d.meet("rod", "rocker", end)


def rssr_spin(d: Draft) -> None:
    """A spatial four-bar whose rod spins freely about itself."""
    start, end = vec(0.1, 0.2, 0.1), vec(0.5, 0.3, 0.45)
    d.hinge("crank", GROUND, vec(0, 0, 0), Z)
    d.ball("rod", "crank", start)
    d.hinge("rocker", GROUND, vec(0.6, 0.1, 0), vec(0.3, 1, 0.2))
    d.meet("rod", "rocker", end)
