"""Functions of geometry symbols that are only known by their values modulo primes, found symbol by symbol.

An ansatz says which monomials a function may have; linear algebra fits their coefficients to samples.  Work is counted
in operations, so that no result depends on the clock.

On a line along one symbol every function is a quotient of univariate polynomials, found from its values by the extended
Euclidean algorithm (von zur Gathen and Gerhard, *Modern Computer Algebra*, 5.8).  Along an angle these are polynomials
in the tangent t of its half; they become polynomials in cosine and sine by a power of 1 + t², the least that is enough.

If two lines with other values of the other symbols show the same denominator, it is a factor in this symbol alone, as
the denominators of robots mostly are.  Symbols that are entangled with one another are fitted together, with all others
held: the degrees are known from the lines.

Times its denominator a function is a polynomial.  Its monomials in the symbols seen so far are known; at some values of
the next symbol, as many as its degree needs, their coefficients follow from as many random points as there are
monomials, and each coefficient is then interpolated along that symbol (Zippel, "Probabilistic algorithms for sparse
polynomials", 1979).  So the cost follows the number of terms and not the degrees of all symbols together.  Lengths come
last; the power of the very last one follows from the dimension.  All functions share their points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from itertools import product
from math import prod
from typing import Any, TypeVar

import flint
import numpy as np

from echelon.errors import ClosedFormError, DegenerateSampleError
from echelon.exact.field import PrimeField, Residues, as_flint, null_vectors
from echelon.exact.polynomial import Monomial, cosine, sine
from echelon.exact.rational import residues_of_generators

_OPERATIONS = 5e8  # a few seconds
_TERMS = 500
SOLVING = 0.05
"""What an operation of FLINT's linear algebra costs beside one of an evaluation in NumPy."""


@dataclass
class Work:
    """What is left of a budget."""

    operations: float  # operations on residues that are left
    terms: float  # the most terms that one coefficient may have

    @staticmethod
    def of(budget: float) -> Work:
        """The work of a budget: 1 for a few seconds, 0 for none."""
        return Work(budget * _OPERATIONS, budget * _TERMS)

    def take(self, operations: float) -> bool:
        """Take some operations if as many are left."""
        if operations > self.operations:
            return False
        self.operations -= operations
        return True

    def spend(self, operations: float) -> None:
        """Take some operations."""
        if not self.take(operations):
            raise ClosedFormError("the budget for closed forms is used up")

    def share(self, part: float) -> Work:
        """A part of it, taken out; what is not used is given back by :meth:`give_back`."""
        taken = self.operations * part
        self.operations -= taken
        return Work(taken, self.terms)

    def give_back(self, rest: Work) -> None:
        """Take back what is left of a share."""
        self.operations += rest.operations


_ATTEMPTS = 8
_CHUNK = 512
"""Geometries that are evaluated at once."""

T = TypeVar("T")


@dataclass(frozen=True)
class UnknownFunctions:
    """Functions of geometry symbols that can be evaluated modulo primes."""

    # geometry maps every symbol to an array of values (for an angle: of the tangent of its half); without symbols there
    # is one geometry
    evaluate: Callable[[PrimeField, Geometry], Residues]
    symbols: Sequence[str]  # all symbols that may matter
    angles: frozenset[str]  # those of them that are angles
    lengths: frozenset[str]  # symbols with the dimension of a length
    degrees: Sequence[int]  # homogeneous degree of each function in the symbols that are lengths
    irrational: tuple[bool, bool]  # whether √2 and √3 can occur in coefficients
    cost: float = 1.0  # operations of one evaluation

    def values(self, field: PrimeField, geometry: Geometry, count: int) -> Residues:
        """Values at some geometries: array of shape (functions, count)."""
        if not self.symbols:  # there is one geometry only
            return np.repeat(self.evaluate(field, geometry), count, axis=1)
        parts = [
            self.evaluate(field, {s: value[first : first + _CHUNK] for s, value in geometry.items()})
            for first in range(0, count, _CHUNK)
        ]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def sample(self, field: PrimeField, rng: np.random.Generator, count: int) -> tuple[Geometry, Residues]:
        """Random geometries and the values there."""

        def attempt() -> tuple[Geometry, Residues]:
            geometry = {s: field.draw(rng, (count,)) for s in self.symbols}
            return geometry, self.values(field, geometry, count)

        return persistent(attempt)


