"""The rows that hypotheses are judged by: a log on a slow clock, in blocks of time, and fits to their products.

All that fits need of the rows are the products [W y]ᵀ[W y] of each output in each block, with the columns W of the
base parameters and of terms that were taken.  A robot of many joints has thousands of entries in W, nearly all of the
work; so readings of the logs that change outputs alone share the filtered entries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from echelon.base import BaseModel
from echelon.identification.judge.places import Motion
from echelon.identification.judge.reversals import Reversal, Reversals
from echelon.identification.logs.preparation.prepare import ORDER, ROOM
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.plan import LOOKED_AT, spread_out
from echelon.identification.rows.rows import rows_filtered, rows_taken
from echelon.identification.signals.clock import shifted
from echelon.identification.signals.filters import WORTH, lowpass
from echelon.shared import Flags, Floats, Integers

BLOCKS = 10  # blocks of time: few enough to hold all motions, enough to tell a standard error
_RIDGE = 1e-9  # of squares of columns: what the data leave open stays small
_FLOOR = 1e-9  # of an output's squares: rounding of exact data is no noise
_REWEIGHTED = 5  # iterations in which outputs get the weights of their residuals

_OF_MOTION = (
    "q",
    "qd",
    "qdd",
    "inputs",
    "pieces",
    "gravity",
    "drives",
)  # what the regressor of states depends on

GRAVITY = ("gx", "gy", "gz")


@dataclass(frozen=True)
class States:
    """Samples of logs as some hypothesis reads them."""

    q: Floats
    qd: Floats
    qdd: Floats
    y: Floats
    inputs: Mapping[str, Floats]
    pieces: tuple[
        Samples, ...
    ]  # stretches that the samples are, with the filter of both sides
    scale: Floats  # shape (outputs,); outputs by what the model predicts
    gravity: Floats | None = (
        None  # shape (3,), m/s² in the base frame; None where the model has it built in
    )
    band: float = np.inf  # that the fit keeps, Hz
    drives: Motion | None = (
        None  # motion at which effects act, where drives do not move with their joints
    )
    late: Floats | float = 0.0  # shape (outputs,); delays that were undone, s
    shared: Floats | None = (
        None  # shape (outputs, outputs); forces of drives in outputs, where drives move several
    )
    # shape (samples, 1); other friction less Coulomb friction, of unit size
    reversals: Mapping[Reversal, Floats] = field(default_factory=dict)

    @staticmethod
    def of(
        samples: Iterable[Samples],
        band: float,
        base: BaseModel,
        values: Floats,
        gravity: Floats | None = None,
        reversals: Reversals | None = None,
    ) -> States:
        """Prepared samples on a clock that is no faster than their band needs, Hz, from all parts of the logs.

        A slow clock knows too late where dry friction turns.  So what a model with some base parameters predicts is
        taken off on the clock of the log, and added again on the slow one.  Columns of ``reversals``
        come from there, too.
        """

        def left(some: Samples) -> Samples:
            assert some.y is not None
            return replace(some, y=some.y - _predicted(base, some, values))

        measured = (piece for piece in samples if piece.y is not None)
        beside = None if reversals is None else reversals.columns
        pieces = tuple(spread_out(measured, band, LOOKED_AT, BLOCKS, left, beside))
        q, qd, qdd, rest = (
            np.concatenate([getattr(p, name) for p in pieces])
            for name in ("q", "qd", "qdd", "y")
        )
        rest, columns = np.split(rest, [len(base.mechanism.outputs)], axis=1)
        y = rest + np.concatenate([_predicted(base, piece, values) for piece in pieces])
        tried = [] if reversals is None else reversals.tried(pieces[0])
        at_reversals = {some: columns[:, [k]] for k, some in enumerate(tried)}
        inputs = {
            name: np.concatenate([piece.inputs[name] for piece in pieces])
            for name in pieces[0].inputs
        }
        scale = np.ones(y.shape[1])
        return States(
            q, qd, qdd, y, inputs, pieces, scale, gravity, band, reversals=at_reversals
        )

    @property
    def unfiltered(self) -> States:
        """The states with rows up to half of their rate, not only in the band of the fit."""
        pieces = tuple(replace(piece, reduction=None) for piece in self.pieces)
        return replace(self, pieces=pieces)

    @property
    def motion(self) -> Motion:
        """Positions, velocities and accelerations."""
        return self.q, self.qd, self.qdd

    @property
    def time(self) -> Floats:
        """Times of the samples since the first one, s; logs follow one another."""
        parts, begin = [], 0.0
        for piece, following in zip(self.pieces, (*self.pieces[1:], None), strict=True):
            parts.append(begin + np.arange(len(piece)) / piece.rate)
            ahead = len(piece) / piece.rate
            if (
                following is not None
                and following.source == piece.source
                and following.start > piece.start
            ):
                ahead = following.start - piece.start
            begin += ahead
        return np.concatenate(parts)

    def place(self, sample: int) -> tuple[Samples, float]:
        """The stretch that a sample is from, and the sample's time by the stamps of its log, s."""
        for piece in self.pieces:
            if sample < len(piece):
                break
            sample -= len(piece)
        return piece, piece.start + sample / piece.rate

    def earlier(self, outputs: Sequence[int], delay: float) -> States:
        """States with a delay of some outputs undone, s; near the ends of stretches no row is fitted then."""
        y, late = self.y.copy(), np.zeros(self.y.shape[1]) + self.late
        parts = [
            shifted(part, delay * piece.rate)
            for piece, part in self._stretches(y[:, outputs])
        ]
        y[:, outputs] = np.concatenate(parts)
        late[outputs] += delay
        return replace(self, y=y, late=late)

    def derivative(self, values: Floats) -> Floats:
        """Rates of signals (samples, …), by central differences within stretches."""
        rates = [
            np.gradient(part, axis=0) * piece.rate
            for piece, part in self._stretches(values)
        ]
        return np.asarray(np.concatenate(rates))

    def _stretches(self, values: Floats) -> Iterator[tuple[Samples, Floats]]:
        """Stretches, each with its part of signals (samples, …)."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        return zip(self.pieces, np.split(values, ends[:-1]), strict=True)

    @property
    def rate(self) -> Floats:
        """Samples per second at each sample."""
        return np.concatenate(
            [np.full(len(piece), piece.rate) for piece in self.pieces]
        )

    def smoothed(self, values: Floats) -> Floats:
        """Signals (samples,) after the low-pass that measured positions have passed."""
        cutoff = ROOM * self.band
        found = []
        for piece, part in self._stretches(values):
            found.append(
                part
                if cutoff > WORTH * piece.rate
                else lowpass(part, cutoff, piece.rate, ORDER)
            )
        return np.concatenate(found)

    def rows(self, values: Floats) -> Floats:
        """Signals (samples, …) after the filter of both sides, shape (rows, …)."""
        return np.concatenate(
            [rows_filtered(piece, part) for piece, part in self._stretches(values)]
        )

    @cached_property
    def fitted(self) -> Flags:
        """Rows that are fitted, shape (rows, outputs)."""
        found, margin = [], float(np.max(np.abs(self.late)))
        for piece in self.pieces:
            times, rows, flags = rows_taken(piece, piece.q[:, :1])
            some = (
                np.ones((len(rows), self.y.shape[1]), dtype=bool)
                if flags is None
                else flags
            )
            since = times - piece.start
            inner = (since >= margin) & (since <= len(piece) / piece.rate - margin)
            found.append(some & inner[:, None])
        return np.concatenate(found)

    def moves_like(self, other: States) -> bool:
        """Whether the regressor is that of other states, as far as this can be told without looking at samples."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in _OF_MOTION)
        return all(one is two for one, two in pairs)

    def predicted(self, base: BaseModel, values: Floats) -> Floats:
        """The outputs of a model, shape (samples, outputs)."""
        if self.drives is None:
            of_joints = base.predict(*self.motion, values, self.symbols, self.inputs)
            return self.scale * of_joints
        q, qd, qdd = self.drives
        ahead = replace(self, q=q, qd=qd, qdd=qdd, drives=None)
        bodies = of_bodies(base)
        joints = replace(self, drives=None)
        of_effects = ahead.predicted(base, np.where(bodies, 0.0, values))
        if self.shared is not None:
            of_effects = of_effects @ self.shared.T
        return joints.predicted(base, np.where(bodies, values, 0.0)) + of_effects

    @property
    def symbols(self) -> dict[str, float]:
        """Values of the symbols of gravity, if the model has some."""
        if self.gravity is None:
            return {}
        return {
            name: float(value)
            for name, value in zip(GRAVITY, self.gravity, strict=True)
        }


