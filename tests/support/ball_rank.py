"""The rank of a robot's regressor from numbers alone, in 1024-bit ball arithmetic: a truth from outside.

Nothing of Echelon is used.  Geometry is numeric; the dynamics are the textbook recursion in world axes (velocities and
accelerations outwards, wrenches of unit parameters, projected on every joint before the body); the rank is that of
random states by Gaussian elimination with full pivoting.  What is kept and what is dropped must lie 20 orders of
magnitude apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import flint
import numpy as np
import numpy.typing as npt
from flint import arb, fmpq

BITS = 1024
GAP = 1e-20

Vec = npt.NDArray[Any]
"""Balls, shape (3,)."""
Mat = npt.NDArray[Any]
"""Balls, shape (3, 3)."""


def number(text: str) -> arb:
    """A decimal number or an integer, exactly."""
    digits, _, power = text.lower().partition("e")
    whole, _, part = digits.partition(".")
    value = fmpq(int(whole + part), 10 ** len(part)) * fmpq(10) ** int(power or 0)
    with flint.ctx.workprec(BITS):
        return arb(value)


def vector(*entries: arb | int) -> Vec:
    return np.array([arb(x) for x in entries], dtype=object)


def cross(a: Vec, b: Vec) -> Vec:
    (ax, ay, az), (bx, by, bz) = a, b
    return vector(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def unit(axis: Vec) -> Vec:
    found: Vec = axis / (axis @ axis).sqrt()
    return found


def rotation(axis: Vec, angle: arb) -> Mat:
    """Rodrigues' formula for a unit axis."""
    x, y, z = axis
    zero = arb(0)
    skew = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]], dtype=object)
    one = np.array(
        [[arb(int(i == j)) for j in range(3)] for i in range(3)], dtype=object
    )
    found: Mat = one + angle.sin() * skew + (1 - angle.cos()) * (skew @ skew)
    return found


@dataclass(frozen=True)
class Place:
    """A fixed frame: shifted, then turned about z, y and x."""

    xyz: Vec
    rpy: Vec

    @property
    def matrix(self) -> Mat:
        found = rotation(vector(0, 0, 1), self.rpy[2]) @ rotation(
            vector(0, 1, 0), self.rpy[1]
        )
        found @= rotation(vector(1, 0, 0), self.rpy[0])
        return found


@dataclass(frozen=True)
class Move:
    """One freedom: a turn about an axis, a slide along it, or a screw of some pitch."""

    axis: Vec
    turns: bool
    pitch: arb | None = None
    """Metres per unit of the coordinate; None for a turn without a slide."""


@dataclass(frozen=True)
class Body:
    """A body with its ten parameters."""

    parent: int
    steps: Sequence[Place | Move]


@dataclass
class _Moving:
    """A frame in the world: where it is, how it moves, and how each coordinate before it moves it."""

    axes: Mat
    place: Vec
    spin: Vec
    velocity: Vec
    spin_rate: Vec
    acceleration: Vec
    freedoms: list[tuple[int, Vec, Vec, Vec]] = field(default_factory=list)
    """Coordinate, angular velocity and velocity at a point per unit of its rate, and that point."""

    def shifted(self, r: Vec) -> None:
        self.place = self.place + r
        self.velocity = self.velocity + cross(self.spin, r)
        self.acceleration = (
            self.acceleration
            + cross(self.spin_rate, r)
            + cross(self.spin, cross(self.spin, r))
        )

    def moved(self, move: Move, index: int, q: arb, v: arb, a: arb) -> None:
        axis = self.axes @ unit(move.axis)
        turning, sliding = (
            axis * int(move.turns),
            axis * (move.pitch if move.pitch is not None else 0),
        )
        self.freedoms.append((index, turning, sliding, self.place))
        if move.turns:
            self.spin_rate = self.spin_rate + axis * a + cross(self.spin, axis) * v
            self.spin = self.spin + axis * v
            self.axes = self.axes @ rotation(unit(move.axis), q)
        if move.pitch is not None:
            self.shifted(sliding * q)
            self.velocity = self.velocity + sliding * v
            self.acceleration = (
                self.acceleration + sliding * a + 2 * cross(self.spin, sliding) * v
            )

    def copy(self) -> _Moving:
        parts = (
            self.axes,
            self.place,
            self.spin,
            self.velocity,
            self.spin_rate,
            self.acceleration,
        )
        return _Moving(*parts, list(self.freedoms))


