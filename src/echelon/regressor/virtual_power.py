"""The regressor y = X(q, q̇, q̈) ζ of the measured outputs, by virtual power.

A forward recursion finds the angular velocity, angular acceleration and linear acceleration (minus gravity) of every
body, in its own axes; from them follows the wrench about the body's origin that a unit of each of its ten standard
parameters needs.  Certificates rest on this recursion.  It is separate on purpose from that of the energy rows, which
find what is certified, and from that of the inverse dynamics (:mod:`echelon.dynamics.recursion`).

In a virtual motion u of the measured freedoms, uᵀ X ζ is the power of the bodies' inertial wrenches and of the effects
(Jourdain's principle).  With u a unit vector it is a row of X: the wrench that a unit of each parameter needs meets the
twist that the freedom gives to the parameter's body.  (To carry every wrench back to every freedom takes half as many
operations again.)  One row with arbitrary u holds every row of X, but costs O(bodies) operations instead of O(bodies ·
depth).  So X · N = 0 and the rank of X can be checked on X itself at little cost.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

from echelon.mechanism.effect import Side
from echelon.mechanism.joint import GROUND
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values
from echelon.program.tape import Program, Scalar
from echelon.regressor.linear import FEW_COLUMNS, BlockRows, LinearForms, Rows, blocks_of, column_sums, energy_form
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.regressor.loops.recorded_loops import loops_of
from echelon.regressor.steps import (
    EffectRecorder,
    Probes,
    Recorder,
    Step,
    Vec,
    VirtualMotion,
    add,
    any_motion,
    cross,
    dot,
    forward,
    into_frame,
    motion_of_joints,
    scale,
    virtual_motion,
)

Twist = tuple[Vec, Vec]
"""Angular velocity and linear velocity of the frame's origin, in the frame's axes."""

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force, in the frame's axes."""


def inverse_dynamics_regressor(mechanism: Mechanism, columns: Sequence[int] | None = None) -> LinearForms:
    """Record X with y = X ζ: rows are the mechanism's outputs (N·m or N), columns its parameters or the given ones.

    Entries go column by column, which is the order in which intermediate values are soonest done with.  Inputs are
    ``q[...]``, ``qd[...]``, ``qdd[...]``, geometry symbols, and ``i[...]`` where effects use measured inputs.  With
    loops, rates are those of the independent coordinates, and positions must be closed.
    """
    program = Program()
    closed = DependentMotion(mechanism, program) if mechanism.closures else None
    recorded = _RecordedPowers(mechanism, program, closed.given() if closed else None)
    wanted = range(len(mechanism.parameters)) if columns is None else columns
    rows = []
    for output in mechanism.outputs:
        speeds = {output.name: program.one}
        motion = virtual_motion(mechanism, recorded.probes, speeds, closed.speeds if closed else None)
        rows.append(recorded.powers(motion, set(wanted)))
    entries = {
        (row, place): powers[column].node
        for place, column in enumerate(wanted)
        for row, powers in enumerate(rows)
        if not powers[column].is_zero
    }
    return LinearForms(recorded.program, entries, (len(rows), len(wanted)))


def virtual_power_form(mechanism: Mechanism) -> LinearForms:
    """Record uᵀ X(q, q̇, q̈), one row.

    Inputs are ``u[...]`` for every output beside those of :func:`inverse_dynamics_regressor`; with loops, also
    ``v[...]`` for the freedoms that the outputs do not determine, or for all if every force is measured.
    """
    recorded = _RecordedPowers(mechanism)
    program, recorder, probes = recorded.program, recorded.recorder, recorded.probes
    if mechanism.closures and mechanism.measures_every_force:
        motion, known = any_motion(mechanism, recorder), None
    else:
        speeds = {output.name: program.input(f"u[{output.name}]") for output in mechanism.outputs}
        motion = virtual_motion(mechanism, probes, speeds)
        known = motion.chosen
    powers = recorded.powers(motion, range(len(mechanism.parameters)))
    entries = {(0, column): power.node for column, power in powers.items() if not power.is_zero}
    loops = loops_of(mechanism, recorder, probes, known) if mechanism.closures else None
    many = len(mechanism.parameters) > FEW_COLUMNS
    blocks = _block_powers(recorded) if many and mechanism.measures_every_force and not mechanism.closures else None
    return LinearForms(program, entries, (1, len(mechanism.parameters)), loops, blocks, known_values(mechanism))


