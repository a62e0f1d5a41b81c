"""The certificate: evidence that a base parameter set is complete and minimal, checked on X itself.

A set is valid only if every column is accounted for by a check that could have failed, at the robot's stated values.
:func:`certify` lists the columns that each check reached; one that none did is an error.

*Minimal* (rank ≥ r): a non-zero r × r minor of the pivot columns at the stated values, modulo a prime or in ball
arithmetic.

*Complete* (rank ≤ r), column by column:

- coefficients in closed form: X = X̄ B is an identity of rational functions, compared modulo primes
  (:mod:`echelon.base.prime_checks`), in each known region of signs (:mod:`echelon.algebra.program.region`);
- coefficients that are numbers: exact ones are compared at the stated values modulo primes.  Of rounded ones the ranks
  modulo primes show that they exist, and ball arithmetic what they are (:mod:`echelon.base.ball_checks`);
- loops and functions such as exp: all columns at real states in ball arithmetic, at the stated values of the symbols,
  and formulas at random other values, too.

The set was derived from energies; the check uses the inverse dynamics (as rows uᵀX for arbitrary u, see
:mod:`echelon.dynamics.linear_forms`), so the two do not share their formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from echelon.algebra import (
    AGREEING_POINTS,
    CERTIFICATE_BITS,
    MOST_ATTEMPTS,
    random_generator,
)
from echelon.base.ball_checks import BallEvidence, check_in_balls, has_plain_signs
from echelon.base.matrix import NEGLIGIBLE_ERROR, BaseMatrix, StatedNumbers
from echelon.base.prime_checks import (
    Identity,
    Minor,
    check_spanned,
    find_minor,
)
from echelon.base.real_states import RealStates
from echelon.base.rounded_checks import check_to_rounding
from echelon.dynamics import LinearForms, Rows
from echelon.robot import StatedValues
from echelon.shared import CertificateError, DegenerateSampleError, InputError

RANDOM_GEOMETRIES = 4
"""Random values of the symbols, of more than 30 bits each, at which balls compare formulas."""

MINOR, IDENTITY, NUMBERS, BALLS = "minor", "identity", "numbers", "balls"
"""Kinds of checks, by which a certificate counts the columns that each of them reached."""


@dataclass(frozen=True)
class Certificate:
    """Evidence that was checked, with the data to check it again."""

    rank: int
    seed: int  # seed of the random points and primes
    minor_prime: int  # prime modulo which an r × r minor of the pivot columns is non-zero; 0 for one in ball arithmetic
    # number of random states whose rows contain what is left of it without its triangular part (see
    # :mod:`echelon.dynamics.blocks`)
    minor_states: int
    identity_primes: tuple[
        int, ...
    ]  # primes modulo which X · N = 0 held at a random point each
    degree: int  # bound on the degree of the identity
    log10_error: (
        float  # decimal logarithm of a bound on the probability that X · N = 0 is false
    )
    # whether the minor is non-zero at the stated values of the symbols, and not only for general ones
    at_values: bool = False
    regions: int = 0  # regions of signs that were visited, by the minor and at every point; 0 without signs
    # why other regions do not matter, or that this is assumed, and which signs were seen from one side only
    regions_note: str = ""
    numbers: int = 0  # number of columns of B that are numbers, checked at the stated values of the symbols only
    # decimal logarithm of a bound on what X · N leaves at real states, beside the largest entry of the column; None
    # where nothing was checked in ball arithmetic
    log10_residual: float | None = None
    ball_states: int = (
        0  # real states at which coefficients were solved for in ball arithmetic
    )
    rounding: float = 0.0  # with loops, the last decimal of the file, to which the set holds; 0 where it is exact
    other_values: int = 0  # random values of the symbols at which formulas were checked in ball arithmetic, too
    closed: bool = (
        False  # whether states are closed ones of loops, near the assembly pose
    )
    columns: Mapping[str, int] = field(
        default_factory=dict
    )  # number of columns that each kind of check reached
    unchecked: tuple[
        str, ...
    ] = ()  # claims that no check reached; the set is not valid as a whole then

    @property
    def in_balls(self) -> bool:
        """Whether it was checked at real states in ball arithmetic, and not modulo primes."""
        return not self.identity_primes

    @property
    def holds(self) -> str:
        """For whom the set was shown to hold: for which values of the symbols, and where."""
        values = (
            "at the stated values"
            if self.at_values
            else "for general values of the symbols"
        )
        return f"{values}, near the assembly pose" if self.closed else values

    @property
    def assumptions(self) -> tuple[str, ...]:
        """The assumptions of the certificate, by the headings of ``docs/assumptions.md``."""
        found = ["Random points", "Exact decimals"]
        if not self.at_values:
            found.append("Generic constants")
        if self.regions_note:
            found.append("Regions of signs")
        if self.in_balls:
            found.append("Closed loops" if self.closed else "Functions")
        return tuple(found)

    def __str__(self) -> str:
        where = " at the stated values" if self.at_values and not self.in_balls else ""
        how = f"mod {self.minor_prime}" if self.minor_prime else "in ball arithmetic"
        text = f"rank {self.rank} proved from below by a non-zero minor{where} {how}; completeness X·N = 0 checked "
        text += "; ".join(self._completeness)
        text += f", {self.regions_note}" if self.regions_note else ""
        if self.unchecked:
            return f"{text}; not checked: {'; '.join(self.unchecked)}"
        return text

    @property
    def _completeness(self) -> list[str]:
        """How X · N = 0 was checked."""
        found = []
        if self.identity_primes:
            found.append(
                f"modulo {len(self.identity_primes)} primes of {CERTIFICATE_BITS} bits, error probability below "
                f"1e{int(self.log10_error)}"
            )
        if self.numbers and not self.in_balls:
            exactly = ", exactly" if self.log10_residual is None else ""
            found.append(
                f"{self.numbers} columns of numbers at the stated values only{exactly}"
            )
        if self.log10_residual is not None:
            closed = "closed states" if self.closed else "states"
            found.append(
                f"in ball arithmetic at {self.ball_states} {closed}, residual below 1e{int(self.log10_residual)}"
            )
        if self.rounding:
            found.append(
                f"to the last decimals of the file ({self.rounding:.0e} of its size)"
            )
        if self.other_values:
            found.append(
                f"formulas also at {self.other_values} other values of the symbols"
            )
        return found


@dataclass(frozen=True)
class AtStatedValues:
    """A model at the stated values of its symbols."""

    record: Callable[[], LinearForms]  # records X with exact values put in
    texts: Mapping[str, str]  # exact values as text; radians for angles
    special: bool  # whether there are symbols with values, so that these may be special
    everywhere: bool  # whether all symbols have a value
    # whether angles are fractions of π such as π/7, whose sines satisfy relations that random residues do not
    fractions_of_pi: bool = False
    approximate: tuple[
        str, ...
    ] = ()  # symbols of which only rounded values are known, which count as general
    # X for general values and values to draw there, where that is the same as recording it with these put in
    drawn: tuple[LinearForms, StatedValues] | None = None

    @property
    def says_something(self) -> bool:
        """Whether it is a robot at hand, and not one of which no symbol has a value."""
        return self.special or self.everywhere

    def minor(self, columns: tuple[int, ...], rng: np.random.Generator) -> Minor:
        """A non-zero minor of some columns at the values.

        Raises
        ------
        InputError
            If an entry divides by zero there.
        """
        if self.drawn is None:
            return find_minor(self.forms, columns, rng)
        forms, values = self.drawn
        return find_minor(forms, columns, rng, values)

    @cached_property
    def forms(self) -> LinearForms:
        """X with exact values put in, recorded once.

        Raises
        ------
        InputError
            If an entry divides by zero then.
        """
        return self.record()


def certify(
    regressor: LinearForms,
    matrix: BaseMatrix,
    seed: int,
    stated: AtStatedValues | None = None,
    doubt: str = "",
) -> Certificate:
    """Check a base parameter set against a regressor.

    Parameters
    ----------
    regressor : LinearForms
        Rows uᵀX for general values of the symbols.
    matrix : BaseMatrix
        The claimed set.
    seed : int
    stated : AtStatedValues, optional
        The model at its stated values; a set for general values if omitted.
    doubt : str
        With loops, why the mode that states near the assembly pose belong to cannot be told.

    Returns
    -------
    Certificate

    Raises
    ------
    CertificateError
        If the set is too large, incomplete or wrong, or some column is reached by no check.
    """
    _check_echelon(matrix)
    if regressor.shape[1] != len(matrix.parameters):
        raise CertificateError(
            f"the set has {len(matrix.parameters)} standard parameters, the model {regressor.shape[1]}"
        )
    _check_numbers(matrix, _rounding(regressor, matrix))
    rng = random_generator(seed)
    checks = _Checks(regressor, matrix, stated, rng, doubt)
    if regressor.rational:
        checks.modulo_primes()
    else:
        checks.at_real_states()
    return checks.certificate(seed)


class _Checks:
    """Checks of one set, and the columns that each of them reached."""

    def __init__(
        self,
        regressor: LinearForms,
        matrix: BaseMatrix,
        stated: AtStatedValues | None,
        rng: np.random.Generator,
        doubt: str,
    ) -> None:
        self.regressor = regressor
        self.matrix = matrix
        self.stated = stated
        self.rng = rng
        self.numbers = set(matrix.numbers.columns) if matrix.numbers else set[int]()
        self.reached: dict[str, set[int]] = {}
        self.doubt = doubt
        self.unchecked = [doubt] if doubt else list[str]()
        self.minor: Minor | None = None
        self.at_values = False
        self.primes: tuple[int, ...] = ()
        self.degree, self.log10_error, self.other_values = 0, 0.0, 0
        self.rounding = 0.0
        self.balls: BallEvidence | None = None

    def certificate(self, seed: int) -> Certificate:
        """The evidence, if every column was reached."""
        matrix, minor, balls = self.matrix, self.minor, self.balls
        reached = set[int]().union(*self.reached.values())
        missed = [
            name
            for column, name in enumerate(matrix.parameters)
            if column not in reached
        ]
        if missed or minor is None:
            raise CertificateError(
                f"no check reaches {', '.join(missed[:4]) or 'the representatives'}"
            )
        regions, note = 0, ""
        closed, signs = self.regressor.loops is not None, self.regressor.has_signs
        if signs and not closed:
            points = self.regressor.points
            regions, note = points.count, str(points.report)
            if points.report.unseen:
                self.unchecked.append(points.report.unseen)
            if self.stated is None and points.constants:
                names = ", ".join(points.constants)
                self.unchecked.append(
                    f"other signs of what depends on {names}, which decide about regions"
                )
        elif signs:
            note = "signs at random states of all speeds"
            if not has_plain_signs(self.regressor, self.rng):
                self.unchecked.append("regions of signs that random closed states miss")
        return Certificate(
            matrix.rank,
            seed,
            minor.prime,
            minor.states,
            self.primes,
            self.degree,
            self.log10_error,
            at_values=self.at_values,
            regions=regions,
            regions_note=note,
            numbers=len(self.numbers),
            log10_residual=balls.log10_residual if balls else None,
            ball_states=balls.states if balls else 0,
            other_values=self.other_values,
            closed=closed,
            rounding=self.rounding,
            columns={kind: len(columns) for kind, columns in self.reached.items()},
            unchecked=tuple(self.unchecked),
        )

    # -- where rows are rational in free states ---------------------------------------------------------------------

    def modulo_primes(self) -> None:
        """Check modulo primes, rounded numbers also in ball arithmetic."""
        self._minor_modulo_primes()
        self._identity(self.regressor, self._others() - self.numbers)
        if not self.numbers:
            return
        stated, numbers = self.stated, self.matrix.numbers
        assert numbers is not None
        if stated is None:
            raise CertificateError(
                "columns of numbers hold at stated values only, and the model is missing"
            )
        if not self._exactly(stated, numbers):
            check_spanned(stated.forms, self.matrix, self.numbers, self.rng)
            self.balls = check_in_balls(
                self.regressor, self.matrix, self.numbers, stated.texts, self.rng
            )
        self.reached[NUMBERS] = self.numbers

    def _exactly(self, stated: AtStatedValues, numbers: StatedNumbers) -> bool:
        """Whether exact numbers hold modulo primes; of angles with irrational sines residues show this less often."""
        if numbers.radius:
            return False
        only = _with_numbers_only(self.matrix)
        identity = Identity(stated.forms, only, self.numbers, self.rng)
        try:
            for _ in range(AGREEING_POINTS):
                identity.holds_modulo(CERTIFICATE_BITS)
        except CertificateError:
            if numbers.exact(frozenset(self.regressor.sampler().angles)) is not None:
                raise
            return False
        return True

    def _minor_modulo_primes(self) -> None:
        """A minor at the stated values, if there are any."""
        stated, matrix = self.stated, self.matrix
        if stated is None:
            self._take(find_minor(self.regressor, matrix.pivots, self.rng))
            return
        try:
            self._take(stated.minor(matrix.pivots, self.rng))
            if stated.fractions_of_pi:
                self._require_in_balls(stated)
            self.at_values = stated.says_something and not stated.approximate
        except InputError as error:
            self._take(find_minor(self.regressor, matrix.pivots, self.rng))
            self._minor_in_balls(stated, str(error))

    def _require_in_balls(self, stated: AtStatedValues) -> None:
        """A minor in ball arithmetic, where fractions of π have their true sines."""
        try:
            check_in_balls(self.regressor, self.matrix, (), stated.texts, self.rng)
        except CertificateError as error:
            raise CertificateError(
                f"{error}.  Echelon does not detect sums of angles from values other than multiples of 15°: write "
                "one angle in terms of the other, such as  alpha: pi - beta"
            ) from None

    def _minor_in_balls(self, stated: AtStatedValues, reason: str) -> None:
        """A minor at the stated values where primes show none; else it is named as not checked."""
        try:
            evidence = check_in_balls(
                self.regressor, self.matrix, (), stated.texts, self.rng
            )
        except CertificateError as error:
            self.unchecked.append(
                f"independence at the stated values ({reason}; {error})"
            )
        else:
            self.minor = Minor(self.matrix.rank, 0, evidence.states)
            self.at_values = True

    # -- loops and functions ----------------------------------------------------------------------------------------

    def at_real_states(self) -> None:
        """Check all columns at real states: at the stated values of the symbols, and formulas at others, too."""
        matrix, stated = self.matrix, self.stated
        others = self._others()
        everywhere = stated is not None and stated.everywhere
        loops = self.regressor.loops
        self.rounding = _rounding(self.regressor, matrix)
        if loops is not None and self.rounding:
            evidence = check_to_rounding(
                self.regressor, matrix, loops.mechanism, self.rng
            )
            self._take_balls(evidence, others)
            self.at_values = True
            return
        if self.numbers and not everywhere:
            raise CertificateError(
                "columns of numbers hold at stated values only, and some symbols have none"
            )
        if self._holds_for_free_functions(others - self.numbers):
            others = self.numbers
        formulas = others - self.numbers
        if (formulas and matrix.symbols) or not everywhere:
            self._at_other_values(formulas)
        if stated is not None and everywhere:
            try:
                self._take_balls(
                    check_in_balls(
                        self.regressor, matrix, others, stated.texts, self.rng
                    ),
                    others,
                )
            except DegenerateSampleError as error:
                raise CertificateError(f"at the stated values {error}") from None
            self.at_values = True
        elif stated is not None and (
            self.regressor.loops is not None or stated.says_something
        ):
            self.unchecked.append(
                "independence at the stated values (some symbols have no value)"
            )

    def _holds_for_free_functions(self, formulas: set[int]) -> bool:
        """Whether formulas hold whatever the functions are, which is known modulo primes as for rational rows."""
        freed = self.regressor.freed
        if freed is None or not formulas:
            return False
        try:
            self._identity(freed, formulas)
        except CertificateError:
            return False
        return True

    def _at_other_values(self, formulas: set[int]) -> None:
        """Compare formulas at random values of the symbols, each of which a false one satisfies by rare chance."""
        states = RealStates(Rows(self.regressor, 0))
        count = RANDOM_GEOMETRIES if states.symbols and formulas else 1
        self.other_values = count if formulas else 0
        for _ in range(count):
            self._take_balls(self._near(states, formulas), formulas)

    def _near(self, states: RealStates, formulas: set[int]) -> BallEvidence:
        """Evidence at random values of the symbols at which there are real states."""
        for _ in range(MOST_ATTEMPTS):
            try:
                return check_in_balls(
                    self.regressor,
                    self.matrix,
                    formulas,
                    states.elsewhere(self.rng),
                    self.rng,
                )
            except DegenerateSampleError:
                continue
        raise CertificateError(
            "there are no real states at random values of the symbols near the stated ones"
        )

    def _take_balls(self, evidence: BallEvidence, columns: set[int]) -> None:
        """Keep evidence in balls, with the largest residual of all."""
        self._take(Minor(self.matrix.rank, 0, evidence.states))
        if not columns:
            return
        largest = max(
            evidence.log10_residual,
            self.balls.log10_residual if self.balls else evidence.log10_residual,
        )
        self.balls = BallEvidence(evidence.states, largest)
        self.reached[BALLS] = self.reached.get(BALLS, set()) | columns

    # -- all --------------------------------------------------------------------------------------------------------

    def _others(self) -> set[int]:
        """Columns that are no pivots."""
        return set(range(len(self.matrix.parameters))) - set(self.matrix.pivots)

    def _take(self, minor: Minor) -> None:
        """Keep a minor of all representatives."""
        if minor.rank < self.matrix.rank:
            shown = max(minor.rank, 0)
            raise CertificateError(
                f"the set is too large: its {self.matrix.rank} representatives span only {shown} dimensions"
            )
        self.minor = minor
        self.reached[MINOR] = set(self.matrix.pivots)

    def _identity(self, regressor: LinearForms, columns: Collection[int]) -> None:
        """X = X̄ B in columns with closed forms."""
        identity = Identity(regressor, self.matrix, columns, self.rng)
        self.primes, self.degree, self.log10_error = identity.holds()
        self.reached[IDENTITY] = set(columns)


def _rounding(regressor: LinearForms, matrix: BaseMatrix) -> float:
    """Rounding of the file, beside sizes, to which the set claims to hold; 0 where it claims to hold exactly."""
    loops, numbers = regressor.loops, matrix.numbers
    if loops is None or numbers is None or not numbers.rounded:
        return 0.0
    return loops.mechanism.rounding


def _check_numbers(matrix: BaseMatrix, rounding: float) -> None:
    """Refuse columns of numbers that are no numbers, or that are so rounded that they say too little."""
    numbers = matrix.numbers
    if numbers is None:
        return
    chosen = set(numbers.columns)
    coefficients = [
        value
        for row in matrix.rows
        for column, value in row.items()
        if column in chosen
    ]
    if any(value.symbols() for value in coefficients):
        raise CertificateError("a coefficient in a column of numbers is not a number")
    size = max((abs(value.evaluate({}, float)) for value in coefficients), default=0.0)
    if not rounding and not numbers.radius <= NEGLIGIBLE_ERROR * max(1.0, size):
        raise CertificateError(
            f"numbers with errors of {numbers.radius:.0e} prove nothing"
        )


def _with_numbers_only(matrix: BaseMatrix) -> BaseMatrix:
    """B without the columns that hold for general values: symbols have none where stated values are put in."""
    assert matrix.numbers is not None
    kept = {*matrix.pivots, *matrix.numbers.columns}
    rows = tuple(
        {column: value for column, value in row.items() if column in kept}
        for row in matrix.rows
    )
    return replace(matrix, rows=rows)


def _check_echelon(matrix: BaseMatrix) -> None:
    """Rows sorted by pivot, leading 1, nothing before it, nothing else in pivot columns."""
    position = {column: k for k, column in enumerate(matrix.order)}
    if sorted(matrix.order) != list(range(len(matrix.parameters))):
        raise CertificateError(
            "the column order is not a permutation of the parameters"
        )
    if len(matrix.rows) != matrix.rank:
        raise CertificateError(
            f"{len(matrix.rows)} rows but {matrix.rank} representatives"
        )
    places = [position[p] for p in matrix.pivots]
    if places != sorted(set(places)):
        raise CertificateError(
            "the representatives are not in the order of the columns"
        )
    pivots = set(matrix.pivots)
    for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
        name = matrix.parameters[pivot]
        if row.get(pivot) != 1:
            raise CertificateError(
                f"the coefficient of the representative {name} is not 1"
            )
        for column, coefficient in row.items():
            other = matrix.parameters[column]
            if column != pivot and column in pivots:
                raise CertificateError(
                    f"row {name} contains the representative {other}"
                )
            if position[column] < position[pivot] and coefficient:
                raise CertificateError(
                    f"row {name} contains {other}, which comes before it in the column order"
                )
