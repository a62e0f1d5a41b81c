"""Linkages that move in a plane: pins are along y, points (x, z)."""

from __future__ import annotations

from flint import arb

from support.rounded_exports.geometry import (
    Vec,
    X,
    Y,
    Z,
    about,
    beyond,
    cross,
    degrees,
    exactly,
    flat,
    meeting,
    middle,
    unit,
    vec,
)
from support.rounded_exports.mechanism import GROUND, Draft


def four_bar(d: Draft) -> None:
    a, b, c, e = flat((0, 0), (0.11, 0.23), (0.52, 0.34), (0.43, -0.05))
    bars(d, "", GROUND, GROUND, a, b, c, e)


def bars(
    d: Draft, name: str, first: str, last: str, a: Vec, b: Vec, c: Vec, e: Vec
) -> None:
    """A crank a-b on one body, a rocker e-c on another, and their coupler."""
    d.hinge(f"crank{name}", first, a)
    d.hinge(f"coupler{name}", f"crank{name}", b)
    d.hinge(f"rocker{name}", last, e)
    d.pin(f"coupler{name}", f"rocker{name}", c)


def parallelogram(d: Draft) -> None:
    a, b, e = flat((0, 0), (0.14, 0.31), (0.4, 0.1))
    bars(d, "", GROUND, GROUND, a, b, b + e - a, e)


def three_cranks(d: Draft) -> None:
    """A rod on three parallel cranks, of which one is redundant."""
    b = vec(0.14, 0, 0.21)
    a, c, e = flat((0, 0), (0.33, 0.05), (0.71, -0.11))
    bars(d, "", GROUND, GROUND, a, a + b, c + b, c)
    d.hinge("third", GROUND, e)
    d.pin("coupler", "third", e + b)


def antiparallelogram(d: Draft) -> None:
    """Equal opposite sides that cross: mirror images in the line across the middle of both cranks."""
    a, e, b = flat((-0.25, 0), (0.25, 0), (0.13, 0.2))
    bars(d, "", GROUND, GROUND, a, b, vec(-b[0], 0, b[2]), e)


def kite(d: Draft) -> None:
    """Galloway's mechanism: two pairs of equal sides that are next to each other."""
    a, e = flat((0, 0), (0.3, 0))
    c = meeting(e, 0.3, a, 0.41, 1)
    bars(d, "", GROUND, GROUND, a, meeting(a, 0.25, c, 0.25, 1), c, e)


def slider_crank(d: Draft) -> None:
    a, b = flat((0, 0), (0.12, 0.16))
    piston = meeting(b, 0.45, vec(0.6, 0, 0), 0.2, -1)
    d.hinge("crank", GROUND, a)
    d.hinge("rod", "crank", b)
    d.slide("piston", GROUND, piston, X)
    d.pin("rod", "piston", piston)


def scott_russell(d: Draft) -> None:
    """A slider-crank whose crank is half as long as its rod: the rod's end runs in a second guide."""
    b = vec(0.18, 0, 0.24)
    foot = vec(0.36, 0, 0)
    d.hinge("crank", GROUND, vec(0, 0, 0))
    d.hinge("rod", "crank", b)
    d.slide("foot", GROUND, foot, X)
    d.slide("head", GROUND, vec(0, 0, 0.48), Z)
    d.pin("rod", "foot", foot)
    d.pin("rod", "head", vec(0, 0, 0.48))


def watt_six_bar(d: Draft) -> None:
    a, b, c, e = flat((0, 0), (0.1, 0.25), (0.45, 0.3), (0.5, 0.02))
    f, g, h = flat((0.6, 0.35), (0.55, 0.6), (0.2, 0.55))
    bars(d, "", GROUND, GROUND, a, b, c, e)
    d.hinge("arm", "rocker", f)
    d.hinge("fore", "coupler", h)
    d.pin("arm", "fore", g)


def stephenson_six_bar(d: Draft) -> None:
    a, b, c, e = flat((0, 0), (0.1, 0.22), (0.47, 0.33), (0.5, -0.03))
    f, g, h = flat((0.29, 0.51), (0.72, 0.44), (0.8, 0.05))
    bars(d, "", GROUND, GROUND, a, b, c, e)
    d.hinge("link", "coupler", f)
    d.hinge("lever", GROUND, h)
    d.pin("link", "lever", g)


