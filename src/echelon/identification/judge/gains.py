"""Outputs that are in other units than the others, such as currents: gains by which they contradict one another.

Each output's unit, but for one, is taken for an unknown gain in the equation 0 = W ζ − y K, which outputs that share
parameters determine.  The most frequent gain is taken for right.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from echelon.base import BaseModel
from echelon.compute import Layout, Observation, safe_norms, upper_triangle
from echelon.identification.current_fit import fit_currents
from echelon.identification.judge.evidence import Products
from echelon.shared import Floats, InputError, in_quotes

APART = 1.4  # ratio of gains from which on outputs contradict one another
_TOLD = 0.1  # relative standard deviation up to which the data tell a gain
_MEETING = 1e-9  # singular value, relative to the largest, below which directions of rows are the same


def own_gains(
    base: BaseModel, products: Products
) -> tuple[dict[int, float], list[str]]:
    """Outputs with gains of their own, and how many times they are what they should be, which may be negative.

    Beside them why gains of some outputs could not be tested.
    """
    observation = _observation(base, products)
    used = [k for k, count in enumerate(observation.counts) if count]
    found: dict[int, float] = {}
    untested = []
    for group in _one_scale(observation, used):
        try:
            found |= _apart(observation, base.units, group)
        except InputError as error:
            names = in_quotes([observation.layout.outputs[k] for k in group])
            untested.append(f"gains of the outputs {names} ({error})")
    return found, untested


def _observation(base: BaseModel, products: Products) -> Observation:
    """R-factors of the base parameters' rows in all blocks."""
    factors, columns, counts = [], [], products.counts.sum(axis=0)
    for mine, gram in zip(products.columns, products.grams, strict=True):
        some = np.append(np.flatnonzero(mine < base.rank), len(mine))
        values, vectors = np.linalg.eigh(gram.sum(axis=0)[np.ix_(some, some)])
        factors.append(
            upper_triangle(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
        )
        columns.append(tuple(mine[mine < base.rank].tolist()))
    names = tuple(output.name for output in base.mechanism.outputs)
    layout = Layout(names, tuple(base.pivots), tuple(columns))
    return Observation(layout, tuple(factors), tuple(round(count) for count in counts))


def _one_scale(observation: Observation, outputs: Sequence[int]) -> list[list[int]]:
    """Outputs whose gains the data relate: the spaces of their rows meet."""
    layout = observation.layout
    rows = {}
    for k in outputs:
        rows[k] = np.zeros((len(observation.factors[k]), len(layout.parameters)))
        rows[k][:, layout.columns[k]] = observation.factors[k][:, :-1]
    scales = safe_norms(np.concatenate(list(rows.values()))) if rows else np.ones(0)

    def rank(group: Sequence[int]) -> int:
        parts = [rows[k] / scales for k in group]
        stacked = np.concatenate(
            [part / (np.linalg.norm(part) or 1.0) for part in parts]
        )
        singular = np.linalg.svd(stacked, compute_uv=False)
        return int(np.sum(singular > _MEETING * singular[0]))

    groups = [[k] for k in outputs]
    while True:
        pairs = combinations(groups, 2)
        meeting = next(
            ((a, b) for a, b in pairs if rank(a + b) < rank(a) + rank(b)), None
        )
        if meeting is None:
            return [sorted(group) for group in groups if len(group) > 1]
        groups = [g for g in groups if g not in meeting] + [meeting[0] + meeting[1]]


def _apart(
    observation: Observation, units: Sequence[str], group: Sequence[int]
) -> dict[int, float]:
    """Gains of outputs that have one scale: every unit but one is unknown, and each is compared with the usual one."""
    layout, scaled = observation.layout, group[1:]
    names = tuple(f"gain of {layout.outputs[k]}" for k in scaled)
    found = fit_currents(
        _with_gains(observation, scaled, names),
        [*units, *("" for _ in names)],
        [
            (names[scaled.index(k)],) if k in scaled else ()
            for k in range(len(layout.outputs))
        ],
    )
    gains = np.array([1.0, *found.values[len(layout.parameters) :]])
    deviations = np.array([0.0, *found.std[len(layout.parameters) :]])
    told = deviations < _TOLD * np.abs(gains)
    if not (told & (gains > 0)).any():
        return {}
    factors = gains / _usual_gain(np.sort(gains[told & (gains > 0)]))
    some = zip(group, factors, told, strict=True)
    return {
        k: float(1 / f) for k, f, clear in some if clear and not 1 / APART < f < APART
    }


def _usual_gain(gains: Floats) -> float:
    """The gain that half of the sorted gains or more are like, else the median."""
    alike = np.sum(
        np.abs(np.log(np.divide.outer(gains, gains))) < 0.5 * np.log(APART), axis=1
    )
    return float(
        gains[
            np.argmax(alike) if 2 * alike.max() >= len(gains) else (len(gains) - 1) // 2
        ]
    )


def _with_gains(
    observation: Observation, scaled: Sequence[int], names: tuple[str, ...]
) -> Observation:
    """The equations 0 = X ζ − y K for some outputs, as they are for the others."""
    layout, count = observation.layout, len(observation.layout.parameters)
    columns, factors = list(layout.columns), list(observation.factors)
    for place, k in enumerate(scaled):
        columns[k] = (*columns[k], count + place)
        R = factors[k]
        factors[k] = upper_triangle(
            np.column_stack([R[:, :-1], -R[:, -1], np.zeros(len(R))])
        )
    whole = Layout(layout.outputs, (*layout.parameters, *names), tuple(columns))
    return Observation(whole, tuple(factors), observation.counts)
