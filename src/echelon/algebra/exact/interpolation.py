"""Closed forms of functions that are known by their values modulo primes.

The caller can evaluate a vector of unknown functions of the geometry symbols at any points of any field.  One field
shows which monomials they have (:mod:`echelon.algebra.exact.fitting`).  The coefficients of these are then found in
as many
fields as it takes, one per sign of √2 and √3 and one per prime, and put together by Chinese remainders and rational
reconstruction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from echelon.algebra.exact.ansatz import Ansatz, Fit, solve_ansatz
from echelon.algebra.exact.field import PrimeField, residues_at
from echelon.algebra.exact.fitting import Fitting
from echelon.algebra.exact.polynomial import (
    Number,
    Polynomial,
    Rational,
    simplest,
    surd,
)
from echelon.algebra.exact.rational import RationalFunction
from echelon.algebra.exact.unknown_functions import (
    SOLVING,
    UnknownFunctions,
    Work,
    persistent,
)
from echelon.shared import DegenerateSampleError

_MARGIN_BITS = 16
"""A candidate n/d is believed when |n|·d is this many bits shorter than the modulus; the certificate has the last
word, so this only decides when to ask for one more prime."""


def combine(residues: Sequence[int], primes: Sequence[int]) -> tuple[int, int]:
    """The residue modulo the product of the primes, and that product."""
    value, modulus = 0, 1
    for residue, prime in zip(residues, primes, strict=True):
        value += modulus * ((residue - value) * pow(modulus, -1, prime) % prime)
        modulus *= prime
    return value, modulus


def rational(residue: int, modulus: int) -> Rational | None:
    """The simplest rational number with this residue, or None if none is simple enough to be believed.

    Uses the largest quotient of the extended Euclidean algorithm (Monagan, "Maximal quotient rational
    reconstruction", 2004).

    >>> rational(pow(3, -1, 2147483399) * 2, 2147483399)
    Fraction(2, 3)
    """
    residue %= modulus
    if residue == 0:
        return 0
    best, height = (0, 1), modulus
    remainders, cofactors = (modulus, residue), (0, 1)
    while remainders[1]:
        size = remainders[1] * abs(cofactors[1])
        if size < height:
            best, height = (remainders[1], cofactors[1]), size
        quotient = remainders[0] // remainders[1]
        remainders = remainders[1], remainders[0] - quotient * remainders[1]
        cofactors = cofactors[1], cofactors[0] - quotient * cofactors[1]
    if height << _MARGIN_BITS > modulus:
        return None
    return simplest(Fraction(*best))


MOST_PRIMES = 64
"""Primes of an interpolation: coefficients then have fractions of up to 300 digits."""


def interpolate(
    unknown: UnknownFunctions,
    rng: np.random.Generator,
    work: Work | None = None,
    most_primes: int = MOST_PRIMES,
) -> list[RationalFunction | None]:
    """Closed forms of unknown functions; None for those that take more than the work, or longer numbers."""
    return _Interpolation(
        unknown, rng, Work.of(1) if work is None else work, most_primes
    ).run()


@dataclass(eq=False)
class _Pending:
    """A function whose coefficients are not known yet, with what is known of them."""

    ansatz: Ansatz
    primes: list[int]
    tables: list[
        list[list[int]]
    ]  # for each prime the four parts (1, √2, √3, √6) of every coefficient


class _Interpolation:
    def __init__(
        self,
        unknown: UnknownFunctions,
        rng: np.random.Generator,
        work: Work,
        most_primes: int,
    ) -> None:
        self.unknown = unknown
        self.rng = rng
        self.work = work
        self.most_primes = most_primes

    def run(self) -> list[RationalFunction | None]:
        if not self.unknown.degrees:
            return []
        field = PrimeField.random(self.rng)
        pending: dict[int, _Pending] = {}
        found_in = self._monomials if self.unknown.symbols else self._numbers
        fits = persistent(lambda: found_in(field))
        for index, fit in enumerate(fits):
            if fit is not None:
                ansatz, vector = fit
                # without roots the choosing field already gave the coefficients
                known = not any(self.unknown.irrational)
                tables = [[[c, 0, 0, 0] for c in vector]] if known else []
                pending[index] = _Pending(ansatz, [field.p] if known else [], tables)
        done = self._coefficients(pending)
        return [done.get(index) for index in range(len(self.unknown.degrees))]

    def _monomials(self, field: PrimeField) -> list[Fit | None]:
        return Fitting(self.unknown, field, self.rng, self.work).run()

    def _numbers(self, field: PrimeField) -> list[Fit | None]:
        """Functions of no symbol, by one value."""
        self.work.spend(self.unknown.cost)
        values = self.unknown.values(field, {}, 1)[:, 0]
        return [
            (Ansatz(((),) if value else (), ((),)), [value, 1] if value else [1])
            for value in map(int, values)
        ]

    def _coefficients(
        self, pending: dict[int, _Pending]
    ) -> dict[int, RationalFunction]:
        done: dict[int, RationalFunction] = {}
        primes = {p for function in pending.values() for p in function.primes}
        for _ in range(self.most_primes):
            candidates = {
                i: f for i, p in pending.items() if (f := _reconstructed(p)) is not None
            }
            for index in self._confirmed(candidates):
                done[index] = candidates[index]
                del pending[index]
            if not pending:
                break
            field = PrimeField.random(self.rng)
            if field.p not in primes and not self._add(pending, field):
                break
            primes.add(field.p)
        return done

    def _confirmed(self, functions: Mapping[int, RationalFunction]) -> list[int]:
        """Indices of functions that also hold at a fresh point of a fresh field, as mistaken reconstructions do not."""
        if not functions:
            return []
        field = PrimeField.random(self.rng)
        geometry, values = self.unknown.sample(field, self.rng, 1)
        generators = {g for f in functions.values() for g in f.generators()}
        point = residues_at(generators, geometry, field)
        confirmed = []
        for index, function in functions.items():
            try:
                top, bottom = (
                    f.evaluate(point, field.embed)
                    for f in (function.numerator, function.denominator)
                )
            except DegenerateSampleError:
                continue
            if not (top - int(values[index, 0]) * bottom) % field.p:
                confirmed.append(index)
        return confirmed

    def _add(self, pending: Mapping[int, _Pending], field: PrimeField) -> bool:
        """Find the coefficients of pending functions in one more field; whether the budget allows it."""
        flips2, flips3 = (
            (False, True) if flag else (False,) for flag in self.unknown.irrational
        )
        signs = [(a, b) for a in flips2 for b in flips3]
        sizes = [p.ansatz.size for p in pending.values()]
        cost = (max(sizes) + 1) * self.unknown.cost + SOLVING * sum(
            size**3 for size in sizes
        )
        if not self.work.take(len(signs) * cost):
            return False
        try:
            solved = {
                sign: self._solve(pending, field.conjugate(*sign)) for sign in signs
            }
            for index, function in pending.items():
                function.tables.append(
                    _separate(
                        {sign: found[index] for sign, found in solved.items()}, field
                    )
                )
                function.primes.append(field.p)
        except DegenerateSampleError:
            pass  # the next field will do
        return True

    def _solve(
        self, pending: Mapping[int, _Pending], field: PrimeField
    ) -> dict[int, list[int]]:
        """Coefficients of every pending function in one field."""
        count = max(p.ansatz.size for p in pending.values()) + 1
        geometry, values = self.unknown.sample(field, self.rng, count)
        return {
            i: solve_ansatz(p.ansatz, field, geometry, values[i])
            for i, p in pending.items()
        }


def _separate(
    embeddings: Mapping[tuple[bool, bool], list[int]], field: PrimeField
) -> list[list[int]]:
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
            known = (index & 1 == 0 or (True, False) in embeddings) and (
                index & 2 == 0 or (False, True) in embeddings
            )
            quadruple.append(
                total * share * field.invert(root) % field.p if known else 0
            )
        parts.append(quadruple)
    return parts


def _reconstructed(pending: _Pending) -> RationalFunction | None:
    """The quotient that has the residues found so far, if one is simple enough to be believed."""
    if not pending.primes:
        return None
    coefficients: list[Number] = []
    for k in range(len(pending.tables[0])):
        parts: list[Rational] = []
        for part in range(4):
            value = rational(
                *combine([table[k][part] for table in pending.tables], pending.primes)
            )
            if value is None:
                return None
            parts.append(value)
        coefficients.append(surd(parts[0], parts[1], parts[2], parts[3]))
    cut = len(pending.ansatz.numerator)
    top = Polynomial(
        dict(zip(pending.ansatz.numerator, coefficients[:cut], strict=True))
    )
    bottom = Polynomial(
        dict(zip(pending.ansatz.denominator, coefficients[cut:], strict=True))
    )
    return RationalFunction(top, bottom)
