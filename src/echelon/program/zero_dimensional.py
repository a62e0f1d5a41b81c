"""All solutions in GF(p) of polynomial systems with finitely many solutions, for many samples at once.

The systems have the same monomials and, sample by sample, other coefficients, like the closure conditions of a
mechanism at random geometries.  The ideal is completed degree by degree: equations, and differences between two ways
to compute a normal form, are eliminated until the multiplications by the variables are known on the free monomials and
commute (Mourrain's criterion), which makes these a basis of the quotient ring.

What to eliminate is found out on one sample and recorded as a program, which is then run on all; the few that do not
follow are treated by themselves.  Every point is checked against all equations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from echelon.arrays import Flags, Integers
from echelon.exact.field import PrimeField, Residues, reduced_echelon
from echelon.exact.quotient_ring import Equation, Exponents, Monomials, commute, quotient_points
from echelon.program.operations import Op
from echelon.program.schedule import Array, ModularArithmetic, Schedule
from echelon.program.tape import Program

Row = dict[int, int]  # monomials and the numbers by which they are multiplied

Product = tuple[int, int]  # a variable and a known monomial


class Residue:
    """Computes with the residues of one sample; numbers are these.  It counts the numbers that it adds."""

    zero, one = 0, 1

    def __init__(self, field: PrimeField) -> None:
        self._field, self.minus_one, self.added = field, field.p - 1, 0

    def combined(self, parts: Iterable[tuple[int, Row]], begin: Row | None = None) -> Row:
        """Sum of a row and multiples of rows."""
        total, p = dict(begin or {}), self._field.p
        known = total.get
        for factor, row in parts:
            self.added += len(row)
            for monomial, number in row.items():
                total[monomial] = known(monomial, 0) + factor * number
        return {monomial: rest for monomial, number in total.items() if (rest := number % p)}

    def minus_inverse(self, number: int) -> int:
        """−1/x."""
        return self._field.p - self._field.invert(number)

    def require(self, number: int) -> None:
        """All is computed at this sample."""


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

    def combined(self, parts: Iterable[tuple[int, Row]], begin: Row | None = None) -> Row:
        """Sum of a row and multiples of rows."""
        terms = {monomial: [(self.one, number)] for monomial, number in (begin or {}).items()}
        for factor, row in parts:
            for monomial, number in row.items():
                terms.setdefault(monomial, []).append((factor, number))
        sums = {monomial: self._sum(products) for monomial, products in terms.items()}
        return {monomial: number for monomial, number in sums.items() if number != self.zero}

    def _sum(self, terms: Iterable[tuple[int, int]]) -> int:
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


class NormalForms:
    """Normal forms of all monomials up to a degree modulo the ideal of some polynomials, without zeros.

    Modulo the polynomials known so far every monomial is a combination of a few *free* ones.  The table of these
    combinations grows by degree (a multiple of a monomial that is not free follows from lower degrees) and shrinks the
    set of free monomials by elimination (a polynomial of the ideal expresses its leading monomial by smaller ones).
    """

    def __init__(
        self, monomials: Monomials, numbers: Residue | Recorder, polynomials: Sequence[Mapping[Exponents, int]]
    ) -> None:
        self.monomials, self._numbers, self._polynomials = monomials, numbers, polynomials
        self._rows: dict[int, Row] = {0: {0: numbers.one}}
        self.free = [0]

    def size(self, monomial: int) -> int:
        """Number of terms of a monomial's normal form."""
        return len(self._rows[monomial])

    def grow(self, free: Sequence[int], products: Iterable[Product]) -> None:
        """Add monomials of a higher degree: free ones, and products of known ones."""
        self.free = [*self.free, *free]
        self._rows.update({monomial: {monomial: self._numbers.one} for monomial in free})
        for product in products:
            self._rows[self._times(*product)] = self._numbers.combined(self._product(product))

    def defect(self, product: Product) -> Row:
        """An element of the ideal: the normal form computed from the factor less the known one."""
        known = self._rows[self._times(*product)]
        return self._numbers.combined([*self._product(product), (self._numbers.minus_one, known)])

    def reduce(self, polynomial: int) -> Row:
        """Normal form of one of the polynomials."""
        number, terms = self.monomials.number, self._polynomials[polynomial].items()
        return self._numbers.combined((c, self._rows[number[e]]) for e, c in terms if c != self._numbers.zero)

    def eliminate(self, products: Sequence[Product], polynomials: Sequence[int], pivots: Sequence[int]) -> None:
        """Solve defects of products, and polynomials, for as many monomials, which cease to be free."""
        rows = [*(self.defect(product) for product in products), *(self.reduce(k) for k in polynomials)]
        solved = self._solved(rows, pivots)
        for monomial, row in self._rows.items():
            self._rows[monomial] = self._substituted(row, solved)
        self.free = [monomial for monomial in self.free if monomial not in solved]

    def multiplications(self) -> list[int]:
        """Entries of the multiplications by the variables, an array of shape (variables, free, free)."""
        rows = [self._rows[self._times(i, m)] for i in range(self.monomials.variables) for m in self.free]
        return [row.get(m, self._numbers.zero) for row in rows for m in self.free]

    def _times(self, variable: int, monomial: int) -> int:
        return int(self.monomials.times[variable, monomial])

    def _product(self, product: Product) -> list[tuple[int, Row]]:
        variable, factor = product
        return [(number, self._rows[self._times(variable, m)]) for m, number in self._rows[factor].items()]

    def _substituted(self, row: Row, solved: dict[int, Row]) -> Row:
        """A row with some monomials replaced by what they are equal to."""
        if solved.keys().isdisjoint(row):
            return row
        rest = {m: number for m, number in row.items() if m not in solved}
        return self._numbers.combined(((number, solved[m]) for m, number in row.items() if m in solved), rest)

    def _solved(self, polynomials: list[Row], pivots: Sequence[int]) -> dict[int, Row]:
        """What the pivots are equal to; short polynomials, and pivots that occur rarely, come first."""
        left, waiting, solved = list(polynomials), set(pivots), dict[int, Row]()
        inverted = {}
        while left:
            shortest = min(left, key=len)
            left.remove(shortest)
            pivot = min(waiting & shortest.keys(), key=lambda m: sum(m in row for row in left))
            waiting.remove(pivot)
            inverted[pivot] = self._numbers.minus_inverse(shortest[pivot])
            rest = {m: number for m, number in shortest.items() if m != pivot}
            solved[pivot] = self._numbers.combined([(inverted[pivot], rest)])
            left = [self._substituted(row, {pivot: solved[pivot]}) for row in left]
        for pivot in reversed(solved):
            solved[pivot] = self._substituted(solved[pivot], solved)
            if not solved[pivot]:
                self._numbers.require(inverted[pivot])
        return solved


