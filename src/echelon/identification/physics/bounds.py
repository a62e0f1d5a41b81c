"""Bounds on standard parameters: what any robot satisfies, and what a user knows of the bodies beyond that.

- A body that carries all ten has a pseudo-inertia J ≻ 0.
- A body that carries some of them gave the others to another body (a rotor's mass counts to the link it sits on, a
  payload's shape to its carrier), so only what each single parameter must satisfy is required: M, XX, YY, ZZ ≥ 0.
- Among effects, viscous and Coulomb friction (also for each direction of motion), rotor inertia and spring stiffness
  are not negative: the rows of :data:`echelon.robot.effect.KINDS` say so, and an effect is recognised by what it
  does.  The Stribeck amplitude, offsets, preloads, drive gains and forces of one's own may have any sign, unless the
  user bounds them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from echelon.robot import Effect, Mechanism
from echelon.shared import PER_BODY, Floats, InputError, nearest_of

if TYPE_CHECKING:
    from echelon.formats import BodyBoundsEntry


@dataclass(frozen=True)
class Bounds:
    """Bounds of a robot's standard parameters."""

    bodies: Mapping[str, BodyBoundsEntry] = field(default_factory=dict)  # by body name
    # by parameter name, SI units
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    total_mass: tuple[float, float] | None = None  # of all bodies but loads, kg
    loads: frozenset[str] = frozenset()  # bodies that experiments add to the robot

    def check(self, mechanism: Mechanism) -> None:
        """Check that bodies and parameters exist and carry what is bounded."""
        carried = {body.name: body.carried for body in mechanism.bodies}
        for name, body in self.bodies.items():
            where = f"bounds of body '{name}'"
            if name not in carried:
                raise InputError(
                    f"there is no such body{nearest_of(name, carried)}", element=where
                )
            if (body.box or body.ellipsoid or body.extent or body.symmetry) and len(
                carried[name]
            ) < 10:
                raise InputError(
                    "it does not carry all ten parameters, so it has no centre of mass",
                    element=where,
                )
            if body.mass and 9 not in carried[name]:
                raise InputError("its mass is not among its parameters", element=where)
        for name in self.parameters:
            if name not in mechanism.parameters:
                raise InputError(
                    f"there is no such parameter{nearest_of(name, mechanism.parameters)}",
                    element=f"bounds of '{name}'",
                )


_DIAGONAL = (0, 3, 5, 9)  # XX, YY, ZZ and M, which cannot be negative by themselves

# parameters (of XX … M) that vanish, and pairs that are equal, for each plane and axis of symmetry
_VANISHING = {
    "yz": (1, 2, 6),
    "xz": (1, 4, 7),
    "xy": (2, 4, 8),
    "x": (1, 2, 4, 7, 8),
    "y": (1, 2, 4, 6, 8),
    "z": (1, 2, 4, 6, 7),
}
_EQUAL = {"x": (3, 5), "y": (0, 5), "z": (0, 3)}


@dataclass(frozen=True)
class Roles:
    """Constraints on every standard parameter of a mechanism."""

    mechanism: Mechanism
    # bodies with a pseudo-inertia: name and the column of XX
    bodies: tuple[tuple[str, int], ...]
    # columns of parameters that are not negative by themselves
    positive: tuple[int, ...]
    # columns of parameters of any sign outside the pseudo-inertias
    free: tuple[int, ...]

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """Column of XX of every body with a pseudo-inertia."""
        return tuple(start for _, start in self.bodies)

    @property
    def size(self) -> int:
        """Standard parameters."""
        return len(self.mechanism.columns)

    def blocks(self, values: Floats) -> Floats:
        """The ten parameters of every body with a pseudo-inertia, shape (bodies, 10)."""
        places = np.add.outer(np.array(self.starts, dtype=int), np.arange(PER_BODY))
        found: Floats = values[places]
        return found


def roles(mechanism: Mechanism) -> Roles:
    """The role of every standard parameter."""
    bodies = tuple(
        (mechanism.bodies[body].name, mechanism.first_column[body])
        for body in mechanism.carriers
        if len(mechanism.bodies[body].carried) == PER_BODY
    )
    full = {column + k for _, column in bodies for k in range(PER_BODY)}
    effects = {effect.parameter: effect for effect in mechanism.effects}
    positive: list[int] = []
    free: list[int] = []
    for column, parameter in enumerate(mechanism.columns):
        if column in full:
            continue
        positive_itself = (
            _is_positive(effects[parameter.name])
            if parameter.body is None
            else parameter.kind in _DIAGONAL
        )
        (positive if positive_itself else free).append(column)
    return Roles(mechanism, bodies, tuple(positive), tuple(free))


def _is_positive(effect: Effect) -> bool:
    """Whether an effect is friction, inertia or stiffness, none of which is negative."""
    return bool(effect.actions) and all(action.is_positive for action in effect.actions)


@dataclass(frozen=True)
class LinearLimits:
    """Bounds as rows over the standard parameters ζ."""

    equal: Floats  # shape (k, p + 1); rows (a, b) with a · ζ + b = 0
    least: Floats  # shape (l, p + 1); rows (a, b) with a · ζ + b ≥ 0
    cones: tuple[Floats, ...]  # shape (4, p); second-order cones
    names: tuple[str, ...]  # what each row of least is about


