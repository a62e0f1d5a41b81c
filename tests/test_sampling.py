"""Random points of a field: relations that hold for all real inputs hold at every sample, and no others do."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from echelon.errors import DegenerateSampleError
from echelon.exact.elimination import rank
from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import surd
from echelon.program.sampling import FieldSampler
from echelon.program.tape import Program, Scalar
from strategies import FIELDS, SMALL_FIELD

Relation = Callable[..., Any]  # of sin, cos and states x, y

IDENTITIES: dict[str, Relation] = {
    "circle": lambda s, c, x, _: s(x) * s(x) + c(x) * c(x) - 1,
    "odd and even": lambda s, c, x, _: (s(-x) + s(x)) * 2 + c(-x) - c(x),
    "double angle": lambda s, c, x, _: s(2 * x) - 2 * s(x) * c(x),
    "half angle": lambda s, c, x, _: 2 * c(x / 2) * c(x / 2) - 1 - c(x),
    "sum": lambda s, c, x, y: c(x + y) - c(x) * c(y) + s(x) * s(y),
    "sum of multiples": lambda s, c, x, y: s(x / 3 - y) - s(x / 3) * c(y) + c(x / 3) * s(y),
    "coupling": lambda s, c, x, _: c(Fraction(3, 7) * x) - 4 * c(x / 7) * c(x / 7) * c(x / 7) + 3 * c(x / 7),
    "large multiple": lambda s, c, x, _: s(1000 * x) - 2 * s(500 * x) * c(500 * x),
    "large and small multiples": lambda s, c, x, _: s(2 * x) - 2 * s(x) * c(x) + 0 * 1 + (s(x / 1000) - s(x / 1000)),
    "angle that cancels": lambda s, c, x, y: s(x + y - x - y) + c((x + y) - y - x) - 1,
    "product as angle": lambda s, c, x, y: s(2 * (x * y)) - 2 * s(x * y) * c(x * y),
    "irrational multiple": lambda s, c, x, _: (
        s(x * surd(0, 1, 0, 0) + x) - s(x * surd(0, 1, 0, 0)) * c(x) - c(x * surd(0, 1, 0, 0)) * s(x)
    ),
    "function as angle": lambda s, c, x, _: s(2 * s(x)) - 2 * s(s(x)) * c(s(x)),
    "constant angle": lambda s, c, x, _: (
        s(x + 1) * c(x) - c(x + 1) * s(x) - 2 * s(x - x + Fraction(1, 2)) * c(x - x + Fraction(1, 2))
    ),
}

DIFFERENCES: dict[str, Relation] = {
    "sine and angle": lambda s, c, x, _: s(x) - x,
    "sine and cosine": lambda s, c, x, _: s(x) - c(x),
    "two angles": lambda s, c, x, y: c(x) - c(y),
    "two multiples": lambda s, c, x, _: c(x) - c(2 * x),
    "tangent of the half": lambda s, c, x, _: s(x) - 2 * x / (1 + x * x),
    "irrational multiple": lambda s, c, x, _: c(x) - c(x * surd(0, 1, 0, 0)),
    "shift": lambda s, c, x, _: c(x) - c(x + 1),
}


def sample(relation: Relation, field: PrimeField, states: int = 20) -> Residues:
    program = Program()
    x, y = program.input("x"), program.input("y")
    result = relation(program.sin, program.cos, x, y)
    values: Residues = FieldSampler(program, [result.node]).evaluate(field, np.random.default_rng(0), states, {})
    assert values.shape == (1, 1, states)
    return values.ravel()


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
@pytest.mark.parametrize("relation", IDENTITIES.values(), ids=IDENTITIES.keys())
def test_identities_hold(relation: Relation, field: PrimeField) -> None:
    assert not sample(relation, field).any()


@pytest.mark.parametrize("relation", DIFFERENCES.values(), ids=DIFFERENCES.keys())
def test_other_relations_do_not_hold(relation: Relation) -> None:
    values = sample(relation, SMALL_FIELD)
    assert values.all()
    assert len(set(values.tolist())) == len(values)


SPANS: dict[str, tuple[Callable[..., list[Any]], int]] = {
    "shifted angles": (lambda s, c, x, _: [s(x), c(x), s(x + 1), c(x - Fraction("0.7853"))], 2),
    "angle shifted by a symbol": (lambda s, c, x, a: [s(x), c(x), s(x + a), c(x - 2 * a)], 2),
    "product of symbols as shift": (lambda s, c, x, a: [s(x), c(x), s(x + a * a)], 2),
    "squares": (lambda s, c, x, _: [s(x) * s(x), c(x) * c(x), c(2 * x), x - x + 1], 2),
    "screw": (lambda s, c, x, _: [x, s(x), c(x), x * x, x * s(x)], 5),
    "constants": (lambda s, c, x, a: [s(a), c(a), s(x - x + 2), x - x + 1], 1),
}


@pytest.mark.parametrize(("columns", "expected"), SPANS.values(), ids=SPANS.keys())
def test_ranks(columns: Callable[..., list[Any]], expected: int) -> None:
    program = Program()
    x, a = program.input("x"), program.input("a", "symbol")
    outputs = [scalar.node for scalar in columns(program.sin, program.cos, x, a)]
    sampler, rng = FieldSampler(program, outputs), np.random.default_rng(1)
    geometry = {name: SMALL_FIELD.draw(rng, (1,)) for name in sampler.symbols}
    matrix = sampler.evaluate(SMALL_FIELD, rng, 10, geometry)[:, 0]
    assert rank(matrix, SMALL_FIELD) == expected


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_quaternions_have_unit_norm(field: PrimeField) -> None:
    program = Program()
    q = [program.input(f"q{k}") for k in range(4)]
    program.unit_groups.append(tuple(x.node for x in q))
    norm = sum((x * x for x in q), program.zero)
    values = FieldSampler(program, [norm.node, q[0].node, q[3].node]).evaluate(field, np.random.default_rng(2), 9, {})
    assert (values[0] == 1).all()
    assert len(set(values[1:].ravel().tolist())) == 18


def geometry_sampler() -> FieldSampler:
    program = Program()
    d, a, unused = (program.input(name, "symbol") for name in ("d", "a", "unused"))
    x = program.input("x")
    outputs: list[Scalar] = [d, program.cos(a), program.sin(a) * d, x]
    assert unused.node not in program.needed([s.node for s in outputs])
    return FieldSampler(program, [s.node for s in outputs])


@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_geometry_takes_the_given_values(field: PrimeField) -> None:
    sampler = geometry_sampler()
    assert sampler.symbols == ["a", "d"]
    geometry = {"d": np.array([5, 7], dtype=field.dtype), "a": np.array([0, 3], dtype=field.dtype)}
    values = sampler.evaluate(field, np.random.default_rng(3), 4, geometry)
    cosine, sine = -4 * field.invert(5) % field.p, 3 * field.invert(5) % field.p  # of the angle with tan a/2 = 3
    assert values.shape == (4, 2, 4)
    for row, expected in zip(values, ([5, 7], [1, cosine], [0, 7 * sine % field.p]), strict=False):
        assert row.tolist() == [[e] * 4 for e in expected]
    assert len(set(values[3].ravel().tolist())) == 8


def test_a_singular_geometry_is_degenerate() -> None:
    program = Program()
    sampler = FieldSampler(program, [(1 / program.input("d", "symbol")).node])
    with pytest.raises(DegenerateSampleError):
        sampler.evaluate(SMALL_FIELD, np.random.default_rng(4), 2, {"d": np.array([0])})


def test_no_outputs_and_constant_outputs() -> None:
    program, rng = Program(), np.random.default_rng(5)
    assert FieldSampler(program, []).evaluate(SMALL_FIELD, rng, 3, {}).shape == (0, 1, 3)
    constant = FieldSampler(program, [program.constant(Fraction(1, 2)).node])
    assert constant.symbols == []
    assert constant.evaluate(SMALL_FIELD, rng, 3, {}).tolist() == [[[(SMALL_FIELD.p + 1) // 2] * 3]]


def test_the_same_generator_gives_the_same_samples() -> None:
    first, second = (sample(DIFFERENCES["two angles"], SMALL_FIELD) for _ in range(2))
    assert first.tolist() == second.tolist()