_MONOMIALS = 1500  # default bound on the number of monomials
_DEGREES = 6  # of monomials above that of equations; those of loops with finitely many solutions need two at most
_FAILURES = 2  # samples in a row that have infinitely many solutions; then the others are taken to have them, too
AT_ONCE = 20  # numbers of many samples are added together about as quickly as one of a single sample
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

    def solve(
        self,
        equations: Sequence[Mapping[Exponents, Residues]],
        field: PrimeField,
        spend: Callable[[float], None] = lambda _: None,
    ) -> Solutions:
        """Solve polynomials by the exponents of their terms, with coefficients of shape (samples,).

        ``spend`` is told of the work that is done, in numbers that are added, and may raise an exception to end it.
        """
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
                sample, numbers = [equation.at(left[:1]) for equation in system], Residue(field)
                try:
                    ring = _recorded(*_explore(sample, variables, numbers, field, self._limit), sample, field)
                except _UnsolvedSystemError:
                    failures += 1
                    left = left[1:]
                    continue
                finally:
                    spend(numbers.added)
            spend(len(left) * ring.recording.size / AT_ONCE)
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


_Step = Callable[[NormalForms], None]


def _recorded(steps: list[_Step], monomials: Monomials, sample: list[Equation], field: PrimeField) -> _Ring:
    """The steps, done once more at the sample where they were found."""
    recorder = Recorder(field, [c for equation in sample for c in equation.coefficients[0].tolist()])
    inputs = iter(recorder.inputs)
    forms = NormalForms(monomials, recorder, [dict(zip(e.exponents, inputs, strict=False)) for e in sample])
    for step in steps:
        step(forms)
    return _Ring(recorder.recording(forms.multiplications()), monomials.variables, len(forms.free))