def persistent(attempt: Callable[[], T]) -> T:
    """The result of an attempt that depends on random points, several times if they are singular."""
    for _ in range(_ATTEMPTS):
        try:
            return attempt()
        except DegenerateSampleError:
            continue
    raise ClosedFormError(f"{_ATTEMPTS} random geometries in a row were singular")


EXTRA_SAMPLES = 4
"""Samples beyond the number of unknowns: a wrong ansatz fits them with probability about p^-4."""

Geometry = Mapping[str, Residues]
"""Values of the symbols; for an angle the tangent of its half."""


@dataclass(frozen=True)
class Ansatz:
    """Numerator and denominator monomials of one function; the last denominator coefficient is normalised to 1."""

    numerator: tuple[Monomial, ...]
    denominator: tuple[Monomial, ...]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.numerator) + len(self.denominator)


Fit = tuple[Ansatz, list[int]]
"""The occurring monomials and their coefficients in one field."""


def circle_basis(angle: str, degree: int) -> list[Monomial]:
    """Basis of the polynomials of this degree in cos and sin, with sin² eliminated."""
    basis: list[Monomial] = []
    for power in range(degree + 1):
        basis.append(((cosine(angle), power),) if power else ())
        if power < degree:
            basis.append(tuple(sorted((*(((cosine(angle), power),) if power else ()), (sine(angle), 1)))))
    return basis


def design(field: PrimeField, geometry: Geometry, monomials: Sequence[Monomial], count: int) -> Residues:
    """Values of the monomials at the first points: array of shape (count, monomials)."""
    values = residues_of_generators({g for monomial in monomials for g, _ in monomial}, geometry, field)
    table = np.ones((len(monomials), count), dtype=np.int64)
    for row, monomial in zip(table, monomials, strict=True):
        for generator, exponent in monomial:
            for _ in range(exponent):
                row[:] = row * values[generator][:count] % field.p
    return table.T


def _system(
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
    top: Sequence[Monomial],
    bottom: Sequence[Monomial],
    count: int,
) -> Residues:
    """Equations numerator − value · denominator = 0 in the coefficients."""
    numerator = design(field, geometry, top, count)
    denominator = design(field, geometry, bottom, count) * values[:count, None] % field.p
    return np.concatenate([numerator, -denominator % field.p], axis=1)


def fit_quotient(
    field: PrimeField,
    geometry: Geometry,
    values: Residues,
    top: Sequence[Monomial],
    bottom: Sequence[Monomial],
) -> Fit | None:
    """Fit one function by a quotient with these monomials, or None if that cannot represent it."""
    count = len(top) + len(bottom) + EXTRA_SAMPLES
    for vector in null_vectors(_system(field, geometry, values, top, bottom, count), field):
        above = [(m, c) for m, c in zip(top, vector, strict=False) if c]
        below = [(m, c) for m, c in zip(bottom, vector[len(top) :], strict=True) if c]
        if below:
            ansatz = Ansatz(tuple(m for m, _ in above), tuple(m for m, _ in below))
            return ansatz, normalised([c for _, c in above + below], field)
    return None


def solve_ansatz(ansatz: Ansatz, field: PrimeField, geometry: Geometry, values: Residues) -> list[int]:
    """Coefficients of a known ansatz in one field."""
    system = _system(field, geometry, values, ansatz.numerator, ansatz.denominator, ansatz.size + 1)
    solutions = null_vectors(system, field)
    if len(solutions) != 1 or not solutions[0][-1]:
        raise DegenerateSampleError("the ansatz does not have one solution here")
    return normalised(solutions[0], field)


def normalised(vector: list[int], field: PrimeField) -> list[int]:
    """Coefficients scaled so that the last one, of the last denominator monomial, is 1."""
    scale = field.invert(vector[-1])
    return [c * scale % field.p for c in vector]


