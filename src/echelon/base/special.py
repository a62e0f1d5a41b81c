"""Special geometry: conditions on symbols and on gravity at which the number of base parameters changes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

from echelon.base.structure import find_structure
from echelon.exact.polynomial import Polynomial, is_trigonometric, symbol_of
from echelon.mechanism.mechanism import Mechanism, setup_expressions
from echelon.mechanism.placement import Placement
from echelon.mechanism.substitute import substituted
from echelon.seeds import DEFAULT_SEED, random_generator

_ZERO, _ONE = Polynomial({}), Polynomial.constant(1)
_TURNS = (("0", _ONE, _ZERO), ("90°", _ZERO, _ONE), ("180°", -_ONE, _ZERO), ("-90°", _ZERO, -_ONE))
_AXES = (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1)))


@dataclass(frozen=True)
class SpecialCase:
    """A condition and the rank where it holds and everything else is generic.

    Attributes
    ----------
    condition : str
    rank : int
    """

    condition: str
    rank: int

    def __str__(self) -> str:
        return f"{self.condition}: {self.rank}"


@dataclass(frozen=True)
class SpecialGeometry:
    """Where the rank of a mechanism changes.

    Attributes
    ----------
    rank : int
        For generic values of the symbols.
    tried : int
        Number of conditions that were tried, one at a time.
    cases : tuple of SpecialCase
        Those that change the rank.
    seed : int
    """

    rank: int
    tried: int
    cases: tuple[SpecialCase, ...]
    seed: int


def special_geometry(mechanism: Mechanism, *, seed: int = DEFAULT_SEED) -> SpecialGeometry:
    """Try special values of the symbols and special directions of gravity, one at a time.

    Each length or other constant is set to zero, each pair of them equal and opposite, each angle to a multiple of
    90°, and gravity along each axis of the base frame and to nothing.

    Parameters
    ----------
    mechanism : Mechanism
    seed : int

    Returns
    -------
    SpecialGeometry

    Examples
    --------
    >>> import echelon as ec
    >>> for case in ec.special_geometry(ec.load("examples/double_pendulum.yaml")).cases:
    ...     print(case)
    g = 0: 4
    gravity along z: 4
    no gravity: 4
    """
    rng = random_generator(seed)
    rank = find_structure(mechanism, rng).rank
    tried: int = 0
    cases: list[SpecialCase] = []
    for condition, special in _conditions(mechanism):
        tried += 1
        found = find_structure(special, rng).rank
        if found != rank:
            cases.append(SpecialCase(condition, found))
    return SpecialGeometry(rank, tried, tuple(cases), seed)


def _conditions(mechanism: Mechanism) -> Iterator[tuple[str, Mechanism]]:
    plain, angles = _symbols(mechanism)
    for name in plain:
        yield f"{name} = 0", substituted(mechanism, {name: _ZERO})
    for first, second in combinations(plain, 2):
        for sign, text in ((1, ""), (-1, "-")):
            value = Polynomial.generator(second) * sign
            yield f"{first} = {text}{second}", substituted(mechanism, {first: value})
    for name in angles:
        for degrees, cosine, sine in _TURNS:
            values = {f"cos({name})": cosine, f"sin({name})": sine}
            yield f"{name} = {degrees}", substituted(mechanism, values)
    for axis, direction in _AXES:
        x, y, z = (Polynomial.constant(component) for component in direction)
        yield f"gravity along {axis}", replace(mechanism, gravity=(x, y, z), reading=None)
    yield "no gravity", replace(mechanism, gravity=None, reading=None)


def _symbols(mechanism: Mechanism) -> tuple[list[str], list[str]]:
    """Symbols of the geometry and of gravity: lengths and other constants, and angles."""
    found: dict[str, bool] = {}
    expressions = [*(mechanism.gravity or ()), *setup_expressions(mechanism)]
    for body in mechanism.bodies:
        for step in body.joint.steps:
            if isinstance(step, Placement):
                expressions += [*step.translation, *(entry for row in step.rotation for entry in row)]
            else:
                expressions.append(step.pitch)
    for expression in expressions:
        for name in expression.generators():
            found[symbol_of(name)] = is_trigonometric(name)
    return sorted(s for s, angle in found.items() if not angle), sorted(s for s, angle in found.items() if angle)