def _explore(
    system: list[Equation], variables: int, numbers: Residue, field: PrimeField, monomial_limit: int
) -> tuple[list[_Step], Monomials]:
    """The steps for a single sample, and the monomials that they need."""
    monomials = Monomials(variables)
    polynomials = [dict(zip(e.exponents, e.coefficients[0].tolist(), strict=True)) for e in system]
    forms, steps = NormalForms(monomials, numbers, polynomials), list[_Step]()
    degree, highest = 0, max(equation.degree for equation in system)
    while True:
        steps += _complete(forms, system, degree, field)
        if not forms.free or (degree >= highest and _is_finite(forms, field)):
            return steps, monomials
        if degree >= highest + _DEGREES:
            raise _UnsolvedSystemError
        degree += 1
        monomials.raise_degree()
        if monomials.start[-1] > monomial_limit:
            raise _UnsolvedSystemError
        steps.append(_extension(forms))
        steps[-1](forms)


def _is_finite(forms: NormalForms, field: PrimeField) -> bool:
    """Whether the free monomials are a basis of the quotient ring."""
    if forms.free[-1] >= forms.monomials.start[-2]:
        return False
    size = len(forms.free)
    matrices = np.array(forms.multiplications(), dtype=np.int64).reshape(-1, size, size, 1)
    return bool(commute(matrices, field).all())


def _extension(forms: NormalForms) -> _Step:
    """Step to the next degree: multiples of a monomial that is not free are products, of the one with fewest terms."""
    monomials = forms.monomials
    before, low, count = monomials.start[-3:]
    best: dict[int, Product] = {}
    for factor in sorted(set(range(before, low)) - set(forms.free), key=forms.size):
        for variable, multiple in enumerate(monomials.times[:, factor].tolist()):
            best.setdefault(multiple, (variable, factor))
    free = [m for m in range(low, count) if m not in best]
    return partial(NormalForms.grow, free=free, products=[best[multiple] for multiple in sorted(best)])


def _complete(forms: NormalForms, system: list[Equation], degree: int, field: PrimeField) -> list[_Step]:
    """Eliminate all that follows from the equations without monomials above a degree."""
    start, steps = forms.monomials.start, list[_Step]()
    fresh = [m for m in range(start[max(degree - 1, 0)], start[degree]) if m not in set(forms.free)]
    pending = [k for k, equation in enumerate(system) if equation.degree == degree]
    while fresh or pending:
        products, polynomials, pivots = _chosen(forms, fresh, pending, field)
        if not pivots:
            break
        steps.append(partial(NormalForms.eliminate, products=products, polynomials=polynomials, pivots=pivots))
        steps[-1](forms)
        fresh, pending = [m for m in pivots if m < start[degree]], []
    return steps


def _chosen(
    forms: NormalForms, fresh: list[int], pending: list[int], field: PrimeField
) -> tuple[list[Product], list[int], list[int]]:
    """Independent ones among the products of fresh monomials and the equations, and monomials to solve them for."""
    products = [(variable, m) for variable in range(forms.monomials.variables) for m in fresh]
    rows = [*(forms.defect(product) for product in products), *(forms.reduce(k) for k in pending)]
    order = sorted((k for k, row in enumerate(rows) if row), key=lambda k: len(rows[k]))
    table, place = np.zeros((len(order), len(forms.free)), dtype=np.int64), {m: k for k, m in enumerate(forms.free)}
    for number, k in enumerate(order):
        table[number, [place[m] for m in rows[k]]] = list(rows[k].values())
    independent = list(reduced_echelon(table.T, field)[1])
    leading = reduced_echelon(table[independent, ::-1], field)[1]
    chosen = sorted(order[k] for k in independent)
    return (
        [products[k] for k in chosen if k < len(products)],
        [pending[k - len(products)] for k in chosen if k >= len(products)],
        [forms.free[-1 - k] for k in leading][::-1],
    )
