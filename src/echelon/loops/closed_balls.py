"""Random closed states of a mechanism in ball arithmetic, at stated values of its symbols.

Poses in doubles are refined by Newton's iteration, on as many of the closure equations and coordinates as the Jacobian
has rank; the other coordinates stay as they are.  The interval Newton operator then shows that exactly one solution of
these equations lies in a small box around each, and the box is the pose.  Equations that were left out must hold there
but for rounding of frames: they depend on the others on the component of poses that the pose belongs to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    BallArithmetic,
    FloatArithmetic,
    Op,
    Schedule,
    StagedSchedule,
    ball,
    stated_ball,
)
from echelon.loops.closed_motion import CLOSED, NEGLIGIBLE, NOISE, RATE
from echelon.loops.recorded_loops import FINENESS, Loops, floats_of
from echelon.robot import MotionKind, quaternion_times
from echelon.shared import Floats, InputError, Integers, pivoted_qr

Balls = npt.NDArray[Any]
"""Array of ``arb``, poses last."""

Values = dict[str, Balls]
"""By the names of coordinates, freedoms or inputs, each of shape (poses,)."""

LAST_WEIGHT = 0.9
"""Weight of the last column where the longest is taken next; the first has 1."""
LARGEST_EXPONENT = 40.0
"""Largest argument of exponentials of speeds: beyond, they leave nothing of others."""
DOUBLINGS = 20
"""Doublings of speeds where signs or exponentials occur: from a millionth to a million of the usual ones."""

_middle = np.frompyfunc(lambda x: x.mid(), 1, 1)
_double = np.frompyfunc(lambda x: float(x.mid()), 1, 1)
_series = np.frompyfunc(lambda x, rate: flint.arb_series([x, rate], 2), 2, 1)
_slope = np.frompyfunc(
    lambda x: x[1] if isinstance(x, flint.arb_series) else flint.arb(0), 1, 1
)


_Choice = list[tuple[list[int], list[int]]]
"""For each pose, independent equations and the freedoms that they are solved for."""


@dataclass(frozen=True)
class _Jacobian:
    """Derivatives of the closure equations by freedoms: those that may differ from zero."""

    shape: tuple[int, int]
    rows: Integers
    columns: Integers
    values: Balls  # (entries, poses)

    @property
    def dense(self) -> Balls:
        """All derivatives, (equations, freedoms, poses)."""
        return self._filled(flint.arb(0), self.values)

    def times(self, x: Balls) -> Balls:
        """Rates of the equations, (equations, motions, poses), from those of freedoms."""
        total = _zeros((self.shape[0], *x.shape[1:]))
        np.add.at(total, self.rows, self.values[:, None] * x[self.columns])
        return total

    def chosen(self, held: Sequence[int], given: Sequence[int] = ()) -> _Choice:
        """Independent equations and freedoms, none of which is given; equations that are held, if some are."""
        solved, found = [k for k in range(self.shape[1]) if k not in given], _Choice()
        for table in np.moveaxis(self._doubles, 2, 0):
            columns = [
                solved[k]
                for k in _independent(table[list(held) or slice(None)][:, solved])
            ]
            if len(columns) < len(held):
                raise InputError(
                    "the equations that are held depend on one another at some pose"
                )
            found.append(
                (list(held) or _independent(table[:, columns].T, len(columns)), columns)
            )
        return found

    def possible(self, chosen: _Choice, wanted: Balls) -> Balls:
        """Rates (freedoms, motions, poses) that nearly keep the equations, next to wanted ones.

        So motions depend on what was wanted, and not on which freedoms are solved for.
        """
        rates = _double(wanted).astype(float)
        for pose, table in enumerate(np.moveaxis(self._doubles, 2, 0)):
            across = np.linalg.svd(table)[2][: len(chosen[pose][0])]
            rates[:, :, pose] -= across.T @ (across @ rates[:, :, pose])
        return np.asarray(np.frompyfunc(flint.arb, 1, 1)(rates))

    @property
    def _doubles(self) -> Floats:
        """All derivatives in doubles, (equations, freedoms, poses)."""
        table = self._filled(0.0, _double(self.values).astype(float))
        table[np.abs(table) < NOISE] = (
            0  # equations that hold whatever moves determine nothing
        )
        return table

    def _filled(self, zero: Any, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        table = np.full((*self.shape, values.shape[1]), zero)
        table[self.rows, self.columns] = values
        return table

    def completed(self, chosen: _Choice, free: Balls, bias: Balls | int = 0) -> Balls:
        """x (freedoms, motions, poses) with J x + bias = 0, of which those that are not solved for are given."""
        result = free.copy()
        for pose, (_, columns) in enumerate(chosen):
            result[columns, :, pose] = flint.arb(0)
        return _solved(self.dense, chosen, self.times(result) + bias, result)


class ClosedBalls:
    """Closed states of a program's inputs."""

    def __init__(self, loops: Loops, symbols: Values, poses: Floats) -> None:
        """Keep some sets of values of the symbols, and poses in doubles, as many for each, one set after the other.

        Shapes: symbols (sets,), poses (sets · poses of each, positions).
        """
        program = loops.equations.program
        self.program, self.loops, self._real = program, loops, poses
        self._sets = symbols
        self._count = len(next(iter(symbols.values()), [0]))
        self.symbols = {
            name: np.repeat(value, len(poses) // self._count)
            for name, value in symbols.items()
        }
        self._names = loops.mechanism.velocities
        motions = loops.mechanism.free_motions
        self._balls = [
            (m.positions, m.velocities) for m in motions if m.kind is MotionKind.BALL
        ]
        self._closing, self._speeds = loops.closing, loops.driven
        # equations that are held while rounding makes others contradict them, and by how much these may miss
        assembly = loops.assembly
        self._held = list(assembly.held) if loops.mechanism.rounding else []
        self._explained = assembly.explained * max(1.0, assembly.closures.length)
        self._arithmetic = BallArithmetic()
        self._kept = dict[
            int, dict[int, Balls]
        ]()  # by schedule: what depends on symbols alone

    def leaves(
        self,
        schedule: StagedSchedule,
        rng: np.random.Generator,
        motions: int = 1,
        *,
        at_rest: bool = False,
    ) -> dict[int, Balls]:
        """Values of a schedule's leaves, (motions · poses,), at some random motions through each of the poses.

        Those that start from rest take less time.
        """
        used = {*schedule.leaves, *self._speeds.leaves}
        values = self._moving(
            {self.program.inputs[node].name for node in used}, rng, motions, at_rest
        )
        return self._leaves(schedule, values, motions * len(self._real))

    @cached_property
    def _pace(self) -> Any:
        """How slowly things move, so that exponentials of speeds are more than nothing: 1, or a power of two."""
        program, count = self.program, len(self._real)
        schedule = Schedule(
            program,
            [program.lhs[node] for node, op in enumerate(program.ops) if op == Op.EXP],
        )
        known = {
            name: _double(value).astype(float) for name, value in self.symbols.items()
        }
        known |= _inputs(
            "q", dict(zip(self.loops.mechanism.positions, self._real.T, strict=True))
        )
        for halvings in range(DOUBLINGS):
            rest, pace = np.ones(count), 0.5**halvings
            moving = {f"qd[{name}]": pace * RATE * rest for name in self._names}
            leaves = {
                node: (known | moving).get(program.inputs[node].name, rest)
                for node in schedule.leaves
            }
            if (
                np.abs(schedule.run(FloatArithmetic(), leaves, count)).max(initial=0.0)
                < LARGEST_EXPONENT
            ):
                return flint.arb(pace)
        return flint.arb(1)

    def _moving(
        self, names: set[str], rng: np.random.Generator, motions: int, at_rest: bool
    ) -> Values:
        """Values of inputs, (motions · poses,), at random motions through the poses."""
        there, chosen = self.poses
        jacobian = self._closure(there, self._names)[1]
        q = {name: np.tile(x, motions) for name, x in there.items()}
        shape, count = (len(self._names), motions, len(chosen)), motions * len(chosen)
        rates = _zeros(shape)
        if not at_rest:
            free = jacobian.possible(chosen, random_balls(rng, shape))
            rates = jacobian.completed(
                chosen, free * self._pace * self._paces(rng, shape[1:])
            )
        values = _inputs("q", q) | _inputs("qd", _flat(self._names, rates))
        if any(name.startswith("qdd[") for name in names):
            bias = (
                0
                if at_rest
                else self._bias(q, _flat(self._names, rates)).reshape(-1, *shape[1:])
            )
            found = jacobian.completed(
                chosen, jacobian.possible(chosen, random_balls(rng, shape)), bias
            )
            values |= _inputs("qdd", _flat(self._names, found))
        values |= {
            n: random_balls(rng, (count,))
            for n in sorted(names)
            if n not in {*values, *self.symbols}
        }
        values |= {name: np.tile(x, motions) for name, x in self.symbols.items()}
        if any(name.startswith("v[") for name in names):
            values |= _inputs("v", self._virtual(there, values, rng, motions))
        return values

    def _paces(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Any:
        """Factors of speeds, (motions, poses).

        Where signs occur, as of friction or dead zones, these are random powers of two, which take half of the speeds
        beyond dead zones and limits on either side; but exponentials would vanish or overflow at large ones.
        """
        ops = set(self.program.ops)
        if ops.isdisjoint((Op.SIGN, Op.ABS)):
            return 1
        powers = rng.integers(
            -DOUBLINGS, 1 if Op.EXP in ops else DOUBLINGS + 1, size=shape
        )
        powers *= rng.integers(2, size=shape)
        return np.frompyfunc(lambda n: _power_of_two(int(n)), 1, 1)(powers)

    # -- poses -----------------------------------------------------------------------------------------------------

    @cached_property
    def poses(self) -> tuple[Values, _Choice]:
        """Closed poses, and equations and freedoms that are solved for; InputError if they are not proved to close."""
        try:
            return self._poses()
        except ZeroDivisionError:
            raise InputError(self._open("their equations are singular there")) from None

    def _poses(self) -> tuple[Values, _Choice]:
        names = self.loops.mechanism.positions
        q: Values = {
            name: np.array([flint.arb(x) for x in column.tolist()], dtype=object)
            for name, column in zip(names, self._real.T, strict=True)
        }
        none = _zeros((len(self._names), 1, len(q[names[0]])))
        q = self._moved(q, none[:, 0])
        chosen, size, before = _Choice(), flint.arb(1), flint.arb("inf")
        while _power_of_two(-(flint.ctx.prec // 2)) < size < before / 2:
            values, jacobian = self._closure(q, self._names)
            chosen = chosen or jacobian.chosen(self._held)
            step = _middle(jacobian.completed(chosen, none, values[:, None])[:, 0])
            q = {name: _middle(x) for name, x in self._moved(q, step).items()}
            before = size
            size = max((abs(x).upper() for x in step.flat), default=flint.arb(0))
        # beyond what is left, the square of half of the digits, and so small that its own square is less than rounding
        return self._enclosed(
            q, chosen, _power_of_two(-2 * flint.ctx.prec // 3)
        ), chosen

    def _enclosed(self, q: Values, chosen: _Choice, size: Any) -> Values:
        """Poses as boxes in each of which there is one solution, by the interval Newton operator."""
        none = _zeros((len(self._names), 1, len(chosen)))
        spread = none[:, 0].copy()
        for pose, (_, columns) in enumerate(chosen):
            spread[columns, pose] = flint.arb(0, size)
        slopes = self._closure(self._moved(q, spread), self._names)[1].dense
        fuzz = flint.arb(
            0, 2 * size
        )  # a turn by s changes the axes of the next turn by no more than that
        for _, velocities in self._balls:
            places = [self._names.index(name) for name in velocities]
            slopes[:, places] = (
                slopes[:, places] + (abs(slopes[:, places]).sum(axis=1) * fuzz)[:, None]
            )
        found = _solved(
            slopes, chosen, self._closure(q, self._names)[0][:, None], none
        )[:, 0]
        closed = self._moved(q, found)
        for owner, left in zip(
            self.loops.equations.owners,
            self._closure(closed, self._names)[0],
            strict=True,
        ):
            most = max(0.0 if x.contains(0) else float(abs(x).mid()) for x in left)
            if most > max(CLOSED, self._explained):
                problem = f"with all others closed, '{owner}' is open by {most:.1g} (m or rad)"
                raise InputError(self._open(problem))
        if not all(abs(x) < size for x in found.flat):
            raise InputError(
                self._open("no box around the pose is shown to hold a solution")
            )
        return closed

    def _open(self, reason: str) -> str:
        names = ", ".join(
            f"'{name}'" for name in dict.fromkeys(self.loops.equations.owners)
        )
        return (
            f"the loops closed by {names} are not proved to close at the stated values in ball arithmetic: {reason}.  "
            "Write lengths and angles exactly, such as pi/3, or leave  on_second  out, so that the frame there follows"
        )

    def _moved(self, q: Values, change: Balls) -> Values:
        """Positions after small turns and slides (freedoms, poses); quaternions of unit length."""
        moves = dict(zip(self._names, change, strict=True))
        result = {name: x + moves[name] for name, x in q.items() if name in moves}
        for positions, velocities in self._balls:
            here = [q[name] for name in positions]
            half = [moves[name] / 2 for name in velocities]
            turned = [
                x + step
                for x, step in zip(here, quaternion_times(here, half), strict=True)
            ]
            square = sum(x * x for x in here) * (1 + sum(x * x for x in half))
            length = np.array([x.sqrt() for x in square], dtype=object)
            result |= {
                name: part / length
                for name, part in zip(positions, turned, strict=True)
            }
        return result

    # -- closure equations -----------------------------------------------------------------------------------------

    def _closure(self, q: Values, names: Sequence[str]) -> tuple[Balls, _Jacobian]:
        """Values of the equations, (equations, poses), and their derivatives by freedoms."""
        found = self._run(self._closing, _inputs("q", q))
        count = len(self.loops.equations.equations)
        places = [
            (k, row, name)
            for k, (row, name) in enumerate(self.loops.equations.jacobian)
            if name in names
        ]
        rows = np.array([row for _, row, _ in places], dtype=np.intp)
        columns = np.array([names.index(name) for *_, name in places], dtype=np.intp)
        return found[:count], _Jacobian(
            (count, len(names)), rows, columns, found[[count + k for k, *_ in places]]
        )

    def _bias(self, q: Values, speeds: Values) -> Balls:
        """J̇ q̇ for every equation, (equations, poses), from the first two coefficients along the motion."""
        changes = dict(speeds)
        for positions, velocities in self._balls:
            turned = quaternion_times(
                [q[name] for name in positions],
                [speeds[name] / 2 for name in velocities],
            )
            changes |= dict(zip(positions, turned, strict=True))
        jacobian = self._closure(
            {name: _series(x, changes[name]) for name, x in q.items()}, self._names
        )[1]
        rates = np.array([speeds[name] for name in self._names], dtype=object)
        return replace(jacobian, values=_slope(jacobian.values)).times(rates[:, None])[
            :, 0
        ]

    def _virtual(
        self, q: Values, values: Values, rng: np.random.Generator, motions: int
    ) -> Values:
        """Virtual velocities that keep the loops closed, at motions through poses."""
        speeds = list(self.loops.speeds or ())
        names = [*self._names, *(name for name in speeds if name not in self._names)]
        given = [names.index(name) for name in speeds]
        shape = (len(names), motions, len(next(iter(q.values()))))
        free = random_balls(rng, shape) if self.loops.speeds is None else _zeros(shape)
        if given:
            free[given] = self._run(self._speeds, values).reshape(-1, *shape[1:])
        jacobian = self._closure(q, names)[1]
        found = jacobian.completed(jacobian.chosen(self._held, given), free)
        return _flat(names, found)

    def _run(self, schedule: StagedSchedule, values: Values) -> Balls:
        states = len(next(iter(values.values())))
        return schedule.moving.run(
            self._arithmetic, self._leaves(schedule, values, states), states
        )

    def _leaves(
        self, schedule: StagedSchedule, values: Values, states: int
    ) -> dict[int, Balls]:
        """Values of leaves at all states: inputs, and what depends on symbols alone."""
        kept = self._kept.get(id(schedule))
        if kept is None:
            kept = self._kept[id(schedule)] = schedule.kept(
                self._arithmetic, self._sets, self._count
            )
        each = len(self._real) // self._count
        leaves = {
            node: np.resize(np.repeat(value, each), states)
            for node, value in kept.items()
        }
        return leaves | {
            node: values[self.program.inputs[node].name] for node in schedule.leaves
        }


def closed_states(
    loops: Loops, at: Sequence[Mapping[str, str]], poses: Floats
) -> ClosedBalls:
    """Closed poses in ball arithmetic next to some in doubles, at the loops' own values or others of some symbols.

    Parameters
    ----------
    loops : Loops
    at : sequence of mapping of str to str
        Values of symbols in place of the stated ones; the poses are closed at each of them, one after the other.
    poses : array of shape (poses, positions)
        Closed at the loops' own values.

    Raises
    ------
    DegenerateSampleError
        If the loops do not close at other values.
    """
    values = [{**loops.values, **given} for given in at]
    wanted = np.tile(poses, (len(at), 1))
    if any(given != loops.values for given in values):
        floats = [floats_of(given) for given in values]
        spread = {
            name: np.repeat([given[name] for given in floats], len(poses))
            for name in loops.values
        }
        wanted = loops.followed(wanted, spread)
    balls = [
        {name: stated_ball(text) for name, text in given.items()} for given in values
    ]
    names = [
        given.name
        for given in loops.equations.program.inputs.values()
        if given.role == "symbol"
    ]
    symbols = {name: np.array([b[name] for b in balls], dtype=object) for name in names}
    return ClosedBalls(loops, symbols, wanted)


def _solved(jacobian: Balls, chosen: _Choice, opening: Balls, free: Balls) -> Balls:
    """Rates (freedoms, motions, poses) that undo some of the equations, where others are free.

    Shapes: jacobian (equations, freedoms, poses), opening (equations, motions, poses).
    """
    result = free.copy()
    for pose, (rows, columns) in enumerate(chosen):
        if rows:
            square = flint.arb_mat(jacobian[np.ix_(rows, columns)][..., pose].tolist())
            solved = square.solve(flint.arb_mat((-opening[rows, :, pose]).tolist()))
            result[columns, :, pose] = np.array(solved.entries(), dtype=object).reshape(
                len(columns), -1
            )
    return result


def _independent(matrix: Floats, count: int | None = None) -> list[int]:
    """Columns that span all columns, in doubles; of columns that are alike the first, whatever rounding says."""
    sizes, order = pivoted_qr(matrix * np.linspace(1.0, LAST_WEIGHT, matrix.shape[1]))
    rank = (
        int((sizes > NEGLIGIBLE * sizes.max(initial=0.0)).sum())
        if count is None
        else count
    )
    return sorted(order[:rank].tolist())


def _flat(names: Sequence[str], found: Balls) -> Values:
    """Rates of freedoms, (freedoms, motions, poses), by name."""
    return {name: x.ravel() for name, x in zip(names, found, strict=True)}


def _inputs(kind: str, values: Mapping[str, npt.NDArray[Any]]) -> Values:
    return {f"{kind}[{name}]": x for name, x in values.items()}


def _zeros(shape: tuple[int, ...]) -> Balls:
    return np.full(shape, flint.arb(0), dtype=object)


def _power_of_two(exponent: int) -> Any:
    """As a ball, which has exponents beyond those of doubles."""
    return flint.arb(2) ** exponent


def random_balls(rng: np.random.Generator, shape: tuple[int, ...]) -> Balls:
    """Random exact numbers."""
    numbers = rng.integers(-2 * FINENESS, 2 * FINENESS, size=shape)
    return np.asarray(
        np.frompyfunc(lambda n: ball(Fraction(int(n), FINENESS)), 1, 1)(numbers)
    )