def _block_powers(recorded: _RecordedPowers) -> BlockRows:
    """Powers in virtual motions of one coordinate each, in the columns of the bodies and effects of its block."""
    mechanism, program = recorded.mechanism, recorded.program
    blocks = blocks_of(mechanism)
    columns, rows = [], []
    for block in blocks:
        entries: dict[tuple[int, int], int] = {}
        for row, name in enumerate(block.coordinates):
            motion = motion_of_joints(mechanism, recorded.recorder, {name: program.one})
            powers = recorded.powers_of(motion, block.bodies, block.effects)
            entries |= {(row, column): power.node for column, power in powers.items() if not power.is_zero}
        columns.append(tuple(recorded.columns_of(block.bodies, block.effects)))
        rows.append(entries)
    return BlockRows(program, tuple(columns), tuple(rows), tuple(block.carried for block in blocks))


def power_form(mechanism: Mechanism) -> LinearForms:
    """Record the power of the forces of all independent coordinates, q̇ᵀ X(q, q̇, q̈)."""
    recorded = _RecordedPowers(mechanism)
    motion = any_motion(mechanism, recorded.recorder, "qd")
    powers = recorded.powers(motion, range(len(mechanism.parameters)))
    entries = {(0, column): power.node for column, power in powers.items() if not power.is_zero}
    loops = loops_of(mechanism, recorded.recorder) if mechanism.closures else None
    return LinearForms(recorded.program, entries, (1, len(mechanism.parameters)), loops)


def rows_of(mechanism: Mechanism) -> Rows:
    """The cheapest rows for what is measured: energies while every force is, and only bodies have parameters."""
    if mechanism.measures_every_force and not mechanism.effects:
        return Rows(energy_form(mechanism), 1)
    return Rows(virtual_power_form(mechanism), 0)


class _RecordedPowers:
    """A mechanism's motion on a program, and powers in virtual motions."""

    def __init__(
        self, mechanism: Mechanism, program: Program | None = None, given: Mapping[str, Scalar] | None = None
    ) -> None:
        self.mechanism, self.program = mechanism, program or Program()
        self.recorder = Recorder(mechanism, self.program, given)
        self.probes = Probes(mechanism, self.recorder)
        self._steps = {index: self.recorder.steps(index) for index in range(len(mechanism.bodies))}
        accelerations = _all_accelerations(self.recorder, self._steps)
        self._wrenches = {index: _unit_wrenches(accelerations[index], self.program) for index in mechanism.first_column}
        effects = EffectRecorder(mechanism, self.recorder)
        self._effects = [effects.forces(effect) for effect in mechanism.effects]
        self._first_effect = len(mechanism.parameters) - len(self._effects)

    def powers(self, motion: VirtualMotion, wanted: Collection[int]) -> dict[int, Scalar]:
        """Power per unit of the wanted standard parameters, by column."""
        everything = range(len(self.mechanism.bodies)), range(len(self._effects))
        return self.powers_of(motion, *everything, wanted)

    def powers_of(
        self,
        motion: VirtualMotion,
        bodies: Sequence[int],
        effects: Sequence[int],
        wanted: Collection[int] | None = None,
    ) -> dict[int, Scalar]:
        """Virtual power of some bodies and effects; the motion must leave at rest what these bodies hang on."""
        twists = _twists(self.mechanism, self.recorder, self._steps, self.probes, motion, bodies)
        found = column_sums(
            self.mechanism, bodies, lambda body, kind: _power(twists[body], self._wrenches[body][kind]), wanted
        )
        for k in effects:
            column = self._first_effect + k
            if wanted is None or column in wanted:
                found[column] = self._effect_power(self._effects[k], motion)
        return found

    def columns_of(self, bodies: Sequence[int], effects: Sequence[int]) -> list[int]:
        """Columns of some bodies and effects."""
        first, carried = self.mechanism.first_column, (len(self.mechanism.bodies[i].carried) for i in bodies)
        inertial = [first[i] + k for i, count in zip(bodies, carried, strict=True) for k in range(count)]
        return [*dict.fromkeys(inertial), *(self._first_effect + k for k in effects)]

    def _effect_power(self, forces: Sequence[tuple[Side, str, Scalar]], motion: VirtualMotion) -> Scalar:
        total = self.program.zero
        for side, at, force in forces:
            speeds = motion.freedoms if side is Side.JOINT else motion.drives
            if at in speeds:
                total = total + force * speeds[at]
        return total


