"""The certificate: evidence that a base parameter set is complete and minimal, checked on X itself.

*Complete* (rank ≤ r): X · N = 0 for the null vectors N that B implies.  This is an identity of rational functions; it
is checked at random points modulo at least two random 81-bit primes.  By the Schwartz–Zippel lemma a false identity of
degree d survives one such point with probability at most d/p (``docs/certificate.md`` has the whole bound).  Where
signs make regions, there is a point in each known region (see :mod:`echelon.program.region`); the certificate tells
how many there are and what that leaves to be assumed.

Loops have no random points at hand.  There the identity is checked along random curves from closed poses, each modulo
its own 31-bit prime, coefficient by coefficient.  A false identity that vanishes at the pose to a lower order than the
number of coefficients is missed by one curve with probability at most order/p, so several curves make it as unlikely.

*Minimal* (rank ≥ r): the pivot columns of X, sampled modulo a 31-bit prime, contain a non-zero r × r minor, block
triangular as far as possible.  That is a proof, not a probability.  (Closed poses modulo p continue to p-adic ones, so
it is one with loops, too.)

The set was derived from energies; the check uses the inverse dynamics (as rows uᵀX for arbitrary u, see
:mod:`echelon.regressor.linear_forms`), so the two do not share their formulas.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import ceil, log2, log10
from typing import Any

import flint
import numpy as np

from echelon.base.ball_rows import ball_rows
from echelon.base.ball_tables import independent_rows
from echelon.base.matrix import BaseMatrix, StatedNumbers
from echelon.errors import CertificateError, DegenerateSampleError
from echelon.exact.field import ARRAY_BITS, CERTIFICATE_BITS, PrimeField, Residues, random_generator, rank, substituted
from echelon.exact.polynomial import Number, is_trigonometric, multiple_of
from echelon.mechanism.stated import GENERAL, StatedValues
from echelon.program.arithmetics import ball
from echelon.program.operations import Op
from echelon.program.schedule import FieldSampler, Size, polynomial_size, size_bound
from echelon.regressor.linear_forms import LinearForms
from echelon.regressor.loops.curves import CurveSampler

_ATTEMPTS = 64
_MOST_STATES = 4096


@dataclass(frozen=True)
class Minor:
    """The largest non-zero minor of some columns that was found."""

    rank: int  # its size
    prime: int  # modulo which it is not zero
    states: int  # number of random states whose rows contain it


def find_minor(
    regressor: LinearForms, columns: tuple[int, ...], values: StatedValues, rng: np.random.Generator
) -> Minor:
    """A non-zero minor of some columns, all of them if they are independent; as block triangular as it can be."""
    doubled, best = 1, Minor(-1, 0, 0)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, ARRAY_BITS)
        try:
            settled = regressor.blocks.independent(columns, field, rng, values) if regressor.blocks else set()
            rest = tuple(p for p in columns if p not in settled)
            sampler = regressor.columns(rest).sampler()
            regions = sampler.regions
            states = doubled * max(2 + len(rest) // max(1, regressor.shape[0]), regions)
            residues = sampler.evaluate(field, rng, states, values.draw(sampler.symbols, field, rng))
        except DegenerateSampleError:
            continue
        found = Minor(len(settled) + rank(regressor.columns(rest).stacked(residues)[0], field), field.p, states)
        # once twice the states add nothing and rows abound, also in every region, more will not either
        enough = found.rank <= best.rank and states * regressor.shape[0] > 4 * len(rest) + 64
        best = max(best, found, key=lambda minor: minor.rank)
        if best.rank == len(columns) or (enough and states > regions) or 2 * states > max(_MOST_STATES, 4 * regions):
            break
        doubled *= 2
    return best


_FEWEST_POINTS, _LOG10_ERROR, _LEAST_SHOWN = 2, -30.0, -1.0  # a point that shows less is not worth its time
_LOG2_PRIMES = CERTIFICATE_BITS - 11
"""There are more primes of that many bits that are 23 modulo 24, one in eight of all."""
_CURVES = 5
_BALL_BITS, _BALL_STATES, _SURPLUS = 512, 8, 20
_WRONG_THERE = "the set is wrong at the stated values"
_LOOSEST = 1e-30
"""The largest error of a coefficient, beside the largest coefficient, with which a check means anything."""


@dataclass(frozen=True)
class Certificate:
    """Evidence that was checked, with the data to check it again."""

    rank: int
    seed: int  # seed of the random points and primes
    minor_prime: int  # prime modulo which an r × r minor of the pivot columns is non-zero
    # number of random states whose rows contain what is left of it without its triangular part (see
    # :mod:`echelon.regressor.blocks`)
    minor_states: int
    identity_primes: tuple[int, ...]  # primes modulo which X · N = 0 held at a random point each
    degree: int  # bound on the degree of the identity
    log10_error: float  # decimal logarithm of a bound on the probability that X · N = 0 is false
    order: int = 0  # with loops, the number of coefficients compared along each curve; 0 without
    # whether the minor is non-zero at the stated values of the symbols, and not only for general ones
    at_values: bool = False
    regions: int = 0  # regions of signs that were visited, by the minor and at every point; 0 without signs
    # why other regions do not matter, or that this is assumed, and which signs were seen from one side only
    regions_note: str = ""
    numbers: int = 0  # number of columns of B that are numbers, checked at the stated values of the symbols only
    # decimal logarithm of a bound on what X · N leaves there, beside the largest entry of X; None where the numbers are
    # exact
    log10_residual: float | None = None
    # with loops, the ranks of all assembly modes that were found; the set is for the one of the stated pose
    modes: tuple[int, ...] = ()

    @property
    def in_balls(self) -> bool:
        """Whether it was checked at real states in ball arithmetic, and not modulo primes."""
        return not self.identity_primes

    @property
    def assumptions(self) -> tuple[str, ...]:
        """The assumptions of the certificate, by the headings of ``docs/assumptions.md``."""
        found = ["Random points", "Exact decimals"]
        if not self.at_values:
            found.append("Generic constants")
        if self.regions_note:
            found.append("Regions of signs")
        return (*found, "Closed loops") if self.order or self.in_balls else tuple(found)

    def __str__(self) -> str:
        if self.in_balls:
            rest = "" if self.log10_residual is None else f", residual below 1e{int(self.log10_residual)}"
            return (
                f"rank {self.rank} proved from below by a non-zero minor in ball arithmetic; completeness X·N = 0 "
                f"checked in ball arithmetic at {_BALL_STATES} closed states{rest}"
                f"{f', {self.regions_note}' if self.regions_note else ''}"
            )
        count = len(self.identity_primes)
        how = f"modulo {count} primes of {CERTIFICATE_BITS} bits, error probability below 1e{int(self.log10_error)}"
        if self.order:
            how = (
                f"along {count} closed curves, each modulo its own prime of {ARRAY_BITS} bits: what shows up to order "
                f"{self.order} is missed with probability below 1e{int(self.log10_error)}"
            )
        where = " at the stated values" if self.at_values else ""
        if len(self.modes) > 1:
            how += (
                f"; for the assembly mode of the stated pose (modes with {', '.join(map(str, self.modes))} were found)"
            )
        if self.numbers:
            left = self.log10_residual
            found = "exactly" if left is None else f"in ball arithmetic, residual below 1e{int(left)}"
            how += f"; {self.numbers} columns of numbers at the stated values only, {found}"
        return (
            f"rank {self.rank} proved from below by a non-zero minor{where} mod {self.minor_prime}; "
            f"completeness X·N = 0 checked {how}{f', {self.regions_note}' if self.regions_note else ''}"
        )


def certify(
    regressor: LinearForms,
    matrix: BaseMatrix,
    seed: int,
    values: StatedValues | None = None,
    modes: tuple[int, ...] = (),
) -> Certificate:
    """Check a base parameter set against a regressor."""
    _check_echelon(matrix)
    found = _certified(regressor, matrix, seed, values)
    regions, note = (0, _signs_seen(regressor)) if found.in_balls else regressor.sampler().signs
    certificate = replace(found, modes=modes, regions=regions, regions_note=note)
    if matrix.numbers is None:
        return certificate
    residual = _check_stated(regressor, matrix, matrix.numbers, random_generator(seed))
    return replace(certificate, numbers=len(matrix.numbers.columns), log10_residual=residual)


def _certified(regressor: LinearForms, matrix: BaseMatrix, seed: int, values: StatedValues | None) -> Certificate:
    if regressor.shape[1] != len(matrix.parameters):
        raise CertificateError(
            f"the set has {len(matrix.parameters)} standard parameters, the model {regressor.shape[1]}"
        )
    rng = random_generator(seed)
    if regressor.loops is not None and regressor.loops.mechanism.closed_in_balls:
        return _certified_in_balls(regressor, matrix, seed, rng)
    complete = _Completeness(regressor, matrix, rng)
    sampler = complete.sampler
    if isinstance(sampler, CurveSampler):
        return _certified_on_curves(complete, sampler, seed)
    values = values if values is not None and values.can_be_drawn else GENERAL
    minor = find_minor(regressor, matrix.pivots, values, rng)
    _require(minor, matrix)
    primes = list[int]()
    points, forms = _FEWEST_POINTS, size_bound(sampler.program, sampler.outputs)
    while len(primes) < points:
        primes.append(complete.prime(CERTIFICATE_BITS))
        size = _identity_size(forms, matrix, sampler)  # by now all that occurs in some region of signs is known
        missed = _log10_missed(size)
        if missed > _LEAST_SHOWN:
            raise CertificateError(f"its degree of {size.degree} is too high for primes of {CERTIFICATE_BITS} bits")
        points = max(points, ceil(_LOG10_ERROR / missed))
    below = (matrix.rank, seed, minor.prime, minor.states)
    return Certificate(*below, tuple(primes), size.degree, points * missed, at_values=bool(values.names))


def _certified_on_curves(complete: _Completeness, sampler: CurveSampler, seed: int) -> Certificate:
    """Closed poses may take long to find, so the first one shows the minor, too.

    Symbols have any values: lengths of loops cannot be chosen freely modulo a prime.
    """
    matrix, regressor = complete.matrix, complete.regressor
    first = complete.point(ARRAY_BITS, states=2 + matrix.rank // max(1, regressor.shape[0]))
    minor = complete.minor(first)
    if minor.rank < matrix.rank:
        minor = find_minor(regressor, matrix.pivots, GENERAL, complete.rng)
    _require(minor, matrix)
    complete.compare(first)
    primes = [first.field.p, *(complete.prime(ARRAY_BITS) for _ in range(_CURVES - 1))]
    error = sum(log10(sampler.order) - log10(p) for p in primes)
    below = (matrix.rank, seed, minor.prime, minor.states)
    return Certificate(*below, tuple(primes), sampler.order, error, sampler.order)


def _certified_in_balls(regressor: LinearForms, matrix: BaseMatrix, seed: int, rng: np.random.Generator) -> Certificate:
    """A minor in balls; that nothing is left of other columns is checked with the numbers."""
    assert matrix.numbers is not None
    assert regressor.loops is not None
    if wrong := {c for row in matrix.rows for c in row} - {*matrix.pivots, *matrix.numbers.columns}:
        raise CertificateError(f"the coefficients of {matrix.parameters[min(wrong)]} are not said to be numbers")
    mechanism, pivots = regressor.loops.mechanism, regressor.columns(matrix.pivots)
    motions = max(1, len(mechanism.independent_velocities))
    # the mass matrix and gravity show at rest, which takes less time; all other forces of bodies follow from them
    for at_rest in (True, False) if mechanism.measures_every_force and not mechanism.effects else (False,):
        states = (1 + at_rest) * -(-(matrix.rank + _SURPLUS) // regressor.shape[0])
        with flint.ctx.workprec(_BALL_BITS):
            rows = ball_rows(pivots, matrix.numbers.at, states, rng, motions, at_rest=at_rest)
            square, _ = independent_rows(rows)
            if not flint.arb_mat(rows[square].tolist()).det().contains(0):
                return Certificate(matrix.rank, seed, 0, states, (), 0, 0.0, at_values=True)
    raise CertificateError(f"the set is too large: its {matrix.rank} representatives are not independent")


def _signs_seen(regressor: LinearForms) -> str:
    """What is said of regions of signs where states are random; empty without signs."""
    program = regressor.program
    functions = {program.ops[node] for node in program.needed(regressor.entries.values())}
    return "signs as they are at random states" if functions & {Op.SIGN, Op.ABS} else ""


def _require(minor: Minor, matrix: BaseMatrix) -> None:
    if minor.rank < matrix.rank:
        raise CertificateError(
            f"the set is too large: its {matrix.rank} representatives span only {max(minor.rank, 0)} dimensions"
        )


def _check_echelon(matrix: BaseMatrix) -> None:
    """Rows sorted by pivot, leading 1, nothing before it, nothing else in pivot columns."""
    position = {column: k for k, column in enumerate(matrix.order)}
    if sorted(matrix.order) != list(range(len(matrix.parameters))):
        raise CertificateError("the column order is not a permutation of the parameters")
    if len(matrix.rows) != matrix.rank:
        raise CertificateError(f"{len(matrix.rows)} rows but {matrix.rank} representatives")
    places = [position[p] for p in matrix.pivots]
    if places != sorted(set(places)):
        raise CertificateError("the representatives are not in the order of the columns")
    pivots = set(matrix.pivots)
    for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
        name = matrix.parameters[pivot]
        if row.get(pivot) != 1:
            raise CertificateError(f"the coefficient of the representative {name} is not 1")
        for column, coefficient in row.items():
            other = matrix.parameters[column]
            if column != pivot and column in pivots:
                raise CertificateError(f"row {name} contains the representative {other}")
            if position[column] < position[pivot] and coefficient:
                raise CertificateError(f"row {name} contains {other}, which comes before it in the column order")


@dataclass(frozen=True)
class _Point:
    """Entries of X, (entries, 1, states), and rows of B by their pivots at a random point."""

    field: PrimeField
    values: Residues
    rows: Mapping[int, Mapping[int, int]]


class _Completeness:
    """Checks X = X̄ B at random points modulo random primes."""

    def __init__(self, regressor: LinearForms, matrix: BaseMatrix, rng: np.random.Generator) -> None:
        self.regressor, self.matrix, self.rng = regressor, matrix, rng
        self.sampler = regressor.sampler()

    def prime(self, bits: int, stated: Mapping[str, Number] | None = None) -> int:
        """A random prime modulo which it holds at a random point."""
        point = self.point(bits, stated)
        self.compare(point, stated)
        return point.field.p

    def point(self, bits: int, stated: Mapping[str, Number] | None = None, states: int = 0) -> _Point:
        """A random point, or one where symbols have their stated values, modulo a random prime."""
        for _ in range(_ATTEMPTS):
            field = PrimeField.random(self.rng, bits)
            known = {s: np.array([field.embed(value)], dtype=field.dtype) for s, value in (stated or {}).items()}
            names = sorted({*self.sampler.symbols, *self.matrix.symbols})
            symbols = {s: known[s] if s in known else field.draw(self.rng, (1,)) for s in names}
            try:
                values = self.sampler.evaluate(field, self.rng, max(states, self.sampler.regions), symbols)
                return _Point(
                    field, values, dict(zip(self.matrix.pivots, self.matrix.modulo(symbols, field), strict=True))
                )
            except DegenerateSampleError:
                continue
        raise CertificateError("every random point is singular" + " at the stated values" * (stated is not None))

    def minor(self, point: _Point) -> Minor:
        """The largest minor of the representatives at a point."""
        table = self.regressor.stacked(point.values)[0][:, list(self.matrix.pivots)]
        return Minor(rank(table, point.field), point.field.p, point.values.shape[2])

    def compare(self, point: _Point, stated: Mapping[str, Number] | None = None) -> None:
        """Check it at a point.

        Columns that are numbers are checked where symbols have their stated values, all others where these are random.
        """
        matrix, p = self.matrix, point.field.p
        numbers = set(matrix.numbers.columns) if matrix.numbers else set()
        columns = [c for c in range(len(matrix.parameters)) if (c in numbers) == (stated is not None)]
        for actual in self._rows_of_regressor(point.values[:, 0, : self.sampler.regions]):
            claimed = substituted({pivot: actual[pivot] for pivot in matrix.pivots if actual.get(pivot)}, point.rows)
            for column in columns:
                if (actual.get(column, 0) - claimed.get(column, 0)) % p:
                    wrong = "the set is incomplete or wrong" if stated is None else _WRONG_THERE
                    name = matrix.parameters[column]
                    raise CertificateError(f"{wrong}: it does not reproduce the effect of {name}")

    def _rows_of_regressor(self, values: Residues) -> Iterator[dict[int, int]]:
        """Rows of X at all states, by column.  Shapes: values (entries, states)."""
        for state in values.T:
            rows: dict[int, dict[int, int]] = {}
            for (row, column), value in zip(self.regressor.entries, state, strict=True):
                rows.setdefault(row, {})[column] = int(value)
            yield from rows.values()


def _check_stated(
    regressor: LinearForms, matrix: BaseMatrix, numbers: StatedNumbers, rng: np.random.Generator
) -> float | None:
    """Check the columns that are numbers at the stated values; returns the logarithm of what balls leave, if any."""
    if not numbers.columns:
        return None
    chosen = set(numbers.columns)
    coefficients = [value for row in matrix.rows for column, value in row.items() if column in chosen]
    if any(value.symbols() for value in coefficients):
        raise CertificateError("a coefficient in a column of numbers is not a number")
    size = max((abs(value.evaluate({}, float)) for value in coefficients), default=0.0)
    if not numbers.radius <= _LOOSEST * max(1.0, size):
        raise CertificateError(f"numbers with errors of {numbers.radius:.0e} prove nothing")
    if numbers.radius:
        return _check_in_balls(regressor, matrix, numbers, rng)
    complete = _Completeness(regressor, matrix, rng)
    values = numbers.exact(complete.sampler.angles)
    if values is None:
        raise CertificateError("numbers at angles without exact sines cannot be exact")
    for _ in range(_FEWEST_POINTS):
        bits = CERTIFICATE_BITS if regressor.loops is None else ARRAY_BITS
        complete.prime(bits, values)
    return None


def _check_in_balls(
    regressor: LinearForms, matrix: BaseMatrix, numbers: StatedNumbers, rng: np.random.Generator
) -> float | None:
    with flint.ctx.workprec(_BALL_BITS):
        rows = ball_rows(regressor, numbers.at, _BALL_STATES, rng)
        largest = max(1.0, *map(_upper, rows.ravel()))
        allowed, worst = numbers.radius * largest * (matrix.rank + 1), 0.0
        for column in numbers.columns:
            left = rows[:, column]
            for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
                if column in row:
                    left = left - rows[:, pivot] * ball(row[column].numerator.number or 0)
            missed = max(map(_upper, left))
            if not missed <= allowed:
                name = matrix.parameters[column]
                raise CertificateError(f"{_WRONG_THERE}: it does not reproduce the effect of {name}")
            worst = max(worst, missed / largest)
    return log10(worst) if worst else None


def _upper(x: Any) -> float:
    return float(abs(x).upper())


def _identity_size(forms: Size, matrix: BaseMatrix, sampler: FieldSampler) -> Size:
    """Size of X − X̄ B over a common denominator, as a polynomial with whole coefficients in the random numbers.

    ``forms`` is the size of the entries of X in the sampler's leaves.
    """
    substituted = sampler.leaf_size
    turns = 2 * max((multiple_of(g)[0] for g in matrix.generators if is_trigonometric(g)), default=1)
    above = polynomial_size(c.numerator for c in matrix.coefficients)
    below = [polynomial_size([d]) for d in {c.denominator for c in matrix.coefficients}]
    degree = forms.degree + above.degree + sum(d.degree for d in below)
    bits = forms.bits + above.bits + sum(d.bits for d in below) + log2(matrix.rank + 1)
    # each factor is a quotient of random numbers, and each of them may be missing from a term that it then multiplies
    factors = degree * (sampler.leaves + len(matrix.symbols))
    return Size(factors * max(turns, substituted.degree), bits + factors * max(float(turns), substituted.bits))


def _log10_missed(size: Size) -> float:
    """Bound on the probability that one random point modulo one random prime misses a false identity.

    The norm of a coefficient in Q(√2, √3) is a product of four numbers of the given size, and has as many prime factors
    of the given length as that has room for.
    """
    point = log10(max(1, size.degree)) - log10(2) * (CERTIFICATE_BITS - 1)
    prime = log10(max(1.0, 4 * size.bits / (CERTIFICATE_BITS - 1))) - log10(2) * _LOG2_PRIMES
    return max(point, prime) + log10(2)