def regressor(
    bodies: Sequence[Body], gravity: Vec, rng: np.random.Generator
) -> npt.NDArray[Any]:
    """Generalised forces per unit parameter at a random state, shape (coordinates, 10 · bodies)."""
    coordinates = sum(isinstance(step, Move) for body in bodies for step in body.steps)
    q, v, a = (
        [arb(fmpq(int(x), 1000)) for x in rng.integers(-2000, 2000, coordinates)]
        for _ in range(3)
    )
    one = np.array(
        [[arb(int(i == j)) for j in range(3)] for i in range(3)], dtype=object
    )
    still = vector(0, 0, 0)
    frames: dict[int, _Moving] = {
        -1: _Moving(one, still, still, still, still, -gravity)
    }
    table = np.array(
        [[arb(0)] * (10 * len(bodies)) for _ in range(coordinates)], dtype=object
    )
    index = 0
    for number_, body in enumerate(bodies):
        frame = frames[body.parent].copy()
        for step in body.steps:
            if isinstance(step, Place):
                frame.shifted(frame.axes @ step.xyz)
                frame.axes = frame.axes @ step.matrix
            else:
                frame.moved(step, index, q[index], v[index], a[index])
                index += 1
        frames[number_] = frame
        for k, (force, moment) in enumerate(_wrenches(frame)):
            for j, turning, sliding, point in frame.freedoms:
                rate = sliding + cross(turning, frame.place - point)
                table[j, 10 * number_ + k] = rate @ force + turning @ moment
    return table


def _wrenches(frame: _Moving) -> list[tuple[Vec, Vec]]:
    """Force and moment about the frame's origin per unit of XX XY XZ YY YZ ZZ MX MY MZ M."""
    found = []
    w, alpha, acceleration = frame.spin, frame.spin_rate, frame.acceleration
    axes = [frame.axes[:, k] for k in range(3)]
    for i in range(3):
        for j in range(i, 3):
            on_alpha, on_w = (
                axes[i] * (axes[j] @ x) + (axes[j] * (axes[i] @ x) if i != j else 0)
                for x in (alpha, w)
            )
            found.append((vector(0, 0, 0), on_alpha + cross(w, on_w)))
    first = [
        (cross(alpha, c) + cross(w, cross(w, c)), cross(c, acceleration)) for c in axes
    ]
    return [*found, *first, (acceleration, vector(0, 0, 0))]


def rank(bodies: Sequence[Body], gravity: Vec, seed: int = 1) -> int:
    """Number of base parameters of a robot without symbols."""
    rng = np.random.default_rng(seed)
    coordinates = sum(isinstance(step, Move) for body in bodies for step in body.steps)
    if not coordinates:
        return 0
    # every coordinate gives one row per state, and a body may need ten of the same coordinate
    states = max(12, 10 * len(bodies) // coordinates + 3)
    with flint.ctx.workprec(BITS):
        pivots = elimination(
            np.concatenate([regressor(bodies, gravity, rng) for _ in range(states)])
        )
    sizes = [1.0, *pivots]
    kept = next(
        (k for k, (x, y) in enumerate(pairwise(sizes)) if y < GAP * x), len(pivots)
    )
    assert all(size < GAP**2 for size in pivots[kept:]), f"no clear gap: {pivots}"
    return kept


def elimination(table: npt.NDArray[Any]) -> list[float]:
    """Sizes of the pivots of Gaussian elimination with full pivoting, relative to the largest entry."""
    table = table.copy()
    size = np.vectorize(lambda x: abs(float(x.mid())), otypes=[float])
    largest, pivots = float(size(table).max()), []
    while table.size:
        sizes = size(table)
        row, column = np.unravel_index(int(sizes.argmax()), table.shape)
        pivots.append(float(sizes[row, column] / largest) if largest else 0.0)
        if pivots[-1] < GAP**3:
            break
        top, left = table[row], table[:, column] / table[row, column]
        keep_rows = [k for k in range(len(table)) if k != row]
        keep_columns = [
            k for k in range(table.shape[1]) if k != column and sizes[:, k].any()
        ]
        table = table[np.ix_(keep_rows, keep_columns)] - np.outer(
            left[keep_rows], top[keep_columns]
        )
    return pivots
