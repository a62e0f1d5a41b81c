"""Continuous changes made in earnest: the sizes of all knobs that were taken, found together until they stand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.base import BaseModel
from echelon.identification.judge.evidence import (
    BLOCKS,
    Evidence,
    States,
    WeightedFit,
    fitted,
)
from echelon.identification.judge.hypothesis import Knob
from echelon.identification.judge.knobs import load_of, slopes
from echelon.shared import Floats

_STANDS = 1e-3  # change of a size, by its standard error or itself, or of what is left, that is none any more
_STEPS = 6  # at most
_LOADS = 12  # times that loads follow the fit at most
_HALVINGS = 5  # of a step at most

FitWith = Callable[[States, Sequence[dict[int, Floats]]], tuple[float, WeightedFit]]
"""Fits states with further columns; gives how much is left, as a logarithm, and the fit."""


@dataclass(frozen=True)
class Turned:
    """A knob with the sizes that were found."""

    knob: Knob
    sizes: Floats  # shape (count,)
    errors: Floats  # standard errors
    load: Floats  # of gears, shape (samples, outputs)

    @property
    def words(self) -> tuple[str, str]:
        """A sentence with its sizes, and the lines of a set-up that state it."""
        return self.knob.says(self.sizes, self.errors)


def read_with(start: States, turned: Sequence[Turned]) -> States:
    """States that are read with some knobs turned."""
    for some in turned:
        start = some.knob.moved(start, some.sizes, some.load)
    return start


def settled(
    base: BaseModel, start: States, turned: Sequence[Turned], fit: FitWith
) -> tuple[tuple[Turned, ...], float]:
    """Knobs with the sizes that leave least, by Gauss–Newton steps from those that are given, and what is left."""
    turned = tuple(turned)
    left, found = fit(read_with(start, turned), ())
    for _ in range(_STEPS):
        values = found.values[: base.rank]
        columns = [_slopes(base, start, values, turned, k) for k in range(len(turned))]
        _, found = fit(read_with(start, turned), columns)
        count = sum(some.knob.count for some in turned)
        changes, errors = found.values[-count:], found.errors[-count:]
        sizes = np.abs(np.concatenate([some.sizes for some in turned]))
        before = left
        turned, left, found = _stepped(start, turned, changes, errors, left, fit)
        if (
            left >= before
            or (np.abs(changes) < _STANDS * np.maximum(errors, sizes)).all()
        ):
            break
    return turned, left


def jackknifed(
    base: BaseModel,
    start: States,
    turned: Sequence[Turned],
    evidence: Evidence,
    terms: Sequence[Mapping[int, Floats]],
) -> tuple[Turned, ...]:
    """Knobs with standard errors from leaving out one block of time after another: residuals resemble their neighbours.

    ``terms`` are columns that are fitted beside them.
    """
    states = read_with(start, turned)
    values = fitted(evidence.products(states, terms)).values[: base.rank]
    columns = [_slopes(base, start, values, turned, k) for k in range(len(turned))]
    products = evidence.products(states, [*terms, *columns])
    count = sum(some.knob.count for some in turned)
    others = [
        [other for other in range(BLOCKS) if other != block] for block in range(BLOCKS)
    ]
    found = np.array(
        [fitted(products.together(some)).values[-count:] for some in others]
    )
    errors = np.sqrt(
        (BLOCKS - 1) / BLOCKS * np.sum((found - found.mean(axis=0)) ** 2, axis=0)
    )
    ends = np.cumsum([some.knob.count for some in turned])[:-1]
    return tuple(
        replace(some, errors=mine)
        for some, mine in zip(turned, np.split(errors, ends), strict=True)
    )


def settled_with_loads(
    base: BaseModel, start: States, turned: Sequence[Turned], fit: FitWith
) -> tuple[Turned, ...]:
    """Knobs with the sizes that leave least, and with loads of gears as the model that is fitted has them.

    While knobs are still to be found loads had better stay: those of a model that lacks one bend to what it lacks.
    """
    best, least = settled(base, start, turned, fit)
    tried = best
    for _ in range(_LOADS):
        states = read_with(start, tried)
        _, found = fit(states, ())
        values = found.values[: base.rank]
        newer = [
            replace(some, load=load_of(base, states, values, some.knob))
            for some in tried
        ]
        tried, left = settled(base, start, newer, fit)
        stands = abs(left - least) < _STANDS
        if left < least:
            best, least = tried, left
        if stands:
            break
    return best


def _slopes(
    base: BaseModel, start: States, values: Floats, turned: Sequence[Turned], k: int
) -> dict[int, Floats]:
    """Derivatives of the prediction by the sizes of one of the knobs, the others as they are."""
    some, ahead = turned[k], read_with(start, turned[:k])

    def moved(states: States, sizes: Floats, load: Floats) -> States:
        return read_with(some.knob.moved(states, sizes, load), turned[k + 1 :])

    return slopes(
        base, ahead, values, replace(some.knob, moved=moved), some.sizes, some.load
    )


def _stepped(
    start: States,
    turned: tuple[Turned, ...],
    changes: Floats,
    errors: Floats,
    left: float,
    fit: FitWith,
) -> tuple[tuple[Turned, ...], float, WeightedFit]:
    """Knobs after a step that is halved until no more is left than before it, what is left then, and the fit."""
    ends = np.cumsum([some.knob.count for some in turned])[:-1]
    own = list(
        zip(turned, np.split(changes, ends), np.split(errors, ends), strict=True)
    )
    for halvings in range(_HALVINGS):
        tried = tuple(
            replace(some, sizes=some.sizes + change / 2**halvings, errors=error)
            for some, change, error in own
        )
        after, found = fit(read_with(start, tried), ())
        if after <= left:
            return tried, after, found
    stay = tuple(replace(some, errors=error) for some, _, error in own)
    return stay, *fit(read_with(start, stay), ())