def five_bar(d: Draft) -> None:
    a, b, c, e, f = flat(
        (0, 0), (-0.08, 0.24), (0.21, 0.47), (0.53, 0.21), (0.37, 0.02)
    )
    d.hinge("left", GROUND, a)
    d.hinge("left_fore", "left", b)
    d.hinge("right", GROUND, f)
    d.hinge("right_fore", "right", e)
    d.pin("left_fore", "right_fore", c)


def scissor(d: Draft, stages: int) -> None:
    """A lift of crossed bars of one length on a fixed foot and a foot that slides; a platform on top likewise."""
    width, rise = degrees(35).cos() * exactly(0.6), degrees(35).sin() * exactly(0.6)
    left = [vec(0, 0, rise * k) for k in range(stages + 1)]
    right = [vec(width, 0, rise * k) for k in range(stages + 1)]
    d.slide("foot", GROUND, right[0], X)
    up, down = (
        GROUND,
        "foot",
    )  # what carries the bars that start at the left and at the right
    for k in range(stages):
        first, second = d.hinge(f"a{k}", up, left[k]), d.hinge(f"b{k}", down, right[k])
        d.pin(first, second, middle(left[k], right[k + 1]))
        up, down = second, first
    d.hinge("platform", up, left[-1])
    d.slide("head", "platform", right[-1], X)
    d.pin("head", down, right[-1])


def scissor_one(d: Draft) -> None:
    scissor(d, 1)


def scissor_two(d: Draft) -> None:
    scissor(d, 2)


def scissor_three(d: Draft) -> None:
    scissor(d, 3)


def four_bars_in_series(d: Draft, count: int) -> None:
    """Every rocker drives the next four-bar as its crank."""
    bars(
        d, "0", GROUND, GROUND, *flat((0, 0), (0.1, 0.21), (0.42, 0.27), (0.39, -0.04))
    )
    for k in range(1, count):
        b, c, e = flat(
            (0.35 * k + 0.12, 0.13),
            (0.35 * k + 0.41, 0.28 + 0.02 * k),
            (0.35 * k + 0.4, 0.03 * k - 0.05),
        )
        d.hinge(f"link{k}", f"rocker{k - 1}", b)
        d.hinge(f"rocker{k}", GROUND, e)
        d.pin(f"link{k}", f"rocker{k}", c)


def two_four_bars(d: Draft) -> None:
    four_bars_in_series(d, 2)


def three_four_bars(d: Draft) -> None:
    four_bars_in_series(d, 3)


def four_four_bars(d: Draft) -> None:
    four_bars_in_series(d, 4)


def remote_center(d: Draft) -> None:
    """Two parallelograms on a yaw axis turn a slide about a point on that axis."""
    a = vec(0, 0, 0)
    arm, out = about(vec(0, 1, 0), 17, vec(0, 0, 0.3)), vec(0.35, 0, 0)
    far = vec(0.2, 0, 0)
    d.hinge("yaw", GROUND, a, X)
    d.hinge("arm", "yaw", a)
    d.hinge("arm2", "yaw", far)
    d.hinge("bar", "arm", arm)
    d.pin("bar", "arm2", far + arm)
    d.hinge("bar2", "arm", arm / 2)
    d.pin("bar2", "arm2", far + arm / 2)
    d.hinge("up", "bar", arm + out)
    d.pin("bar2", "up", arm / 2 + out)
    d.slide("tool", "up", arm + out, arm)


def pantograph_leg(d: Draft) -> None:
    """A parallelogram of thigh, shank, and two rods, on two cranks about the hip."""
    hip, knee, out = vec(0, 0, 0), vec(0.14, 0, -0.25), vec(-0.09, 0, -0.12)
    d.hinge("thigh", GROUND, hip)
    d.hinge("shank", "thigh", knee)
    d.hinge("crank", GROUND, hip)
    d.hinge("rod", "crank", hip + out)
    d.pin("rod", "shank", knee + out)


def peaucellier(d: Draft) -> None:
    """Two long arms, a rhombus, and a crank as long as the ground: a point runs on a straight line."""
    start, ground = flat((0, 0), (0.2, 0))
    along = unit(vec(0.9, 0, 0.25))
    near = along * (2 * ground[0] * along[0])
    center = near + along * exactly(0.15)
    across = vec(-along[2], 0, along[0]) * exactly(0.2)
    top, low = center + across, center - across
    far = center * 2 - near
    d.hinge("crank", GROUND, ground)
    d.hinge("top_arm", GROUND, start)
    d.hinge("low_arm", GROUND, start)
    d.hinge("near_top", "crank", near)
    d.hinge("near_low", "crank", near)
    d.hinge("far_top", "top_arm", top)
    d.hinge("far_low", "low_arm", low)
    d.pin("near_top", "top_arm", top)
    d.pin("near_low", "low_arm", low)
    d.pin("far_top", "far_low", far)


