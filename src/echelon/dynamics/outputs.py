"""Measured outputs of a mechanism in terms of parameters, and their parts: inertial forces and effects.

They are recorded with body frames and inertias that cost least.  A body's frame lies directly behind its joint.  A
constant placement there, as in standard Denavit–Hartenberg tables, belongs to the joints that follow: then the frame
has a coordinate axis on the axis of its joint, and a third of the body's parameters count to its parent.

A rotation and a shift along its axis commute.  So an offset along an axis, such as d in Denavit–Hartenberg tables, can
wait until behind the joint, where it often meets an offset that it can be added to, or need not be taken at all because
no body further out is shifted.  On arms with parallel axes this saves up to a tenth of all operations.

Mass on the axis of a rotation moves alike on both sides of the joint: its second moment along the axis, its first
moment and the mass itself may count to either body.  Inertias count to the parent, so that a body behind a rotation
has no more than seven parameters, in whatever form parameters were given; and all of a body that cannot move against
its parent counts to the parent.  The work is done once for all samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from echelon.algebra import Op, Polynomial, Program, Scalar, derivatives
from echelon.dynamics.arguments import Arguments, parameter_input, row_names
from echelon.dynamics.composite import (
    by_quaternion,
    effort_derivatives,
    efforts_at_rest,
    mass_matrix,
)
from echelon.dynamics.loop_rows import dependent_motion
from echelon.dynamics.recursion import MASS, ForwardPass, efforts
from echelon.robot import (
    GROUND,
    ORIGIN,
    Array,
    EffectRecorder,
    Joint,
    Mechanism,
    MotionKind,
    Placement,
    Probes,
    Recorder,
    Step,
    Vector,
    VirtualMotion,
    merge,
    motion_of_joints,
    pseudo_inertia,
    scale,
    virtual_motion,
)
from echelon.robot import RecordedStep as Recorded
from echelon.shared import PER_BODY, InputError

if TYPE_CHECKING:
    from echelon.loops import DependentMotion

Index = tuple[int, ...]  # row, or row and column


class RecordedOutputs:
    """Records outputs on a program of its own.

    ``pivots`` are the columns of the regressor that belong to parameters; all other columns' parameters are zero.
    ``sums`` allows sums of angles (:mod:`echelon.dynamics.recursion`).  With loops, ``dependent`` records the forces of
    the tree at the dependent coordinates instead of outputs, in terms of standard parameters.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pivots: Sequence[int],
        sums: bool = True,
        dependent: bool = False,
    ) -> None:
        columns = mechanism.columns
        strange = next((p for p in pivots if not 0 <= p < len(columns)), None)
        if strange is not None or len(set(pivots)) < len(pivots):
            raise InputError(
                f"pivots are different column numbers from 0 to {len(columns) - 1}, got {list(pivots)}"
            )
        self.mechanism, self.program, self._sums = mechanism, Program(), sums
        self._pivots, self._reframed = pivots, reframed(mechanism)
        self.parameters = {columns[p].name: columns[p].unit for p in pivots}
        inputs = {
            p: parameter_input(columns[p].name, standard=dependent) for p in pivots
        }
        self._values = {
            p: self.program.input(name, "symbol") for p, name in inputs.items()
        }
        self.dependent_motion = dependent_motion(mechanism, self.program)
        self.names = row_names(mechanism)
        self._dependent = dependent

    @property
    def state(self) -> tuple[str, ...]:
        """Inputs of the positions, then of the velocities; with loops, of independent velocity coordinates twice."""
        free = self.mechanism.independent_velocities
        positions = self.mechanism.positions if self.dependent_motion is None else free
        return (*(f"q[{n}]" for n in positions), *(f"qd[{n}]" for n in free))

    @property
    def arguments(self) -> Arguments:
        """Arguments of functions of these outputs."""
        return Arguments(
            self.mechanism, self.program, self.parameters, standard=self._dependent
        )

    # -- parts -------------------------------------------------------------------------------------------------

    def inertial(self, gravity: bool, *still: str) -> list[Scalar]:
        """Forces of the bodies' inertia, one for each row, with or without gravity.

        ``still`` names rates that are zero, ``"qd"`` or ``"qdd"``; with loops the independent ones.
        """
        return self._rows(
            efforts(self._inertias, self._motion(*still, gravity=gravity))
        )

    def forces(self) -> list[Scalar]:
        """Inertial forces with gravity, and all effects, one for each row."""
        return [a + b for a, b in zip(self.inertial(True), self.effects(), strict=True)]

    def weight(self) -> list[Scalar]:
        """Forces that hold the bodies' weight at rest, one for each row."""
        return self._rows(efforts_at_rest(self._inertias, self._motion("qd", "qdd")))

    def inertial_mass(self) -> dict[Index, Scalar]:
        """Derivatives of the inertial forces by the accelerations, by row and column."""
        return self._outer(
            mass_matrix(self._inertias, self._motion("qd", "qdd", gravity=False))
        )

    def inertial_derivatives(self) -> dict[Index, Scalar]:
        """Derivatives of the inertial forces by row and column; columns are positions, then velocities."""
        mechanism = self._reframed.mechanism
        if self.dependent_motion is not None:
            return self._derivatives_in_loops(
                self.dependent_motion, self.inertial(True)
            )
        if not all(coupling.is_linear for coupling in mechanism.couplings):
            return self._derivatives_on_sphere(self.inertial(True))
        inertias, state = self._inertias, self._motion()
        by_angle, by_rate = map(self._outer, effort_derivatives(inertias, state))
        found: dict[Index, Scalar] = {}
        for row in range(len(self._motions)):
            slopes: list[Scalar] = []
            place = 0
            for motion in mechanism.free_motions:
                own = [by_angle[row, place + k] for k in range(len(motion.velocities))]
                place += len(own)
                ball = motion.kind is MotionKind.BALL
                slopes += (
                    by_quaternion(state.recorder.coordinates[motion.name].position, own)
                    if ball
                    else own
                )
            slopes += [by_rate[row, k] for k in range(place)]
            found |= {(row, column): slope for column, slope in enumerate(slopes)}
        return found

    def effect_derivatives(self) -> dict[Index, Scalar]:
        """Derivatives of the forces of effects by the state."""
        forces, motion = self.effects(), self.dependent_motion
        if motion is None:
            return self._derivatives(forces)
        return self._derivatives_in_loops(motion, forces)

    def state_derivatives(self) -> dict[Index, Scalar]:
        """Derivatives of all forces by row and column; see :meth:`inertial_derivatives`."""
        entries = self.inertial_derivatives()
        for index, slope in self.effect_derivatives().items():
            entries[index] = entries[index] + slope
        return entries

    def masses(self) -> dict[Index, Scalar]:
        """Entries of the mass matrix, effects included, by row and column."""
        entries = self.inertial_mass()
        for index, slope in self.effect_inertia().items():
            entries[index] = entries[index] + slope
        return entries

    def _derivatives_in_loops(
        self, motion: DependentMotion, forces: Sequence[Scalar]
    ) -> dict[Index, Scalar]:
        """Derivatives of forces along the motions of the independent coordinates."""
        program, free = self.program, self.mechanism.independent_velocities
        along = [
            motion.position_rates(unit.freedoms) for unit in self._unit_motions.values()
        ]
        along += [{program.input(f"qd[{name}]").node: program.one} for name in free]
        inputs = list(dict.fromkeys(node for rates in along for node in rates))
        found = derivatives(
            program, [force.node for force in forces], inputs, reverse=True
        )
        slopes = {
            (row, inputs[k]): Scalar(program, node) for (row, k), node in found.items()
        }
        total: dict[Index, Scalar] = {}
        for k, rates in enumerate(along):
            for row in range(len(forces)):
                known = [n for n in rates if (row, n) in slopes]
                parts = (slopes[row, n] * rates[n] for n in known)
                total[row, k] = sum(parts, program.zero)
        return total

    def _derivatives(self, forces: Sequence[Scalar]) -> dict[Index, Scalar]:
        """Derivatives by the state, by row and column."""
        program = self.program
        inputs = [program.input(name).node for name in self.state]
        slopes = derivatives(program, [force.node for force in forces], inputs)
        return {index: Scalar(program, node) for index, node in slopes.items()}

    def _derivatives_on_sphere(self, forces: Sequence[Scalar]) -> dict[Index, Scalar]:
        """Derivatives of forces; those by a unit quaternion without their part across the unit sphere."""
        # forces that dependent joints pass on with ratios that vary need it; those of constant ratios come cheaper
        program, found = self.program, self._derivatives(forces)
        for motion in (m for m in self.mechanism.motions if m.kind is MotionKind.BALL):
            columns = [
                self.mechanism.positions.index(name) for name in motion.positions
            ]
            quaternion = [program.input(f"q[{name}]") for name in motion.positions]
            for row in range(len(forces)):
                own = [found.get((row, column), program.zero) for column in columns]
                along = sum(
                    (slope * part for slope, part in zip(own, quaternion, strict=True)),
                    program.zero,
                )
                for column, slope, part in zip(columns, own, quaternion, strict=True):
                    found[row, column] = slope - along * part
        return {
            (row, column): found.get((row, column), program.zero)
            for row in range(len(forces))
            for column in range(len(self.state))
        }

    def _outer(self, matrix: Mapping[tuple[str, str], Scalar]) -> dict[Index, Scalar]:
        """Entries between freedoms as entries between outputs and velocity coordinates."""
        found: dict[Index, Scalar] = {}
        zero = self.program.zero
        for column, unit in enumerate(self._unit_motions.values()):
            moved = unit.freedoms
            efforts: dict[str, Scalar] = {}
            for (effort, cause), entry in matrix.items():
                if cause in moved:
                    efforts[effort] = efforts.get(effort, zero) + entry * moved[cause]
            for row, motion in enumerate(self._motions):
                terms = (
                    efforts[n] * weight
                    for n, weight in motion.freedoms.items()
                    if n in efforts
                )
                found[row, column] = sum(terms, zero)
        return found

    def effects(self, *still: str) -> list[Scalar]:
        """Forces of the effects, one for each row; see :meth:`inertial`."""
        return self._total_effects(self._recorder(*still))

    def _total_effects(self, recorder: Recorder) -> list[Scalar]:
        totals = [self.program.zero for _ in self._motions]
        for _, row, force in self._effect_terms(recorder):
            totals[row] = totals[row] + force
        return totals

    def effect_inertia(self) -> dict[Index, Scalar]:
        """Derivatives of the effects' forces by the accelerations, by row and column."""
        program, total = self.program, dict[Index, Scalar]()
        inputs = [
            program.input(f"qdd[{name}]").node
            for name in self.mechanism.independent_velocities
        ]
        for name, row, force in self._effect_terms(self._recorder()):
            slopes = derivatives(program, [force.node], inputs)
            if _varies(program, slopes.values(), ("qd[", "qdd[", "i[")) or _varies(
                program, _signs(force), ("qdd[",)
            ):
                raise InputError(
                    f"effect '{name}' is not linear in the accelerations, with positions alone in the factor, so there "
                    "is no mass matrix M(q); leave its parameter out or use the inverse dynamics"
                )
            for (_, column), node in slopes.items():
                total[row, column] = total.get((row, column), program.zero) + Scalar(
                    program, node
                )
        return total

    def _effect_terms(self, state: Recorder) -> Iterator[tuple[str, int, Scalar]]:
        """Effects by name, and what they add to rows."""
        recorder = EffectRecorder(self.mechanism, state)
        first = len(self.mechanism.parameters) - len(self.mechanism.effects)
        for column, effect in enumerate(self.mechanism.effects, first):
            if column not in self._values:
                continue
            for side, at, force in recorder.forces(effect):
                for row, motion in enumerate(self._motions):
                    speeds = motion.at(side)
                    if at in speeds:
                        yield (
                            effect.parameter,
                            row,
                            self._values[column] * speeds[at] * force,
                        )

    # -- what they share -----------------------------------------------------------------------------------------

    def _given(self, *still: str) -> dict[str, Scalar]:
        """Values that stand in for inputs: zeros, and dependent velocities and accelerations."""
        if self.dependent_motion is not None:
            return self.dependent_motion.given(*still)
        return {
            f"{kind}[{name}]": self.program.zero
            for kind in still
            for name in self.mechanism.velocities
        }

    def _recorder(self, *still: str) -> Recorder:
        return Recorder(self.mechanism, self.program, self._given(*still))

    def _motion(self, *still: str, gravity: bool = True) -> ForwardPass:
        weight = self.program.one if gravity else self.program.zero
        return self._forward(self._given(*still), weight)

    def _forward(self, given: Mapping[str, Scalar], weight: Scalar) -> ForwardPass:
        """Motion of all frames, with values that stand in for inputs, and gravity times a factor."""
        recorder = Recorder(self._reframed.mechanism, self.program, given)
        probes = Probes(recorder.mechanism, recorder)
        base = scale(recorder.gravity(), weight)
        return ForwardPass(recorder, probes, base, sums=self._sums)

    def _rows(self, efforts: Mapping[str, Scalar]) -> list[Scalar]:
        """Outputs that read efforts of freedoms."""
        zero = self.program.zero
        return [
            sum((efforts[n] * speed for n, speed in m.freedoms.items()), zero)
            for m in self._motions
        ]

    @cached_property
    def _inertias(self) -> dict[int, Array]:
        """Pseudo-inertias of the bodies that have some."""
        return grouped_inertias(
            self._reframed,
            Recorder(self._reframed.mechanism, self.program),
            self._values,
        )

    @cached_property
    def _motions(self) -> list[VirtualMotion]:
        """The virtual motion whose power is the row, for each row."""
        mechanism, program = self.mechanism, self.program
        recorder = Recorder(mechanism, program)
        probes = Probes(mechanism, recorder)
        closed = self.dependent_motion
        if closed is not None and self._dependent:
            return [
                motion_of_joints(mechanism, recorder, {name: program.one})
                for name in closed.dependent
            ]
        solved = None if closed is None else closed.speeds
        return [
            virtual_motion(mechanism, probes, {o.name: program.one}, solved)
            for o in mechanism.outputs
        ]

    @cached_property
    def _unit_motions(self) -> dict[str, VirtualMotion]:
        """For every independent velocity coordinate, the motion of all coordinates while it alone has a velocity."""
        mechanism, closed = self.mechanism, self.dependent_motion
        recorder = Recorder(mechanism, self.program)
        found: dict[str, VirtualMotion] = {}
        for name in mechanism.independent_velocities:
            moved = {name: self.program.one}
            if closed is not None:
                moved |= closed.speeds(moved)
            found[name] = motion_of_joints(mechanism, recorder, moved)
        return found


