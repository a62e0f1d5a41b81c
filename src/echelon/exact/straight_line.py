"""Straight-line programs over GF(p): sums of products, and inverses, recorded at one sample and repeated on many.

What is zero at the recorded sample is left out of all further computation.  Other samples *follow* the program if the
same numbers vanish there and none that is inverted does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Flags
from echelon.exact.field import PrimeField, Residues

Indices = npt.NDArray[np.int64]

ZERO, ONE, MINUS_ONE = 0, 1, 2
_CONSTANTS = (0, 1, -1)
_CACHED = 1 << 19  # numbers that are treated together

Terms = Sequence[tuple[int, int]]


@dataclass(frozen=True)
class _Stage:
    """Numbers that depend on earlier stages only; the first ones have most terms."""

    start: int  # the first of them
    # factors of the first term of each number, then of the second of those that have one, and so on; in a stage of
    # inverses ``right`` is empty
    left: Indices
    right: Indices
    counts: list[int]  # how many numbers have a first, second, ... term

    def run(self, values: Residues, field: PrimeField) -> Flags | None:
        """Compute the numbers; returns where all that are inverted differ from zero."""
        out = values[self.start : self.start + self.counts[0]]
        terms = values.take(self.left, axis=0)
        if not self.right.size:
            zero = terms == 0
            terms[zero] = 1
            out[:] = field.p - field.invert_array(terms)
            return np.asarray(~zero.any(axis=0))
        terms *= values.take(self.right, axis=0)
        np.remainder(terms, field.p, out=terms)
        place = self.counts[0]
        for count in self.counts[1:]:
            terms[:count] += terms[place : place + count]
            place += count
        np.remainder(terms[: self.counts[0]], field.p, out=out)
        return None


@dataclass(frozen=True)
class Program:
    """A recorded computation."""

    size: int  # how many numbers it computes
    inputs: Indices  # where they go
    zeros: Indices  # the numbers that vanish at all samples that follow
    outputs: Indices
    _stages: list[_Stage]

    def run(self, inputs: Residues, field: PrimeField) -> tuple[Flags, Residues]:
        """Which samples follow, and the outputs, from inputs of shape (inputs, samples)."""
        samples = inputs.shape[1]
        parts = np.array_split(np.arange(samples), samples * self.size // _CACHED + 1)
        results = [self._run(inputs[:, part], field) for part in parts]
        return np.concatenate([mask for mask, _ in results]), np.concatenate([out for _, out in results], axis=1)

    def _run(self, inputs: Residues, field: PrimeField) -> tuple[Flags, Residues]:
        values = np.zeros((self.size, inputs.shape[1]), dtype=np.int64)
        values[ONE], values[MINUS_ONE] = 1, field.p - 1
        values[self.inputs] = inputs
        follows = np.ones(inputs.shape[1], dtype=bool)
        for stage in self._stages:
            invertible = stage.run(values, field)
            if invertible is not None:
                follows &= invertible
        return follows & ~values[self.zeros].any(axis=0), values[self.outputs]


class Recorder:
    """Computes with the numbers of one sample, and records how.

    Numbers are denoted by their place among all.
    """

    def __init__(self, field: PrimeField, inputs: Iterable[int]) -> None:
        self._p = field.p
        self._values = [v % field.p for v in (*_CONSTANTS, *inputs)]
        self._terms: list[Terms] = [()] * len(self._values)
        self._inputs = range(len(_CONSTANTS), len(self._values))
        self._zeros: list[int] = [k for k in self._inputs if not self._values[k]]
        self._required: list[int] = []

    @property
    def inputs(self) -> list[int]:
        """The inputs; ``ZERO`` for those that vanish."""
        return [k if self._values[k] else ZERO for k in self._inputs]

    def sum(self, terms: Terms) -> int:
        """Sum of products of two numbers; ``ZERO`` if it vanishes."""
        if len(terms) == 1 and ONE in terms[0]:
            return sum(terms[0]) - ONE
        number = self._append(terms, sum(self._values[a] * self._values[b] for a, b in terms) % self._p)
        if self._values[number]:
            return number
        self._zeros.append(number)
        return ZERO

    def minus_inverse(self, number: int) -> int:
        """−1/x."""
        if number in (ONE, MINUS_ONE):
            return ONE + MINUS_ONE - number
        return self._append([(number, -1)], pow(-self._values[number], -1, self._p))

    def require(self, number: int) -> None:
        """Let only those samples follow at which this number can be computed."""
        self._required.append(number)

    def program(self, outputs: Sequence[int]) -> Program:
        """What leads to some numbers."""
        needed, queue = set(range(self._inputs.stop)), [*outputs, *self._zeros, *self._required]
        while queue:
            number = queue.pop()
            if number not in needed:
                needed.add(number)
                queue += [k for term in self._terms[number] for k in term if k >= 0]
        level = [0] * len(self._terms)
        stages: dict[tuple[int, bool], list[int]] = {}
        for number in sorted(needed)[self._inputs.stop :]:
            terms = self._terms[number]
            level[number] = 1 + max(level[k] for term in terms for k in term if k >= 0)
            stages.setdefault((level[number], terms[0][1] < 0), []).append(number)
        place = np.zeros(len(level), dtype=np.int64)
        place[: self._inputs.stop] = range(self._inputs.stop)
        size, compiled = self._inputs.stop, []
        for key in sorted(stages):
            numbers = sorted(stages[key], key=lambda number: -len(self._terms[number]))
            place[numbers] = range(size, size + len(numbers))
            compiled.append(self._stage(size, numbers, place))
            size += len(numbers)
        return Program(size, place[list(self._inputs)], place[self._zeros], place[list(outputs)], compiled)

    def _append(self, terms: Terms, value: int) -> int:
        self._terms.append(terms)
        self._values.append(value)
        return len(self._values) - 1

    def _stage(self, start: int, numbers: list[int], place: Indices) -> _Stage:
        """A stage of numbers in descending order of their terms."""
        terms = [self._terms[number] for number in numbers]
        counts = [sum(len(t) > k for t in terms) for k in range(len(terms[0]))]
        ordered = np.array([terms[i][k] for k, count in enumerate(counts) for i in range(count)])
        inverse = ordered[0, 1] < 0
        return _Stage(start, place[ordered[:, 0]], place[ordered[: 0 if inverse else None, 1]], counts)