def jansen(d: Draft) -> None:
    """Jansen's leg, with his holy numbers in centimetres."""
    n = {key: exactly(value) / 100 for key, value in JANSEN.items()}
    crank, pivot = vec(0, 0, 0), vec(-n["a"], 0, -n["l"])
    m = about(vec(0, 1, 0), -63, vec(n["m"], 0, 0))
    top = meeting(pivot, n["b"], m, n["j"], 1)
    low = meeting(pivot, n["c"], m, n["k"], -1)
    back = meeting(pivot, n["d"], top, n["e"], 1)
    knee = meeting(low, n["g"], back, n["f"], 1)
    d.hinge("crank", GROUND, crank)
    d.hinge("upper", "crank", m)
    d.hinge("lower", "crank", m)
    d.hinge("triangle", GROUND, pivot)
    d.hinge("strut", GROUND, pivot)
    d.pin("upper", "triangle", top)
    d.pin("lower", "strut", low)
    d.hinge("rod", "triangle", back)
    d.hinge("foot", "strut", low)
    d.pin("rod", "foot", knee)


JANSEN = {
    "a": 38, "b": 41.5, "c": 39.3, "d": 40.1, "e": 55.8, "f": 39.4, "g": 36.7, "j": 50, "k": 61.9, "l": 7.8, "m": 15,
}  # fmt: skip


def chebyshev_lambda(d: Draft) -> None:
    a, e = flat((0, 0), (0.2, 0))
    b = about(vec(0, 1, 0), -70, vec(0.1, 0, 0))
    bars(d, "", GROUND, GROUND, a, b, meeting(b, 0.25, e, 0.25, 1), e)


def hoeken(d: Draft) -> None:
    """Hoeken's straight line: the coupler's end moves a table that lifts."""
    a, e = flat((0, 0), (0.2, 0))
    b = about(vec(0, 1, 0), -130, vec(0.1, 0, 0))
    c = meeting(b, 0.25, e, 0.25, 1)
    tip = c * 2 - b
    bars(d, "", GROUND, GROUND, a, b, c, e)
    d.slide("table", GROUND, tip, X)
    d.slide("lift", "table", tip, Z)
    d.pin("coupler", "lift", tip)


def klann(d: Draft) -> None:
    """A leg like Klann's: a crank, a connector whose far end carries the leg, and two rockers."""
    crank, low, top = flat((0, 0), (-0.6, -0.18), (-0.24, 0.61))
    m, b, c = flat((-0.25, 0.1), (-0.8, 0.06), (-1.3, 0.15))
    e = vec(-0.71, 0, 0.83)
    d.hinge("crank", GROUND, crank)
    d.hinge("connector", "crank", m)
    d.hinge("low", GROUND, low)
    d.pin("connector", "low", b)
    d.hinge("leg", "connector", c)
    d.hinge("top", GROUND, top)
    d.pin("leg", "top", e)


def planar_3rrr(d: Draft) -> None:
    feet = flat((0, 0), (0.9, 0.05), (0.42, 0.81))
    knees = flat((-0.05, 0.33), (0.81, 0.39), (0.2, 0.74))
    tips = flat((0.32, 0.31), (0.57, 0.27), (0.41, 0.48))
    for k, (foot, knee) in enumerate(zip(feet, knees, strict=True)):
        d.hinge(f"arm{k}", GROUND, foot)
        d.hinge(f"fore{k}", f"arm{k}", knee)
    d.hinge("platform", "fore0", tips[0])
    d.pin("platform", "fore1", tips[1])
    d.pin("platform", "fore2", tips[2])


def planar_3prr(d: Draft) -> None:
    feet = flat((0, 0), (0.9, 0.05), (0.42, 0.81))
    tips = flat((0.32, 0.31), (0.57, 0.27), (0.41, 0.48))
    for k, along in enumerate(flat((1, 0), (-0.5, 0.87), (-0.3, -0.8))):
        d.slide(f"cart{k}", GROUND, feet[k], along)
        d.hinge(f"bar{k}", f"cart{k}", feet[k])
    d.hinge("platform", "bar0", tips[0])
    d.pin("platform", "bar1", tips[1])
    d.pin("platform", "bar2", tips[2])


