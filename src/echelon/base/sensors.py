"""Which sensors see what: ranks of subsets of a machine's sensors."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from math import comb
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    AGREEING_POINTS,
    DEFAULT_SEED,
    MOST_ATTEMPTS,
    SOLVING,
    PrimeField,
    Residues,
    Work,
    persistent,
    random_generator,
    rank,
)
from echelon.base.ball_spaces import spaces_of
from echelon.base.derive import silent
from echelon.base.row_space import row_space
from echelon.base.stated_values import at_stated_values, stated_structure
from echelon.dynamics import LinearForms, virtual_power_form
from echelon.robot import (
    GROUND,
    Cut,
    Experiment,
    Mechanism,
    Output,
    Placement,
    Readable,
    experiment_of,
    joined,
    mechanism_of,
    refuse_contacts,
)
from echelon.shared import (
    ClosedFormError,
    Count,
    DegenerateSampleError,
    DoubtWarning,
    EchelonError,
    InputError,
    NotNegative,
    public,
)

BALL_COST = 100
"""Cost of a rank in ball arithmetic, in ranks modulo a prime."""
Progress = Callable[[str], None]
Geometry = Mapping[str, Residues]


@public
@dataclass(frozen=True)
class SensorReport:
    """Ranks of sensor subsets.

    Attributes
    ----------
    kind : "sensors" or "experiments"
    sensors : tuple of str
        A force/torque sensor counts as one, with all its components; experiments, where the mechanism is of several.
    parameters : int
        Number of standard parameters.
    rank : int
        Number of base parameters that all sensors together see.
    added : tuple of (str, int)
        The sensors in their order, each with the rank that it reaches together with those before it.
    ranks : mapping of tuple of str to int
        Rank of every subset up to the requested size.
    greedy : tuple of (str, int)
        The sensor that adds most, the next, and so on until nothing is added, each with the rank reached.
    smallest : tuple of str
        A smallest subset that sees as much as all.
    proven_smallest : bool
        Whether no smaller subset suffices; otherwise ``smallest`` is the greedy choice.
    at_least : int
        No subset of fewer sensors suffices: all were tried, or see too little even if they all saw different things.
    seed : int
    """

    kind: Literal["sensors", "experiments"]
    sensors: tuple[str, ...]
    parameters: int
    rank: int
    added: tuple[tuple[str, int], ...]
    ranks: Mapping[tuple[str, ...], int]
    greedy: tuple[tuple[str, int], ...]
    smallest: tuple[str, ...]
    proven_smallest: bool
    at_least: int
    seed: int


@public
def plan(
    candidates: Sequence[Experiment],
    size: Count = 1,
    *,
    seed: int = DEFAULT_SEED,
    budget: NotNegative = 1.0,
    progress: Progress = silent,
) -> SensorReport:
    """The smallest choice of experiments that sees what all of them see together.

    Parameters
    ----------
    candidates : sequence of Experiment
    size, seed, budget, progress
        As for :func:`sensor_report`.

    Returns
    -------
    SensorReport
        With experiments in the place of sensors.  The greedy choice is at most 1 + ln(rank) times as large as a
        smallest one (Wolsey, Combinatorica 2, 1982), and ``at_least`` bounds that from below.

    Raises
    ------
    InputError
        If an experiment is not possible, or the budget does not suffice for the subsets that are to be listed.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/panda.yaml")
    >>> table, wall = ec.Experiment(robot, "table"), ec.Experiment(robot, "wall", gravity=(9.81, 0, 0))
    >>> held = ec.Experiment(robot, "held", locked={"j1": 0})
    >>> ec.plan([held, table, wall]).smallest
    ('wall',)
    """
    return sensor_report(
        joined(candidates), size, seed=seed, budget=budget, progress=progress
    )


@public
def sensor_report(
    mechanism: Mechanism | Readable,
    size: Count = 1,
    *,
    seed: int = DEFAULT_SEED,
    budget: NotNegative = 1.0,
    progress: Progress = silent,
) -> SensorReport:
    """Ranks of the subsets of a mechanism's sensors.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        Its outputs are the candidates; where none are stated, all actuators and a wrench sensor under the base.  The
        stated values of its symbols decide.
    size : int
        Ranks of all subsets up to this size are listed.
    seed : int
    budget : float
        How much work the subsets may take: 1 is a few seconds.  The rest goes into the search for a smallest
        sufficient one.
    progress : callable
        Told what is being done.

    Returns
    -------
    SensorReport

    Raises
    ------
    InputError
        If the budget does not suffice for all subsets that are to be listed.

    Warns
    -----
    DoubtWarning
        If a file with loops is rounded, so that the ranks, which are to its letter, are not those that are meant.

    Examples
    --------
    >>> import echelon as ec
    >>> report = ec.sensor_report(ec.load("examples/panda.yaml"))
    >>> report.rank, report.ranks["base",], report.smallest
    (48, 48, ('base',))
    """
    mechanism = at_stated_values(mechanism_of(mechanism))
    forms = _candidates(mechanism)
    spaces = _spaces(mechanism, forms, random_generator(seed), progress)
    names = tuple(forms)
    total = spaces.rank(names)
    added = [(name, spaces.rank(names[: k + 1])) for k, name in enumerate(names)]
    progress("adding the most informative sensors")
    greedy = _greedy(names, spaces, total)
    spaces.work = Work.of(budget)
    ranks = _listed(names, spaces, size, progress)
    progress("looking for the smallest sufficient set")
    smallest, at_least = _smallest(names, spaces, total, [name for name, _ in greedy])
    return SensorReport(
        "experiments" if mechanism.experiments else "sensors",
        names,
        len(mechanism.parameters),
        total,
        tuple(added),
        ranks,
        tuple(greedy),
        smallest,
        len(smallest) == at_least,
        at_least,
        seed,
    )


def _candidates(mechanism: Mechanism) -> dict[str, LinearForms]:
    """Rows of every sensor, or of every experiment; columns are those of the mechanism."""
    if mechanism.experiments:
        return {name: _rows_of(mechanism, name) for name in mechanism.experiments}
    refuse_contacts(
        mechanism,
        "with unknown forces, several sensors together see more than the sum of each: derive each choice of "
        "outputs instead, as experiments with other sensors",
    )
    outputs = list(mechanism.outputs)
    if mechanism.measured is None:
        outputs += [
            Cut(GROUND, Placement(), False, axis, angular).of_sensor("base")
            for axis in range(3)
            for angular in (False, True)
        ]
    groups: dict[str, list[Output]] = {}
    for output in outputs:
        groups.setdefault(output.sensor, []).append(output)
    return {
        name: virtual_power_form(mechanism.measuring(group))
        for name, group in groups.items()
    }


def _rows_of(mechanism: Mechanism, name: str) -> LinearForms:
    """Rows of one experiment."""
    own = experiment_of(mechanism, name)
    place = {parameter: k for k, parameter in enumerate(own.parameters)}
    columns = [place[parameter] for parameter in mechanism.parameters]
    return virtual_power_form(own).columns(columns)


_Base = tuple[Callable[[npt.NDArray[Any]], int], Mapping[str, npt.NDArray[Any]]]
"""How a rank is counted, and a basis of every sensor's row space."""


