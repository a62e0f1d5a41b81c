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

from echelon.errors import InputError, shortened
from echelon.exact.expressions import expression_tree

_BOUNDED = ("sign", "heaviside", "tanh", "atan", "atan2", "sin", "cos")
_POWERS = {"abs": 1.0, "max": 1.0, "min": 1.0, "sqrt": 0.5} | dict.fromkeys(
    _BOUNDED, 0.0
)
"""Power of its argument with which a function grows; the others may grow beyond any power."""
_REMEMBERED = 4096  # terms; robots have some ten each


@dataclass(frozen=True)
class Reference:
    """A name in a term: ``qd`` of the place where the term acts, ``qd[j5]`` of another, or a symbol."""

    name: str
    at: str | None  # what stands in brackets
    node: ast.expr


class Term:
    """A term that is read.  Expressions are those of :mod:`echelon.program.text`."""

    def __init__(self, text: str) -> None:
        self.text = text.strip().replace("^", "**")
        self.tree = expression_tree(self.text)
        self.references = tuple(self._references(self.tree))

    @property
    def symbols(self) -> frozenset[str]:
        """Names that stand alone: geometry symbols, and the state of the place itself."""
        return frozenset(
            reference.name for reference in self.references if reference.at is None
        )

    @property
    def is_dry(self) -> bool:
        """Whether it does not vanish in slow motion."""
        found = [self._growth(node) for node in self._parts(self.tree)]
        return any(power is not None and power <= 0 for power in found)

    @property
    def is_inertial(self) -> bool:
        """Whether it depends on an acceleration."""
        return any(reference.name == "qdd" for reference in self.references)

    def source(self, node: ast.expr) -> str:
        """The text of a part."""
        return ast.get_source_segment(self.text, node) or ""

    def replaced(self, texts: Mapping[Reference, str]) -> str:
        """The text with other texts in the place of some names."""
        return self.spliced({reference.node: text for reference, text in texts.items()})

    def spliced(self, changes: Mapping[ast.expr, str]) -> str:
        """The text with other texts in the place of some parts, which do not overlap."""
        found = self.text.encode()  # columns of syntax trees count bytes
        for node in sorted(changes, key=lambda node: node.col_offset, reverse=True):
            found = (
                found[: node.col_offset]
                + changes[node].encode()
                + found[node.end_col_offset :]
            )
        return found.decode()

    def calls(self, name: str) -> list[ast.Call]:
        """Calls of a function."""
        calls = [node for node in self._parts(self.tree) if isinstance(node, ast.Call)]
        return [
            call
            for call in calls
            if isinstance(call.func, ast.Name) and call.func.id == name
        ]

    def _parts(self, node: ast.expr) -> Iterator[ast.expr]:
        """All subexpressions, without names of functions and what stands in brackets."""
        yield node
        for child in _operands(node):
            yield from self._parts(child)

    def _references(self, tree: ast.expr) -> Iterator[Reference]:
        for node in self._parts(tree):
            match node:
                case ast.Name(id=name):
                    yield Reference(name, None, node)
                case ast.Subscript(value=ast.Name(id=name), slice=inner):
                    quoted = isinstance(inner, ast.Constant) and isinstance(
                        inner.value, str
                    )
                    yield Reference(
                        name,
                        ast.literal_eval(inner) if quoted else self.source(inner),
                        node,
                    )

    def _growth(self, node: ast.expr) -> float | None:
        """The power of velocities with which a part grows; None if it does not depend on them."""
        known = [
            power for power in map(self._growth, _operands(node)) if power is not None
        ]
        match node:
            case ast.Name(id="qd") | ast.Subscript(value=ast.Name(id="qd")):
                return 1.0
            case _ if not known:
                return None
            case ast.BinOp(op=ast.Mult()):
                return sum(known)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return (self._growth(left) or 0.0) - (self._growth(right) or 0.0)
            case ast.BinOp(
                op=ast.Pow(), right=ast.Constant(value=int() | float() as power)
            ):
                return known[0] * power
            case ast.BinOp(op=ast.Pow()):
                return inf
            case ast.Call(func=ast.Name(id=name)):
                power = _POWERS.get(name, inf)
                return max(known) * power if power else 0.0
        return max(known)


def _operands(node: ast.expr) -> list[ast.expr]:
    match node:
        case ast.UnaryOp(operand=operand):
            return [operand]
        case ast.BinOp(left=left, right=right):
            return [left, right]
        case ast.Call(args=arguments):
            return arguments
    return []


@lru_cache(maxsize=_REMEMBERED)
def read_term(text: str) -> Term:
    """A term by its text.

    >>> read_term("tanh(qd/0.01)").is_dry, read_term("abs(qd)*qd").is_dry, read_term("2*qdd[j5]").is_inertial
    (True, False, True)
    """
    try:
        return Term(text)
    except (SyntaxError, RecursionError):
        raise InputError(
            f"'{shortened(text)}' is not an expression such as 2*a*sin(x) - b*x**2"
        ) from None
    except ValueError as error:
        raise InputError(f"in '{shortened(text)}': {error}") from None


def has_shape(template: ast.expr, node: ast.expr, constants: Collection[str]) -> bool:
    """Whether a part of a term is a template, in which the names of constants stand for anything."""
    match template, node:
        case ast.Name(id=name), _ if name in constants:
            return True
        case ast.Name(id=name), ast.Name(id=other):
            return name == other
        case ast.Constant(value=value), ast.Constant(value=other):
            return bool(value == other)
        case (ast.UnaryOp(op=op), ast.UnaryOp(op=other)) | (
            ast.BinOp(op=op),
            ast.BinOp(op=other),
        ):
            alike = type(op) is type(other)
        case ast.Call(func=ast.Name(id=name)), ast.Call(func=ast.Name(id=other)):
            alike = name == other
        case _:
            return False
    parts, others = _operands(template), _operands(node)
    if not alike or len(parts) != len(others):
        return False
    return all(
        has_shape(part, other, constants)
        for part, other in zip(parts, others, strict=True)
    )
