"""Largest differences of outputs over all states within limits: one that was met, and a bound that none exceeds.

Outputs are weight + M q̈ + Coriolis + effects, so that each part has an attained value, a bound and an example.  With
one geometry the difference of two robots is an output of one, whose base parameters are the differences; any other is
the output of one robot minus that of the other.  Recorded functions serve both sides: machine code for a
search that mutates the best states, interval arithmetic for boxes of states, of which the worst are halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    Function,
    Interval,
    derivatives,
    random_generator,
)
from echelon.dynamics import (
    ClosedStates,
    CompiledAssembly,
    Evaluator,
    geometry_values,
    robot_function,
)
from echelon.excite import enclosures_of
from echelon.loops import normalised
from echelon.robot import Mechanism
from echelon.shared import Floats

PARTS = ("gravity", "acceleration", "velocity", "effects")
_FUNCTIONS = ("gravity", "mass_matrix", "coriolis", "effects")
SAMPLES = 512
"""Random states from which the search starts; half of them have all rates at their limits."""
_ROUNDS, _MUTANTS, _LINES = 60, 4, 4
"""Rounds of the search, changed copies of every best state in each, and searches that go on beside one another."""
_COARSEST, _FINEST = 0.5, 1e-3
"""Size of changes in the first and the last round, as shares of the ranges."""
_WORK = 2**23
"""Operations on intervals that the bounds of a part may take: a second or less."""
_MOST_PRODUCTS = 1000
"""Products of velocities, in all outputs, whose coefficients are bounded one by one: those of nine joints."""
_BATCH, _TRIED = 512, 4
"""Boxes that are halved together, and those on which each coordinate is tried."""
_SHARP = 1.01
"""Ratio of bound to attained value up to which a box is left whole."""


@dataclass(frozen=True, eq=False)
class OutputTerm:
    """Outputs of a robot with some parameters, and zero for all others, as functions of the first robot's states."""

    first: Mechanism  # whose coordinates and outputs have the same names, perhaps in another order
    mechanism: Mechanism
    columns: Sequence[int]  # of the regressor, whose parameters there are
    values: Floats  # of these parameters, SI units

    @cached_property
    def positions(self) -> list[int]:
        """Places of its positions among the first's: of the independent ones where other loops give the rest."""
        own = self.mechanism
        other_loops = own.closures and own is not self.first
        names = own.independent_positions if other_loops else own.positions
        return [self.first.positions.index(name) for name in names]

    @cached_property
    def velocities(self) -> list[int]:
        """Places of its velocities and accelerations among the first's."""
        names = self.mechanism.independent_velocities
        return [self.first.independent_velocities.index(name) for name in names]

    @cached_property
    def rows(self) -> list[int]:
        """Its output for every output of the first."""
        own = [output.name for output in self.mechanism.outputs]
        return [own.index(output.name) for output in self.first.outputs]

    @cached_property
    def _functions(self) -> list[Function]:
        return [
            robot_function(name, self.mechanism, self.columns) for name in _FUNCTIONS
        ]

    @cached_property
    def _evaluators(self) -> list[Evaluator]:
        loops = ClosedStates(self.mechanism) if self.mechanism.closures else None
        return [Evaluator(self.mechanism, f, loops=loops) for f in self._functions]

    @cached_property
    def enclosable(self) -> list[Function]:
        """Functions of boxes of states, part by part: for velocities the coefficients of products, if they are few."""
        gravity, mass, velocity, effects = self._functions
        if len(velocity.axes[0]) * len(self.velocities) ** 2 < _MOST_PRODUCTS:
            velocity = _products(velocity)
        return [gravity, mass, velocity, effects]

    def parts(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The parts of all outputs, shape (N, parts, outputs)."""
        state = {
            "q": q[:, self.positions],
            "qd": qd[:, self.velocities],
            "parameters": self.values,
        }
        found = []
        for evaluator in self._evaluators:
            names = {argument.name for argument in evaluator.function.arguments}
            value = evaluator({k: v for k, v in state.items() if k in names})
            if value.ndim > 2:
                value = np.einsum("nij,nj->ni", value, qdd[:, self.velocities])
            found.append(value)
        return np.stack(found, axis=1)[:, :, self.rows]

    def enclosed(self, part: int, q: Interval, qd: Interval) -> Interval:
        """Bounds of an enclosable function in boxes of states, shape (boxes, outputs) or with axes of velocities."""
        function = self.enclosable[part]
        ranges = {
            "q": (q[0][:, self.positions], q[1][:, self.positions]),
            "qd": (qd[0][:, self.velocities], qd[1][:, self.velocities]),
        }
        known = geometry_values(self.mechanism, function.arguments)
        ends = enclosures_of(function, {"parameters": self.values, **known}, ranges)
        entries = np.array(list(function.entries), dtype=int)
        places = entries.reshape(-1, len(function.axes)).T
        order = np.argsort(self.velocities)
        found = []
        for end in ends:
            whole = np.zeros((len(end), *(len(axis) for axis in function.axes)))
            whole[(slice(None), *places)] = end
            whole = whole[:, self.rows]
            for axis in range(2, whole.ndim):
                whole = np.take(whole, order, axis=axis)
            found.append(whole)
        return found[0], found[1]


def _products(function: Function) -> Function:
    """Coefficients of products of velocities: a form without other terms is half its second derivative in them."""
    (rates,) = (argument for argument in function.arguments if argument.name == "qd")
    program, rows = function.program, [row for (row,) in function.entries]
    first = derivatives(program, function.outputs, rates.nodes)
    second = derivatives(program, list(first.values()), rates.nodes)
    at = list(first)
    half = program.constant(Fraction(1, 2)).node
    entries: dict[tuple[int, ...], int] = {
        (rows[at[k][0]], at[k][1], place): program.multiply(half, node)
        for (k, place), node in second.items()
    }
    axes = (*function.axes, rates.labels, rates.labels)
    return Function("velocity_products", program, function.arguments, entries, axes)


@dataclass(frozen=True, eq=False)
class StateBox:
    """All states within limits."""

    low: Floats  # shape (positions,)
    high: Floats
    velocity: Floats  # shape (velocities,); largest rates
    acceleration: Floats

    @property
    def ends(self) -> Interval:
        """Least and largest positions, velocities and accelerations, one after another."""
        rates = np.concatenate([self.velocity, self.acceleration])
        return np.concatenate([self.low, -rates]), np.concatenate([self.high, rates])

    def cut(self, states: Floats) -> list[Floats]:
        """Positions, velocities and accelerations of states, as views."""
        first = len(self.low)
        return np.split(states, [first, first + len(self.velocity)], axis=1)


@dataclass(frozen=True, eq=False)
class OutputDifference:
    """The sum of terms, over a box of states."""

    terms: tuple[OutputTerm, ...]
    box: StateBox

    def parts(self, states: Floats) -> Floats:
        """The parts and their sum at states, shape (N, parts + 1, outputs)."""
        state = self.box.cut(states)
        found = np.sum([term.parts(*state) for term in self.terms], axis=0)
        return np.concatenate([found, found.sum(axis=1, keepdims=True)], axis=1)

    @cached_property
    def samples(self) -> Floats:
        """Random states, shape (N, size)."""
        rng, (low, high) = random_generator(DEFAULT_SEED), self.box.ends
        found = rng.uniform(low, high, (SAMPLES, len(low)))
        _, qd, qdd = self.box.cut(found[::2])
        for rates, limit in ((qd, self.box.velocity), (qdd, self.box.acceleration)):
            rates[:] = np.copysign(limit, rates)
        return self._possible(found, rng)

    def largest(self) -> tuple[Floats, Floats]:
        """The largest sizes that a search met, shape (parts + 1, outputs), and states (parts + 1, outputs, size)."""
        rng, (low, high) = random_generator(DEFAULT_SEED), self.box.ends
        # every line of descent seeks the largest size of one part of one output
        states = self.samples.reshape(_LINES, -1, len(low))
        values = np.abs(self.parts(self.samples)).reshape(*states.shape[:2], -1)
        best, at = _best(values, states)
        for scale in np.geomspace(_COARSEST, _FINEST, _ROUNDS):
            parents = np.repeat(at, _MUTANTS, axis=1).reshape(-1, len(low))
            moved = rng.random(parents.shape) < max(0.2, 1 / len(low))
            steps = scale * (high - low) * rng.normal(size=parents.shape)
            states = self._possible(np.clip(parents + moved * steps, low, high), rng)
            values = np.abs(self.parts(states)).reshape(_LINES, -1, best.shape[-1])
            found, where = _best(values, states.reshape(_LINES, -1, len(low)))
            at = np.where((found > best)[:, :, None], where, at)
            best = np.maximum(best, found)
        line = best.argmax(axis=0)
        columns = np.arange(len(line))
        shape = len(PARTS) + 1, -1
        return best[line, columns].reshape(shape), at[line, columns].reshape(
            *shape, len(low)
        )

    def _possible(self, states: Floats, rng: np.random.Generator) -> Floats:
        """States with unit quaternions, and with loops at closed positions near random ones."""
        mechanism, q = self.terms[0].mechanism, self.box.cut(states)[0]
        if self._closed is None:
            q[:] = normalised(mechanism, q)
        else:
            q[:] = self._closed[rng.integers(len(self._closed), size=len(q))]
        return states

    @cached_property
    def _closed(self) -> Floats | None:
        """Closed positions within limits; None without loops."""
        mechanism = self.terms[0].mechanism
        if not mechanism.closures:
            return None
        found = CompiledAssembly(mechanism).random_closed_states(
            random_generator(DEFAULT_SEED), SAMPLES
        )[0]
        inside = ((found >= self.box.low) & (found <= self.box.high)).all(axis=1)
        return found[inside] if inside.any() else found

    def bounds(self, reached: Floats, negligible: Floats) -> Floats | None:
        """Sizes that no state exceeds, shape (parts + 1, outputs); None with loops, where intervals say nothing.

        ``reached`` are those that some states have, and ``negligible`` (outputs) those below which none matters: bounds
        need not be sharper.
        """
        if self._closed is not None:
            return None
        found = [
            np.maximum(
                self._bound(part, np.maximum(_SHARP * reached[part], negligible)),
                reached[part],
            )
            for part in range(len(PARTS))
        ]
        return np.array([*found, np.sum(found, axis=0)])

    def _bound(self, part: int, wanted: Floats) -> Floats:
        places = self._varying(part)
        low, high = (
            end[None, : len(self.box.low) + len(self.box.velocity)]
            for end in self.box.ends
        )
        upper = self._upper(part, low, high)
        settled = np.zeros(len(wanted))
        budget = _WORK // sum(len(term.enclosable[part].program) for term in self.terms)
        while places and budget > 0:
            worst = (upper / np.where(wanted > 0, wanted, 1.0)).max(axis=1)
            done = (upper <= wanted).all(axis=1)
            settled = np.maximum(settled, upper[done].max(axis=0, initial=0.0))
            low = low[~done]
            high = high[~done]
            upper = upper[~done]
            worst = worst[~done]
            if not len(worst):
                break
            order = np.argsort(-worst)
            low, high, upper = low[order], high[order], upper[order]
            place = self._best_place(part, low[:_TRIED], high[:_TRIED], places, wanted)
            halves = _halved(low[:_BATCH], high[:_BATCH], place)
            less = np.minimum(
                self._upper(part, *halves), np.tile(upper[:_BATCH], (2, 1))
            )
            budget -= len(less) + 2 * _TRIED * len(places)
            low = np.concatenate([halves[0], low[_BATCH:]])
            high = np.concatenate([halves[1], high[_BATCH:]])
            upper = np.concatenate([less, upper[_BATCH:]])
        return np.asarray(np.maximum(settled, upper.max(axis=0, initial=0.0)))

    def _best_place(
        self,
        part: int,
        low: Floats,
        high: Floats,
        places: Sequence[int],
        wanted: Floats,
    ) -> int:
        """The coordinate along which halving some boxes lowers their bounds most."""
        halves = [_halved(low, high, place) for place in places]
        ends = (np.concatenate([half[k] for half in halves]) for k in (0, 1))
        upper = self._upper(part, *ends) / np.where(wanted > 0, wanted, 1.0)
        scores = upper.reshape(len(places), -1).sum(axis=1)
        return places[int(np.argmin(scores))]

    def _upper(self, part: int, low: Floats, high: Floats) -> Floats:
        """Bounds of the sizes of a part in boxes, shape (boxes, outputs)."""
        cut = [len(self.box.low)]
        q, qd = np.split(low, cut, axis=1)
        q_high, qd_high = np.split(high, cut, axis=1)
        ends = [term.enclosed(part, (q, q_high), (qd, qd_high)) for term in self.terms]
        least, most = (sum(end[k] for end in ends) for k in (0, 1))
        sizes = np.maximum(np.abs(least), np.abs(most))
        if part == PARTS.index("acceleration"):
            return sizes @ self.box.acceleration
        for _ in range(2, sizes.ndim):
            sizes = sizes @ self.box.velocity
        return sizes

    def _varying(self, part: int) -> list[int]:
        """Places of positions and velocities on which a part depends."""
        found = set[int]()
        for term in self.terms:
            function = term.enclosable[part]
            used = set(function.program.needed(function.entries.values()))
            first = {
                "q": (term.positions, 0),
                "qd": (term.velocities, len(self.box.low)),
            }
            for argument in function.arguments:
                places, start = first.get(argument.name, ((), 0))
                nodes = argument.nodes if places else ()
                found |= {
                    start + places[k] for k, node in enumerate(nodes) if node in used
                }
        return sorted(found)


def _best(values: Floats, states: Floats) -> tuple[Floats, Floats]:
    """The largest values (lines, columns) of (lines, N, columns), and the states that have them."""
    at = values.argmax(axis=1)
    lines = np.arange(len(values))[:, None]
    return values.max(axis=1), states[lines, at]


def _halved(low: Floats, high: Floats, place: int) -> Interval:
    """Both halves of boxes along a coordinate."""
    first, second = high.copy(), low.copy()
    first[:, place] = second[:, place] = (low[:, place] + high[:, place]) / 2
    return np.concatenate([low, second]), np.concatenate([first, high])
