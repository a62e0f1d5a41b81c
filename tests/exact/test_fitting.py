"""Interpolation: functions known beforehand are found again from nothing but their values modulo primes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from echelon.algebra.exact.ansatz import sections
from echelon.algebra.exact.expressions import parse
from echelon.algebra.exact.field import PrimeField, Residues
from echelon.algebra.exact.interpolation import interpolate
from echelon.algebra.exact.polynomial import Polynomial
from echelon.algebra.exact.rational import RationalFunction
from echelon.algebra.exact.unknown_functions import UnknownFunctions, Work
from echelon.shared.errors import ClosedFormError, DegenerateSampleError
from support.selection import examples

LENGTHS, ANGLES, OTHERS = ("d", "r", "l3"), ("a", "b"), ("g", "k")


@dataclass(frozen=True)
class Known:
    """Functions that interpolation has to find, written ``numerator`` or ``numerator : denominator``."""

    texts: Sequence[str]
    degrees: Sequence[int] | None = None
    irrational: tuple[bool, bool] = (False, False)
    symbols: Sequence[str] = (*LENGTHS, *ANGLES, *OTHERS)

    @property
    def functions(self) -> list[RationalFunction]:
        return [RationalFunction(*map(parse, text.split(":"))) for text in self.texts]

    def evaluate(self, field: PrimeField, geometry: Any) -> Residues:
        points = dict(geometry.items())
        for angle in ANGLES:
            if angle in geometry:
                points[f"cos({angle})"], points[f"sin({angle})"] = field.circle(
                    geometry[angle]
                )
        points = {name: x.astype(object) for name, x in points.items()}
        count = len(next(iter(points.values()))) if points else 1
        rows = [
            _residues(f.numerator, points, field, count)
            * field.invert_array(_residues(f.denominator, points, field, count))
            % field.p
            for f in self.functions
        ]
        return np.array(rows, dtype=np.int64).reshape(len(rows), count)

    def unknown(self) -> UnknownFunctions:
        degrees = [0] * len(self.texts) if self.degrees is None else self.degrees
        names = self.symbols
        lengths, angles = (
            frozenset(names) & {*kind} for kind in ((*LENGTHS, *"uvwxyz"), ANGLES)
        )
        return UnknownFunctions(
            self.evaluate, names, angles, lengths, degrees, self.irrational
        )


def _residues(
    polynomial: Polynomial, points: dict[str, Residues], field: PrimeField, count: int
) -> Residues:
    values = np.zeros(count, dtype=object) + polynomial.evaluate(points, field.embed)
    residues: Residues = (values % field.p).astype(np.int64)
    return residues


KNOWN = {
    "lengths": Known(["d", "2*d*r - r^2/3", "l3^2", "0", "1"], [1, 2, 2, 2, 0]),
    "angles": Known(["cos(a)^2", "sin(a)*cos(a)*cos(b)", "sin(b)/2 - 1"]),
    "others": Known(["g*k", "3*k + 1/7", "g^2 - k"]),
    "everything": Known(["d*cos(a) - r*sin(a)*cos(b)", "g*d^2*sin(b)"], [1, 2]),
    "decimals": Known(
        ["0.0825*d + 0.31612345*r", "0.000123*d^2 - 0.27035*l3*r"], [1, 2]
    ),
    "several primes": Known(
        [
            "123456789012345678901/98765432109876543211*d - 31415926535897932384626*r",
            "2*d",
        ],
        [1, 1],
    ),
    "sqrt 2": Known(["sqrt(2)*d/2 + r", "3 - 2*sqrt(2)"], [1, 0], (True, False)),
    "sqrt 3": Known(["sqrt(3)*cos(a)/3 - 1/7"], [0], (False, True)),
    "all roots": Known(
        ["(1 + sqrt(2) - sqrt(3)/5 + 0.123456789*sqrt(6))*d", "sqrt(6)*g", "5"],
        [1, 0, 0],
        (True, True),
    ),
    "ratios": Known(["d : d + r", "d^2 - 3*r*l3 : 2*r + l3", "d : l3"], [0, 1, 0]),
    "negative degree": Known(["1 : d", "d : r^2 + l3^2"], [-1, -1]),
    "quotients of angles": Known(["cos(a) : sin(a)", "1 : 2 + cos(b)"]),
    "quotients of others": Known(["1 : 1 + k", "g : k"]),
    "quotients with roots": Known(
        ["d : r + sqrt(2)*d", "1 : k*sqrt(3)"], [0, 0], (True, True)
    ),
    "many symbols": Known(
        ["v*x - 2*z^2", "k", "1", "r*y"],
        [2, 0, 0, 2],
        symbols=(*LENGTHS, *OTHERS, *"uvwxyz"),
    ),
    "no symbols": Known(["22/7", "0", "-1"], symbols=()),
    "no symbols but roots": Known(
        ["1/3 + sqrt(2)"], irrational=(True, False), symbols=()
    ),
    "no functions": Known([]),
}


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("known", KNOWN.values(), ids=KNOWN.keys())
def test_known_functions_are_found(known: Known, seed: int) -> None:
    found = interpolate(known.unknown(), np.random.default_rng(seed))
    assert found == known.functions
    assert [f.is_polynomial for f in found] == [":" not in text for text in known.texts]


def _linear_combination(coefficients: Iterable[Any]) -> str:
    monomials = ("d", "r*cos(a)", "l3*sin(a)*cos(b)", "k*d")
    return " + ".join(
        f"({c.numerator})*{m}/{c.denominator}"
        for c, m in zip(coefficients, monomials, strict=True)
    )


@examples(15)
@given(
    st.lists(st.fractions(max_denominator=10**9), min_size=4, max_size=4),
    st.integers(0, 99),
)
def test_random_coefficients_are_found(coefficients: list[Any], seed: int) -> None:
    known = Known([_linear_combination(coefficients)], [1])
    assert interpolate(known.unknown(), np.random.default_rng(seed)) == known.functions


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("irrational", [(False, False), (True, True)])
def test_one_prime_is_not_believed_alone(
    irrational: tuple[bool, bool], index: int
) -> None:
    """The coefficient is 1 modulo one of the first primes that the generator gives."""
    rng = np.random.default_rng(7)
    primes = [PrimeField.random(rng).p for _ in range(3)]
    known = Known([f"{1 + primes[index]}"], irrational=irrational, symbols=())
    assert interpolate(known.unknown(), np.random.default_rng(7)) == known.functions


def test_the_same_prime_twice_adds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(8)
    fields = [PrimeField.random(rng) for _ in range(12)]
    pending = iter([f for f in fields for _ in range(3)])
    monkeypatch.setattr(PrimeField, "random", staticmethod(lambda *_: next(pending)))
    known = KNOWN["several primes"]
    assert interpolate(known.unknown(), rng) == known.functions


def test_singular_geometries_are_drawn_again() -> None:
    known = KNOWN["ratios"]
    calls = []

    def evaluate(field: PrimeField, geometry: Any) -> Residues:
        calls.append(geometry)
        if len(calls) % 2:
            raise DegenerateSampleError("unlucky")
        return known.evaluate(field, geometry)

    assert (
        interpolate(
            replace(known.unknown(), evaluate=evaluate), np.random.default_rng(9)
        )
        == known.functions
    )


def _always_singular(_field: PrimeField, _geometry: Any) -> Residues:
    raise DegenerateSampleError("unlucky")


def _noise(field: PrimeField, geometry: Any) -> Residues:
    return field.draw(np.random.default_rng(), (1, len(geometry["k"])))


@pytest.mark.parametrize("budget", [0, 1])
def test_singular_everywhere_is_an_error(budget: float) -> None:
    unknown = UnknownFunctions(
        _always_singular, ["k"], frozenset(), frozenset(), [0], (False, False)
    )
    with pytest.raises(ClosedFormError, match="singular" if budget else "budget"):
        interpolate(unknown, np.random.default_rng(10), Work.of(budget))


def test_what_has_no_closed_form_is_left_open() -> None:
    unknown = UnknownFunctions(
        _noise, ["k"], frozenset(), frozenset(), [0], (False, False)
    )
    assert interpolate(unknown, np.random.default_rng(10)) == [None]


def test_functions_that_cost_too_much_are_left_open() -> None:
    """A function with many terms is left out beside a short one, whatever the order."""
    known = Known(
        ["d + r", " + ".join(f"{k}*g^{k}*k^{7 - k}*d" for k in range(1, 7)), "d"],
        [1, 1, 1],
    )
    assert interpolate(known.unknown(), np.random.default_rng(0)) == known.functions
    found = interpolate(known.unknown(), np.random.default_rng(0), Work(1e6, 3))
    assert [f is None for f in found] == [False, True, False]


def test_undeclared_roots_are_left_open() -> None:
    known = Known(["sqrt(2)*k"])
    assert interpolate(known.unknown(), np.random.default_rng(11)) == [None]


# -- along one symbol -------------------------------------------------------------------------------------------------

_integers = st.lists(st.integers(-50, 50), min_size=1, max_size=5).filter(any)


@examples(40)
@given(_integers, _integers, st.integers(0, 99))
def test_degrees_and_denominator_along_a_line(
    top: list[int], bottom: list[int], seed: int
) -> None:
    """Against SymPy's cancellation over the same field."""
    x = sympy.Symbol("x")
    rng = np.random.default_rng(seed)
    field = PrimeField.random(rng)
    quotient = [sympy.Poly(c, x, modulus=field.p) for c in (top, bottom)]
    shared = quotient[0].gcd(quotient[1])
    above, below = (part.quo(shared) for part in quotient)
    nodes = np.unique(field.draw(rng, (16,)))
    values = [
        int(quotient[0].eval(int(n)))
        * field.invert(int(quotient[1].eval(int(n))))
        % field.p
        for n in nodes
    ]
    (section,) = sections(nodes, np.array([values]), field, angle=False)
    assert section is not None
    monic = [int(c) % field.p for c in reversed(below.monic().all_coeffs())]
    assert (section.top, section.bottom, list(section.denominator)) == (
        above.degree(),
        below.degree(),
        monic,
    )


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("cos(a)^2*sin(a)", (3, 0)),
        ("cos(a) : sin(a)", (1, 1)),
        ("1 : 1 + cos(a)", (0, 1)),
        ("sin(a) : 2 + cos(a)^2", (1, 2)),
        ("3", (0, 0)),
    ],
)
def test_degrees_of_trigonometric_quotients(
    text: str, degrees: tuple[int, int]
) -> None:
    rng = np.random.default_rng(12)
    field = PrimeField.random(rng)
    nodes = field.draw(rng, (16,))
    (section,) = sections(
        nodes, Known([text]).evaluate(field, {"a": nodes}), field, angle=True
    )
    assert section is not None
    assert (section.top, section.bottom) == degrees


