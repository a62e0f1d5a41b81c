"""Rows: the regressor and the measured outputs of prepared samples, both filtered alike, block by block.

The next piece of a log is read and prepared on another thread while this one is worked on.  Decoding, filters and
compiled functions free the interpreter while they run, so that two threads are nearly twice as fast as one; more would
only hold more pieces in memory.

Only the entries that are not structurally zero are computed, filtered and kept.  Windows overlap by what the filter
reaches, so that cutting changes nothing but memory.  Samples that need no filter and lose no rows go straight into the
fused factorisation, which never forms a row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from typing import Any, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel
from echelon.compute import Layout, Observation, upper_triangle
from echelon.identification.logs.columns.conversion import (
    contact_of,
    is_contact_input,
    touching,
)
from echelon.identification.logs.finding import listed
from echelon.identification.logs.recording import Samples
from echelon.shared import Flags, Floats, InputError, Integers

Item = TypeVar("Item")

_END: Any = object()


def prefetched(items: Iterable[Item]) -> Iterator[Item]:
    """Items in their order, each made on another thread while the one before is worked on."""
    if isinstance(items, Sequence):
        yield from items
        return
    source = iter(items)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(next, source, _END)
        while (item := waiting.result()) is not _END:
            waiting = pool.submit(next, source, _END)
            yield item
            del item  # it need not be in memory while the next one is waited for


@dataclass(frozen=True)
class RowBlock:
    """Rows of [W y], output by output; outputs may have different numbers of rows."""

    source: str  # log they come from
    segment: int  # counts uninterrupted stretches, so that neighbouring rows can be told from those across a gap
    times: tuple[Floats, ...]  # shape (k_i,); for each output, the times of its rows, s
    # shape (k_i, n_i); for each output, the columns layout.columns[i] of the regressor
    matrices: tuple[Floats, ...]
    y: tuple[Floats, ...]  # shape (k_i,); for each output, the measured values

    def taken(self, some: Sequence[Flags | slice]) -> RowBlock:
        """Some rows of every output."""
        times, matrices, y = (
            tuple(part[cut] for part, cut in zip(parts, some, strict=True))
            for parts in (self.times, self.matrices, self.y)
        )
        return RowBlock(self.source, self.segment, times, matrices, y)


@runtime_checkable
class RowStream(Protocol):
    """Rows that can be gone through as often as a method needs; every pass gives the same blocks."""

    @property
    def layout(self) -> Layout:
        """Outputs, parameters, and which of them each output can depend on."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the parameters."""
        ...

    def blocks(self) -> Iterator[RowBlock]:
        """The rows that are fitted, in the order of time, log after log."""
        ...

    def observation(self) -> Observation:
        """The R-factors of the rows that are fitted."""
        empty = _empty(self.layout)
        return reduce(
            stacked, (observed(self.layout, block) for block in self.blocks()), empty
        )


_WINDOW = 1 << 14
"""Samples whose regressor is held at once: a few tens of megabytes for an arm, and long against filters."""
_FREE_WINDOW = 1 << 11
"""Samples whose dense regressor is held at once, where contact forces are projected out."""
_UNKNOWN = 0.05
"""Weight in a row of samples near standstill, or at a limit of their sensor, beyond which the row is left out."""
_REACHES = 8  # windows are at least so many times longer than what the filter reaches


_LEFT = 0.5
"""Eigenvalue of a projector, 0 or 1 but for rounding, above which it leaves an axis."""

FORCES = "outputs"
"""Name of the rows of all outputs, which are mixed once contact forces are projected out."""


