"""Random real states of a program whose inputs are free: in the domain of its functions and in all regions of signs.

In a region of signs all is analytic, and what vanishes there vanishes wherever it is continued to.  So signs are leaves
with the values of a region.  Where there are no logarithms, roots and arc tangents, whose domains have pieces,
the inputs are those of any point, where exp and the like are tame: those of a region near x = 1e6 would be at e^1e6.

States are exact: inputs are doubles, taken as the dyadic fractions that they are, quaternions are normalised in ball
arithmetic, and symbols have exact values as text: the stated ones, and random positive ones where none are stated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from zlib import crc32

import numpy as np

from echelon.algebra.exact.field import DEFAULT_SEED, MOST_ATTEMPTS, random_generator
from echelon.algebra.exact.polynomial import Rational
from echelon.algebra.program.arithmetics import Balls, ball, stated_ball
from echelon.algebra.program.operations import Op
from echelon.algebra.program.region import BUDGET, COMPLETE, EXHAUSTED, RegionSearch
from echelon.algebra.program.region_moves import SPREAD
from echelon.algebra.program.rewriting import without_absolutes
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.surfaces import RealValues, find_surfaces
from echelon.algebra.program.tape import Program
from echelon.shared import Floats, InputError, SignArray

_STATE_SPREAD = SPREAD / 3
"""Standard deviation of the logarithm of random states, where functions grow fast: most lie between 1/3 and 3."""
_FINENESS = 512
"""Random values of symbols are multiples of its inverse, so that they are short."""
_TAME = 4
"""Points of a region that states are drawn around: those whose inputs are nearest to one, where functions are tame."""
_MOVES = 10.0 ** -np.arange(12, -1, -3)
"""Random moves within regions, beside the size of inputs; of those that stay in the region the largest one counts."""
_STEEP = 16.0
"""Largest wanted arguments of exp and tanh: beyond, they are almost 0, 1 or ±1 beside others, and hide what they do."""
_TRIES = 24
"""Random changes of inputs by factors of up to 16, for each such argument, by which it is made moderate."""
_POOL = 64
"""States that are drawn at once, which takes little longer than one."""
_ENDED = {
    EXHAUSTED: "no change of one sign led to another",
    BUDGET: "the search ended by its budget",
}


States = Mapping[int, Floats]
"""Values of inputs, and of signs, by node, each of shape (states,)."""


@dataclass(frozen=True)
class RegionReport:
    """Which regions of signs were visited, and why no others."""

    count: int  # regions visited; those whose signs make the same products as others are left out
    # ``"complete"`` if no other region can add anything, ``"exhausted"`` if no change of one sign led to another that
    # does, ``"budget"`` if the search was cut short
    ended: str
    remarks: tuple[
        str, ...
    ] = ()  # signs of which only one side is known, and constants that were given a value

    @property
    def unseen(self) -> str:
        """Words about regions that may add something and were not visited; empty if there are none."""
        if self.ended == COMPLETE:
            return ""
        return f"regions of signs beyond the {self.count} that were visited ({_ENDED[self.ended]})"

    def __str__(self) -> str:
        regions = f"in {self.count} region{'s' * (self.count != 1)} of signs"
        if self.ended == COMPLETE:
            text = f"{regions}, which is enough for all products of signs that occur"
        else:
            text = f"{regions}; assumed: that no other region adds anything ({_ENDED[self.ended]})"
        return "; ".join([text, *self.remarks])


class RealPoints:
    """Random real points where a program's outputs are real.

    Parameters
    ----------
    program : Program
    outputs : sequence of int
        Nodes.
    stated : mapping of str to str, optional
        Exact values of symbols as text.

    Raises
    ------
    InputError
        At first use, if no point is found in the domain.
    """

    def __init__(
        self,
        program: Program,
        outputs: Sequence[int],
        stated: Mapping[str, str] | None = None,
    ) -> None:
        program, self._places = without_absolutes(program, outputs)
        outputs = [self._places[n] for n in outputs]
        self.program, self.outputs, self._stated = program, outputs, stated or {}
        needed = [n for n in program.needed(outputs) if program.ops[n] == Op.INPUT]
        whole = (
            n
            for group in program.unit_groups
            if not set(group).isdisjoint(needed)
            for n in group
        )
        self._inputs = list(dict.fromkeys((*needed, *whole)))
        self._surfaces = find_surfaces(program, outputs)
        self._signs = [n for n in program.needed(outputs) if program.ops[n] == Op.SIGN]
        self._steep = sorted(
            {
                program.lhs[n]
                for n in program.needed(outputs)
                if program.ops[n] in (Op.EXP, Op.TANH)
            }
        )
        self._jumps = any(program.ops[n] == Op.ATAN for n in program.needed(outputs))
        self._known: States = {}
        self._rng = random_generator(DEFAULT_SEED)

    def of(self, outputs: Sequence[int]) -> RealPoints:
        """Copy that evaluates some of the outputs at these points."""
        _ = self._found  # is searched for once
        found = copy(self)
        found.__dict__.pop("rows", None)
        found.outputs = [self._places[n] for n in outputs]
        return found

    @cached_property
    def rows(self) -> Schedule:
        """Evaluates the outputs; signs are leaves."""
        return self.schedule(self.outputs)

    @property
    def has_signs(self) -> bool:
        """Whether there are regions of signs, and not only of a domain."""
        return bool(self._surfaces.signs)

    @property
    def count(self) -> int:
        """Number of regions."""
        return len(self._found[0].regions)

    @property
    def values(self) -> Mapping[str, str]:
        """Exact values of all symbols that the outputs depend on, as text."""
        return self._found[1]

    @property
    def constants(self) -> list[str]:
        """Symbols that surfaces depend on, sorted."""
        used = (self.program.inputs[n] for n in self._surfaces.inputs)
        return sorted(given.name for given in used if given.role == "symbol")

    @cached_property
    def report(self) -> RegionReport:
        """Report of the regions that the points visit."""
        return RegionReport(
            self.count, self._found[0].ended, (*self._one_sided(), *self._unstated())
        )

    # -- regions -----------------------------------------------------------------------------------------------------

    @cached_property
    def _found(self) -> tuple[RegionSearch, Mapping[str, str]]:
        """All regions, at values of the symbols where the domain is not empty."""
        previous: Mapping[str, str] | None = None
        for attempt in range(MOST_ATTEMPTS):
            values = self._drawn_values(attempt)
            if values == previous:
                break
            numbers = {
                n: _number(values[g.name])
                for n in self._inputs
                if (g := self.program.inputs[n]).name in values
            }
            search = RegionSearch(
                RealValues(self._surfaces, numbers), random_generator(DEFAULT_SEED)
            )
            previous = values
            if search.regions:
                search.run()
                return search, values
        raise InputError(
            "no real point was found at which all logarithms and square roots of the model are real"
        )

    def _drawn_values(self, attempt: int) -> dict[str, str]:
        """Stated values, and values that only the name and the attempt decide."""
        found = dict[str, str]()
        for given in (self.program.inputs[n] for n in self._inputs):
            if given.role == "symbol":
                drawn = random_generator(
                    crc32(given.name.encode()) + attempt
                ).standard_normal()
                numerator = 1 + int(_FINENESS * np.exp(SPREAD * drawn))
                found[given.name] = self._stated.get(
                    given.name, str(Fraction(numerator, _FINENESS))
                )
        return found

    def signs(self, states: int) -> dict[int, SignArray]:
        """Values of signs, by node, at states of all regions in turn."""
        regions = self._found[0].regions
        place = {n: k for k, n in enumerate(self._surfaces.nodes)}
        table = np.stack(
            [regions[k % len(regions)].signs for k in range(states)], axis=1
        )
        return {n: table[place[self.program.lhs[n]]] for n in self._signs}

    def schedule(self, nodes: Sequence[int]) -> Schedule:
        """Evaluates nodes; signs are leaves."""
        return Schedule(self.program, nodes, self._signs)

    # -- states ------------------------------------------------------------------------------------------------------

    def known(self, first: int, count: int) -> States:
        """Some of a sequence of states that is drawn once, in all regions in turn."""
        while first + count > len(next(iter(self._known.values()), ())):
            more = self.draw(self._rng, self.count * max(1, _POOL // self.count))
            if not more:
                return {}
            self._known = {
                n: np.concatenate([self._known.get(n, x[:0]), x])
                for n, x in more.items()
            }
        return {n: x[first : first + count] for n, x in self._known.items()}

    def draw(self, rng: np.random.Generator, states: int) -> States:
        """Random states of all regions in turn."""
        search = self._found[0]
        turns = [search.regions[k % self.count] for k in range(states)]
        wide = rng.random(states) < 0.5 * self._jumps
        near = [
            r.points[
                int(rng.integers(len(r.points) if w else min(_TAME, len(r.points))))
            ]
            for r, w in zip(turns, wide, strict=True)
        ]
        inputs = {
            n: _random_numbers(rng, states)
            for n in self._inputs
            if n not in self._constants
        }
        inputs |= dict(
            zip(search.values.variables, np.stack(near, axis=1), strict=True)
        )
        signs = {n: x.astype(np.float64) for n, x in self.signs(states).items()}
        kept = {
            n: np.array([r.signs[k] for r in turns])
            for k, n in enumerate(self._surfaces.nodes)
            if n in self._kept
        }
        return {**self._walked(rng, inputs, signs, kept), **signs}

    @cached_property
    def _kept(self) -> list[int]:
        """Surfaces that states do not cross."""
        surfaces = self._surfaces
        crossed = (
            surfaces.signs | self._found[0].zero
            if surfaces.entire
            else self._found[0].zero
        )
        return [n for n in surfaces.nodes if n not in crossed]

    @cached_property
    def _constants(self) -> dict[int, float]:
        """Values of the symbols in doubles."""
        inputs = self.program.inputs
        return {
            n: float(_number(self.values[inputs[n].name]))
            for n in self._inputs
            if inputs[n].role == "symbol"
        }

    def _walked(
        self,
        rng: np.random.Generator,
        inputs: States,
        signs: States,
        kept: Mapping[int, SignArray],
    ) -> States:
        """Points on the same side of some surfaces, at random places where arguments of exp and tanh are moderate."""
        if not inputs:
            return {}
        nodes, count, positive = [*inputs], count_of(inputs), self._surfaces.positive
        schedule = self.schedule([*positive, *kept, *self._steep])
        sides = np.array([*kept.values()]).reshape(len(kept), count)
        constants = {n: np.full(count, value) for n, value in self._constants.items()}

        def excess(table: Floats) -> tuple[Floats, Floats]:
            """Excess of arguments over the moderate size, (arguments, states), and its sum; infinite outside."""
            leaves = {
                **constants,
                **signs,
                **self._normal(dict(zip(nodes, table, strict=True))),
            }
            with np.errstate(all="ignore"):
                found = schedule.run(FloatArithmetic(), leaves, count)
            first, last = len(positive), len(positive) + len(kept)
            inside = (found[:first] > 0).all(axis=0) & (
                np.sign(found[first:last]) == sides
            ).all(axis=0)
            sizes = np.log(
                np.maximum(
                    np.nan_to_num(np.abs(found[last:]), nan=np.inf) / _STEEP, 1.0
                )
            )
            return sizes, np.where(inside, sizes.sum(axis=0), np.inf)

        table = np.stack([inputs[n] for n in nodes])
        directions = np.where(table == 0, 1.0, np.abs(table)) * rng.standard_normal(
            table.shape
        )
        sizes, cost = excess(table)
        for size in _MOVES:
            tried = table + size * directions
            found, total = excess(tried)
            inside = np.isfinite(total)
            table = np.where(inside, tried, table)
            sizes = np.where(inside, found, sizes)
            cost = np.where(inside, total, cost)
        cones = [
            [k for k, n in enumerate(nodes) if n in self.program.needed([steep])]
            for steep in self._steep
        ]
        for _ in range(_TRIES * len(cones)):
            if not cost.any():
                break
            worst = [cones[k] or [0] for k in np.argmax(sizes, axis=0)]
            moved = [
                cone[int(k * len(cone))]
                for cone, k in zip(worst, rng.random(count), strict=True)
            ]
            tried = table.copy()
            tried[moved, np.arange(count)] *= 2.0 ** rng.integers(-4, 5, count)
            found, total = excess(tried)
            better = total < cost
            table = np.where(better, tried, table)
            sizes = np.where(better, found, sizes)
            cost = np.minimum(total, cost)
        return self._normal(dict(zip(nodes, table, strict=True)))

    def _normal(self, states: States) -> States:
        """States with quaternions of unit length, nearly."""
        for group in self.program.unit_groups:
            if not states.keys().isdisjoint(group):
                length = np.sqrt(np.sum([states[n] ** 2 for n in group], axis=0))
                states = {**states, **{n: states[n] / length for n in group}}
        return states

    def leaves(
        self, nodes: Iterable[int], states: States, at: Sequence[Mapping[str, str]]
    ) -> dict[int, Balls]:
        """Balls of inputs and signs at some states, at each of some values of the symbols, of shape (at · states,).

        Symbols have :attr:`values` where no others are given.
        """
        inputs = self.program.inputs
        balls = {
            n: np.array([ball(float(x)) for x in values], dtype=object)
            for n, values in states.items()
        }
        for group in self.program.unit_groups:
            if not balls.keys().isdisjoint(group):
                squares = np.sum([balls[n] * balls[n] for n in group], axis=0)
                length = np.array([x.sqrt() for x in squares])
                balls |= {n: balls[n] / length for n in group}
        found = dict[int, Balls]()
        for node in nodes:
            if node in balls:
                found[node] = np.tile(balls[node], len(at))
            else:
                name = inputs[node].name
                values = [
                    stated_ball(given.get(name) or self.values[name]) for given in at
                ]
                found[node] = np.repeat(
                    np.array(values, dtype=object), count_of(states)
                )
        return found

    # -- remarks -----------------------------------------------------------------------------------------------------

    def _one_sided(self) -> list[str]:
        """Signs of which only one side is known."""
        search = self._found[0]
        signs = self._surfaces.signs - set(self._surfaces.positive)
        remarks = []
        for k, n in enumerate(self._surfaces.nodes):
            seen = {int(r.signs[k]) for r in search.regions}
            if n in signs and len(seen) == 1:
                sign = seen.pop()
                known = (
                    "everywhere"
                    if n in search.constant
                    else ""
                    if sign
                    else "as far as 512 bits tell"
                )
                remarks.append(_one_side(self.program, n, sign, known))
        return remarks

    def _unstated(self) -> list[str]:
        """Constants without a value that a surface depends on."""
        shown = [
            f"{name} = {float(_number(self.values[name])):.3g}"
            for name in self.constants
            if name not in self._stated
        ]
        if shown:
            return [f"regions as for {', '.join(shown)}, which have no stated value"]
        return []


def _random_numbers(rng: np.random.Generator, count: int) -> Floats:
    """Random numbers of either sign, half of them of one, the others of up to sixteen."""
    sizes = np.exp(_STATE_SPREAD * rng.standard_normal(count)) * 2.0 ** (
        rng.integers(0, 2, count) * rng.integers(0, 5, count)
    )
    return np.asarray(sizes * rng.choice([-1.0, 1.0], count))


def count_of(states: States) -> int:
    """Number of states; one where nothing varies."""
    return len(next(iter(states.values()), (0.0,)))


def _number(text: str) -> Rational | float:
    """The number that a value is, or the double next to it."""
    try:
        return Fraction(text)
    except ValueError:
        return float(stated_ball(text).mid())


def _one_side(program: Program, node: int, sign: int, known: str) -> str:
    """Message about a sign of which only one side was visited."""
    from echelon.algebra.program.sympy_bridge import to_sympy

    kind = {1: "positive", -1: "negative", 0: "zero"}[sign]
    shown = to_sympy(program, [node])[0]
    return f"sign({shown}): {f'{kind} {known}' if known else f'only {kind} values were found'}"
