"""Random robots with special numbers planted: zeros, equal lengths, parallel axes, rounded wrists, slanted directions.

A planted robot knows each of its numbers twice: as the file writes it, and as what it was rounded from.  So it has two
true ranks, that of the literal and that of the intended reading; see :mod:`truth`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

import flint
import numpy as np
from flint import arb

from support import ball_rank as truth
from support.ball_rank import BITS, Body, Move, Place, Vec, number, unit, vector

LENGTHS = ("0.11", "0.17", "0.23", "0.31", "0.43")
ANGLES = ("0.32", "0.4", "0.63", "0.76", "1.04", "1.12")
"""Neither these, nor sums of up to three of them, come near multiples of 15°."""

KINDS = (
    "revolute",
    "prismatic",
    "helical",
    "cylindrical",
    "universal",
    "spherical",
    "planar",
    "floating",
)
DIRECTIONS = ("x", "y", "z")


@dataclass(frozen=True)
class Written:
    """A number of a file, what the file says, and what it stands for."""

    text: str
    literal: arb
    intended: arb
    symbol: str | None = None


Triple = tuple[Written, Written, Written]


def plain(text: str) -> Written:
    """A decimal that means what it says."""
    return Written(text, number(text), number(text))


def negative(x: Written) -> Written:
    """The opposite number."""
    text = x.text.removeprefix("-") if x.text.startswith("-") else f"-{x.text}"
    with flint.ctx.workprec(BITS):
        return Written(text, -x.literal, -x.intended)


def rounded(value: arb, digits: int = 8) -> Written:
    """An exact number, written with some decimals."""
    text = f"{float(value.mid()):.{digits}f}"
    return Written(text, number(text), value)


ZERO = plain("0")
with flint.ctx.workprec(BITS):
    HALF = arb.pi() / 2


def triple(x: Written = ZERO, y: Written = ZERO, z: Written = ZERO) -> Triple:
    return x, y, z


AXES = {"x": triple(x=plain("1")), "y": triple(y=plain("1")), "z": triple(z=plain("1"))}


@dataclass(frozen=True)
class Link:
    """A link with the joint that holds it; fixed links belong to what carries them."""

    kind: str
    xyz: Triple = (ZERO, ZERO, ZERO)
    rpy: Triple = (ZERO, ZERO, ZERO)
    axis: Triple = AXES["z"]
    pitch: Written = ZERO


@dataclass(frozen=True)
class Robot:
    """A chain of links, as a URDF file or as a description."""

    family: str
    links: tuple[Link, ...]
    gravity: Triple = (ZERO, ZERO, plain("-9.81"))
    described: bool = field(default=False)

    def rank(self, intended: bool) -> int:
        """The truth."""

        def values(numbers: Triple) -> Vec:
            return vector(*(x.intended if intended else x.literal for x in numbers))

        bodies: list[Body] = []
        waiting: list[Place | Move] = []
        with flint.ctx.workprec(BITS):
            for link in self.links:
                waiting.append(Place(values(link.xyz), values(link.rpy)))
                if link.kind != "fixed":
                    pitch = link.pitch.intended if intended else link.pitch.literal
                    bodies.append(
                        Body(
                            len(bodies) - 1,
                            (*waiting, *moves(link.kind, values(link.axis), pitch)),
                        )
                    )
                    waiting = []
            return truth.rank(bodies, values(self.gravity))

    @property
    def suffix(self) -> str:
        return ".yaml" if self.described else ".urdf"

    @property
    def text(self) -> str:
        """The file."""
        return self._description() if self.described else self._urdf()

    def _urdf(self) -> str:
        parts = [f'<robot name="{self.family}"><link name="base"/>']
        inertia = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        for k, link in enumerate(self.links):
            limits = '<limit lower="-3" upper="3" effort="9" velocity="9"/>'
            parts.append(
                f'<link name="l{k}"><inertial>{inertia}</inertial></link><joint name="j{k}" type="{link.kind}">'
                f'<parent link="{f"l{k - 1}" if k else "base"}"/><child link="l{k}"/>'
                f'<origin xyz="{_joined(link.xyz)}" rpy="{_joined(link.rpy)}"/><axis xyz="{_joined(link.axis)}"/>'
                f"{limits}</joint>"
            )
        return "\n".join([*parts, "</robot>"])

    def _description(self) -> str:
        symbols: dict[str, str] = {}

        def entry(x: Written) -> str:
            if x.symbol is None:
                return x.text
            symbols[x.symbol] = x.text
            return x.symbol

        def entries(numbers: Triple) -> str:
            return "[" + ", ".join(map(entry, numbers)) + "]"

        bodies = []
        for k, link in enumerate(self.links):
            axis = next(
                (name for name, known in AXES.items() if known == link.axis),
                entries(link.axis),
            )
            keys = (
                ""
                if link.kind in ("fixed", "spherical", "floating")
                else f", axis: {axis}"
            )
            keys += f", pitch: {entry(link.pitch)}" if link.kind == "helical" else ""
            keys += f", axis2: {_next(axis)}" if link.kind == "universal" else ""
            origin = f"{{xyz: {entries(link.xyz)}, rpy: {entries(link.rpy)}}}"
            parent = f", parent: l{k - 1}" if k else ""
            bodies.append(
                f"  - {{name: l{k}{parent}, joint: {{type: {link.kind}{keys}, origin: {origin}}}}}"
            )
        gravity = entries(self.gravity)
        stated = ", ".join(f"{name}: {value}" for name, value in symbols.items())
        head = f"echelon: 1\nname: {self.family}\nsymbols: {{{stated}}}\ngravity: {gravity}\nbodies:\n"
        return head + "\n".join(bodies) + "\n"


def _joined(numbers: Triple) -> str:
    return " ".join(x.text for x in numbers)


def _next(axis: str) -> str:
    return DIRECTIONS[(DIRECTIONS.index(axis) + 1) % 3]


def moves(kind: str, axis: Vec, pitch: arb) -> list[Move]:
    """The freedoms of a joint, one after another; balls as three turns, which see the same at random angles."""
    x, y, z = vector(1, 0, 0), vector(0, 1, 0), vector(0, 0, 1)
    slides, turns = (
        [Move(d, False, arb(1)) for d in (x, y, z)],
        [Move(d, True) for d in (x, y, z)],
    )
    if kind == "planar":
        # two directions in the plane: any that are perpendicular to the normal
        first = truth.cross(
            axis, x if not axis[1].is_zero() or not axis[2].is_zero() else y
        )
        second = truth.cross(axis, first)
        return [
            Move(first, False, arb(1)),
            Move(second, False, arb(1)),
            Move(axis, True),
        ]
    return {
        "revolute": [Move(axis, True)],
        "continuous": [Move(axis, True)],
        "prismatic": [Move(axis, False, arb(1))],
        "helical": [Move(axis, True, pitch)],
        "cylindrical": [Move(axis, False, arb(1)), Move(axis, True)],
        "universal": [Move(axis, True), Move(vector(axis[2], axis[0], axis[1]), True)],
        "spherical": turns,
        "floating": [*slides, *turns],
    }[kind]


# -- pieces ------------------------------------------------------------------------------------------------------------


class Dice:
    """Random choices of one robot."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)

    def pick(self, options: Sequence[str]) -> str:
        return options[int(self.rng.integers(len(options)))]

    def yes(self, chance: float = 0.5) -> bool:
        return bool(self.rng.random() < chance)

    def length(self) -> Written:
        x = plain(self.pick(LENGTHS))
        return negative(x) if self.yes() else x

    def angle(self) -> Written:
        x = plain(self.pick(ANGLES))
        return negative(x) if self.yes() else x

    def lengths(self) -> Triple:
        """An offset, some parts of which are zero."""
        return triple(*(self.length() if self.yes(0.6) else ZERO for _ in range(3)))

    def general(self, kind: str = "revolute") -> Link:
        """A joint in no special place."""
        return Link(
            kind, self.lengths(), triple(self.angle(), self.angle(), self.angle())
        )

    def first(self) -> Link:
        """A first joint, along gravity or across it."""
        return Link("revolute", axis=AXES[self.pick(("z", "z", "x"))])

    def end(self) -> list[Link]:
        """None or one more joint that is in no special place."""
        return [self.general()] if self.yes() else []