_factors = st.lists(
    st.sampled_from(["d", "r", "l3", "cos(a)", "sin(a)", "cos(b)", "sin(b)", "g", "k"]),
    max_size=5,
)
_sums = st.lists(st.tuples(st.integers(1, 99), _factors), min_size=1, max_size=6).map(
    lambda terms: " + ".join("*".join([str(c), *factors]) for c, factors in terms)
)
_denominators = st.sampled_from(
    [
        "1",
        "k",
        "cos(a)",
        "2 + sin(b)",
        "(1 + k)*cos(a)",
        "g + k",
        "3 + cos(a)*sin(b)",
        "1 - cos(a)^2",
        "k + cos(b)",
    ]
)


@examples(25)
@given(_sums, _denominators, st.integers(0, 99))
def test_random_quotients_are_found(top: str, bottom: str, seed: int) -> None:
    """No length is declared here, so that the terms may have any degrees."""
    known = Known([f"{top} : {bottom}"])
    unknown = replace(known.unknown(), lengths=frozenset())
    assert interpolate(unknown, np.random.default_rng(seed)) == known.functions


def test_many_symbols_cost_by_the_term() -> None:
    """Twelve symbols: all monomials of these degrees would be millions."""
    text = "d*cos(a)*sin(b)*g*k + r*l3*u*v^2 - 7*w*x*y*z*cos(b)^2 + sin(a)^1*z^2*k^2 : cos(b)"
    known = Known([text], symbols=(*LENGTHS, *ANGLES, *OTHERS, *"uvwxyz"))
    work = Work.of(1)
    unknown = replace(known.unknown(), lengths=frozenset())
    assert interpolate(unknown, np.random.default_rng(0), work) == known.functions
    assert Work.of(1).operations - work.operations < 5000
