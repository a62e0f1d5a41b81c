"""Which sensors see what: ranks of subsets of a machine's sensors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from echelon.base.own import at_stated_values
from echelon.base.structure import find_structure
from echelon.errors import DegenerateSampleError, EchelonError
from echelon.exact.elimination import rank, reduced_echelon
from echelon.exact.field import PrimeField, Residues
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.output import Cut, Output, plain
from echelon.mechanism.placement import Placement
from echelon.regressor.linear import LinearForms
from echelon.regressor.virtual_power import virtual_power_form
from echelon.seeds import DEFAULT_SEED, random_generator

_SURPLUS = 8
_FIELDS = 2
_ATTEMPTS = 8
_MOST_SUBSETS = 50_000
"""Subsets tried in the search for a smallest sufficient one."""


@dataclass(frozen=True)
class SensorReport:
    """Ranks of sensor subsets.

    Attributes
    ----------
    sensors : tuple of str
        A force/torque sensor counts as one, with all its components.
    parameters : int
        Number of standard parameters.
    rank : int
        Number of base parameters that all sensors together see.
    ranks : mapping of tuple of str to int
        Rank of every subset up to the requested size.
    greedy : tuple of (str, int)
        The sensor that adds most, the next, and so on until nothing is added, each with the rank reached.
    smallest : tuple of str
        A smallest subset that sees as much as all.
    proven_smallest : bool
        Whether all smaller subsets were tried; otherwise ``smallest`` is the greedy choice.
    seed : int
    """

    sensors: tuple[str, ...]
    parameters: int
    rank: int
    ranks: Mapping[tuple[str, ...], int]
    greedy: tuple[tuple[str, int], ...]
    smallest: tuple[str, ...]
    proven_smallest: bool
    seed: int


def sensor_report(mechanism: Mechanism, size: int = 1, *, seed: int = DEFAULT_SEED) -> SensorReport:
    """What each subset of a mechanism's sensors sees.

    Parameters
    ----------
    mechanism : Mechanism
        Its outputs are the candidates; where none are stated, all actuators and a wrench sensor under the base.  The
        stated values of its symbols decide.
    size : int
        Ranks of all subsets up to this size are listed.
    seed : int

    Returns
    -------
    SensorReport

    Examples
    --------
    >>> import echelon as ec
    >>> report = ec.sensor_report(ec.load("examples/panda.yaml"))
    >>> report.rank, report.ranks["base",], report.smallest
    (48, 48, ('base',))
    """
    mechanism = at_stated_values(mechanism)
    groups = _candidates(mechanism)
    spaces = _Spaces(mechanism, groups, random_generator(seed))
    names = tuple(groups)
    total = spaces.rank(names)
    ranks = {s: spaces.rank(s) for k in range(1, min(size, len(names)) + 1) for s in combinations(names, k)}
    greedy = _greedy(names, spaces, total)
    smallest, proven = _smallest(names, spaces, total, [name for name, _ in greedy])
    return SensorReport(names, len(mechanism.parameters), total, ranks, tuple(greedy), smallest, proven, seed)


def _candidates(mechanism: Mechanism) -> dict[str, tuple[Output, ...]]:
    """Outputs by sensor."""
    outputs = list(mechanism.outputs)
    if mechanism.measured is None:
        for axis in range(3):
            for angular in (False, True):
                component = f"base.{'t' if angular else 'f'}{'xyz'[axis]}"
                cut = Cut(GROUND, Placement(), False, axis, angular)
                outputs.append(plain(component, "N·m" if angular else "N", cut))
    groups: dict[str, list[Output]] = {}
    for output in outputs:
        is_wrench = all(isinstance(channel, Cut) for channel, _ in output.terms)
        groups.setdefault(output.name.rpartition(".")[0] if is_wrench else output.name, []).append(output)
    return {name: tuple(group) for name, group in groups.items()}


class _Spaces:
    """Row spaces of the sensors modulo primes, at one random geometry each."""

    def __init__(self, mechanism: Mechanism, groups: Mapping[str, tuple[Output, ...]], rng: np.random.Generator):
        self._forms = {name: virtual_power_form(replace(mechanism, measured=group)) for name, group in groups.items()}
        if mechanism.closures:
            structure = find_structure(mechanism, rng)
            self._forms = {name: structure.on_curves(forms) for name, forms in self._forms.items()}
        self._known: dict[tuple[str, ...], int] = {}
        self._bases: list[tuple[PrimeField, dict[str, Residues]]] = []
        for _ in range(_ATTEMPTS):
            field = PrimeField.random(rng)
            try:
                self._bases.append((field, _row_spaces(self._forms, field, rng)))
            except DegenerateSampleError:
                continue
            if len(self._bases) == _FIELDS:
                return
        raise EchelonError("every random point is singular; please report this model")

    def rank(self, names: Sequence[str]) -> int:
        """Rank of the sensors together; an unlucky point could only lower it, so the larger of two counts."""
        key = tuple(names)
        if key not in self._known:
            self._known[key] = max(
                rank(np.vstack([spaces[name] for name in names]), field) if names else 0
                for field, spaces in self._bases
            )
        return self._known[key]


def _row_spaces(forms: Mapping[str, LinearForms], field: PrimeField, rng: np.random.Generator) -> dict[str, Residues]:
    """A basis of every sensor's row space."""
    samplers = {name: f.sampler() for name, f in forms.items()}
    symbols = sorted({s for sampler in samplers.values() for s in sampler.symbols})
    geometry = {s: field.draw(rng, (1,)) for s in symbols}
    spaces: dict[str, Residues] = {}
    for name, sampler in samplers.items():
        columns = forms[name].shape[1]
        own = {s: geometry[s] for s in sampler.symbols}
        states, seen = max(columns + _SURPLUS, sampler.regions), -1
        while True:
            matrix = forms[name].stacked(sampler.evaluate(field, rng, states, own))[0]
            reduced, pivots = reduced_echelon(matrix, field)
            if sampler.regions == 1 or len(pivots) == seen:
                break
            states, seen = 2 * states, len(pivots)  # a region of signs may have more to show
        rows = [[int(x) for x in row] for row in reduced.tolist()[: len(pivots)]]
        spaces[name] = np.array(rows, dtype=np.int64).reshape(len(pivots), columns)
    return spaces


def _greedy(names: Sequence[str], spaces: _Spaces, total: int) -> list[tuple[str, int]]:
    chosen: list[tuple[str, int]] = []
    reached = 0
    while reached < total:
        taken = [name for name, _ in chosen]
        left = [name for name in names if name not in taken]
        best = max(left, key=lambda name: spaces.rank([*taken, name]))
        reached = spaces.rank([*taken, best])
        chosen.append((best, reached))
    return chosen


def _smallest(names: Sequence[str], spaces: _Spaces, total: int, greedy: Sequence[str]) -> tuple[tuple[str, ...], bool]:
    """A smallest subset with the full rank, and whether the search was complete."""
    tried = 0
    for size in range(len(greedy)):
        for subset in _promising(names, spaces, total, size):
            tried += 1
            if tried > _MOST_SUBSETS:
                return tuple(greedy), False
            if spaces.rank(subset) == total:
                return subset, True
    return tuple(greedy), True


def _promising(names: Sequence[str], spaces: _Spaces, total: int, size: int) -> Iterable[tuple[str, ...]]:
    """Subsets whose members see enough, if they all saw different things."""
    alone = {name: spaces.rank([name]) for name in names}
    return (s for s in combinations(names, size) if sum(alone[name] for name in s) >= total)
