"""A mechanism whose stated numbers are changed by a little, each on its own: what rounding may have done to them."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from echelon.algebra import Polynomial, as_polynomial, decimal_text, parts_of
from echelon.robot import Body, Mechanism, Placement, Symbol, rational_rotation

FINENESS = 1 << 20
"""Random changes are multiples of this part of the largest one."""
LARGEST_PLAIN = 4
"""Largest denominator of entries of rotations by multiples of 30, 45 or 60 degrees, which stay as they are."""


def nudged(
    mechanism: Mechanism, amount: Fraction, length: float, rng: np.random.Generator
) -> Mechanism:
    """The mechanism with other numbers in its geometry.

    Parameters
    ----------
    mechanism : Mechanism
    amount : Fraction
        The largest change, rad or a share of the length.
    length : float
        Size of the mechanism, m.
    rng : numpy.random.Generator

    Returns
    -------
    Mechanism
        Zeros, and angles that are multiples of 15 degrees, are as before.
    """
    nudge = _Nudge(amount, Fraction(length), rng)
    bodies = tuple(nudge.body(body) for body in mechanism.bodies)
    closures = tuple(
        replace(
            c,
            first_frame=nudge.placement(c.first_frame),
            second_frame=nudge.placement(c.second_frame),
        )
        for c in mechanism.closures
    )
    symbols = {name: nudge.symbol(symbol) for name, symbol in mechanism.symbols.items()}
    return replace(mechanism, bodies=bodies, closures=closures, symbols=symbols)


class _Nudge:
    def __init__(
        self, amount: Fraction, length: Fraction, rng: np.random.Generator
    ) -> None:
        self.amount, self.length, self.rng = amount, length, rng

    def change(self) -> Fraction:
        """A random change up to the largest one."""
        return self.amount * Fraction(
            int(self.rng.integers(-FINENESS, FINENESS)), FINENESS
        )

    def body(self, body: Body) -> Body:
        """A body with its joint's frames elsewhere."""
        steps = tuple(
            self.placement(s) if isinstance(s, Placement) else s
            for s in body.joint.steps
        )
        return replace(body, joint=replace(body.joint, steps=steps))

    def placement(self, placement: Placement) -> Placement:
        """A frame that is moved where its translation is not zero, and turned where its rotation is a general one."""
        x, y, z = (
            value + as_polynomial(self.change() * self.length) if value else value
            for value in placement.translation
        )
        moved = Placement(placement.rotation, (x, y, z))
        if not any(_is_general(entry) for row in placement.rotation for entry in row):
            return moved
        turn = [1.0, *(float(self.change()) / 2 for _ in range(3))]
        return moved @ rational_rotation(turn, float(self.amount) / FINENESS)

    def symbol(self, symbol: Symbol) -> Symbol:
        """A symbol with another value; what stands for others changes with these."""
        if symbol.value is None or symbol.stands_for is not None:
            return symbol
        number = symbol.number
        changed = Fraction(symbol.value) if number is None else parts_of(number)[0]
        changed += self.change()
        text = decimal_text(changed) if number is not None else None
        return replace(symbol, value=float(changed), exact=text, tangent_squared=None)


def _is_general(entry: Polynomial) -> bool:
    """Whether an entry of a rotation is a number that no multiple of 15 degrees has."""
    number = entry.number
    if number is None:
        return False
    return any(Fraction(part).denominator > LARGEST_PLAIN for part in parts_of(number))
