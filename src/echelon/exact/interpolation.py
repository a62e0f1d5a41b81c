"""Closed forms by interpolation: from values at random geometries to polynomials and quotients.

The caller can evaluate a vector of unknown functions of the geometry symbols at any points of any field.  Group testing
finds which symbols each function depends on, lines along single symbols give the degrees and the denominator, and
sparse interpolation the numerator (:mod:`echelon.exact.unknown`), all in one field.  The coefficients of the
monomials that occur are then found in as many fields as it takes, one per sign of √2 and √3 and one per prime, and put
together by Chinese remainders and rational reconstruction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import numpy as np

from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues
from echelon.exact.polynomial import Number, Polynomial, Rational, simplest, surd
from echelon.exact.rational import RationalFunction, residues_at
from echelon.exact.unknown import (
    SOLVING,
    Ansatz,
    Fit,
    Geometry,
    Numerator,
    Residual,
    Section,
    SparseInterpolation,
    UnknownFunctions,
    Work,
    entangled_factor,
    entangled_size,
    evaluated,
    factor_of,
    multiplied,
    persistent,
    sections,
    solve_ansatz,
)

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


_MOST_PRIMES = 64


def interpolate(
    unknown: UnknownFunctions, rng: np.random.Generator, work: Work | None = None
) -> list[RationalFunction | None]:
    """Closed forms of all functions."""
    return _Interpolation(unknown, rng, Work.of(1) if work is None else work).run()


@dataclass(eq=False)
class _Pending:
    """A function whose coefficients are not known yet, with what is known of them."""

    ansatz: Ansatz
    primes: list[int]
    tables: list[list[list[int]]]  # for each prime the four parts (1, √2, √3, √6) of every coefficient


class _Interpolation:
    def __init__(self, unknown: UnknownFunctions, rng: np.random.Generator, work: Work) -> None:
        self.unknown, self.rng, self.work = unknown, rng, work

    def run(self) -> list[RationalFunction | None]:
        if not self.unknown.degrees:
            return []
        field = PrimeField.random(self.rng)
        pending: dict[int, _Pending] = {}
        fits = persistent(lambda: _Fitting(self.unknown, field, self.rng, self.work).run())
        for index, fit in enumerate(fits):
            if fit is not None:
                ansatz, vector = fit
                # without roots the choosing field already gave the coefficients
                known = not any(self.unknown.irrational)
                tables = [[[c, 0, 0, 0] for c in vector]] if known else []
                pending[index] = _Pending(ansatz, [field.p] if known else [], tables)
        done = self._coefficients(pending)
        return [done.get(index) for index in range(len(self.unknown.degrees))]

    def _coefficients(self, pending: dict[int, _Pending]) -> dict[int, RationalFunction]:
        done: dict[int, RationalFunction] = {}
        primes = {p for function in pending.values() for p in function.primes}
        for _ in range(_MOST_PRIMES):
            candidates = {i: f for i, p in pending.items() if (f := _reconstructed(p)) is not None}
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
        """Those that hold at a fresh point of a fresh field, which a mistaken reconstruction does not."""
        if not functions:
            return []
        field = PrimeField.random(self.rng)
        geometry, values = self.unknown.sample(field, self.rng, 1)
        generators = {g for f in functions.values() for g in f.generators()}
        point = residues_at(generators, geometry, field)
        confirmed = []
        for index, function in functions.items():
            try:
                top, bottom = (f.evaluate(point, field.embed) for f in (function.numerator, function.denominator))
            except DegenerateSampleError:
                continue
            if not (top - int(values[index, 0]) * bottom) % field.p:
                confirmed.append(index)
        return confirmed

    def _add(self, pending: Mapping[int, _Pending], field: PrimeField) -> bool:
        """Find the coefficients of pending functions in one more field; whether the budget allows it."""
        flips2, flips3 = ((False, True) if flag else (False,) for flag in self.unknown.irrational)
        signs = [(a, b) for a in flips2 for b in flips3]
        sizes = [p.ansatz.size for p in pending.values()]
        cost = (max(sizes) + 1) * self.unknown.cost + SOLVING * sum(size**3 for size in sizes)
        if not self.work.take(len(signs) * cost):
            return False
        try:
            solved = {sign: self._solve(pending, field.conjugate(*sign)) for sign in signs}
            for index, function in pending.items():
                function.tables.append(_separate({sign: found[index] for sign, found in solved.items()}, field))
                function.primes.append(field.p)
        except DegenerateSampleError:
            pass  # the next field will do
        return True

    def _solve(self, pending: Mapping[int, _Pending], field: PrimeField) -> dict[int, list[int]]:
        """Coefficients of every pending function in one field."""
        count = max(p.ansatz.size for p in pending.values()) + 1
        geometry, values = self.unknown.sample(field, self.rng, count)
        return {i: solve_ansatz(p.ansatz, field, geometry, values[i]) for i, p in pending.items()}


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


def _reconstructed(pending: _Pending) -> RationalFunction | None:
    """The quotient that has the residues found so far, if one is simple enough to be believed."""
    if not pending.primes:
        return None
    coefficients: list[Number] = []
    for k in range(pending.ansatz.size):
        parts: list[Rational] = []
        for part in range(4):
            value = rational(*combine([table[k][part] for table in pending.tables], pending.primes))
            if value is None:
                return None
            parts.append(value)
        coefficients.append(surd(parts[0], parts[1], parts[2], parts[3]))
    cut = len(pending.ansatz.numerator)
    top = Polynomial(dict(zip(pending.ansatz.numerator, coefficients[:cut], strict=True)))
    bottom = Polynomial(dict(zip(pending.ansatz.denominator, coefficients[cut:], strict=True)))
    return RationalFunction(top, bottom)


_NODES = (6, 16, 40, 100)
"""Values along a line, more where they are too few."""
_LARGEST_JOINT_FIT = 1500
_FEW_SYMBOLS = 8

_Sections = dict[str, Section]


class _Fitting:
    """Finds the monomials of functions, and their coefficients in one field."""

    def __init__(self, unknown: UnknownFunctions, field: PrimeField, rng: np.random.Generator, work: Work) -> None:
        self.unknown, self.field, self.rng, self.work = unknown, field, rng, work
        self.anchor = self._point()
        self._entangled: dict[object, Residual | None] = {}

    def run(self) -> list[Fit | None]:
        depends = self._dependence()
        found = self._all_sections(depends)
        entangled = self._entangled_symbols(found)
        at_anchor = {s: np.array([value], dtype=np.int64) for s, value in self.anchor.items()}
        values = persistent(lambda: self._values(at_anchor, 1))[:, 0]
        numerators = []
        for index, parts in enumerate(found):
            denominator = None if parts is None else self._denominator(index, parts, entangled[index])
            if parts is not None and denominator is not None:
                numerators.append(self._numerator(index, parts, denominator, int(values[index])))
        sparse = SparseInterpolation(self.unknown, self.field, self.rng, self.anchor, self.work)
        fits: list[Fit | None] = [None] * len(found)
        for numerator in sparse.finish(numerators):
            fits[numerator.index] = numerator.fit(self.field)
        return fits

    def _point(self) -> dict[str, int]:
        return {s: int(self.field.draw(self.rng, (1,))[0]) for s in self.unknown.symbols}

    def _values(self, geometry: Geometry, count: int) -> Residues:
        self.work.spend(count * self.unknown.cost)
        return self.unknown.values(self.field, geometry, count)

    # -- which symbols matter ------------------------------------------------------------------------------------

    def _dependence(self) -> list[list[str]]:
        """For each function, the symbols that change it."""
        depends: list[list[str]] = [[] for _ in self.unknown.degrees]
        pending = [list(self.unknown.symbols)] if self.unknown.symbols else []
        if len(self.unknown.symbols) <= _FEW_SYMBOLS:  # one evaluation for all singles beats bisection
            pending = [[s] for s in self.unknown.symbols]
        while pending:
            changed = persistent(partial(self._changes, pending))
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

    def _changes(self, groups: list[list[str]]) -> list[Residues]:
        """For each group of symbols, which functions change when only these symbols do."""
        geometry = {}
        for symbol in self.unknown.symbols:
            base, other = self.field.draw(self.rng, (2,))
            column = [other if symbol in group else base for group in groups]
            geometry[symbol] = np.array([base, *column], dtype=self.field.dtype)
        values = self._values(geometry, 1 + len(groups))
        return [values[:, 1 + k] != values[:, 0] for k in range(len(groups))]

    # -- along single symbols ------------------------------------------------------------------------------------

    def _all_sections(self, depends: Sequence[Sequence[str]]) -> list[_Sections | None]:
        """Every function along every symbol that it depends on, from the anchor; None if a degree is too high."""
        found: list[_Sections] = [{} for _ in depends]
        pending = {name: [i for i, names in enumerate(depends) if name in names] for name in self.unknown.symbols}
        for nodes in _NODES:
            pending = {name: indices for name, indices in pending.items() if indices}
            for name, row in persistent(partial(self._lines, self.anchor, pending, nodes)).items():
                for index, section in zip(pending[name], row, strict=True):
                    if section is not None:
                        found[index][name] = section
                pending[name] = [i for i in pending[name] if name not in found[i]]
        return [parts if len(parts) == len(names) else None for parts, names in zip(found, depends, strict=True)]

    def _lines(
        self, anchor: Mapping[str, int], wanted: Mapping[str, Sequence[int]], nodes: int
    ) -> dict[str, list[Section | None]]:
        """Some functions along some symbols, from an anchor."""
        if not wanted:
            return {}
        geometry = {s: np.full(nodes * len(wanted), value) for s, value in anchor.items()}
        for k, name in enumerate(wanted):
            geometry[name][k * nodes : (k + 1) * nodes] = self.field.draw(self.rng, (nodes,))
        values = self._values(geometry, nodes * len(wanted))
        found = {}
        for k, (name, indices) in enumerate(wanted.items()):
            block = slice(k * nodes, (k + 1) * nodes)
            angle = name in self.unknown.angles
            found[name] = sections(geometry[name][block], values[list(indices), block], self.field, angle=angle)
        return found

    # -- denominators --------------------------------------------------------------------------------------------

    def _entangled_symbols(self, found: Sequence[_Sections | None]) -> list[list[str]]:
        """For every function, the symbols whose denominators change with other symbols."""
        wanted: dict[str, list[int]] = {}
        nodes = _NODES[0]
        for index, parts in enumerate(found):
            for name, section in (parts or {}).items():
                if section.bottom:
                    wanted.setdefault(name, []).append(index)
                    nodes = max(nodes, 2 * (section.top + 2 * section.bottom) + 4)
        entangled: list[list[str]] = [[] for _ in found]
        for name, row in persistent(lambda: self._lines(self._point(), wanted, nodes)).items():
            for index, other in zip(wanted[name], row, strict=True):
                parts = found[index]
                if parts is not None and (other is None or other.denominator != parts[name].denominator):
                    entangled[index].append(name)
        return entangled

    def _denominator(self, index: int, parts: _Sections, entangled: Sequence[str]) -> Residual | None:
        angles = self.unknown.angles
        factors = [
            factor_of(name, section, self.field, self.rng, angle=name in angles)
            for name, section in parts.items()
            if section.bottom and name not in entangled
        ]
        if entangled:
            key = tuple((name, parts[name].denominator) for name in entangled)
            if key not in self._entangled:
                joint = {name: parts[name] for name in entangled}
                self._entangled[key] = persistent(partial(self._entangled_factor, index, joint))
            shared = self._entangled[key]
            if shared is None:
                return None
            factors.append(shared)
        return multiplied(factors, self.field)

    def _entangled_factor(self, index: int, parts: _Sections) -> Residual | None:
        count = entangled_size(parts, self.unknown.angles)
        if count > _LARGEST_JOINT_FIT or not self.work.take(SOLVING * count**3):
            return None
        geometry = {s: np.full(count, value) for s, value in self.anchor.items()}
        geometry |= {name: self.field.draw(self.rng, (count,)) for name in parts}
        values = self._values(geometry, count)[index]
        return entangled_factor(parts, self.unknown.angles, self.field, geometry, values)

    # -- numerators ----------------------------------------------------------------------------------------------

    def _numerator(self, index: int, parts: _Sections, denominator: Residual, value: int) -> Numerator:
        """The numerator at the anchor, to be extended."""
        lengths = self.unknown.lengths
        below = {sum(e for g, e in monomial if g in lengths) for monomial in denominator}
        homogeneous = len(below) == 1 and any(name in lengths for name in parts)
        degree = self.unknown.degrees[index] + below.pop() if homogeneous else None
        point = {s: np.array([x], dtype=np.int64) for s, x in self.anchor.items()}
        start = value * int(evaluated(denominator, self.field, point, 1)[0]) % self.field.p
        if not start and parts:
            raise DegenerateSampleError("a function vanishes at the anchor")
        terms: Residual = {(): start} if start else {}
        return Numerator(index, denominator, {name: s.top for name, s in parts.items()}, degree, terms)
