"""Random closed states of a mechanism in ball arithmetic, at stated values of its symbols.

A pose in doubles is refined by Newton's iteration, on as many of the closure equations and coordinates as the Jacobian
has rank; the other coordinates stay as they are.  Krawczyk's operator then shows that exactly one solution of these
equations lies in a small box around it, and the box is the pose.  Equations that were left out must hold there as far
as the balls tell: they depend on the others on the component of poses that the pose belongs to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.arrays import pivoted_qr
from echelon.errors import InputError
from echelon.program.balls import BallArithmetic, ball
from echelon.program.schedule import Schedule
from echelon.program.tape import Program
from echelon.regressor.loops.closures import Loops
from echelon.regressor.loops.moving import Layout
from echelon.regressor.spatial import quaternion_times

Values = dict[str, Any]
"""Balls by the names of coordinates or freedoms."""

_ITERATIONS = 16
_RANK = 1e-6  # what counts as nothing among the pivots of a Jacobian in doubles
_STEPS = 256
_SPARE = 32  # bits between the last step and the box


@dataclass(frozen=True)
class _Jacobian:
    """Derivatives of the closure equations by freedoms, and a choice of independent equations and freedoms."""

    names: tuple[str, ...]
    entries: list[list[Any]]
    rows: tuple[int, ...]
    columns: tuple[int, ...]

    @property
    def free(self) -> list[str]:
        """Freedoms that are not solved for."""
        return [name for k, name in enumerate(self.names) if k not in self.columns]

    def square(self) -> Any:
        """The chosen part as a matrix of balls."""
        return flint.arb_mat([[self.entries[r][c] for c in self.columns] for r in self.rows])

    def completed(self, free: Mapping[str, Any], bias: Sequence[Any] | None = None) -> Values:
        """x with J x + bias = 0 and given values of the other freedoms."""
        places = {name: k for k, name in enumerate(self.names)}
        right = []
        for r in self.rows:
            total = flint.arb(0) if bias is None else bias[r]
            right.append([-sum((self.entries[r][places[name]] * x for name, x in free.items()), total)])
        solved = self.square().solve(flint.arb_mat(right)).entries() if self.rows else []
        return {**free, **dict(zip((self.names[c] for c in self.columns), solved, strict=True))}


class ClosedBalls:
    """Closed states of a program's inputs."""

    def __init__(self, program: Program, loops: Loops, symbols: Mapping[str, Any]) -> None:
        self.program, self.loops, self.symbols = program, loops, symbols
        self.layout, self._arithmetic = Layout(loops.motions), BallArithmetic()
        self._balls = {m.name: (m.positions, m.velocities) for m in self.layout.balls}
        self._entries = list(loops.equations.jacobian)
        self._closing = Schedule(program, [*loops.equations.equations, *loops.equations.jacobian.values()])
        self._speeds = Schedule(program, list((loops.speeds or {}).values()))

    def leaves(
        self, schedule: Schedule, real: Mapping[str, float], rng: np.random.Generator, motions: int = 1
    ) -> list[dict[int, Any]]:
        """Values of a schedule's leaves at some random motions through one closed pose."""
        try:
            q = self._pose(real)
        except ZeroDivisionError:
            raise InputError(self._open("their equations are singular there")) from None
        inputs = {*schedule.leaves, *self._speeds.leaves}
        names = {n: self.program.inputs[n].name for n in inputs}
        jacobian = self._jacobian(q, self.layout.names)
        found = []
        for _ in range(motions):
            values = self._moving(q, jacobian, set(names.values()), rng)
            found.append({node: values[names[node]] for node in schedule.leaves})
        return found

    def _moving(self, q: Values, jacobian: _Jacobian, names: set[str], rng: np.random.Generator) -> Values:
        """Values of inputs at a random motion through a pose."""
        rates = jacobian.completed({name: _random(rng) for name in jacobian.free})
        values = {f"q[{n}]": x for n, x in q.items()} | {f"qd[{n}]": x for n, x in rates.items()}
        if any(name.startswith("qdd[") for name in names):
            found = jacobian.completed({name: _random(rng) for name in jacobian.free}, self._bias(q, rates))
            values |= {f"qdd[{n}]": x for n, x in found.items()}
        values |= {name: _random(rng) for name in sorted(names) if name not in {*values, *self.symbols}}
        values |= self.symbols
        if not any(name.startswith("v[") for name in names):
            return values
        given = self._run(self._speeds, values) if self.loops.speeds is not None else None
        return values | {f"v[{n}]": x for n, x in self._virtual(q, given, rng).items()}

    # -- poses -----------------------------------------------------------------------------------------------------

    def _pose(self, real: Mapping[str, float]) -> Values:
        q = {name: flint.arb(real[f"q[{name}]"]) for motion in self.loops.motions for name in motion.positions}
        q = self._moved(q, {})
        jacobian = self._jacobian(q, self.layout.names)
        for _ in range(_ITERATIONS):
            step = self._step(q, jacobian)
            q = {name: x.mid() for name, x in self._moved(q, step).items()}
            size = max((abs(x).upper() for x in step.values()), default=flint.arb(0))
            if size < _power_of_two(-(flint.ctx.prec // 2)):
                break
        size = max(size**2, _power_of_two(_SPARE - flint.ctx.prec)).upper()
        return self._enclosed(q, jacobian, size * _power_of_two(_SPARE))

    def _step(self, q: Values, jacobian: _Jacobian) -> Values:
        values, entries = self._closure(q, jacobian.names)
        here = _Jacobian(jacobian.names, entries, jacobian.rows, jacobian.columns)
        step = here.completed({}, values)
        return {name: x.mid() for name, x in step.items()}

    def _enclosed(self, q: Values, jacobian: _Jacobian, size: Any) -> Values:
        """The pose as a box in which there is one solution, by Krawczyk's operator."""
        rows, columns = jacobian.rows, jacobian.columns
        if not rows:
            return q
        any_ = flint.arb(0, size)
        box = self._moved(q, {jacobian.names[c]: any_ for c in columns})
        values = self._closure(q, jacobian.names)[0]
        slopes = self._closure(box, jacobian.names)[1]
        fuzz = flint.arb(0, 2 * size)  # a turn by s changes the axes of the next turn by no more than that
        for velocities in (v for _, v in self._balls.values()):
            places = [jacobian.names.index(name) for name in velocities]
            for r in rows:
                change = sum((abs(slopes[r][k]) for k in places), flint.arb(0)) * fuzz
                for k in places:
                    slopes[r][k] += change
        square = flint.arb_mat([[slopes[r][c] for c in columns] for r in rows])
        middle = flint.arb_mat([[slopes[r][c].mid() for c in columns] for r in rows]).inv()
        middle = flint.arb_mat(len(rows), len(rows), [x.mid() for x in middle.entries()])
        identity = flint.arb_mat([[int(i == k) for k in range(len(rows))] for i in range(len(rows))])
        spread = flint.arb_mat([[any_] for _ in rows])
        image = (identity - middle * square) * spread - middle * flint.arb_mat([[values[r]] for r in rows])
        found = {jacobian.names[c]: image[k, 0] for k, c in enumerate(columns)}
        closed = self._moved(q, found)
        left = self._closure(closed, jacobian.names)[0]
        if not all(x.contains(0) for x in left):
            owners = self.loops.equations.owners
            most, owner = max((float(abs(x).mid()), owner) for x, owner in zip(left, owners, strict=True))
            raise InputError(self._open(f"with all others closed, '{owner}' is open by {most:.1g} (m or rad)"))
        if not all(abs(x) < size for x in found.values()):
            raise InputError(self._open("no box around the pose is shown to hold a solution"))
        return closed

    def _open(self, reason: str) -> str:
        names = ", ".join(f"'{name}'" for name in dict.fromkeys(self.loops.equations.owners))
        return (
            f"the loops closed by {names} are not proved to close at the stated values in ball arithmetic: {reason}.  "
            "Write lengths and angles exactly, such as pi/3, or leave  on_second  out, so that the frame there follows"
        )

    def _moved(self, q: Values, change: Mapping[str, Any]) -> Values:
        """Positions after small turns and slides; quaternions of unit length."""
        zero = flint.arb(0)
        result = {name: x + change.get(name, zero) for name, x in q.items()}
        for positions, velocities in self._balls.values():
            here = [q[name] for name in positions]
            half = [change.get(name, zero) / 2 for name in velocities]
            turned = [x + step for x, step in zip(here, quaternion_times(here, half), strict=True)]
            length = (sum(x * x for x in here) * (1 + sum(x * x for x in half))).sqrt()
            result |= {name: part / length for name, part in zip(positions, turned, strict=True)}
        return result

    # -- closure equations -----------------------------------------------------------------------------------------

    def _closure(self, q: Values, names: Sequence[str]) -> tuple[list[Any], list[list[Any]]]:
        """Values of the equations, and their derivatives by freedoms."""
        found = self._run(self._closing, {**{f"q[{n}]": x for n, x in q.items()}, **self.symbols})
        count, place = len(self.loops.equations.equations), {name: k for k, name in enumerate(names)}
        entries: list[list[Any]] = [[flint.arb(0)] * len(names) for _ in range(count)]
        for (row, name), value in zip(self._entries, found[count:], strict=True):
            if name in place:
                entries[row][place[name]] = value
        return found[:count], entries

    def _jacobian(self, q: Values, names: Sequence[str], given: Sequence[str] = ()) -> _Jacobian:
        """The Jacobian with independent rows and columns, none of them of a given freedom."""
        entries = self._closure(q, names)[1]
        solved = [k for k, name in enumerate(names) if name not in given]
        doubles = np.array([[float(x.mid()) for x in row] for row in entries]).reshape(len(entries), len(names))
        columns = [solved[k] for k in _independent(doubles[:, solved])]
        rows = _independent(doubles[:, columns].T)
        return _Jacobian(tuple(names), entries, tuple(rows), tuple(columns))

    def _bias(self, q: Values, rates: Values) -> list[Any]:
        """J̇ q̇ for every equation, from the first two coefficients along the motion."""
        moving = {name: flint.arb_series([x, rates.get(name, 0)], 2) for name, x in q.items()}
        for positions, velocities in self._balls.values():
            speeds = quaternion_times([q[name] for name in positions], [rates[name] / 2 for name in velocities])
            moving |= {n: flint.arb_series([q[n], s], 2) for n, s in zip(positions, speeds, strict=True)}
        found = self._run(self._closing, {**{f"q[{n}]": x for n, x in moving.items()}, **self.symbols})
        count = len(self.loops.equations.equations)
        bias = [flint.arb(0)] * count
        for (row, name), slope in zip(self._entries, found[count:], strict=True):
            if isinstance(slope, flint.arb_series) and name in rates:
                bias[row] += slope[1] * rates[name]
        return bias

    def _virtual(self, q: Values, given: Sequence[Any] | None, rng: np.random.Generator) -> Values:
        """Virtual velocities that keep the loops closed."""
        if given is None or self.loops.speeds is None:
            jacobian = self._jacobian(q, self.layout.names)
            return jacobian.completed({name: _random(rng) for name in jacobian.free})
        freedoms = list(self.loops.speeds)
        names = [*self.layout.names, *(name for name in freedoms if name not in self.layout.names)]
        jacobian = self._jacobian(q, names, freedoms)
        return jacobian.completed(dict(zip(freedoms, given, strict=True)))

    def _run(self, schedule: Schedule, values: Mapping[str, Any]) -> list[Any]:
        leaves = {}
        for node in schedule.leaves:
            leaves[node] = np.empty(1, dtype=object)
            leaves[node][0] = values[self.program.inputs[node].name]
        return [row[0] for row in schedule.run(self._arithmetic, leaves, 1)]


def _power_of_two(exponent: int) -> Any:
    """As a ball, which has exponents beyond those of doubles."""
    return flint.arb(2) ** exponent


def _independent(matrix: npt.NDArray[np.float64]) -> list[int]:
    """Columns that span all columns, in doubles."""
    sizes, order = pivoted_qr(matrix)
    return sorted(order[: int((sizes > _RANK * sizes.max(initial=0.0)).sum())].tolist())


def _random(rng: np.random.Generator) -> Any:
    return ball(Fraction(int(rng.integers(-2 * _STEPS, 2 * _STEPS)), _STEPS))