class _Spaces:
    """Row spaces of the sensors: modulo primes, at one random geometry each, or in ball arithmetic."""

    def __init__(self, bases: Sequence[_Base], each: int = 1) -> None:
        """``each`` is what an operation counts."""
        self._bases, self._each = bases, each
        self.work: Work | None = None  # what subsets may still take; unlimited if None
        self._known: dict[tuple[str, ...], int] = {}

    def rank(self, names: Sequence[str]) -> int:
        """Rank of the sensors together; an unlucky point could only lower it, so the larger of two counts."""
        key = tuple(names)
        if key not in self._known:
            if self.work is not None:
                self.work.spend(self.cost(key))
            self._known[key] = max(
                counted(np.vstack([spaces[name] for name in names])) if names else 0
                for counted, spaces in self._bases
            )
        return self._known[key]

    def cost(self, names: Sequence[str]) -> float:
        """Operations that a rank takes."""
        shapes = [spaces[name].shape for _, spaces in self._bases for name in names]
        widest = max((columns for _, columns in shapes), default=0)
        return float(self._each * SOLVING * sum(rows for rows, _ in shapes) * widest**2)


def _spaces(
    mechanism: Mechanism,
    forms: Mapping[str, LinearForms],
    rng: np.random.Generator,
    progress: Progress,
) -> _Spaces:
    progress("structure")
    one = "experiment" if mechanism.experiments else "sensor"
    numbers = {
        name: f"{one} {number} of {len(forms)}" for number, name in enumerate(forms, 1)
    }
    if not all(form.rational for form in forms.values()):
        _warn_of_rounding(mechanism, rng)
        said = "what {} sees ({}, in ball arithmetic)"
        found = spaces_of(
            forms, lambda name: progress(said.format(name, numbers[name]))
        )
        return _Spaces([(found.rank, found.bases)], BALL_COST)
    bases = list[_Base]()
    for _ in range(MOST_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            bases.append(
                (
                    partial(rank, field=field),
                    _row_spaces(forms, field, rng, progress, numbers),
                )
            )
        except (DegenerateSampleError, ClosedFormError):
            continue
        if len(bases) == AGREEING_POINTS:
            return _Spaces(bases)
    raise EchelonError("every random point is singular; please report this model")


def _warn_of_rounding(mechanism: Mechanism, rng: np.random.Generator) -> None:
    """Warn where the ranks of sensors, which are to the letter, are not those that a rounded file means."""
    spectrum = stated_structure(mechanism, rng).spectrum
    told = "" if spectrum is None else spectrum.doubt or spectrum.note
    if told:
        warnings.warn(
            f"ranks of sensors belong to the literal file, which has {told}",
            DoubtWarning,
            stacklevel=4,
        )


def _row_spaces(
    forms: Mapping[str, LinearForms],
    field: PrimeField,
    rng: np.random.Generator,
    progress: Progress,
    numbers: Mapping[str, str],
) -> dict[str, Residues]:
    """A basis of every sensor's row space; ``numbers`` say which it is of how many."""
    samplers = {name: f.sampler() for name, f in forms.items()}
    symbols = sorted({s for sampler in samplers.values() for s in sampler.symbols})
    geometry = {s: field.draw(rng, (1,)) for s in symbols}
    spaces: dict[str, Residues] = {}
    for name, sampler in samplers.items():
        progress(f"what {name} sees ({numbers[name]}, modulo {field.p})")
        own = {s: geometry[s] for s in sampler.symbols}
        spaces[name] = persistent(
            partial(row_space, forms[name], field, rng, own)
        )  # loops close with some luck
    return spaces


def _listed(
    names: Sequence[str], spaces: _Spaces, size: int, progress: Progress
) -> dict[tuple[str, ...], int]:
    """Ranks of all subsets up to a size."""
    sizes = range(1, min(size, len(names)) + 1)
    count = sum(comb(len(names), k) for k in sizes)
    ranks: dict[tuple[str, ...], int] = {}
    try:
        for k in sizes:
            progress(f"subsets of {k} sensors")
            ranks |= {subset: spaces.rank(subset) for subset in combinations(names, k)}
    except ClosedFormError:
        problem = f"{len(names)} sensors have {count} subsets of up to {size}, which exceeds the budget"
        raise InputError(
            f"{problem}: list smaller ones, or give a larger budget"
        ) from None
    return ranks


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


def _smallest(
    names: Sequence[str], spaces: _Spaces, total: int, greedy: Sequence[str]
) -> tuple[tuple[str, ...], int]:
    """A smallest subset with the full rank as far as is known, and a size below which there is none."""
    alone = sorted((spaces.rank([name]) for name in names), reverse=True)
    sums = [sum(alone[:size]) for size in range(len(names) + 1)]
    least = next(size for size, most in enumerate(sums) if most >= total)
    try:
        for size in range(least, len(greedy)):
            for subset in _promising(names, spaces, total, size):
                if spaces.rank(subset) == total:
                    return subset, size
            least = size + 1
    except ClosedFormError:
        pass
    return tuple(greedy), least


def _promising(
    names: Sequence[str], spaces: _Spaces, total: int, size: int
) -> Iterable[tuple[str, ...]]:
    """Subsets whose members see enough, if they all saw different things."""
    alone = {name: spaces.rank([name]) for name in names}
    return (
        s for s in combinations(names, size) if sum(alone[name] for name in s) >= total
    )
