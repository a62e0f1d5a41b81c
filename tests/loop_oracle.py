"""Ranks of mechanisms with loops, by mechanics that shares nothing with the package.

A body is a 4 x 4 pose, a joint a product of exponentials of twists, a closure some entries of the pose of one frame in
another.  The parameters of a body are the ten entries of its pseudo-inertia P, the integral of X X' dm over its points
X = (x, y, z, 1), because the virtual power of a body that moves with T(t) is then just tr(dT P (T'' - G)').

Closed states are solved, and regressors computed, with 75 digits.  A rank is stated with the ratio of the smallest pivot
that is kept to the largest number that is dropped; without a gap of fifteen digits there is no answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from flint import arb, arb_mat, ctx

ctx.dps = 75
CLOSED = 1e-60
"""What a closure, and its first and second rate, may miss by."""
GAP = 1e15

POINT, TURN = [(0, 3), (1, 3), (2, 3)], [(i, j) for i in range(3) for j in range(3)]
AXIS = [(0, 2), (1, 2), (2, 2)]
KINDS = {"point": POINT, "weld": POINT + TURN, "revolute": POINT + AXIS, "axis": POINT[:2] + AXIS}
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
    return matrix([*([*row, end] for row, end in zip(rows, shift, strict=True)), [0, 0, 0, 0]])


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
    """The pose after a motion: T^3 = -T for a rotation, T^2 = 0 for a translation."""
    square = by * by
    if all(float(abs(entry)) < 1e-30 for entry in square.entries()):
        return ONE + by * amount
    return ONE + by * amount.sin() + square * (1 - amount.cos())


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

    poses: list[arb_mat]
    axes: list[arb_mat]
    rates: list[arb_mat]
    biases: list[arb_mat]


@dataclass(frozen=True)
class Linkage:
    """Bodies in the order of the tree, loops, and ties: coefficients of coordinates whose sum is constant."""

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
        return State([*poses[1:], ONE], axes, [*rates[1:], NOTHING], [*biases[1:], NOTHING])

    def residual(self, q: Sequence[arb]) -> list[arb]:
        at = self.state(q, [arb(0)] * len(q))
        missed: list[arb] = []
        for loop in self.loops:
            pose = (at.poses[loop.first] * loop.at).inv() * at.poses[loop.second] * loop.on
            missed += [(pose - ONE)[entry] for entry in KINDS[loop.kind]]
        for tie in self.ties:
            missed.append(sum((number(c) * (q[j] - number(self.start[j])) for j, c in tie.items()), arb(0)))
        return missed

    def jacobian(self, at: State) -> arb_mat:
        columns: list[list[arb]] = []
        for j, axis in enumerate(at.axes):
            column: list[arb] = []
            for loop in self.loops:
                sign = (j in self.chains[loop.second]) - (j in self.chains[loop.first])
                first, second = at.poses[loop.first] * loop.at, at.poses[loop.second] * loop.on
                change = first.inv() * axis * second * sign if sign else NOTHING
                column += [change[entry] for entry in KINDS[loop.kind]]
            columns.append(column + [number(tie.get(j, 0)) for tie in self.ties])
        return arb_mat(columns).transpose()

    def bias(self, at: State) -> list[arb]:
        """The second rate of the closure equations while the coordinates' accelerations are zero."""
        found: list[arb] = []
        for loop in self.loops:
            first, second = at.poses[loop.first] * loop.at, at.poses[loop.second] * loop.on
            slow, fast = at.rates[loop.first], at.rates[loop.second]
            apart = fast - slow
            rate = at.biases[loop.second] - at.biases[loop.first] + apart * fast - slow * apart
            change = first.inv() * rate * second
            found += [change[entry] for entry in KINDS[loop.kind]]
        return found + [arb(0)] * len(self.ties)

    def closed(self, guess: Sequence[arb]) -> list[arb]:
        """Closed coordinates near a guess, by Newton steps of least length; their sixteen digits add up to all."""
        q = [value.mid() for value in guess]
        for _ in range(200):
            missed = self.residual(q)
            sizes = [float(abs(value).mid()) for value in missed]
            if max(sizes, default=0.0) < CLOSED:
                return q
            scale = max(sizes)
            slopes = doubles(self.jacobian(self.state(q, [arb(0)] * len(q))))
            right = np.array([float((value / scale).mid()) for value in missed])
            step = np.linalg.lstsq(slopes, right, rcond=1e-7)[0]
            length = max(np.abs(step).max() * scale / 0.3, 1.0)
            q = [(a - number(float(b)) * number(scale / length)).mid() for a, b in zip(q, step, strict=True)]
        raise ArithmeticError(f"no closed pose here: closures miss by {max(sizes):.1e}")


