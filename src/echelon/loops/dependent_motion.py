"""Dependent motion in mechanisms with loops, recorded: velocities, accelerations, positions, closing forces.

With J the Jacobian of the closure equations, J_D its columns of dependent coordinates and J_I those of independent
ones,

    q̇_D = −J_D⁺ J_I q̇_I,        q̈_D = −J_D⁺ (J_I q̈_I + J̇ q̇),        λ = J_Dᵀ⁺ Γ_D,

and a step q_D − J_D⁺ c(q) of Newton's iteration closes positions that are nearly closed.  All of it is recorded on the
program that needs it, elimination included, so that machine code, source code and derivatives are those of any program.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from math import log2

from echelon.algebra import LeastSquares, Program, Scalar, rates
from echelon.loops.closures import record_closures
from echelon.robot import (
    Mechanism,
    MotionKind,
    Probes,
    Recorder,
    characteristic_length,
)
from echelon.shared import InputError


class DependentMotion:
    """The dependent coordinates of a mechanism on a program, as functions of all positions and of independent rates.

    Inputs are ``q[...]`` of all positions, which are to be closed, and ``qd[...]``, ``qdd[...]`` of independent ones.
    """

    def __init__(self, mechanism: Mechanism, program: Program) -> None:
        self.mechanism, self.program = mechanism, program
        self._recorder = Recorder(mechanism, program)
        found = record_closures(
            mechanism, self._recorder, Probes(mechanism, self._recorder)
        )
        rows = [row for row, kept in enumerate(_kept(mechanism)) if kept]
        self._owners = found.owners
        self._wrenches = found.wrenches
        self._is_length = found.is_length
        self._openings = {row: Scalar(program, found.equations[row]) for row in rows}
        self._columns: dict[str, dict[int, Scalar]] = {}
        for (row, name), node in found.jacobian.items():
            if row in self._openings:
                self._columns.setdefault(name, {})[row] = Scalar(program, node)
        self.dependent = mechanism.dependent_velocities
        loose = next(
            (name for name in self.dependent if name not in self._columns), None
        )
        if loose is not None:
            raise InputError(
                f"'{loose}' is in no loop and not independent", element="independent"
            )
        columns = {name: self._columns[name] for name in self.dependent}
        weights = {row: 1 / unit**2 for row, unit in self.row_units.items()}
        self._system = LeastSquares(program, columns, weights)

    @cached_property
    def length(self) -> Fraction:
        """The characteristic length, rounded to a power of two, m."""
        return Fraction(2) ** round(log2(characteristic_length(self.mechanism)))

    @cached_property
    def units(self) -> dict[str, Fraction]:
        """Units of velocity coordinates: the characteristic length where they slide."""
        sliding = {
            m.name for m in self.mechanism.motions if m.kind is MotionKind.TRANSLATION
        }
        return {
            name: self.length if name in sliding else Fraction(1)
            for name in self.mechanism.velocities
        }

    @cached_property
    def jacobian(self) -> dict[tuple[int, str], Scalar]:
        """Derivatives of the closure equations that count, by equation and velocity coordinate."""
        names = self.mechanism.velocities
        return {
            (row, name): entry
            for name in names
            for row, entry in self._columns.get(name, {}).items()
        }

    @cached_property
    def row_units(self) -> dict[int, Fraction]:
        """Units of the closure equations that count, by their numbers: lengths are in characteristic lengths."""
        return {
            row: self.length if self._is_length[row] else Fraction(1)
            for row in self._openings
        }

    @property
    def openness(self) -> Scalar:
        """(Σ 1/σ²)^(−1/2) over the singular values of J_D in these units: how far the pose is from a singular one."""
        return (
            1
            / self._system.inverse_square(
                {name: self.units[name] for name in self.dependent}
            ).sqrt()
        )

    @property
    def pivots(self) -> dict[str, Scalar]:
        """Pivot of each dependent coordinate, small where it is nearly undetermined; see :class:`LeastSquares`."""
        return self._system.pivots

    def speeds(self, chosen: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """Velocities of the dependent coordinates while other freedoms have some and the rest none."""
        return self._solved(self._opened(chosen))

    def given(self, *still: str) -> dict[str, Scalar]:
        """Rates of all velocity coordinates by the names of inputs; independent ones are inputs, or still (zero)."""
        free = self.mechanism.independent_velocities
        zero = self.program.zero

        def stated(kind: str) -> dict[str, Scalar]:
            if kind in still:
                return dict.fromkeys(free, zero)
            return {n: self.program.input(f"{kind}[{n}]") for n in free}

        qd, qdd = stated("qd"), stated("qdd")
        qd |= self._solved(self._opened(qd))
        opening = self._opened({name: qdd[name] for name in free})
        for row, value in self.bias(qd).items():
            opening[row] = opening.get(row, zero) + value
        qdd |= self._solved(opening)
        return {
            f"{kind}[{n}]": value
            for kind, found in (("qd", qd), ("qdd", qdd))
            for n, value in found.items()
        }

    def closed_positions(self) -> list[Scalar]:
        """Positions after one step of Newton's iteration; those of independent coordinates stay."""
        found: list[Scalar] = []
        for here, change in self._recorder.moved_positions(
            self._solved(self._openings)
        ):
            position = [p + d for p, d in zip(here, change, strict=True)]
            if len(position) > 1 and not all(d.is_zero for d in change):
                size = sum((p * p for p in position), self.program.zero).sqrt()
                position = [p / size for p in position]
            found += position
        return found

    def position_rates(self, speeds: Mapping[str, Scalar]) -> dict[int, Scalar]:
        """Rates of the positions' inputs; see :meth:`Recorder.position_rates`."""
        return self._recorder.position_rates(speeds)

    def closing_wrenches(
        self, efforts: Mapping[str, Scalar]
    ) -> dict[str, tuple[Scalar, ...]]:
        """Wrenches of the closures, by their names, that make the efforts of the dependent coordinates.

        Moment and force on the second body about the first frame's origin, in its axes; where constraints are
        redundant, those of the smallest multipliers.
        """
        multipliers = self._system.solve_transposed(efforts)

        def total(parts: Sequence[tuple[int, Scalar]]) -> Scalar:
            terms = (c * multipliers[row] for row, c in parts if row in multipliers)
            return sum(terms, self.program.zero)

        wrenches = self._components.items()
        return {name: tuple(map(total, components)) for name, components in wrenches}

    def determined(self) -> dict[str, tuple[Scalar, ...]]:
        """For every component of these wrenches, how much of it the efforts determine: 1, or less if redundant."""
        return {
            n: tuple(self._system.share(dict(p)) for p in parts)
            for n, parts in self._components.items()
        }

    @cached_property
    def _components(self) -> dict[str, list[list[tuple[int, Scalar]]]]:
        """Rows of every component of every closure's wrench, and the component that their unit stands for."""
        found: dict[str, list[list[tuple[int, Scalar]]]] = {}
        for closure in self.mechanism.closures:
            rows = [row for row in self._openings if self._owners[row] == closure.name]
            wrenches = {
                row: (*self._wrenches[row][0], *self._wrenches[row][1]) for row in rows
            }
            found[closure.name] = [
                [(r, w[k]) for r, w in wrenches.items() if not w[k].is_zero]
                for k in range(6)
            ]
        return found

    def bias(self, speeds: Mapping[str, Scalar]) -> dict[int, Scalar]:
        """J̇ q̇: accelerations of the closure equations that velocities alone cause, by equation."""
        total: dict[int, Scalar] = {}
        if seeds := self.position_rates(speeds):
            changes = rates(
                self.program, [entry.node for entry in self.jacobian.values()], seeds
            )
            for (row, name), change in zip(self.jacobian, changes, strict=True):
                total[row] = total.get(row, self.program.zero) + change * speeds[name]
        return total

    # -- equations ---------------------------------------------------------------------------------------------------

    def _opened(self, speeds: Mapping[str, Scalar]) -> dict[int, Scalar]:
        found: dict[int, Scalar] = {}
        for name, speed in speeds.items():
            for row, entry in self._columns.get(name, {}).items():
                term = entry * speed
                found[row] = found[row] + term if row in found else term
        return {row: value for row, value in found.items() if not value.is_zero}

    def _solved(self, opening: Mapping[int, Scalar]) -> dict[str, Scalar]:
        return self._system.solve({row: -value for row, value in opening.items()})


def _kept(mechanism: Mechanism) -> Iterator[bool]:
    """Which closure equations count: of a fixed orientation, three say it all near where it is fixed."""
    for closure in mechanism.closures:
        yield from (True for _ in closure.kind.positions)
        yield from (i < j for i, j, _ in closure.kind.directions)
