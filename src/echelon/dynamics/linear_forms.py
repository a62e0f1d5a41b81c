"""Rows of X(q, q̇, q̈) with y = X ζ, recorded as linear forms in the standard parameters ζ: powers and energies.

*Virtual power.*  A forward recursion finds the angular velocity, angular acceleration and linear acceleration (minus
gravity) of every body, in its own axes; from them follows the wrench about the body's origin that a unit of each of its
ten standard parameters needs.  In a virtual motion u of the measured freedoms, uᵀ X ζ is the power of the bodies'
inertial wrenches and of the effects (Jourdain's principle).  With u a unit vector it is a row of X: the wrench that a
unit of each parameter needs meets the twist that the freedom gives to the parameter's body.  (To carry every wrench
back to every freedom takes half as many operations again.)  One row with arbitrary u holds every row of X, but costs
O(bodies) operations instead of O(bodies · depth).  So X · N = 0 and the rank of X can be checked on X itself at little
cost.

*Energy.*  When every independent coordinate's generalised force is measured, y = X ζ vanishes for all motions exactly
if the kinetic energy vanishes and the potential energy is constant: y = M q̈ + C q̇ + g is linear in q̈ with coefficient
M, the Hessian of the kinetic energy, and then g is the gradient of the potential.  So the rows [1, E(q, q̇)] have the
null space of X (with a leading column for the constant), need no accelerations, and cost a fraction of Newton–Euler.

Energies find the base parameters and powers certify them; so the two recursions are separate on purpose, and both from
that of the inverse dynamics (:mod:`echelon.dynamics.recursion`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial, reduce
from typing import TYPE_CHECKING

import numpy as np

from echelon.algebra import (
    FieldSampler,
    Op,
    Program,
    RealPoints,
    Residues,
    Scalar,
    StagedSchedule,
    sampler_of,
    with_free_functions,
)
from echelon.dynamics.blocks import BlockRows, MovingBlock, blocks_of
from echelon.dynamics.contact_motion import ContactMotion
from echelon.dynamics.frame_motion import Accelerations, Twist, accelerated, moved
from echelon.dynamics.loop_rows import dependent_motion, recorded_loops
from echelon.robot import (
    GROUND,
    EffectRecorder,
    Mechanism,
    Probes,
    RecordedStep,
    Recorder,
    Side,
    Vec,
    VirtualMotion,
    add,
    all_symbols,
    any_motion,
    cross,
    dot,
    forward,
    into_frame,
    measured_motion,
    motion_of_joints,
    scale,
    value_texts,
    virtual_motion,
)
from echelon.shared import EchelonError

if TYPE_CHECKING:
    from echelon.loops import Loops

FEW_COLUMNS = 120
"""So many columns are eliminated at once in less time than block by block."""


@dataclass(frozen=True)
class LinearForms:
    """Rows of coefficients of some parameters, recorded on a program."""

    program: Program
    entries: Mapping[
        tuple[int, int], int
    ]  # node of every entry that is not structurally zero
    shape: tuple[int, int]  # numbers of rows and columns
    loops: Loops | None = (
        None  # what keeps motions on closed configurations, where there are loops
    )
    blocks: BlockRows | None = (
        None  # combinations of rows, over all columns, that see little at a time
    )
    values: Mapping[str, str] = field(
        default_factory=dict
    )  # stated values of symbols, as exact text
    whole: LinearForms | None = field(
        default=None, repr=False, compare=False
    )  # of which these are some columns
    # the same columns are asked for again and again, and a schedule costs as much as an evaluation
    _restricted: dict[tuple[int, ...], LinearForms] = field(
        init=False, default_factory=dict, repr=False, compare=False
    )
    _samplers: list[FieldSampler] = field(
        init=False, default_factory=list, repr=False, compare=False
    )

    def columns(self, keep: Collection[int]) -> LinearForms:
        """The forms restricted to some columns, renumbered in the given order."""
        kept = tuple(keep)
        if kept not in self._restricted:
            position = {column: i for i, column in enumerate(kept)}
            entries = {
                (r, position[c]): node
                for (r, c), node in self.entries.items()
                if c in position
            }
            self._restricted[kept] = replace(
                self,
                entries=entries,
                shape=(self.shape[0], len(position)),
                whole=self.whole or self,
            )
        return self._restricted[kept]

    @cached_property
    def rational(self) -> bool:
        """Whether entries are rational functions of what varies, region by region of signs, so that primes do."""
        return self.loops is None and FieldSampler.suits(
            self.program, list(self.entries.values())
        )

    @cached_property
    def freed(self) -> LinearForms | None:
        """These forms with free variables in the place of functions; None where primes do not evaluate those either.

        Relations between its columns hold for any functions, and so for these.  It may have fewer than these.  The
        regions of its signs are known to be enough: they need not be those of real states.
        """
        program, outputs = with_free_functions(
            self.program, list(self.entries.values())
        )
        entries = dict(zip(self.entries, outputs, strict=True))
        freed = LinearForms(
            program, entries, self.shape, self.loops, values=self.values
        )
        if not freed.rational or (freed.has_signs and freed.points.report.unseen):
            return None
        return freed

    def sampler(self) -> FieldSampler:
        """Evaluates all entries at random states modulo primes."""
        if not self._samplers:
            nodes = list(self.entries.values())
            if not self.rational:
                raise EchelonError(
                    "states of loops and of functions are real ones, and no points of finite fields"
                )
            self._samplers.append(
                sampler_of(self.program, nodes, self.points if self.has_signs else None)
            )
        return self._samplers[0]

    @cached_property
    def points(self) -> RealPoints:
        """Random real states, where these are free; those of all columns serve some, too."""
        nodes = list(self.entries.values())
        if self.whole is not None and self.has_signs:
            return self.whole.points.of(nodes)
        return RealPoints(self.program, nodes, self.values)

    @cached_property
    def has_signs(self) -> bool:
        """Whether signs occur in some entry."""
        return any(
            self.program.ops[n] in (Op.SIGN, Op.ABS)
            for n in self.program.needed(self.entries.values())
        )

    @cached_property
    def schedule(self) -> StagedSchedule:
        """All entries, ordered for evaluation in any arithmetic."""
        return StagedSchedule(self.program, list(self.entries.values()))

    def stacked(self, values: Residues) -> Residues:
        """Sampled entries as matrices, one for each geometry."""
        # shapes: values (entries, geometries, states); returns (geometries, states · rows, columns)
        _, geometries, states = values.shape
        matrix = np.zeros((geometries, states, *self.shape), dtype=values.dtype)
        for (row, column), value in zip(self.entries, values, strict=True):
            matrix[:, :, row, column] = value
        return matrix.reshape(geometries, states * self.shape[0], self.shape[1])

    def operations(self) -> dict[str, int]:
        """Operations needed to evaluate all entries, by kind."""
        return self.program.count(self.entries.values())

    def __repr__(self) -> str:
        return f"LinearForms({self.shape[0]} × {self.shape[1]}, {len(self.entries)} entries, {self.program})"


@dataclass(frozen=True)
class Rows:
    """Forms whose null space is that of X, with some auxiliary columns before those of the parameters."""

    forms: LinearForms
    auxiliary: int  # 1 for energies, which are known up to a constant; 0 for forces

    def columns(self, keep: Sequence[int]) -> Rows:
        """The rows restricted to some parameters, renumbered in the given order."""
        chosen = [*range(self.auxiliary), *(self.auxiliary + column for column in keep)]
        return Rows(self.forms.columns(chosen), self.auxiliary)

    @property
    def freed(self) -> Rows | None:
        """These rows with free variables in the place of functions; see :attr:`LinearForms.freed`."""
        if self.forms.freed is None:
            return None
        return Rows(self.forms.freed, self.auxiliary)


def rows_of(mechanism: Mechanism) -> Rows:
    """The cheapest rows for what is measured: energies while every force is, and only bodies have parameters."""
    plain = not mechanism.effects and not mechanism.contacts
    if mechanism.measures_every_force and plain:
        return Rows(energy_form(mechanism), 1)
    return Rows(virtual_power_form(mechanism), 0)


def column_sums(
    mechanism: Mechanism,
    bodies: Iterable[int],
    unit: Callable[[int, int], Scalar],
    wanted: Collection[int] | None = None,
) -> dict[int, Scalar]:
    """Contribution of a unit of each standard parameter, by column, summed over the bodies that share it."""
    total: dict[int, Scalar] = {}
    for index in bodies:
        for column, kind in enumerate(
            mechanism.bodies[index].carried, mechanism.first_column.get(index, 0)
        ):
            if wanted is None or column in wanted:
                value = unit(index, kind)
                total[column] = total[column] + value if column in total else value
    return total


def _row(values: Mapping[int, Scalar], row: int = 0) -> dict[tuple[int, int], int]:
    """The entries of one row that are not structurally zero."""
    return {
        (row, column): value.node
        for column, value in values.items()
        if not value.is_zero
    }


def _stated(mechanism: Mechanism) -> dict[str, str]:
    """Exact values of those symbols that have one, as text."""
    return value_texts(mechanism, all_symbols(mechanism))


# -- energy ------------------------------------------------------------------------------------------------------------


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
    entries = {(0, 0): program.one.node} | _row(
        {1 + column: energy for column, energy in energies(recorder).items()}
    )
    loops = recorded_loops(recorder)
    return LinearForms(
        program,
        entries,
        (1, 1 + len(mechanism.parameters)),
        loops,
        values=_stated(mechanism),
    )


def energies(recorder: Recorder) -> dict[int, Scalar]:
    """Kinetic and potential energy per unit of each standard parameter, by column."""
    mechanism, rates = recorder.mechanism, _all_rates(recorder)
    found = {index: _energy_of_body(rates[index]) for index in mechanism.first_column}
    return column_sums(mechanism, found, lambda body, kind: found[body][kind])


def energy_changes(mechanism: Mechanism) -> BlockRows:
    """Record how the energy of its bodies changes when one block after the other moves from one state to another.

    A linear combination of columns whose energy is constant does not change either, so what these rows show to be
    independent is.  There is one row for each block; inputs of the second state are ``q'[...]`` and ``qd'[...]``.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    names = (
        (f"q[{n}]" for n in mechanism.positions),
        (f"qd[{n}]" for n in mechanism.velocities),
    )
    second = {
        name: program.input(name.replace("[", "'[", 1))
        for some in names
        for name in some
    }
    moved = Recorder(mechanism, program, second)
    rates = _all_rates(recorder)
    blocks = blocks_of(mechanism)
    first = mechanism.first_column
    columns, changes = [], []
    for block in blocks:
        after: dict[int, _Rates] = {}
        differences: dict[int, list[Scalar]] = {}
        for index in block.bodies:
            parent = mechanism.bodies[index].parent
            after[index] = reduce(
                _advance, moved.steps(index), after.get(parent, rates[parent])
            )
            if index in first:
                pairs = zip(
                    _energy_of_body(after[index]),
                    _energy_of_body(rates[index]),
                    strict=True,
                )
                differences[index] = [new - old for new, old in pairs]
        # the function is called before the loop goes on
        sums = column_sums(
            mechanism,
            differences,
            lambda body, kind: differences[body][kind],  # noqa: B023
        )
        columns.append(tuple(sums))
        changes.append(_row(sums))
    return BlockRows(
        program,
        tuple(columns),
        tuple(changes),
        tuple(block.carried for block in blocks),
    )


