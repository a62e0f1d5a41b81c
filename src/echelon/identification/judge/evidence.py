"""The rows that hypotheses are judged by: a log on a slow clock, in blocks of time that are predicted from one another.

A model with the columns W of the base parameters and columns X of a hypothesis is fitted by least squares, outputs
weighted by their noise, to all blocks but one, and the one left out is predicted.  What it leaves of each output in
each block says how good the hypothesis is, and how sure that is: blocks err independently where samples do not.
W is projected away once for each block, so that a hypothesis costs no more than its own few columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Flags, Floats, Integers
from echelon.base.model import BaseModel
from echelon.identification.rows.plan import spread_out
from echelon.identification.rows.rows import rows_taken
from echelon.logs.preparation.prepare import ORDER, ROOM
from echelon.logs.recording import Samples
from echelon.signals.filters import WORTH, lowpass

SAMPLES = 8000  # samples that are judged, over all logs, of which filters leave a third or a quarter
BLOCKS = 10  # blocks of time: few enough to hold all motions, enough to tell a standard error
_RIDGE = 1e-9  # of squares of columns: what the data leave open stays small
_FLOOR = 1e-9  # of an output's squares: rounding of exact data is no noise
_LITTLE = 0.005  # gain, in logarithms, that is none however sure it is
_REWEIGHTED = 5  # iterations in which outputs get the weights of their residuals

GRAVITY = ("gx", "gy", "gz")


@dataclass(frozen=True)
class States:
    """Samples of logs as some hypothesis reads them."""

    q: Floats
    qd: Floats
    qdd: Floats
    y: Floats
    inputs: Mapping[str, Floats]
    pieces: tuple[Samples, ...]  # stretches that the samples are, with the filter of both sides
    scale: Floats  # shape (outputs,); outputs by what the model predicts
    gravity: Floats | None = None  # shape (3,), m/s² in the base frame; None where the model has it built in
    band: float = np.inf  # that the fit keeps, Hz

    @staticmethod
    def of(
        samples: Iterable[Samples], band: float, base: BaseModel, values: Floats, gravity: Floats | None = None
    ) -> States:
        """Prepared samples on a clock that is no faster than their band needs, Hz, from all parts of the logs.

        A slow clock knows too late where dry friction turns.  So what a model with some base parameters predicts is
        taken off on the clock of the log, and added again on the slow one.
        """

        def left(some: Samples) -> Samples:
            assert some.y is not None
            return replace(some, y=some.y - _predicted(base, some, values))

        measured = (piece for piece in samples if piece.y is not None)
        pieces = tuple(spread_out(measured, band, SAMPLES, BLOCKS, left))
        q, qd, qdd, rest = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("q", "qd", "qdd", "y"))
        y = rest + np.concatenate([_predicted(base, piece, values) for piece in pieces])
        inputs = {name: np.concatenate([piece.inputs[name] for piece in pieces]) for name in pieces[0].inputs}
        return States(q, qd, qdd, y, inputs, pieces, np.ones(y.shape[1]), gravity, band)

    @property
    def time(self) -> Floats:
        """Times of the samples since the first one, s; logs follow one another."""
        parts, begin = [], 0.0
        for piece, following in zip(self.pieces, (*self.pieces[1:], None), strict=True):
            parts.append(begin + np.arange(len(piece)) / piece.rate)
            ahead = len(piece) / piece.rate
            if following is not None and following.source == piece.source and following.start > piece.start:
                ahead = following.start - piece.start
            begin += ahead
        return np.concatenate(parts)

    def derivative(self, values: Floats) -> Floats:
        """Rates of signals (samples, …), by central differences within stretches."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        parts = zip(self.pieces, np.split(values, ends[:-1]), strict=True)
        rates: Floats = np.concatenate([np.gradient(part, axis=0) * piece.rate for piece, part in parts])
        return rates

    @property
    def rate(self) -> Floats:
        """Samples per second at each sample."""
        return np.concatenate([np.full(len(piece), piece.rate) for piece in self.pieces])

    def smoothed(self, values: Floats) -> Floats:
        """Signals (samples,) after the low-pass that measured positions have passed."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        parts = zip(self.pieces, np.split(values, ends[:-1]), strict=True)
        cutoff = ROOM * self.band
        return np.concatenate(
            [part if cutoff > WORTH * piece.rate else lowpass(part, cutoff, piece.rate, ORDER) for piece, part in parts]
        )

    def rows(self, values: Floats) -> Floats:
        """Signals (samples, …) after the filter of both sides, shape (rows, …)."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        parts = zip(self.pieces, np.split(values, ends[:-1]), strict=True)
        return np.concatenate([rows_taken(piece, part)[1] for piece, part in parts])

    @cached_property
    def fitted(self) -> Flags:
        """Rows that are fitted, shape (rows, outputs)."""
        found = [rows_taken(piece, piece.q[:, :1]) for piece in self.pieces]
        every = (np.ones((len(rows), self.y.shape[1]), dtype=bool) for _, rows, _ in found)
        return np.concatenate([a if flags is None else flags for a, (_, _, flags) in zip(every, found, strict=True)])

    def predicted(self, base: BaseModel, values: Floats) -> Floats:
        """The outputs of a model, shape (samples, outputs)."""
        inputs = dict(self.inputs)
        found: Floats = self.scale * base.predict(self.q, self.qd, self.qdd, values, self.symbols, inputs)
        return found

    @property
    def symbols(self) -> dict[str, float]:
        """Values of the symbols of gravity, if the model has some."""
        if self.gravity is None:
            return {}
        return {name: float(value) for name, value in zip(GRAVITY, self.gravity, strict=True)}


