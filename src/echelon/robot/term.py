"""Terms of effects as syntax trees: what a term depends on and how it grows with velocity, read in this one place.

A law of friction is recognised by its shape and not by its spelling.  Dry friction is what does not vanish in slow
motion: some part of the term depends on a velocity and stays bounded when that grows, as sign(q̇), tanh(q̇/v) and
q̇/(v + |q̇|) do, and q̇ or q̇·|q̇| do not.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import inf

from echelon.algebra import expression_tree
from echelon.shared import InputError, shortened

_BOUNDED = ("sign", "heaviside", "tanh", "atan", "atan2", "sin", "cos")
_POWERS = {"abs": 1.0, "max": 1.0, "min": 1.0, "sqrt": 0.5}
"""Power of its argument with which a function grows; any other may outgrow all powers."""


@dataclass(frozen=True)
class Quantity:
    """A name in a term: ``qd`` of the place where the term acts, ``qd[j5]`` of another, or a symbol."""

    name: str
    at: str | None  # what stands in brackets
    node: ast.expr


class TermTree:
    """A term of an effect, read.  Expressions are those of :mod:`echelon.algebra.program.text`."""

    def __init__(self, text: str) -> None:
        self.text = text.strip().replace("^", "**")
        self.tree = expression_tree(self.text)
        # all subexpressions, without names of functions and what stands in brackets
        self.parts = list(_parts(self.tree))
        self.quantities = tuple(self._quantities())

    @property
    def symbols(self) -> frozenset[str]:
        """Names that stand alone: geometry symbols, and the state of the place itself."""
        return frozenset(q.name for q in self.quantities if q.at is None)

    @property
    def is_dry(self) -> bool:
        """Whether it does not vanish in slow motion."""
        return any(power <= 0 for part in self.parts for power in _growth(part))

    @property
    def is_inertial(self) -> bool:
        """Whether it depends on an acceleration."""
        return any(q.name == "qdd" for q in self.quantities)

    def source(self, node: ast.expr) -> str:
        """The text of a part."""
        return ast.get_source_segment(self.text, node) or ""

    def replaced(self, texts: Mapping[ast.expr, str]) -> str:
        """The text with other texts in the place of some parts, which do not overlap."""
        found = self.text.encode()  # columns of syntax trees count bytes
        for node in sorted(texts, key=lambda node: node.col_offset, reverse=True):
            before, after = found[: node.col_offset], found[node.end_col_offset :]
            found = before + texts[node].encode() + after
        return found.decode()

    def _quantities(self) -> Iterator[Quantity]:
        for node in self.parts:
            match node:
                case ast.Name(id=name):
                    yield Quantity(name, None, node)
                case ast.Subscript(
                    value=ast.Name(id=name), slice=ast.Constant(value=str(at))
                ):
                    yield Quantity(name, at, node)
                case ast.Subscript(value=ast.Name(id=name), slice=inner):
                    yield Quantity(name, self.source(inner), node)


def _parts(node: ast.expr) -> Iterator[ast.expr]:
    yield node
    for operand in _operands(node):
        yield from _parts(operand)


def _operands(node: ast.expr) -> list[ast.expr]:
    match node:
        case ast.UnaryOp(operand=operand):
            return [operand]
        case ast.BinOp(left=left, right=right):
            return [left, right]
        case ast.Call(args=arguments):
            return arguments
    return []


def _growth(node: ast.expr) -> list[float]:
    """The power of velocities with which a part grows; nothing if it does not depend on them."""
    known = [power for operand in _operands(node) for power in _growth(operand)]
    match node:
        case ast.Name(id="qd") | ast.Subscript(value=ast.Name(id="qd")):
            return [1.0]
        case _ if not known:
            return []
        case ast.BinOp(op=ast.Mult()):
            return [sum(known)]
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return [sum(_growth(left)) - sum(_growth(right))]
        case ast.BinOp(
            op=ast.Pow(), right=ast.Constant(value=int() | float() as power)
        ):
            return [known[0] * power]
        case ast.BinOp(op=ast.Add() | ast.Sub()) | ast.UnaryOp():
            return [max(known)]
        case ast.Call(func=ast.Name(id=name)) if name in _POWERS:
            return [max(known) * _POWERS[name]]
        case ast.Call(func=ast.Name(id=name)) if name in _BOUNDED:
            return [0.0]
    return [inf]


@lru_cache
def read_term(text: str) -> TermTree:
    """A term by its text.

    >>> read_term("tanh(qd/0.01)").is_dry, read_term("abs(qd)*qd").is_dry, read_term("2*qdd[j5]").is_inertial
    (True, False, True)
    """
    try:
        return TermTree(text)
    except (SyntaxError, RecursionError):
        problem = (
            f"'{shortened(text)}' is not an expression such as 2*a*sin(x) - b*x**2"
        )
    except ValueError as error:
        problem = f"in '{shortened(text)}': {error}"
    raise InputError(problem)


def has_shape(template: ast.AST, node: ast.AST, constants: Collection[str]) -> bool:
    """Whether a part of a term is a template, in which the names of constants stand for anything."""
    match template:
        case ast.Name(id=name) if name in constants:
            return True
        case ast.Name() | ast.Constant():
            return ast.dump(template) == ast.dump(node)
    parts, others = (list(ast.iter_child_nodes(tree)) for tree in (template, node))
    if type(template) is not type(node) or len(parts) != len(others):
        return False
    pairs = zip(parts, others, strict=True)
    return all(has_shape(part, other, constants) for part, other in pairs)
