"""Vectorised evaluation of a program: one NumPy call per level and kind of operation; random points; bounds.

Walking a program node by node costs a microsecond of Python per operation, whatever the number of samples.  So nodes
are sorted into levels (a node is one level above its operands) and all operations of one kind in one level are done
together on a (operation, sample) array.  The same schedule serves every arithmetic: doubles, residues, power series,
and balls.

At random points of a prime field angles are points of the unit circle and quaternions points of the unit sphere, so
that exactly the relations hold which hold for all real values.

A false identity of quotients of polynomials survives a random point with a probability that its degree bounds, and a
random prime with one that the size of its coefficients bounds.  Both follow from the program, node by node.  The size
of a polynomial is its 1-norm: the sum of its coefficients' absolute values, where a + b√2 + c√3 + d√6 counts as
|a| + |b|√2 + |c|√3 + |d|√6.  That of a sum or product is at most the sum or product of those.  Coefficients are made
whole by one common denominator of all constants, whose power is carried along.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import lcm, log2, sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.field import PrimeField, Residues
from echelon.algebra.exact.polynomial import Number, Polynomial, parts_of
from echelon.algebra.program.operations import FUNCTIONS, Op
from echelon.algebra.program.tape import Program
from echelon.shared import EchelonError

Array = npt.NDArray[Any]


BLOCK = 1024
"""Samples that are evaluated together, so that the table of intermediate values stays in a cache."""


class Arithmetic(Protocol):
    """Arithmetic that a schedule runs in."""

    dtype: npt.DTypeLike
    shape: tuple[
        int, ...
    ]  # axes of a single number: none, or one for the coefficients of a series

    def constant(self, value: Number) -> float | int | Array:
        """Embed an exact constant."""

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """ADD, SUB, MUL or DIV of arrays."""

    def unary(self, op: int, a: Array) -> Array:
        """NEG or a function of an array."""


@dataclass(frozen=True)
class _Group:
    """Operations of one kind in one level: rows [start, stop) from rows lhs and rhs."""

    op: int
    start: int
    stop: int
    lhs: npt.NDArray[np.intp]
    rhs: npt.NDArray[np.intp]


class Schedule:
    """The part of a program that some outputs need, ordered for vectorised evaluation."""

    def __init__(
        self, program: Program, outputs: Sequence[int], leaves: Iterable[int] = ()
    ) -> None:
        given = set(leaves)
        needed = program.needed(outputs, given)
        self.program = program
        self.leaves = [n for n in needed if n in given or program.ops[n] == Op.INPUT]
        self._constants = [
            n for n in needed if program.ops[n] == Op.CONSTANT and n not in given
        ]
        self._row: dict[int, int] = {
            n: i for i, n in enumerate(self.leaves + self._constants)
        }
        self._groups = self._sort(needed)
        self._outputs = np.array([self._row[n] for n in outputs], dtype=np.intp)
        self.size = len(self._row)

    def _sort(self, needed: list[int]) -> list[_Group]:
        ops, lhs, rhs = self.program.ops, self.program.lhs, self.program.rhs
        level: dict[int, int] = dict.fromkeys(self._row, 0)
        buckets: dict[tuple[int, int], list[int]] = {}
        for node in needed:
            if node in level:
                continue
            a, b = lhs[node], rhs[node]
            height = 1 + (level[a] if b < 0 else max(level[a], level[b]))
            level[node] = height
            buckets.setdefault((height, ops[node]), []).append(node)
        groups = []
        for (_, op), nodes in sorted(buckets.items()):
            start = len(self._row)
            for node in nodes:
                self._row[node] = len(self._row)
            left = np.array([self._row[lhs[n]] for n in nodes], dtype=np.intp)
            right = np.array(
                [self._row[rhs[n]] if rhs[n] >= 0 else 0 for n in nodes], dtype=np.intp
            )
            groups.append(_Group(op, start, len(self._row), left, right))
        return groups

    def run(
        self, arithmetic: Arithmetic, values: Mapping[int, Array], samples: int
    ) -> Array:
        """Evaluate the outputs."""
        # shapes: values (samples, *arithmetic.shape); returns (outputs, samples, *arithmetic.shape)
        table: Array = np.empty(
            (self.size, samples, *arithmetic.shape), dtype=arithmetic.dtype
        )
        for node in self.leaves:
            table[self._row[node]] = values[node]
        for node in self._constants:
            table[self._row[node]] = arithmetic.constant(self.program.constants[node])
        for group in self._groups:
            left = table[group.lhs]
            if group.op in (Op.ADD, Op.SUB, Op.MUL, Op.DIV):
                table[group.start : group.stop] = arithmetic.binary(
                    group.op, left, table[group.rhs]
                )
            else:
                table[group.start : group.stop] = arithmetic.unary(group.op, left)
        return table[self._outputs]


class StagedSchedule:
    """The part of a program that some outputs need, in two stages: what depends on symbols alone, and all else.

    Frames turned by many general angles make most of a program; they need no evaluation at every state.
    """

    def __init__(self, program: Program, outputs: Sequence[int]) -> None:
        kept = _constant_frontier(program, outputs)
        self.program = program
        self.constants = Schedule(program, kept)
        self.moving = Schedule(program, outputs, kept)
        self._kept = kept
        self.leaves = [node for node in self.moving.leaves if node not in set(kept)]

    @property
    def size(self) -> int:
        """Operations at every state."""
        return self.moving.size

    def kept(
        self, arithmetic: Arithmetic, symbols: Mapping[str, Array], count: int
    ) -> dict[int, Array]:
        """Arrays of shape (count,) of the nodes that depend on symbols alone, at ``count`` sets of symbol values."""
        names = {node: self.program.inputs[node].name for node in self.constants.leaves}
        found = self.constants.run(
            arithmetic, {node: symbols[name] for node, name in names.items()}, count
        )
        return dict(zip(self._kept, found, strict=True))


def _constant_frontier(program: Program, outputs: Sequence[int]) -> list[int]:
    """Nodes that depend on symbols and on no state, and that something else needs: an output, or what does depend."""
    needed = program.needed(outputs)
    moves = dict[int, bool]()
    for node in needed:
        if program.ops[node] == Op.INPUT:
            moves[node] = program.inputs[node].role != "symbol"
        elif program.ops[node] == Op.CONSTANT:
            moves[node] = False
        else:
            operands = [n for n in (program.lhs[node], program.rhs[node]) if n >= 0]
            moves[node] = any(moves[n] for n in operands)
    used = set(outputs)
    for node in needed:
        if moves[node] and program.ops[node] not in (Op.INPUT, Op.CONSTANT):
            used |= {n for n in (program.lhs[node], program.rhs[node]) if n >= 0}
    return [
        node
        for node in needed
        if node in used and not moves[node] and program.ops[node] != Op.CONSTANT
    ]


_FLOAT_FUNCTIONS: dict[Op, Any] = {
    op: getattr(np, op.name.lower()) for op in FUNCTIONS if op is not Op.ATAN
}
_FLOAT_FUNCTIONS |= {Op.NEG: np.negative, Op.ATAN: np.arctan}
_FLOAT_BINARY = {
    Op.ADD: np.add,
    Op.SUB: np.subtract,
    Op.MUL: np.multiply,
    Op.DIV: np.divide,
}


class FloatArithmetic:
    """Double precision."""

    dtype: npt.DTypeLike = np.float64
    shape: tuple[int, ...] = ()

    def constant(self, value: Number) -> float:
        """The nearest double."""
        return float(value)

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """Elementwise operation."""
        return _FLOAT_BINARY[Op(op)](a, b)

    def unary(self, op: int, a: Array) -> Array:
        """Elementwise function."""
        result: Array = _FLOAT_FUNCTIONS[Op(op)](a)
        return result


class ModularArithmetic:
    """GF(p): int64 arrays for primes below 2^31, arrays of Python integers above."""

    shape: tuple[int, ...] = ()

    def __init__(self, field: PrimeField) -> None:
        self.field = field
        self.dtype: npt.DTypeLike = field.dtype

    def constant(self, value: Number) -> int | Array:
        """The residue."""
        return self.field.embed(value)

    def binary(self, op: int, a: Array, b: Array) -> Array:
        """Elementwise operation modulo p."""
        if op == Op.MUL:
            a *= b
        elif op == Op.ADD:
            a += b
        elif op == Op.SUB:
            a -= b
        else:
            a *= self.field.invert_array(b)
        a %= self.field.p
        return a

    def unary(self, op: int, a: Array) -> Array:
        """Negation modulo p."""
        if op != Op.NEG:
            raise EchelonError(
                f"{Op(op).name.lower()} has no exact meaning in a finite field"
            )
        return -a % self.field.p


@dataclass(frozen=True)
class Size:
    """Size of quotients of polynomials with whole coefficients, apart from one number that divides them all."""

    degree: int  # the larger total degree of numerator and denominator
    bits: float  # the larger binary logarithm of their 1-norms


class FieldSampler:
    """Evaluates outputs of a program at random points of a prime field; functions are those of :meth:`suits`.

    Programs with signs take :class:`echelon.algebra.program.sampling.SignSampler`.
    """

    def __init__(self, program: Program, outputs: Sequence[int]) -> None:
        self.program, self.outputs = program, outputs
        needed = program.needed(outputs)
        functions = [n for n in needed if program.ops[n] in CIRCULAR]
        signs = [n for n in needed if program.ops[n] == Op.SIGN]
        self._schedule = Schedule(program, outputs, (*functions, *signs))
        self._inputs = [n for n in self._schedule.leaves if n in program.inputs]
        self._functions = [
            n for n in self._schedule.leaves if program.ops[n] in CIRCULAR
        ]
        arguments = dict.fromkeys(program.lhs[n] for n in self._functions)
        self._angles = {
            n: form for n in arguments if (form := _turns(program, n)) is not None
        }

    @staticmethod
    def suits(program: Program, outputs: Sequence[int]) -> bool:
        """Whether outputs are rational functions of what is drawn, with signs that are constant in regions.

        These are inputs, points of circles for sines, cosines and tangents of rational combinations of inputs, and
        signs of anything.  Constants in angles occur there in whole multiples, and nowhere else.
        """
        signs = [n for n in program.needed(outputs) if program.ops[n] == Op.SIGN]
        functions = [
            n for n in program.needed(outputs, signs) if program.ops[n] >= Op.SIN
        ]
        circular = [n for n in functions if program.ops[n] in CIRCULAR]
        if any(program.ops[n] not in (*CIRCULAR, Op.SIGN, Op.ABS) for n in functions):
            return False
        turns = [_turns(program, program.lhs[n]) for n in circular]
        if None in turns:
            return False
        ratios = [(n, ratio) for form in turns for n, ratio in (form or {}).items()]
        constant = {
            n: ratio for n, ratio in ratios if program.inputs[n].role == "symbol"
        }
        whole = all(ratio.denominator == 1 for n, ratio in ratios if n in constant)
        return whole and (
            not constant
            or constant.keys().isdisjoint(program.needed(outputs, (*circular, *signs)))
        )

    @property
    def regions(self) -> int:
        """Number of regions into which signs cut the real points; this many states visit them all."""
        return 1

    @property
    def symbols(self) -> list[str]:
        """Constants that the outputs depend on, sorted."""
        return sorted(
            {self.program.inputs[n].name for n in self._inputs if self._is_symbol(n)}
            | self.angles
        )

    @property
    def angles(self) -> frozenset[str]:
        """Symbols whose values stand for the tangent of half of them."""
        angles = (n for form in self._angles.values() for n in form)
        return frozenset(
            self.program.inputs[n].name for n in angles if self._is_symbol(n)
        )

    @property
    def leaves(self) -> int:
        """Number of inputs and functions that the outputs are computed from."""
        return len(self._schedule.leaves)

    @property
    def leaf_size(self) -> Size:
        """Bound on a leaf as a quotient of polynomials in the independent random numbers, e.g. multiples of angles."""
        # a cosine or sine of n angles is a quotient of degree 2n, with coefficients that add up to 4ⁿ at most; a unit
        # quaternion is one of degree 2
        units = self._units()
        turns = max(
            (
                int(sum(abs(r) * units[n] for n, r in form.items()))
                for form in self._angles.values()
            ),
            default=1,
        )
        return Size(2 * turns, 2.0 * turns)

    def _units(self) -> dict[int, int]:
        """For every input of angles, into how many parts it is divided so that all angles hold whole multiples."""
        units: dict[int, int] = {}
        for form in self._angles.values():
            for node, ratio in form.items():
                units[node] = lcm(units.get(node, 1), ratio.denominator)
        return units

    def evaluate(
        self,
        field: PrimeField,
        rng: np.random.Generator,
        states: int,
        geometry: Mapping[str, Residues],
    ) -> Residues:
        """Evaluate at random states for given geometries."""
        # shapes: geometry (geometries,); returns (outputs, geometries, states)
        geometries = len(next(iter(geometry.values()))) if geometry else 1
        samples = geometries * states
        given = {name: np.repeat(value, states) for name, value in geometry.items()}

        def drawn(nodes: Iterable[int]) -> dict[int, Residues]:
            return {
                n: given[self.program.inputs[n].name]
                if self._is_symbol(n)
                else field.draw(rng, (samples,))
                for n in nodes
            }

        units = self._units()
        points = {n: field.circle(tangent) for n, tangent in drawn(units).items()}
        values = drawn(self._inputs)
        for group in self.program.unit_groups:
            if not values.keys().isdisjoint(group):
                on_sphere = field.sphere(field.draw(rng, (len(group) - 1, samples)))
                values |= {
                    n: point
                    for n, point in zip(group, on_sphere, strict=True)
                    if n in values
                }
        circles = {
            angle: _turned(form, units, points, field)
            for angle, form in self._angles.items()
        }
        for n in self._functions:
            cosine, sine = circles[self.program.lhs[n]]
            op = self.program.ops[n]
            values[n] = (
                cosine
                if op == Op.COS
                else sine
                if op == Op.SIN
                else sine * field.invert_array(cosine) % field.p
            )
        values |= self._signs(field, states, geometries)
        return self._schedule.run(ModularArithmetic(field), values, samples).reshape(
            -1, geometries, states
        )

    def _signs(
        self,
        field: PrimeField,  # noqa: ARG002
        states: int,  # noqa: ARG002
        geometries: int,  # noqa: ARG002
    ) -> dict[int, Residues]:
        """Values of signs at states of all regions in turn, (geometries · states,)."""
        return {}

    def _is_symbol(self, node: int) -> bool:
        return (
            node in self.program.inputs and self.program.inputs[node].role == "symbol"
        )


CIRCULAR = (Op.SIN, Op.COS, Op.TAN)
_Turns = dict[int, Fraction]  # an angle as a combination of inputs


def _turns(program: Program, node: int) -> _Turns | None:
    """An angle as a rational combination of inputs; None if it is none."""
    known: dict[int, _Turns | Fraction | None] = {}
    for n in program.needed([node]):
        op, a, b = program.ops[n], known.get(program.lhs[n]), known.get(program.rhs[n])
        found: _Turns | Fraction | None = None
        if op == Op.INPUT:
            found = {n: Fraction(1)}
        elif op == Op.CONSTANT:
            number = program.constants[n]
            found = Fraction(number) if isinstance(number, int | Fraction) else None
        elif op == Op.NEG and isinstance(a, dict):
            found = {x: -ratio for x, ratio in a.items()}
        elif op in (Op.ADD, Op.SUB) and isinstance(a, dict) and isinstance(b, dict):
            side = 1 if op == Op.ADD else -1
            total = {
                x: a.get(x, Fraction(0)) + side * b.get(x, Fraction(0))
                for x in {**a, **b}
            }
            found = {x: ratio for x, ratio in total.items() if ratio}
        elif op == Op.MUL:
            factor, angle = (a, b) if isinstance(b, dict) else (b, a)
            if isinstance(factor, Fraction) and isinstance(angle, dict):
                found = {x: factor * ratio for x, ratio in angle.items()}
        elif op == Op.DIV and isinstance(a, dict) and isinstance(b, Fraction) and b:
            found = {x: ratio / b for x, ratio in a.items()}
        known[n] = found
    angle = known[node]
    return angle if isinstance(angle, dict) else None


def is_angle(program: Program, outputs: Sequence[int], node: int) -> bool:
    """Whether a symbol is an angle: it occurs only in whole multiples, added to angles of sines and the like."""
    if program.inputs[node].role != "symbol":
        return False
    circular = [n for n in program.needed(outputs) if program.ops[n] in CIRCULAR]
    ratios = [
        (_turns(program, program.lhs[n]) or {}).get(node, Fraction(0)) for n in circular
    ]
    holders = [n for n, ratio in zip(circular, ratios, strict=True) if ratio]
    whole = all(ratio.denominator == 1 for ratio in ratios)
    return bool(holders) and whole and node not in program.needed(outputs, holders)


Circle = tuple[Residues, Residues]  # cosines and sines


def _turned(
    form: _Turns,
    units: Mapping[int, int],
    points: Mapping[int, Circle],
    field: PrimeField,
) -> Circle:
    """The point of an angle from those of parts of inputs."""
    turns = [(points[n], int(ratio * units[n])) for n, ratio in form.items()]
    if not turns:
        return np.ones(1, dtype=field.dtype), np.zeros(1, dtype=field.dtype)
    found = [
        point if count == 1 else field.multiply_angle(point, count)
        for point, count in turns
    ]
    return reduce(field.add_angles, found)


_ROOTS = (1.0, sqrt(2), sqrt(3), sqrt(6))


class _Quotient(NamedTuple):
    """N / (M·D^power), where D is the common denominator: degrees of N and M, and their norms' logarithms."""

    degree: int
    bits: float = 0.0
    below: int = 0
    bits_below: float = 0.0
    power: int = 0