def of_bodies(base: BaseModel) -> Flags:
    """Whether base parameters are those of bodies, not of effects such as friction and rotors; shape (r,)."""
    columns = base.mechanism.columns
    return np.array(
        [columns[pivot].body is not None for pivot in base.matrix.pivots], dtype=bool
    )


def _predicted(base: BaseModel, samples: Samples, values: Floats) -> Floats:
    return base.predict(*samples.motion, values, None, samples.inputs)


@dataclass(frozen=True)
class OutputRows:
    """The rows [W y] of one output that are fitted, block after block."""

    columns: Integers  # shape (n,): the parameters that it can depend on
    table: Floats  # shape (rows, n + 1)
    fitted: Flags  # of all rows of the states
    blocks: tuple[slice, ...]  # of the rows of the table

    def products(self, columns: Floats, others: Floats) -> Floats:
        """Products columnsᵀ others in each block, both of shape (rows, …); shape (blocks, …, …)."""
        found = np.empty((len(self.blocks), columns.shape[1], others.shape[1]))
        for block, some in enumerate(self.blocks):
            found[block] = columns[some].T @ others[some]
        return found


@dataclass(frozen=True)
class Products:
    """[W y]ᵀ[W y] of each output's rows in each block."""

    size: int  # of all parameters: base parameters, then those of terms
    columns: tuple[
        Integers, ...
    ]  # shape (n_i,) for each output: the parameters it can depend on
    grams: tuple[Floats, ...]  # shape (blocks, n_i + 1, n_i + 1)
    counts: Floats  # shape (blocks, outputs); rows
    sums: Floats  # shape (blocks, outputs); of the measured values

    @staticmethod
    def of(size: int, outputs: Iterable[OutputRows]) -> Products:
        """Products of the rows of all outputs; ``size`` is the number of parameters."""
        columns, grams, counts, sums = [], [], [], []
        for rows in outputs:
            columns.append(rows.columns)
            grams.append(rows.products(rows.table, rows.table))
            counts.append([float(some.stop - some.start) for some in rows.blocks])
            sums.append([float(rows.table[some, -1].sum()) for some in rows.blocks])
        return Products(
            size, tuple(columns), tuple(grams), np.array(counts).T, np.array(sums).T
        )

    @cached_property
    def spread(self) -> Floats:
        """Squares of measured values about their means, shape (outputs,)."""
        squares = np.array([gram[:, -1, -1].sum() for gram in self.grams])
        of_means: Floats = self.sums.sum(axis=0) ** 2 / np.maximum(
            self.counts.sum(axis=0), 1
        )
        return np.asarray(np.maximum(squares - of_means, 0.0))

    def together(self, blocks: Sequence[int] | slice = slice(None)) -> Products:
        """The products of some blocks as of one."""
        grams = tuple(gram[blocks].sum(axis=0, keepdims=True) for gram in self.grams)
        counts, sums = (
            some[blocks].sum(axis=0, keepdims=True) for some in (self.counts, self.sums)
        )
        return replace(self, grams=grams, counts=counts, sums=sums)

    def scaled(self, output: int, factor: float) -> Products:
        """The products of a model whose prediction of one output is multiplied by a factor."""
        scale = np.append(np.full(len(self.columns[output]), factor), 1.0)
        grams = list(self.grams)
        grams[output] = grams[output] * np.outer(scale, scale)
        return replace(self, grams=tuple(grams))

    def squares(self, values: Floats) -> Floats:
        """Squares of residuals with some parameters, shape (blocks, outputs)."""
        found = np.empty_like(self.counts)
        for output, (columns, gram) in enumerate(
            zip(self.columns, self.grams, strict=True)
        ):
            full = np.append(values[columns], -1.0)
            found[:, output] = np.maximum((gram @ full) @ full, 0.0)
        return found

    def normal_equations(self, weights: Floats) -> tuple[Floats, Floats]:
        """Normal matrix and right side of the first block, outputs weighted."""
        weighted = [
            weight * gram[0, :-1]
            for weight, gram in zip(weights, self.grams, strict=True)
        ]
        products = np.concatenate([part[:, :-1].ravel() for part in weighted])
        right = np.concatenate([part[:, -1] for part in weighted])
        matrix = np.bincount(self._places, products, self.size**2).reshape(
            self.size, self.size
        )
        sides = np.bincount(np.concatenate(self.columns), right, self.size)
        return np.asarray(matrix, dtype=np.float64), np.asarray(sides, dtype=np.float64)

    @cached_property
    def _places(self) -> Integers:
        """Places in the normal matrix, row by row, of the products of all outputs."""
        return np.concatenate(
            [
                np.add.outer(self.size * columns, columns).ravel()
                for columns in self.columns
            ]
        )


