"""Combinations of signs that cannot occur, because surfaces are parallel: v > d and v < −d of a dead zone.

Every surface is written as Σ ratio · atom + constant with exact numbers, where an atom is whatever is not a sum or a
multiple.  If f = c·g + k, some of the four combinations of their signs are impossible.  Then products with them vanish,
(1 ± sign f)(1 ± sign g)·s = 0, and so many fewer regions tell all products apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np

from echelon.exact.elimination import rank
from echelon.exact.field import PrimeField
from echelon.exact.numbers import Rational
from echelon.program.operations import Op
from echelon.program.surfaces import Surfaces
from echelon.program.tape import Program

Combination = tuple[tuple[int, int], tuple[int, int]]
"""Two surfaces with a sign each."""

_Linear = dict[int, Fraction]  # ratios of atoms; −1 for the constant
_FIELD = PrimeField.of(2**31 - 105)
_MOST_ATOMS = 64


def impossible(surfaces: Surfaces, constants: Mapping[int, Rational | float]) -> list[Combination]:
    """Pairs of signs that cannot occur together."""
    together = {pair for product in surfaces.maximal for pair in combinations(sorted(product - surfaces.nested), 2)}
    forms = _linear_forms(surfaces.program, [n for pair in together for n in pair], constants)
    return [found for f, g in sorted(together) for found in _excluded(f, g, forms[f], forms[g])]


def _linear_forms(
    program: Program, nodes: Sequence[int], constants: Mapping[int, Rational | float]
) -> dict[int, _Linear]:
    """Nodes, and all that they depend on, as combinations of atoms."""
    forms: dict[int, _Linear] = {}
    for node in program.needed(nodes):
        found = _combined(program, node, constants, forms)
        forms[node] = found if found is not None and len(found) <= _MOST_ATOMS else {node: Fraction(1)}
    return forms


def _combined(
    program: Program, node: int, constants: Mapping[int, Rational | float], forms: Mapping[int, _Linear]
) -> _Linear | None:
    """A node by the forms of its operands; None if it is an atom."""
    number = constants.get(node, program.constants.get(node))
    if isinstance(number, int | Fraction | float):
        return {-1: Fraction(number)} if number else {}
    op, a, b = Op(program.ops[node]), program.lhs[node], program.rhs[node]
    if op is Op.NEG:
        return _sum({}, forms[a], -1)
    if op in (Op.ADD, Op.SUB):
        return _sum(forms[a], forms[b], 1 if op is Op.ADD else -1)
    if op is Op.MUL:
        for factor, other in ((a, b), (b, a)):
            if forms[factor].keys() <= {-1}:
                return _sum({}, forms[other], forms[factor].get(-1, Fraction(0)))
    return None


def _sum(a: _Linear, b: _Linear, factor: Rational) -> _Linear:
    total = {n: a.get(n, Fraction(0)) + factor * b.get(n, Fraction(0)) for n in {**a, **b}}
    return {n: value for n, value in total.items() if value}


def _excluded(f: int, g: int, of_f: _Linear, of_g: _Linear) -> list[Combination]:
    """What f = c·g + k excludes, if there are such numbers."""
    atoms = of_g.keys() - {-1}
    if not atoms or atoms != of_f.keys() - {-1}:
        return []
    ratios = {of_f[n] / of_g[n] for n in atoms}
    if len(ratios) > 1:
        return []
    c = ratios.pop()
    k = of_f.get(-1, Fraction(0)) - c * of_g.get(-1, Fraction(0))
    side = 1 if c > 0 else -1
    found = []
    if k >= 0:  # where c·g is positive, so is f
        found.append(((f, -1), (g, side)))
    if k <= 0:
        found.append(((f, 1), (g, -side)))
    return found


def relations(products: Sequence[tuple[tuple[int, int], ...]], excluded: Sequence[Combination]) -> int:
    """The number of independent relations between products of signs that excluded combinations bring."""
    place = {product: k for k, product in enumerate(products)}
    known = {n for product in products for n, _ in product}
    rows = []
    for (f, s), (g, t) in excluded:
        for product in products:
            nodes = {n for n, _ in product}
            if {f, g} <= known and not nodes & {f, g} and all(e == 1 for _, e in product):
                terms = [(1, set()), (s, {f}), (t, {g}), (s * t, {f, g})]
                keys = [(sign, tuple((n, 1) for n in sorted(nodes | more))) for sign, more in terms]
                if all(key in place for _, key in keys):
                    row = np.zeros(len(products), dtype=np.int64)
                    for sign, key in keys:
                        row[place[key]] = sign % _FIELD.p
                    rows.append(row)
    return rank(np.stack(rows), _FIELD) if rows else 0
