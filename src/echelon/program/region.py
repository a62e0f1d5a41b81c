"""Real points of every region: which signs can occur together, and where logarithms and roots are real.

A sign is constant on a region of the real inputs, and not every combination of signs is a region: sign(x), sign(y) and
sign(x + y) have six of eight.  The row space of a model is that of the union over its regions.  Within a region all is
analytic, so random points of a field stand for any of its points once the signs are known; so signs are taken from
regions that surely exist (:mod:`echelon.program.region_search`), and every sample set visits all of them in turn.

Points on the surfaces themselves, where a sign is zero, are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from zlib import crc32

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.exact.numbers import Rational
from echelon.program.operations import Op
from echelon.program.region_search import BUDGET, COMPLETE, EXHAUSTED, RegionSearch
from echelon.program.surfaces import RealValues, find_surfaces
from echelon.program.tape import Program
from echelon.seeds import DEFAULT_SEED, random_generator

SAMPLED = "sampled"
_ATTEMPTS = 16
_SPREAD = 1.5
_ENDED = {
    EXHAUSTED: "no change of one sign led to another",
    BUDGET: "the search ended by its budget",
    SAMPLED: "they are those of random closed states at all speeds",
}


@dataclass(frozen=True)
class RegionReport:
    """Which regions were visited, and why no others."""

    count: int  # regions visited; those whose signs make the same products as others are left out
    # ``"complete"`` if no other region can add anything, ``"exhausted"`` if no change of one sign led to another that
    # does, ``"budget"`` if the search was cut short, ``"sampled"`` if regions are those of random closed states
    ended: str
    remarks: tuple[str, ...] = ()  # signs of which only one side is known, and constants that were given a value

    def __str__(self) -> str:
        regions = f"in {self.count} region{'s' * (self.count != 1)} of signs"
        if self.ended == COMPLETE:
            text = f"{regions}, which is enough for all products of signs that occur"
        else:
            text = f"{regions}; assumed: that no other region adds anything ({_ENDED[self.ended]})"
        return "; ".join([text, *self.remarks])


class RealPoints:
    """Random real points where a program's outputs are real."""

    def __init__(
        self,
        program: Program,
        outputs: Sequence[int],
        values: Mapping[str, Rational | float] | None = None,
    ) -> None:
        self.program, self._stated = program, values or {}
        self._inputs = [n for n in program.needed(outputs) if program.ops[n] == Op.INPUT]
        self._surfaces = find_surfaces(program, outputs)

    @property
    def has_signs(self) -> bool:
        """Whether there are regions of signs, and not only of a domain."""
        return bool(self._surfaces.signs)

    @property
    def count(self) -> int:
        """Number of regions."""
        return len(self._search.regions)

    @cached_property
    def report(self) -> RegionReport:
        """What was visited."""
        return RegionReport(self.count, self._search.ended, (*self._one_sided(), *self._unstated()))

    @cached_property
    def _search(self) -> RegionSearch:
        """All regions, at constants where the domain is not empty."""
        previous = None
        for attempt in range(_ATTEMPTS):
            values = RealValues(self._surfaces, self._constants(attempt))
            if values.constants == previous:
                break
            search, previous = RegionSearch(values, random_generator(DEFAULT_SEED)), values.constants
            if search.regions:
                search.run()
                return search
        raise InputError("no real point was found at which all logarithms and square roots of the model are real")

    def _constants(self, attempt: int) -> dict[int, Rational | float]:
        """Constants of the model; those not stated have a value that only their name decides."""
        found: dict[int, Rational | float] = {}
        for n in self._inputs:
            entry = self.program.inputs[n]
            if entry.role == "symbol":
                drawn = random_generator(crc32(entry.name.encode()) + attempt).standard_normal()
                found[n] = self._stated.get(entry.name, float(np.exp(_SPREAD * drawn)))
        return found

    def draw(self, rng: np.random.Generator, samples: int) -> dict[int, Floats]:
        """Values of the inputs and of the arguments of signs, at points of all regions in turn."""
        # shapes: returns (samples,)
        search, values = self._search, self._search.values
        turns = [search.regions[k % self.count] for k in range(samples)]
        points = np.stack([r.points[int(rng.integers(len(r.points)))] for r in turns], axis=1)
        signs = np.stack([r.signs for r in turns], axis=1)
        points, table = self._moved(rng, points, signs)
        reals = {n: np.full(samples, float(x)) for n, x in self._constants_used().items()}
        for n in self._inputs:
            if n not in reals:
                size = np.exp(_SPREAD * rng.standard_normal(samples))
                reals[n] = size * rng.choice([-1.0, 1.0], samples)
        reals |= {n: points[k] for k, n in enumerate(values.variables)}
        for k, n in enumerate(self._surfaces.nodes):
            if n not in self._inputs:
                reals[n] = signs[k] * np.maximum(np.abs(table[k]), np.finfo(float).tiny)
        return reals

    def _constants_used(self) -> Mapping[int, Rational | float]:
        return self._search.values.constants

    def _moved(self, rng: np.random.Generator, points: Floats, signs: npt.NDArray[np.int8]) -> tuple[Floats, Floats]:
        """Points at random places of their regions, with the values of the surfaces there."""
        values, zero = self._search.values, self._search.zero
        size = np.where(points == 0, 1.0, np.abs(points)) * 10 ** rng.uniform(-12, 0, points.shape[1])
        moved = values.normal(points + size * rng.standard_normal(points.shape))
        table = values.at(moved)
        same = values.in_domain(table)
        for k, n in enumerate(self._surfaces.nodes):
            if n not in zero:
                same &= np.sign(table[k]) == signs[k]
        points = np.where(same, moved, points)
        return points, values.at(points)

    # -- remarks -----------------------------------------------------------------------------------------------------

    def _one_sided(self) -> list[str]:
        """Signs of which only one side is known."""
        program, search = self.program, self._search
        signs = self._surfaces.signs - set(self._surfaces.positive)
        remarks = []
        for k, n in enumerate(self._surfaces.nodes):
            seen = {int(r.signs[k]) for r in search.regions}
            if n not in signs or len(seen) > 1:
                continue
            sign = seen.pop()
            known = "everywhere" if n in search.constant else "" if sign else "as far as 512 bits tell"
            remarks.append(one_sided(program, n, sign, known))
        return remarks

    def _unstated(self) -> list[str]:
        """Constants without a value that a surface depends on."""
        drawn = [n for n in self._surfaces.inputs if n in self._constants_used()]
        inputs, values = self.program.inputs, self._constants_used()
        shown = [f"{inputs[n].name} = {float(values[n]):.3g}" for n in drawn if inputs[n].name not in self._stated]
        return [f"regions as for {', '.join(shown)}, which have no stated value"] if shown else []


def one_sided(program: Program, node: int, sign: int, known: str = "") -> str:
    """What to say of a sign of which only one side was seen."""
    from echelon.program.sympy_bridge import to_sympy

    kind = {1: "positive", -1: "negative", 0: "zero"}[sign]
    shown = to_sympy(program, [node])[0]
    return f"sign({shown}): {f'{kind} {known}' if known else f'only {kind} values were found'}"