class Evidence:
    """The rows of a base model in some states."""

    def __init__(self, base: BaseModel) -> None:
        self.base = base
        places, parameters = base.sparsity
        self._entries: list[Integers] = [
            np.flatnonzero(places == k) for k in range(len(base.mechanism.outputs))
        ]
        self._parameters = parameters
        self._of_effects = ~of_bodies(base)[parameters]
        self._last: tuple[States, Floats] | None = None

    def products(
        self, states: States, terms: Sequence[Mapping[int, Floats]] = ()
    ) -> Products:
        """Products of the rows of some states, with columns of terms: signals (samples, k) by output."""
        size = self.base.rank + sum(map(width, terms))
        return Products.of(size, self.rows(states, terms))

    def rows(
        self, states: States, terms: Sequence[Mapping[int, Floats]] = ()
    ) -> Iterator[OutputRows]:
        """The rows of all outputs."""
        entries, measured = self._filtered_entries(states), states.rows(states.y)
        for output in range(len(self._entries)):
            added, signals = _of_terms(self.base.rank, terms, output)
            chosen, shares = self._chosen(states, output)
            columns = np.append(self._parameters[chosen], added)
            fitted = states.fitted[:, output]
            table = np.empty((np.count_nonzero(fitted), len(columns) + 1))
            table[:, : len(chosen)] = (
                states.scale[output] * shares * entries[:, chosen][fitted]
            )
            if signals:
                table[:, len(chosen) : -1] = states.rows(np.hstack(signals))[fitted]
            table[:, -1] = measured[fitted, output]
            yield OutputRows(columns, table, fitted, _blocks(fitted))

    def _chosen(self, states: States, output: int) -> tuple[Integers, Floats]:
        """Entries of the regressor that an output depends on, and their shares in it."""
        own = self._entries[output]
        if states.shared is None:
            return own, np.ones(len(own))
        chosen, shares = [own[~self._of_effects[own]]], [1.0]
        for drive, share in enumerate(states.shared[output]):
            if share:
                entries = self._entries[drive]
                chosen.append(entries[self._of_effects[entries]])
                shares.append(float(share))
        return np.concatenate(chosen), np.repeat(shares, list(map(len, chosen)))

    def _filtered_entries(self, states: States) -> Floats:
        """Entries of the regressor after the filter, shape (rows, entries)."""
        if self._last is None or not states.moves_like(self._last[0]):
            entries = self._entries_at(states, states.motion)
            if states.drives is not None:
                entries[:, self._of_effects] = self._entries_at(states, states.drives)[
                    :, self._of_effects
                ]
            self._last = states, states.rows(entries)
        return self._last[1]

    def _entries_at(self, states: States, motion: Motion) -> Floats:
        given = states.symbols, states.inputs
        return self.base.regressor_entries(*motion, *given, threads=1)