def _predicted(base: BaseModel, samples: Samples, values: Floats) -> Floats:
    return base.predict(samples.q, samples.qd, samples.qdd, values, None, dict(samples.inputs))


@dataclass(frozen=True)
class Products:
    """[W X y]ᵀ[W X y] of each output's rows in each block, with the columns X of hypotheses."""

    size: int  # of all parameters: base parameters, then those of hypotheses
    columns: tuple[Integers, ...]  # shape (n_i,) for each output: the parameters it can depend on
    grams: tuple[Floats, ...]  # shape (blocks, n_i + 1, n_i + 1)
    counts: Floats  # shape (blocks, outputs); rows
    sums: Floats  # shape (blocks, outputs); of the measured values

    @property
    def spread(self) -> Floats:
        """Squares of measured values about their means, shape (outputs,)."""
        squares = np.array([gram[:, -1, -1].sum() for gram in self.grams])
        of_means: Floats = self.sums.sum(axis=0) ** 2 / np.maximum(self.counts.sum(axis=0), 1)
        return np.asarray(np.maximum(squares - of_means, 0.0))

    @property
    def together(self) -> Products:
        """The products of all blocks as of one."""
        grams = tuple(gram.sum(axis=0, keepdims=True) for gram in self.grams)
        counts, sums = (some.sum(axis=0, keepdims=True) for some in (self.counts, self.sums))
        return replace(self, grams=grams, counts=counts, sums=sums)

    def scaled(self, output: int, factor: float) -> Products:
        """The products where an output is so many times what the model says."""
        scale = np.append(np.full(len(self.columns[output]), factor), 1.0)
        grams = list(self.grams)
        grams[output] = grams[output] * np.outer(scale, scale)
        return replace(self, grams=tuple(grams))

    def squares(self, values: Floats) -> Floats:
        """Squares of residuals with some parameters, shape (blocks, outputs)."""
        found = np.empty_like(self.counts)
        for output, (columns, gram) in enumerate(zip(self.columns, self.grams, strict=True)):
            full = np.append(values[columns], -1.0)
            found[:, output] = np.maximum((gram @ full) @ full, 0.0)
        return found


