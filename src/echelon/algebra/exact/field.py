"""Prime fields GF(p): primes, embeddings of exact numbers, random points, and linear algebra over them.

All primes are 23 modulo 24.  Then 2 and 3 are squares (so multiples of 15° have a sine and cosine), square roots are
one power because p = 3 mod 4, and −1 is *not* a square, so 1 + t² never vanishes and every t gives a point of the unit
circle, c = (1 − t²)/(1 + t²), s = 2t/(1 + t²).

Two sizes are used: 31 bits for arrays of int64 (a product fits 63 bits), and 81 bits for certificates, where two random
points make an error less likely than 1e-30; arrays of those hold Python integers.  Thirteen Miller–Rabin bases prove
primes below 3.3·10²⁴ in microseconds (Sorenson and Webster 2015); a proof for larger ones takes milliseconds.

Matrices come in two shapes.  One large matrix, whose pivots are wanted: FLINT's ``nmod_mat`` (recursive, with fast
multiplication).  Very many small systems, one per random geometry: Gauss–Jordan in NumPy, vectorised over the batch.
In matrices of balls, what is surely not zero is a pivot and what may be zero is bounded.  The pivots are proved.
Columns without one are dependent up to a bound that shrinks with the precision.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import gcd
from typing import Any, Protocol, TypeVar

import flint
import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.polynomial import Number, Surd, generator_values, repeated
from echelon.shared import DegenerateSampleError, InputError

Residues = npt.NDArray[
    Any
]  # array of residues in [0, p): int64 for primes below 2^31, Python integers above

ARRAY_BITS = 31
"""Size of primes whose residues are multiplied in machine words."""
CERTIFICATE_BITS = 81
"""Size of primes of certificates: a false identity holds modulo one of them with a probability below 1e-20."""
_WORD_BITS = 63  # of the largest modulus of FLINT's matrices of machine words
_SMALL_PRIMES = int(flint.fmpz.primorial_ui(flint.fmpz(400)))  # their product
_FEW = 16
"""Elements below which inverting one by one is faster than a tree of products."""


MOST_ATTEMPTS = 16
"""Random points before a degenerate model is reported: chance makes one degenerate in less than 2^-20 of the cases."""
AGREEING_POINTS = 2
"""Random points of random fields that must agree; one alone is unlucky with a probability of about 2^-31."""
SURPLUS_ROWS = 8
"""Rows beyond those that determine a relation: a false one holds in all of them with a probability of about p^-8."""

DEFAULT_SEED = 2015
"""Seed of a random generator that nobody chose; results record it."""


def random_generator(seed: int) -> np.random.Generator:
    """A random generator."""
    if seed < 0:
        raise InputError(f"the seed {seed} is negative; give a whole number from 0 on")
    return np.random.default_rng(seed)


def random_prime(rng: np.random.Generator, bits: int) -> int:
    """A random prime of exactly this many bits that is 23 modulo 24."""
    low, high = 1 << (bits - 1), 1 << bits
    while True:
        candidate = _random_below(rng, (high - low) // 24 - 1) * 24 + low
        candidate += (23 - candidate) % 24
        if (
            gcd(candidate, _SMALL_PRIMES) == 1 and flint.fmpz(candidate).is_prime()
        ):  # gcd spares most of the tests
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
        """Copy of the field with the other square root of 2 and/or 3."""
        p = self.p
        return PrimeField(
            p,
            p - self.root2 if flip2 else self.root2,
            p - self.root3 if flip3 else self.root3,
        )

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
            return (
                sum(
                    self.embed(part) * b for part, b in zip(x.parts, basis, strict=True)
                )
                % self.p
            )
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
        return np.concatenate(
            [
                inverse[:half] * right % self.p,
                inverse[:half] * left % self.p,
                inverse[half:],
            ]
        )

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Residues:
        """Random residues."""
        if self.dtype is np.int64:
            return rng.integers(0, self.p, size=shape, dtype=np.int64)
        count = int(np.prod(shape))
        flat = np.empty(count, dtype=object)
        flat[:] = [_random_below(rng, self.p) for _ in range(count)]
        return flat.reshape(shape)

    def circle(self, t: Residues) -> tuple[Residues, Residues]:
        """Cosine and sine with half-angle tangent t, elementwise; t = p stands for infinity, of a half turn."""
        p = self.p
        square = t * t % p
        scale = self.invert_array((1 + square) % p)
        cosine, sine = (1 - square) * scale % p, 2 * t * scale % p
        return np.where(t == p, p - 1, cosine), sine

    def half_tangent(self, cosine: int, sine: int) -> int:
        """The tangent t that :meth:`circle` takes for a point; p for that of a half turn."""
        if (1 + cosine) % self.p == 0:
            return self.p
        return sine * self.invert(1 + cosine) % self.p

    def sphere(self, t: Residues) -> Residues:
        """Points of the unit sphere by stereographic projection: t of shape (k, ...) gives (k + 1, ...)."""
        p = self.p
        square = (t * t % p).sum(axis=0) % p
        scale = self.invert_array((1 + square) % p)
        return np.concatenate([((1 - square) * scale % p)[None], 2 * t * scale % p])

    def multiply_angle(
        self, point: tuple[Residues, Residues], count: int
    ) -> tuple[Residues, Residues]:
        """Cosine and sine of count times an angle, by repeated squaring of c + i s."""
        c, s = point
        base = (c, s if count >= 0 else -s % self.p)
        return repeated(
            base, abs(count), (np.ones_like(c), np.zeros_like(s)), self.add_angles
        )

    def add_angles(
        self, a: tuple[Residues, Residues], b: tuple[Residues, Residues]
    ) -> tuple[Residues, Residues]:
        """Cosine and sine of the sum of two angles."""
        p = self.p
        return (a[0] * b[0] % p - a[1] * b[1] % p) % p, (
            a[0] * b[1] % p + a[1] * b[0] % p
        ) % p


def as_flint(matrix: Residues, field: PrimeField) -> Any:
    """A matrix over GF(p) in FLINT."""
    rows, columns = matrix.shape
    if field.p.bit_length() > _WORD_BITS:
        return flint.fmpz_mod_mat(
            rows, columns, matrix.ravel().tolist(), flint.fmpz_mod_ctx(field.p)
        )
    return flint.nmod_mat(rows, columns, matrix.ravel().tolist(), field.p)


def reduced_echelon(matrix: Residues, field: PrimeField) -> tuple[Any, list[int]]:
    """Reduced row echelon form of a matrix over GF(p) with p below 2^63.  Shapes: matrix (rows, columns)."""
    rows, columns = matrix.shape
    if not rows or not columns:
        return flint.nmod_mat(rows, columns, field.p), []
    reduced, rank = as_flint(matrix, field).rref()
    pivots: list[int] = []
    column = 0
    for row in range(rank):
        while not int(reduced[row, column]):
            column += 1
        pivots.append(column)
        column += 1
    return reduced, pivots


def rank(matrix: Residues, field: PrimeField) -> int:
    """Rank of a matrix over GF(p)."""
    rows, columns = matrix.shape
    if not rows or not columns:
        return 0
    return int(as_flint(matrix, field).rank())


def by_pivots(matrix: Residues, field: PrimeField) -> dict[int, dict[int, int]]:
    """Every column without a pivot as a combination of pivot columns: their coefficients where they are not zero."""
    reduced, pivots = reduced_echelon(matrix, field)
    found = {}
    for column in sorted(set(range(matrix.shape[1])) - set(pivots)):
        pairs = [(p, int(reduced[row, column])) for row, p in enumerate(pivots)]
        found[column] = {p: value for p, value in pairs if p < column and value}
    return found


def null_vectors(matrix: Residues, field: PrimeField) -> list[list[int]]:
    """Basis of the right null space, one vector per non-pivot column, with a 1 there."""
    basis = []
    for free, combination in by_pivots(matrix, field).items():
        vector = [0] * matrix.shape[1]
        vector[free] = 1
        for pivot, value in combination.items():
            vector[pivot] = field.p - value
        basis.append(vector)
    return basis


def solve_batched(left: Residues, right: Residues, field: PrimeField) -> Residues:
    """Solve many small systems A x = b at once, with as many or more equations than unknowns."""
    # shapes: left (batch, equations, unknowns); right (batch, equations, sides); returns (batch, unknowns, sides)
    unknowns = left.shape[2]
    table = np.concatenate([left, right], axis=2) % field.p
    batch = np.arange(table.shape[0])
    for j in range(unknowns):
        below = table[:, j:, j] != 0
        if not below.any(axis=1).all():
            raise DegenerateSampleError("a sample has dependent pivot columns")
        pivot = j + below.argmax(axis=1)
        chosen = table[batch, pivot]
        table[batch, pivot] = table[:, j]
        chosen = chosen * field.invert_array(chosen[:, j])[:, None] % field.p
        table = (table - table[:, :, j, None] * chosen[:, None, :]) % field.p
        table[:, j] = chosen
    if table[:, unknowns:, unknowns:].any():
        raise DegenerateSampleError("surplus equations contradict the relation")
    return table[:, :unknowns, unknowns:]


class RingElement(Protocol):
    """Numbers that can be added and multiplied."""

    def __add__(self, other: Any, /) -> Any: ...

    def __mul__(self, other: Any, /) -> Any: ...


T = TypeVar("T", bound=RingElement)


def substituted(
    combination: Mapping[int, T], solved: Mapping[int, Mapping[int, T]]
) -> dict[int, T]:
    """A combination of columns as one of those that the solved ones are combinations of."""
    total: dict[int, T] = {}
    for column, coefficient in combination.items():
        if column not in solved:
            total[column] = (
                total[column] + coefficient if column in total else coefficient
            )
            continue
        for pivot, inner in solved[column].items():
            addend = coefficient * inner
            total[pivot] = total[pivot] + addend if pivot in total else addend
    return dict(sorted(total.items()))


# -- functions that are known by their values --------------------------------------------------------------------------

Geometry = Mapping[
    str, Residues
]  # values of the symbols; for an angle the tangent of its half


def residues_of_generators(
    generators: Iterable[str], symbols: Mapping[str, Residues], field: PrimeField
) -> dict[str, Residues]:
    """Residues of generators for given symbols; an angle symbol is given by the tangent of its half."""

    def circle(t: Residues, count: int) -> tuple[Residues, Residues]:
        point = field.circle(t)
        return point if count == 1 else field.multiply_angle(point, count)

    return generator_values(generators, symbols.__getitem__, circle)


def residues_at(
    generators: Iterable[str], symbols: Mapping[str, Residues], field: PrimeField
) -> dict[str, int]:
    """Residues of generators as plain integers, for one value (shape (1,)) of every symbol."""
    return {
        g: int(value[0])
        for g, value in residues_of_generators(generators, symbols, field).items()
    }
