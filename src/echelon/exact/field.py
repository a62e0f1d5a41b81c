"""Prime fields GF(p): primes, embeddings of exact numbers, arrays of residues, random points.

All primes are 23 modulo 24.  Then 2 and 3 are squares (so multiples of 15° have a sine and cosine), square roots are
one power because p = 3 mod 4, and −1 is *not* a square, so 1 + t² never vanishes and every t gives a point of the unit
circle, c = (1 − t²)/(1 + t²), s = 2t/(1 + t²).

Two sizes are used: 31 bits for arrays of int64 (a product fits 63 bits), and 81 bits for certificates, where two random
points make an error less likely than 1e-30; arrays of those hold Python integers.  Thirteen Miller–Rabin bases prove
primes below 3.3·10²⁴ in microseconds (Sorenson and Webster 2015); a proof for larger ones takes milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import Any

import flint
import numpy as np
import numpy.typing as npt

from echelon.errors import DegenerateSampleError
from echelon.exact.numbers import Number, Surd, repeated

Residues = npt.NDArray[Any]
"""Array of residues in [0, p): int64 for primes below 2^31, Python integers above."""

ARRAY_BITS, CERTIFICATE_BITS = 31, 81
_SMALL_PRIMES = int(flint.fmpz.primorial_ui(flint.fmpz(400)))  # their product
_FEW = 16  # below this many elements, inverting one by one is faster than a tree of products


def random_prime(rng: np.random.Generator, bits: int) -> int:
    """A random prime of exactly this many bits that is 23 modulo 24."""
    low, high = 1 << (bits - 1), 1 << bits
    while True:
        candidate = _random_below(rng, (high - low) // 24 - 1) * 24 + low
        candidate += (23 - candidate) % 24
        if gcd(candidate, _SMALL_PRIMES) == 1 and flint.fmpz(candidate).is_prime():  # gcd spares most of the tests
            return candidate


def _random_below(rng: np.random.Generator, bound: int) -> int:
    """Uniform in [0, bound) up to a bias of 2^-64."""
    return int.from_bytes(rng.bytes(bound.bit_length() // 8 + 9), "little") % bound


@dataclass(frozen=True)
class PrimeField:
    """GF(p) with chosen square roots of 2 and 3."""

    p: int  # a prime that is 23 modulo 24
    # the residues that stand for √2 and √3.  The four sign choices are the Galois conjugates, from which the irrational
    # parts of a coefficient are separated
    root2: int
    root3: int

    @staticmethod
    def of(p: int) -> PrimeField:
        """The field with the roots that are themselves squares."""
        power = (p + 1) // 4
        return PrimeField(p, pow(2, power, p), pow(3, power, p))

    @staticmethod
    def random(rng: np.random.Generator, bits: int = ARRAY_BITS) -> PrimeField:
        """A field with a random prime."""
        return PrimeField.of(random_prime(rng, bits))

    def conjugate(self, flip2: bool, flip3: bool) -> PrimeField:
        """The same field with the other square root of 2 and/or 3."""
        p = self.p
        return PrimeField(p, p - self.root2 if flip2 else self.root2, p - self.root3 if flip3 else self.root3)

    @property
    def dtype(self) -> npt.DTypeLike:
        """Type of the elements of residue arrays."""
        return np.int64 if self.p < 1 << 31 else object

    def embed(self, x: Number) -> int:
        """Residue of an exact number."""
        if isinstance(x, int):
            return x % self.p
        if isinstance(x, Surd):
            basis = (1, self.root2, self.root3, self.root2 * self.root3)
            return sum(self.embed(part) * b for part, b in zip(x.parts, basis, strict=True)) % self.p
        return x.numerator * self.invert(x.denominator) % self.p

    def invert(self, x: int) -> int:
        """1/x mod p."""
        if not x % self.p:
            raise DegenerateSampleError(f"a denominator vanishes modulo {self.p}")
        return pow(x, -1, self.p)

    def invert_array(self, x: Residues) -> Residues:
        """Elementwise 1/x mod p."""
        if x.size < _FEW or x.dtype == object:
            flat = [self.invert(int(v)) for v in x.ravel()]
            return np.array(flat, dtype=self.dtype).reshape(x.shape)
        if not np.all(x):
            raise DegenerateSampleError(f"a denominator vanishes modulo {self.p}")
        return self._inverses(x.ravel()).reshape(x.shape)

    def _inverses(self, x: Residues) -> Residues:
        """1/x of a vector, by a tree of products: that of a pair tells both inverses."""
        if len(x) < _FEW:
            return np.array([pow(v, -1, self.p) for v in x.tolist()], dtype=np.int64)
        half = len(x) // 2
        left, right = x[:half], x[half : 2 * half]
        inverse = self._inverses(np.concatenate([left * right % self.p, x[2 * half :]]))
        return np.concatenate([inverse[:half] * right % self.p, inverse[:half] * left % self.p, inverse[half:]])

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Residues:
        """Random residues."""
        if self.dtype is np.int64:
            return rng.integers(0, self.p, size=shape, dtype=np.int64)
        count = int(np.prod(shape))
        flat = np.empty(count, dtype=object)
        flat[:] = [_random_below(rng, self.p) for _ in range(count)]
        return flat.reshape(shape)

    def circle(self, t: Residues) -> tuple[Residues, Residues]:
        """Cosine and sine with half-angle tangent t, elementwise."""
        p = self.p
        square = t * t % p
        scale = self.invert_array((1 + square) % p)
        return (1 - square) * scale % p, 2 * t * scale % p

    def sphere(self, t: Residues) -> Residues:
        """Points of the unit sphere by stereographic projection: t of shape (k, ...) gives (k + 1, ...)."""
        p = self.p
        square = (t * t % p).sum(axis=0) % p
        scale = self.invert_array((1 + square) % p)
        return np.concatenate([((1 - square) * scale % p)[None], 2 * t * scale % p])

    def multiply_angle(self, point: tuple[Residues, Residues], count: int) -> tuple[Residues, Residues]:
        """Cosine and sine of count times an angle, by repeated squaring of c + i s."""
        c, s = point
        base = (c, s if count >= 0 else -s % self.p)
        return repeated(base, abs(count), (np.ones_like(c), np.zeros_like(s)), self.add_angles)

    def add_angles(self, a: tuple[Residues, Residues], b: tuple[Residues, Residues]) -> tuple[Residues, Residues]:
        """Cosine and sine of the sum of two angles."""
        p = self.p
        return (a[0] * b[0] % p - a[1] * b[1] % p) % p, (a[0] * b[1] % p + a[1] * b[0] % p) % p
