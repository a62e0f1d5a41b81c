"""Linear relations between joints, sorted into held, dependent and free ones: against elimination."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from echelon.algebra.exact.polynomial import Polynomial
from echelon.formats.mjcf.mjcf_equality import EqualityRelation, resolve
from echelon.robot.coupling import Spline
from echelon.shared.errors import InputError

JOINTS = "abcde"
small = st.integers(-3, 3)


@st.composite
def systems(draw: st.DrawFn) -> list[tuple[dict[str, int], int]]:
    """Coefficients and constants of up to four relations."""
    rows = st.lists(small, min_size=5, max_size=5)
    found = [
        (dict(zip(JOINTS, draw(rows), strict=True)), draw(small))
        for _ in range(draw(st.integers(0, 4)))
    ]
    return [
        ({name: value for name, value in row.items() if value}, constant)
        for row, constant in found
    ]


def relation(
    number: int, row: dict[str, int], constant: int, joint: str
) -> EqualityRelation:
    terms = {name: Spline((Polynomial.constant(value),)) for name, value in row.items()}
    return EqualityRelation(
        f"equality {number}", joint, terms, Polynomial.constant(constant)
    )


@given(
    systems(),
    st.sets(st.sampled_from(JOINTS)),
    st.lists(st.fractions(-2, 2, max_denominator=9), min_size=5),
)
def test_dependent_joints_solve_the_relations(
    system: list[tuple[dict[str, int], int]], driven: set[str], numbers: list[Fraction]
) -> None:
    reference = dict(zip(JOINTS, numbers, strict=False))
    matrix = sympy.Matrix(
        [[row.get(name, 0) for name in JOINTS] for row, _ in system] or [[0] * 5]
    )
    constants = sympy.Matrix([-constant for _, constant in system] or [0])
    relations = [
        relation(k, row, constant, next(iter(row), "") * bool(k % 2))
        for k, (row, constant) in enumerate(system)
    ]
    if matrix.rank() < matrix.row_join(constants).rank():
        with pytest.raises(InputError, match="contradicts the other equalities"):
            resolve(relations, reference, driven, "robot.xml")
        return
    held, couplings, notes = resolve(relations, reference, driven, "robot.xml")
    assert len(held) + len(couplings) == matrix.rank()
    assert len(notes) == len(system) - matrix.rank()
    dependent = {*held, *(coupling.coordinate for coupling in couplings)}
    position = {
        name: Fraction(k, 7) for k, name in enumerate(JOINTS) if name not in dependent
    }
    position |= {
        name: reference[name] + displacement for name, displacement in held.items()
    }
    for coupling in couplings:
        assert dependent.isdisjoint(coupling.terms)
        value = coupling.offset
        for name, function in coupling.terms.items():
            assert function.ratio is not None
            value = value + function.ratio * position[name]
        assert isinstance(value.number, int | Fraction)
        position[coupling.coordinate] = Fraction(value.number)
    for row, constant in system:
        assert (
            sum(c * (position[name] - reference[name]) for name, c in row.items())
            + constant
            == 0
        )
