"""Standard parameters: the columns of X, whatever they describe."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.conventions import LENGTH_DEGREE, UNITS, parameter_name


@dataclass(frozen=True)
class Parameter:
    """One standard parameter."""

    name: str
    unit: str  # SI unit
    body: int | None = None  # index of the body whose inertia it describes; None for parameters of effects
    kind: int | None = None  # its place in XX … M, for a body's parameter

    @property
    def length_degree(self) -> int:
        """Power of length in the unit of an inertial parameter; 0 for other parameters."""
        return 0 if self.kind is None else LENGTH_DEGREE[self.kind]


def inertial_parameter(body: int, label: str, kind: int) -> Parameter:
    """One of the ten standard parameters of a body."""
    return Parameter(parameter_name(label, kind), UNITS[kind], body, kind)
