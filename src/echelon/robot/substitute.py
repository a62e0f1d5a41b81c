"""A mechanism with other expressions put in for its geometry symbols.

With loops, ratios of gears become numbers, because the sine of n·q is algebraic in those of q for rational n only.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import fields, is_dataclass, replace
from fractions import Fraction
from typing import Any

from echelon.algebra import (
    Polynomial,
    as_polynomial,
    cosine,
    format_polynomial,
    is_trigonometric,
    multiple_of,
    multiple_of_point,
    sine,
    symbol_of,
)
from echelon.robot.joint import Joint, MotionKind, merge
from echelon.robot.mechanism import Mechanism
from echelon.robot.term import read_term

_WITH_EXPRESSIONS = (
    "bodies",
    "gravity",
    "couplings",
    "closures",
    "contacts",
    "actuators",
    "measured",
)
"""Fields of a mechanism that hold expressions."""


def substituted(mechanism: Mechanism, values: Mapping[str, Polynomial]) -> Mechanism:
    """Put expressions in for generators, wherever a mechanism uses them."""
    symbols = {symbol_of(generator) for generator in values}

    def put(expression: Polynomial) -> Polynomial:
        generators = expression.generators()
        if not any(symbol_of(generator) in symbols for generator in generators):
            return expression
        return expression.evaluate(
            {g: _value_of(g, values, symbols) for g in generators}, as_polynomial
        )

    changed = {
        name: _mapped(getattr(mechanism, name), put) for name in _WITH_EXPRESSIONS
    }
    gravity = changed["gravity"] if any(changed["gravity"] or ()) else None

    def text(term: str) -> str:
        return _text(term, values)

    effects = tuple(effect.with_terms(text) for effect in mechanism.effects)
    left = {
        name: symbol
        for name, symbol in mechanism.symbols.items()
        if name not in symbols
    }
    return replace(
        mechanism,
        **{**changed, "gravity": gravity, "effects": effects, "symbols": left},
    )


def _value_of(
    generator: str, values: Mapping[str, Polynomial], symbols: Collection[str]
) -> Polynomial:
    if generator in values or symbol_of(generator) not in symbols:
        return values.get(generator, Polynomial.generator(generator))
    count, symbol = multiple_of(generator)
    point = multiple_of_point((values[cosine(symbol)], values[sine(symbol)]), count)
    return point[0 if generator.startswith("cos") else 1]


def _mapped(value: Any, put: Callable[[Polynomial], Polynomial]) -> Any:
    """A part of a mechanism with other expressions in the place of its own."""
    if isinstance(value, Polynomial):
        return put(value)
    if isinstance(value, tuple):
        return tuple(_mapped(part, put) for part in value)
    if isinstance(value, Mapping):
        return {name: _mapped(part, put) for name, part in value.items()}
    if not is_dataclass(value):
        return value
    found = replace(
        value, **{f.name: _mapped(getattr(value, f.name), put) for f in fields(value)}
    )  # type: ignore[type-var]
    if isinstance(found, Joint):
        return replace(found, steps=merge(found.steps))
    return found


def _text(term: str, values: Mapping[str, Polynomial]) -> str:
    """A term of an effect, where expressions are text."""
    plain = {
        name: value for name, value in values.items() if not is_trigonometric(name)
    }
    read = read_term(term)
    named = [q for q in read.quantities if q.at is None and q.name in plain]
    return read.replaced(
        {q.node: f"({format_polynomial(plain[q.name])})" for q in named}
    )


def with_numeric_ratios(mechanism: Mechanism) -> Mechanism:
    """A mechanism with loops in which symbols in ratios of turning coordinates are replaced by their values."""
    sliding, ratios = _sliding(mechanism), list[Polynomial]()
    for coupling in mechanism.couplings:
        if coupling.coordinate not in sliding:
            ratios += [
                ratio
                for _, function in coupling.terms
                if (ratio := function.ratio) is not None
            ]
    symbols = {symbol for ratio in ratios for symbol in ratio.symbols()}
    numbers = {
        name: s.number for name, s in mechanism.symbols.items() if name in symbols
    }
    known = {
        name: Polynomial.constant(value)
        for name, value in numbers.items()
        if value is not None
    }
    return substituted(mechanism, known) if known else mechanism


def inexact_coupling(mechanism: Mechanism) -> tuple[str, str] | None:
    """A coupling by which something turns without exact sines: where it is stated, and why; None if there is none."""
    sliding = _sliding(mechanism)
    for coupling in mechanism.couplings:
        turns = coupling.coordinate not in sliding
        where = f"coupling of '{coupling.coordinate}'"
        for name, function in coupling.terms:
            ratio = function.ratio
            if ratio is None:
                return where, "it is not linear"
            if turns and name in sliding:
                return where, f"it turns while '{name}' slides"
            if turns and not isinstance(ratio.number, int | Fraction):
                return where, f"the ratio {ratio} is not a rational number"
    return None


def _sliding(mechanism: Mechanism) -> set[str]:
    return {m.name for m in mechanism.motions if m.kind is MotionKind.TRANSLATION}
