"""Closed forms by interpolation: from values at random geometries to polynomials and quotients.

The caller can evaluate a vector of unknown functions of the geometry symbols at any points of any field.  First, group
testing finds which symbols each function depends on.  Then an ansatz is fitted by linear algebra: for polynomials the
monomials of the right physical dimension, for quotients numerator and denominator with growing degree.  The ansatz is
chosen in one field; its coefficients are then found in as many fields as it takes, one per sign of √2 and √3 and one
per prime, and put together by Chinese remainders and rational reconstruction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.errors import ClosedFormError, DegenerateSampleError
from echelon.exact.ansatz import (
    EXTRA_SAMPLES,
    Ansatz,
    Fit,
    Geometry,
    fit_polynomials,
    fit_quotient,
    generator_values,
    monomials_up_to,
    solve_ansatz,
)
from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import Number, Rational, surd
from echelon.exact.polynomial import Monomial, Polynomial
from echelon.exact.rational import RationalFunction
from echelon.exact.reconstruction import combine, rational

_LARGEST_ANSATZ = 1500
_LARGEST_DENOMINATOR_DEGREE = 6
_MOST_PRIMES = 64
_ATTEMPTS = 8


@dataclass(frozen=True)
class UnknownFunctions:
    """Functions of geometry symbols that can be evaluated modulo primes.

    Attributes
    ----------
    evaluate : callable (field, geometry) -> array of shape (functions, geometries)
        Geometry maps every symbol to an array of values (for an angle: of the tangent of its half); without symbols
        there is one geometry.
    symbols : sequence of str
        All symbols that may matter.
    angles : collection of str
        Those of them that are angles.
    degrees : sequence of int
        Homogeneous degree of each function in the symbols that are lengths.
    lengths : collection of str
        Symbols with the dimension of a length; other symbols take part with any degree up to 2.
    irrational : (bool, bool)
        Whether √2 and √3 can occur in coefficients.
    """

    evaluate: Callable[[PrimeField, Geometry], Residues]
    symbols: Sequence[str]
    angles: frozenset[str]
    lengths: frozenset[str]
    degrees: Sequence[int]
    irrational: tuple[bool, bool]


def interpolate(unknown: UnknownFunctions, rng: np.random.Generator) -> list[RationalFunction]:
    """Closed forms of all functions.

    Parameters
    ----------
    unknown : UnknownFunctions
    rng : numpy Generator

    Returns
    -------
    list of RationalFunction

    Raises
    ------
    ClosedFormError
        If a function is not a quotient within the degree bounds.
    """
    return _Interpolation(unknown, rng).run()


class _Interpolation:
    def __init__(self, unknown: UnknownFunctions, rng: np.random.Generator) -> None:
        self.unknown, self.rng = unknown, rng

    def run(self) -> list[RationalFunction]:
        if not self.unknown.degrees:
            return []
        field = PrimeField.random(self.rng)
        fits = self._choose(field, self._dependence(field))
        return self._coefficients([ansatz for ansatz, _ in fits], [vector for _, vector in fits], field)

    # -- sampling ------------------------------------------------------------------------------------------------

    def _sample(self, field: PrimeField, count: int) -> tuple[Geometry, Residues]:
        for _ in range(_ATTEMPTS):
            geometry = {s: field.draw(self.rng, (count,)) for s in self.unknown.symbols}
            try:
                values = self.unknown.evaluate(field, geometry)
            except DegenerateSampleError:
                continue
            # without symbols there is one geometry only
            return geometry, np.broadcast_to(values, (len(values), count))
        raise ClosedFormError(f"{_ATTEMPTS} random geometries in a row were singular")

    # -- which symbols matter ------------------------------------------------------------------------------------

    def _dependence(self, field: PrimeField) -> list[list[str]]:
        """For each function, the symbols that change it."""
        depends: list[list[str]] = [[] for _ in self.unknown.degrees]
        pending = [list(self.unknown.symbols)] if self.unknown.symbols else []
        if len(self.unknown.symbols) <= 8:  # one evaluation for all singles beats bisection
            pending = [[s] for s in self.unknown.symbols]
        while pending:
            changed = self._changes(field, pending)
            split: list[list[str]] = []
            for group, hits in zip(pending, changed, strict=True):
                if len(group) == 1:
                    for index in np.flatnonzero(hits):
                        depends[index].append(group[0])
                elif hits.any():
                    middle = len(group) // 2
                    split += [group[:middle], group[middle:]]
            pending = split
        return depends

    def _changes(self, field: PrimeField, groups: list[list[str]]) -> list[Residues]:
        """For each group of symbols, which functions change when only these symbols do."""
        for _ in range(_ATTEMPTS):
            geometry = {}
            for symbol in self.unknown.symbols:
                base, other = field.draw(self.rng, (2,))
                column = [other if symbol in group else base for group in groups]
                geometry[symbol] = np.array([base, *column], dtype=field.dtype)
            try:
                values = self.unknown.evaluate(field, geometry)
            except DegenerateSampleError:
                continue
            return [values[:, 1 + k] != values[:, 0] for k in range(len(groups))]
        raise ClosedFormError(f"{_ATTEMPTS} random geometries in a row were singular")

    # -- which monomials occur -----------------------------------------------------------------------------------

    def _choose(self, field: PrimeField, depends: list[list[str]]) -> list[Fit]:
        """The smallest ansatz that fits each function, and its coefficients in this field."""
        chosen: dict[int, Fit] = {}
        for extra in range(_LARGEST_DENOMINATOR_DEGREE + 1):
            trials: dict[tuple[tuple[Monomial, ...], tuple[Monomial, ...]], list[int]] = {}
            for i, names in enumerate(depends):
                if i not in chosen:
                    trial = self._trial(names, self.unknown.degrees[i], extra)
                    trials.setdefault((tuple(trial[0]), tuple(trial[1])), []).append(i)
            trials = {key: v for key, v in trials.items() if len(key[0]) + len(key[1]) <= _LARGEST_ANSATZ}
            chosen |= self._fit_trials(field, trials)
            if len(chosen) == len(depends):
                return [chosen[i] for i in range(len(depends))]
        worst = next(i for i in range(len(depends)) if i not in chosen)
        raise ClosedFormError(
            f"no quotient of low degree in {', '.join(depends[worst]) or 'no symbol'} fits a coefficient"
        )

    def _fit_trials(
        self, field: PrimeField, trials: Mapping[tuple[tuple[Monomial, ...], tuple[Monomial, ...]], list[int]]
    ) -> dict[int, Fit]:
        """The functions, by index, that their trial monomials can represent."""
        found: dict[int, Fit] = {}
        if not trials:
            return found
        geometry, values = self._sample(field, max(len(a) + len(b) for a, b in trials) + EXTRA_SAMPLES)
        for (top, bottom), indices in trials.items():
            if bottom == ((),):
                fits = fit_polynomials(field, geometry, values[indices], top)
            else:
                fits = [fit_quotient(field, geometry, values[i], top, bottom) for i in indices]
            found |= {i: fit for i, fit in zip(indices, fits, strict=True) if fit is not None}
        return found

    def _trial(self, names: list[str], degree: int, extra: int) -> tuple[list[Monomial], list[Monomial]]:
        """Monomials of numerator and denominator; ``extra`` is how much more the denominator may have than it must."""
        lengths = [s for s in names if s in self.unknown.lengths]
        angles = [s for s in names if s in self.unknown.angles]
        others = [s for s in names if s not in self.unknown.lengths and s not in self.unknown.angles]
        below = extra + max(0, -degree) if lengths else 0
        above = extra + max(0, degree) if lengths else 0
        top = monomials_up_to(lengths, above, angles, max(2, 1 + extra), others, 2 + extra)
        bottom: list[Monomial] = [()]
        if extra or below:
            bottom = monomials_up_to(lengths, below, angles, 1 + extra, others, extra)
        return top, bottom

    # -- exact coefficients --------------------------------------------------------------------------------------

    def _coefficients(self, ansatz: list[Ansatz], first: list[list[int]], field: PrimeField) -> list[RationalFunction]:
        primes: list[int] = []
        tables: list[list[list[list[int]]]] = []  # per prime and function: the four parts of every coefficient
        if not any(self.unknown.irrational):  # the choosing field already gave the coefficients
            primes.append(field.p)
            tables.append([[[c, 0, 0, 0] for c in vector] for vector in first])
        for _ in range(_MOST_PRIMES):
            found = _reconstruct(ansatz, tables, primes) if primes else None
            if found is not None and self._confirmed(found):
                return found
            field = PrimeField.random(self.rng)
            if field.p in primes:
                continue
            try:
                tables.append(self._parts(ansatz, field))
            except DegenerateSampleError:
                continue
            primes.append(field.p)
        raise ClosedFormError(f"coefficients need more than {_MOST_PRIMES} primes")

    def _confirmed(self, functions: list[RationalFunction]) -> bool:
        """Whether the functions hold at a fresh point of a fresh field, which a mistaken reconstruction does not."""
        field = PrimeField.random(self.rng)
        geometry, values = self._sample(field, 1)
        monomials = [m for f in functions for part in (f.numerator, f.denominator) for m in part.terms]
        point = {g: int(x[0]) for g, x in generator_values(field, geometry, monomials).items()}
        try:
            pairs = [
                (f.numerator.evaluate(point, field.embed), f.denominator.evaluate(point, field.embed))
                for f in functions
            ]
        except DegenerateSampleError:
            return False
        return not any((top - int(v) * bottom) % field.p for (top, bottom), v in zip(pairs, values[:, 0], strict=True))

    def _parts(self, ansatz: list[Ansatz], field: PrimeField) -> list[list[list[int]]]:
        """Residues of the four parts (1, √2, √3, √6) of every coefficient of every function."""
        flips2, flips3 = ((False, True) if flag else (False,) for flag in self.unknown.irrational)
        embeddings = {(a, b): self._solve(ansatz, field.conjugate(a, b)) for a in flips2 for b in flips3}
        return [_separate({k: v[i] for k, v in embeddings.items()}, field) for i in range(len(ansatz))]

    def _solve(self, ansatz: list[Ansatz], field: PrimeField) -> list[list[int]]:
        """Coefficients of every function in one field."""
        count = max((a.size for a in ansatz), default=0) + 1
        geometry, values = self._sample(field, count)
        return [solve_ansatz(a, field, geometry, values[i]) for i, a in enumerate(ansatz)]


def _separate(embeddings: Mapping[tuple[bool, bool], list[int]], field: PrimeField) -> list[list[int]]:
    """Split every coefficient into its parts on 1, √2, √3, √6 from its values under all sign choices."""
    size = len(next(iter(embeddings.values())))
    share = field.invert(len(embeddings))
    roots = (1, field.root2, field.root3, field.root2 * field.root3)
    parts = []
    for k in range(size):
        quadruple = []
        for index, root in enumerate(roots):
            total = 0
            for (flip2, flip3), coefficients in embeddings.items():
                negative = (flip2 and bool(index & 1)) ^ (flip3 and bool(index & 2))
                total += -coefficients[k] if negative else coefficients[k]
            known = (index & 1 == 0 or (True, False) in embeddings) and (index & 2 == 0 or (False, True) in embeddings)
            quadruple.append(total * share * field.invert(root) % field.p if known else 0)
        parts.append(quadruple)
    return parts


def _reconstruct(
    ansatz: list[Ansatz], tables: list[list[list[list[int]]]], primes: list[int]
) -> list[RationalFunction] | None:
    functions = []
    for i, shape in enumerate(ansatz):
        coefficients: list[Number] = []
        for k in range(shape.size):
            parts: list[Rational] = []
            for part in range(4):
                value = rational(*combine([table[i][k][part] for table in tables], primes))
                if value is None:
                    return None
                parts.append(value)
            coefficients.append(surd(parts[0], parts[1], parts[2], parts[3]))
        cut = len(shape.numerator)
        top = Polynomial(dict(zip(shape.numerator, coefficients[:cut], strict=True)))
        bottom = Polynomial(dict(zip(shape.denominator, coefficients[cut:], strict=True)))
        functions.append(RationalFunction(top, bottom))
    return functions
