"""Parallel robots: a platform on several legs."""

from __future__ import annotations

from support.rounded_exports.geometry import (
    Vec,
    X,
    Y,
    Z,
    about,
    cross,
    exactly,
    unit,
    vec,
)
from support.rounded_exports.mechanism import GROUND, Draft

ORIGIN = vec(0, 0, 0)


def delta_legs(d: Draft, angles: tuple[float, ...]) -> None:
    """Arms that turn about tangents, and two parallel rods each: the platform does not turn."""
    half = exactly(0.04)
    for k, angle in enumerate(angles):
        radial, tangent = about(Z, angle, X), about(Z, angle, Y)
        elbow = radial * exactly(0.36) + Z * exactly(-0.12)
        tip = radial * exactly(0.07) + Z * exactly(-0.62)
        d.hinge(f"arm{k}", GROUND, radial * exactly(0.15), tangent)
        for name, side in (("l", -half), ("r", half)):
            rod = d.rod(
                f"rod{k}{name}",
                f"arm{k}",
                elbow + tangent * side,
                tip + tangent * side,
                Z,
            )
            if k == 0 and name == "l":
                d.ball("platform", rod, tip + tangent * side)
            else:
                d.meet(rod, "platform", tip + tangent * side)


def delta(d: Draft) -> None:
    delta_legs(d, (0, 120, 240))


def delta_four(d: Draft) -> None:
    """Four legs for three freedoms."""
    delta_legs(d, (0, 90, 180, 270))


def four_legs_in_pairs(d: Draft) -> None:
    """Parallelograms of rods to two halves of a platform, which a bar connects by vertical hinges: it can turn, too."""
    half = exactly(0.04)
    for k, angle in enumerate((10, 80, 200, 310)):
        radial, tangent = about(Z, angle, X), about(Z, angle, Y)
        tip = radial * exactly(0.1) + Z * exactly(-0.62)
        elbow = radial * exactly(0.36) + Z * exactly(-0.12)
        d.hinge(f"arm{k}", GROUND, radial * exactly(0.15), tangent)
        for name, side in (("l", -half), ("r", half)):
            rod = d.rod(
                f"rod{k}{name}",
                f"arm{k}",
                elbow + tangent * side,
                tip + tangent * side,
                Z,
            )
            if k in (0, 2) and name == "l":
                d.ball(f"half{k // 2}", rod, tip + tangent * side)
            else:
                d.meet(rod, f"half{k // 2}", tip + tangent * side)
    d.hinge("bar", "half0", vec(0, 0.08, -0.62), Z)
    d.pin("bar", "half1", vec(0, -0.08, -0.62), Z)


def delta_pins(d: Draft) -> None:
    """Parallelograms with pins instead of balls, in the planes of their rods."""
    half = exactly(0.04)
    for k in range(3):
        radial, tangent = about(Z, 120 * k, X), about(Z, 120 * k, Y)
        elbow = radial * exactly(0.36) + Z * exactly(-0.12)
        tip = radial * exactly(0.07) + Z * exactly(-0.62)
        normal = cross(tangent, tip - elbow)
        arm = d.hinge(f"arm{k}", GROUND, radial * exactly(0.15), tangent)
        upper = d.hinge(f"upper{k}", arm, elbow, tangent)
        lower = ""
        for name, side in (("l", -half), ("r", half)):
            rod = d.hinge(f"rod{k}{name}", upper, elbow + tangent * side, normal)
            if lower:
                d.pin(rod, lower, tip + tangent * side, normal)
            else:
                lower = d.hinge(f"lower{k}", rod, tip + tangent * side, normal)
        if k == 0:
            d.hinge("platform", lower, tip, tangent)
        else:
            d.pin(lower, "platform", tip, tangent)


def orthoglide(d: Draft) -> None:
    """Three perpendicular slides with parallelograms of rods."""
    half = exactly(0.05)
    for k, (along, across) in enumerate(((X, Y), (Y, Z), (Z, X))):
        tip = along * exactly(0.06)
        start = along * exactly(0.5) + cross(along, across) * exactly(0.07)
        d.slide(f"cart{k}", GROUND, start, along)
        for name, side in (("l", -half), ("r", half)):
            rod = d.rod(
                f"rod{k}{name}",
                f"cart{k}",
                start + across * side,
                tip + across * side,
                vec(1, 1, 1),
            )
            if k == 0 and name == "l":
                d.ball("platform", rod, tip + across * side)
            else:
                d.meet(rod, "platform", tip + across * side)


def linear_delta(d: Draft) -> None:
    """Three vertical slides with parallelograms of rods."""
    half = exactly(0.04)
    for k in range(3):
        radial, tangent = about(Z, 120 * k, X), about(Z, 120 * k, Y)
        start = radial * exactly(0.3) + Z * exactly(0.5)
        tip = radial * exactly(0.05) + Z * exactly(0.12)
        d.slide(f"cart{k}", GROUND, start, Z)
        for name, side in (("l", -half), ("r", half)):
            rod = d.rod(
                f"rod{k}{name}",
                f"cart{k}",
                start + tangent * side,
                tip + tangent * side,
                Z,
            )
            if k == 0 and name == "l":
                d.ball("platform", rod, tip + tangent * side)
            else:
                d.meet(rod, "platform", tip + tangent * side)


