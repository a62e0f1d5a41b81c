"""Ranks of mechanisms with loops, by mechanics that shares nothing with the package.

The parameters of a body are the ten entries of its pseudo-inertia P, the integral of X X' dm over its points
X = (x, y, z, 1), because the virtual power of a body that moves with T(t) is then just tr(dT P (T'' - G)').

Closed states are solved, and regressors computed, with 75 digits.  A rank is stated with the ratio of the smallest
pivot that is kept to the largest number that is dropped; without a gap of fifteen digits there is no answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from flint import arb, arb_mat

from support.loop_linkage import NOTHING, Linkage, State, doubles, matrix, number

GAP = 1e15
FAINT = 1e-8


def part(values: arb_mat, rows: Sequence[int], columns: Sequence[int]) -> arb_mat:
    width, entries = values.ncols(), values.entries()
    return arb_mat(
        len(rows), len(columns), [entries[i * width + j] for i in rows for j in columns]
    )


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
        largest = max(
            (float(abs(entry).mid()) for entry in values.entries()), default=0.0
        )
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
        change = part(values, others[0], j) * part(values, i, j).solve(
            part(values, i, others[1])
        )
        values = (part(values, *others) - change).mid()
        free_rows, free_columns = (
            [free_rows[k] for k in others[0]],
            [free_columns[k] for k in others[1]],
        )


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


def virtual_powers(
    linkage: Linkage, q: list[arb], rng: np.random.Generator
) -> list[list[arb]]:
    """The rows of the regressor on the independent motions, at random velocities and accelerations of a closed pose."""
    still = linkage.state(q, [arb(0)] * len(q))
    slopes = linkage.jacobian(still)
    found = pivots(slopes)
    settled(found, "freedom")
    free = [j for j in range(len(q)) if j not in set(found.columns)]
    square = part(slopes, found.rows, found.columns)
    follow = (
        square.solve(part(slopes, found.rows, free) * -1).mid()
        if found.rows
        else arb_mat(0, len(free), [])
    )

    def whole(independent: list[arb], offset: list[arb]) -> list[arb]:
        values = [arb(0)] * len(q)
        for j, value in zip(free, independent, strict=True):
            values[j] = value
        for i, j in enumerate(found.columns):
            values[j] = sum(
                (follow[i, k] * value for k, value in enumerate(independent)), offset[i]
            ).mid()
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
            and max(
                float(abs(v))
                for v in (
                    slopes * arb_mat(len(q), 1, rate) + arb_mat(len(bias), 1, extra)
                ).entries()
            )
            > 1e-40
        ):
            raise UnsettledError("the closures that were left out do not stay closed")
    motions = [
        whole([arb(int(k == d)) for k in range(len(free))], zero)
        for d in range(len(free))
    ]
    return regressor(linkage, at, qdd, motions)


def regressor(
    linkage: Linkage, at: State, qdd: list[arb], motions: list[list[arb]]
) -> list[list[arb]]:
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
            row += [
                power[i, j] if i == j else power[i, j] + power[j, i]
                for i in range(4)
                for j in range(i, 4)
            ]
    return rows


def walk(
    linkage: Linkage, rng: np.random.Generator, step: float = 0.06
) -> Iterator[list[arb]]:
    """Closed poses a few small steps away from the start, which stay in its assembly mode."""
    start = linkage.closed([number(value) for value in linkage.start])
    constraints = len(
        pivots(linkage.jacobian(linkage.state(start, [arb(0)] * len(start)))).sizes
    )
    while True:
        q = start
        for _ in range(4):
            # only along motions that closures allow: what they lock has other closed poses, too
            still = linkage.state(q, [arb(0)] * len(q))
            free = (
                np.linalg.svd(doubles(linkage.jacobian(still)))[2][constraints:]
                if linkage.loops
                else np.eye(len(q))
            )
            moved_on = free.T @ rng.normal(scale=step, size=len(free))
            q = linkage.closed(
                [a + number(float(d)) for a, d in zip(q, moved_on, strict=True)],
                constraints,
            )
        yield q


def rank(linkage: Linkage, seed: int = 0) -> Rank:
    """The number of base parameters at the mode of the start, from more rows than there are columns."""
    rng = np.random.default_rng(seed)
    columns = 10 * sum(bool(body.motions) for body in linkage.bodies)
    rows: list[list[arb]] = []
    poses, enough, before = walk(linkage, rng), max(13, 1.2 * columns), -1
    while True:
        drawn = virtual_powers(linkage, next(poses), rng)
        rows += drawn
        count = len(rows) // max(len(drawn), 1)
        if drawn and (len(rows) < enough or count < 13):
            continue
        found = pivots(arb_mat(rows))
        shown = settled(found, "rank")
        # along few ways much may show faintly, and more of it at more poses
        if not drawn or found.sizes[-1] > FAINT * found.sizes[0] or shown == before:
            return Rank(len(drawn), shown, found.steps[0][1] if found.sizes else np.inf)
        enough, before = 1.5 * len(rows), shown