class Evidence:
    """A base model beside the rows of some logs."""

    def __init__(self, base: BaseModel, states: States) -> None:
        self.base, self.states = base, states
        places, parameters = base.sparsity
        self._entries: list[Integers] = [np.flatnonzero(places == i) for i in range(states.y.shape[1])]
        self._columns = [parameters[entries] for entries in self._entries]

    def products(self, states: States, terms: Sequence[Mapping[int, Floats]] = ()) -> Products:
        """Products of the rows as some states have them, with columns of terms: signals (samples, k) by output."""
        size, placed = self.base.rank, []
        for term in terms:
            width = next(iter(term.values())).shape[1]
            placed.append((size, term))
            size += width
        entries = self.base.regressor_entries(
            states.q, states.qd, states.qdd, states.symbols, dict(states.inputs), threads=1
        )
        model, fitted = states.rows(np.column_stack([entries, states.y])), states.fitted
        blocks = np.minimum(np.arange(len(model)) * BLOCKS // max(len(model), 1), BLOCKS - 1)
        columns, grams, counts, sums = (
            [],
            [],
            np.zeros((BLOCKS, states.y.shape[1])),
            np.zeros((BLOCKS, states.y.shape[1])),
        )
        for output, chosen in enumerate(self._entries):
            mine = [(first, term[output]) for first, term in placed if output in term]
            more = states.rows(np.hstack([signals for _, signals in mine])) if mine else np.zeros((len(model), 0))
            y = model[:, [entries.shape[1] + output]]
            table = np.hstack([states.scale[output] * model[:, chosen], more, y])
            added = [first + k for first, signals in mine for k in range(signals.shape[1])]
            columns.append(np.append(self._columns[output], np.array(added, dtype=np.intp)))
            parts = [table[(blocks == block) & fitted[:, output]] for block in range(BLOCKS)]
            grams.append(np.stack([part.T @ part for part in parts]))
            counts[:, output] = [len(part) for part in parts]
            sums[:, output] = [part[:, -1].sum() for part in parts]
        return Products(size, tuple(columns), tuple(grams), counts, sums)


@dataclass(frozen=True)
class Fit:
    """Weighted least squares on all rows."""

    values: Floats  # shape (parameters,)
    noise: Floats  # variance of each output's residual, shape (outputs,)
    matrix: Floats  # normal matrix, shape (parameters, parameters)

    @property
    def covariance(self) -> Floats:
        """Covariance of the parameters; what the data leave open is kept small."""
        scale = np.sqrt(np.where(np.diagonal(self.matrix) > 0, np.diagonal(self.matrix), 1.0))
        scaled = self.matrix / np.outer(scale, scale) + _RIDGE * np.eye(len(scale))
        return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))

    @property
    def errors(self) -> Floats:
        """Standard errors of the parameters."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))


def fitted(products: Products) -> Fit:
    """All parameters by iteratively reweighted least squares."""
    whole, counts = products.together, np.maximum(products.counts.sum(axis=0), 1)
    total = np.array([gram[0, -1, -1] for gram in whole.grams])
    floor = np.maximum(_FLOOR * total / counts, np.finfo(float).tiny)
    noise = np.maximum(total / counts, floor)
    values, matrix = np.zeros(products.size), np.zeros((products.size, products.size))
    for _ in range(_REWEIGHTED):
        matrix, right = _normal(whole, 1 / noise, slice(None))
        values = _ridged(matrix)(right)
        noise = np.maximum(whole.squares(values)[0] / counts, floor)
    return Fit(values, noise, matrix)


def _normal(products: Products, weights: Floats, blocks: slice | Integers) -> tuple[Floats, Floats]:
    """Normal matrix and right side over some blocks."""
    matrix, right = np.zeros((products.size, products.size)), np.zeros(products.size)
    for columns, gram, weight in zip(products.columns, products.grams, weights, strict=True):
        part = weight * gram[blocks].sum(axis=0)
        matrix[np.ix_(columns, columns)] += part[:-1, :-1]
        right[columns] += part[:-1, -1]
    return matrix, right


def _ridged(matrix: Floats) -> Callable[[Floats], Floats]:
    """Solves with a normal matrix, what it leaves open kept small."""
    scale = np.sqrt(np.where(np.diagonal(matrix) > 0, np.diagonal(matrix), 1.0))
    scaled = matrix / np.outer(scale, scale) + _RIDGE * np.eye(len(matrix))

    def solve(right: Floats) -> Floats:
        divisor = scale if right.ndim == 1 else scale[:, None]
        found: Floats = np.linalg.solve(scaled, right / divisor) / divisor
        return found

    return solve


class HeldOut:
    """Predictions of each block from all others, without columns of hypotheses and with some."""

    def __init__(self, products: Products, kept: Integers, noise: Floats) -> None:
        self._products, self._kept = products, kept
        everything = np.arange(BLOCKS)
        self._folds = []
        others = np.setdiff1d(np.arange(products.size), kept)
        for block in range(BLOCKS):
            matrix, right = _normal(products, 1 / noise, everything[everything != block])
            solve = _ridged(matrix[np.ix_(kept, kept)])
            cross = matrix[np.ix_(kept, others)]
            beside, alone = solve(cross), solve(right[kept])
            left = matrix[np.ix_(others, others)] - cross.T @ beside
            rest = right[others] - cross.T @ alone
            self._folds.append((alone, beside, left, rest, np.diagonal(matrix)[others]))
        self._place = {int(column): k for k, column in enumerate(others)}

    def squares(self, columns: Sequence[int] = ()) -> Floats:
        """Squares of what is left of each block, with some columns of hypotheses, shape (blocks, outputs)."""
        products = self._products
        found = np.empty_like(products.counts)
        some = [self._place[column] for column in columns]
        for block, (alone, beside, left, rest, _) in enumerate(self._folds):
            values = np.zeros(products.size)
            values[self._kept] = alone
            if some:
                own = _ridged(left[np.ix_(some, some)])(rest[some])
                values[self._kept] -= beside[:, some] @ own
                values[list(columns)] = own
            for output, (chosen, gram) in enumerate(zip(products.columns, products.grams, strict=True)):
                full = np.append(values[chosen], -1.0)
                found[block, output] = max(full @ gram[block] @ full, 0.0)
        return found

    def sizes(self, columns: Sequence[int]) -> Floats:
        """Parameters of some columns, the mean over the folds, shape (columns,)."""
        some = [self._place[column] for column in columns]
        found = [_ridged(left[np.ix_(some, some)])(rest[some]) for _, _, left, rest, _ in self._folds]
        return np.asarray(np.mean(found, axis=0))

    def new(self, columns: Sequence[int]) -> Floats:
        """Shares of columns' squares that the model cannot say already, at least over the folds, shape (columns,)."""
        some = [self._place[column] for column in columns]
        shares = [
            np.diagonal(left)[some] / np.maximum(whole[some], np.finfo(float).tiny)
            for _, _, left, _, whole in self._folds
        ]
        return np.asarray(np.min(shares, axis=0))


@dataclass(frozen=True)
class Gain:
    """How much better one prediction is than another: logarithms of ratios of residuals, mean of all outputs."""

    mean: float
    error: float  # standard error, from blocks

    @staticmethod
    def of(before: Floats, after: Floats, floor: Floats) -> Gain:
        """From squares by block and output, shape (blocks, outputs), and squares that count as none, (outputs,)."""
        told = (before > 0).any(axis=0)
        if not told.any():
            return Gain(0.0, np.inf)
        least = np.maximum(floor / len(before), np.finfo(float).tiny)
        ratios = 0.5 * np.log(np.maximum(before, least) / np.maximum(after, least))[:, told].mean(axis=1)
        return Gain(float(ratios.mean()), float(ratios.std(ddof=1) / np.sqrt(len(ratios))))

    @property
    def is_none(self) -> bool:
        """Whether it is within its standard error, or too little to matter."""
        return self.mean < max(self.error, _LITTLE)

    @property
    def ratio(self) -> float:
        """The mean in standard errors."""
        return self.mean / max(self.error, np.finfo(float).tiny)
