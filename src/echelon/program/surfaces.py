"""Which surfaces cut the real inputs into regions, and in which products their signs enter the outputs.

A sign is constant on a region.  Logarithms and roots bound the domain, and the signs of the factors of their arguments
tell its pieces apart.  An output is a polynomial in the signs with coefficients that know nothing of them, so what
matters of a region are the values that the *products* of signs have there, and of those only the ones that occur: signs
that are only added never need to be combined.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from echelon.program.operations import Op
from echelon.program.tape import Program

_MOST_MAXIMAL = 256
"""Maximal products followed through a program; more are taken together, which only asks for more regions."""
_DOMAIN = (Op.LOG, Op.SQRT)


@dataclass(frozen=True)
class Surfaces:
    """Where signs change and where the domain ends."""

    program: Program
    # whose zeros are the surfaces: arguments of signs, and factors of arguments of logarithms and roots
    nodes: tuple[int, ...]
    signs: frozenset[int]  # those of ``nodes`` that are arguments of signs
    positive: tuple[int, ...]  # arguments of logarithms and roots, which are positive in the domain
    nonzero: tuple[int, ...]  # denominators with signs, which could vanish on a region
    nested: frozenset[int]  # those of ``nodes`` whose value contains a sign: they may vanish on a whole region
    inputs: tuple[int, ...]  # the inputs that all of these depend on
    # maximal sets of ``nodes`` whose signs are multiplied with each other in an output
    maximal: tuple[frozenset[int], ...]


def find_surfaces(program: Program, outputs: Sequence[int]) -> Surfaces:
    """The surfaces of some outputs."""
    ops, lhs = program.ops, program.lhs
    needed = program.needed(outputs)
    positive = {lhs[n] for n in needed if ops[n] in _DOMAIN}
    signs = {lhs[n] for n in needed if ops[n] in (Op.SIGN, Op.ABS)}
    nodes = tuple(sorted(signs | {f for n in positive for f in _factors(program, n) if f not in positive}))
    nested = frozenset(n for n in nodes if _jumps(program, n))
    below = sorted({program.rhs[n] for n in needed if ops[n] == Op.DIV}) if signs else []
    nonzero = tuple(n for n in below if _jumps(program, n))
    inputs = tuple(n for n in program.needed([*nodes, *positive, *nonzero]) if ops[n] == Op.INPUT)
    products = _products(program, outputs, nodes)
    return Surfaces(program, nodes, frozenset(signs), tuple(sorted(positive)), nonzero, nested, inputs, products)


def _jumps(program: Program, node: int) -> bool:
    """Whether there is a sign in a node."""
    return any(program.ops[n] in (Op.SIGN, Op.ABS) for n in program.needed([node]))


def _factors(program: Program, node: int) -> set[int]:
    """Whatever is multiplied in a node and is not a number."""
    found, pending = set(), [node]
    while pending:
        n = pending.pop()
        op = program.ops[n]
        if op in (Op.MUL, Op.DIV):
            pending += [program.lhs[n], program.rhs[n]]
        elif op in (Op.NEG, Op.SQRT, Op.ABS):
            pending.append(program.lhs[n])
        elif op not in (Op.CONSTANT, Op.EXP, Op.SIGN):
            found.add(n)
    return found


_Masks = tuple[int, ...]  # maximal products, each the bits of its surfaces


def _products(program: Program, outputs: Sequence[int], nodes: Sequence[int]) -> tuple[frozenset[int], ...]:
    """Maximal sets of surfaces whose signs are multiplied in an output."""
    bit = {n: 1 << k for k, n in enumerate(nodes)}
    found: dict[int, _Masks] = {-1: (0,)}
    touched: dict[int, int] = {-1: 0}
    for n in program.needed(outputs):
        op, a, b = Op(program.ops[n]), program.lhs[n], program.rhs[n]
        touched[n] = touched[a] | touched[b]
        if op in (Op.SIGN, Op.ABS):
            touched[n] |= bit[a]
        elif op in _DOMAIN:
            touched[n] |= sum(bit.get(f, 0) for f in _factors(program, a))
        if op is Op.SIGN:
            found[n] = (bit[a],)
        else:
            found[n] = (touched[n],) if op >= Op.SIN else _operated(op, found[a], found[b], touched[b])
    masks = _maximal([m for n in outputs for m in found[n]])
    return tuple(frozenset(n for n in nodes if bit[n] & m) for m in masks)


def _operated(op: Op, a: _Masks, b: _Masks, below: int) -> _Masks:
    if op is Op.DIV and below:
        b = (below,)
    if b == (0,) or a == b:
        return a if b == (0,) or op is not Op.MUL or len(a) == 1 else _maximal([x | y for x in a for y in b])
    if a == (0,):
        return b
    return _maximal([*a, *b] if op in (Op.ADD, Op.SUB) else [x | y for x in a for y in b])


def _maximal(masks: Iterable[int]) -> _Masks:
    kept: list[int] = []
    for mask in sorted(set(masks), key=lambda m: (-m.bit_count(), m)):
        if not any(mask & other == mask for other in kept):
            kept.append(mask)
    if len(kept) <= _MOST_MAXIMAL:
        return tuple(kept)
    together = 0
    for mask in kept:
        together |= mask
    return (together,)


def monomials(surfaces: Surfaces, constant: Mapping[int, int], most: int) -> list[tuple[tuple[int, int], ...]] | None:
    """All products of powers of signs that may occur."""
    found: set[tuple[tuple[int, int], ...]] = {()}
    for product in surfaces.maximal:
        variables = [n for n in sorted(product) if n not in constant]
        if len(variables) > most.bit_length():
            return None
        own: list[tuple[tuple[int, int], ...]] = [()]
        for n in variables:
            powers = (1, 2) if n in surfaces.nested else (1,)
            own += [(*m, (n, e)) for m in own for e in powers]
        found.update(own)
        if len(found) > most:
            return None
    return sorted(found, key=lambda m: (len(m), m))
