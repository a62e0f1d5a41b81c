"""Units of columns: what each is in SI units, and what is said about wrong ones."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.identification.logs.units import factor

G = 9.80665
FACTORS = [
    ("rad", "rad", 1.0),
    ("deg", "rad", math.radians(1)),
    ("°", "rad", math.radians(1)),
    ("rev", "rad", math.tau),
    ("turn", "rad", math.tau),
    ("mrad", "rad", 1e-3),
    ("grad", "rad", math.pi / 200),
    ("arcmin", "rad", math.radians(1 / 60)),
    ("deg/s", "rad/s", math.radians(1)),
    ("°/s", "rad/s", math.radians(1)),
    ("rpm", "rad/s", math.tau / 60),
    ("rev/min", "rad/s", math.tau / 60),
    ("RPM", "rad/s", math.tau / 60),
    ("rev/s", "rad/s", math.tau),
    ("deg/s^2", "rad/s²", math.radians(1)),
    ("rad s^-2", "rad/s²", 1.0),
    ("deg/s/s", "rad/s²", math.radians(1)),
    ("mm", "m", 1e-3),
    ("cm", "m", 1e-2),
    ("um", "m", 1e-6),
    ("µm", "m", 1e-6),
    ("in", "m", 0.0254),
    ("mm/s", "m/s", 1e-3),
    ("m / s", "m/s", 1.0),
    ("mm/s²", "m/s²", 1e-3),
    ("N·m", "N·m", 1.0),
    ("Nm", "N·m", 1.0),
    ("N*m", "N·m", 1.0),
    ("N m", "N·m", 1.0),
    ("mNm", "N·m", 1e-3),
    ("mN·m", "N·m", 1e-3),
    ("Nmm", "N·m", 1e-3),
    ("N·mm", "N·m", 1e-3),
    ("kgf·cm", "N·m", G / 100),
    ("kgf*m", "N·m", G),
    ("lbf·in", "N·m", 0.45359237 * G * 0.0254),
    ("in-lbf", "N·m", 0.45359237 * G * 0.0254),
    ("lbf.ft", "N·m", 0.45359237 * G * 0.3048),
    ("ozf·in", "N·m", 0.45359237 / 16 * G * 0.0254),
    ("kg·m²/s²", "N·m", 1.0),
    ("kN", "N", 1e3),
    ("mN", "N", 1e-3),
    ("lbf", "N", 0.45359237 * G),
    ("mA", "A", 1e-3),
    ("mV", "V", 1e-3),
    ("ms", "s", 1e-3),
    ("us", "s", 1e-6),
    ("µs", "s", 1e-6),
    ("ns", "s", 1e-9),
    ("min", "s", 60.0),
    ("", "N·m", 1.0),
]


@pytest.mark.parametrize(("unit", "quantity", "expected"), FACTORS)
def test_factors(unit: str, quantity: str, expected: float) -> None:
    assert factor(unit, quantity) == pytest.approx(expected, rel=4e-16)


WRONG = [
    (
        "mm",
        "rad",
        r"'mm' is the unit of a length, not of an angle \(valid: rad, deg, °",
    ),
    ("deg/s", "rad", "of an angular velocity, not of an angle"),
    ("A", "N·m", "of a current, not of a torque"),
    ("N", "N·m", "of a force, not of a torque"),
    ("nm", "N·m", "of a length, not of a torque"),
    ("lb·in", "N·m", "something else, not of a torque"),
    ("degre", "rad", "'degre' is not a unit; did you mean 'deg'"),
    ("N·", "N", "'N·' is not a unit"),
    ("rad/", "rad", "'rad/' is not a unit"),
    ("(rad)", "rad", "not a unit"),
    ("counts", "rad", "is not a unit of fixed size.*scale"),
]


@pytest.mark.parametrize(("unit", "quantity", "problem"), WRONG)
def test_wrong_units_say_what_would_be_right(
    unit: str, quantity: str, problem: str
) -> None:
    with pytest.raises(ec.InputError, match=problem):
        factor(unit, quantity)


@given(
    st.sampled_from(["N", "m", "s", "rad", "A"]),
    st.sampled_from(["m", "s", "A"]),
    st.integers(1, 3),
)
def test_products_and_quotients_are_what_they_say(
    first: str, second: str, power: int
) -> None:
    prefixed = f"k{first}/m{second}^{power}"
    assert factor(prefixed, f"{first}/{second}^{power}") == pytest.approx(
        1e3 / 1e-3**power, rel=1e-15
    )
    assert factor(f"m{first}*k{second}", f"{first}·{second}") == pytest.approx(
        1.0, rel=1e-15
    )