def turn(along: str, angle: Written) -> Triple:
    """Angles of a turn about one coordinate axis."""
    return triple(**{along: angle})


def total(*numbers: Written) -> Written:
    """The sum of decimals, as a decimal."""
    value = sum((Fraction(x.text) for x in numbers), Fraction(0))
    return plain(f"{float(value):.6f}".rstrip("0").rstrip(".")) if value else ZERO


def degrees(value: int, digits: int) -> Written:
    with flint.ctx.workprec(BITS):
        return rounded(arb.pi() * value / 180, digits)


# -- families ----------------------------------------------------------------------------------------------------------


def zeros(dice: Dice) -> Robot:
    """Joints of all types; some symbols have the value zero."""
    return _described(
        "zeros", dice, lambda _: "0" if dice.yes(0.6) else dice.pick(LENGTHS)
    )


def equals(dice: Dice) -> Robot:
    """Joints of all types; symbols of few different values, of both signs."""
    pool = dice.pick(LENGTHS), dice.pick(LENGTHS)
    return _described(
        "equals", dice, lambda _: ("-" if dice.yes() else "") + dice.pick(pool)
    )


def _described(family: str, dice: Dice, value: Callable[[str], str]) -> Robot:
    def symbol(name: str) -> Written:
        return replace(plain(value(name)), symbol=name)

    right = Written("pi/2", HALF, HALF)
    mostly = (
        ("revolute", "revolute", "prismatic") if dice.yes() else KINDS
    )  # in chains of such, special numbers matter
    links = []
    for k in range(2 + dice.rng.integers(3)):
        kind = dice.pick(mostly)
        xyz = triple(
            *(symbol(f"{axis}{k}") if dice.yes(0.7) else ZERO for axis in DIRECTIONS)
        )
        options = [ZERO, right, right, dice.angle()]
        rpy = triple(options[dice.rng.integers(4)], options[dice.rng.integers(3)])
        pitch = replace(plain("0.05"), symbol=f"h{k}")
        links.append(
            Link(
                kind,
                xyz if k else triple(),
                rpy if k else triple(),
                AXES[dice.pick(DIRECTIONS)],
                pitch,
            )
        )
    return Robot(family, tuple(links), described=True)


