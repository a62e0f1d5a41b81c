"""Energy rows: the total mechanical energy as a linear form in the standard parameters.

When every independent coordinate's generalised force is measured, y = X ζ vanishes for all motions exactly if the
kinetic energy vanishes and the potential energy is constant: y = M q̈ + C q̇ + g is linear in q̈ with coefficient M,
the Hessian of the kinetic energy, and then g is the gradient of the potential.  So the rows [1, E(q, q̇)] have the null
space of X (with a leading column for the constant), need no accelerations, and cost a fraction of Newton–Euler.  They
find the structure; the certificate then checks the result on X itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial, reduce

from echelon.mechanism.mechanism import Mechanism
from echelon.program.tape import Program, Scalar
from echelon.regressor.linear import BlockRows, LinearForms, blocks_of, column_sums
from echelon.regressor.loops.recorded_loops import loops_of
from echelon.regressor.steps import Recorder, Step, Vec, add, cross, dot, forward, into_frame, scale
from echelon.regressor.virtual_power import virtual_power_form


@dataclass(frozen=True)
class _Rates:
    """Angular and linear velocity and gravity in a frame's axes; ``lift`` is −g·p of its origin."""

    angular: Vec
    linear: Vec
    gravity: Vec
    lift: Scalar


def energy_form(mechanism: Mechanism) -> LinearForms:
    """Record E(q, q̇) = kinetic + potential energy, one row: the constant 1, then a column per standard parameter."""
    program = Program()
    recorder = Recorder(mechanism, program)
    rates = _all_rates(recorder)
    energies = {index: _energy_of_body(rates[index]) for index in mechanism.first_column}
    entries = {(0, 0): program.one.node}
    for column, energy in column_sums(mechanism, energies, partial(_entry, energies)).items():
        if not energy.is_zero:
            entries[0, 1 + column] = energy.node
    return LinearForms(program, entries, (1, 1 + len(mechanism.parameters)), loops_of(mechanism, recorder))


@dataclass(frozen=True)
class Rows:
    """Forms whose null space is that of X, with some auxiliary columns before those of the parameters."""

    forms: LinearForms
    auxiliary: int  # 1 for energies, which are known up to a constant; 0 for forces

    def columns(self, keep: Sequence[int]) -> Rows:
        """The rows restricted to some parameters, renumbered in the given order."""
        chosen = [*range(self.auxiliary), *(self.auxiliary + column for column in keep)]
        return Rows(self.forms.columns(chosen), self.auxiliary)


def rows_of(mechanism: Mechanism) -> Rows:
    """The cheapest rows for what is measured: energies while every force is, and only bodies have parameters."""
    if mechanism.measures_every_force and not mechanism.effects:
        return Rows(energy_form(mechanism), 1)
    return Rows(virtual_power_form(mechanism), 0)


def energy_changes(mechanism: Mechanism) -> BlockRows:
    """Record how the energy of its bodies changes when one block after the other moves from one state to another.

    A linear combination of columns whose energy is constant does not change either, so what these rows show to be
    independent is.  There is one row for each block; inputs of the second state are ``q'[...]`` and ``qd'[...]``.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    names = (f"q[{n}]" for n in mechanism.positions), (f"qd[{n}]" for n in mechanism.velocities)
    second = {name: program.input(name.replace("[", "'[", 1)) for some in names for name in some}
    moved = Recorder(mechanism, program, second)
    rates, blocks, first = _all_rates(recorder), blocks_of(mechanism), mechanism.first_column
    columns, changes = [], []
    for block in blocks:
        after: dict[int, _Rates] = {}
        differences: dict[int, list[Scalar]] = {}
        for index in block.bodies:
            parent = mechanism.bodies[index].parent
            after[index] = _advanced(after.get(parent, rates[parent]), moved.steps(index))
            if index in first:
                pairs = zip(_energy_of_body(after[index]), _energy_of_body(rates[index]), strict=True)
                differences[index] = [new - old for new, old in pairs]
        sums = column_sums(mechanism, differences, partial(_entry, differences))
        columns.append(tuple(sums))
        changes.append({(0, column): change.node for column, change in sums.items() if not change.is_zero})
    return BlockRows(program, tuple(columns), tuple(changes), tuple(block.carried for block in blocks))


def _entry(values: Mapping[int, Sequence[Scalar]], body: int, kind: int) -> Scalar:
    return values[body][kind]


def _all_rates(recorder: Recorder) -> dict[int, _Rates]:
    ground = _Rates(recorder.zeros, recorder.zeros, recorder.gravity(), recorder.program.zero)
    return forward(recorder.mechanism, ground, lambda rates, index: _advanced(rates, recorder.steps(index)))


def _advanced(rates: _Rates, steps: Iterable[Step]) -> _Rates:
    return reduce(_advance, steps, rates)


def _advance(rates: _Rates, step: Step) -> _Rates:
    linear, lift = rates.linear, rates.lift
    if step.shift is not None:
        linear = add(linear, cross(rates.angular, step.shift))
        lift = lift - dot(rates.gravity, step.shift)
    angular, linear = into_frame(step, rates.angular), into_frame(step, linear)
    for freedom in step.freedoms:
        angular = add(angular, scale(freedom.angular, freedom.rate))
        linear = add(linear, scale(freedom.linear, freedom.rate))
    return _Rates(angular, linear, into_frame(step, rates.gravity), lift)


def _energy_of_body(rates: _Rates) -> list[Scalar]:
    """Coefficients of XX … M in ½ωᵀIω + mc·(v×ω) + ½m v² − g·(m p + m c)."""
    half = Fraction(1, 2)
    wx, wy, wz = rates.angular
    vw = cross(rates.linear, rates.angular)
    first = [vw[k] - rates.gravity[k] for k in range(3)]
    inertia = [wx * wx * half, wx * wy, wx * wz, wy * wy * half, wy * wz, wz * wz * half]
    return [*inertia, *first, dot(rates.linear, rates.linear) * half + rates.lift]