def size_bound(program: Program, outputs: Sequence[int]) -> Size:
    """A bound on the sizes of outputs in the leaves, which are inputs and functions.

    |x| = sign(x)·x, and tan and tanh are quotients of leaves.

    >>> program = Program()
    >>> x, y = program.input("x"), program.input("y")
    >>> size_bound(program, [(x * y * 3 + x / 2).node])
    Size(degree=2, bits=2.807354922057604)
    """
    needed = program.needed(outputs)
    numbers = [program.constants[n] for n in needed if program.ops[n] == Op.CONSTANT]
    denominator = common_denominator(numbers)
    scale = log2(denominator)
    sizes: dict[int, _Quotient] = {}
    for node in needed:
        op, a, b = program.ops[node], program.lhs[node], program.rhs[node]
        if op == Op.CONSTANT:
            number = program.constants[node]
            power = int(common_denominator([number]) > 1)
            sizes[node] = _Quotient(
                0, norm_bits([number], denominator if power else 1), power=power
            )
        elif op in (Op.TAN, Op.TANH):
            sizes[node] = _Quotient(1, below=1)
        elif op == Op.ABS:
            sizes[node] = _product(sizes[a], _Quotient(1))
        elif op == Op.INPUT or op >= Op.SIN:
            sizes[node] = _Quotient(1)
        else:
            sizes[node] = (
                sizes[a] if op == Op.NEG else _combined(op, sizes[a], sizes[b], scale)
            )
    found = [sizes[n] for n in outputs]
    power = max(
        (s.power for s in found), default=0
    )  # one for all, so that outputs can be added
    bits = [max(s.bits + (power - s.power) * scale, s.bits_below) for s in found]
    return Size(
        max((max(s.degree, s.below) for s in found), default=0), max(bits, default=0.0)
    )


