"""From residues back to rational numbers: Chinese remainders and rational reconstruction."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from echelon.exact.numbers import Rational

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
    value = Fraction(*best)
    return value.numerator if value.denominator == 1 else value
