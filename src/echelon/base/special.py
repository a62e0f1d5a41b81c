"""Special geometry: conditions on symbols and on gravity at which the number of base parameters changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from echelon.algebra import DEFAULT_SEED, Polynomial, cosine, random_generator, sine
from echelon.base.stated_values import MOST_STRUCTURES
from echelon.base.structure import find_structure
from echelon.robot import (
    Mechanism,
    Readable,
    Vector,
    mechanism_of,
    substituted,
    symbol_roles,
)
from echelon.shared import public

_ZERO, _ONE = Polynomial({}), Polynomial.constant(1)
_TURNS = (
    ("0", _ONE, _ZERO),
    ("90°", _ZERO, _ONE),
    ("180°", -_ONE, _ZERO),
    ("-90°", _ZERO, -_ONE),
)
_GRAVITY = "gravity"
_AXES = (("x", (1, 0, 0)), ("y", (0, 1, 0)), ("z", (0, 0, 1)))


@dataclass(frozen=True)
class SpecialCase:
    """A condition and the rank where it holds and everything else is generic."""

    condition: str
    rank: int

    def __str__(self) -> str:
        return f"{self.condition}: {self.rank}"


@public
@dataclass(frozen=True)
class SpecialGeometry:
    """Conditions at which the rank of a mechanism changes.

    Attributes
    ----------
    rank : int
        For generic values of the symbols.
    tried : int
        Number of conditions and pairs of conditions that were tried.
    cases : tuple of SpecialCase
        Conditions that change the rank, and pairs that change it further than either alone.
    seed : int
    left_out : int
        Pairs of conditions that were not tried, because there are too many.
    """

    rank: int
    tried: int
    cases: tuple[SpecialCase, ...]
    seed: int
    left_out: int = 0


@dataclass(frozen=True, eq=False)
class _Condition:
    """Expressions for generators, or a gravity, that hold in a special case."""

    text: str
    symbols: frozenset[str]
    put_in: Mapping[str, Polynomial]
    gravity: Vector | None = None

    def __and__(self, other: _Condition) -> _Condition:
        text, symbols = f"{self.text}, {other.text}", self.symbols | other.symbols
        return _Condition(
            text,
            symbols,
            {**self.put_in, **other.put_in},
            self.gravity or other.gravity,
        )

    def of(self, mechanism: Mechanism) -> Mechanism:
        """The mechanism under this condition."""
        special = substituted(mechanism, self.put_in)
        if _GRAVITY not in self.symbols:
            return special
        return replace(
            special,
            gravity=self.gravity if self.gravity and any(self.gravity) else None,
        )


@public
def special_geometry(
    mechanism: Mechanism | Readable, *, seed: int = DEFAULT_SEED
) -> SpecialGeometry:
    """Try special values of the symbols and special directions of gravity, one at a time and two together.

    Each length or other constant is set to zero, each pair of them equal and opposite, each angle to a multiple of
    90°, and gravity along each axis of the base frame and to nothing.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        A robot, or the file of one.
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
    g = 0, l1 = 0: 2
    l1 = 0, gravity along z: 2
    l1 = 0, no gravity: 2
    """
    mechanism = mechanism_of(mechanism)
    rng = random_generator(seed)
    rank = find_structure(mechanism, rng).rank
    single = list(_conditions(mechanism))
    alone = {
        condition: find_structure(condition.of(mechanism), rng).rank
        for condition in single
    }
    cases = [
        SpecialCase(condition.text, found)
        for condition, found in alone.items()
        if found != rank
    ]
    pairs = [(a, b) for a, b in combinations(single, 2) if not a.symbols & b.symbols]
    for a, b in pairs[:MOST_STRUCTURES]:
        found = find_structure((a & b).of(mechanism), rng).rank
        if found < min(alone[a], alone[b]):
            cases.append(SpecialCase((a & b).text, found))
    tried = len(single) + min(len(pairs), MOST_STRUCTURES)
    return SpecialGeometry(
        rank, tried, tuple(cases), seed, max(0, len(pairs) - MOST_STRUCTURES)
    )


def _conditions(mechanism: Mechanism) -> Iterator[_Condition]:
    roles = symbol_roles(mechanism)
    plain = sorted(roles.symbols - roles.angles)
    angles = sorted(roles.symbols & roles.angles)
    for name in plain:
        yield _Condition(f"{name} = 0", frozenset({name}), {name: _ZERO})
    for first, second in combinations(plain, 2):
        for sign, text in ((1, ""), (-1, "-")):
            value = Polynomial.generator(second) * sign
            yield _Condition(
                f"{first} = {text}{second}", frozenset({first, second}), {first: value}
            )
    for name in angles:
        for degrees, c, s in _TURNS:
            yield _Condition(
                f"{name} = {degrees}",
                frozenset({name}),
                {cosine(name): c, sine(name): s},
            )
    own = frozenset(
        {
            _GRAVITY,
            *(symbol for part in mechanism.gravity or () for symbol in part.symbols()),
        }
    )
    for axis, direction in _AXES:
        x, y, z = (Polynomial.constant(component) for component in direction)
        yield _Condition(f"gravity along {axis}", own, {}, (x, y, z))
    yield _Condition("no gravity", own, {}, None)
