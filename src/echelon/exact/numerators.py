"""Numerators of unknown functions, symbol by symbol: Zippel's sparse interpolation.

Times its denominator a function is a polynomial.  Its monomials in the symbols seen so far are known; at some values of
the next symbol, as many as its degree needs, their coefficients follow from as many random points as there are
monomials, and each coefficient is then interpolated along that symbol (Zippel, "Probabilistic algorithms for sparse
polynomials", 1979).  So the cost follows the number of terms and not the degrees of all symbols together.  Lengths come
last; the power of the very last one follows from the dimension.  All functions share their points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import flint
import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.ansatz import Ansatz, Fit, design, normalised
from echelon.exact.denominators import Residual, evaluated, symbol_basis
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Monomial
from echelon.exact.unknown import persistent
from echelon.exact.work import SOLVING, Work


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

    evaluate: Callable[[Mapping[str, Residues]], Residues]
    field: PrimeField
    rng: np.random.Generator
    anchor: Mapping[str, int]  # values of the symbols that are held
    angles: frozenset[str]
    lengths: frozenset[str]
    cost: float  # operations of one evaluation
    work: Work

    def finish(self, numerators: Sequence[Numerator]) -> list[Numerator]:
        """Those whose terms in all symbols could be found within the budget."""
        names = {name for numerator in numerators for name in numerator.degrees}
        order = sorted(names, key=lambda name: (name in self.lengths, name))
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
        if numerator.length_degree is None or name not in self.lengths:
            return False
        return name == max(n for n in numerator.degrees if n in self.lengths)

    def _complete(self, numerator: Numerator, name: str) -> None:
        """Add the power that makes every term homogeneous."""
        p, share = self.field.p, self.field.invert(self.anchor[name])
        terms = {}
        for monomial, coefficient in numerator.terms.items():
            missing = (numerator.length_degree or 0) - sum(e for g, e in monomial if g in self.lengths)
            if missing < 0:
                raise DegenerateSampleError("a term has more lengths than the function")
            power = ((name, missing),) if missing else ()
            terms[tuple(sorted((*monomial, *power)))] = coefficient * pow(share, missing, p) % p
        numerator.terms = terms

    # -- any other symbol ----------------------------------------------------------------------------------------

    def _extend(self, numerators: list[Numerator], known: Sequence[str], name: str) -> list[Numerator]:
        """Add a symbol to some numerators; returns those that the budget does not allow."""
        bases = {n.index: symbol_basis(name, n.degrees[name], angle=name in self.angles) for n in numerators}
        growing = sorted(numerators, key=lambda n: len(n.terms) * len(bases[n.index]))
        failed = [n for n in growing if len(n.terms) > self.work.terms]
        growing = [n for n in growing if len(n.terms) <= self.work.terms]
        while growing:
            points, nodes = max(len(n.terms) for n in growing), max(len(bases[n.index]) for n in growing)
            solving = sum(len(n.terms) ** 3 for n in growing) * SOLVING
            if self.work.take(points * nodes * self.cost + solving):
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
        values = self.evaluate(geometry).reshape(-1, points, nodes)
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
    matrix = flint.nmod_mat(rows, rows, left.ravel().tolist(), field.p)
    try:
        solution = matrix.solve(flint.nmod_mat(rows, columns, right.ravel().tolist(), field.p))
    except ZeroDivisionError:
        raise DegenerateSampleError("random points do not tell the monomials apart") from None
    return np.array([int(x) for x in solution.entries()], dtype=np.int64).reshape(rows, columns)
