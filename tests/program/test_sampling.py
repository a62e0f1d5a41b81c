"""Random points of a field: relations that hold for all real inputs hold at every sample, and no others do."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from echelon.errors import DegenerateSampleError
from echelon.exact.field import PrimeField, Residues, rank
from echelon.exact.polynomial import surd
from echelon.program.sampling import FunctionSampler
from echelon.program.schedule import FieldSampler
from echelon.program.tape import Program, Scalar
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
    "coupling": lambda _p, x, _: (Fraction(3, 7) * x).sin() - turned(x / 7, Fraction(2, 7) * x),
    "large multiple": lambda _p, x, _: (10_000_000 * x).sin() - doubled(5_000_000 * x),
    "large and small multiples": lambda _p, x, _: ((2 * x).sin() - doubled(x)) * (x / 1000).sin(),
    "angle that cancels": lambda _p, x, y: (x + y - x - y).sin() + ((x + y) - y - x).cos() - 1,
    "product": lambda _p, x, y: (2 * (x * y)).sin() - doubled(x * y),
    "product and sum": lambda _p, x, y: (x - x * y).sin() - turned(x, -(x * y)),
    "irrational multiple": lambda _p, x, _: (x * ROOT2 + x).sin() - turned(x * ROOT2, x),
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


def sample(relation: Relation, field: PrimeField, states: int = 20) -> Residues:
    program = Program()
    x, y = program.input("x"), program.input("y")
    result = relation(program, x, y)
    values: Residues = FunctionSampler(program, [result.node]).evaluate(field, np.random.default_rng(0), states, {})
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


Columns = Callable[[Program, Scalar, Scalar], list[Scalar]]  # of a state x and a symbol a

SPANS: dict[str, tuple[Columns, int]] = {
    "shifts": (lambda _p, x, _: [x.sin(), x.cos(), (x + 1).sin(), (x - Fraction("0.7853")).cos()], 2),
    "symbols as shifts": (lambda _p, x, a: [x.sin(), x.cos(), (x + a).sin(), (x - 2 * a).cos(), (x - a * a).sin()], 2),
    "squares": (lambda p, x, _: [x.sin() * x.sin(), x.cos() * x.cos(), (2 * x).cos(), p.one], 2),
    "screw": (lambda _p, x, _: [x, x.sin(), x.cos(), x * x, x * x.sin()], 5),
    "constants": (lambda p, x, a: [a.sin(), (a * a).cos(), p.constant(2).sin(), p.one, (x - x)], 1),
}


@pytest.mark.parametrize(("columns", "expected"), SPANS.values(), ids=SPANS.keys())
def test_ranks(columns: Columns, expected: int) -> None:
    program = Program()
    x, a = program.input("x"), program.input("a", "symbol")
    outputs = [scalar.node for scalar in columns(program, x, a)]
    kinds = (FunctionSampler, FieldSampler)[: 1 + FieldSampler.suits(program, outputs)]
    for sampler in (kind(program, outputs) for kind in kinds):
        rng = np.random.default_rng(1)
        geometry = {name: SMALL_FIELD.draw(rng, (1,)) for name in sampler.symbols}
        matrix = sampler.evaluate(SMALL_FIELD, rng, 10, geometry)[:, 0]
        assert rank(matrix, SMALL_FIELD) == expected


def test_programs_of_arms_have_no_other_functions_than_sines_and_cosines_of_inputs() -> None:
    program = Program()
    x, a = program.input("x"), program.input("a", "symbol")
    for outputs in ([x, x.sin(), x.cos()], [a.sin(), x * a.cos()], [x * a], []):
        assert FieldSampler.suits(program, [scalar.node for scalar in outputs])
    for outputs in ([(2 * x).sin()], [x.sign()], [x.sin().sin()], [a, a.sin()], [(x + a).cos()], [x.tan()]):
        assert not FieldSampler.suits(program, [scalar.node for scalar in outputs])


KINDS = pytest.mark.parametrize("kind", [FieldSampler, FunctionSampler])


@KINDS
@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_quaternions_have_unit_norm(field: PrimeField, kind: type[FieldSampler]) -> None:
    program = Program()
    q = [program.input(f"q{k}") for k in range(4)]
    program.unit_groups.append(tuple(x.node for x in q))
    norm = sum((x * x for x in q), program.zero)
    sampler = kind(program, [norm.node, q[0].node, q[3].node])
    values = sampler.evaluate(field, np.random.default_rng(2), 9, {})
    assert (values[0] == 1).all()
    assert len(set(values[1:].ravel().tolist())) == 18


def geometry_sampler(kind: type[FieldSampler]) -> FieldSampler:
    program = Program()
    d, a, unused = (program.input(name, "symbol") for name in ("d", "a", "unused"))
    x = program.input("x")
    outputs: list[Scalar] = [d, a.cos(), a.sin() * d, x]
    assert unused.node not in program.needed([s.node for s in outputs])
    return kind(program, [s.node for s in outputs])


@KINDS
@pytest.mark.parametrize("field", FIELDS, ids=["small", "large"])
def test_geometry_takes_the_given_values(field: PrimeField, kind: type[FieldSampler]) -> None:
    sampler = geometry_sampler(kind)
    assert sampler.symbols == ["a", "d"]
    geometry = {"d": np.array([5, 7], dtype=field.dtype), "a": np.array([0, 3], dtype=field.dtype)}
    values = sampler.evaluate(field, np.random.default_rng(3), 4, geometry)
    cosine, sine = -4 * field.invert(5) % field.p, 3 * field.invert(5) % field.p  # of the angle with tan a/2 = 3
    assert values.shape == (4, 2, 4)
    for row, expected in zip(values, ([5, 7], [1, cosine], [0, 7 * sine % field.p]), strict=False):
        assert row.tolist() == [[e] * 4 for e in expected]
    assert len(set(values[3].ravel().tolist())) == 8


@KINDS
def test_a_singular_geometry_is_degenerate(kind: type[FieldSampler]) -> None:
    program = Program()
    sampler = kind(program, [(1 / program.input("d", "symbol")).node])
    with pytest.raises(DegenerateSampleError):
        sampler.evaluate(SMALL_FIELD, np.random.default_rng(4), 2, {"d": np.array([0])})


@KINDS
def test_no_outputs_and_constant_outputs(kind: type[FieldSampler]) -> None:
    program, rng = Program(), np.random.default_rng(5)
    assert kind(program, []).evaluate(SMALL_FIELD, rng, 3, {}).shape == (0, 1, 3)
    constant = kind(program, [program.constant(Fraction(1, 2)).node])
    assert constant.symbols == []
    assert constant.evaluate(SMALL_FIELD, rng, 3, {}).tolist() == [[[(SMALL_FIELD.p + 1) // 2] * 3]]


def test_the_same_generator_gives_the_same_samples() -> None:
    first, second = (sample(DIFFERENCES["two angles"], SMALL_FIELD) for _ in range(2))
    assert first.tolist() == second.tolist()
