"""Bounds on the size of a program's outputs as quotients of polynomials, for error probabilities modulo random primes.

A false identity survives a random point with a probability that its degree bounds, and a random prime with one that the
size of its coefficients bounds.  Both follow from the program, node by node.

The size of a polynomial is its 1-norm: the sum of its coefficients' absolute values, where a + b√2 + c√3 + d√6 counts
as |a| + |b|√2 + |c|√3 + |d|√6.  That of a sum or product is at most the sum or product of those.  Coefficients are made
whole by one common denominator of all constants, whose power is carried along.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm, log2, sqrt
from typing import NamedTuple

from echelon.exact.numbers import Number, parts_of
from echelon.exact.polynomial import Polynomial
from echelon.program.tape import Op, Program

_ROOTS = (1.0, sqrt(2), sqrt(3), sqrt(6))


@dataclass(frozen=True)
class Size:
    """Size of quotients of polynomials with whole coefficients, apart from one number that divides them all."""

    degree: int  # the larger total degree of numerator and denominator
    bits: float  # the larger binary logarithm of their 1-norms


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
            sizes[node] = _Quotient(0, norm_bits([number], denominator if power else 1), power=power)
        elif op in (Op.TAN, Op.TANH):
            sizes[node] = _Quotient(1, below=1)
        elif op == Op.ABS:
            sizes[node] = _product(sizes[a], _Quotient(1))
        elif op == Op.INPUT or op >= Op.SIN:
            sizes[node] = _Quotient(1)
        else:
            sizes[node] = sizes[a] if op == Op.NEG else _combined(op, sizes[a], sizes[b], scale)
    found = [sizes[n] for n in outputs]
    power = max((s.power for s in found), default=0)  # one for all, so that outputs can be added
    bits = [max(s.bits + (power - s.power) * scale, s.bits_below) for s in found]
    return Size(max((max(s.degree, s.below) for s in found), default=0), max(bits, default=0.0))


def polynomial_size(polynomials: Iterable[Polynomial]) -> Size:
    """The largest degree in generators, and the largest norm, of polynomials with coefficients made whole each."""
    degree, bits = 0, 0.0
    for polynomial in polynomials:
        numbers = list(polynomial.terms.values())
        degree = max([degree, *(sum(e for _, e in monomial) for monomial in polynomial.terms)])
        bits = max(bits, norm_bits(numbers, common_denominator(numbers)))
    return Size(degree, bits)


def common_denominator(numbers: Iterable[Number]) -> int:
    """Common denominator of all parts of exact numbers."""
    return lcm(*(Fraction(part).denominator for number in numbers for part in parts_of(number)))


def norm_bits(numbers: Sequence[Number], factor: int = 1) -> float:
    """Binary logarithm of the sum of numbers' sizes, times a factor; 0 for sums below 1."""
    parts = (
        (abs(Fraction(part)), root) for number in numbers for part, root in zip(parts_of(number), _ROOTS, strict=True)
    )
    terms = [_log2(part * factor) + log2(root) for part, root in parts if part]
    return max(0.0, _sum(terms)) if terms else 0.0


def _log2(x: Fraction) -> float:
    return log2(x.numerator) - log2(x.denominator)  # also of whole numbers beyond the range of floats


def _sum(terms: Sequence[float]) -> float:
    """Logarithm of a sum, from logarithms."""
    largest = max(terms)
    return largest + log2(sum([2.0 ** (term - largest) for term in terms]))


def _product(a: _Quotient, b: _Quotient) -> _Quotient:
    return _Quotient(
        a.degree + b.degree, a.bits + b.bits, a.below + b.below, a.bits_below + b.bits_below, a.power + b.power
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
    return _Quotient(degree, _sum((left, right)), a.below + b.below, a.bits_below + b.bits_below, power)
