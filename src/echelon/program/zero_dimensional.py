"""All solutions in GF(p) of polynomial systems with finitely many solutions, for many samples at once.

The systems have the same monomials and, sample by sample, other coefficients, like the closure conditions of a
mechanism at random geometries.  The ideal is completed degree by degree: equations, and differences between two ways
to compute a normal form, are eliminated until the multiplications by the variables are known on the free monomials and
commute (Mourrain's criterion), which makes these a basis of the quotient ring.

What to eliminate is found out on one sample and recorded as a program, which is then run on all; the few that do not
follow are treated by themselves.  Every point is checked against all equations.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Flags, Integers
from echelon.exact.field import PrimeField, Residues, reduced_echelon
from echelon.exact.quotient_ring import Equation, Exponents, Monomials, NormalForms, Product, commute, quotient_points
from echelon.program.schedule import Array, ModularArithmetic, Schedule
from echelon.program.tape import Op, Program

Row = dict[int, int]
"""Monomials and the numbers, of a recorder, by which they are multiplied."""


class Recorder:
    """Computes with the residues of one sample, and records how on a program; numbers are its nodes.

    What is zero at the recorded sample is left out of all further computation.  Other samples *follow* if the same
    numbers vanish there and none that is inverted does.
    """

    def __init__(self, field: PrimeField, inputs: Iterable[int]) -> None:
        self.program = record = Program()
        self.zero, self.one, self.minus_one = (record.constant(x).node for x in (0, 1, -1))
        self._field, self._zeros, self._required = field, list[int](), list[int]()
        self._values = {self.zero: 0, self.one: 1, self.minus_one: -1}
        self.inputs = [self._number(record.input(f"x{k}").node, value) for k, value in enumerate(inputs)]

    def sum(self, terms: Iterable[tuple[int, int]]) -> int:
        """Sum of products of two numbers; the number zero if it vanishes."""
        record, node, value = self.program, self.zero, 0
        for a, b in terms:
            node = record.add(node, record.multiply(a, b))
            value += self._values[a] * self._values[b]
        return self._number(node, value)

    def minus_inverse(self, number: int) -> int:
        """−1/x."""
        return self._number(self.program.divide(self.minus_one, number), -self._field.invert(self._values[number]))

    def require(self, number: int) -> None:
        """Let only those samples follow at which this number can be computed."""
        self._required.append(number)

    def recording(self, outputs: Sequence[int]) -> Recording:
        """What leads to some numbers."""
        return Recording(self.program, outputs, self._zeros, self._required)

    def _number(self, node: int, value: int) -> int:
        self._values[node] = value % self._field.p
        if self._values[node] or node == self.zero:
            return node
        self._zeros.append(node)
        return self.zero


class Recording:
    """A recorded computation."""

    def __init__(self, program: Program, outputs: Sequence[int], zeros: Sequence[int], required: Sequence[int]) -> None:
        self._schedule = Schedule(program, [*outputs, *zeros, *required])
        self._place = {node: k for k, node in enumerate(program.inputs)}
        self._outputs, self._zeros = len(outputs), slice(len(outputs), len(outputs) + len(zeros))
        self.size = self._schedule.size

    def run(self, inputs: Residues, field: PrimeField) -> tuple[Flags, Residues]:
        """Which samples follow, and the outputs, from inputs of shape (inputs, samples)."""
        arithmetic = _Noting(field, inputs.shape[1])
        leaves = {node: inputs[self._place[node]] for node in self._schedule.leaves}
        found = self._schedule.run(arithmetic, leaves, inputs.shape[1])
        return arithmetic.regular & ~found[self._zeros].any(axis=0), found[: self._outputs]


class _Noting(ModularArithmetic):
    """GF(p); notes the samples at which all that is inverted differs from zero."""

    def __init__(self, field: PrimeField, samples: int) -> None:
        super().__init__(field)
        self.regular = np.ones(samples, dtype=bool)

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """Elementwise operation modulo p."""
        if op == Op.DIV:
            zero = b == 0
            self.regular &= ~zero.any(axis=0)
            b[zero] = 1
        return super().binary(op, a, b)


class RecordedForms:
    """Normal forms of monomials, without entries that vanish.

    It repeats the steps of :class:`~echelon.exact.quotient_ring.NormalForms`.
    """

    def __init__(self, monomials: Monomials, recorder: Recorder) -> None:
        self._monomials, self._recorder = monomials, recorder
        self._rows: dict[int, Row] = {0: {0: recorder.one}}

    def grow(self, free: Iterable[int]) -> None:
        """Add free monomials."""
        self._rows.update({monomial: {monomial: self._recorder.one} for monomial in free})

    def define(self, product: Product) -> None:
        """Add products."""
        for factor in product.factors:
            self._rows[self._times(product.variable, factor)] = self._combined(self._product(product.variable, factor))

    def defects(self, product: Product) -> list[Row]:
        """Normal forms computed from the factors less those known."""
        variable = product.variable
        return [
            self._combined(
                [
                    *self._product(variable, factor),
                    (self._recorder.minus_one, self._rows[self._times(variable, factor)]),
                ]
            )
            for factor in product.factors
        ]

    def reduce(self, polynomial: Mapping[Exponents, int]) -> Row:
        """Normal form of a polynomial."""
        monomials = self._monomials.number
        return self._combined((c, self._rows[monomials[e]]) for e, c in polynomial.items() if c != self._recorder.zero)

    def eliminate(self, polynomials: list[Row], pivots: Sequence[int]) -> None:
        """Solve polynomials of the ideal for as many monomials, which cease to be free."""
        solved = self._solved(polynomials, pivots)
        for monomial, row in self._rows.items():
            self._rows[monomial] = self._substituted(row, solved)

    def multiplications(self, free: Sequence[int]) -> list[int]:
        """Entries of an array of shape (variables, free, free)."""
        rows = [self._rows[self._times(i, m)] for i in range(self._monomials.variables) for m in free]
        return [row.get(m, self._recorder.zero) for row in rows for m in free]

    def _times(self, variable: int, monomial: int) -> int:
        return int(self._monomials.times[variable, monomial])

    def _product(self, variable: int, factor: int) -> list[tuple[int, Row]]:
        return [(number, self._rows[self._times(variable, m)]) for m, number in self._rows[factor].items()]

    def _combined(self, parts: Iterable[tuple[int, Row]]) -> Row:
        """Sum of multiples of rows."""
        terms: dict[int, list[tuple[int, int]]] = {}
        for factor, row in parts:
            for monomial, number in row.items():
                terms.setdefault(monomial, []).append((factor, number))
        sums = {monomial: self._recorder.sum(products) for monomial, products in terms.items()}
        return {monomial: number for monomial, number in sums.items() if number != self._recorder.zero}

    def _substituted(self, row: Row, solved: dict[int, Row]) -> Row:
        """A row with some monomials replaced by what they are equal to."""
        if solved.keys().isdisjoint(row):
            return row
        rest = {m: number for m, number in row.items() if m not in solved}
        return self._combined(
            [(self._recorder.one, rest), *((number, solved[m]) for m, number in row.items() if m in solved)]
        )

    def _solved(self, polynomials: list[Row], pivots: Sequence[int]) -> dict[int, Row]:
        """What the pivots are equal to; short polynomials, and pivots that occur rarely, come first."""
        left, waiting, solved = list(polynomials), set(pivots), dict[int, Row]()
        inverted = {}
        while left:
            shortest = min(left, key=len)
            left.remove(shortest)
            pivot = min(waiting & shortest.keys(), key=lambda m: sum(m in row for row in left))
            waiting.remove(pivot)
            inverted[pivot] = self._recorder.minus_inverse(shortest[pivot])
            rest = {m: number for m, number in shortest.items() if m != pivot}
            solved[pivot] = self._combined([(inverted[pivot], rest)])
            left = [self._substituted(row, {pivot: solved[pivot]}) for row in left]
        for pivot in reversed(solved):
            solved[pivot] = self._substituted(solved[pivot], solved)
            if not solved[pivot]:
                self._recorder.require(inverted[pivot])
        return solved


_MONOMIALS = 1500  # default bound on the number of monomials
_DEGREES = 6  # of monomials above that of equations; those of loops with finitely many solutions need two at most
_FAILURES = 3  # samples in a row that have infinitely many solutions; then the others are taken to have them, too
_ENTRIES = 1 << 24  # recorded numbers, or powers of multiplications; more samples are treated in parts


class _UnsolvedSystemError(Exception):
    """The solutions are infinitely many, or need more monomials than allowed."""


@dataclass(frozen=True)
class Solutions:
    """Solutions of the samples of a system."""

    counts: Residues  # number of distinct solutions; −1 where they are infinitely many, as far as can be told
    points: list[Residues]  # the solutions of each sample


class Solver:
    """Solves systems with finitely many solutions, and remembers how for others that have the same monomials.

    >>> x, y = (1, 0), (0, 1)
    >>> line = {x: np.array([1, 1]), y: np.array([-1, -1])}
    >>> circle = {(2, 0): np.array([1, 1]), (0, 2): np.array([1, 1]), (0, 0): np.array([-2, -8])}
    >>> [sorted(points.tolist()) for points in Solver().solve([line, circle], PrimeField.of(47)).points]
    [[[1, 1], [46, 46]], [[2, 2], [45, 45]]]
    """

    def __init__(self, monomial_limit: int = _MONOMIALS) -> None:
        self._limit = monomial_limit
        self._rings: dict[tuple[tuple[Exponents, ...], ...], _Ring] = {}

    def solve(self, equations: Sequence[Mapping[Exponents, Residues]], field: PrimeField) -> Solutions:
        """Solve polynomials by the exponents of their terms, with coefficients of shape (samples,)."""
        system = [Equation.of(terms, field) for terms in equations if terms]
        if not system:
            return Solutions(np.zeros(0, dtype=np.int64), [])
        samples = len(system[0].coefficients)
        variables = len(next(e for terms in equations for e in terms))
        points = [np.zeros((0, variables), dtype=np.int64) for _ in range(samples)]
        solutions, left, most = Solutions(np.full(samples, -1), points), np.arange(samples), 0
        failures = 0
        key = tuple(tuple(equation.exponents) for equation in system)
        ring = self._rings.get(key)
        while left.size and failures < _FAILURES:
            if ring is None:
                try:
                    sample = [equation.at(left[:1]) for equation in system]
                    ring = _recorded(*_explore(sample, variables, field, self._limit), sample)
                except _UnsolvedSystemError:
                    failures += 1
                    left = left[1:]
                    continue
            rest = ring.solve(system, left, field, solutions)
            if len(left) - len(rest) > most:
                self._rings[key], most = ring, len(left) - len(rest)
            left, ring, failures = rest, None, 0
        return solutions


@dataclass(frozen=True)
class _Ring:
    """Multiplications by the variables in the quotient ring, recorded from the coefficients."""

    recording: Recording
    variables: int
    dimension: int

    def solve(self, system: list[Equation], samples: Integers, field: PrimeField, solutions: Solutions) -> Integers:
        """Solve those of some samples that follow; returns the others."""
        shape, others = (self.variables, self.dimension, self.dimension), []
        entries = max(self.recording.size, self.dimension**2 * (self.dimension + self.variables))
        for part in np.array_split(samples, len(samples) * entries // _ENTRIES + 1):
            selected = [equation.at(part) for equation in system]
            coefficients = np.concatenate([equation.coefficients.T for equation in selected])
            follows, outputs = self.recording.run(coefficients, field)
            matrices = outputs.reshape(*shape, len(part))
            follows &= commute(matrices, field)
            others.append(part[~follows])
            places = np.flatnonzero(follows)
            owners, found = quotient_points(matrices[..., places], field)
            owners = places[owners]
            wrong = [equation.at(owners).value(found, field) != 0 for equation in selected]
            valid = ~np.any(wrong, axis=0)
            owners, found = owners[valid], found[valid]
            solutions.counts[part[places]] = 0
            present, starts, counts = np.unique(owners, return_index=True, return_counts=True)
            solutions.counts[part[present]] = counts
            for sample, start, count in zip(part[present].tolist(), starts.tolist(), counts.tolist(), strict=True):
                solutions.points[sample] = found[start : start + count]
        return np.concatenate(others)


@dataclass(frozen=True)
class _Extension:
    """Step to ``count`` monomials, some of the new ones free and others defined as products."""

    count: int
    free: list[int]
    definitions: list[Product]


@dataclass(frozen=True)
class _Elimination:
    """Step that solves defects of products, and equations, for as many pivots."""

    products: list[Product]
    equations: list[int]
    pivots: list[int]


_Step = _Extension | _Elimination


def _recorded(steps: list[_Step], forms: NormalForms, sample: list[Equation]) -> _Ring:
    """The steps, done once more at the sample where they were found."""
    recorder = Recorder(forms.field, [c for equation in sample for c in equation.coefficients[0].tolist()])
    inputs = iter(recorder.inputs)
    polynomials = [dict(zip(equation.exponents, inputs, strict=False)) for equation in sample]
    recorded = RecordedForms(forms.monomials, recorder)
    for step in steps:
        if isinstance(step, _Extension):
            recorded.grow(step.free)
            for product in step.definitions:
                recorded.define(product)
        else:
            rows = [row for product in step.products for row in recorded.defects(product)]
            rows += [recorded.reduce(polynomials[k]) for k in step.equations]
            recorded.eliminate(rows, step.pivots)
    recording = recorder.recording(recorded.multiplications(forms.free.tolist()))
    return _Ring(recording, forms.monomials.variables, len(forms.free))


def _explore(
    system: list[Equation], variables: int, field: PrimeField, monomial_limit: int
) -> tuple[list[_Step], NormalForms]:
    """The steps for a single sample, and where they lead."""
    forms = NormalForms(Monomials(variables), field)
    steps: list[_Step] = []
    degree, highest = 0, max(equation.degree for equation in system)
    while True:
        steps += _complete(forms, system, degree)
        if not forms.free.size or (degree >= highest and _is_finite(forms)):
            return steps, forms
        if degree >= highest + _DEGREES:
            raise _UnsolvedSystemError
        degree += 1
        steps.append(_extend(forms, monomial_limit))


def _is_finite(forms: NormalForms) -> bool:
    """Whether the free monomials are a basis of the quotient ring."""
    if forms.free[-1] >= forms.monomials.start[-2]:
        return False
    return bool(commute(forms.multiplications()[..., None], forms.field).all())


def _extend(forms: NormalForms, monomial_limit: int) -> _Extension:
    """Step to the next degree: multiples of a monomial that is not free are products, of the one with fewest terms."""
    monomials = forms.monomials
    monomials.raise_degree()
    low, count = monomials.start[-2:]
    if count > monomial_limit:
        raise _UnsolvedSystemError
    size = np.count_nonzero(forms.table, axis=1)
    size[forms.free] = low
    best: dict[int, tuple[int, int]] = {}
    for factor in sorted(set(range(monomials.start[-3], low)) - set(forms.free.tolist()), key=lambda m: int(size[m])):
        for variable, multiple in enumerate(monomials.times[:, factor].tolist()):
            best.setdefault(multiple, (variable, factor))
    step = _Extension(count, [m for m in range(low, count) if m not in best], [])
    forms.grow(step.count, step.free)
    for multiple in sorted(best):
        variable, factor = best[multiple]
        step.definitions.append(Product(variable, [factor]))
        forms.define(step.definitions[-1])
    return step


def _complete(forms: NormalForms, system: list[Equation], degree: int) -> list[_Elimination]:
    """Eliminate all that follows from the equations without monomials above a degree."""
    monomials, steps = forms.monomials, []
    free = set(forms.free.tolist())
    fresh = [m for m in range(monomials.start[max(degree - 1, 0)], monomials.start[degree]) if m not in free]
    pending = [k for k, equation in enumerate(system) if equation.degree == degree]
    while fresh or pending:
        step, replacement = _choose(forms, system, fresh, pending)
        if not step.pivots:
            break
        steps.append(step)
        forms.eliminate(step.pivots, replacement)
        fresh, pending = [m for m in step.pivots if m < monomials.start[degree]], []
    return steps


def _choose(
    forms: NormalForms, system: list[Equation], fresh: list[int], pending: list[int]
) -> tuple[_Elimination, Residues]:
    """Step that eliminates independent ones among the equations and the products of fresh monomials.

    It comes with the combinations of the other free monomials that the pivots are equal to.
    """
    variables = range(forms.monomials.variables) if fresh else range(0)
    labels = [(i, m) for i in variables for m in fresh] + [(-1, k) for k in pending]
    rows = np.concatenate(
        [forms.defect(Product(i, fresh)) for i in variables] + [forms.reduce(system[k]) for k in pending]
    )
    terms = np.count_nonzero(rows, axis=1)
    order = np.argsort(terms, kind="stable")[np.count_nonzero(terms == 0) :]
    chosen = order[reduced_echelon(rows[order].T, forms.field)[1]]
    solved, leading = reduced_echelon(rows[chosen][:, ::-1], forms.field)
    rest = np.delete(np.arange(len(forms.free)), leading)
    table = np.array([int(x) for x in solved.entries()], dtype=np.int64).reshape(len(chosen), len(forms.free))
    factors = {i: sorted(labels[row][1] for row in chosen if labels[row][0] == i) for i in variables}
    products = [Product(i, monomials) for i, monomials in factors.items() if monomials]
    equations = [labels[row][1] for row in chosen if labels[row][0] < 0]
    pivots = forms.free[::-1][leading][::-1].tolist()
    return _Elimination(products, equations, pivots), -table[::-1, rest[::-1]] % forms.field.p
