"""Numeric loops closed exactly: at a closed pose in doubles, the second frames are made to follow the first ones.

The numbers of a file close its loops up to rounding only, and where constraints are redundant that locks them.  So the
pose that is nearest to closing is solved for, its coordinates are written as decimals, and each second frame is put
where the first one is then.  Nothing else moves, and the frames do by the rounding.  A decimal angle is a generic point
of the circle (Lindemann), so angles that are equal, opposite, add up to another, or differ by multiples of 15° are
recognised first, and share their symbols: the sides of a parallelogram stay parallel.  So are doubles.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from math import cos, pi, sin

import numpy as np

from echelon.arrays import Floats
from echelon.exact.expressions import LARGEST_EXPANSION, STEPS_PER_HALF_TURN, Angle
from echelon.exact.field import CERTIFICATE_BITS, DEFAULT_SEED, PrimeField, random_generator
from echelon.exact.polynomial import Polynomial, as_polynomial
from echelon.mechanism.closed_pose import angle_parts, follow, largest_multiple, loop_motions, travelling
from echelon.mechanism.joint import Motion, MotionKind, Symbol
from echelon.mechanism.mechanism import ClosedAt, Mechanism
from echelon.mechanism.stated import stated_values

_SAME = 1e-9  # angles that differ by less are the same, rad
_STEP = pi / STEPS_PER_HALF_TURN
_DIGITS = 15
_LARGEST_MULTIPLE = 200  # of a rational point of the circle, whose digits multiply too


def closed_exactly(mechanism: Mechanism, pose: Floats) -> Mechanism:
    """A mechanism whose loops are closed at a pose."""
    exact, symbols = _positions(mechanism, dict(zip(mechanism.positions, map(float, pose), strict=True)))
    return follow(replace(mechanism, symbols={**mechanism.symbols, **symbols}), exact)


def rational_pose(mechanism: Mechanism, pose: Floats) -> ClosedAt:
    """Positions of what moves in loops next to a pose, of angles rational points of the circle.

    Ratios of couplings without a value, or of so many digits that the points would not end, raise ValueError.
    """
    values, parts = dict(zip(mechanism.positions, map(float, pose), strict=True)), angle_parts(mechanism)
    involved, travels = loop_motions(mechanism), travelling(mechanism)
    if largest_multiple(mechanism) > _LARGEST_MULTIPLE:
        raise ValueError(f"angles that are turned by more than {_LARGEST_MULTIPLE} times a common part")
    return {
        m.name: _exact(m, values, parts.get(m.name, 1), None, m.name in travels)
        for m in mechanism.motions
        if m.name in involved
    }


def stated_exactly(mechanism: Mechanism) -> ClosedAt:
    """Exact positions at the assembly pose, zero where it says nothing; empty if an angle there has no exact sine."""
    upright = {m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL}
    values = dict.fromkeys(mechanism.positions, 0.0) | upright | dict(mechanism.assembly)
    try:
        exact, symbols = _positions(mechanism, values)
    except ValueError:  # ratios of couplings that are no numbers
        return {}
    return {} if symbols else exact


def _positions(mechanism: Mechanism, values: Mapping[str, float]) -> tuple[ClosedAt, dict[str, Symbol]]:
    """Exact positions of what moves in loops, and the symbols that they hold."""
    angles, parts, involved = _Angles({*mechanism.symbols}), angle_parts(mechanism), loop_motions(mechanism)
    exact, travels = dict[str, tuple[Polynomial, ...]](), travelling(mechanism)
    for motion in sorted(mechanism.motions, key=lambda m: abs(values.get(m.name, 0.0))):  # halves before their doubles
        if motion.name in involved:
            exact[motion.name] = _exact(motion, values, parts.get(motion.name, 1), angles, motion.name in travels)
    return exact, angles.symbols


def check_pose(mechanism: Mechanism, pose: ClosedAt) -> None:
    """Check that exact positions are complete, and points of circles and spheres where they have to be."""
    sizes, travels = {MotionKind.BALL: 4, MotionKind.TRANSLATION: 1}, travelling(mechanism)
    motions = {m.name: m for m in mechanism.motions if m.name in loop_motions(mechanism)}
    if pose.keys() != motions.keys():
        wrong = ", ".join(f"'{name}'" for name in sorted(pose.keys() ^ motions.keys()))
        raise ValueError(f"it needs the positions of all motions in loops and of no others ({wrong})")
    field = PrimeField.random(rng := random_generator(DEFAULT_SEED), CERTIFICATE_BITS)
    values = stated_values(mechanism)
    for name, position in pose.items():
        size = sizes.get(motions[name].kind, 3 if name in travels else 2)
        if len(position) != size:
            raise ValueError(f"'{name}' needs {size} numbers, not {len(position)}")
        symbols = {symbol for x in position for symbol in x.symbols()}
        if symbols - set(values.names):
            raise ValueError(f"'{name}' holds symbols without a value ({', '.join(sorted(symbols))})")
        square = Polynomial.sum(x * x for x in position[: 2 if name in travels else size])
        if size > 1 and square.evaluate(values.residues(square.generators(), field, rng), field.embed) % field.p != 1:
            raise ValueError(f"the position of '{name}' is not a point of the unit circle or sphere")


def _exact(
    motion: Motion, values: Mapping[str, float], parts: int, angles: _Angles | None, travels: bool
) -> tuple[Polynomial, ...]:
    if motion.kind is MotionKind.BALL:
        return tuple(map(as_polynomial, unit_quaternion([values[name] for name in motion.positions])))
    value = values[motion.name]
    if motion.kind is MotionKind.TRANSLATION:
        return (as_polynomial(Fraction(f"{value:.{_DIGITS}f}")),)
    if angles is None:
        cosine, sine, *_ = unit_quaternion([cos(value / parts), sin(value / parts), 0.0, 0.0])
        return tuple(map(as_polynomial, (cosine, sine, Fraction(value))[: 2 + travels]))
    angle = angles.exact(value, motion.name, parts)
    point = angle.cos(), angle.sin()
    return (*point, as_polynomial(parts * angles.decimal(angle))) if travels else point


class _Angles:
    """Gives angles exact values, and symbols where they are no multiples of 15° and no sums of others."""

    def __init__(self, taken: set[str]) -> None:
        self._taken, self.symbols = taken, dict[str, Symbol]()
        self._known, self._values = [Angle()], [0.0]

    def exact(self, value: float, name: str, parts: int) -> Angle:
        """One of the equal parts of an angle."""
        value /= parts
        angle = self._recognised(value, parts)
        if angle is None:
            angle = Angle(parts=((self._symbol(name, value, _DIGITS + len(str(parts)) - 1), 1),))
        if angle.parts and angle not in self._known:
            self._known += [angle, _negative(angle)]
            self._values += [value, -value]
        return angle

    def _recognised(self, value: float, parts: int) -> Angle | None:
        """The shortest sum of at most two known angles, and a multiple of 15°, if there is one."""
        known = np.array(self._values if parts <= LARGEST_EXPANSION else [0.0])
        sums = known + known[:, None]
        steps = (value - sums) / _STEP
        near = np.argwhere(np.triu(np.abs(steps - np.rint(steps)) * _STEP * parts < _SAME))
        turns = (Fraction(round(steps[i, j]), STEPS_PER_HALF_TURN) for i, j in near)
        found = [_sum(self._known[i], self._known[j], turn) for (i, j), turn in zip(near, turns, strict=True)]
        shortest = min(found, key=_length, default=None)
        return shortest if shortest is not None and _length(shortest) <= LARGEST_EXPANSION else None

    def decimal(self, angle: Angle) -> Fraction:
        """The value of an angle; sums of angles have sums of these."""
        turned = [count * Fraction(str(self.symbols[symbol].exact)) for symbol, count in angle.parts]
        return sum(turned, angle.half_turns * Fraction(pi))

    def _symbol(self, name: str, value: float, digits: int) -> str:
        stem = "".join(c if c.isalnum() else "_" for c in name)
        symbol = stem = f"{stem}_closed" if not stem[:1].isdigit() else f"q{stem}_closed"
        while symbol in self._taken:
            symbol += "_"
        self._taken.add(symbol)
        text = f"{value:.{digits}f}"
        self.symbols[symbol] = Symbol(symbol, float(text), text, f"angle of {name} where the loops are closed")
        return symbol


def _sum(first: Angle, second: Angle, turn: Fraction) -> Angle:
    counts = Counter[str]()
    for symbol, count in (*first.parts, *second.parts):
        counts[symbol] += int(count)
    parts = tuple((symbol, count) for symbol, count in counts.items() if count)
    return Angle(first.half_turns + second.half_turns + turn, parts)


def _negative(angle: Angle) -> Angle:
    return Angle(-angle.half_turns, tuple((symbol, -count) for symbol, count in angle.parts))


def _length(angle: Angle) -> int:
    return sum(abs(int(count)) for _, count in angle.parts)


def unit_quaternion(parts: Sequence[float]) -> list[Fraction]:
    """The rational point of the unit sphere next to a quaternion, by stereographic projection from the far side."""
    lead = max(range(4), key=lambda k: abs(parts[k]))
    sign = 1 if parts[lead] >= 0 else -1
    t = [Fraction(x / (parts[lead] + sign)).limit_denominator(10**_DIGITS) for x in parts]
    square = sum((x * x for k, x in enumerate(t) if k != lead), Fraction(0))
    return [sign * (1 - square if k == lead else 2 * x) / (1 + square) for k, x in enumerate(t)]