def tables(dice: Dice) -> Robot:
    """Rows a, α, d as in a table, whose symbols are zero or equal more often than not."""
    length = dice.pick(LENGTHS)
    pool = ("0", "0", length, length, f"-{length}")
    quarters = ZERO, ZERO, ZERO, Written("pi/2", HALF, HALF), dice.angle()
    links = [dice.first()]
    for k in range(2 + dice.rng.integers(2)):
        for row in range(2 if dice.yes(0.3) else 1):
            a = replace(plain(dice.pick(pool)), symbol=f"a{k}{row}")
            links.append(
                Link("fixed", triple(a), triple(quarters[dice.rng.integers(5)]))
            )
        d = replace(plain(dice.pick(pool)), symbol=f"d{k}")
        links.append(
            Link(
                dice.pick(("revolute", "revolute", "revolute", "prismatic")),
                triple(z=d),
            )
        )
    return Robot("tables", tuple(links), described=True)


def lengths_that_cancel(dice: Dice) -> Robot:
    """Offsets along fixed joints that sum to zero: axes meet that seem not to."""
    along = dice.pick(DIRECTIONS)
    a, b = dice.length(), dice.length()
    steps = [a, b, negative(total(a, b))]
    described = dice.yes()
    if described:  # a reader adds numbers, but not symbols
        steps = [replace(x, symbol=f"s{k}") for k, x in enumerate(steps)]
    fixed = [Link("fixed", turn(along, x)) for x in steps[:2]]
    if dice.yes():  # on one line with the first axis, or on a line that meets it
        links = [Link("revolute"), *fixed, Link("revolute", turn(along, steps[2]))]
    else:
        aside = turn(along, dice.angle())
        links = [
            dice.first(),
            *fixed,
            Link("revolute", turn(along, steps[2]), aside, AXES[dice.pick(DIRECTIONS)]),
        ]
    return Robot("lengths", (*links, *dice.end()), described=described)


def angles_that_cancel(dice: Dice) -> Robot:
    """Parallel axes behind a chain of fixed joints with decimal angles that sum to zero."""
    along = dice.pick(("x", "y"))
    a, b = dice.angle(), dice.angle()
    chain = [Link("fixed", dice.lengths(), turn(along, x)) for x in (a, b)]
    parallel = Link(
        dice.pick(("revolute", "prismatic")),
        dice.lengths(),
        turn(along, negative(total(a, b))),
    )
    return Robot("angles", (dice.first(), *chain, parallel, *dice.end()))