_SURPLUS = 2
"""Values beyond those that a quotient needs: a wrong one fits them with probability about p^-2."""


@dataclass(frozen=True)
class Section:
    """A function along one symbol."""

    top: int  # degrees of numerator and denominator, for an angle in its cosine and sine together
    bottom: int  # that of the denominator
    # coefficients of the monic denominator, the constant one first; for an angle in the tangent t of its half, to be
    # divided by (1 + t²) to the power ``bottom``
    denominator: tuple[int, ...]


def sections(nodes: Residues, values: Residues, field: PrimeField, *, angle: bool) -> list[Section | None]:
    """Functions along one symbol.  Shapes: nodes (nodes,); values (functions, nodes)."""
    p, size = field.p, len(nodes)
    powers = np.ones((size, size), dtype=np.int64)
    for k in range(1, size):
        powers[:, k] = powers[:, k - 1] * nodes % p
    solved = as_flint(powers, field).solve(as_flint(values.T, field)).transpose().tolist()
    factors = (flint.nmod_poly([-int(x) % p, 1], p) for x in nodes)
    vanishing = reduce(lambda a, b: a * b, factors)
    quotients = (_quotient(flint.nmod_poly([int(c) for c in row], p), vanishing) for row in solved)
    read = _along_angle if angle else _along_symbol
    return [None if q is None else read(*q) for q in quotients]


def _quotient(values: Any, vanishing: Any) -> tuple[Any, Any] | None:
    """The quotient of the lowest degree that is congruent to a polynomial, with a monic denominator."""
    p, size = values.modulus(), vanishing.degree()
    one, zero = flint.nmod_poly([1], p), flint.nmod_poly([], p)
    before, rest, cofactor_before, cofactor = vanishing, values, zero, one
    best, lowest = (rest, cofactor), max(rest.degree(), 0)
    while rest.degree() > 0:
        quotient, remainder = divmod(before, rest)
        before, rest = rest, remainder
        cofactor_before, cofactor = cofactor, cofactor_before - quotient * cofactor
        degree = max(rest.degree(), 0) + cofactor.degree()
        if rest.degree() >= 0 and degree < lowest:
            best, lowest = (rest, cofactor), degree
    if lowest + 1 + _SURPLUS > size:
        return None
    lead = best[1].leading_coefficient()
    return best[0] / lead, best[1] / lead


def _coefficients(polynomial: Any) -> tuple[int, ...]:
    return tuple(int(c) for c in polynomial.coeffs())


def _along_symbol(top: Any, bottom: Any) -> Section:
    return Section(max(top.degree(), 0), bottom.degree(), _coefficients(bottom))