# -- virtual motions ---------------------------------------------------------------------------------------------------


def _twists(
    mechanism: Mechanism,
    recorder: Recorder,
    steps: dict[int, list[Step]],
    probes: Probes,
    motion: VirtualMotion,
    bodies: Iterable[int],
) -> dict[int, Twist]:
    """Virtual twists of some bodies, where those that they hang on and that are not among them are at rest."""
    rest = (recorder.zeros, recorder.zeros)
    twists: dict[int, Twist] = {GROUND: rest}
    for step in probes.steps(GROUND, on_parent=False):
        twists[GROUND] = _advance(twists[GROUND], step, motion)
    for index in bodies:
        current = twists.get(mechanism.bodies[index].parent, rest)
        for step in (*probes.steps(index, True), *steps[index], *probes.steps(index, False)):
            current = _advance(current, step, motion)
        twists[index] = current
    return twists


def _advance(twist: Twist, step: Step, motion: VirtualMotion) -> Twist:
    angular, linear = twist
    if step.shift is not None:
        linear = add(linear, cross(angular, step.shift))
    angular, linear = into_frame(step, angular), into_frame(step, linear)
    for freedom in step.freedoms:
        if freedom.name in motion.freedoms:
            angular = add(angular, scale(freedom.angular, motion.freedoms[freedom.name]))
            linear = add(linear, scale(freedom.linear, motion.freedoms[freedom.name]))
    return angular, linear


def _power(twist: Twist, wrench: Wrench) -> Scalar:
    return dot(twist[0], wrench[0]) + dot(twist[1], wrench[1])


# -- accelerations and wrenches ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Accelerations:
    """Angular velocity, angular acceleration, and linear acceleration of the origin minus gravity."""

    angular: Vec
    angular_rate: Vec
    linear: Vec


def _all_accelerations(recorder: Recorder, steps: Mapping[int, Sequence[Step]]) -> dict[int, _Accelerations]:
    """Accelerations of every body, by index; the ground has those that gravity stands for."""
    gx, gy, gz = recorder.gravity()
    ground = _Accelerations(recorder.zeros, recorder.zeros, (-gx, -gy, -gz))
    return forward(recorder.mechanism, ground, lambda now, index: reduce(_accelerated, steps[index], now))


def _accelerated(now: _Accelerations, step: Step) -> _Accelerations:
    linear = now.linear
    if step.shift is not None:
        swing = add(cross(now.angular_rate, step.shift), cross(now.angular, cross(now.angular, step.shift)))
        linear = add(linear, swing)
    before = into_frame(step, now.angular)
    angular, angular_rate, linear = before, into_frame(step, now.angular_rate), into_frame(step, linear)
    for freedom in step.freedoms:
        turning, sliding = scale(freedom.angular, freedom.rate), scale(freedom.linear, freedom.rate)
        angular = add(angular, turning)
        angular_rate = add(angular_rate, add(cross(before, turning), scale(freedom.angular, freedom.acceleration)))
        coriolis = cross(before, sliding)
        linear = add(linear, add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)))
    return _Accelerations(angular, angular_rate, linear)


def _unit_wrenches(at: _Accelerations, program: Program) -> list[Wrench]:
    """Wrench about the body's origin needed by a unit of each of XX … M."""
    zero, one = program.zero, program.one
    zeros: Vec = (zero, zero, zero)
    wrenches: list[Wrench] = []
    for i in range(3):
        for j in range(i, 3):
            rate = _symmetric_unit(i, j, at.angular_rate, zero)
            momentum = _symmetric_unit(i, j, at.angular, zero)
            wrenches.append((add(rate, cross(at.angular, momentum)), zeros))
    for k in range(3):
        x, y, z = (one if k == axis else zero for axis in range(3))
        unit: Vec = (x, y, z)
        force = add(cross(at.angular_rate, unit), cross(at.angular, cross(at.angular, unit)))
        wrenches.append((cross(unit, at.linear), force))
    wrenches.append((zeros, at.linear))
    return wrenches


def _symmetric_unit(i: int, j: int, v: Vec, zero: Scalar) -> Vec:
    """E v, where E is the symmetric matrix with ones at (i, j) and (j, i)."""
    entries = [zero, zero, zero]
    entries[i] = v[j]
    entries[j] = v[i]
    return (entries[0], entries[1], entries[2])