def _signs(force: Scalar) -> list[int]:
    program = force.program
    return [
        node for node in program.needed([force.node]) if program.ops[node] == Op.SIGN
    ]


def _varies(program: Program, outputs: Iterable[int], kinds: tuple[str, ...]) -> bool:
    """Whether outputs depend on inputs of some kinds."""
    names = (
        program.inputs[n].name for n in program.needed(outputs) if n in program.inputs
    )
    return any(name.startswith(kinds) for name in names)


# -- frames and inertias that cost least -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Reframed:
    """A mechanism whose bodies have other frames, with the same motion and the same forces."""

    mechanism: Mechanism
    frames: dict[
        int, Placement
    ]  # a body's new frame in its old one, where it is another


def reframed(mechanism: Mechanism) -> Reframed:
    """Put bodies' frames directly behind their joints, and along rotation axes to where the joint has no offset."""
    # a mechanism with sensors between bodies stays as it is, because these are placed in its frames
    if mechanism.cuts:
        return Reframed(mechanism, {})
    frames: dict[int, Placement] = {}
    bodies = []
    for index, body in enumerate(mechanism.bodies):
        steps: tuple[Step, ...] = body.joint.steps
        if body.parent in frames:
            steps = merge((frames[body.parent].inverse(), *steps))
        steps, behind = _without_placement_behind(steps)
        offset = _offset(body.joint, steps)
        if any(offset):
            steps = merge((*steps[:-1], Placement(translation=offset), steps[-1]))
        frame = behind.inverse() @ Placement(translation=offset)
        if not frame.is_identity:
            frames[index] = frame
        bodies.append(replace(body, joint=replace(body.joint, steps=steps)))
    return Reframed(replace(mechanism, bodies=tuple(bodies)), frames)


