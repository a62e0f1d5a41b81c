"""Random points of a field: relations that hold for all real inputs hold at every sample, and no others do."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from echelon.algebra.exact.field import PrimeField, Residues
from echelon.algebra.exact.polynomial import surd
from echelon.algebra.program.sampling import sampler_of
from echelon.algebra.program.schedule import FieldSampler
from echelon.algebra.program.tape import Program, Scalar
from echelon.base.structure import linear_structure
from echelon.dynamics.linear_forms import LinearForms
from echelon.shared.errors import DegenerateSampleError
from support.strategies import FIELDS, SMALL_FIELD

Relation = Callable[[Program, Scalar, Scalar], Scalar]  # of states x and y
HALF, ROOT2 = Fraction(1, 2), surd(0, 1, 0, 0)


def turned(a: Scalar, b: Scalar) -> Scalar:
    """sin(a + b) by the addition theorem."""
    return a.sin() * b.cos() + a.cos() * b.sin()


def doubled(a: Scalar) -> Scalar:
    """sin 2a by the addition theorem."""
    return turned(a, a)


IDENTITIES: dict[str, Relation] = {
    "circle": lambda _p, x, _: x.sin() * x.sin() + x.cos() * x.cos() - 1,
    "odd and even": lambda _p, x, _: ((-x).sin() + x.sin()) * 2 + (-x).cos() - x.cos(),
    "double angle": lambda _p, x, _: (2 * x).sin() - doubled(x),
    "half angle": lambda _p, x, _: x.sin() - doubled(x / 2),
    "sum": lambda _p, x, y: (x + y).sin() - turned(x, y),
    "sum of multiples": lambda _p, x, y: (x / 3 - y).sin() - turned(x / 3, -y),
    "coupling": lambda _p, x, _: (
        (Fraction(3, 7) * x).sin() - turned(x / 7, Fraction(2, 7) * x)
    ),
    "large multiple": lambda _p, x, _: (10_000_000 * x).sin() - doubled(5_000_000 * x),
    "large and small multiples": lambda _p, x, _: (
        ((2 * x).sin() - doubled(x)) * (x / 1000).sin()
    ),
    "angle that cancels": lambda _p, x, y: (
        (x + y - x - y).sin() + ((x + y) - y - x).cos() - 1
    ),
    "product": lambda _p, x, y: (2 * (x * y)).sin() - doubled(x * y),
    "product and sum": lambda _p, x, y: (x - x * y).sin() - turned(x, -(x * y)),
    "irrational multiple": lambda _p, x, _: (
        (x * ROOT2 + x).sin() - turned(x * ROOT2, x)
    ),
    "function": lambda _p, x, _: (2 * x.sin()).sin() - doubled(x.sin()),
    "constant": lambda p, x, _: (x + 1).sin() - turned(x, p.one),
    "half of a constant": lambda p, _, __: p.one.sin() - doubled(p.constant(HALF)),
}

DIFFERENCES: dict[str, Relation] = {
    "sine and angle": lambda _p, x, _: x.sin() - x,
    "sine and cosine": lambda _p, x, _: x.sin() - x.cos(),
    "two angles": lambda _p, x, y: x.cos() - y.cos(),
    "two multiples": lambda _p, x, _: x.cos() - (2 * x).cos(),
    "tangent of the half": lambda _p, x, _: x.sin() - 2 * x / (1 + x * x),
    "irrational multiple": lambda _p, x, _: x.cos() - (x * ROOT2).cos(),
    "shift": lambda _p, x, _: x.cos() - (x + 1).cos(),
}


def recorded(relation: Relation) -> LinearForms:
    program = Program()
    x, y = program.input("x"), program.input("y")
    return LinearForms(program, {(0, 0): relation(program, x, y).node}, (1, 1))


def sample(relation: Relation, field: PrimeField, states: int = 20) -> Residues:
    values: Residues = (
        recorded(relation)
        .sampler()
        .evaluate(field, np.random.default_rng(0), states, {})
    )
    assert values.shape == (1, 1, states)
    return values.ravel()


RATIONAL = (
    "circle",
    "odd",
    "double",
    "half angle",
    "sum",
    "coupling",
    "large",
    "angle that",
    "sine",
    "two",
    "tangent",
)
"""Relations between functions of rational combinations of inputs, which primes know."""


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@pytest.mark.parametrize("name", IDENTITIES)
def test_identities_hold(name: str, field: PrimeField) -> None:
    forms = recorded(IDENTITIES[name])
    assert forms.rational == name.startswith(RATIONAL)
    assert linear_structure(forms, np.random.default_rng(0)).rank == 0
    if forms.rational:
        assert not sample(IDENTITIES[name], field).any()


@pytest.mark.parametrize("name", DIFFERENCES)
def test_other_relations_do_not_hold(name: str) -> None:
    forms = recorded(DIFFERENCES[name])
    assert forms.rational == name.startswith(RATIONAL)
    assert linear_structure(forms, np.random.default_rng(0)).rank == 1
    if forms.rational:
        values = sample(DIFFERENCES[name], SMALL_FIELD)
        assert values.all()
        assert len(set(values.tolist())) == len(values)


Columns = Callable[
    [Program, Scalar, Scalar], list[Scalar]
]  # of a state x and a symbol a

SPANS: dict[str, tuple[Columns, int]] = {
    "shifts": (
        lambda _p, x, _: [
            x.sin(),
            x.cos(),
            (x + 1).sin(),
            (x - Fraction("0.7853")).cos(),
        ],
        2,
    ),
    "symbols as shifts": (
        lambda _p, x, a: [
            x.sin(),
            x.cos(),
            (x + a).sin(),
            (x - 2 * a).cos(),
            (x - a * a).sin(),
        ],
        2,
    ),
    "squares": (
        lambda p, x, _: [x.sin() * x.sin(), x.cos() * x.cos(), (2 * x).cos(), p.one],
        2,
    ),
    "screw": (lambda _p, x, _: [x, x.sin(), x.cos(), x * x, x * x.sin()], 5),
    "constants": (
        lambda p, x, a: [a.sin(), (a * a).cos(), p.constant(2).sin(), p.one, (x - x)],
        1,
    ),
}


@pytest.mark.parametrize(("columns", "expected"), SPANS.values(), ids=SPANS.keys())
def test_ranks(columns: Columns, expected: int) -> None:
    program = Program()
    x, a = program.input("x"), program.input("a", "symbol")
    outputs = columns(program, x, a)
    forms = LinearForms(
        program,
        {(0, k): scalar.node for k, scalar in enumerate(outputs)},
        (1, len(outputs)),
    )
    assert linear_structure(forms, np.random.default_rng(1)).rank == expected


def test_programs_of_arms_have_no_other_functions_than_sines_and_cosines_of_inputs() -> (
    None
):
    program = Program()
    x, a = program.input("x"), program.input("a", "symbol")
    suited: list[list[Scalar]] = [
        [x, x.sin(), x.cos()],
        [a.sin(), x * a.cos()],
        [x * a],
        [],
    ]
    suited += [
        [(2 * x).sin()],
        [(x / 3 + a).cos()],
        [x.tan()],
        [x.sign()],
        [abs(x)],
        [x.exp().sign() * x],
    ]
    for outputs in suited:
        assert FieldSampler.suits(program, [scalar.node for scalar in outputs])
    for outputs in (
        [x.sin().sin()],
        [a, a.sin()],
        [(x + a / 2).cos()],
        [(x + 1).sin()],
        [(a * x).sin()],
        [x.exp()],
    ):
        assert not FieldSampler.suits(program, [scalar.node for scalar in outputs])


def test_signs_are_those_of_regions() -> None:
    program = Program()
    x, y = program.input("x"), program.input("y")
    outputs = [(x - y).sign(), x.sign(), abs(y), y]
    sampler = sampler_of(program, [scalar.node for scalar in outputs])
    values = sampler.evaluate(
        SMALL_FIELD, np.random.default_rng(1), 2 * sampler.regions, {}
    )[:, 0]
    p = SMALL_FIELD.p
    signs = {
        tuple(int(s) if s < 2 else int(s) - p for s in column)
        for column in values[:2].T
    }
    assert signs <= {(1, 1), (1, -1), (-1, 1), (-1, -1)}
    assert sampler.regions >= 3
    assert set((values[2] * values[3] % p == values[3] * values[3] % p).tolist()) == {
        True,
        False,
    }


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_quaternions_have_unit_norm(field: PrimeField) -> None:
    program = Program()
    q = [program.input(f"q{k}") for k in range(4)]
    program.unit_groups.append(tuple(x.node for x in q))
    norm = sum((x * x for x in q), program.zero)
    sampler = FieldSampler(program, [norm.node, q[0].node, q[3].node])
    values = sampler.evaluate(field, np.random.default_rng(2), 9, {})
    assert (values[0] == 1).all()
    assert len(set(values[1:].ravel().tolist())) == 18


def geometry_sampler() -> FieldSampler:
    program = Program()
    d, a, unused = (program.input(name, "symbol") for name in ("d", "a", "unused"))
    x = program.input("x")
    outputs: list[Scalar] = [d, a.cos(), a.sin() * d, x]
    assert unused.node not in program.needed([s.node for s in outputs])
    return FieldSampler(program, [s.node for s in outputs])


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_geometry_takes_the_given_values(field: PrimeField) -> None:
    sampler = geometry_sampler()
    assert sampler.symbols == ["a", "d"]
    geometry = {
        "d": np.array([5, 7], dtype=field.dtype),
        "a": np.array([0, 3], dtype=field.dtype),
    }
    values = sampler.evaluate(field, np.random.default_rng(3), 4, geometry)
    cosine, sine = (
        -4 * field.invert(5) % field.p,
        3 * field.invert(5) % field.p,
    )  # of the angle with tan a/2 = 3
    assert values.shape == (4, 2, 4)
    for row, expected in zip(
        values, ([5, 7], [1, cosine], [0, 7 * sine % field.p]), strict=False
    ):
        assert row.tolist() == [[e] * 4 for e in expected]
    assert len(set(values[3].ravel().tolist())) == 8


def test_a_singular_geometry_is_degenerate() -> None:
    program = Program()
    sampler = FieldSampler(program, [(1 / program.input("d", "symbol")).node])
    with pytest.raises(DegenerateSampleError):
        sampler.evaluate(SMALL_FIELD, np.random.default_rng(4), 2, {"d": np.array([0])})


def test_no_outputs_and_constant_outputs() -> None:
    program, rng = Program(), np.random.default_rng(5)
    assert FieldSampler(program, []).evaluate(SMALL_FIELD, rng, 3, {}).shape == (
        0,
        1,
        3,
    )
    constant = FieldSampler(program, [program.constant(Fraction(1, 2)).node])
    assert constant.symbols == []
    assert constant.evaluate(SMALL_FIELD, rng, 3, {}).tolist() == [
        [[(SMALL_FIELD.p + 1) // 2] * 3]
    ]


def test_the_same_generator_gives_the_same_samples() -> None:
    first, second = (sample(DIFFERENCES["two angles"], SMALL_FIELD) for _ in range(2))
    assert first.tolist() == second.tolist()
