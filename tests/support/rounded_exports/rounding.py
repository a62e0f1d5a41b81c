"""Frames of links, and numbers as a file says them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property

import numpy as np
from flint import arb

from support.rounded_exports.export import Export
from support.rounded_exports.geometry import Mat, Vec, X, Y, Z, cross, exactly
from support.rounded_exports.mechanism import GROUND, Part, frame_along

NEUTRAL = np.array([X, Y, Z], dtype=object)
LEVEL = 1e-50
"""Below it, a cosine of a pitch is zero."""


@dataclass(frozen=True)
class Frame:
    """A rotation, whose columns are the axes, and an origin."""

    turn: Mat
    origin: Vec

    def local(self, point: Vec) -> Vec:
        return self.turn.T @ (point - self.origin)

    def within(self, parent: Frame) -> Frame:
        return Frame(parent.turn.T @ self.turn, parent.local(self.origin))


@dataclass(frozen=True)
class Rounded:
    """An export's frames in the world, and its numbers as text."""

    export: Export
    aligned: bool = False
    """Universal joints have x and y of their link along their axes."""

    @cached_property
    def frames(self) -> dict[str, Frame]:
        rng = np.random.default_rng(self.export.seed)
        exact = self.export.exact
        base = (
            drawn(rng) if self.export.frames == "random" and exact.floating else NEUTRAL
        )
        found = {GROUND: Frame(base, X * 0)}
        for part in exact.parts:
            found[part.name] = Frame(self._turn(part, rng), part.point)
            if self.export.frames == "random" and part.kind in ("hinge", "slide"):
                # anywhere on the axis, as drawing programs place it
                found[part.name] = replace(
                    found[part.name],
                    origin=part.point
                    + part.axes[0] * exactly(round(rng.uniform(-0.1, 0.1), 6)),
                )
        return found

    def _turn(self, part: Part, rng: np.random.Generator) -> Mat:
        if part.kind == "universal" and self.aligned:
            one, two = part.axes
            return np.column_stack([one, two, cross(one, two)])
        if self.export.frames == "random":
            return drawn(rng)
        return (
            frame_along(part.axes[0])
            if self.export.frames == "natural" and part.axes
            else NEUTRAL
        )

    def placed(self, part: Part) -> Frame:
        return self.frames[part.name].within(self.frames[part.parent])

    def axis(self, body: str, axis: Vec) -> str:
        return self.directions(self.frames[body].turn.T @ axis)

    def point(self, body: str, point: Vec) -> str:
        return self.lengths(self.frames[body].local(point))

    def directions(self, values: Vec) -> str:
        return " ".join(rounded(value, self.export.digits) for value in values)

    def lengths(self, values: Vec) -> str:
        return self.directions(values * (1000 if self.export.unit == "mm" else 1))

    def rpy(self, turn: Mat) -> str:
        return self.directions(angles(turn))

    def quaternion(self, turn: Mat) -> str:
        return self.directions(quaternion(turn))


def rounded(value: arb, digits: int) -> str:
    """A decimal number with so many decimals at most."""
    count = (value.mid() * 10**digits + arb(1) / 2).mid().floor().unique_fmpz()
    text = format(Decimal(int(count)).scaleb(-digits), "f")
    return text.rstrip("0").rstrip(".") if int(count) else "0"


def drawn(rng: np.random.Generator) -> Mat:
    return rotation_of([exactly(round(float(x), 15)) for x in rng.normal(size=4)])


def rotation_of(quaternion: list[arb]) -> Mat:
    w, x, y, z = quaternion
    size = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.array(rows, dtype=object) / size


def angles(turn: Mat) -> list[arb]:
    """Roll, pitch and yaw about the fixed axes x, y and z."""
    t = [[entry.mid() for entry in row] for row in turn]
    level = (t[0][0] * t[0][0] + t[1][0] * t[1][0]).sqrt().mid()
    pitch = arb.atan2(-t[2][0], level)
    if float(level) < LEVEL:
        return [arb.atan2(-t[1][2], t[1][1]), pitch, arb(0)]
    return [arb.atan2(t[2][1], t[2][2]), pitch, arb.atan2(t[1][0], t[0][0])]


def quaternion(turn: Mat) -> list[arb]:
    """W, x, y, z of length one, with the largest of them positive."""
    t = [[entry.mid() for entry in row] for row in turn]
    trace = t[0][0] + t[1][1] + t[2][2]
    # four times the squares and products of w, x, y, z
    table = [
        [1 + trace, t[2][1] - t[1][2], t[0][2] - t[2][0], t[1][0] - t[0][1]],
        [
            t[2][1] - t[1][2],
            1 + 2 * t[0][0] - trace,
            t[0][1] + t[1][0],
            t[0][2] + t[2][0],
        ],
        [
            t[0][2] - t[2][0],
            t[0][1] + t[1][0],
            1 + 2 * t[1][1] - trace,
            t[1][2] + t[2][1],
        ],
        [
            t[1][0] - t[0][1],
            t[0][2] + t[2][0],
            t[1][2] + t[2][1],
            1 + 2 * t[2][2] - trace,
        ],
    ]
    largest = max(range(4), key=lambda k: float(table[k][k]))
    return [entry / table[largest][largest].sqrt() / 2 for entry in table[largest]]
