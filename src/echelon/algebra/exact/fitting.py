"""Unknown functions of geometry symbols, fitted in one field: which symbols and which monomials matter, and how much.

Group testing finds which symbols each function depends on; lines along single symbols give the degrees and the
denominator.  If two lines with other values of the other symbols show the same denominator, it is a factor in this
symbol alone, as the denominators of robots mostly are.  Symbols that are entangled with one another are fitted
together, with all others held: the degrees are known from the lines.

Times its denominator a function is a polynomial.  Its monomials in the symbols seen so far are known; at some values of
the next symbol, as many as its degree needs, their coefficients follow from as many random points as there are
monomials, and each coefficient is then interpolated along that symbol (Zippel, "Probabilistic algorithms for sparse
polynomials", 1979).  So the cost follows the number of terms and not the degrees of all symbols together.  Lengths come
last; the power of the very last one follows from the dimension.  All functions share their points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from echelon.algebra.exact.ansatz import (
    Ansatz,
    Fit,
    Residual,
    Section,
    design,
    entangled_factor,
    entangled_size,
    evaluated,
    factor_of,
    multiplied,
    normalised,
    sections,
    symbol_basis,
)
from echelon.algebra.exact.field import Geometry, PrimeField, Residues, as_flint
from echelon.algebra.exact.polynomial import Monomial
from echelon.algebra.exact.unknown_functions import (
    SOLVING,
    UnknownFunctions,
    Work,
    persistent,
)
from echelon.shared import DegenerateSampleError

_NODES = (6, 16, 40, 100)  # values along a line, more where they are too few
LARGEST_JOINT_FIT = 1500
"""Monomials of a factor in which symbols are entangled; their coefficients are solved for together."""
FEW_SYMBOLS = 8
"""Symbols up to which each is changed by itself at once, which takes less time than bisection."""

_Sections = dict[str, Section]


class Fitting:
    """Finds the monomials of functions, and their coefficients in one field."""

    def __init__(
        self,
        unknown: UnknownFunctions,
        field: PrimeField,
        rng: np.random.Generator,
        work: Work,
    ) -> None:
        self.unknown, self.field, self.rng, self.work = unknown, field, rng, work
        self.anchor = self._point()
        self._entangled: dict[object, Residual | None] = {}

    def run(self) -> list[Fit | None]:
        """The functions that could be fitted within the budget."""
        depends = self._dependence()
        found = self._all_sections(depends)
        entangled = self._entangled_symbols(found)
        at_anchor = {
            s: np.array([value], dtype=np.int64) for s, value in self.anchor.items()
        }
        values = persistent(lambda: self._values(at_anchor, 1))[:, 0]
        numerators = []
        for index, parts in enumerate(found):
            denominator = (
                None
                if parts is None
                else self._denominator(index, parts, entangled[index])
            )
            if parts is not None and denominator is not None:
                numerators.append(
                    self._numerator(index, parts, denominator, int(values[index]))
                )
        sparse = SparseInterpolation(
            self.unknown, self.field, self.rng, self.anchor, self.work
        )
        fits: list[Fit | None] = [None] * len(found)
        for numerator in sparse.finish(numerators):
            fits[numerator.index] = numerator.fit(self.field)
        return fits

    def _point(self) -> dict[str, int]:
        return {
            s: int(self.field.draw(self.rng, (1,))[0]) for s in self.unknown.symbols
        }

    def _values(self, geometry: Geometry, count: int) -> Residues:
        self.work.spend(count * self.unknown.cost)
        return self.unknown.values(self.field, geometry, count)

    # -- which symbols matter ------------------------------------------------------------------------------------

    def _dependence(self) -> list[list[str]]:
        """For each function, the symbols that change it."""
        depends: list[list[str]] = [[] for _ in self.unknown.degrees]
        pending = [list(self.unknown.symbols)] if self.unknown.symbols else []
        if len(self.unknown.symbols) <= FEW_SYMBOLS:
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
        pending = {
            name: [i for i, names in enumerate(depends) if name in names]
            for name in self.unknown.symbols
        }
        for nodes in _NODES:
            pending = {name: indices for name, indices in pending.items() if indices}
            for name, row in persistent(
                partial(self._lines, self.anchor, pending, nodes)
            ).items():
                for index, section in zip(pending[name], row, strict=True):
                    if section is not None:
                        found[index][name] = section
                pending[name] = [i for i in pending[name] if name not in found[i]]
        return [
            parts if len(parts) == len(names) else None
            for parts, names in zip(found, depends, strict=True)
        ]

    def _lines(
        self, anchor: Mapping[str, int], wanted: Mapping[str, Sequence[int]], nodes: int
    ) -> dict[str, list[Section | None]]:
        """Some functions along some symbols, from an anchor."""
        if not wanted:
            return {}
        geometry = {
            s: np.full(nodes * len(wanted), value) for s, value in anchor.items()
        }
        for k, name in enumerate(wanted):
            geometry[name][k * nodes : (k + 1) * nodes] = self.field.draw(
                self.rng, (nodes,)
            )
        values = self._values(geometry, nodes * len(wanted))
        found = {}
        for k, (name, indices) in enumerate(wanted.items()):
            block = slice(k * nodes, (k + 1) * nodes)
            angle = name in self.unknown.angles
            found[name] = sections(
                geometry[name][block],
                values[list(indices), block],
                self.field,
                angle=angle,
            )
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
        for name, row in persistent(
            lambda: self._lines(self._point(), wanted, nodes)
        ).items():
            for index, other in zip(wanted[name], row, strict=True):
                parts = found[index]
                if parts is not None and (
                    other is None or other.denominator != parts[name].denominator
                ):
                    entangled[index].append(name)
        return entangled

    def _denominator(
        self, index: int, parts: _Sections, entangled: Sequence[str]
    ) -> Residual | None:
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
                self._entangled[key] = persistent(
                    partial(self._entangled_factor, index, joint)
                )
            shared = self._entangled[key]
            if shared is None:
                return None
            factors.append(shared)
        return multiplied(factors, self.field)

    def _entangled_factor(self, index: int, parts: _Sections) -> Residual | None:
        count = entangled_size(parts, self.unknown.angles)
        if count > LARGEST_JOINT_FIT or not self.work.take(SOLVING * count**3):
            return None
        geometry = {s: np.full(count, value) for s, value in self.anchor.items()}
        geometry |= {name: self.field.draw(self.rng, (count,)) for name in parts}
        values = self._values(geometry, count)[index]
        return entangled_factor(
            parts, self.unknown.angles, self.field, geometry, values
        )

    # -- numerators ----------------------------------------------------------------------------------------------

    def _numerator(
        self, index: int, parts: _Sections, denominator: Residual, value: int
    ) -> Numerator:
        """The numerator at the anchor, to be extended."""
        lengths = self.unknown.lengths
        below = {
            sum(e for g, e in monomial if g in lengths) for monomial in denominator
        }
        homogeneous = len(below) == 1 and any(name in lengths for name in parts)
        degree = self.unknown.degrees[index] + below.pop() if homogeneous else None
        point = {s: np.array([x], dtype=np.int64) for s, x in self.anchor.items()}
        start = (
            value * int(evaluated(denominator, self.field, point, 1)[0]) % self.field.p
        )
        if not start and parts:
            raise DegenerateSampleError("a function vanishes at the anchor")
        terms: Residual = {(): start} if start else {}
        return Numerator(
            index,
            denominator,
            {name: s.top for name, s in parts.items()},
            degree,
            terms,
        )


@dataclass(eq=False)
class Numerator:
    """A numerator that is being found."""

    index: int  # of the function
    denominator: Residual
    degrees: Mapping[str, int]  # degree in every symbol of the function
    length_degree: (
        int | None
    )  # degree in all lengths together, or None if the function is not homogeneous in them
    terms: Residual  # in the symbols seen so far, the others held

    def fit(self, field: PrimeField) -> Fit:
        """The finished quotient."""
        ansatz = Ansatz(tuple(self.terms), tuple(self.denominator))
        return ansatz, normalised(
            [*self.terms.values(), *self.denominator.values()], field
        )


@dataclass(frozen=True)
class SparseInterpolation:
    """Sparse interpolation of numerators, one symbol after another, within a budget of work."""

    unknown: UnknownFunctions
    field: PrimeField
    rng: np.random.Generator
    anchor: Mapping[str, int]  # values of the symbols that are held
    work: Work

    def finish(self, numerators: Sequence[Numerator]) -> list[Numerator]:
        """Numerators whose terms in all symbols were found within the budget."""
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
            missing = (numerator.length_degree or 0) - sum(
                e for g, e in monomial if g in self.unknown.lengths
            )
            if missing < 0:
                raise DegenerateSampleError("a term has more lengths than the function")
            power = ((name, missing),) if missing else ()
            terms[tuple(sorted((*monomial, *power)))] = (
                coefficient * pow(share, missing, p) % p
            )
        numerator.terms = terms

    # -- any other symbol ----------------------------------------------------------------------------------------

    def _extend(
        self, numerators: list[Numerator], known: Sequence[str], name: str
    ) -> list[Numerator]:
        """Add a symbol to some numerators; returns those that the budget does not allow."""
        bases = {
            n.index: symbol_basis(
                name, n.degrees[name], angle=name in self.unknown.angles
            )
            for n in numerators
        }
        growing = sorted(numerators, key=lambda n: len(n.terms) * len(bases[n.index]))
        failed = [n for n in growing if len(n.terms) > self.work.terms]
        growing = [n for n in growing if len(n.terms) <= self.work.terms]
        while growing:
            points = max(len(n.terms) for n in growing)
            nodes = max(len(bases[n.index]) for n in growing)
            solving = sum(len(n.terms) ** 3 for n in growing) * SOLVING
            if self.work.take(points * nodes * self.unknown.cost + solving):
                break
            failed.append(growing.pop())
        if growing:
            persistent(
                partial(self._extend_all, growing, known, name, bases, (points, nodes))
            )
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
            bottom = evaluated(
                numerator.denominator, field, geometry, count * nodes
            ).reshape(count, nodes)
            right = (values[numerator.index, :count] * bottom % field.p)[
                :, : len(basis)
            ]
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
        raise DegenerateSampleError(
            "random points do not tell the monomials apart"
        ) from None
    return np.array([int(x) for x in solution.entries()], dtype=np.int64).reshape(
        rows, columns
    )
