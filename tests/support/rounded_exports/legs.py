"""Legs with rods, on a base that stands or floats."""

from __future__ import annotations

from support.rounded_exports.geometry import Vec, X, Y, Z, vec
from support.rounded_exports.mechanism import GROUND, Draft

ROD_PULL = 0.05


def ankle(d: Draft, shin: str, at: Vec, names: str = "") -> str:
    """Pitch and roll, each driven by both rods, between motors on the shin and balls at the foot."""
    pitch = d.hinge(f"pitch{names}", shin, at + vec(0, 0, -0.4), Y)
    roll = d.hinge(
        f"roll{names}", pitch, at + vec(-0.01, 0, -0.42), vec(0.88, 0, -0.47)
    )
    for side, name, high in ((1, "l", -0.13), (-1, "r", -0.22)):
        axle = at + vec(-0.02, 0.05 * side, high)
        horn, heel = axle + vec(-0.05, 0, 0.005), at + vec(-0.07, 0.045 * side, -0.43)
        d.hinge(f"motor_{name}{names}", shin, axle, Y)
        d.rod(f"rod_{name}{names}", f"motor_{name}{names}", horn, heel, Y)
        d.meet(f"rod_{name}{names}", roll, heel)
    return roll


def ankle_two_rods(d: Draft) -> None:
    d.hinge("knee", GROUND, vec(0, 0, 0), Y)
    ankle(d, "knee", vec(0, 0, 0))


def ankle_balls(d: Draft) -> None:
    """Rods between balls, which spin about themselves."""
    d.hinge("pitch", GROUND, vec(0, 0, -0.4), Y)
    d.hinge("roll", "pitch", vec(0, 0, -0.4), X)
    for side, name, high in ((1, "l", -0.1), (-1, "r", -0.2)):
        horn, heel = vec(-0.06, 0.05 * side, high), vec(-0.06, 0.045 * side, -0.39)
        d.hinge(f"motor_{name}", GROUND, vec(0, 0.05 * side, high), Y)
        d.ball(f"rod_{name}", f"motor_{name}", horn)
        d.meet(f"rod_{name}", "roll", heel)


def hip(d: Draft, side: int, names: str) -> str:
    at = vec(0, 0.1 * side, -0.05)
    d.hinge(f"yaw{names}", GROUND, at, Z)
    d.hinge(f"abduction{names}", f"yaw{names}", at + vec(0.02, 0, -0.03), X)
    return d.hinge(
        f"thigh{names}", f"abduction{names}", at + vec(0.02, 0.03 * side, -0.05), Y
    )


def leg_with_rods(d: Draft, side: int = 1, names: str = "") -> None:
    """A hip of three hinges, a knee that a parallelogram drives, and an ankle with two rods."""
    thigh = hip(d, side, names)
    top, knee, pull = (
        vec(0.02, 0.13 * side, -0.1),
        vec(0.05, 0.13 * side, -0.45),
        vec(-0.06, 0, 0.01),
    )
    shin = d.hinge(f"shin{names}", thigh, knee, Y)
    d.hinge(f"crank{names}", thigh, top, Y)
    d.hinge(f"tie{names}", f"crank{names}", top + pull, Y)
    d.pin(f"tie{names}", shin, knee + pull, Y)
    ankle(d, shin, knee, names)


def biped(d: Draft) -> None:
    leg_with_rods(d, 1, "_left")
    leg_with_rods(d, -1, "_right")


