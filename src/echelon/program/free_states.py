"""Random real states of a program whose inputs are free: in the domain of its functions and in all regions of signs.

States are exact: inputs are doubles, taken as the dyadic fractions that they are, quaternions are normalised in ball
arithmetic, and symbols have exact values as text: the stated ones, and random positive ones where none are stated.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from zlib import crc32

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, SignArray
from echelon.errors import InputError
from echelon.exact.field import DEFAULT_SEED, random_generator
from echelon.exact.polynomial import Rational
from echelon.program.arithmetics import Balls, ball, stated_ball
from echelon.program.operations import Op
from echelon.program.region import BUDGET, COMPLETE, EXHAUSTED, RegionSearch
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.surfaces import RealValues, find_surfaces
from echelon.program.tape import Program

_ATTEMPTS = 16
"""Sets of random values that are tried for symbols without one until the domain is not empty."""
_SPREAD, _STATE_SPREAD = 1.5, 0.5
"""Standard deviation of the logarithm of random values: most lie between 1/20 and 20; those of states, where functions
grow fast, between 1/3 and 3."""
_FINENESS = 512
"""Random values of symbols are multiples of its inverse, so that they are short."""
_TAME = 4
"""Points of each region that states are drawn around: those whose inputs are nearest to one, where functions are tame."""
_MOVES = 10.0 ** -np.arange(12, -1, -3)
"""Random moves within regions, beside the size of inputs; of those that stay in the region the largest one counts."""
_STEEP = 16.0
"""Largest wanted arguments of exp and tanh: beyond, they are almost 0, 1 or ±1 beside others, and hide what they do."""
_TRIES = 120
"""Random changes of inputs by factors of up to 16, by which arguments become smaller than that where they can."""
_POOL = 64
"""States that are drawn at once, which takes little longer than one."""
_ENDED = {EXHAUSTED: "no change of one sign led to another", BUDGET: "the search ended by its budget"}


@dataclass(frozen=True)
class RegionReport:
    """Which regions of signs were visited, and why no others."""

    count: int  # regions visited; those whose signs make the same products as others are left out
    # ``"complete"`` if no other region can add anything, ``"exhausted"`` if no change of one sign led to another that
    # does, ``"budget"`` if the search was cut short
    ended: str
    remarks: tuple[str, ...] = ()  # signs of which only one side is known, and constants that were given a value

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

    def __init__(self, program: Program, outputs: Sequence[int], stated: Mapping[str, str] | None = None) -> None:
        self.program, self._stated = program, stated or {}
        needed = [n for n in program.needed(outputs) if program.ops[n] == Op.INPUT]
        whole = (n for group in program.unit_groups if not set(group).isdisjoint(needed) for n in group)
        self._inputs = list(dict.fromkeys((*needed, *whole)))
        self._surfaces = find_surfaces(program, outputs)
        self._steep = sorted({program.lhs[n] for n in program.needed(outputs) if program.ops[n] in (Op.EXP, Op.TANH)})
        self._jumps = any(program.ops[n] == Op.ATAN for n in program.needed(outputs))
        self._known: dict[int, Floats] = {}
        self._rng = random_generator(DEFAULT_SEED)

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
        """What was visited."""
        return RegionReport(self.count, self._found[0].ended, (*self._one_sided(), *self._unstated()))

    # -- regions -----------------------------------------------------------------------------------------------------

    @cached_property
    def _found(self) -> tuple[RegionSearch, Mapping[str, str]]:
        """All regions, at values of the symbols where the domain is not empty."""
        previous: Mapping[str, str] | None = None
        for attempt in range(_ATTEMPTS):
            values = self._drawn_values(attempt)
            if values == previous:
                break
            numbers = {n: _number(values[g.name]) for n in self._inputs if (g := self.program.inputs[n]).name in values}
            search, previous = RegionSearch(RealValues(self._surfaces, numbers), random_generator(DEFAULT_SEED)), values
            if search.regions:
                search.run()
                return search, values
        raise InputError("no real point was found at which all logarithms and square roots of the model are real")

    def _drawn_values(self, attempt: int) -> dict[str, str]:
        """Stated values, and values that only the name and the attempt decide."""
        found = dict[str, str]()
        for given in (self.program.inputs[n] for n in self._inputs):
            if given.role == "symbol":
                drawn = random_generator(crc32(given.name.encode()) + attempt).standard_normal()
                numerator = 1 + int(_FINENESS * np.exp(_SPREAD * drawn))
                found[given.name] = self._stated.get(given.name, str(Fraction(numerator, _FINENESS)))
        return found

    def signs(self, states: int) -> dict[int, SignArray]:
        """Signs of the surfaces, by node, in all regions in turn."""
        regions = self._found[0].regions
        table = np.stack([regions[k % len(regions)].signs for k in range(states)], axis=1)
        return dict(zip(self._surfaces.nodes, table, strict=True))

    # -- states ------------------------------------------------------------------------------------------------------

    def known(self, first: int, count: int) -> dict[int, Floats]:
        """Some of a sequence of states that is drawn once, in all regions in turn: values of inputs by node."""
        while first + count > len(next(iter(self._known.values()), ())):
            more = self.draw(self._rng, self.count * max(1, _POOL // self.count))
            if not more:
                return {}
            self._known = {n: np.concatenate([self._known.get(n, x[:0]), x]) for n, x in more.items()}
        return {n: x[first : first + count] for n, x in self._known.items()}

    def draw(self, rng: np.random.Generator, states: int) -> dict[int, Floats]:
        """Values of the inputs, by node, at random states of all regions in turn, each of shape (states,)."""
        search = self._found[0]
        turns = [search.regions[k % self.count] for k in range(states)]
        wide = rng.random(states) < 0.5 * self._jumps
        near = [r.points[int(rng.integers(len(r.points) if w else min(_TAME, len(r.points))))]
                for r, w in zip(turns, wide, strict=True)]
        points = np.stack(near, axis=1)
        signs = np.stack([r.signs for r in turns], axis=1)
        free = [n for n in self._inputs if self.program.inputs[n].role != "symbol"]
        found = {n: _random_numbers(rng, states) for n in free}
        found |= dict(zip(search.values.variables, self._moved(rng, points, signs), strict=True))
        return self._tamed(rng, found, signs) if self._steep and free else found

    def _moved(self, rng: np.random.Generator, points: Floats, signs: SignArray) -> Floats:
        """Points at random places of their regions."""
        result = points
        directions = np.where(points == 0, 1.0, np.abs(points)) * rng.standard_normal(points.shape)
        for size in _MOVES:
            moved = self._found[0].values.normal(points + size * directions)
            result = np.where(self._inside(moved, signs), moved, result)
        return result

    def _inside(self, points: Floats, signs: SignArray) -> npt.NDArray[np.bool_]:
        """Which points are in their regions."""
        search = self._found[0]
        tested = [k for k, n in enumerate(self._surfaces.nodes) if n not in search.zero]
        table = search.values.at(points)
        same = search.values.in_domain(table) & (np.sign(table[tested]) == signs[tested]).all(axis=0)
        return np.asarray(same, dtype=bool)

    def _tamed(self, rng: np.random.Generator, states: dict[int, Floats], signs: SignArray) -> dict[int, Floats]:
        """States of the same regions at which arguments of exp and tanh are moderate, where there are such."""
        schedule, variables = Schedule(self.program, self._steep), self._found[0].values.variables
        nodes, count = [*states], signs.shape[1]
        constants = {n: np.full(count, float(_number(self.values[self.program.inputs[n].name])))
                     for n in schedule.leaves if n not in states}
        places = [nodes.index(n) for n in variables]
        moving = [k for k, n in enumerate(nodes) if n in schedule.leaves]

        def excess(table: Floats) -> Floats:
            leaves = {**constants, **{n: table[k] for k, n in enumerate(nodes)}}
            with np.errstate(all="ignore"):
                sizes = np.abs(schedule.run(FloatArithmetic(), leaves, count)) / _STEEP
            return np.asarray(np.log(np.maximum(np.nan_to_num(sizes, nan=np.inf), 1.0)).sum(axis=0))

        table = np.stack([states[n] for n in nodes])
        cost = excess(table)
        for _ in range(_TRIES if moving else 0):
            if not cost.any():
                break
            tried = table.copy()
            tried[rng.choice(moving, count), np.arange(count)] *= 2.0 ** rng.integers(-4, 5, count)
            better = excess(tried)
            kept = (better < cost) & self._inside(tried[places], signs)
            table, cost = np.where(kept, tried, table), np.where(kept, better, cost)
        return dict(zip(nodes, table, strict=True))

    def leaves(
        self, nodes: Iterable[int], states: Mapping[int, Floats], at: Sequence[Mapping[str, str]]
    ) -> dict[int, Balls]:
        """Balls of inputs at some states, at each of some values of the symbols, each of shape (at · states,).

        Symbols have :attr:`values` where no others are given.
        """
        count, inputs = len(next(iter(states.values()), (0.0,))), self.program.inputs
        found = dict[int, Balls]()
        for group in (group for group in self.program.unit_groups if not states.keys().isdisjoint(group)):
            parts = {n: _balls(states[n]) for n in group if n in states}
            lengths = np.array([x.sqrt() for x in np.sum([part * part for part in parts.values()], axis=0)])
            found |= {n: part / lengths for n, part in parts.items()}
        found = {n: np.tile(found.get(n, _balls(x)), len(at)) for n, x in states.items()}
        for node in nodes:
            if inputs[node].role == "symbol":
                name = inputs[node].name
                values = [stated_ball(given.get(name) or self.values[name]) for given in at]
                found[node] = np.repeat(np.array(values, dtype=object), count)
        return {node: found[node] for node in nodes}

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
                known = "everywhere" if n in search.constant else "" if sign else "as far as 512 bits tell"
                remarks.append(_one_side(self.program, n, sign, known))
        return remarks

    def _unstated(self) -> list[str]:
        """Constants without a value that a surface depends on."""
        shown = [f"{name} = {float(_number(self.values[name])):.3g}" for name in self.constants if name not in self._stated]
        return [f"regions as for {', '.join(shown)}, which have no stated value"] if shown else []


def _random_numbers(rng: np.random.Generator, count: int) -> Floats:
    """Random numbers of either sign, half of them of one, the others of up to sixteen."""
    sizes = np.exp(_STATE_SPREAD * rng.standard_normal(count)) * 2.0 ** (rng.integers(0, 2, count) * rng.integers(0, 5, count))
    return np.asarray(sizes * rng.choice([-1.0, 1.0], count))


def _balls(values: Floats) -> Balls:
    return np.array([ball(float(x)) for x in values], dtype=object)


def _number(text: str) -> Rational | float:
    """The number that a value is, or the double next to it."""
    try:
        return Fraction(text)
    except ValueError:
        return float(stated_ball(text).mid())


def _one_side(program: Program, node: int, sign: int, known: str) -> str:
    """What to say of a sign of which only one side was seen."""
    from echelon.program.sympy_bridge import to_sympy

    kind = {1: "positive", -1: "negative", 0: "zero"}[sign]
    shown = to_sympy(program, [node])[0]
    return f"sign({shown}): {f'{kind} {known}' if known else f'only {kind} values were found'}"
