"""Linkages for `loop_oracle`: mechanics of loops from the definitions, with 75 digits and nothing of the package.

A body is a 4 x 4 pose, a joint a product of exponentials of twists, a closure the entries of the pose of one frame in
another that are those of the identity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flint import arb, arb_mat, ctx

ctx.dps = 75
CLOSED = 1e-60
"""What a closure, and its first and second rate, may miss by."""

POINT, TURN = [(0, 3), (1, 3), (2, 3)], [(i, j) for i in range(3) for j in range(3)]
AXIS = [(0, 2), (1, 2), (2, 2)]
KINDS = {
    "point": POINT,
    "weld": POINT + TURN,
    "revolute": POINT + AXIS,
    "axis": POINT[:2] + AXIS,
    "prismatic": POINT[:2] + TURN,
    "planar": POINT[2:] + AXIS,
    "universal": [*POINT, (0, 1)],
    "point_on_axis": POINT[:2],
    "point_on_plane": POINT[2:],
}
"""The entries of the second frame's pose in the first frame that are those of the identity; axes are z."""


def number(value: str | float) -> arb:
    return arb(value).mid()


def matrix(rows: Sequence[Sequence[object]]) -> arb_mat:
    return arb_mat([list(row) for row in rows])


ONE = matrix([[int(i == j) for j in range(4)] for i in range(4)])
NOTHING = ONE - ONE


def twist(turn: Sequence[object], shift: Sequence[object]) -> arb_mat:
    """The 4 x 4 matrix of an angular velocity and the velocity of the origin."""
    x, y, z = turn
    rows = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    return matrix(
        [*([*row, end] for row, end in zip(rows, shift, strict=True)), [0, 0, 0, 0]]
    )


def turning(axis: Sequence[arb], point: Sequence[object] = (0, 0, 0)) -> arb_mat:
    """The twist of a rotation about an axis through a point."""
    size = sum(a * a for a in axis).sqrt()
    x, y, z = (a / size for a in axis)
    px, py, pz = point
    return twist((x, y, z), (py * z - pz * y, pz * x - px * z, px * y - py * x))


def sliding(axis: Sequence[arb]) -> arb_mat:
    size = sum(a * a for a in axis).sqrt()
    return twist((0, 0, 0), [a / size for a in axis])


def moved(by: arb_mat, amount: arb) -> arb_mat:
    """The pose after a motion: T^2 = 0 for a translation, T^4 = -T^2 for a rotation or a screw."""
    square = by * by
    if all(float(abs(entry)) < 1e-30 for entry in square.entries()):
        return ONE + by * amount
    return (
        ONE
        + by * amount
        + square * (1 - amount.cos())
        + square * by * (amount - amount.sin())
    )


@dataclass(frozen=True)
class Body:
    """A body: its parent (-1 the ground), its pose there while its motions are at zero, and their twists, in order."""

    name: str
    parent: int
    pose: arb_mat
    motions: tuple[arb_mat, ...] = ()


@dataclass(frozen=True)
class Loop:
    """Two bodies (-1 the ground) with the frames that a closure of a kind of `KINDS` keeps together."""

    kind: str
    first: int
    second: int
    at: arb_mat
    on: arb_mat


@dataclass(frozen=True)
class State:
    """World poses, twists, and bias accelerations of a linkage that moves."""

    q: Sequence[arb]
    qd: Sequence[arb]
    poses: list[arb_mat]
    axes: list[arb_mat]
    rates: list[arb_mat]
    biases: list[arb_mat]


def function(coefficients: object, x: arb) -> tuple[arb, arb, arb]:
    """c1 x + c2 x^2 + ..., its slope and its second derivative; one number stands for c1 alone."""
    several = coefficients if isinstance(coefficients, tuple) else (coefficients,)
    terms = [(number(c), k) for k, c in enumerate(several, start=1)]
    value = sum((c * x**k for c, k in terms), arb(0))
    slope = sum((c * k * x ** (k - 1) for c, k in terms), arb(0))
    return (
        value,
        slope,
        sum((c * k * (k - 1) * x ** (k - 2) for c, k in terms[1:]), arb(0)),
    )


