"""Transmissions: actuator coordinates as linear combinations of joint coordinates, θ = T q, so τ_q = Tᵀ τ_θ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction


@dataclass(frozen=True)
class Actuator:
    """One row of T."""

    name: str  # the actuator's coordinate
    terms: tuple[tuple[str, Polynomial], ...]  # ratio to each joint coordinate


@dataclass(frozen=True)
class Transmission:
    """All actuators, and what an actuator's motion moves."""

    # those stated, then one of the same name for every coordinate that none of them drives
    actuators: tuple[Actuator, ...]
    # T⁻¹ by columns: for each actuator, the joint velocities that a unit of its velocity causes alone
    inverse: Mapping[str, Mapping[str, RationalFunction]]


def transmission(stated: Sequence[Actuator], coordinates: Sequence[str]) -> Transmission:
    """Complete the stated actuators by direct drives and invert T."""
    driven = [name for name in coordinates if any(name == joint for a in stated for joint, _ in a.terms)]
    if len(driven) != len(stated):
        raise InputError(
            f"{len(stated)} actuators drive {len(driven)} coordinates ({', '.join(driven) or 'none'}); their torques "
            "follow from the motion only if the numbers are equal: measure combinations of them as outputs instead",
            element="transmission",
        )
    matrix = [[RationalFunction(dict(a.terms).get(name, Polynomial({}))) for name in driven] for a in stated]
    solved = _inverse(matrix)
    if solved is None:
        names = ", ".join(a.name for a in stated)
        raise InputError(f"the transmission of {names} is singular: its actuators cannot move independently")
    one = Polynomial.constant(1)
    direct = tuple(Actuator(name, ((name, one),)) for name in coordinates if name not in driven)
    inverse: dict[str, dict[str, RationalFunction]] = {a.name: {a.name: RationalFunction(1)} for a in direct}
    for k, actuator in enumerate(stated):
        inverse[actuator.name] = {name: row[k] for name, row in zip(driven, solved, strict=True) if row[k]}
    return Transmission((*stated, *direct), inverse)


def _inverse(matrix: list[list[RationalFunction]]) -> list[list[RationalFunction]] | None:
    """Inverse of a square matrix by Gauss–Jordan elimination; None if it is singular."""
    size = len(matrix)
    rows = [[*row, *(RationalFunction(int(i == j)) for j in range(size))] for i, row in enumerate(matrix)]
    for column in range(size):
        pivot = next((i for i in range(column, size) if rows[i][column]), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        lead = rows[column][column]
        rows[column] = [entry / lead for entry in rows[column]]
        for i in range(size):
            factor = rows[i][column]
            if i != column and factor:
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[column], strict=True)]
    return [row[size:] for row in rows]
