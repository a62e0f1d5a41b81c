"""A mechanism with other expressions put in for its geometry symbols.

With loops, ratios of gears become numbers, because the sine of n·q is algebraic in those of q for rational n only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction

from echelon.errors import InputError
from echelon.exact.expressions import multiple_of_point
from echelon.exact.polynomial import (
    Polynomial,
    as_polynomial,
    cosine,
    format_polynomial,
    is_trigonometric,
    multiple_of,
    sine,
    symbol_of,
)
from echelon.mechanism.closure import Closure
from echelon.mechanism.effect import Effect
from echelon.mechanism.joint import Body, Matrix, Motion, MotionKind, Placement, Step, Vector, merge
from echelon.mechanism.mechanism import Channel, Cut, Mechanism, Output

_NAMES = re.compile(r"\[[^\]]*\]|[^\W\d]\w*")  # coordinates in brackets, which are no symbols, and names


def substituted(mechanism: Mechanism, values: Mapping[str, Polynomial]) -> Mechanism:
    """Put expressions in for generators, wherever a mechanism uses them."""
    put = _Substitution(values)
    gravity = None if mechanism.gravity is None else put.vector(mechanism.gravity)
    return replace(
        mechanism,
        bodies=tuple(put.body(body) for body in mechanism.bodies),
        gravity=gravity if gravity is not None and any(gravity) else None,
        couplings=tuple(
            replace(c, terms=tuple((name, function.mapped(put.polynomial)) for name, function in c.terms))
            for c in mechanism.couplings
        ),
        closures=tuple(map(put.closure, mechanism.closures)),
        stated_closures=tuple(map(put.closure, mechanism.stated_closures)),
        actuators=tuple(
            replace(a, terms=tuple((name, put.polynomial(ratio)) for name, ratio in a.terms))
            for a in mechanism.actuators
        ),
        measured=None if mechanism.measured is None else tuple(put.output(output) for output in mechanism.measured),
        effects=tuple(put.effect(effect) for effect in mechanism.effects),
        closed_at={name: tuple(map(put.polynomial, value)) for name, value in mechanism.closed_at.items()},
        symbols={name: symbol for name, symbol in mechanism.symbols.items() if name not in put.symbols},
    )


class _Substitution:
    def __init__(self, values: Mapping[str, Polynomial]) -> None:
        self.values = values
        self.symbols = {symbol_of(generator) for generator in values}

    def polynomial(self, p: Polynomial) -> Polynomial:
        generators = p.generators()
        if not any(symbol_of(g) in self.symbols for g in generators):
            return p
        return p.evaluate({g: self.generator(g) for g in generators}, as_polynomial)

    def generator(self, generator: str) -> Polynomial:
        if generator in self.values or symbol_of(generator) not in self.symbols:
            return self.values.get(generator, Polynomial.generator(generator))
        count, symbol = multiple_of(generator)
        point = multiple_of_point((self.values[cosine(symbol)], self.values[sine(symbol)]), count)
        return point[0 if generator.startswith("cos") else 1]

    def closure(self, closure: Closure) -> Closure:
        return replace(
            closure,
            first_frame=self.placement(closure.first_frame),
            second_frame=self.placement(closure.second_frame),
            second_mount=tuple(self.placement(p) for p in closure.second_mount),
        )

    def output(self, output: Output) -> Output:
        return replace(output, terms=tuple((self.channel(c), self.polynomial(weight)) for c, weight in output.terms))

    def channel(self, channel: Channel) -> Channel:
        return replace(channel, frame=self.placement(channel.frame)) if isinstance(channel, Cut) else channel

    def effect(self, effect: Effect) -> Effect:
        return replace(effect, actions=tuple(replace(a, term=self.text(a.term)) for a in effect.actions))

    def text(self, term: str) -> str:
        plain = {name: value for name, value in self.values.items() if not is_trigonometric(name)}
        return _NAMES.sub(lambda m: f"({format_polynomial(plain[m[0]])})" if m[0] in plain else m[0], term)

    def vector(self, vector: Vector) -> Vector:
        x, y, z = (self.polynomial(part) for part in vector)
        return (x, y, z)

    def matrix(self, matrix: Matrix) -> Matrix:
        a, b, c = (self.vector(row) for row in matrix)
        return (a, b, c)

    def body(self, body: Body) -> Body:
        steps: tuple[Step, ...] = tuple(self.step(step) for step in body.joint.steps)
        return replace(body, joint=replace(body.joint, steps=merge(steps)))

    def step(self, step: Step) -> Step:
        if isinstance(step, Motion):
            return replace(step, pitch=self.polynomial(step.pitch))
        return self.placement(step)

    def placement(self, placement: Placement) -> Placement:
        return Placement(self.matrix(placement.rotation), self.vector(placement.translation))


def with_numeric_ratios(mechanism: Mechanism) -> Mechanism:
    """A mechanism with loops in which the ratios between turning coordinates are rational numbers."""
    # symbols in such ratios are replaced by their values, wherever they occur
    symbols = {symbol for _, ratio in _turning(mechanism) for symbol in ratio.symbols()}
    if symbols:
        numbers = {name: s.number for name, s in mechanism.symbols.items() if name in symbols}
        known = {name: Polynomial.constant(value) for name, value in numbers.items() if value is not None}
        mechanism = substituted(mechanism, known)
    for where, ratio in _turning(mechanism):
        if not isinstance(ratio.number, int | Fraction):
            problem = "is not a rational number, and with loops only those have exact sines and cosines"
            what = "give its symbols exact values such as 3/2, or write a number"
            raise InputError(f"the ratio {ratio} {problem}: {what}", element=where)
    return mechanism


def _turning(mechanism: Mechanism) -> Iterator[tuple[str, Polynomial]]:
    """The ratios of turning coordinates to others, each with the coupling that it stands in."""
    sliding = {m.name for m in mechanism.motions if m.kind is MotionKind.TRANSLATION}
    for coupling in mechanism.couplings:
        if coupling.coordinate in sliding:
            continue
        where = f"coupling of '{coupling.coordinate}'"
        for name, function in coupling.terms:
            if name in sliding:
                problem = f"with loops, what turns cannot follow what slides: state '{name}' as a multiple of"
                raise InputError(f"{problem} '{coupling.coordinate}' instead", element=where)
            if function.ratio is not None:
                yield where, function.ratio