@dataclass(frozen=True)
class Linkage:
    """Bodies in the order of the tree, loops, and ties: functions of coordinates whose sum is constant."""

    bodies: tuple[Body, ...]
    loops: tuple[Loop, ...]
    start: tuple[float, ...]
    ties: tuple[dict[int, object], ...] = ()
    gravity: tuple[object, ...] = (0, 0, "-9.81")

    @cached_property
    def chains(self) -> list[list[int]]:
        """The coordinates that move each body; the last entry is the ground's."""
        found: list[list[int]] = []
        count = 0
        for body in self.bodies:
            own = list(range(count, count + len(body.motions)))
            found.append([*(found[body.parent] if body.parent >= 0 else []), *own])
            count += len(own)
        return [*found, []]

    def state(self, q: Sequence[arb], qd: Sequence[arb]) -> State:
        poses, rates, biases = [ONE], [NOTHING], [NOTHING]
        axes: list[arb_mat] = []
        for body in self.bodies:
            pose = poses[body.parent + 1] * body.pose
            rate, bias = rates[body.parent + 1], biases[body.parent + 1]
            for motion in body.motions:
                axis = pose * motion * pose.inv()
                bias = bias + (rate * axis - axis * rate) * qd[len(axes)]
                rate = rate + axis * qd[len(axes)]
                pose = pose * moved(motion, q[len(axes)])
                axes.append(axis)
            poses.append(pose)
            rates.append(rate)
            biases.append(bias)
        return State(
            q,
            qd,
            [*poses[1:], ONE],
            axes,
            [*rates[1:], NOTHING],
            [*biases[1:], NOTHING],
        )

    def residual(self, q: Sequence[arb]) -> list[arb]:
        at = self.state(q, [arb(0)] * len(q))
        missed: list[arb] = []
        for loop in self.loops:
            pose = (
                (at.poses[loop.first] * loop.at).inv() * at.poses[loop.second] * loop.on
            )
            missed += [(pose - ONE)[entry] for entry in KINDS[loop.kind]]
        for tie in self.ties:
            ends = (
                (function(c, q[j])[0], function(c, number(self.start[j]))[0])
                for j, c in tie.items()
            )
            missed.append(sum((here - there for here, there in ends), arb(0)))
        return missed

    def jacobian(self, at: State) -> arb_mat:
        columns: list[list[arb]] = []
        for j, axis in enumerate(at.axes):
            column: list[arb] = []
            for loop in self.loops:
                sign = (j in self.chains[loop.second]) - (j in self.chains[loop.first])
                first, second = (
                    at.poses[loop.first] * loop.at,
                    at.poses[loop.second] * loop.on,
                )
                change = first.inv() * axis * second * sign if sign else NOTHING
                column += [change[entry] for entry in KINDS[loop.kind]]
            columns.append(
                column + [function(tie.get(j, 0), at.q[j])[1] for tie in self.ties]
            )
        return arb_mat(columns).transpose()

    def bias(self, at: State) -> list[arb]:
        """The second rate of the closure equations while the coordinates' accelerations are zero."""
        found: list[arb] = []
        for loop in self.loops:
            first, second = (
                at.poses[loop.first] * loop.at,
                at.poses[loop.second] * loop.on,
            )
            slow, fast = at.rates[loop.first], at.rates[loop.second]
            apart = fast - slow
            rate = (
                at.biases[loop.second]
                - at.biases[loop.first]
                + apart * fast
                - slow * apart
            )
            change = first.inv() * rate * second
            found += [change[entry] for entry in KINDS[loop.kind]]
        bends = [
            [function(c, at.q[j])[2] * at.qd[j] ** 2 for j, c in tie.items()]
            for tie in self.ties
        ]
        return found + [sum(terms, arb(0)) for terms in bends]

    def closed(self, guess: Sequence[arb], constraints: int | None = None) -> list[arb]:
        """Closed coordinates near a guess, by Newton steps of least length; their sixteen digits add up to all.

        Where loops are redundantly constrained, only as many constraints as are known to be independent are followed:
        away from closed poses the others contradict them.
        """
        q = [value.mid() for value in guess]
        for _ in range(200):
            missed = self.residual(q)
            scale = max((float(abs(value).mid()) for value in missed), default=0.0)
            if scale < CLOSED:
                return q
            left, sizes, right = np.linalg.svd(
                doubles(self.jacobian(self.state(q, [arb(0)] * len(q)))),
                full_matrices=False,
            )
            count = constraints or int(np.sum(sizes > 1e-7 * sizes[0]))
            error = np.array([float((value / scale).mid()) for value in missed])
            step = right[:count].T @ ((left[:, :count].T @ error) / sizes[:count])
            length = max(np.abs(step).max() * scale / 0.3, 1.0)
            q = [
                (a - number(float(b)) * number(scale / length)).mid()
                for a, b in zip(q, step, strict=True)
            ]
        raise ArithmeticError(f"no closed pose here: closures miss by {scale:.1e}")


def doubles(values: arb_mat) -> np.ndarray:
    flat = [float(entry.mid()) for entry in values.entries()]
    return np.array(flat).reshape(values.nrows(), values.ncols())