def doubles(values: arb_mat) -> np.ndarray:
    flat = [float(entry.mid()) for entry in values.entries()]
    return np.array(flat).reshape(values.nrows(), values.ncols())


def part(values: arb_mat, rows: Sequence[int], columns: Sequence[int]) -> arb_mat:
    width, entries = values.ncols(), values.entries()
    return arb_mat(len(rows), len(columns), [entries[i * width + j] for i in rows for j in columns])


def leading(values: np.ndarray) -> tuple[list[int], list[int], list[float]]:
    """Rows, columns and sizes of pivots that are not small beside the first one, with complete pivoting."""
    values = values.copy()
    rows, columns, sizes = [], [], []
    for _ in range(min(values.shape)):
        i, j = np.unravel_index(np.argmax(np.abs(values)), values.shape)
        pivot = values[i, j]
        if sizes and abs(pivot) < 1e-5 * sizes[0]:
            break
        rows.append(int(i))
        columns.append(int(j))
        sizes.append(abs(float(pivot)))
        values -= np.outer(values[:, j], values[i] / pivot)
        values[i], values[:, j] = 0.0, 0.0
    return rows, columns, sizes


@dataclass(frozen=True)
class Pivots:
    """Pivots of a matrix with the rows and columns they stand in, and the largest number that is left."""

    rows: list[int]
    columns: list[int]
    sizes: list[float]
    left: float

    @property
    def steps(self) -> list[tuple[int, float]]:
        """Ranks after which pivots fall by more than ten digits, and by how much: the last one is to zero."""
        falls = [a / b for a, b in pairwise([*self.sizes, self.left])]
        return [(i + 1, fall) for i, fall in enumerate(falls) if fall > 1e10]


def pivots(values: arb_mat, least: float = 1e-45) -> Pivots:
    """Elimination by blocks whose pivots are chosen in doubles."""
    free_rows, free_columns = list(range(values.nrows())), list(range(values.ncols()))
    rows, columns, sizes = [], [], []
    while True:
        largest = max((float(abs(entry).mid()) for entry in values.entries()), default=0.0)
        if largest <= least * max(sizes, default=1.0):
            return Pivots(rows, columns, sizes, max(largest, 1e-70))
        near = leading(doubles(values * (1 / number(largest))))
        i, j = near[:2]
        rows += [free_rows[k] for k in i]
        columns += [free_columns[k] for k in j]
        sizes += [size * largest for size in near[2]]
        others = (
            [k for k in range(values.nrows()) if k not in set(i)],
            [k for k in range(values.ncols()) if k not in set(j)],
        )
        if not all(others):
            return Pivots(rows, columns, sizes, 1e-70)
        change = part(values, others[0], j) * part(values, i, j).solve(part(values, i, others[1]))
        values = (part(values, *others) - change).mid()
        free_rows, free_columns = [free_rows[k] for k in others[0]], [free_columns[k] for k in others[1]]


@dataclass(frozen=True)
class Rank:
    """A rank with its degrees of freedom, and the fall of the pivots behind it."""

    freedom: int
    rank: int
    gap: float


class UnsettledError(ArithmeticError):
    """A rank that the numbers do not settle."""


def settled(found: Pivots, what: str) -> int:
    steps = found.steps
    if found.sizes and (len(steps) != 1 or steps[0][1] < GAP):
        raise UnsettledError(
            f"{what}: pivots fall after {steps}, the last of {len(found.sizes)} is {found.sizes[-1]:.1e}"
        )
    return len(found.sizes)