def oldham(d: Draft) -> None:
    """Two discs on parallel shafts, with a cross between them that slides on both."""
    a, b = flat((0, 0), (0.03, 0.02))
    along = vec(0.8, 0, 0.6)
    d.hinge("first", GROUND, a)
    d.slide("cross", "first", a, along)
    d.slide("second", "cross", b, vec(-0.6, 0, 0.8))
    d.pin("second", GROUND, b)


def scotch_yoke(d: Draft) -> None:
    b = vec(0.09, 0, 0.12)
    d.hinge("crank", GROUND, vec(0, 0, 0))
    d.slide("yoke", GROUND, vec(0.3, 0, 0), X)
    d.slide("block", "yoke", b, Z)
    d.pin("crank", "block", b)


def quick_return(d: Draft) -> None:
    """Whitworth's: a block on the crank slides in a lever, whose end moves a ram by a link."""
    low, crank = flat((0, 0), (0, 0.4))
    pin, ram = crank + vec(0.12, 0, 0.09), vec(-0.05, 0, 0.9)
    end = beyond(low, pin, 0.85)
    d.hinge("crank", GROUND, crank)
    d.hinge("lever", GROUND, low)
    d.slide("block", "lever", pin, pin - low)
    d.pin("crank", "block", pin)
    d.hinge("link", "lever", end)
    d.slide("ram", GROUND, ram, X)
    d.pin("link", "ram", ram)


def palletizer(d: Draft) -> None:
    """Two parallelograms in a row keep a hand level; a third drives the forearm."""
    shoulder, elbow, wrist = flat((0, 0.3), (0.11, 0.85), (0.76, 0.71))
    tie, tie2 = vec(-0.15, 0, 0.08), vec(0.1, 0, 0.12)
    lever = vec(-0.2, 0, 0.03)
    d.hinge("turret", GROUND, vec(0, 0, 0), Z)
    d.hinge("arm", "turret", shoulder)
    d.hinge("forearm", "arm", elbow)
    d.hinge("hand", "forearm", wrist)
    d.hinge("crank", "turret", shoulder)
    d.hinge("drive", "crank", shoulder + lever)
    d.pin("drive", "forearm", elbow + lever)
    d.hinge("triangle", "arm", elbow)
    d.hinge("rod", "turret", shoulder + tie)
    d.pin("rod", "triangle", elbow + tie)
    d.hinge("rod2", "triangle", elbow + tie2)
    d.pin("rod2", "hand", wrist + tie2)


def sr400(d: Draft) -> None:
    """Six axes with a parallelogram that drives the forearm."""
    shoulder, elbow = flat((0, 0.4), (0, 1.1))
    back = vec(-0.3, 0, 0)
    d.hinge("turret", GROUND, vec(0, 0, 0), Z)
    d.hinge("arm", "turret", shoulder)
    d.hinge("forearm", "arm", elbow)
    d.hinge("roll", "forearm", vec(0.3, 0, 1.2), X)
    d.hinge("pitch", "roll", vec(0.9, 0, 1.2))
    d.hinge("flange", "pitch", vec(0.9, 0, 1.2), X)
    d.hinge("lever", "turret", shoulder)
    d.hinge("rod", "lever", shoulder + back)
    d.pin("rod", "forearm", elbow + back)


def parallel_gripper(d: Draft) -> None:
    """Two fingers on parallelograms; each is turned by a link from one slide."""
    d.slide("slide", GROUND, vec(0, 0, 0.02), Z)
    for side, name in ((1, "l"), (-1, "r")):
        x = [exactly(value) * side for value in (0.03, 0.05, 0.09, 0.02, 0.06)]
        a, c, b = vec(x[0], 0, 0.05), vec(x[1], 0, 0.03), vec(x[2], 0, 0.11)
        d.hinge(f"inner_{name}", GROUND, a)
        d.hinge(f"outer_{name}", GROUND, c)
        d.hinge(f"finger_{name}", f"inner_{name}", b)
        d.pin(f"finger_{name}", f"outer_{name}", b + c - a)
        d.hinge(f"link_{name}", "slide", vec(x[3], 0, 0.02))
        d.pin(f"link_{name}", f"inner_{name}", vec(x[4], 0, 0.09))