def linear_limits(role: Roles, bounds: Bounds) -> LinearLimits:
    """Signs and bounds as rows; pseudo-inertias are not among them."""
    bounds.check(role.mechanism)
    rows = _LimitRows(role.size)
    for column in role.positive:
        name = role.mechanism.parameters[column]
        if name not in bounds.parameters:
            rows.between({column: 1.0}, (0.0, np.inf), name)
    for name, limits in bounds.parameters.items():
        rows.between({role.mechanism.parameters.index(name): 1.0}, limits, name)
    column_of = {
        role.mechanism.bodies[body].name: first
        for body, first in role.mechanism.first_column.items()
    }
    for name, body in bounds.bodies.items():
        carried = next(b.carried for b in role.mechanism.bodies if b.name == name)
        _body_rows(rows, name, body, column_of[name], carried)
    if bounds.total_mass is not None:
        masses = {
            column: float(_copies(role.mechanism, parameter.body, bounds.loads))
            for column, parameter in enumerate(role.mechanism.columns)
            if parameter.kind == 9 and parameter.body is not None
        }
        if not any(masses.values()):
            raise InputError(
                "no parameter is a mass, so the total mass cannot be bounded"
            )
        rows.between(masses, bounds.total_mass, "total mass")
    return rows.limits()


def _copies(mechanism: Mechanism, body: int, loads: Collection[str]) -> int:
    """Bodies of the robot that share the parameters of one; experiments have the same robot."""
    names = [mechanism.bodies[k].name for k in mechanism.sharing[body]]
    trees = [
        name.partition(".")[0] if mechanism.experiments else ""
        for name in names
        if name not in loads
    ]
    return max(Counter(trees).values(), default=0)


def _body_rows(
    rows: _LimitRows,
    name: str,
    body: BodyBoundsEntry,
    start: int,
    carried: tuple[int, ...],
) -> None:
    if body.mass is not None:
        rows.between({start + carried.index(9): 1.0}, body.mass, f"mass of {name}")
    for k in range(3):
        if body.box is not None:
            low, high = body.box[0][k], body.box[1][k]
            text = f"centre of mass of {name}, {'xyz'[k]}"
            if low == high:
                rows.equal({start + 6 + k: 1.0, start + 9: -low})
                continue
            rows.least({start + 6 + k: 1.0, start + 9: -low}, 0.0, text)
            rows.least({start + 6 + k: -1.0, start + 9: high}, 0.0, text)
    if body.ellipsoid is not None:
        centre, axes = body.ellipsoid
        cone = np.zeros((4, rows.size))
        cone[0, start + 9] = 1.0
        for k in range(3):
            cone[1 + k, start + 6 + k], cone[1 + k, start + 9] = (
                1 / axes[k],
                -centre[k] / axes[k],
            )
        rows.cones.append(cone)
    if body.extent is not None:
        rows.least(_inside(body.extent, start), 0.0, f"extent of {name}")
    vanishing = sorted({k for plane in body.symmetry for k in _VANISHING[plane]})
    for k in vanishing:
        rows.equal({start + k: 1.0})
    for plane in body.symmetry:
        if plane in _EQUAL:
            first, second = _EQUAL[plane]
            rows.equal({start + first: 1.0, start + second: -1.0})


def _inside(
    extent: tuple[tuple[float, ...], tuple[float, ...]], start: int
) -> dict[int, float]:
    """∫ 1 − Σ ((x − c)/a)² dm, not negative for mass in an ellipsoid (Wensing, Kim & Slotine 2018), as a row."""
    terms = dict.fromkeys(range(start, start + PER_BODY), 0.0)
    terms[start + 9] = 1.0
    for k, (centre, axis) in enumerate(zip(*extent, strict=True)):
        terms[start + 9] -= (centre / axis) ** 2
        terms[start + 6 + k] += 2 * centre / axis**2
        # ∫ x² dm = ½ (−XX + YY + ZZ), and so on
        for moment, place in enumerate((0, 3, 5)):
            terms[start + place] -= (0.5 if moment != k else -0.5) / axis**2
    return terms


class _LimitRows:
    """Rows of linear limits while they are gathered."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.cones: list[Floats] = []
        self._equal: list[Floats] = []
        self._least: list[Floats] = []
        self._names: list[str] = []

    def equal(self, terms: dict[int, float], constant: float = 0.0) -> None:
        self._equal.append(self._row(terms, constant))

    def least(self, terms: dict[int, float], constant: float, name: str) -> None:
        self._least.append(self._row(terms, constant))
        self._names.append(name)

    def between(
        self, terms: dict[int, float], limits: tuple[float, float], name: str
    ) -> None:
        low, high = limits
        if low == high:
            self.equal(terms, -low)
            return
        if low > -np.inf:
            self.least(terms, -low, name)
        if high < np.inf:
            self.least({c: -v for c, v in terms.items()}, high, name)

    def limits(self) -> LinearLimits:
        equal, least = (
            np.array(rows, dtype=float).reshape(len(rows), self.size + 1)
            for rows in (self._equal, self._least)
        )
        return LinearLimits(
            _independent(equal), least, tuple(self.cones), tuple(self._names)
        )

    def _row(self, terms: dict[int, float], constant: float) -> Floats:
        row = np.zeros(self.size + 1)
        for column, value in terms.items():
            row[column] += value
        row[-1] = constant
        return row


def _independent(equations: Floats) -> Floats:
    """Equations without repetitions, which two symmetries bring; solvers want independent ones."""
    kept: list[Floats] = []
    for row in equations:
        rank = np.linalg.matrix_rank(np.array([*kept, row]))
        if rank > len(kept):
            kept.append(row)
    return np.array(kept).reshape(len(kept), equations.shape[1])
