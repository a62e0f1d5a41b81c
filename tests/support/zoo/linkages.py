"""Linkages of textbooks, drawn in a closed pose: straight lines, walking legs, spherical and parallel ones, screws."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import cos, hypot, pi, sin, sqrt

from support.zoo.case import Case
from support.zoo.drawn import Drawn, Point

ZERO: Point = (0, 0, 0)
OBLIQUE = ("[1, 2, 2]", "[2, -1, 2]", "[2, 3, 6]", "[-1, 4, 8]", "[6, -2, 3]")
"""Directions of rational length."""


def turn(axis: str) -> str:
    return f"revolute, axis: {axis}"


def slide(axis: str) -> str:
    return f"prismatic, axis: {axis}"


def at(text: str, pose: str) -> str:
    return f"{text}assembly: {{{pose}}}\n"


def peaucellier() -> str:
    robot = Drawn()
    robot.body("crank", "base", (1, 0))
    for arm, corner in (("a", (4, 3)), ("b", (4, -3))):
        robot.body(arm, "base", ZERO)
        robot.body(f"{arm}near", arm, corner)
        robot.body(f"{arm}far", arm, corner)
        robot.loop(f"{arm}near", "crank", (2, 0))
    robot.loop("afar", "bfar", (6, 0))
    return robot.text


def octahedron() -> str:
    """Bricard's ring of faces of a flexible octahedron that is symmetric about a plane; all edges are integers."""
    robot, last = Drawn(), "base"
    corners = (
        (-8, 1, -4),
        (-4, -7, 4),
        (10, 0, -10),
        (-8, -1, -4),
        (-4, 7, 4),
        (0, 0, 0),
    )
    edges = [
        [b - a for a, b in zip(*pair, strict=True)]
        for pair in pairwise((*corners, corners[0]))
    ]
    for k in range(5):
        last = robot.body(f"face{k}", last, corners[k], turn(str(edges[k])))
    robot.loop(last, "base", corners[5], turn(str(edges[5])))
    return robot.text


def scissors(stages: int) -> str:
    robot = Drawn()
    robot.body("left0", "base", ZERO)
    robot.body("foot", "base", (4, 0), slide("x"))
    robot.body("right0", "foot", (4, 0))
    robot.loop("left0", "right0", (2, 1.5))
    for k in range(1, stages):
        robot.body(f"left{k}", f"right{k - 1}", (0, 3 * k))
        robot.body(f"right{k}", f"left{k - 1}", (4, 3 * k))
        robot.loop(f"left{k}", f"right{k}", (2, 3 * k + 1.5))
    return robot.text


def jansen(legs: int) -> str:
    """Legs of Jansen's beach animals on one shaft: his numbers, at a pose to a hundredth of a millimetre."""
    robot = Drawn()
    robot.body("shaft", "base", ZERO)
    for leg in range(legs):
        _jansen_leg(robot, leg, 0.3 + leg * 2 * pi / 3)
    return robot.text


def _jansen_leg(robot: Drawn, leg: int, phase: float) -> None:
    crank, frame = (0.15 * cos(phase), 0.15 * sin(phase)), (-0.38, -0.078)
    top, knee = (
        _meet(frame, 0.415, crank, 0.5, 1),
        _meet(frame, 0.393, crank, 0.619, -1),
    )
    back = _meet(frame, 0.401, top, 0.558, 1)
    ankle = _meet(knee, 0.367, back, 0.394, -1)
    crank, top, knee, back, ankle = (
        (round(x, 5), round(y, 5)) for x, y in (crank, top, knee, back, ankle)
    )
    for name, parent, point in (
        ("upper", "shaft", crank),
        ("lower", "shaft", crank),
        ("triangle", "base", frame),
        ("bar", "base", frame),
        ("rod", f"triangle{leg}", back),
        ("foot", f"bar{leg}", knee),
    ):
        robot.body(f"{name}{leg}", parent, point)
    robot.loop(f"upper{leg}", f"triangle{leg}", top)
    robot.loop(f"lower{leg}", f"bar{leg}", knee)
    robot.loop(f"rod{leg}", f"foot{leg}", ankle)


