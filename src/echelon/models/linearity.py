"""Outputs that are linear in parameters, taken apart into a regressor; anything else is refused with the reason.

Every recorded value is written as a polynomial in the parameters whose coefficients are values without parameters.
What cancels is recognised exactly, at a random point of a large prime field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from echelon.errors import DegenerateSampleError, InputError
from echelon.exact.field import CERTIFICATE_BITS, PrimeField
from echelon.program.operations import Op
from echelon.program.sampling import FieldSampler
from echelon.program.scalar import Scalar
from echelon.program.tape import Program
from echelon.seeds import DEFAULT_SEED, random_generator

_Powers = tuple[int, ...]  # parameter nodes, sorted, with repetition
_Parts = dict[_Powers, Scalar]
_LARGEST_DEGREE = 8
_ATTEMPTS = 16
_STATES = 16


def linear_rows(
    program: Program, outputs: Sequence[Scalar], parameters: Sequence[int], names: Sequence[str]
) -> list[list[Scalar]]:
    """The coefficients of the parameters in every output."""
    parts: dict[int, _Parts] = {p: {(p,): program.one} for p in parameters}
    rows = []
    for output, name in zip(outputs, names, strict=True):
        for node in program.needed([output.node], parts):
            if node not in parts:
                parts[node] = _taken_apart(program, node, parts, f"output '{name}'")
        found = parts[output.node]
        for powers, coefficient in found.items():
            if len(powers) != 1 and not _vanishes(coefficient):
                raise InputError(_problem(program, powers), element=f"output '{name}'")
        rows.append([found.get((p,), program.zero) for p in parameters])
    return rows


def _taken_apart(program: Program, node: int, parts: Mapping[int, _Parts], where: str) -> _Parts:
    op, a = Op(program.ops[node]), parts.get(program.lhs[node], {})
    b = parts.get(program.rhs[node], {})
    involved = [powers for powers in (*a, *b) if powers]
    if not involved:
        return {(): Scalar(program, node)}
    if op is Op.NEG:
        return {powers: -c for powers, c in a.items()}
    if op in (Op.ADD, Op.SUB):
        return _sum(program, a, b if op is Op.ADD else {powers: -c for powers, c in b.items()})
    name = program.inputs[involved[0][0]].name
    if op is Op.MUL:
        return _product(program, a, b, where)
    if op is Op.DIV and not any(b):
        return {powers: c / b[()] for powers, c in a.items()}
    place = "a denominator" if op is Op.DIV else f"the argument of {op.name.lower()}"
    raise InputError(f"not linear in the parameters: '{name}' is in {place}", element=where)


def _sum(program: Program, a: _Parts, b: _Parts) -> _Parts:
    return {k: a.get(k, program.zero) + b.get(k, program.zero) for k in {**a, **b}}


def _product(program: Program, a: _Parts, b: _Parts, where: str) -> _Parts:
    total: _Parts = {}
    for left, x in a.items():
        for right, y in b.items():
            powers = tuple(sorted(left + right))
            if len(powers) > _LARGEST_DEGREE:
                raise InputError(_problem(program, powers), element=where)
            total[powers] = total.get(powers, program.zero) + x * y
    return total


def _problem(program: Program, powers: _Powers) -> str:
    if not powers:
        return "not linear in the parameters: it has a part without any; give that part a parameter of its own"
    return f"not linear in the parameters: it holds {'·'.join(program.inputs[p].name for p in powers)}"


def _vanishes(value: Scalar) -> bool:
    """Whether a value is zero everywhere, by its residue at a random point."""
    if value.number is not None:
        return value.is_zero
    sampler, rng = FieldSampler(value.program, [value.node]), random_generator(DEFAULT_SEED)
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng, CERTIFICATE_BITS)
        try:
            geometry = {name: field.draw(rng, (1,)) for name in sampler.symbols}
            return not sampler.evaluate(field, rng, max(_STATES, sampler.regions), geometry).any()
        except DegenerateSampleError:
            continue
    raise InputError("division by zero at every point")