def _all_rates(recorder: Recorder) -> dict[int, _Rates]:
    ground = _Rates(
        recorder.zeros, recorder.zeros, recorder.gravity(), recorder.program.zero
    )
    return forward(
        recorder.mechanism,
        ground,
        lambda rates, index: reduce(_advance, recorder.steps(index), rates),
    )


def _advance(rates: _Rates, step: RecordedStep) -> _Rates:
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
    inertia = [
        wx * wx * half,
        wx * wy,
        wx * wz,
        wy * wy * half,
        wy * wz,
        wz * wz * half,
    ]
    return [*inertia, *first, dot(rates.linear, rates.linear) * half + rates.lift]


# -- virtual power -----------------------------------------------------------------------------------------------------

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force, in the frame's axes."""


def inverse_dynamics_regressor(
    mechanism: Mechanism, columns: Sequence[int] | None = None
) -> LinearForms:
    """Record X with y = X ζ: rows are the mechanism's outputs (N·m or N), columns its parameters or the given ones.

    Entries go column by column, which is the order in which intermediate values are soonest done with.  Inputs are
    ``q[...]``, ``qd[...]``, ``qdd[...]``, geometry symbols, and ``i[...]`` where effects use measured inputs.  With
    loops, rates are those of the independent coordinates, and positions must be closed.
    """
    program = Program()
    closed = dependent_motion(mechanism, program)
    recorded = _RecordedPowers(mechanism, program, closed.given() if closed else None)
    wanted = range(len(mechanism.parameters)) if columns is None else columns
    rows = []
    for output in mechanism.outputs:
        speeds = {output.name: program.one}
        motion = virtual_motion(
            mechanism, recorded.probes, speeds, closed.speeds if closed else None
        )
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
    program = Program()
    contacts = ContactMotion(mechanism, program) if mechanism.contacts else None
    recorded = _RecordedPowers(
        mechanism, program, None if contacts is None else contacts.given
    )
    recorder, probes = recorded.recorder, recorded.probes
    speeds = contacts.speeds if contacts is not None else None
    motion = measured_motion(mechanism, probes, speeds)
    entries = _row(recorded.powers(motion))
    loops = recorded_loops(recorder, probes, motion.chosen or None)
    many = len(mechanism.parameters) > FEW_COLUMNS
    blocks = (
        _block_powers(recorded)
        if many
        and mechanism.measures_every_force
        and loops is None
        and contacts is None
        else None
    )
    return LinearForms(
        program,
        entries,
        (1, len(mechanism.parameters)),
        loops,
        blocks,
        _stated(mechanism),
    )


