"""All solutions in GF(p) of polynomial systems with finitely many solutions, for many samples at once.

The systems have the same monomials and, sample by sample, other coefficients, like the closure conditions of a
mechanism at random geometries.  The ideal is completed degree by degree: equations, and differences between two ways
to compute a normal form, are eliminated until the multiplications by the variables are known on the free monomials and
commute (Mourrain's criterion), which makes these a basis of the quotient ring.

What to eliminate is found out on one sample and then repeated on all; the few that do not follow are treated by
themselves.  Every point is checked against all equations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.errors import EchelonError
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField, Residues
from echelon.exact.normal_forms import Equation, Exponents, Mask, Monomials, NormalForms, Product
from echelon.exact.quotient_points import commute, quotient_points

_MONOMIALS = 1500  # default bound on the number of monomials
_ENTRIES = 1 << 24  # in a table of normal forms; more samples are treated in parts


class UnsolvedSystemError(EchelonError):
    """The solutions are infinitely many, or need monomials of a higher degree than allowed."""


@dataclass(frozen=True)
class Solutions:
    """Solutions of the samples of a system.

    Attributes
    ----------
    counts : array of shape (samples,)
        Number of distinct solutions; −1 where a sample is unlike the first one and could not be solved.
    points : list of arrays of shape (solutions, variables)
        The solutions of each sample.
    """

    counts: Residues
    points: list[Residues]


def solve(
    equations: Sequence[Mapping[Exponents, Residues]],
    variables: int,
    field: PrimeField,
    monomial_limit: int = _MONOMIALS,
) -> Solutions:
    """Solve a system with finitely many solutions.

    Parameters
    ----------
    equations : sequence of mappings from exponents to arrays of shape (samples,)
        Polynomials by the coefficients of their monomials.  They may be more than the variables, and redundant.
    variables : int
    field : PrimeField
        With a prime below 2^31.
    monomial_limit : int
        Bound on the number of monomials, up to the degree that is needed; not above 2048, where sums stay exact.

    Raises
    ------
    UnsolvedSystemError
        If no degree within the limit shows the first sample to have finitely many solutions.

    Examples
    --------
    >>> x, y = (1, 0), (0, 1)
    >>> line = {x: np.array([1, 1]), y: np.array([-1, -1])}
    >>> circle = {(2, 0): np.array([1, 1]), (0, 2): np.array([1, 1]), (0, 0): np.array([-2, -8])}
    >>> [sorted(points.tolist()) for points in solve([line, circle], 2, PrimeField.of(47)).points]
    [[[1, 1], [46, 46]], [[2, 2], [45, 45]]]
    """
    system = [Equation.of(terms, field) for terms in equations if terms]
    samples = system[0].coefficients.shape[0] if system else 0
    counts = np.full(samples, -1)
    points = [np.zeros((0, variables), dtype=np.int64) for _ in range(samples)]
    left = np.arange(samples)
    while left.size:
        try:
            structure, forms = _explore(
                [equation.at(left[:1]) for equation in system], variables, field, monomial_limit
            )
        except UnsolvedSystemError:
            if left[0] == 0:
                raise
            left = left[1:]
            continue
        irregular = []
        for part in np.array_split(left, len(left) * structure.entries // _ENTRIES + 1):
            selected = [equation.at(part) for equation in system]
            if len(left) > 1:
                forms = _follow(structure, selected, field)
            regular, found = _solutions(forms, selected)
            counts[part[regular]] = [len(solutions) for solutions in found]
            for sample, solutions in zip(part[regular].tolist(), found, strict=True):
                points[sample] = solutions
            irregular.append(part[~regular])
        left = np.concatenate(irregular)
    return Solutions(counts, points)


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


@dataclass(frozen=True)
class _Structure:
    """The steps that lead to the quotient ring, and the largest table of normal forms on the way."""

    monomials: Monomials
    steps: list[_Step]
    entries: int


def _explore(
    system: list[Equation], variables: int, field: PrimeField, monomial_limit: int
) -> tuple[_Structure, NormalForms]:
    """The steps for a single sample, and where they lead."""
    forms = NormalForms(Monomials(variables), field, 1)
    steps: list[_Step] = []
    degree, highest, entries = 0, max(equation.degree for equation in system), 1
    while True:
        steps += _complete(forms, system, degree)
        if not forms.free.size or (degree >= highest and _is_finite(forms)):
            return _Structure(forms.monomials, _needed_steps(steps, forms, system), entries), forms
        degree += 1
        steps.append(_extend(forms, monomial_limit))
        entries = max(entries, forms.table.size)


def _is_finite(forms: NormalForms) -> bool:
    """Whether the free monomials are a basis of the quotient ring."""
    if forms.free[-1] >= forms.monomials.start[-2]:
        return False
    return bool(commute(forms.multiplications(), forms.field).all())


def _extend(forms: NormalForms, monomial_limit: int) -> _Extension:
    """Step to the next degree: multiples of a monomial that is not free are products, of the one with fewest terms."""
    monomials = forms.monomials
    monomials.raise_degree()
    low, count = monomials.start[-2:]
    if count > monomial_limit:
        raise UnsolvedSystemError(
            f"a system of polynomials has infinitely many solutions, or needs more than {monomial_limit} monomials"
        )
    size = np.count_nonzero(forms.table[0], axis=1)
    size[forms.free] = low
    best: dict[int, tuple[int, int]] = {}
    for factor in sorted(set(range(monomials.start[-3], low)) - set(forms.free.tolist()), key=lambda m: int(size[m])):
        for variable, multiple in enumerate(monomials.times[:, factor].tolist()):
            best.setdefault(multiple, (variable, factor))
    step = _Extension(count, [m for m in range(low, count) if m not in best], [])
    forms.grow(step.count, step.free)
    for multiple in sorted(best):
        variable, factor = best[multiple]
        step.definitions.append(Product(variable, [factor], forms.support([factor])))
        forms.define(step.definitions[-1])
    return step


def _complete(forms: NormalForms, system: list[Equation], degree: int) -> list[_Elimination]:
    """Eliminate all that follows from the equations without monomials above a degree."""
    monomials, steps = forms.monomials, []
    free = set(forms.free.tolist())
    fresh = [m for m in range(monomials.start[max(degree - 1, 0)], monomials.start[degree]) if m not in free]
    pending = [k for k, equation in enumerate(system) if equation.degree == degree]
    while fresh or pending:
        step = _choose(forms, system, fresh, pending)
        if not step.pivots:
            break
        steps.append(step)
        forms.eliminate(_rows(forms, system, step), step.pivots)
        fresh, pending = [m for m in step.pivots if m < monomials.start[degree]], []
    return steps


def _choose(forms: NormalForms, system: list[Equation], fresh: list[int], pending: list[int]) -> _Elimination:
    """Step that eliminates independent ones among the equations and the products of fresh monomials."""
    variables = range(forms.monomials.variables) if fresh else range(0)
    every = _Elimination([Product(i, fresh, forms.support(fresh)) for i in variables], pending, [])
    labels = [(i, m) for i in variables for m in fresh] + [(-1, k) for k in pending]
    rows = _rows(forms, system, every)[0]
    terms = np.count_nonzero(rows, axis=1)
    order = np.argsort(terms, kind="stable")[np.count_nonzero(terms == 0) :]
    chosen = order[reduced_echelon(rows[order].T, forms.field)[1]]
    pivots = reduced_echelon(rows[chosen][:, ::-1], forms.field)[1]
    factors = {i: sorted(labels[row][1] for row in chosen if labels[row][0] == i) for i in variables}
    products = [Product(i, monomials, forms.support(monomials)) for i, monomials in factors.items() if monomials]
    equations = [labels[row][1] for row in chosen if labels[row][0] < 0]
    return _Elimination(products, equations, sorted(int(forms.free[::-1][column]) for column in pivots))


def _rows(forms: NormalForms, system: list[Equation], step: _Elimination) -> Residues:
    """Elements of the ideal in terms of free monomials, of shape (samples, rows, free)."""
    rows = [forms.defect(product) for product in step.products]
    rows += [forms.reduce(system[k]) for k in step.equations]
    return np.concatenate(rows, axis=1)


def _needed_steps(steps: list[_Step], forms: NormalForms, system: list[Equation]) -> list[_Step]:
    """The steps without the definitions that nothing depends on."""
    times, number = forms.monomials.times, forms.monomials.number
    needed = set(times[:, forms.free].ravel().tolist())
    kept: list[_Step] = []
    for step in reversed(steps):
        if isinstance(step, _Elimination):
            for product in step.products:
                needed.update(product.uses(times), times[product.variable, product.factors].tolist())
            needed.update(number[e] for k in step.equations for e in system[k].exponents)
            kept.append(step)
            continue
        definitions = []
        for product in reversed(step.definitions):
            if int(times[product.variable, product.factors[0]]) in needed:
                needed.update(product.uses(times))
                definitions.append(product)
        kept.append(_Extension(step.count, step.free, definitions[::-1]))
    return kept[::-1]


def _follow(structure: _Structure, system: list[Equation], field: PrimeField) -> NormalForms:
    """The normal forms of all samples by the same steps."""
    forms = NormalForms(structure.monomials, field, system[0].coefficients.shape[0])
    for step in structure.steps:
        if isinstance(step, _Elimination):
            forms.eliminate(_rows(forms, system, step), step.pivots)
            continue
        forms.grow(step.count, step.free)
        for product in step.definitions:
            forms.define(product)
    return forms


def _solutions(forms: NormalForms, system: list[Equation]) -> tuple[Mask, list[Residues]]:
    """Which samples follow the structure, and the solutions of those."""
    matrices = forms.multiplications()
    regular = forms.regular & commute(matrices, forms.field)
    owners, found = quotient_points(matrices[:, regular], forms.field)
    samples = np.flatnonzero(regular)
    wrong = [equation.at(samples[owners]).value(found, forms.field) != 0 for equation in system]
    valid = ~np.any(wrong, axis=0)
    return regular, [found[valid & (owners == k)] for k in range(len(samples))]
