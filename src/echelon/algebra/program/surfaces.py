"""Which surfaces cut the real inputs into regions, and in which products their signs enter the outputs.

A sign is constant on a region.  Logarithms and roots bound the domain, and the signs of the factors of their arguments
tell its pieces apart.  So do those of denominators in arc tangents, which jump there.  An output is a polynomial in the
signs with coefficients that know nothing of them, so what matters of a region are the values that the *products* of
signs have there, and of those only the ones that occur: signs that are only added never need to be combined.
Values of surfaces at real points are in double precision and, where it decides, in ball arithmetic.

Some combinations of signs cannot occur, because surfaces are parallel: v > d and v < −d of a dead zone.  Every surface
is written as Σ ratio · atom + constant with exact numbers, where an atom is whatever is not a sum or a
multiple.  If f = c·g + k, some of the four combinations of their signs are impossible.  Then products with them vanish,
(1 ± sign f)(1 ± sign g)·s = 0, and so many fewer regions tell all products apart.

A row of a model is Σ s_T·A_T, with s_T the product T of signs in its region and A_T functions that know nothing of the
signs.  What vanishes in some regions vanishes in every region whose vector (s_T) is a combination of theirs.  So a
region adds something only if its vector is independent of those before, and as many regions as there are products
are enough, however many exist: 31 for the friction of 30 joints, whose signs make 2^30.  Vectors are compared modulo a
prime; their entries are 0 and ±1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.field import PrimeField, rank
from echelon.algebra.exact.polynomial import Rational
from echelon.algebra.program.arithmetics import BallArithmetic, ball
from echelon.algebra.program.intervals import interval_values
from echelon.algebra.program.operations import Op
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.tape import Program
from echelon.shared import Floats, SignArray

_MOST_MAXIMAL = 256
"""Maximal products followed through a program; more are taken together, which only asks for more regions."""
_DOMAIN = (Op.LOG, Op.SQRT)


@dataclass(frozen=True)
class Surfaces:
    """Where signs change and where the domain ends."""

    program: Program
    # whose zeros are the surfaces: arguments of signs, factors of those of logarithms and roots, and denominators in
    # arc tangents
    nodes: tuple[int, ...]
    signs: frozenset[int]  # those of ``nodes`` that are arguments of signs
    entire: bool  # whether there are no logarithms, roots and arc tangents, whose domains have pieces
    positive: tuple[
        int, ...
    ]  # arguments of logarithms and roots, which are positive in the domain
    nonzero: tuple[int, ...]  # denominators with signs, which could vanish on a region
    nested: frozenset[
        int
    ]  # those of ``nodes`` whose value contains a sign: they may vanish on a whole region
    inputs: tuple[int, ...]  # the inputs that all of these depend on
    # maximal sets of ``nodes`` whose signs are multiplied with each other in an output
    maximal: tuple[frozenset[int], ...]


def find_surfaces(program: Program, outputs: Sequence[int]) -> Surfaces:
    """The surfaces of some outputs."""
    ops, lhs = program.ops, program.lhs
    needed = program.needed(outputs)
    positive = {lhs[n] for n in needed if ops[n] in _DOMAIN}
    signs = {lhs[n] for n in needed if ops[n] == Op.SIGN}
    pieces = {pole for n in needed if ops[n] == Op.ATAN for pole in _poles(program, n)}
    pieces |= {f for n in positive for f in _factors(program, n) if f not in positive}
    nodes = tuple(sorted(signs | pieces))
    entire = not any(ops[n] in (*_DOMAIN, Op.ATAN) for n in needed)
    nested = frozenset(n for n in nodes if _jumps(program, n))
    below = (
        sorted({program.rhs[n] for n in needed if ops[n] == Op.DIV}) if signs else []
    )
    nonzero = tuple(n for n in below if _jumps(program, n))
    inputs = tuple(
        n for n in program.needed([*nodes, *positive, *nonzero]) if ops[n] == Op.INPUT
    )
    products = _products(program, outputs, nodes)
    return Surfaces(
        program,
        nodes,
        frozenset(signs),
        entire,
        tuple(sorted(positive)),
        nonzero,
        nested,
        inputs,
        products,
    )


def _jumps(program: Program, node: int) -> bool:
    """Whether there is a sign in a node."""
    return any(program.ops[n] == Op.SIGN for n in program.needed([node]))


def _poles(program: Program, node: int) -> set[int]:
    """Denominators in an arc tangent, which may jump where they vanish."""
    return {
        program.rhs[n] for n in program.needed([node]) if program.ops[n] == Op.DIV
    } - program.constants.keys()


def _factors(program: Program, node: int) -> set[int]:
    """Whatever is multiplied in a node and is not a number."""
    found, pending = set(), [node]
    while pending:
        n = pending.pop()
        op = program.ops[n]
        if op in (Op.MUL, Op.DIV):
            pending += [program.lhs[n], program.rhs[n]]
        elif op in (Op.NEG, Op.SQRT):
            pending.append(program.lhs[n])
        elif op not in (Op.CONSTANT, Op.EXP, Op.SIGN):
            found.add(n)
    return found


_Masks = tuple[int, ...]  # maximal products, each the bits of its surfaces


def _products(
    program: Program, outputs: Sequence[int], nodes: Sequence[int]
) -> tuple[frozenset[int], ...]:
    """Maximal sets of surfaces whose signs are multiplied in an output."""
    bit = {n: 1 << k for k, n in enumerate(nodes)}
    found: dict[int, _Masks] = {-1: (0,)}
    touched: dict[int, int] = {-1: 0}
    for n in program.needed(outputs):
        op, a, b = Op(program.ops[n]), program.lhs[n], program.rhs[n]
        touched[n] = touched[a] | touched[b]
        if op is Op.SIGN:
            touched[n] |= bit[a]
        elif op in _DOMAIN:
            touched[n] |= sum(bit.get(f, 0) for f in _factors(program, a))
        elif op is Op.ATAN:
            touched[n] |= sum(bit[pole] for pole in _poles(program, n))
        if op is Op.SIGN:
            found[n] = (bit[a],)
        else:
            found[n] = (
                (touched[n],)
                if op >= Op.SIN
                else _operated(op, found[a], found[b], touched[b])
            )
    masks = _maximal([m for n in outputs for m in found[n]])
    return tuple(frozenset(n for n in nodes if bit[n] & m) for m in masks)


def _operated(op: Op, a: _Masks, b: _Masks, below: int) -> _Masks:
    if op is Op.DIV and below:
        b = (below,)
    if b == (0,) or a == b:
        if b == (0,) or op is not Op.MUL or len(a) == 1:
            return a
        return _maximal([x | y for x in a for y in b])
    if a == (0,):
        return b
    return _maximal(
        [*a, *b] if op in (Op.ADD, Op.SUB) else [x | y for x in a for y in b]
    )


def _maximal(masks: Iterable[int]) -> _Masks:
    kept: list[int] = []
    for mask in sorted(set(masks), key=lambda m: (-m.bit_count(), m)):
        if not any(mask & other == mask for other in kept):
            kept.append(mask)
    if len(kept) <= _MOST_MAXIMAL:
        return tuple(kept)
    together = 0
    for mask in kept:
        together |= mask
    return (together,)


def monomials(
    surfaces: Surfaces, constant: Mapping[int, int], most: int
) -> list[tuple[tuple[int, int], ...]] | None:
    """All products of powers of signs that may occur."""
    found: set[tuple[tuple[int, int], ...]] = {()}
    for product in surfaces.maximal:
        variables = [n for n in sorted(product) if n not in constant]
        if len(variables) > most.bit_length():
            return None
        own: list[tuple[tuple[int, int], ...]] = [()]
        for n in variables:
            powers = (1, 2) if n in surfaces.nested else (1,)
            own += [(*m, (n, e)) for m in own for e in powers]
        found.update(own)
        if len(found) > most:
            return None
    return sorted(found, key=lambda m: (len(m), m))


_BITS = (128, 512)


class RealValues:
    """Evaluates surfaces at real points."""

    def __init__(
        self, surfaces: Surfaces, constants: Mapping[int, Rational | float]
    ) -> None:
        self.surfaces, self.constants = surfaces, constants
        self.variables = [n for n in surfaces.inputs if n not in constants]
        program = surfaces.program
        rows = [*surfaces.nodes, *surfaces.positive, *surfaces.nonzero]
        self._schedule = Schedule(program, rows)
        place = {n: k for k, n in enumerate(self.variables)}
        self.spheres = [
            [place[n] for n in group]
            for group in program.unit_groups
            if all(n in place for n in group)
        ]
        self.cones = [self._cone(n) for n in rows]
        self._nested = np.array(
            [n in surfaces.nested for n in surfaces.nodes], dtype=bool
        )

    def _cone(self, node: int) -> list[int]:
        """Places of the variables that a surface depends on."""
        needed = set(self.surfaces.program.needed([node]))
        return [k for k, n in enumerate(self.variables) if n in needed]

    def normal(self, points: Floats) -> Floats:
        """Points with quaternions of unit length."""
        for group in self.spheres:
            size = np.sqrt((points[group] ** 2).sum(axis=0))
            points[group] /= np.where(size > 0, size, 1.0)
        return points

    def at(self, points: Floats) -> Floats:
        """Values of the surfaces, then of what must be positive, and of what must not vanish."""
        # shapes: points (variables, points); returns (surfaces + positive + nonzero, points)
        count = points.shape[1]
        leaves = {n: points[k] for k, n in enumerate(self.variables)}
        leaves |= {
            n: np.full(count, float(value)) for n, value in self.constants.items()
        }
        with np.errstate(all="ignore"):
            return np.asarray(
                self._schedule.run(FloatArithmetic(), leaves, count), dtype=np.float64
            )

    def inside(self, values: Floats) -> npt.NDArray[np.bool_]:
        """Which points are in the domain and on no surface, but for those that may vanish on a region."""
        count = len(self.surfaces.nodes)
        good = self.in_domain(values)
        good &= ((values[:count] != 0) | self._nested[:, None]).all(axis=0)
        return np.asarray(good, dtype=bool)

    def in_domain(self, values: Floats) -> npt.NDArray[np.bool_]:
        """Which points are in the domain."""
        first = len(self.surfaces.nodes)
        last = len(self.surfaces.nodes) + len(self.surfaces.positive)
        good = (
            ~np.isnan(values).any(axis=0)
            & (values[first:last] > 0).all(axis=0)
            & (values[last:] != 0).all(axis=0)
        )
        return np.asarray(good, dtype=bool)

    def certain(
        self, point: Floats, free: frozenset[int] = frozenset()
    ) -> SignArray | None:
        """The signs at a point as ball arithmetic proves them, None if it cannot."""
        # shapes: point (variables,); returns (surfaces,)
        count = len(self.surfaces.nodes)
        for bits in _BITS:
            values = self._balls(point, bits)
            last = count + len(self.surfaces.positive)
            if not (
                all(v > 0 for v in values[count:last])
                and all(v != 0 for v in values[last:])
            ):
                continue
            known = [
                self._sign(v, bits, nested)
                for v, nested in zip(values, self._nested, strict=False)
            ]
            if all(
                s is not None or n in free
                for s, n in zip(known, self.surfaces.nodes, strict=True)
            ):
                return np.array([s or 0 for s in known], dtype=np.int8)
        return None

    def _sign(self, value: flint.arb, bits: int, nested: bool) -> int | None:
        if value > 0 or value < 0:
            return 1 if value > 0 else -1
        if (
            nested
            and bits == _BITS[-1]
            and value.is_finite()
            and value.rad() < 2.0 ** (-bits / 2)
        ):
            return 0
        return None

    def _balls(self, point: Floats, bits: int) -> list[flint.arb]:
        before = flint.ctx.prec
        try:
            flint.ctx.prec = bits
            known = {
                n: ball(x if isinstance(x, float) else Fraction(x))
                for n, x in self.constants.items()
            }
            known |= {
                n: ball(float(x)) for n, x in zip(self.variables, point, strict=True)
            }
            leaves = {n: np.array([x], dtype=object) for n, x in known.items()}
            return [row[0] for row in self._schedule.run(BallArithmetic(), leaves, 1)]
        finally:
            flint.ctx.prec = before

    def vanishing(self, points: Floats) -> frozenset[int]:
        """Surfaces that ball arithmetic cannot tell from zero at any of some points of the domain."""
        count = len(self.surfaces.nodes)
        suspects = set(self.surfaces.nodes) - set(self.variables)
        for point in points.T:
            if not suspects:
                break
            values = self._balls(point, _BITS[-1])
            suspects -= {
                n
                for n, v in zip(self.surfaces.nodes, values[:count], strict=True)
                if v > 0 or v < 0
            }
        return frozenset(suspects) if points.shape[1] else frozenset()

    def one_sided(self) -> dict[int, int]:
        """Surfaces whose values have one sign everywhere by interval arithmetic, or in the domain."""
        program, surfaces = self.surfaces.program, self.surfaces
        everything = (np.asarray(-np.inf), np.asarray(np.inf))
        inputs = dict.fromkeys(self.variables, everything)
        inputs |= {
            n: (np.asarray(float(x)), np.asarray(float(x)))
            for n, x in self.constants.items()
        }
        found = {n: 1 for n in surfaces.nodes if n in surfaces.positive}
        for n, (low, high) in zip(
            surfaces.nodes,
            interval_values(program, surfaces.nodes, inputs),
            strict=True,
        ):
            if n not in surfaces.nested and (low >= 0 or high <= 0):
                found[n] = 1 if low >= 0 else -1
        return found


Combination = tuple[tuple[int, int], tuple[int, int]]  # two surfaces with a sign each

_Linear = dict[int, Fraction]  # ratios of atoms; −1 for the constant
_FIELD = PrimeField.of(2**31 - 105)
MOST_ATOMS = 64
"""Terms of a linear form; longer ones are hardly ever parallel to another."""


def impossible(
    surfaces: Surfaces, constants: Mapping[int, Rational | float]
) -> list[Combination]:
    """Pairs of signs that cannot occur together."""
    together = {
        pair
        for product in surfaces.maximal
        for pair in combinations(sorted(product - surfaces.nested), 2)
    }
    forms = _linear_forms(
        surfaces.program, [n for pair in together for n in pair], constants
    )
    return [
        found
        for f, g in sorted(together)
        for found in _excluded(f, g, forms[f], forms[g])
    ]


def _linear_forms(
    program: Program, nodes: Sequence[int], constants: Mapping[int, Rational | float]
) -> dict[int, _Linear]:
    """Nodes, and all that they depend on, as combinations of atoms."""
    forms: dict[int, _Linear] = {}
    for node in program.needed(nodes):
        found = _combined(program, node, constants, forms)
        forms[node] = (
            found
            if found is not None and len(found) <= MOST_ATOMS
            else {node: Fraction(1)}
        )
    return forms


def _combined(
    program: Program,
    node: int,
    constants: Mapping[int, Rational | float],
    forms: Mapping[int, _Linear],
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
    total = {
        n: a.get(n, Fraction(0)) + factor * b.get(n, Fraction(0)) for n in {**a, **b}
    }
    return {n: value for n, value in total.items() if value}


def _excluded(f: int, g: int, of_f: _Linear, of_g: _Linear) -> list[Combination]:
    """Combinations of signs that f = c·g + k excludes, if there are such c and k."""
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


def relations(
    products: Sequence[tuple[tuple[int, int], ...]], excluded: Sequence[Combination]
) -> int:
    """The number of independent relations between products of signs that excluded combinations bring."""
    place = {product: k for k, product in enumerate(products)}
    known = {n for product in products for n, _ in product}
    rows = []
    for (f, s), (g, t) in excluded:
        for product in products:
            nodes = {n for n, _ in product}
            if (
                {f, g} <= known
                and not nodes & {f, g}
                and all(e == 1 for _, e in product)
            ):
                terms = [(1, set()), (s, {f}), (t, {g}), (s * t, {f, g})]
                keys = [
                    (sign, tuple((n, 1) for n in sorted(nodes | more)))
                    for sign, more in terms
                ]
                if all(key in place for _, key in keys):
                    row = np.zeros(len(products), dtype=np.int64)
                    for sign, key in keys:
                        row[place[key]] = sign % _FIELD.p
                    rows.append(row)
    return rank(np.stack(rows), _FIELD) if rows else 0


_PRIME = 1_048_573
"""The largest prime below 2^20: then products of matrices of a thousand columns are exact in double precision."""


class IndependentRegions:
    """The vectors of the regions so far, in reduced echelon form."""

    def __init__(
        self, products: Sequence[tuple[tuple[int, int], ...]] | None, relations: int = 0
    ) -> None:
        self._every, self._relations = products is None, relations
        self.products = list(products or ())
        self._place = {product: k for k, product in enumerate(self.products)}
        self._basis: Floats = np.zeros((0, len(self.products)))
        self._pivots: list[int] = []

    @property
    def rank(self) -> int:
        """Number of independent regions so far."""
        return len(self._pivots)

    @property
    def complete(self) -> bool:
        """Whether no other region can add anything."""
        return not self._every and self.rank + self._relations == len(self.products)

    def rests(self, signs: SignArray) -> Floats:
        """Residuals of the vectors of some regions modulo those included so far."""
        # shapes: signs (surfaces, regions); returns (regions, products)
        vectors = np.ones((signs.shape[1], len(self.products)))
        for k, product in enumerate(self.products):  # shorter ones come first
            if product:
                row, exponent = product[-1]
                shorter = vectors[:, self._place[product[:-1]]]
                vectors[:, k] = shorter * signs[row].astype(np.float64) ** exponent
        return (vectors - vectors[:, self._pivots] @ self._basis) % _PRIME

    def adds(self, signs: SignArray) -> npt.NDArray[np.bool_]:
        """Which regions add something, each by itself."""
        return np.asarray(self.rests(signs).any(axis=1) | self._every, dtype=bool)

    def include(self, signs: SignArray, accept: Callable[[int], bool]) -> list[int]:
        """Include those of some regions, in their order, that add something to the earlier ones."""
        # shapes: signs (surfaces, regions)
        if self._every:
            return [k for k in range(signs.shape[1]) if accept(k)]
        rests, included = self.rests(signs), []
        for k in range(len(rests)):
            places = np.flatnonzero(rests[k])
            if not len(places) or not accept(k):
                continue
            pivot = int(places[0])
            row = rests[k] * pow(int(rests[k, pivot]), -1, _PRIME) % _PRIME
            rests[k + 1 :] = (
                rests[k + 1 :] - np.outer(rests[k + 1 :, pivot], row)
            ) % _PRIME
            self._basis = np.vstack(
                [(self._basis - np.outer(self._basis[:, pivot], row)) % _PRIME, row]
            )
            self._pivots.append(pivot)
            included.append(k)
        return included