def digit_leg(d: Draft) -> None:
    """A hip, a knee, a tarsus that a rod from the hip keeps in place of a spring, and a toe with two rods."""
    thigh = hip(d, 1, "")
    knee, tarsus = vec(0.04, 0.13, -0.4), vec(0.01, 0.13, -0.5)
    d.hinge("knee", thigh, knee, Y)
    d.hinge("tarsus", "knee", tarsus, Y)
    start, end = vec(0.0, 0.15, -0.12), vec(-0.06, 0.14, -0.52)
    d.ball("heel_rod", thigh, start)
    d.meet("heel_rod", "tarsus", end)
    toe = vec(-0.02, 0.13, -0.85)
    d.hinge("toe_pitch", "tarsus", toe, Y)
    d.hinge("toe_roll", "toe_pitch", toe, vec(0.9, 0, -0.3))
    for side, name in ((1, "a"), (-1, "b")):
        axle = vec(-0.01, 0.13 + 0.03 * side, -0.6 - 0.04 * side)
        horn, heel = (
            axle + vec(-0.05, 0.005 * side, 0.01),
            toe + vec(-0.07, 0.025 * side, -0.02),
        )
        d.hinge(f"motor_{name}", "tarsus", axle, Y)
        d.ball(f"rod_{name}", f"motor_{name}", horn)
        d.meet(f"rod_{name}", "toe_roll", heel)


def kangaroo_leg(d: Draft) -> None:
    """Linear drives at the hip and thigh, rods down to the knee and the ankle by way of a bell crank."""
    d.hinge("yaw", GROUND, vec(0, 0.1, 0), Z)
    d.universal("thigh", "yaw", vec(0, 0.1, -0.05), X, Y)
    for side, name in ((1, "l"), (-1, "r")):
        foot, tip = (
            vec(0.08, 0.1 + 0.06 * side, 0.1),
            vec(0.07, 0.1 + 0.05 * side, -0.15),
        )
        d.rod(f"hip_tube_{name}", "yaw", foot, tip, X)
        d.slide(f"hip_rod_{name}", f"hip_tube_{name}", (foot + tip) / 2, tip - foot)
        d.meet(f"hip_rod_{name}", "thigh", tip)
    knee = vec(0.03, 0.1, -0.45)
    d.hinge("shin", "thigh", knee, Y)
    d.slide("drive", "thigh", vec(-0.03, 0.1, -0.2), Z)
    d.hinge("knee_rod", "drive", vec(-0.03, 0.1, -0.2), Y)
    d.pin("knee_rod", "shin", knee + vec(-0.05, 0, 0.02), Y)
    # rods along thigh and shin, over a bell crank at the knee, turn the foot
    foot = vec(0, 0.1, -0.85)
    d.universal("foot", "shin", foot, Y, X)
    for side, name in ((1, "l"), (-1, "r")):
        high = vec(0.02, 0.1 + 0.05 * side, -0.18)
        bell, low = (
            knee + vec(-0.06, 0.05 * side, 0.01),
            foot + vec(-0.06, 0.045 * side, 0),
        )
        d.slide(f"drive_{name}", "thigh", high, Z)
        d.hinge(f"bell_{name}", "shin", knee + vec(0, 0.05 * side, 0), Y)
        d.ball(f"upper_rod_{name}", f"drive_{name}", high)
        d.meet(f"upper_rod_{name}", f"bell_{name}", bell)
        d.ball(f"lower_rod_{name}", f"bell_{name}", bell + vec(0.005, 0, -0.015))
        d.meet(f"lower_rod_{name}", "foot", low)


def waist(d: Draft) -> None:
    """A torso on pitch and roll, which two crossed rods drive from motors on the pelvis."""
    d.hinge("roll", GROUND, vec(0, 0, 0.1), X)
    d.hinge("torso", "roll", vec(0, 0, 0.12), Y)
    for side, name in ((1, "l"), (-1, "r")):
        axle = vec(-0.08, 0.07 * side, 0.02)
        horn, tip = axle + vec(-0.04, 0, 0.01), vec(-0.1, 0.06 * side, 0.18)
        d.hinge(f"motor_{name}", GROUND, axle, Y)
        d.rod(f"rod_{name}", f"motor_{name}", horn, tip, Y)
        d.meet(f"rod_{name}", "torso", tip)
    d.hinge("neck", "torso", vec(0.01, 0, 0.5), Z)