def powers_along(
    mechanism: Mechanism, program: Program, given: Mapping[str, Scalar]
) -> LinearForms:
    """Record uᵀ X, one row, along a motion: values that stand in for states, by the names of their inputs."""
    recorded = _RecordedPowers(mechanism, program, given)
    motion = measured_motion(mechanism, recorded.probes)
    shape = (1, len(mechanism.parameters))
    return LinearForms(
        program, _row(recorded.powers(motion)), shape, values=_stated(mechanism)
    )


def _block_powers(recorded: _RecordedPowers) -> BlockRows:
    """Powers in virtual motions of one coordinate each, in the columns of the bodies and effects of its block."""
    mechanism, program = recorded.mechanism, recorded.program
    blocks = blocks_of(mechanism)
    columns, rows = [], []
    for block in blocks:
        entries: dict[tuple[int, int], int] = {}
        for row, name in enumerate(block.coordinates):
            motion = motion_of_joints(mechanism, recorded.recorder, {name: program.one})
            entries |= _row(recorded.powers(motion, block=block), row)
        columns.append(tuple(recorded.columns_of(block)))
        rows.append(entries)
    return BlockRows(
        program, tuple(columns), tuple(rows), tuple(block.carried for block in blocks)
    )


def power_form(mechanism: Mechanism) -> LinearForms:
    """Record the power of the forces of all independent coordinates, q̇ᵀ X(q, q̇, q̈)."""
    recorded = _RecordedPowers(mechanism)
    motion = any_motion(mechanism, recorded.recorder, "qd")
    entries = _row(recorded.powers(motion))
    loops = recorded_loops(recorded.recorder)
    return LinearForms(
        recorded.program,
        entries,
        (1, len(mechanism.parameters)),
        loops,
        values=_stated(mechanism),
    )