def _along_angle(top: Any, bottom: Any) -> Section:
    """Numerator and denominator as trigonometric polynomials.

    Let (1 + t²)^v divide the function, v perhaps negative, and let R be the rest of the denominator.  R / (1 + t²)^m
    is a trigonometric polynomial for 2 m ≥ deg R, and vanishes at t = ∞ to the order 2 m − deg R, which has to be that
    of the function's pole there.
    """
    if not top:
        return Section(0, 0, (1,))
    pole = max(0, top.degree() - bottom.degree())
    circle = flint.nmod_poly([1, 0, 1], top.modulus())
    power = 0
    while not top % circle:
        top, power = top // circle, power + 1
    while not bottom % circle:
        bottom, power = bottom // circle, power - 1
    degree = -(-(bottom.degree() + pole) // 2)
    return Section(degree - power, degree, _coefficients(bottom))


Residual = dict[Monomial, int]
"""A polynomial over GF(p)."""


def symbol_basis(name: str, degree: int, *, angle: bool) -> list[Monomial]:
    """Basis of the polynomials of this degree in one symbol."""
    if angle:
        return circle_basis(name, degree)
    return [((name, k),) if k else () for k in range(degree + 1)]


def box(bases: Sequence[Sequence[Monomial]]) -> list[Monomial]:
    """All products of one monomial of each basis."""
    return [tuple(sorted(pair for part in parts for pair in part)) for parts in product(*bases)]


def factor_of(name: str, section: Section, field: PrimeField, rng: np.random.Generator, *, angle: bool) -> Residual:
    """The denominator along one symbol as a polynomial in its generators."""
    if not angle:
        return {((name, k),) if k else (): c for k, c in enumerate(section.denominator) if c}
    p, basis = field.p, circle_basis(name, section.bottom)
    points = field.draw(rng, (len(basis),))
    scale = field.invert_array((1 + points * points) % p)
    values = np.zeros_like(points)
    for c in reversed(section.denominator):
        values = (values * points + c) % p
    for _ in range(section.bottom):
        values = values * scale % p
    table = design(field, {name: points}, basis, len(basis))
    solution = as_flint(table, field).solve(as_flint(values[:, None], field))
    return {m: int(solution[k, 0]) for k, m in enumerate(basis) if int(solution[k, 0])}


def multiplied(factors: Sequence[Residual], field: PrimeField) -> Residual:
    """The product of polynomials that share no generator."""
    return {
        tuple(sorted(pair for monomial, _ in terms for pair in monomial)): prod(c for _, c in terms) % field.p
        for terms in product(*(factor.items() for factor in factors))
    }


def evaluated(polynomial: Residual, field: PrimeField, geometry: Geometry, count: int) -> Residues:
    """Values of a polynomial over GF(p) at the first points of a geometry."""
    table = design(field, geometry, list(polynomial), count)
    total = np.zeros(count, dtype=np.int64)
    for column, coefficient in zip(table.T, polynomial.values(), strict=True):
        total = (total + column * coefficient) % field.p
    return total


def entangled_size(parts: Mapping[str, Section], angles: frozenset[str]) -> int:
    """Number of samples that :func:`entangled_factor` needs."""
    tops = prod(2 * s.top + 1 if name in angles else s.top + 1 for name, s in parts.items())
    bottoms = prod(2 * s.bottom + 1 if name in angles else s.bottom + 1 for name, s in parts.items())
    return tops + bottoms + EXTRA_SAMPLES


def entangled_factor(
    parts: Mapping[str, Section], angles: frozenset[str], field: PrimeField, geometry: Geometry, values: Residues
) -> Residual | None:
    """The denominator of a function of some symbols, whose degrees in each of them are known."""
    # shapes: values (points,)
    top = box([symbol_basis(name, s.top, angle=name in angles) for name, s in parts.items()])
    bottom = box([symbol_basis(name, s.bottom, angle=name in angles) for name, s in parts.items()])
    fit = fit_quotient(field, geometry, values, top, bottom)
    if fit is None:
        return None
    ansatz, coefficients = fit
    return dict(zip(ansatz.denominator, coefficients[len(ansatz.numerator) :], strict=True))


@dataclass(eq=False)
class Numerator:
    """A numerator that is being found."""

    index: int  # of the function
    denominator: Residual
    degrees: Mapping[str, int]  # degree in every symbol of the function
    length_degree: int | None  # degree in all lengths together, or None if the function is not homogeneous in them
    terms: Residual  # in the symbols seen so far, the others held

    def fit(self, field: PrimeField) -> Fit:
        """The finished quotient."""
        ansatz = Ansatz(tuple(self.terms), tuple(self.denominator))
        return ansatz, normalised([*self.terms.values(), *self.denominator.values()], field)


@dataclass(frozen=True)
class SparseInterpolation:
    """What numerators are interpolated from."""

    unknown: UnknownFunctions
    field: PrimeField
    rng: np.random.Generator
    anchor: Mapping[str, int]  # values of the symbols that are held
    work: Work

    def finish(self, numerators: Sequence[Numerator]) -> list[Numerator]:
        """Those whose terms in all symbols could be found within the budget."""
        names = {name for numerator in numerators for name in numerator.degrees}
        order = sorted(names, key=lambda name: (name in self.unknown.lengths, name))
        going = list(numerators)
        for position, name in enumerate(order):
            concerned = [n for n in going if name in n.degrees]
            for numerator in [n for n in concerned if self._is_last_length(n, name)]:
                self._complete(numerator, name)
                concerned.remove(numerator)
            failed = self._extend(concerned, order[:position], name)
            going = [n for n in going if n not in failed]
        return going

    # -- the last length -----------------------------------------------------------------------------------------

    def _is_last_length(self, numerator: Numerator, name: str) -> bool:
        if numerator.length_degree is None or name not in self.unknown.lengths:
            return False
        return name == max(n for n in numerator.degrees if n in self.unknown.lengths)

    def _complete(self, numerator: Numerator, name: str) -> None:
        """Add the power that makes every term homogeneous."""
        p, share = self.field.p, self.field.invert(self.anchor[name])
        terms = {}
        for monomial, coefficient in numerator.terms.items():
            missing = (numerator.length_degree or 0) - sum(e for g, e in monomial if g in self.unknown.lengths)
            if missing < 0:
                raise DegenerateSampleError("a term has more lengths than the function")
            power = ((name, missing),) if missing else ()
            terms[tuple(sorted((*monomial, *power)))] = coefficient * pow(share, missing, p) % p
        numerator.terms = terms

    # -- any other symbol ----------------------------------------------------------------------------------------

    def _extend(self, numerators: list[Numerator], known: Sequence[str], name: str) -> list[Numerator]:
        """Add a symbol to some numerators; returns those that the budget does not allow."""
        bases = {n.index: symbol_basis(name, n.degrees[name], angle=name in self.unknown.angles) for n in numerators}
        growing = sorted(numerators, key=lambda n: len(n.terms) * len(bases[n.index]))
        failed = [n for n in growing if len(n.terms) > self.work.terms]
        growing = [n for n in growing if len(n.terms) <= self.work.terms]
        while growing:
            points, nodes = max(len(n.terms) for n in growing), max(len(bases[n.index]) for n in growing)
            solving = sum(len(n.terms) ** 3 for n in growing) * SOLVING
            if self.work.take(points * nodes * self.unknown.cost + solving):
                break
            failed.append(growing.pop())
        if growing:
            persistent(partial(self._extend_all, growing, known, name, bases, (points, nodes)))
        return failed

    def _extend_all(
        self,
        numerators: Sequence[Numerator],
        known: Sequence[str],
        name: str,
        bases: Mapping[int, list[Monomial]],
        size: tuple[int, int],
    ) -> None:
        points, nodes = size
        field, total = self.field, points * nodes
        drawn = {s: field.draw(self.rng, (points,)) for s in known}
        along = field.draw(self.rng, (nodes,))
        geometry = {s: np.full(total, value) for s, value in self.anchor.items()}
        geometry |= {s: np.repeat(value, nodes) for s, value in drawn.items()}
        geometry[name] = np.tile(along, points)
        values = self.unknown.values(field, geometry, total).reshape(-1, points, nodes)
        extended = []
        for numerator in numerators:
            basis, count = bases[numerator.index], len(numerator.terms)
            bottom = evaluated(numerator.denominator, field, geometry, count * nodes).reshape(count, nodes)
            right = (values[numerator.index, :count] * bottom % field.p)[:, : len(basis)]
            left = design(field, drawn, list(numerator.terms), count)
            coefficients = _solved(left, right, field)
            nodal = design(field, {name: along}, basis, len(basis))
            table = _solved(nodal, coefficients.T, field)
            extended.append(
                {
                    tuple(sorted((*monomial, *power))): int(table[j, k])
                    for k, monomial in enumerate(numerator.terms)
                    for j, power in enumerate(basis)
                    if table[j, k]
                }
            )
        for numerator, terms in zip(numerators, extended, strict=True):
            numerator.terms = terms


def _solved(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Solution of a square system."""
    rows, columns = right.shape
    if not rows or not columns:
        return np.zeros((left.shape[1], columns), dtype=np.int64)
    try:
        solution = as_flint(left, field).solve(as_flint(right, field))
    except ZeroDivisionError:
        raise DegenerateSampleError("random points do not tell the monomials apart") from None
    return np.array([int(x) for x in solution.entries()], dtype=np.int64).reshape(rows, columns)