def _without_placement_behind(
    steps: tuple[Step, ...],
) -> tuple[tuple[Step, ...], Placement]:
    """Steps up to the last motion, and the placement that follows it."""
    if len(steps) > 1 and isinstance(steps[-1], Placement):
        return steps[:-1], steps[-1]
    return steps, Placement()


def _offset(joint: Joint, steps: tuple[Step, ...]) -> Vector:
    """The shift that cancels a joint's offset along its axis, if the axis is along a coordinate axis of the parent."""
    if (
        len(steps) != 2
        or len(joint.motions) != 1
        or joint.motions[0].kind is not MotionKind.ROTATION
    ):
        return ORIGIN
    placed, motion = steps
    if not isinstance(placed, Placement) or motion is not joint.motions[0]:
        return ORIGIN
    axis = motion.axis
    direction = [row[axis] for row in placed.rotation]
    if sum(1 for entry in direction if entry) != 1:
        return ORIGIN
    along = Polynomial.sum(
        a * b for a, b in zip(direction, placed.translation, strict=True)
    )
    x, y, z = (-along if k == axis else Polynomial({}) for k in range(3))
    return (x, y, z)


# -- inertias ----------------------------------------------------------------------------------------------------------


def grouped_inertias(
    reframed: Reframed, recorder: Recorder, parameters: Mapping[int, Scalar]
) -> dict[int, Array]:
    """Pseudo-inertias [[Σ, h], [hᵀ, m]] about the new frames, of the bodies that have some.

    ``parameters`` belong to some columns of the regressor, about the original frames; all others are zero.
    """
    zero, mechanism = recorder.program.zero, reframed.mechanism
    found = {
        index: np.full((4, 4), zero, dtype=object)
        for index in range(GROUND, len(mechanism.bodies))
    }
    for index, first in mechanism.first_column.items():
        values = np.full((1, PER_BODY), zero, dtype=object)
        for offset, kind in enumerate(mechanism.bodies[index].carried):
            values[0, kind] = parameters.get(first + offset, zero)
        found[index] = pseudo_inertia(values)[0]
        if index in reframed.frames:
            found[index] = _before(
                recorder.placement(reframed.frames[index].inverse()), found[index]
            )
    cuts = {cut.body for cut in mechanism.cuts}
    for index in reversed(range(len(mechanism.bodies))):
        body = mechanism.bodies[index]
        axes = _movable(body.joint)
        if (
            axes
            and index not in cuts
            and not (body.parent == GROUND and GROUND in cuts)
        ):
            moved = np.full((4, 4), zero, dtype=object)
            moved[np.ix_(axes, axes)] = found[index][np.ix_(axes, axes)]
            found[index] = found[index] - moved
            for step in reversed(recorder.steps(index)):
                moved = _before(step, moved)
            found[body.parent] = found[body.parent] + moved
    return {
        i: pseudo
        for i, pseudo in found.items()
        if i != GROUND and not all(x.is_zero for x in pseudo.flat)
    }


def _movable(joint: Joint) -> list[int]:
    """Rows of a body's pseudo-inertia that may count to its parent."""
    if joint.is_fixed:
        return [0, 1, 2, MASS]
    if (
        len(joint.motions) > 1
        or joint.motions[0].kind is not MotionKind.ROTATION
        or joint.steps[-1] != joint.motions[0]
    ):
        return []
    return [joint.motions[0].axis, MASS]


def _before(step: Recorded, pseudo: Array) -> Array:
    """A pseudo-inertia about the frame before a placement; a rotation does not change what lies on its axis."""
    if step.freedoms or step.rotation is None or step.shift is None:
        return pseudo
    homogeneous = np.array(
        [(*row, shift) for row, shift in zip(step.rotation, step.shift, strict=True)]
    )
    homogeneous = np.vstack([homogeneous, [0, 0, 0, 1]])
    moved: Array = homogeneous @ pseudo @ homogeneous.T
    return moved