def halves(dice: Dice) -> Robot:
    """0.3 − 0.15 − 0.15: parallel axes again, the parts on both sides of an inner joint of the same axis."""
    along = dice.pick(("x", "y"))
    part = plain(dice.pick(("0.16", "0.2", "0.38", "0.52")))
    whole = negative(total(part, part))
    links = [
        Link("fixed", dice.lengths(), turn(along, whole)),
        Link("fixed", dice.lengths(), turn(along, part)),
    ]
    inner = (
        [Link("revolute", dice.lengths(), axis=AXES[along])] if dice.yes(0.3) else []
    )
    return Robot(
        "halves",
        (
            dice.first(),
            *links,
            *inner,
            Link("revolute", dice.lengths(), turn(along, part)),
        ),
    )


def right_angles(dice: Dice) -> Robot:
    """Two rounded angles that make a right angle: 65° and 25°."""
    along = dice.pick(("x", "y"))
    digits, one = int(dice.rng.integers(5, 9)), int(dice.pick(("65", "50", "17", "38")))
    first, second = degrees(one, digits), degrees(90 - one, digits)
    chain = Link("fixed", dice.lengths(), turn(along, first))
    square = Link("revolute", dice.lengths(), turn(along, second))
    return Robot("right angles", (dice.first(), chain, square, *dice.end()))


def wrists(dice: Dice) -> Robot:
    """Axes through one point, or on one line, behind offsets in rounded numbers that lead away and back."""
    along, digits = dice.pick(("x", "y")), int(dice.rng.integers(6, 9))
    tilt, reach = dice.angle(), dice.length()
    with flint.ctx.workprec(BITS):
        axis = vector(*(int(along == name) for name in DIRECTIONS))
        out = triple(
            *(
                rounded(x, digits)
                for x in truth.rotation(axis, tilt.intended)
                @ vector(0, 0, reach.intended)
            )
        )
    last = turn("y" if along == "x" else "x", dice.angle())
    if dice.yes():  # an axis that stands out there, aims at the centre, and the next one in the centre
        links = [
            Link("revolute", out, turn(along, tilt)),
            Link("revolute", triple(z=negative(reach)), last),
        ]
    else:  # out and back without a joint, to the first axis again
        links = [
            Link("fixed", out, turn(along, tilt)),
            Link("fixed", triple(z=negative(reach))),
        ]
        links.append(
            Link(
                dice.pick(("revolute", "cylindrical")), rpy=turn(along, negative(tilt))
            )
        )
        links.append(Link("revolute", dice.lengths(), last))
    described = any(link.kind == "cylindrical" for link in links)
    return Robot("wrists", (Link("revolute"), *links), described=described)


def slanted(dice: Dice) -> Robot:
    """One direction as 1 2 3, as a multiple, and to some digits."""
    whole = dice.rng.choice([[1, 2, 3], [2, -1, 2], [1, 1, 1], [3, 0, 4], [-1, 2, 5]])
    with flint.ctx.workprec(BITS):
        exact = unit(vector(*map(int, whole)))
        digits = int(dice.rng.integers(5, 9))
        ways = [
            triple(*(plain(str(int(x))) for x in whole)),
            triple(*(plain(str(2 * int(x))) for x in whole)),
            triple(*(rounded(x, digits) for x in exact)),
        ]
    count = 2 if dice.yes() else 3
    order = dice.rng.permutation(3)[:count]
    links = [
        Link(
            dice.pick(("revolute", "revolute", "prismatic")),
            dice.lengths(),
            axis=ways[k],
        )
        for k in order
    ]
    return Robot(
        "slanted", (*(replace(x, xyz=dice.lengths()) for x in links), *dice.end())
    )


def slanted_exactly(dice: Dice) -> Robot:
    """One direction as whole numbers and as multiples of them, which agree literally."""
    whole = dice.rng.choice([[1, 2, 3], [2, -1, 2], [1, 1, 1], [3, 0, 4]])
    factors = [Fraction(1), Fraction(2), Fraction(1, 10), Fraction(-3)]
    links = []
    for k in dice.rng.permutation(4)[:2]:
        axis = triple(*(plain(str(float(factors[k] * int(x)))) for x in whole))
        links.append(Link("revolute", dice.lengths(), axis=axis))
    return Robot(
        "slanted exactly",
        (dice.first(), *links) if dice.yes() else (*links, *dice.end()),
    )