class _RecordedPowers:
    """A mechanism's motion on a program, and powers in virtual motions."""

    def __init__(
        self,
        mechanism: Mechanism,
        program: Program | None = None,
        given: Mapping[str, Scalar] | None = None,
    ) -> None:
        self.mechanism, self.program = mechanism, program or Program()
        self.recorder = Recorder(mechanism, self.program, given)
        self.probes = Probes(mechanism, self.recorder)
        self._steps = {
            index: self.recorder.steps(index) for index in range(len(mechanism.bodies))
        }
        accelerations = _all_accelerations(self.recorder, self._steps)
        self._wrenches = {
            index: _unit_wrenches(accelerations[index], self.program)
            for index in mechanism.first_column
        }
        effects = EffectRecorder(mechanism, self.recorder)
        self._effects = [effects.forces(effect) for effect in mechanism.effects]
        self._first_effect = len(mechanism.parameters) - len(self._effects)

    def powers(
        self,
        motion: VirtualMotion,
        wanted: Collection[int] | None = None,
        block: MovingBlock | None = None,
    ) -> dict[int, Scalar]:
        """Power per unit of the wanted standard parameters, by column.

        Of a block only, if one is given; the motion must leave at rest what its bodies hang on.
        """
        bodies = range(len(self.mechanism.bodies)) if block is None else block.bodies
        effects = range(len(self._effects)) if block is None else block.effects
        twists = self._twists(motion, bodies)
        found = column_sums(
            self.mechanism,
            bodies,
            lambda body, kind: _power(twists[body], self._wrenches[body][kind]),
            wanted,
        )
        for k in effects:
            column = self._first_effect + k
            if wanted is None or column in wanted:
                found[column] = self._effect_power(self._effects[k], motion)
        return found

    def _twists(self, motion: VirtualMotion, bodies: Iterable[int]) -> dict[int, Twist]:
        """Virtual twists of some bodies, where those that they hang on and that are not among them are at rest."""
        rest, probes = (self.recorder.zeros, self.recorder.zeros), self.probes
        twists: dict[int, Twist] = {
            GROUND: reduce(partial(moved, motion), probes.steps(GROUND, False), rest)
        }
        for index in bodies:
            steps = (
                *probes.steps(index, True),
                *self._steps[index],
                *probes.steps(index, False),
            )
            parent = self.mechanism.bodies[index].parent
            twists[index] = reduce(
                partial(moved, motion), steps, twists.get(parent, rest)
            )
        return twists

    def columns_of(self, block: MovingBlock) -> list[int]:
        """Columns of a block's bodies and effects."""
        first, bodies = self.mechanism.first_column, self.mechanism.bodies
        inertial = [
            first[i] + k for i in block.bodies for k in range(len(bodies[i].carried))
        ]
        return [
            *dict.fromkeys(inertial),
            *(self._first_effect + k for k in block.effects),
        ]

    def _effect_power(
        self, forces: Sequence[tuple[Side, str, Scalar]], motion: VirtualMotion
    ) -> Scalar:
        total = self.program.zero
        for side, at, force in forces:
            speeds = motion.at(side)
            if at in speeds:
                total = total + force * speeds[at]
        return total