def virtual_powers(linkage: Linkage, q: list[arb], rng: np.random.Generator) -> list[list[arb]]:
    """The rows of the regressor on the independent motions, at random velocities and accelerations of a closed pose."""
    still = linkage.state(q, [arb(0)] * len(q))
    slopes = linkage.jacobian(still)
    found = pivots(slopes)
    settled(found, "freedom")
    free = [j for j in range(len(q)) if j not in set(found.columns)]
    square = part(slopes, found.rows, found.columns)
    follow = square.solve(part(slopes, found.rows, free) * -1).mid() if found.rows else arb_mat(0, len(free), [])

    def whole(independent: list[arb], offset: list[arb]) -> list[arb]:
        values = [arb(0)] * len(q)
        for j, value in zip(free, independent, strict=True):
            values[j] = value
        for i, j in enumerate(found.columns):
            values[j] = sum((follow[i, k] * value for k, value in enumerate(independent)), offset[i]).mid()
        return values

    def drawn() -> list[arb]:
        return [number(float(value)) for value in rng.normal(size=len(free))]

    zero = [arb(0)] * len(found.columns)
    qd = whole(drawn(), zero)
    at = linkage.state(q, qd)
    bias = linkage.bias(at)
    right = arb_mat(len(found.rows), 1, [-bias[i] for i in found.rows])
    qdd = whole(drawn(), square.solve(right).entries() if found.rows else zero)
    for rate, extra in ((qd, [arb(0)] * len(bias)), (qdd, bias)):
        if (
            bias
            and max(float(abs(v)) for v in (slopes * arb_mat(len(q), 1, rate) + arb_mat(len(bias), 1, extra)).entries())
            > 1e-40
        ):
            raise UnsettledError("the closures that were left out do not stay closed")
    motions = [whole([arb(int(k == d)) for k in range(len(free))], zero) for d in range(len(free))]
    return regressor(linkage, at, qdd, motions)


def regressor(linkage: Linkage, at: State, qdd: list[arb], motions: list[list[arb]]) -> list[list[arb]]:
    rows: list[list[arb]] = [[] for _ in motions]
    fall = matrix([*([0, 0, 0, number(g)] for g in linkage.gravity), [0, 0, 0, 0]])
    for b, body in enumerate(linkage.bodies):
        if not body.motions:
            continue  # fixed to its parent, whose parameters say all
        pose, rate, chain = at.poses[b], at.rates[b], linkage.chains[b]
        second = sum((at.axes[j] * qdd[j] for j in chain), at.biases[b]) + rate * rate
        pulled = second * pose - fall
        for row, motion in zip(rows, motions, strict=True):
            along = sum((at.axes[j] * motion[j] for j in chain), NOTHING)
            power = (along * pose).transpose() * pulled
            row += [power[i, j] if i == j else power[i, j] + power[j, i] for i in range(4) for j in range(i, 4)]
    return rows


def walk(linkage: Linkage, rng: np.random.Generator, step: float = 0.06) -> Iterator[list[arb]]:
    """Closed poses a few small steps away from the start, which stay in its assembly mode."""
    start = linkage.closed([number(value) for value in linkage.start])
    while True:
        q = start
        for _ in range(4):
            moved_on = rng.normal(scale=step, size=len(q))
            q = linkage.closed([value + number(float(d)) for value, d in zip(q, moved_on, strict=True)])
        yield q


def rank(linkage: Linkage, seed: int = 0) -> Rank:
    """The number of base parameters at the mode of the start, from more rows than there are columns."""
    rng = np.random.default_rng(seed)
    columns = 10 * sum(bool(body.motions) for body in linkage.bodies)
    rows: list[list[arb]] = []
    freedom = 0
    for count, q in enumerate(walk(linkage, rng)):
        drawn = virtual_powers(linkage, q, rng)
        freedom = len(drawn)
        rows += drawn
        if not freedom or (len(rows) > 1.2 * columns and count > 12):
            break
    found = pivots(arb_mat(rows))
    return Rank(freedom, settled(found, "rank"), found.steps[0][1] if found.sizes else np.inf)
