"""All solutions in GF(p) of polynomial systems with finitely many solutions, for many samples at once.

The systems have the same monomials and, sample by sample, other coefficients, like the closure conditions of a
mechanism at random geometries.  The ideal is completed degree by degree: equations, and differences between two ways
to compute a normal form, are eliminated until the multiplications by the variables are known on the free monomials and
commute (Mourrain's criterion), which makes these a basis of the quotient ring.

What to eliminate is found out on one sample and then repeated on all; those to which it does not apply are treated by
themselves.  Nothing is left out that vanishes at that sample only, so no solution is lost.  Every point is checked.

Points are read from traces of multiplications (Rouillier's rational univariate representation), which works for
multiple points, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import flint
import numpy as np

from echelon.arrays import Flags, Integers
from echelon.errors import DegenerateSampleError, EchelonError
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField, Residues
from echelon.exact.normal_forms import Equation, Exponents, Monomials, NormalForms, Product, multiply

_MONOMIALS = 1500  # default bound on the number of monomials, up to the degree that is needed; below 2048
_TOGETHER = 256  # samples


class UnsolvedSystemError(EchelonError):
    """The solutions are infinitely many, or need monomials of a higher degree than allowed."""


@dataclass(frozen=True)
class Solutions:
    """Solutions of the samples of a system."""

    # (samples,): number of distinct solutions; −1 where a sample is unlike the first one and could not be solved
    counts: Residues
    points: list[Residues]  # (solutions, variables): the solutions of each sample


def solve(
    equations: Sequence[Mapping[Exponents, Residues]],
    variables: int,
    field: PrimeField,
    monomial_limit: int = _MONOMIALS,
) -> Solutions:
    """Solve systems with finitely many solutions, by the coefficients (samples,) of their monomials.

    Equations may be more than the variables, and redundant.  The prime is below 2^31.

    Examples
    --------
    >>> x, y = (1, 0), (0, 1)
    >>> line = {x: np.array([1, 1]), y: np.array([-1, -1])}
    >>> circle = {(2, 0): np.array([1, 1]), (0, 2): np.array([1, 1]), (0, 0): np.array([-2, -8])}
    >>> [sorted(points.tolist()) for points in solve([line, circle], 2, PrimeField.of(47)).points]
    [[[1, 1], [46, 46]], [[2, 2], [45, 45]]]
    """
    return Solver(variables, monomial_limit).solve(equations, field)


@dataclass(frozen=True)
class _Extension:
    """Step to ``count`` monomials, some of the new ones free and others defined as products, in this order."""

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


class Solver:
    """Solves systems like :func:`solve`, and remembers how for others that have the same monomials."""

    def __init__(self, variables: int, monomial_limit: int = _MONOMIALS) -> None:
        self._variables, self._limit, self._monomials = variables, monomial_limit, Monomials(variables)
        self._known: dict[tuple[tuple[Exponents, ...], ...], list[_Step]] = {}

    def solve(self, equations: Sequence[Mapping[Exponents, Residues]], field: PrimeField) -> Solutions:
        """Solve a system; for the arguments see :func:`solve`."""
        system = [Equation.of(terms, field) for terms in equations if terms]
        samples = system[0].coefficients.shape[0] if system else 0
        points = [np.zeros((0, self._variables), dtype=np.int64) for _ in range(samples)]
        solutions = Solutions(np.full(samples, -1), points)
        key = tuple(tuple(equation.exponents) for equation in system)
        steps, left = self._known.get(key), np.arange(samples)
        while left.size:
            if steps is None:
                try:
                    steps = self._explored([equation.at(left[:1]) for equation in system], field)
                except UnsolvedSystemError:
                    if left[0] == 0:
                        raise
                    left = left[1:]
                    continue
            parts = np.array_split(left, -(-left.size // _TOGETHER))
            rest = np.concatenate([self._repeat(steps, system, part, field, solutions) for part in parts])
            if rest.size <= left.size // 2:  # steps of a special sample are not kept
                self._known[key] = steps
            left, steps = rest, None
        return solutions

    def _repeat(
        self, steps: list[_Step], system: list[Equation], samples: Integers, field: PrimeField, solutions: Solutions
    ) -> Integers:
        """Solve those of some samples to which the steps apply; returns the others."""
        forms = NormalForms(self._monomials, len(samples), field)
        selected = [equation.at(samples) for equation in system]
        try:
            for step in steps:
                _do(step, forms, selected)
        except DegenerateSampleError:
            halves = np.array_split(samples, 2) if samples.size > 1 else []
            return np.concatenate([self._repeat(steps, system, half, field, solutions) for half in halves] or [samples])
        matrices = forms.multiplications()
        follows = _commute(matrices, field)
        places = np.flatnonzero(follows)
        owners, found = _points(matrices[places], field)
        owners = samples[places[owners]]
        valid = ~np.any([equation.at(owners).value(found, field) != 0 for equation in system], axis=0)
        owners, found = owners[valid], found[valid]
        solutions.counts[samples[places]] = 0
        present, starts, counts = np.unique(owners, return_index=True, return_counts=True)
        solutions.counts[present] = counts
        for sample, start, count in zip(present.tolist(), starts.tolist(), counts.tolist(), strict=True):
            solutions.points[sample] = found[start : start + count]
        return samples[~follows]

    def _explored(self, sample: list[Equation], field: PrimeField) -> list[_Step]:
        """Steps to the degree at which the free monomials are a basis of the quotient ring, for one sample."""
        forms = NormalForms(self._monomials, 1, field)
        steps: list[_Step] = []
        degree, highest = 0, max(equation.degree for equation in sample)
        while True:
            steps += _complete(forms, sample, degree)
            if not forms.free.size or (degree >= highest and _is_finite(forms, degree)):
                return steps
            degree += 1
            steps.append(_extension(forms, degree, self._limit))
            _do(steps[-1], forms, sample)


def _do(step: _Step, forms: NormalForms, system: list[Equation]) -> None:
    if isinstance(step, _Extension):
        forms.grow(step.count, step.free)
        for product in step.definitions:
            forms.define(product)
    else:
        rows = [forms.defects(product) for product in step.products]
        rows += [forms.reduced(system[k]) for k in step.equations]
        forms.eliminate(np.concatenate(rows, axis=1), step.pivots)


def _is_finite(forms: NormalForms, degree: int) -> bool:
    """Whether the free monomials are a basis of the quotient ring."""
    if forms.free[-1] >= forms.monomials.start[degree]:
        return False
    return bool(_commute(forms.multiplications(), forms.field).all())


def _extension(forms: NormalForms, degree: int, limit: int) -> _Extension:
    """Step to a degree: multiples of monomials that are not free are products of the one with fewest terms."""
    monomials, free = forms.monomials, set(forms.free.tolist())
    monomials.up_to(degree)
    below, low, count = monomials.start[degree - 1 : degree + 2]
    if count > limit:
        raise UnsolvedSystemError(
            f"a system of polynomials has infinitely many solutions, or needs more than {limit} monomials"
        )
    size = np.count_nonzero(forms.table[0], axis=1)
    best: dict[int, tuple[int, int]] = {}
    for factor in sorted(set(range(below, low)) - free, key=lambda m: int(size[m])):
        for variable, multiple in enumerate(monomials.times[:, factor].tolist()):
            best.setdefault(multiple, (variable, factor))
    # a product needs those of its variable and the free monomials in the factor's normal form
    level, together = dict[int, int](), dict[tuple[int, int], list[int]]()
    for multiple, (variable, factor) in sorted(best.items()):
        needed = monomials.times[variable, forms.free[forms.table[0, factor] != 0]].tolist()
        level[multiple] = 1 + max((level.get(m, 0) for m in needed), default=0)
        together.setdefault((level[multiple], variable), []).append(factor)
    definitions = [Product(variable, factors) for (_, variable), factors in sorted(together.items())]
    return _Extension(count, [m for m in range(low, count) if m not in best], definitions)


def _complete(forms: NormalForms, system: list[Equation], degree: int) -> list[_Elimination]:
    """Eliminate all that follows from the equations without monomials above a degree."""
    start, steps = forms.monomials.start, []
    fresh = sorted(set(range(start[max(degree - 1, 0)], start[degree])) - set(forms.free.tolist()))
    pending = [k for k, equation in enumerate(system) if equation.degree == degree]
    while fresh or pending:
        step = _chosen(forms, system, fresh, pending)
        if not step.pivots:
            break
        steps.append(step)
        _do(step, forms, system)
        fresh, pending = [m for m in step.pivots if m < start[degree]], []
    return steps


def _chosen(forms: NormalForms, system: list[Equation], fresh: list[int], pending: list[int]) -> _Elimination:
    """Step that eliminates independent ones among the equations and the defects of products of fresh monomials."""
    variables = range(forms.monomials.variables) if fresh else range(0)
    labels = [(i, m) for i in variables for m in fresh] + [(-1, k) for k in pending]
    rows = [forms.defects(Product(i, fresh)) for i in variables] + [forms.reduced(system[k]) for k in pending]
    first = np.concatenate(rows, axis=1)[0]
    terms = np.count_nonzero(first, axis=1)
    order = np.argsort(terms, kind="stable")[np.count_nonzero(terms == 0) :]
    chosen = order[reduced_echelon(first[order].T, forms.field)[1]]
    _, leading = reduced_echelon(first[chosen][:, ::-1], forms.field)
    factors = {i: sorted(labels[row][1] for row in chosen if labels[row][0] == i) for i in variables}
    products = [Product(i, monomials) for i, monomials in factors.items() if monomials]
    equations = [labels[row][1] for row in chosen if labels[row][0] < 0]
    return _Elimination(products, equations, forms.free[::-1][leading][::-1].tolist())


def _commute(matrices: Residues, field: PrimeField) -> Flags:
    """At which samples matrices commute pairwise, (samples, variables, size, size).

    It is enough, but for a chance of a few in p, that two random combinations of them do on a random vector.
    """
    rng = np.random.default_rng(1)
    first, second = (_combination(matrices, field, rng) for _ in range(2))
    vector = field.draw(rng, (first.shape[1], 1))
    one = multiply(first, multiply(second, vector, field), field)
    return np.asarray((one == multiply(second, multiply(first, vector, field), field)).all(axis=(1, 2)))


def _combination(matrices: Residues, field: PrimeField, rng: np.random.Generator) -> Residues:
    """Random linear combination of the matrices of every sample."""
    weights = field.draw(rng, (matrices.shape[1], 1, 1))
    return np.asarray((weights * matrices % field.p).sum(axis=1) % field.p)


def _points(matrices: Residues, field: PrimeField) -> tuple[Integers, Residues]:
    """The sample of each point with coordinates in GF(p), ascending, and these, (points, variables).

    Let m be the characteristic polynomial of a combination M of the multiplications that tells the points apart, and q
    what is left of m without one of its roots.  Then q(M) acts on the subspace of that root only, and if the point has
    the coordinate x there, then the multiplication X has the trace tr(X q(M)) = x tr(q(M)).
    """
    _, variables, size, _ = matrices.shape
    combination = _combination(matrices, field, np.random.default_rng(0))
    powers = [np.broadcast_to(np.eye(size, dtype=np.int64), combination.shape)]
    for _ in range(size):
        powers.append(multiply(powers[-1], combination, field))
    traces = np.stack([np.trace(power, axis1=1, axis2=2) % field.p for power in powers])
    owners, cofactors = _cofactors(_characteristic(traces, field), field)
    points, below = np.zeros((len(owners), variables), dtype=np.int64), np.zeros(len(owners), dtype=np.int64)
    for power, trace, coefficient in zip(powers, traces, cofactors, strict=False):
        moments = (matrices * power.swapaxes(1, 2)[:, None] % field.p).sum(axis=(2, 3)) % field.p
        points = (points + coefficient[:, None] * moments[owners]) % field.p
        below = (below + coefficient * trace[owners]) % field.p
    return owners, points * field.invert_array(below)[:, None] % field.p


def _characteristic(traces: Residues, field: PrimeField) -> Residues:
    """Coefficients, the constant one first, of characteristic polynomials from traces of powers (Newton)."""
    size = len(traces) - 1
    result = np.zeros_like(traces)
    result[size] = 1
    for k in range(1, size + 1):
        total = (result[size - k + 1 :] * traces[1 : k + 1] % field.p).sum(axis=0) % field.p
        result[size - k] = total * (-field.invert(k) % field.p) % field.p
    return result


def _cofactors(polynomials: Residues, field: PrimeField) -> tuple[Integers, Residues]:
    """For every root in GF(p), its polynomial and the coefficients of that without all powers of the root."""
    size, owners, found = len(polynomials) - 1, list[int](), list[list[int]]()
    for sample, coefficients in enumerate(polynomials.T.tolist()):
        polynomial = flint.nmod_poly(coefficients, field.p)
        for root, multiplicity in polynomial.roots():
            rest = polynomial // flint.nmod_poly([-int(root), 1], field.p) ** multiplicity
            owners.append(sample)
            found.append([int(rest[k]) for k in range(size)])
    return np.array(owners, dtype=np.intp), np.array(found, dtype=np.int64).reshape(len(owners), size).T