def gravity(dice: Dice) -> Robot:
    """A first axis along gravity that no coordinate axis is: tilted back, or a slanted direction of whole numbers."""
    if dice.yes():
        along, angle = dice.pick(("x", "y")), dice.angle()
        chain = [
            Link("fixed", rpy=turn(along, angle)),
            Link("fixed", rpy=turn(along, negative(angle))),
        ]
        return Robot("gravity", (*chain, Link("revolute"), dice.general(), *dice.end()))
    axis = triple(plain("1"), plain("2"), plain("2"))
    down = triple(*(plain(x) for x in ("-3.27", "-6.54", "-6.54")))
    links = Link("revolute", axis=axis), dice.general(), *dice.end()
    return Robot("gravity", links, down, described=True)


def undone(dice: Dice) -> Robot:
    """A general turn, and its inverse in rounded angles: parallel axes."""
    digits = int(dice.rng.integers(6, 9))
    rpy = triple(dice.angle(), dice.angle(), dice.angle())
    with flint.ctx.workprec(BITS):
        inverse = Place(vector(0, 0, 0), vector(*(x.intended for x in rpy))).matrix.T
        roll = arb.atan2(inverse[2, 1], inverse[2, 2])
        pitch = arb.atan2(
            -inverse[2, 0], (inverse[2, 1] ** 2 + inverse[2, 2] ** 2).sqrt()
        )
        yaw = arb.atan2(inverse[1, 0], inverse[0, 0])
        back = triple(*(rounded(x, digits) for x in (roll, pitch, yaw)))
    there = Link("fixed", dice.lengths(), rpy)
    return Robot(
        "undone",
        (dice.first(), there, Link("revolute", dice.lengths(), back), *dice.end()),
    )


def undone_exactly(dice: Dice) -> Robot:
    """A general turn undone one angle after another, in decimals: parallel axes, literally."""
    angles = dice.angle(), dice.angle(), dice.angle()
    there = [Link("fixed", dice.lengths(), triple(*angles))]
    back = [
        Link("fixed", rpy=turn(d, negative(x)))
        for d, x in zip(DIRECTIONS[:2], angles[:2], strict=True)
    ]
    last = Link(
        dice.pick(("revolute", "prismatic")),
        dice.lengths(),
        turn("z", negative(angles[2])),
    )
    return Robot("undone exactly", (dice.first(), *there, *back, last, *dice.end()))


def files(dice: Dice) -> Robot:
    """Every joint type of a URDF file, with repeated and missing lengths and right angles to five digits."""
    kinds = ("revolute", "continuous", "prismatic", "planar", "floating", "fixed")
    quarter = degrees(90, int(dice.rng.integers(5, 9)))
    links = []
    for k in range(3 + dice.rng.integers(2)):
        rpy = turn(dice.pick(("x", "y")), quarter if dice.yes(0.7) else dice.angle())
        links.append(
            Link(
                dice.pick(kinds if k else kinds[:3]),
                dice.lengths(),
                rpy,
                AXES[dice.pick(DIRECTIONS)],
            )
        )
    links = [
        replace(x, kind="fixed") if x.kind == "floating" and k == 0 else x
        for k, x in enumerate(links)
    ]
    return Robot("files", tuple(links))


def general(dice: Dice) -> Robot:
    """Nothing special at all."""
    return Robot(
        "general",
        (dice.first(), dice.general(dice.pick(("revolute", "prismatic"))), *dice.end()),
    )


FAMILIES: dict[str, Callable[[Dice], Robot]] = {
    family.__name__: family
    for family in (
        zeros,
        equals,
        tables,
        lengths_that_cancel,
        angles_that_cancel,
        halves,
        right_angles,
        wrists,
        slanted,
        slanted_exactly,
        gravity,
        undone,
        undone_exactly,
        files,
        general,
    )
}


def robot(family: str, seed: int) -> Robot:
    """Robot number ``seed`` of a family."""
    return FAMILIES[family](Dice(1000 * sorted(FAMILIES).index(family) + seed))