def _power(twist: Twist, wrench: Wrench) -> Scalar:
    return dot(twist[0], wrench[0]) + dot(twist[1], wrench[1])


# -- accelerations and wrenches ----------------------------------------------------------------------------------------


def _all_accelerations(
    recorder: Recorder, steps: Mapping[int, Sequence[RecordedStep]]
) -> dict[int, Accelerations]:
    """Accelerations of every body, by index; the ground has those that gravity stands for."""
    gx, gy, gz = recorder.gravity()
    ground = Accelerations(recorder.zeros, recorder.zeros, (-gx, -gy, -gz))
    return forward(
        recorder.mechanism,
        ground,
        lambda now, index: reduce(accelerated, steps[index], now),
    )


def _unit_wrenches(at: Accelerations, program: Program) -> list[Wrench]:
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
        force = add(
            cross(at.angular_rate, unit), cross(at.angular, cross(at.angular, unit))
        )
        wrenches.append((cross(unit, at.linear), force))
    wrenches.append((zeros, at.linear))
    return wrenches


def _symmetric_unit(i: int, j: int, v: Vec, zero: Scalar) -> Vec:
    """E v, where E is the symmetric matrix with ones at (i, j) and (j, i)."""
    entries = [zero, zero, zero]
    entries[i] = v[j]
    entries[j] = v[i]
    return (entries[0], entries[1], entries[2])
