"""How far outputs are apart over all states within limits: the largest that was met, and a bound that none exceeds.

Outputs are weight + M q̈ + Coriolis + effects, so that each part has an attained value, a bound and an example of its
own.  The difference of two robots with one geometry is an output of one robot whose base parameters are the differences;
any other is the output of one robot minus that of the other.  Recorded functions serve both sides: machine code for a
search that mutates the best states, interval arithmetic for boxes of states, of which the worst are halved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echelon.algebra import DEFAULT_SEED, Interval, random_generator
from echelon.base import BaseModel
from echelon.dynamics import CompiledAssembly, geometry_values
from echelon.excite import enclosures_of
from echelon.loops import normalised
from echelon.shared import Floats

PARTS = ("gravity", "acceleration", "velocity", "effects")
_FUNCTIONS = ("gravity", "mass_matrix", "coriolis", "effects")
SAMPLES = 512
"""Random states from which the search starts; half of them have all rates at their limits."""
_ROUNDS, _MUTANTS = 60, 8
"""Rounds of the search, and changed copies of every best state in each."""
_COARSEST, _FINEST = 0.5, 1e-3
"""Size of changes in the first and the last round, as shares of the ranges."""
_WORK = 2**25
"""Operations on intervals that the bounds of a part may take: about a second."""
_BATCH, _TRIED = 128, 4
"""Boxes that are halved together, and those on which each coordinate is tried."""
_SHARP = 1.01
"""Ratio of bound to attained value up to which a box is left whole."""


@dataclass(frozen=True, eq=False)
class Term:
    """Outputs of one robot with some base parameters, by coordinates of the first robot."""

    base: BaseModel
    values: Floats  # shape (r,); base parameters, SI units
    positions: Sequence[int]  # places of its q among the first's
    velocities: Sequence[int]  # places of its q̇ and q̈
    rows: Sequence[int]  # its output for every output of the first

    def parts(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The parts of all outputs, shape (N, parts, outputs)."""
        q, qd, qdd = (
            q[:, self.positions],
            qd[:, self.velocities],
            qdd[:, self.velocities],
        )
        mass = self.base.mass_matrix(q, self.values)
        found = [
            self.base.gravity(q, self.values),
            np.einsum("nij,nj->ni", mass, qdd),
            self.base.coriolis(q, qd, self.values),
            self.base.effects(q, qd, self.values),
        ]
        return np.stack(found, axis=1)[:, :, self.rows]

    def enclosed(self, part: int, q: Interval, qd: Interval) -> Interval:
        """Bounds of a part's function in boxes of states, shape (boxes, outputs), of M (boxes, outputs, velocities)."""
        function = self.base.function(_FUNCTIONS[part])
        ranges = {
            "q": (q[0][:, self.positions], q[1][:, self.positions]),
            "qd": (qd[0][:, self.velocities], qd[1][:, self.velocities]),
        }
        known = geometry_values(self.base.mechanism, function.arguments)
        ends = enclosures_of(function, {"parameters": self.values, **known}, ranges)
        entries = np.array(list(function.entries), dtype=int)
        places = entries.reshape(-1, len(function.axes)).T
        shape = [len(axis) for axis in function.axes]
        found = []
        for end in ends:
            whole = np.zeros((len(end), *shape))
            whole[(slice(None), *places)] = end
            whole = whole[:, self.rows]
            if whole.ndim == 3:
                whole = whole[:, :, np.argsort(self.velocities)]
            found.append(whole)
        return found[0], found[1]

    def cost(self, part: int) -> int:
        """Operations of a part's function."""
        return max(len(self.base.function(_FUNCTIONS[part]).program), 1)


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

    terms: tuple[Term, ...]
    box: StateBox

    def parts(self, states: Floats) -> Floats:
        """The parts and their sum at states, shape (N, parts + 1, outputs)."""
        state = self.box.cut(states)
        found = sum(term.parts(*state) for term in self.terms)
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
        """The largest sizes that a search met, shape (parts + 1, outputs), and their states (parts + 1, outputs, size)."""
        rng, (low, high) = random_generator(DEFAULT_SEED), self.box.ends
        states = self.samples
        values = np.abs(self.parts(states))
        best, at = values.max(axis=0), states[values.argmax(axis=0)]
        size = at.shape[-1]
        for scale in np.geomspace(_COARSEST, _FINEST, _ROUNDS):
            parents = np.repeat(at.reshape(-1, size), _MUTANTS, axis=0)
            moved = rng.random(parents.shape) < max(0.2, 1 / size)
            steps = scale * (high - low) * rng.normal(size=parents.shape)
            states = self._possible(np.clip(parents + moved * steps, low, high), rng)
            values = np.abs(self.parts(states))
            better = values.max(axis=0) > best
            at[better] = states[values.argmax(axis=0)][better]
            best = np.maximum(best, values.max(axis=0))
        return best, at

    def _possible(self, states: Floats, rng: np.random.Generator) -> Floats:
        """States with unit quaternions, and with loops at closed positions near random ones."""
        mechanism, q = self.terms[0].base.mechanism, self.box.cut(states)[0]
        if self._closed is None:
            q[:] = normalised(mechanism, q)
        else:
            q[:] = self._closed[rng.integers(len(self._closed), size=len(q))]
        return states

    @cached_property
    def _closed(self) -> Floats | None:
        """Closed positions within limits; None without loops."""
        mechanism = self.terms[0].base.mechanism
        if not mechanism.closures:
            return None
        found = CompiledAssembly(mechanism).random_closed_states(
            random_generator(DEFAULT_SEED), SAMPLES
        )[0]
        inside = ((found >= self.box.low) & (found <= self.box.high)).all(axis=1)
        return found[inside] if inside.any() else found

    def bounds(self, reached: Floats) -> Floats | None:
        """Sizes that no state exceeds, shape (parts + 1, outputs); None with loops, where intervals say nothing.

        ``reached`` are those that some states have, beside which bounds need not be sharper.
        """
        if self._closed is not None:
            return None
        found = [
            np.maximum(self._bound(part, reached[part]), reached[part])
            for part in range(len(PARTS))
        ]
        return np.array([*found, np.sum(found, axis=0)])

    def _bound(self, part: int, reached: Floats) -> Floats:
        places = self._varying(part)
        low, high = (
            end[None, : len(self.box.low) + len(self.box.velocity)]
            for end in self.box.ends
        )
        upper = self._upper(part, low, high)
        settled, wanted = np.zeros(len(reached)), _SHARP * reached
        budget = _WORK // sum(term.cost(part) for term in self.terms)
        while places and budget > 0:
            worst = (upper / np.where(wanted > 0, wanted, 1.0)).max(axis=1)
            done = (upper <= wanted).all(axis=1)
            settled = np.maximum(settled, upper[done].max(axis=0, initial=0.0))
            low, high, upper, worst = (
                low[~done],
                high[~done],
                upper[~done],
                worst[~done],
            )
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
        return np.maximum(settled, upper.max(axis=0, initial=0.0))

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
        (q, qd), (q_high, qd_high) = (
            np.split(low, cut, axis=1),
            np.split(high, cut, axis=1),
        )
        ends = [term.enclosed(part, (q, q_high), (qd, qd_high)) for term in self.terms]
        least, most = (sum(end[k] for end in ends) for k in (0, 1))
        sizes = np.maximum(np.abs(least), np.abs(most))
        return sizes @ self.box.acceleration if sizes.ndim == 3 else sizes

    def _varying(self, part: int) -> list[int]:
        """Places of positions and velocities on which a part depends."""
        found = set[int]()
        for term in self.terms:
            function = term.base.function(_FUNCTIONS[part])
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


def _halved(low: Floats, high: Floats, place: int) -> Interval:
    """Both halves of boxes along a coordinate."""
    first, second = high.copy(), low.copy()
    first[:, place] = second[:, place] = (low[:, place] + high[:, place]) / 2
    return np.concatenate([low, second]), np.concatenate([first, high])