def _meet(
    p: tuple[float, float], r: float, q: tuple[float, float], s: float, side: int
) -> tuple[float, float]:
    """Where two circles meet."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    apart = hypot(dx, dy)
    along = (r * r - s * s + apart * apart) / (2 * apart)
    across = side * sqrt(r * r - along * along)
    return p[0] + (along * dx - across * dy) / apart, p[1] + (
        along * dy + across * dx
    ) / apart


def parallelograms(count: int) -> str:
    """One upon another, each of a width of its own."""
    robot, ground = Drawn(), "base"
    for k in range(count):
        left, right = (3 * k, 4 * k), (3 * k + 2 + k, 4 * k + Fraction(k, 2))
        robot.body(f"left{k}", ground, left)
        robot.body(f"top{k}", f"left{k}", (left[0] + 3, left[1] + 4))
        robot.body(f"right{k}", ground, right)
        robot.loop(f"top{k}", f"right{k}", (right[0] + 3, right[1] + 4))
        ground = f"top{k}"
    return robot.text


def sliding_coupler() -> str:
    robot = Drawn()
    robot.body("crank", "base", ZERO)
    robot.body("rod", "crank", (1, 2))
    robot.body("rocker", "base", (5, 0))
    robot.loop("rod", "rocker", (5, 3), slide("[3, 4, 0]"))
    return robot.text


def spherical(joints: int) -> str:
    robot = Drawn()
    last = robot.chain(
        "link", "base", *((ZERO, turn(axis)) for axis in OBLIQUE[: joints - 1])
    )
    robot.loop(last, "base", ZERO, turn(OBLIQUE[joints - 1]))
    return robot.text


def sarrus(raised: bool) -> str:
    """Two legs of parallel axes, one of them along (2, 1, 0); raised a little, one angle is twice another."""
    robot = Drawn()
    y, oblique = turn("y"), turn("[2, 1, 0]")
    top = robot.chain("a", "base", ((2, 0, 0), y), ((3, 0, 2), y), ((2, 0, 4), y))
    robot.loop(
        robot.chain("b", "base", ((0, 2, 0), oblique), ((0, 3, 2), oblique)),
        top,
        (0, 2, 4),
        oblique,
    )
    pose = "a1: -0.000939188, a2: 0.001878375, a3: -0.000939188, b1: 0.001050291, b2: -0.002100582"
    return f"{robot.text}assembly: {{{pose}}}\n" if raised else robot.text


def excavator() -> str:
    """Two cylinders between pins, their rods sliding in oblique directions."""
    robot = Drawn()
    robot.body("swing", "base", ZERO, turn("y"))
    robot.body("boom", "swing", (1, 1))
    robot.chain("lift", "swing", ((2, 0), turn("z")), ((3, 2), slide("[1, 2, 0]")))
    robot.loop("lift2", "boom", (4, 4))
    robot.body("stick", "boom", (7, 5))
    robot.chain("crowd", "boom", ((4, 5), turn("z")), ((5, 8), slide("[1, 3, 0]")))
    robot.loop("crowd2", "stick", (7, 14))
    robot.body("bucket", "stick", (9, 1))
    return robot.text


def agile_eye() -> str:
    """Three legs of three revolute joints, all axes through one point and those of neighbours perpendicular."""
    robot = Drawn()
    robot.chain("arm0_", "base", (ZERO, turn("x")), (ZERO, turn("y")))
    robot.body("eye", "arm0_2", ZERO, turn("z"))
    for k, axes in enumerate(("yzx", "zxy"), 1):
        robot.chain(f"arm{k}_", "base", *((ZERO, turn(axis)) for axis in axes[:2]))
        robot.loop(f"arm{k}_2", "eye", ZERO, turn(axes[2]))
    return robot.text


def universal_chain() -> str:
    robot = Drawn()
    cross, crossed = "universal, axis: x, axis2: y", "universal, axis: y, axis2: x"
    last = robot.chain(
        "shaft",
        "base",
        (ZERO, turn("z")),
        ((0, 0, 1), cross),
        ((0, 1, 3), cross),
        ((1, 1, 5), crossed),
    )
    robot.loop(last, "base", (1, 1, 7), "cylindrical, axis: z")
    return robot.text


LEGS = (
    ((5, 0, 0), (2, 0, 4), "[0, 1, 0]", "[4, 0, 3]", "[-3, 0, 4]"),
    ((0, 5, 0), (0, 2, 4), "[1, 0, 0]", "[0, 4, 3]", "[0, -3, 4]"),
    (
        (-3, -4, 0),
        (-2, Fraction(-8, 3), 4),
        "[4, -3, 0]",
        "[36, 48, -25]",
        "[3, 4, 12]",
    ),
)
OTHERS = (
    ("[2, 1, 2]", "[1, 2, -2]"),
    ("[2, 3, 6]", "[6, 2, -3]"),
    ("[1, 4, 8]", "[4, 7, -4]"),
)


def three_upu(*, parallel: bool) -> str:
    """Legs whose crosses have parallel axes at both ends, so that the platform does not turn, or others."""
    robot = Drawn()
    for k, (low, high, outer, inner, along) in enumerate(LEGS):
        near, far = (inner, outer) if parallel else OTHERS[k]
        leg = (
            (low, turn(outer)),
            (low, turn(inner)),
            (low, slide(along)),
            (high, turn(near)),
        )
        end = robot.chain(f"leg{k}_", "base", *leg)
        robot.body("top", end, high, turn(far)) if k == 0 else robot.loop(
            end, "top", high, turn(far)
        )
    return robot.text


def three_prs() -> str:
    robot = Drawn()
    legs = (
        ((4, 0, 1), (2, 0, 4), "y"),
        ((-3, 4, 1), (-1.5, 2, 4), "[4, 3, 0]"),
        ((-3, -4, 1), (-1.5, -2, 4), "[-4, 3, 0]"),
    )
    for k, (low, high, axis) in enumerate(legs):
        end = robot.chain(f"leg{k}_", "base", (low, slide("z")), (low, turn(axis)))
        robot.body("top", end, high, "spherical") if k == 0 else robot.loop(
            end, "top", high, "spherical"
        )
    return robot.text


def gough(
    base: tuple[Point, ...], top: tuple[Point, ...], pairs: tuple[tuple[int, int], ...]
) -> str:
    robot = Drawn()
    for k, (i, j) in enumerate(pairs):
        low, high = base[i], top[j]
        along = ", ".join(str(b - a) for a, b in zip(low, high, strict=True))
        end = robot.chain(
            f"leg{k}_",
            "base",
            (low, "universal, axis: x, axis2: y"),
            (low, slide(f"[{along}]")),
        )
        robot.body("top", end, high, "spherical") if k == 0 else robot.loop(
            end, "top", high, "spherical"
        )
    return robot.text


ARMS = ((1, 0), (Fraction(-3, 5), Fraction(4, 5)), (Fraction(-3, 5), Fraction(-4, 5)))
ROOTS = ((1, 2), (-2, 1), (-1, -3))


def delta(
    rod: str, arms: tuple[tuple[int | Fraction, int | Fraction], ...] = ARMS
) -> str:
    """Arms along some directions, frames in full, rods in parallel pairs between balls."""
    robot = Drawn()
    for k, (c, s) in enumerate(arms):
        robot.body(f"arm{k}", "base", (2 * c, 2 * s, 0), turn(f"[{-s}, {c}, 0]"))
        for name, w in (("a", Fraction(1, 2)), ("b", Fraction(-1, 2))):
            robot.body(
                f"rod{k}{name}", f"arm{k}", (3 * c - s * w, 3 * s + c * w, -1), rod
            )
            high = (c - s * w, s + c * w, -4)
            if "top" in robot.at:
                robot.loop(f"rod{k}{name}", "top", high, "spherical")
            else:
                robot.body("top", f"rod{k}{name}", high, "spherical")
    return robot.text


def screw_jack() -> str:
    """A motor on a cradle turns a screw whose nut swings a lever."""
    robot = Drawn()
    robot.body("cradle", "base", ZERO, turn("y"))
    robot.body("rotor", "cradle", ZERO, turn("[3, 0, 4]"))
    robot.body("nut", "rotor", (3, 0, 4), "helical, axis: [3, 0, 4], pitch: 1/2")
    robot.body("lever", "base", (5, 0, 0), turn("y"))
    robot.loop("nut", "lever", (3, 0, 4), turn("y"))
    return robot.text


def car_jack() -> str:
    """A rhombus whose side corners a screw draws together."""
    robot = Drawn()
    for side, x in (("left", -4), ("right", 4)):
        robot.body(f"{side}0", "base", ZERO)
        robot.body(f"{side}1", f"{side}0", (x, 3))
    robot.loop("left1", "right1", (0, 6))
    robot.chain(
        "screw",
        "left0",
        ((-4, 3), turn("z")),
        ((-4, 3), turn("x")),
        ((4, 3), "helical, axis: x, pitch: 1/50"),
    )
    robot.loop("screw3", "right0", (4, 3))
    return robot.text


def screws_in_parallel() -> str:
    robot = Drawn()
    robot.body("left", "base", ZERO, "helical, axis: z, pitch: 1/50")
    robot.body("bar", "left", (1, 0, 0), turn("z"))
    robot.body("right", "base", (3, 0, 0), "helical, axis: z, pitch: 1/30")
    robot.loop("bar", "right", (2, 1, 0), "cylindrical, axis: z")
    return robot.text


def differential_screw() -> str:
    robot = Drawn()
    robot.body("spindle", "base", ZERO, "helical, axis: z, pitch: 1/50")
    robot.body("nut", "spindle", (0, 0, 2), "helical, axis: z, pitch: -3/100")
    robot.loop("nut", "base", (0, 0, 2), slide("z"))
    return robot.text


PLACES = (
    ZERO,
    (0.3, 0.1, 0.2),
    (0.55, -0.05, 0.3),
    (0.75, 0.25, 0.4),
    (0.6, 0.45, 0.7),
    (0.3, 0.55, 0.6),
    (0.4, 0.25, 0.5),
)


def welded(*joints: str) -> str:
    """A chain in space whose last body is welded to the base."""
    robot = Drawn()
    last = robot.chain("link", "base", *zip(PLACES, joints, strict=False))
    robot.loop(last, "base", (0.1, 0.1, 0.1), "weld")
    return robot.text


def welded_arms() -> str:
    robot = Drawn()
    left = (turn("z"), turn("y"), turn("y"), "helical, axis: x, pitch: 1/100")
    right = (turn("z"), turn("y"), turn("[1, 2, 2]"), turn("x"))
    here = (ZERO, (0, 0, 0.3), (0.3, 0, 0.3), (0.5, 0, 0.5))
    there = ((1.2, 0, 0), (1.2, 0, 0.3), (1, 0.1, 0.4), (0.8, 0, 0.5))
    ends = [
        robot.chain(name, "base", *zip(points, joints, strict=True))
        for name, points, joints in (("l", here, left), ("r", there, right))
    ]
    robot.loop(*ends, (0.6, 0, 0.5), "weld")
    return robot.text


TOP = ((1, 1, 4), (-2, 0, 4), (1, -2, 5))
LINKAGES = {
    "Peaucellier": Case(1, 14, peaucellier()),
    "Peaucellier, moved": Case(
        1, 14, at(peaucellier(), "crank: 0.2733, a: 0.1303, b: 0.143")
    ),
    "Peaucellier, rhombus folded": Case(
        2,
        11,
        at(
            peaucellier(),
            "crank: 0.1076, a: -1.2322, anear: -0.6776, afar: 1.6212, b: 0.0548, bfar: -1.6314",
        ),
    ),
    "octahedron": Case(1, 22, octahedron()),
    "scissor lift": Case(1, 5, scissors(3)),
    "scissor lift, folded": Case(
        2,
        6,
        at(
            scissors(2),
            "left0: -2.4, foot: -4, right0: 2.0281, left1: 1.0122, right1: -2.697",
        ),
    ),
    "Jansen": Case(1, 18, jansen(1)),
    "Jansen, three legs": Case(1, 48, jansen(3), slow=True),
    "parallelograms in series": Case(4, 12, parallelograms(4)),
    "sliding coupler": Case(1, 8, sliding_coupler()),
    "spherical five bar": Case(2, 18, spherical(5)),
    "Sarrus, oblique": Case(1, 8, sarrus(raised=False)),
    "Sarrus, oblique and raised": Case(1, 8, sarrus(raised=True), slow=True),
    "excavator with oblique cylinders": Case(4, 42, excavator()),
    "agile eye": Case(3, 33, agile_eye()),
    "universal joints in series": Case(3, 24, universal_chain()),
    "3-UPU": Case(3, 43, three_upu(parallel=True), slow=True),
    "3-UPU, general": Case(3, 64, three_upu(parallel=False), slow=True),
    "3-PRS": Case(3, 19, three_prs()),
    "Gough-Stewart, 3-3": Case(
        6,
        82,
        gough(
            ((3, 0, 0), (-2, 3, 0), (-2, -4, 0)),
            TOP,
            ((0, 0), (0, 2), (1, 0), (1, 1), (2, 1), (2, 2)),
        ),
        slow=True,
    ),
    "Gough-Stewart, 6-3": Case(
        6,
        82,
        gough(
            ((3, 1, 0), (3, -1, 0), (-1, 3, 0), (-2, 2, 0), (-2, -3, 0), (-1, -4, 0)),
            TOP,
            ((0, 0), (1, 2), (2, 0), (3, 1), (4, 1), (5, 2)),
        ),
        slow=True,
    ),
    "Delta": Case(9, 55, delta("spherical"), slow=True),
    "Delta, crosses": Case(3, 34, delta("universal, axis: x, axis2: y")),
    "screw jack": Case(1, 15, screw_jack()),
    "car jack": Case(2, 20, car_jack()),
    "screws in parallel": Case(1, 10, screws_in_parallel()),
    "differential screw": Case(1, 4, differential_screw()),
    "welded, seven revolutes": Case(1, 31, welded(*map(turn, "zxyzxyz")), slow=True),
    "welded, with slides": Case(
        1,
        24,
        welded(
            turn("z"),
            slide("x"),
            turn("y"),
            turn("[1, 2, 2]"),
            slide("z"),
            turn("x"),
            turn("z"),
        ),
        slow=True,
    ),
    "welded arms, with a screw": Case(2, 40, welded_arms(), slow=True),
}