def three_rps(d: Draft) -> None:
    """Legs that swing about tangents and slide, with balls at a platform."""
    for k in range(3):
        radial, tangent = about(Z, 120 * k, X), about(Z, 120 * k, Y)
        foot, tip = radial * exactly(0.4), radial * exactly(0.25) + Z * exactly(0.5)
        d.hinge(f"leg{k}", GROUND, foot, tangent)
        d.slide(f"piston{k}", f"leg{k}", (foot + tip) / 2, tip - foot)
        if k == 0:
            d.ball("platform", "piston0", tip)
        else:
            d.meet(f"piston{k}", "platform", tip)


def hexapod_points(
    radius: float, spread: float, offset: float, height: float
) -> list[Vec]:
    return [
        about(
            Z,
            120 * (k // 2) + offset + (spread if k % 2 else -spread),
            X * exactly(radius),
        )
        + Z * exactly(height)
        for k in range(6)
    ]


def extensible_legs(
    d: Draft, feet: list[Vec], tips: list[Vec], platform: str = ""
) -> None:
    """Legs of a universal joint, a slide and a ball; without a platform, one is put on the first leg."""
    for k, (foot, tip) in enumerate(zip(feet, tips, strict=True)):
        d.rod(f"leg{k}", GROUND, foot, tip, X)
        d.slide(f"piston{k}", f"leg{k}", (foot + tip) / 2, tip - foot)
        if not platform:
            platform = d.ball("platform", f"piston{k}", tip)
        else:
            d.meet(f"piston{k}", platform, tip)


def gough_stewart(d: Draft) -> None:
    extensible_legs(d, hexapod_points(0.5, 15, 0, 0), hexapod_points(0.3, 40, 0, 0.6))


def gough_stewart_general(d: Draft) -> None:
    feet = hexapod_points(0.5, 17, 3, 0)
    tips = [
        tip + vec(0.03 * k, -0.02 * k, 0.01 * k * k)
        for k, tip in enumerate(hexapod_points(0.3, 37, -4, 0.6))
    ]
    extensible_legs(d, feet, tips)


def two_ups_u(d: Draft) -> None:
    """An ankle on a universal joint, between two extensible legs."""
    d.universal("foot", GROUND, vec(0, 0, 0.3), X, Y)
    extensible_legs(
        d,
        [vec(-0.05, 0.06, 0), vec(-0.05, -0.06, 0)],
        [vec(-0.07, 0.05, 0.28), vec(-0.07, -0.05, 0.28)],
        "foot",
    )


def exechon(d: Draft) -> None:
    """Two legs in one plane that swings, and one across it on a ball-like wrist of three hinges."""
    tips = [vec(-0.12, 0, 0), vec(0.12, 0, 0)]
    feet = [vec(-0.35, 0, 0.9), vec(0.35, 0, 0.9)]
    for k, (foot, tip) in enumerate(zip(feet, tips, strict=True)):
        d.universal(f"leg{k}", GROUND, foot, X, Y)
        d.slide(f"piston{k}", f"leg{k}", tip, tip - foot)
    d.hinge("platform", "piston0", tips[0], Y)
    d.pin("piston1", "platform", tips[1], Y)
    foot, tip = vec(0, 0.4, 0.85), vec(0, 0.15, 0.02)
    d.ball("leg2", GROUND, foot)
    d.slide("piston2", "leg2", tip, tip - foot)
    d.pin("piston2", "platform", tip, X)


def three_upu(d: Draft) -> None:
    """Legs whose outer axes, at the base and the platform, are parallel, as are their inner ones: no turns."""
    for k in range(3):
        radial, tangent = about(Z, 120 * k, X), about(Z, 120 * k, Y)
        foot, tip = (
            radial * exactly(0.4),
            radial * exactly(0.22) + Z * exactly(0.5) + tangent * exactly(0.03),
        )
        inner = unit(cross(tip - foot, tangent))
        leg = d.universal(f"leg{k}", GROUND, foot, tangent, inner)
        piston = d.slide(f"piston{k}", leg, (foot + tip) / 2, tip - foot)
        cross_piece = d.hinge(f"cross{k}", piston, tip, inner)
        if k == 0:
            d.hinge("platform", cross_piece, tip, tangent)
        else:
            d.pin(cross_piece, "platform", tip, tangent)


def hexa(d: Draft) -> None:
    """Six arms with hinges and one rod each."""
    feet, tips = hexapod_points(0.35, 12, 0, 0), hexapod_points(0.12, 20, 0, -0.5)
    for k, (foot, tip) in enumerate(zip(feet, tips, strict=True)):
        radial, tangent = about(Z, 120 * (k // 2), X), about(Z, 120 * (k // 2), Y)
        elbow = foot + radial * exactly(0.2) + Z * exactly(-0.08)
        d.hinge(f"arm{k}", GROUND, foot, tangent)
        d.rod(f"rod{k}", f"arm{k}", elbow, tip, Z)
        if k == 0:
            d.ball("platform", "rod0", tip)
        else:
            d.meet(f"rod{k}", "platform", tip)