def robotiq(d: Draft) -> None:
    """Two fingers of a driver, a coupler, a finger and a spring link each."""
    for side, name in ((1, "l"), (-1, "r")):
        x = [exactly(value) * side for value in (0.03, 0.013, 0.075, 0.06, 0.055)]
        a, c, out = (
            vec(x[0], 0, 0.055),
            vec(x[1], 0, 0.061),
            vec(exactly(0.031) * side, 0, 0.044),
        )
        d.hinge(f"driver_{name}", GROUND, a)
        d.hinge(f"coupler_{name}", f"driver_{name}", vec(x[2], 0, 0.06))
        d.hinge(f"spring_{name}", GROUND, c)
        d.hinge(f"finger_{name}", f"coupler_{name}", vec(x[3], 0, 0.098))
        d.pin(f"finger_{name}", f"spring_{name}", vec(x[4], 0, 0.093) + out)


def excavator(d: Draft) -> None:
    """Boom, stick and bucket, each moved by a cylinder, the bucket by way of a four-bar."""
    boom, stick, bucket = flat((0.2, 0.3), (2.1, 1.4), (3.0, 0.6))
    joints = {"boom": boom, "stick": stick, "bucket": bucket}
    for name, parent in (("boom", GROUND), ("stick", "boom"), ("bucket", "stick")):
        d.hinge(name, parent, joints[name])
    cylinder(d, "lift", GROUND, "boom", *flat((0.5, 0), (1.3, 1.2)))
    cylinder(d, "reach", "boom", "stick", *flat((1.2, 1.5), (2.2, 1.9)))
    rocker, pin, tip = flat((2.8, 0.85), (3.1, 1.05), (3.3, 0.7))
    d.hinge("rocker", "stick", rocker)
    d.hinge("link", "rocker", pin)
    d.pin("link", "bucket", tip)
    cylinder(d, "curl", "stick", "rocker", *flat((2.3, 1.7)), pin)


def cylinder(d: Draft, name: str, first: str, last: str, a: Vec, b: Vec) -> None:
    d.hinge(f"{name}_tube", first, a)
    d.slide(f"{name}_rod", f"{name}_tube", b, b - a)
    d.pin(f"{name}_rod", last, b)


def hoberman(d: Draft) -> None:
    """A ring of four pairs of angulated bars, which opens although counting says that it cannot; one bar is held."""
    count, outer, inner = 4, exactly(0.5), exactly(0.33)
    step = 360 / count
    # a bar's halves are equally long where its middle is above the middle between its ends' distances
    crown = (outer + inner) / (2 * degrees(step / 2).cos())
    far, near = (
        [radial(step * k, radius) for k in range(count)] for radius in (outer, inner)
    )
    mid = [radial(step * (k + 0.5), crown) for k in range(count)]
    # bar a_k runs from far_k to near_k+1, bar b_k from near_k to far_k+1, both through mid_k
    d.hinge("b0", GROUND, mid[0])
    first, second = GROUND, "b0"
    for k in range(1, count):
        a = d.hinge(f"a{k}", second, far[k])
        b = d.hinge(f"b{k}", first, near[k])
        d.pin(a, b, mid[k])
        first, second = a, b
    d.pin(first, "b0", near[0])
    d.pin(second, GROUND, far[0])


def radial(angle: float, radius: arb) -> Vec:
    turn = degrees(angle)
    return vec(radius * turn.cos(), 0, radius * turn.sin())


def ackermann(d: Draft) -> None:
    """A steering trapezoid, with a symmetric pose."""
    a, e, b = flat((-0.3, 0), (0.3, 0), (-0.24, -0.17))
    bars(d, "", GROUND, GROUND, a, b, vec(-b[0], 0, b[2]), e)


def hart(d: Draft) -> None:
    """Hart's inversor: an antiparallelogram whose bars are cut in one ratio by a line along its axis."""
    p, q = vec(-0.25, 0, 0), vec(0.13, 0, 0.2)
    r, s = vec(-q[0], 0, q[2]), vec(0.25, 0, 0)
    share = exactly(0.4)
    o, near, far = p + (r - p) * share, p + (q - p) * share, s + (r - s) * share
    # bars: p-q long, q-s short, s-r long, r-p short
    d.hinge("short", GROUND, o)
    d.hinge("long", "short", p)
    d.hinge("long2", "short", r)
    d.hinge("short2", "long", q)
    d.pin("short2", "long2", s)
    anchor = meeting(o, 0.1, near, 0.1, 1)
    d.hinge("crank", GROUND, anchor)
    d.pin("crank", "long", near)
    d.slide("carriage", GROUND, far, cross(anchor - o, Y))
    d.pin("carriage", "long2", far)


def watt_line(d: Draft) -> None:
    a, e, b = flat((0, 0.1), (0.5, -0.1), (0.22, 0.13))
    bars(d, "", GROUND, GROUND, a, b, vec(0.5 - b[0], 0, -b[2]), e)
