"""Numbers put in for symbols: none is left anywhere, and nothing moves otherwise."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest

from echelon.algebra.exact.polynomial import Polynomial
from echelon.robot.mechanism import Mechanism
from echelon.robot.substitute import substituted
from support import linkages
from support import textbook_arms as arms
from support.float_regressor import float_regressor, random_states

VALUES = {
    "h1": Fraction(1, 20),
    "h2": Fraction(-3, 40),
    "a": Fraction(3, 10),
    "b": Fraction(1, 5),
    "g": Fraction(981, 100),
}


def left(mechanism: Mechanism) -> set[str]:
    """Symbols that joints, couplings, closures or gravity still hold."""
    found = {s for body in mechanism.bodies for s in body.joint.symbols()}
    found |= {s for part in mechanism.gravity or () for s in part.symbols()}
    found |= {
        s
        for coupling in mechanism.couplings
        for _, f in coupling.terms
        for e in f.expressions
        for s in e.symbols()
    }
    return found | {
        s
        for c in mechanism.closures
        for f in (c.first_frame, c.second_frame)
        for s in f.symbols()
    }


@pytest.mark.parametrize(
    "robot", [arms.helical, arms.coupled, linkages.four_bar, linkages.rssr]
)
def test_no_symbol_is_left(robot: Callable[[], Mechanism]) -> None:
    mechanism = robot()
    values = {
        name: Fraction(k + 1, 7) for k, name in enumerate(sorted(left(mechanism)))
    }
    assert values
    numbers = substituted(
        mechanism, {name: Polynomial.constant(value) for name, value in values.items()}
    )
    assert not left(numbers)


def test_values_enter_where_the_symbols_stood() -> None:
    mechanism = arms.helical()
    numbers = substituted(
        mechanism, {name: Polynomial.constant(value) for name, value in VALUES.items()}
    )
    state = random_states(mechanism, 4)
    expected = float_regressor(
        arms.tree("", *mechanism.bodies, values={n: str(v) for n, v in VALUES.items()}),
        *state,
    )
    np.testing.assert_allclose(float_regressor(numbers, *state), expected, atol=1e-12)
