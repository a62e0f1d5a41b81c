"""How rich a motion must be: ranks of motions that are Fourier series or polynomials in time.

The coefficients of a family are random numbers, the same at all times; any others show as much, but for a set of
measure zero.  Rates are then functions of one phase.  A turning coordinate enters rows by its sine and cosine alone:
these are free, since for almost all coefficients exponentials of different values of a series are algebraically
independent (Ax, Annals of Mathematics 93, 1971).  Where a coordinate enters by its value, as of slides and springs, it
is the series itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from echelon.algebra import DEFAULT_SEED, Program, Scalar, random_generator
from echelon.base.stated_values import at_stated_values
from echelon.base.structure import linear_structure
from echelon.dynamics import powers_along
from echelon.robot import Mechanism, MotionKind, Readable, mechanism_of, read_term
from echelon.shared import Count, InputError, public

Family = Literal["fourier", "polynomial"]
PHASE = "t"
_SPREAD = 10**6  # random coefficients are whole numbers up to this size, over it


@public
def motion_ranks(
    mechanism: Mechanism | Readable,
    family: Family = "fourier",
    most: Count = 8,
    *,
    seed: int = DEFAULT_SEED,
) -> tuple[int, ...]:
    """Ranks of motions with one, two, … terms in every coordinate, until they reach that of all motions.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        Without loops and contacts.  The stated values of its symbols decide.
    family : "fourier" or "polynomial"
        Series of harmonics of one frequency, or polynomials in time.
    most : int
        Largest number of harmonics, or degree, that is tried.
    seed : int
        Seed of the coefficients.

    Returns
    -------
    tuple of int
        The rank for 1, 2, … harmonics, or degrees; the last one is that of all motions, unless ``most`` is reached.

    Raises
    ------
    InputError
        If the mechanism has loops, contacts, balls, or effects with signs such as dry friction.

    Examples
    --------
    >>> import echelon as ec
    >>> ec.motion_ranks("examples/panda.yaml"), ec.motion_ranks("examples/cart_pole.yaml")
    ((43,), (4,))
    """
    robot = at_stated_values(mechanism_of(mechanism))
    if robot.closures or robot.contacts:
        raise InputError("motions of robots with loops or contacts are not free series")
    if any(motion.kind is MotionKind.BALL for motion in robot.motions):
        raise InputError(
            "a free rotation is not a series: hold it, or replace it by three turns"
        )
    rng = random_generator(seed)
    every = powers_along(robot, Program(), {})
    if every.has_signs:
        raise InputError(
            "the number of sign changes of a series depends on its coefficients: leave out effects with signs, "
            "such as dry friction"
        )
    whole = linear_structure(every, rng).rank
    found = list[int]()
    while len(found) < most and found[-1:] != [whole]:
        found.append(_rank(robot, family, len(found) + 1, rng))
    return tuple(found)


def _rank(
    robot: Mechanism, family: Family, terms: int, rng: np.random.Generator
) -> int:
    """Rank of a motion with some terms."""
    program = Program()
    phase = program.input(PHASE)
    basis = list((_harmonics if family == "fourier" else _powers)(phase, terms))
    valued = _by_value(robot)
    given = dict[str, Scalar]()
    for motion in robot.free_motions:
        series = _Series([_random(rng) for _ in basis], basis, program)
        name = motion.name
        given |= {
            f"qd[{name}]": series.derivative(1),
            f"qdd[{name}]": series.derivative(2),
        }
        if name in valued:
            given[f"q[{name}]"] = series.derivative(0) + program.constant(_random(rng))
    return linear_structure(powers_along(robot, program, given), rng).rank


@dataclass(frozen=True)
class _Series:
    """A sum of basis functions."""

    coefficients: Sequence[Fraction]
    basis: Sequence[tuple[Scalar, Scalar, Scalar]]  # with first and second derivative
    program: Program

    def derivative(self, order: int) -> Scalar:
        """Its value, or that of a derivative by the phase."""
        pairs = zip(self.coefficients, self.basis, strict=True)
        terms = [functions[order] * self.program.constant(c) for c, functions in pairs]
        return sum(terms, self.program.zero)


def _harmonics(phase: Scalar, count: int) -> Iterator[tuple[Scalar, Scalar, Scalar]]:
    """Cosines and sines of multiples of the phase."""
    c, s = first = phase.cos(), phase.sin()
    for k in range(1, count + 1):
        yield c, s * -k, c * -(k * k)
        yield s, c * k, s * -(k * k)
        c, s = c * first[0] - s * first[1], s * first[0] + c * first[1]


def _powers(phase: Scalar, degree: int) -> Iterator[tuple[Scalar, Scalar, Scalar]]:
    """Powers of the phase, from the first."""
    zero, one = phase.program.zero, phase.program.one
    below = [zero, one]  # powers -1 (which its factor cancels) and 0
    for k in range(1, degree + 1):
        power = below[-1] * phase
        yield power, below[-1] * k, below[-2] * (k * (k - 1))
        below.append(power)


def _random(rng: np.random.Generator) -> Fraction:
    return Fraction(int(rng.integers(1, _SPREAD)) * int(rng.choice([-1, 1])), _SPREAD)


def _by_value(robot: Mechanism) -> set[str]:
    """Coordinates that enter rows by more than their sine and cosine."""
    found = {m.name for m in robot.motions if m.kind is not MotionKind.ROTATION}
    found |= {name for coupling in robot.couplings for name, _ in coupling.terms}
    drives = {a.name: [name for name, _ in a.terms] for a in robot.actuators}
    for effect in robot.effects:
        for action in effect.actions:
            places = {
                q.at or action.at
                for q in read_term(action.term).quantities
                if q.name == "q"
            }
            found |= {name for place in places for name in drives.get(place, [place])}
    return found
