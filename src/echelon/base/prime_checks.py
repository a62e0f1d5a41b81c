"""Checks of a base parameter set modulo primes: a non-zero minor, an identity, and a rank.

*Minor.*  The pivot columns of X, sampled modulo a 31-bit prime, contain a non-zero r × r minor, block triangular as far
as possible.  That is a proof of independence, not a probability.

*Identity.*  X − X̄ B = 0 is an identity of rational functions.  It is compared at random points modulo random 81-bit
primes; by the Schwartz–Zippel lemma a false identity of degree d survives one such point with probability at most d/p
(``docs/certificate.md`` has the whole bound).

*Rank.*  Columns whose coefficients are rounded numbers are shown to be combinations of the pivots by the rank of both
together, which is the same statement about all (r + 1) × (r + 1) minors.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from math import ceil, log2, log10

import numpy as np

from echelon.algebra import (
    AGREEING_POINTS,
    ARRAY_BITS,
    CERTIFICATE_BITS,
    MOST_ATTEMPTS,
    FieldSampler,
    PrimeField,
    Residues,
    Size,
    is_trigonometric,
    multiple_of,
    polynomial_size,
    random_generator,
    rank,
    size_bound,
    substituted,
    symbol_of,
)
from echelon.base.matrix import BaseMatrix
from echelon.dynamics import LinearForms
from echelon.robot import StatedValues
from echelon.shared import CertificateError, DegenerateSampleError

MOST_STATES = 4096
"""States of one elimination at most, where signs do not need more."""
LOG10_ERROR = -30.0
"""Decimal logarithm of the probability that a certificate allows for a false identity."""
LARGEST_LOG10_MISSED = -1.0
"""Log10 of the probability that a point misses a false identity, beyond which points are not worth their time."""
_LOG2_PRIMES = CERTIFICATE_BITS - 11
"""There are more primes of that many bits that are 23 modulo 24, one in eight of all."""


@dataclass(frozen=True)
class Minor:
    """The largest non-zero minor of some columns that was found."""

    rank: int  # its size
    prime: int  # modulo which it is not zero; 0 for one in ball arithmetic
    states: int  # number of random states whose rows contain it


def find_minor(
    regressor: LinearForms,
    columns: tuple[int, ...],
    rng: np.random.Generator,
    values: StatedValues | None = None,
) -> Minor:
    """A non-zero minor of some columns, all of them if they are independent; as block triangular as it can be.

    Symbols have their values where some are given, and general ones elsewhere.
    """
    doubled, best = 1, Minor(-1, 0, 0)
    for _ in range(MOST_ATTEMPTS):
        field = PrimeField.random(rng, ARRAY_BITS)
        try:
            settled = (
                regressor.blocks.independent(columns, field, _child(rng), values)
                if regressor.blocks
                else set()
            )
            rest = tuple(p for p in columns if p not in settled)
            sampler = regressor.columns(rest).sampler()
            regions = sampler.regions
            states = doubled * max(2 + len(rest) // max(1, regressor.shape[0]), regions)
            residues = _evaluated(sampler, field, rng, states, values)
        except DegenerateSampleError:
            continue
        found = Minor(
            len(settled) + rank(regressor.columns(rest).stacked(residues)[0], field),
            field.p,
            states,
        )
        # once twice the states add nothing and rows abound, also in every region, more will not either
        enough = (
            found.rank <= best.rank and states * regressor.shape[0] > 4 * len(rest) + 64
        )
        best = max(best, found, key=lambda minor: minor.rank)
        if (
            best.rank == len(columns)
            or (enough and states > regions)
            or 2 * states > max(MOST_STATES, 4 * regions)
        ):
            break
        doubled *= 2
    return best


def _evaluated(
    sampler: FieldSampler,
    field: PrimeField,
    rng: np.random.Generator,
    states: int,
    values: StatedValues | None = None,
) -> Residues:
    """Outputs at random states and one geometry, random where there are no values."""
    own, names = _child(rng), sampler.symbols
    geometry = (
        values.draw(names, field, own)
        if values
        else {name: field.draw(own, (1,)) for name in names}
    )
    return sampler.evaluate(field, own, states, geometry)


def _child(rng: np.random.Generator) -> np.random.Generator:
    """A generator for one point.

    A sampler learns functions of constants when it is first evaluated, and draws more numbers from then on; the primes
    that are drawn afterwards must not depend on that, or a recorded check could not be repeated.
    """
    return random_generator(int(rng.integers(2**62)))


@dataclass(frozen=True)
class Point:
    """A random point: entries of X, (entries, 1, states), and rows of B by their pivots."""

    field: PrimeField
    values: Residues
    rows: Mapping[int, Mapping[int, int]]


class Identity:
    """X = X̄ B in some columns, compared at random points modulo random primes."""

    def __init__(
        self,
        regressor: LinearForms,
        matrix: BaseMatrix,
        columns: Collection[int],
        rng: np.random.Generator,
    ) -> None:
        self.regressor = regressor
        self.matrix = matrix
        self.columns = sorted(columns)
        self.rng = rng
        self.sampler = regressor.sampler()

    def holds_modulo(self, bits: int) -> int:
        """A random prime modulo which it holds at a random point."""
        point = self.point(bits)
        self.compare(point)
        return point.field.p

    def holds(self) -> tuple[tuple[int, ...], int, float]:
        """Primes at which it holds, a bound on its degree, and the logarithm of the probability that it is false."""
        sampler, primes, points = self.sampler, list[int](), AGREEING_POINTS
        forms = size_bound(sampler.program, sampler.outputs)
        missed, degree = 0.0, 0
        while len(primes) < points:
            primes.append(self.holds_modulo(CERTIFICATE_BITS))
            # by now all functions that occur in some region of signs are known
            size = _identity_size(forms, self.matrix, sampler)
            missed, degree = log10_missed(size), size.degree
            points = max(points, ceil(LOG10_ERROR / missed))
        return tuple(primes), degree, points * missed

    def point(self, bits: int, states: int = 0) -> Point:
        """A random point modulo a random prime."""
        for _ in range(MOST_ATTEMPTS):
            field = PrimeField.random(self.rng, bits)
            own = _child(self.rng)
            names = sorted({*self.sampler.symbols, *self.matrix.symbols})
            symbols = {s: field.draw(own, (1,)) for s in names}
            try:
                values = self.sampler.evaluate(
                    field, own, max(states, self.sampler.regions), symbols
                )
                rows = self.matrix.modulo(symbols, field)
            except DegenerateSampleError:
                continue
            self._refuse_other_roles()
            return Point(
                field, values, dict(zip(self.matrix.pivots, rows, strict=True))
            )
        raise CertificateError("every random point is singular")

    def _refuse_other_roles(self) -> None:
        """Refuse a symbol that is an angle in the model and a plain number in the set, or the other way round.

        One residue stands for both, the tangent of half of an angle and the number, so that they would seem related.
        """
        circular = {symbol_of(g) for g in self.matrix.generators if is_trigonometric(g)}
        plain = {g for g in self.matrix.generators if not is_trigonometric(g)}
        angles = self.sampler.angles
        numbers = set(self.sampler.symbols) - angles
        if confused := (plain & (circular | angles)) | (circular & numbers):
            raise CertificateError(
                f"'{min(confused)}' is an angle and a plain number at once, in the model and the set"
            )

    def minor(self, point: Point) -> Minor:
        """The largest minor of the representatives at a point."""
        table = self.regressor.stacked(point.values)[0][:, list(self.matrix.pivots)]
        return Minor(rank(table, point.field), point.field.p, point.values.shape[2])

    def compare(self, point: Point) -> None:
        """Check it at a point.

        Raises
        ------
        CertificateError
            If it does not hold there, with the first column that shows it.
        """
        matrix, p = self.matrix, point.field.p
        for actual in self._rows_of_regressor(
            point.values[:, 0, : self.sampler.regions]
        ):
            present = {
                pivot: actual[pivot] for pivot in matrix.pivots if actual.get(pivot)
            }
            claimed = substituted(present, point.rows)
            for column in self.columns:
                if (actual.get(column, 0) - claimed.get(column, 0)) % p:
                    name = matrix.parameters[column]
                    problem = f"it does not reproduce the effect of {name}"
                    raise CertificateError(f"the set is incomplete or wrong: {problem}")

    def _rows_of_regressor(self, values: Residues) -> Iterator[dict[int, int]]:
        """Rows of X at all states, by column.  Shapes: values (entries, states)."""
        for state in values.T:
            rows: dict[int, dict[int, int]] = {}
            for (row, column), value in zip(self.regressor.entries, state, strict=True):
                rows.setdefault(row, {})[column] = int(value)
            yield from rows.values()


def check_spanned(
    regressor: LinearForms,
    matrix: BaseMatrix,
    columns: Collection[int],
    rng: np.random.Generator,
) -> tuple[int, float]:
    """Show that some columns are combinations of the pivots, whatever their coefficients, by ranks modulo primes.

    Parameters
    ----------
    regressor : LinearForms
        X at the stated values.
    matrix : BaseMatrix
    columns : collection of int
    rng : numpy.random.Generator

    Returns
    -------
    (int, float)
        Number of primes, and the decimal logarithm of a bound on the probability that it is false.

    Raises
    ------
    CertificateError
        If a column is none, or the pivots are dependent.
    """
    forms = regressor.columns([*matrix.pivots, *sorted(columns)])
    sampler, bound = forms.sampler(), 0.0
    primes = 0
    while bound > LOG10_ERROR:
        field = PrimeField.random(rng, CERTIFICATE_BITS)
        table = _rows_showing_pivots(forms, matrix.rank, field, rng)
        if rank(table, field) > matrix.rank:
            raise CertificateError(
                "the set is wrong at the stated values: columns of numbers are independent of it"
            )
        entry = size_bound(sampler.program, sampler.outputs)
        leaf, factors = sampler.leaf_size, entry.degree * sampler.leaves
        # one (r + 1) × (r + 1) minor is a polynomial in the entries of r + 1 rows
        order = matrix.rank + 1
        size = Size(
            order * factors * leaf.degree,
            order * (entry.bits + factors * leaf.bits + log2(order + 1)),
        )
        primes, bound = primes + 1, bound + log10_missed(size)
    return primes, bound


def _rows_showing_pivots(
    forms: LinearForms, pivots: int, field: PrimeField, rng: np.random.Generator
) -> Residues:
    """Rows of X in which the first columns are independent, and further ones in every region of signs."""
    sampler, regions = forms.sampler(), forms.sampler().regions
    states = max(2 + pivots // max(1, forms.shape[0]), regions)
    while states <= max(MOST_STATES, 4 * regions):
        try:
            values = _evaluated(sampler, field, rng, states + regions)
        except DegenerateSampleError:
            continue
        table: Residues = forms.stacked(values)[0]
        if rank(table[: states * forms.shape[0], :pivots], field) == pivots:
            return table
        states *= 2
    raise CertificateError(
        f"the set is too large: its {pivots} representatives are dependent at the stated values"
    )


def _identity_size(forms: Size, matrix: BaseMatrix, sampler: FieldSampler) -> Size:
    """Size of X − X̄ B over a common denominator, as a polynomial with whole coefficients in the random numbers.

    ``forms`` is the size of the entries of X in the sampler's leaves.
    """
    substituted = sampler.leaf_size
    turns = 2 * max(
        (multiple_of(g)[0] for g in matrix.generators if is_trigonometric(g)), default=1
    )
    above = polynomial_size(c.numerator for c in matrix.coefficients)
    below = [polynomial_size([d]) for d in {c.denominator for c in matrix.coefficients}]
    degree = forms.degree + above.degree + sum(d.degree for d in below)
    bits = forms.bits + above.bits + sum(d.bits for d in below) + log2(matrix.rank + 1)
    # each factor is a quotient of random numbers, and each of them may be missing from a term that it then multiplies
    factors = degree * (sampler.leaves + len(matrix.symbols))
    return Size(
        factors * max(turns, substituted.degree),
        bits + factors * max(float(turns), substituted.bits),
    )


def log10_missed(size: Size) -> float:
    """Log10 of a bound on the probability that a false identity holds at a random point modulo a random prime.

    The norm of a coefficient in Q(√2, √3) is a product of four numbers of the given size, and has as many prime factors
    of the given length as that has room for.

    Raises
    ------
    CertificateError
        If the degree or the size is so high that a point shows next to nothing.
    """
    point = log10(max(1, size.degree)) - log10(2) * (CERTIFICATE_BITS - 1)
    prime = (
        log10(max(1.0, 4 * size.bits / (CERTIFICATE_BITS - 1)))
        - log10(2) * _LOG2_PRIMES
    )
    missed = max(point, prime) + log10(2)
    if missed > LARGEST_LOG10_MISSED:
        raise CertificateError(
            f"its degree of {size.degree} is too high for primes of {CERTIFICATE_BITS} bits"
        )
    return missed