@dataclass(frozen=True, repr=False)
class ModelRows:
    """Rows of [W y] of a base model at prepared samples; see :class:`echelon.identification.rows.rows.RowStream`.

    Of several experiments each has outputs of its own, and no rows of those of the others.  Where contacts touch, T of
    :meth:`echelon.BaseModel.without_contact_forces` takes the unknown forces off both sides.  It mixes the outputs, so
    that all of an experiment are one.  Outputs of joints at rest, or of sensors at a limit, are unknown forces as well.
    """

    base: BaseModel
    # returns the samples, the same ones every time it is called
    source: Callable[[], Iterable[Samples]]
    symbols: Mapping[str, float] | None = None  # in the place of those of the model

    @staticmethod
    def of(base: BaseModel, samples: Sequence[Samples]) -> ModelRows:
        """The rows of samples that are in memory."""
        return ModelRows(base, partial(tuple, tuple(samples)))

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the base parameters."""
        return self.base.units

    @cached_property
    def parts(self) -> Mapping[str, ModelRows]:
        """Rows of each experiment by its name, in the base parameters of all; themselves where there is one."""
        names = self.base.mechanism.experiments
        if not names:
            return {"": self}
        models = {name: self.base.experiment(name) for name in names}
        return {
            n: ModelRows(base, self.source, self.symbols) for n, base in models.items()
        }

    @property
    def is_plain(self) -> bool:
        """Whether they are the rows of a single robot that nothing touches."""
        mechanism = self.base.mechanism
        return not (mechanism.experiments or mechanism.contacts)

    def own(self, samples: Samples) -> ModelRows:
        """The rows of the experiment that samples are of; where contacts tell, of that with most contacts."""
        if not self.base.mechanism.experiments:
            return self
        if samples.experiment:
            return self.parts[samples.experiment]
        return max(
            self.parts.values(), key=lambda rows: len(rows.base.mechanism.contacts)
        )

    def named(self, samples: Samples) -> list[tuple[str, str]]:
        """Names and units of the outputs of some samples, in which validations name them."""
        prefix = f"{samples.experiment}." if samples.experiment else ""
        outputs = self.own(samples).base.mechanism.outputs
        return [(prefix + output.name, output.unit) for output in outputs]

    @cached_property
    def layout(self) -> Layout:
        """Outputs, base parameters, and which of them each output can depend on."""
        every = tuple(range(self.base.rank))
        outputs: list[str] = []
        kept: list[tuple[int, ...]] = []
        for name, part in self.parts.items():
            if self.base.mechanism.contacts:
                outputs.append(name or FORCES)
                kept.append(every)
                continue
            names = [output.name for output in part.base.mechanism.outputs]
            rows, columns = part.base.sparsity
            outputs += [f"{name}.{output}" if name else output for output in names]
            kept += [
                tuple(sorted(columns[rows == k].tolist())) for k in range(len(names))
            ]
        return Layout(tuple(outputs), tuple(self.base.pivots), tuple(kept))

    def blocks(self) -> Iterator[RowBlock]:
        """The rows that are fitted, in the order of time, log after log."""
        numbering = Numbering()
        for samples in prefetched(self.source()):
            yield from self.blocks_of(samples, numbering.of(samples))

    def blocks_of(self, samples: Samples, segment: int) -> Iterator[RowBlock]:
        """The rows of some samples, in the order of time."""
        own = self.own(samples)
        _check_outputs(samples, own.base)
        if self.base.mechanism.contacts:
            yield from self._free_blocks(samples, segment)
            return
        if own is not self:
            for block in own.blocks_of(replace(samples, experiment=""), segment):
                yield self._widened(block, samples.experiment)
            return
        # new memory for every window would take as long as its use
        room = np.empty((0, self.base.sparsity.shape[1]))
        for window in self._windows(samples):
            low, high = self._around(samples, window)
            if high - low > len(room):
                room = np.empty((high - low, room.shape[1]))
            entries = self._entries(samples, low, high, room[: high - low])
            yield self._block(samples, window, segment, entries)

    def _widened(self, block: RowBlock, experiment: str) -> RowBlock:
        """Rows of an experiment among the outputs of all."""
        own = self.parts[experiment].base.mechanism.outputs
        names = [f"{experiment}.{output.name}" for output in own]
        rows = zip(block.times, block.matrices, block.y, strict=True)
        return self._placed(
            block.source, block.segment, dict(zip(names, rows, strict=True))
        )

    def _placed(
        self,
        source: str,
        segment: int,
        rows: Mapping[str, tuple[Floats, Floats, Floats]],
    ) -> RowBlock:
        """Times, matrices and measured values of some outputs, and no rows of the others."""
        none = np.zeros(0)
        parts = [
            rows.get(name, (none, np.zeros((0, len(columns))), none))
            for name, columns in zip(
                self.layout.outputs, self.layout.columns, strict=True
            )
        ]
        times, matrices, y = zip(*parts, strict=True)
        return RowBlock(source, segment, times, matrices, y)

    # -- contacts ----------------------------------------------------------------------------------------------------

    def phases(self, samples: Samples) -> Integers:
        """Numbers of the parts that samples belong to, shape (N,): the fewest contacts that hold all that touch."""
        sets = [
            {contact.name for contact in part.base.mechanism.contacts}
            for part in self.parts.values()
        ]
        if samples.experiment or len(sets) == 1:
            return np.full(len(samples), list(self.parts).index(samples.experiment))
        told = filter(is_contact_input, samples.inputs)
        known = {contact_of(name) for name in told}
        names = sorted(known.union(*sets))
        flags = touching(samples.inputs, names)
        kinds, of = np.unique(flags, axis=0, return_inverse=True)
        chosen = []
        for kind in kinds:
            touch = {name for name, flag in zip(names, kind, strict=True) if flag}
            fitting = [k for k, some in enumerate(sets) if some >= touch]
            if not fitting:
                raise InputError(
                    f"{listed(sorted(touch))} touch together, and no experiment has them all: add one with  contacts: "
                    f"[{', '.join(sorted(touch))}]",
                    source=samples.source,
                )
            chosen.append(min(fitting, key=lambda k: len(sets[k])))
        return np.array(chosen)[of.ravel()]

    def projectors(self, samples: Samples, phases: Integers) -> Floats:
        """Matrices (N, outputs, outputs) that take unknown forces off the outputs of some samples."""
        outputs = self.own(samples).base.mechanism.outputs
        unknown = samples.left_out
        if unknown is None:
            unknown = np.zeros((len(samples), len(outputs)), dtype=bool)
        found = np.empty((*unknown.shape, unknown.shape[1]))
        for k, part in enumerate(self.parts.values()):
            some = phases == k
            if some.any():
                found[some] = _projectors(
                    part.base, samples.q[some], unknown[some], self.symbols
                )
        return found

    def free(self, samples: Samples, signals: Floats) -> tuple[Samples, Floats]:
        """Samples and signals (N, outputs, …) of them without unknown contact forces; as they are without contacts."""
        if not self.base.mechanism.contacts:
            return samples, signals
        T = self.projectors(samples, self.phases(samples))
        return replace(samples, moving=None, pinned=None), T @ signals

    def _free_blocks(self, samples: Samples, segment: int) -> Iterator[RowBlock]:
        phases, y = self.phases(samples), samples.y
        assert y is not None
        for start, stop in self._windows(samples, _FREE_WINDOW):
            low, high = self._around(samples, (start, stop))
            part = samples.cut(slice(low, high))
            regressor = self._regressor(part)
            table = np.concatenate([regressor, y[low:high, :, None]], axis=2)
            T = self.projectors(part, phases[low:high])
            table = samples.reduced(T @ table)
            places = np.arange(low, high, samples.factor)
            inside = (places >= max(start, samples.first)) & (places < stop)
            places = places[inside]
            # as many rows as T leaves dimensions: more would count the noise of a sample more than once
            sizes, axes = np.linalg.eigh(T[places - low])
            table = np.swapaxes(axes, 1, 2) @ table[inside]
            rows = {}
            for k, name in enumerate(self.parts):
                some = phases[places] == k
                left = sizes[some] > _LEFT
                at = samples.start + places[some] / samples.rate
                mixed = table[some][left]
                times = np.repeat(at, left.sum(axis=1))
                rows[name or FORCES] = (times, mixed[:, :-1], mixed[:, -1])
            yield self._placed(samples.source, segment, rows)

    # -- factors of single models ------------------------------------------------------------------------------------

    def observation(self) -> Observation:
        """The R-factors of all rows."""
        total = _empty(self.layout)
        for samples in prefetched(self.source()):
            _check_outputs(samples, self.own(samples).base)
            is_fused = plain(samples) and self.is_plain
            # in the order in which rows in memory would be added
            parts = [self._fused(samples)] if is_fused else self._factors(samples)
            total = reduce(stacked, parts, total)
        return total

    def predict(self, samples: Samples, values: npt.ArrayLike) -> Floats:
        """The outputs at all samples, before any filter; shape (N, outputs); without forces at contacts."""
        if self.base.mechanism.contacts:
            return np.asarray(self._regressor(samples) @ np.asarray(values))
        own, inputs = self.own(samples).base, samples.inputs
        return own.predict(*samples.motion, values, self.symbols, inputs)

    def _regressor(self, samples: Samples) -> Floats:
        """The regressor of the experiment of some samples, shape (N, outputs, parameters), whatever touches."""
        given = samples.inputs.items()
        inputs = {name: some for name, some in given if not is_contact_input(name)}
        own = self.own(samples).base
        return own.regressor(*samples.motion, self.symbols, inputs)

    # -- windows -----------------------------------------------------------------------------------------------------

    @staticmethod
    def _windows(samples: Samples, most: int = _WINDOW) -> Iterator[tuple[int, int]]:
        """Stretches of samples that rows are made of, before the overlap; they start where a row may stand."""
        stop, factor = samples.end, samples.factor
        size = -(-max(most, _REACHES * samples.reach) // factor) * factor
        first = samples.first // factor * factor
        yield from (
            (start, min(start + size, stop)) for start in range(first, stop, size)
        )

    @staticmethod
    def _around(samples: Samples, window: tuple[int, int]) -> tuple[int, int]:
        """The samples that the rows of a window depend on."""
        start, stop = window
        margin = -(-samples.reach // samples.factor) * samples.factor
        return max(start - margin, 0), min(stop + margin, len(samples))

    def _block(
        self, samples: Samples, window: tuple[int, int], segment: int, entries: Floats
    ) -> RowBlock:
        """Rows of the samples in a window, output by output."""
        (start, stop), (low, high) = window, self._around(samples, window)
        assert samples.y is not None
        entries, y = samples.reduced(entries), samples.reduced(samples.y[low:high])
        places = np.arange(low, high, samples.factor)
        inside = (places >= max(start, samples.first)) & (places < stop)
        times = (samples.start + places[inside] / samples.rate,) * len(self._columns)
        matrices = tuple(entries[np.ix_(inside, columns)] for columns in self._columns)
        block = RowBlock(samples.source, segment, times, matrices, tuple(y[inside].T))
        part = samples.cut(slice(low, high))
        fitted = _rows_without(part, part.left_out)
        return block if fitted is None else block.taken(tuple(fitted[inside].T))

    def _entries(self, samples: Samples, low: int, high: int, out: Floats) -> Floats:
        """Entries of the regressor, shape (high − low, entries)."""
        part = samples.cut(slice(low, high))
        motion, inputs = part.motion, part.inputs
        return self.base.regressor_entries(*motion, self.symbols, inputs, out=out)

    @cached_property
    def _columns(self) -> tuple[npt.NDArray[np.intp], ...]:
        """For each output, the entries that are its columns."""
        count = len(self.layout.outputs)
        rows, parameters = self.base.sparsity
        mine = (np.flatnonzero(rows == output) for output in range(count))
        return tuple(some[np.argsort(parameters[some])] for some in mine)

    # -- factors -----------------------------------------------------------------------------------------------------

    def _fused(self, samples: Samples) -> Observation:
        counted = samples.cut(slice(samples.first, samples.stop))
        return self.base.accumulate(counted.state, self.symbols)

    def _factors(self, samples: Samples) -> Iterator[Observation]:
        return (observed(self.layout, block) for block in self.blocks_of(samples, 0))


def _projectors(
    base: BaseModel, q: Floats, unknown: Flags, symbols: Mapping[str, float] | None
) -> Floats:
    """Matrices (N, outputs, outputs) that take forces at contacts and unknown outputs off."""
    if base.mechanism.contacts:
        return base.without_contact_forces(q, symbols=symbols, unknown=unknown)
    return np.eye(unknown.shape[1]) * ~unknown[:, :, None]


class Numbering:
    """Counts uninterrupted stretches of samples that arrive piece by piece."""

    def __init__(self) -> None:
        self._segment, self._end = -1, ("", np.nan)

    def of(self, samples: Samples) -> int:
        """Number of the stretch to which the next samples belong."""
        begin = samples.start + samples.first / samples.rate
        follows = (
            samples.source == self._end[0]
            and abs(begin - self._end[1]) < 0.5 / samples.rate
        )
        self._segment += not follows
        self._end = (samples.source, samples.start + samples.end / samples.rate)
        return self._segment


def rows_taken(samples: Samples, values: Floats) -> tuple[Floats, Floats, Flags | None]:
    """Times of rows, signals (rows, …) filtered like both sides, and which of them are fitted (rows, outputs)."""
    kept, inside = _kept(samples)
    fitted = _rows_without(samples, samples.left_out)
    times = samples.start + kept[inside] / samples.rate
    filtered = rows_filtered(samples, values)
    return times, filtered, None if fitted is None else fitted[inside]


def rows_measured(samples: Samples) -> Flags | None:
    """Rows of whose samples hardly any is at a limit of its sensor, shape (rows, outputs); all if None."""
    measured = _rows_without(samples, samples.pinned)
    return None if measured is None else measured[_kept(samples)[1]]


def rows_filtered(samples: Samples, values: Floats) -> Floats:
    """Signals (samples, …) filtered like both sides, shape (rows, …)."""
    return samples.reduced(values)[_kept(samples)[1]]


def _kept(samples: Samples) -> tuple[Integers, Flags]:
    """Samples that the filter of both sides leaves, and which of them are rows."""
    kept = np.arange(0, len(samples), samples.factor)
    return kept, (kept >= samples.first) & (kept < samples.end)


def _rows_without(samples: Samples, left_out: Flags | None) -> Flags | None:
    """Rows of samples to which those that are left out hardly contribute, shape (rows, outputs); all if None."""
    if left_out is None:
        return None
    return np.abs(samples.reduced(left_out.astype(float))) <= _UNKNOWN


def observed(layout: Layout, block: RowBlock) -> Observation:
    """The R-factors of a block of rows."""
    pairs = zip(block.matrices, block.y, strict=True)
    factors = tuple(upper_triangle(np.column_stack([matrix, y])) for matrix, y in pairs)
    return Observation(layout, factors, tuple(len(y) for y in block.y))


def stacked(a: Observation, b: Observation) -> Observation:
    """The observation of both sets of rows, like their sum, on one thread."""
    factors = tuple(
        upper_triangle(b, start=a) for a, b in zip(a.factors, b.factors, strict=True)
    )
    counts = tuple(m + n for m, n in zip(a.counts, b.counts, strict=True))
    return Observation(a.layout, factors, counts)


def _empty(layout: Layout) -> Observation:
    factors = tuple(np.zeros((size, size)) for size in layout.sizes)
    return Observation(layout, factors, (0,) * len(layout.outputs))


def plain(samples: Samples) -> bool:
    """Whether samples need no filter and lose no rows, so that they can be factored without forming rows."""
    return (
        samples.reduction is None and samples.moving is None and samples.pinned is None
    )


def _check_outputs(samples: Samples, base: BaseModel) -> None:
    if samples.y is None:
        names = ", ".join(output.name for output in base.mechanism.outputs)
        raise InputError(
            f"the log holds no measured outputs; expected {names}",
            source=samples.source,
        )
