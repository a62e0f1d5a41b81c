"""Columns told by their values: clocks, and families of columns whose names say nothing.

A family has a column for every coordinate; columns that never change are none, as they say nothing.  Positions are the
family that another one is the rate of (:mod:`echelon.identification.signals.rates`).  Torques that friction
dominates are proportional
to velocities, too.  What tells them apart is the slope: by the log's own clock it is one for velocities, or the ratio
of two units, the same for all joints.  Without a clock it is a rate that nobody knows; then velocities are only told if
every joint agrees on it, and another family is left for outputs.  Without velocities, positions are much smoother than
what is measured of forces.  Of two that follow one another the smoother one is the reference, and what is left are
outputs, if it is one family.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from echelon.identification.signals.chance import SHARE
from echelon.identification.signals.rates import NEAR, Rate, common_slope, rate
from echelon.identification.signals.spectrum import SHOWING
from echelon.shared import Floats

_MOST_COLUMNS = 10
"""Columns per joint, with more of which pairs are not looked for: their number grows with the square."""

_SAME = 0.98
"""Correlation of positions with those that were asked for."""

_SCALES = np.array([1.0, 180 / np.pi, np.pi / 180, 1e3, 1e-3])
"""Sizes of a reference in units of those of the positions, and slopes of velocities: both may be in other units."""

_ONE_RATE = 0.03
"""Relative difference of the slopes of joints, and their relative errors, up to which they are one rate."""

_SMOOTHER = 1.5
"""Ratio of the steps of two families, in units of their spread, from which on one is smoother than the other."""

_UNIFORM = 0.25
"""Relative difference of most intervals of a clock from their median: loggers are late by less."""


@dataclass(frozen=True)
class Family:
    """Columns of one pattern, in the order of their numbers or of the file."""

    columns: tuple[str, ...]

    @property
    def label(self) -> str:
        """The first and the last column."""
        if len(self.columns) == 1:
            return self.columns[0]
        return f"{self.columns[0]} … {self.columns[-1]}"


_LETTER = re.compile(r"(?<![A-Za-z0-9])[A-Za-z](?![A-Za-z0-9])")
_NUMBER = re.compile(r"\d+(?=\D*$)")
_ENTRY = re.compile(r"^\d+$|\[\d+\]$")


def families(
    names: Sequence[str], count: int, known: Mapping[str, int]
) -> tuple[Family, ...]:
    """Families of ``count`` columns: their names differ by one of ``known``, a number, a letter, or share a word.

    Words that are ``known`` have places in the order of joints.
    """

    def by_name(column: str) -> tuple[str, int] | None:
        inside = [
            word
            for word in known
            if re.search(rf"(?<![^\W_]){re.escape(word)}(?![^\W_])", column)
        ]
        longest = max(inside, key=len, default="")
        return (column.replace(longest, "{}"), known[longest]) if longest else None

    def by_number(column: str) -> tuple[str, int] | None:
        found = _NUMBER.search(column)
        if found:
            return (
                f"{column[: found.start()]}{{}}{column[found.end() :]}",
                int(found.group()),
            )
        return None

    def by_letter(column: str) -> tuple[str, int] | None:
        last = next(reversed([*_LETTER.finditer(column)]), None)
        if last is None:
            return None
        return (
            f"{column[: last.start()]}{{}}{column[last.end() :]}",
            ord(last.group()),
        )

    def by_word(place: int) -> Callable[[str], tuple[str, int]]:
        return lambda column: (
            (re.findall(r"[^\W_]+", column) or [column])[place].lower(),
            0,
        )

    found: list[Family] = []
    left = list(names)
    for key in (by_name, by_number, by_letter, by_word(0), by_word(-1)):
        groups: dict[str, list[tuple[int, int, str]]] = {}
        for place, column in enumerate(left):
            if (said := key(column)) is not None:
                groups.setdefault(said[0], []).append((said[1], place, column))
        found += [
            Family(tuple(column for *_, column in sorted(some)))
            for some in groups.values()
            if len(some) == count
        ]
        left = [
            name for name in left if not any(name in family.columns for family in found)
        ]
    return tuple(found)


def are_numbers(names: Sequence[str]) -> bool:
    """Whether names only count: those of a table without names, or of a matrix, such as ``data[0]`` and ``data[1]``."""
    return len({_ENTRY.sub("", name) for name in names}) == 1 and all(
        _ENTRY.search(name) for name in names
    )


def blocks(names: Sequence[str], count: int) -> tuple[Family, ...]:
    """Columns without names as families, one after another; none if their number does not fit."""
    if len(names) % count:
        return ()
    return tuple(
        Family(tuple(names[start : start + count]))
        for start in range(0, len(names), count)
    )


def in_order(
    names: Sequence[str],
    count: int,
    columns: Mapping[str, Floats],
    times: Floats | None,
    fixed: Mapping[str, Family],
) -> dict[str, Family]:
    """Families by kind of columns that only their order can tell apart: quantity by quantity, or joint by joint.

    Positions have to be smoother than outputs, all of them, so that no family is a mixture.
    """
    moving = [
        name for name in names if len({*np.diff(columns[name])} - {0.0}) > 1
    ]  # no constants, no counters
    if len(moving) % count:
        return {}
    size = len(moving) // count
    for found in (
        blocks(moving, count),
        tuple(Family(tuple(moving[k::size])) for k in range(size)),
    ):
        kinds = classified(found, columns, times, fixed)
        every = {**fixed, **kinds}
        if {"position", "output"} <= every.keys():
            both = (every["position"].columns, every["output"].columns)
            smooth, rough = (
                _roughness(_clean(np.stack([columns[name] for name in some], axis=1)))
                for some in both
            )
            if smooth.max() < rough.min():
                return kinds
    return {}


def in_pairs(
    names: Sequence[str], count: int, columns: Mapping[str, Floats], times: Floats
) -> tuple[dict[str, Family], list[str]]:
    """Positions with their rates, where names of joints have nothing in common, and moving columns that are neither.

    All are in the order of the file.  Nothing is found where there are not as many as joints.
    """
    some = {name: _clean(columns[name][:SHOWING, None]) for name in names}
    moving = {name: values for name, values in some.items() if np.ptp(values) > 0}
    if len(moving) > _MOST_COLUMNS * count:
        return {}, []
    rates = {
        a: [b for b in moving if b != a and _is_rate(moving[a], moving[b], times)]
        for a in moving
    }
    derived = {b for pairs in rates.values() for b in pairs}
    found = {"position": [a for a in moving if rates[a] and a not in derived]}
    for kind, of in (("velocity", "position"), ("acceleration", "velocity")):
        found[kind] = [rates[a][0] for a in found[of] if rates[a]]
    if len(found["position"]) != count:
        return {}, []
    made = {
        kind: Family(tuple(own)) for kind, own in found.items() if len(own) == count
    }
    return made, [
        name for name in moving if name not in derived and name not in found["position"]
    ]


def is_still(values: Floats) -> bool:
    """Whether the finite ones of some values are all the same, so that they say nothing."""
    finite = values[np.isfinite(values)]
    return not len(finite) or bool(np.ptp(finite) == 0)


def is_mixed(
    family: Family, columns: Mapping[str, Floats], times: Floats | None
) -> bool:
    """Whether one column of a family is the rate of another, so that they are not of different joints."""
    values = [_clean(columns[name][:SHOWING, None]) for name in family.columns]
    return times is not None and any(
        _is_rate(a, b, times) for a, b in permutations(values, 2)
    )


def _is_rate(position: Floats, velocity: Floats, times: Floats) -> bool:
    return math.isfinite(
        error_as_rates(np.unwrap(position, axis=0), velocity, times[: len(position)])
    )


def clock(
    columns: Mapping[str, Floats], names: Sequence[str], *, named: bool = False
) -> str:
    """The first column that grows evenly as a clock does; empty if none does.

    What counts samples is no clock, unless it is ``named`` so: the time may be in ms at 1 kHz.
    """
    for name in names:
        if name not in columns:  # it holds words
            continue
        steps = np.diff(columns[name])
        period = float(np.median(steps)) if len(steps) else 0.0
        if len(steps) < 3 or not np.isfinite(period) or period <= 0:
            continue
        even = np.mean(np.abs(steps - period) < _UNIFORM * period)
        counts = period == 1 and set(np.unique(steps)) == {1.0}
        if np.mean(steps > 0) <= SHARE or even <= 0.5 or (counts and not named):
            continue
        # a counter of rows is none if something beside it is
        if not counts or not clock(
            columns, [other for other in names if other != name], named=True
        ):
            return name
    return ""


def classified(
    new: Sequence[Family],
    columns: Mapping[str, Floats],
    times: Floats | None,
    fixed: Mapping[str, Family],
) -> dict[str, Family]:
    """New families by kind, beside those whose kinds are fixed; families that are not clear are left out."""
    found = [*fixed.values(), *new]
    values = [
        _clean(np.column_stack([columns[name] for name in family.columns]))
        for family in found
    ]
    if not values:
        return {}
    pairs = [(a, b) for a in range(len(found)) for b in range(len(found)) if a != b]
    missed = {(a, b): error_as_rates(values[a], values[b], times) for a, b in pairs}
    needed = {"position", "velocity", "output"} - fixed.keys()
    if times is None and len(new) < len(needed):
        missed = dict.fromkeys(
            pairs, math.inf
        )  # what could be velocities are the only columns that could be outputs
    kinds = {kind: k for k, kind in enumerate(fixed)}
    left = list(range(len(fixed), len(found)))
    if "position" not in kinds:
        roots = [a for a in left if _is_root(a, len(found), missed)]
        root = roots[0] if roots else _smoothest(values)
        if root not in left:
            return {}
        # what was measured is less smooth than what was asked for
        like = [
            root,
            *(k for k in left if k != root and _alike(values[root], values[k])),
        ]
        kinds["position"] = max(like, key=lambda k: _bent(values[k], 2))
        left.remove(kinds["position"])
    for kind, of in (("velocity", "position"), ("acceleration", "velocity")):
        if times is None and {"position", "velocity"} <= kinds.keys():
            times = _own_clock(values[kinds["position"]], values[kinds["velocity"]])
            missed = {
                (a, b): error_as_rates(values[a], values[b], times) for a, b in pairs
            }
        children = [
            k for k in left if of in kinds and math.isfinite(missed[kinds[of], k])
        ]
        if children and kind not in kinds:
            kinds[kind] = min((missed[kinds[of], k], k) for k in children)[1]
        left = [k for k in left if k not in children]
    alike = [k for k in left if _alike(values[kinds["position"]], values[k])]
    if alike and "reference" not in kinds:
        kinds["reference"] = alike[0]
    left = [k for k in left if k not in alike]
    if len(left) == 1 and "output" not in kinds:
        kinds["output"] = left[0]
    return {kind: found[k] for kind, k in kinds.items() if k >= len(fixed)}


def _is_root(a: int, count: int, missed: Mapping[tuple[int, int], float]) -> bool:
    others = [k for k in range(count) if k != a]
    leads = any(math.isfinite(missed[a, k]) for k in others)
    return leads and not any(math.isfinite(missed[k, a]) for k in others)


def _clean(values: Floats) -> Floats:
    finite = np.isfinite(values)
    mean = np.mean(np.where(finite, values, 0.0))
    return np.asarray(np.where(finite, values, mean))


def error_as_rates(lower: Floats, upper: Floats, times: Floats | None) -> float:
    """The relative error with which one family, shape (N, joints), follows another one as its rates; inf if not.

    Times are in s; without them all joints have to agree on one rate of samples.
    """
    found = _rates(lower, upper, times)
    slopes, errors = (
        np.array([getattr(some, what) for some in found])
        for what in ("slope", "relative")
    )
    moves = np.isfinite(slopes)
    if not moves.any():
        return math.inf
    if times is None:
        agree = (
            (errors < _ONE_RATE)
            & (np.abs(slopes / np.median(slopes[moves]) - 1) < _ONE_RATE)
            & (slopes > 0)
        )
        told = agree.sum() == moves.sum() > 1
    else:
        near = np.abs(slopes[:, None] / _SCALES - 1) < NEAR
        agree = (near & (errors < NEAR)[:, None]).T[np.argmax(near.sum(axis=0))]
        told = 2 * agree.sum() > moves.sum()
    return float(np.median(errors[agree])) if told else math.inf


def sample_rate(lower: Floats, upper: Floats) -> tuple[float, float]:
    """Samples per second with which most columns are the rates of others, shape (N, joints), and its standard error.

    Both are nan if there is no such rate.
    """
    found = [some for some in _rates(lower, upper, None) if some.relative < NEAR]
    middle = float(np.median([some.slope for some in found])) if found else math.nan
    near = [some for some in found if abs(some.slope - middle) < NEAR * middle]
    return common_slope(near) if 2 * len(near) > len(found) else (math.nan, math.nan)


def _rates(lower: Floats, upper: Floats, times: Floats | None) -> list[Rate]:
    """The columns of one family as rates of those of another one."""
    time = np.arange(len(lower), dtype=float) if times is None else times
    return [rate(q, v, time) for q, v in zip(lower.T, upper.T, strict=True)]


def _own_clock(positions: Floats, velocities: Floats) -> Floats | None:
    """Times by what velocities say, s; None if they say nothing."""
    samples, _ = sample_rate(positions, velocities)
    return np.arange(len(positions)) / samples if math.isfinite(samples) else None


def _alike(first: Floats, second: Floats) -> bool:
    """Whether most columns are the same but for their unit; forces may follow positions, but are of another size."""
    first, second = first - first.mean(axis=0), second - second.mean(axis=0)
    sizes = np.stack([np.linalg.norm(first, axis=0), np.linalg.norm(second, axis=0)])
    moves = (sizes > 0).all(axis=0)
    if not moves.any():
        return False
    first, second, sizes = first[:, moves], second[:, moves], sizes[:, moves]
    # with the sign: of a sine, the position is minus the derivative of the velocity
    likeness = (first * second).sum(axis=0) / sizes.prod(axis=0)
    units = np.any(np.abs((sizes[1] / sizes[0])[:, None] / _SCALES - 1) < NEAR, axis=1)
    return bool(min(np.mean(likeness > _SAME), np.mean(units)) > 0.5)


def _smoothest(values: Sequence[Floats]) -> int | None:
    """The family that is clearly smoother than all others but its like."""
    rough = [_bent(some, 1) or np.inf for some in values]
    first, *others = (int(k) for k in np.argsort(rough))
    rivals = [k for k in others if not _alike(values[first], values[k])]
    return first if rivals and rough[rivals[0]] > _SMOOTHER * rough[first] else None


def _bent(values: Floats, order: int) -> float:
    """Differences of an order of a family, in units of its spread; 0 where nothing moves."""
    rough = _roughness(values, order)
    return float(np.median(rough)) if len(rough) else 0.0


def _roughness(values: Floats, order: int = 1) -> Floats:
    """Differences of the columns that move, in units of their spread."""
    spread = values.std(axis=0)
    steps = np.sqrt(np.mean(np.diff(values, order, axis=0) ** 2, axis=0))
    return np.asarray(steps[spread > 0] / spread[spread > 0])