def polynomial_size(polynomials: Iterable[Polynomial]) -> Size:
    """The largest degree in generators, and the largest norm, of polynomials with coefficients made whole each."""
    degree, bits = 0, 0.0
    for polynomial in polynomials:
        numbers = list(polynomial.terms.values())
        degree = max(
            [degree, *(sum(e for _, e in monomial) for monomial in polynomial.terms)]
        )
        bits = max(bits, norm_bits(numbers, common_denominator(numbers)))
    return Size(degree, bits)


def common_denominator(numbers: Iterable[Number]) -> int:
    """Common denominator of all parts of exact numbers."""
    return lcm(
        *(Fraction(part).denominator for number in numbers for part in parts_of(number))
    )


def norm_bits(numbers: Sequence[Number], factor: int = 1) -> float:
    """Binary logarithm of the sum of numbers' sizes, times a factor; 0 for sums below 1."""
    pairs = [
        pair
        for number in numbers
        for pair in zip(parts_of(number), _ROOTS, strict=True)
    ]
    sizes = ((abs(Fraction(part)) * factor, root) for part, root in pairs if part)
    # logarithms of whole numbers, which may be beyond the range of floats
    terms = [
        log2(size.numerator) - log2(size.denominator) + log2(root)
        for size, root in sizes
    ]
    return max(0.0, _sum(terms)) if terms else 0.0


def _sum(terms: Sequence[float]) -> float:
    """Logarithm of a sum, from logarithms."""
    largest = max(terms)
    return largest + log2(sum([2.0 ** (term - largest) for term in terms]))


def _product(a: _Quotient, b: _Quotient) -> _Quotient:
    return _Quotient(
        a.degree + b.degree,
        a.bits + b.bits,
        a.below + b.below,
        a.bits_below + b.bits_below,
        a.power + b.power,
    )


def _combined(op: int, a: _Quotient, b: _Quotient, scale: float) -> _Quotient:
    """A sum, product or quotient; ``scale`` is the logarithm of the common denominator."""
    if op == Op.DIV:
        b = _Quotient(b.below, b.bits_below + b.power * scale, b.degree, b.bits)
    if op in (Op.MUL, Op.DIV):
        return _product(a, b)
    power = max(a.power, b.power)
    left = a.bits + b.bits_below + (power - a.power) * scale
    right = b.bits + a.bits_below + (power - b.power) * scale
    degree = max(a.degree + b.below, b.degree + a.below)
    return _Quotient(
        degree,
        _sum((left, right)),
        a.below + b.below,
        a.bits_below + b.bits_below,
        power,
    )