def width(term: Mapping[int, Floats]) -> int:
    """Number of columns of a term, given by its signals (samples, k) by output."""
    return int(next(iter(term.values())).shape[1])


def _of_terms(
    first: int, terms: Sequence[Mapping[int, Floats]], output: int
) -> tuple[Integers, list[Floats]]:
    """Parameters of terms that act on an output, numbered from the first one on, and their signals."""
    numbers, signals = [], []
    for term in terms:
        if output in term:
            numbers.append(np.arange(first, first + width(term)))
            signals.append(term[output])
        first += width(term)
    return np.concatenate([*numbers, np.empty(0, dtype=np.intp)]), signals


def _blocks(fitted: Flags) -> tuple[slice, ...]:
    """Blocks of rows that are fitted; they divide all rows evenly."""
    before = np.append(0, np.cumsum(fitted))
    bounds = [
        int(before[-(-len(fitted) * block // BLOCKS)]) for block in range(BLOCKS + 1)
    ]
    return tuple(slice(begin, end) for begin, end in pairwise(bounds))


@dataclass(frozen=True)
class WeightedFit:
    """Weighted least squares on all rows."""

    values: Floats  # shape (parameters,)
    noise: Floats  # variance of each output's residual, shape (outputs,)
    matrix: Floats  # normal matrix, shape (parameters, parameters)

    @property
    def covariance(self) -> Floats:
        """Covariance of the parameters; what the data leave open is kept small."""
        return ridged_inverse(self.matrix)

    @property
    def errors(self) -> Floats:
        """Standard errors of the parameters."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))


def fitted(products: Products) -> WeightedFit:
    """All parameters by iteratively reweighted least squares."""
    whole, counts = products.together(), np.maximum(products.counts.sum(axis=0), 1)
    total = np.array([gram[0, -1, -1] for gram in whole.grams])
    # weights of outputs that are exactly zero stay far from the largest double
    least = np.sqrt(np.finfo(float).tiny)
    floor = np.maximum(_FLOOR * total / counts, least)
    noise = np.maximum(total / counts, floor)
    values, matrix = np.zeros(products.size), np.zeros((products.size, products.size))
    for _ in range(_REWEIGHTED):
        matrix, right = whole.normal_equations(1 / noise)
        values = ridged_solution(matrix, right)
        noise = np.maximum(whole.squares(values)[0] / counts, floor)
    return WeightedFit(values, noise, matrix)


def ridged_solution(matrix: Floats, right: Floats) -> Floats:
    """Solution (n,) with a normal matrix (n, n), what it leaves open kept small."""
    scaled, scale = _ridged(matrix)
    return np.asarray(np.linalg.solve(scaled, right / scale) / scale)


def ridged_inverse(matrix: Floats) -> Floats:
    """Inverse of a normal matrix (n, n), what it leaves open kept small."""
    scaled, scale = _ridged(matrix)
    return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))


def _ridged(matrix: Floats) -> tuple[Floats, Floats]:
    """A normal matrix of columns of unit length with a ridge, and their lengths."""
    squares = np.diagonal(matrix)
    scale = np.sqrt(np.where(squares > 0, squares, 1.0))
    return matrix / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)), scale
