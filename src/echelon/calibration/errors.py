"""Small errors of a robot's geometry, recorded as constant steps beside those of its joints.

Behind every elementary motion stand six errors of the frame that it moves (a product of exponentials in local frames),
or the errors of Denavit–Hartenberg parameters; joint offsets, gear ratios and compliances turn or shift along the
motion's own axis.  Where a body, or the base, carries several branches, six errors of the mount of each stand before
its first motion.  Recorded on the program of the robot's frames, errors are inputs like any others: derivatives by
them are those of the program, and no kinematics but that of :mod:`echelon.robot.steps` is needed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

from echelon.algebra import Program, Scalar, derivatives, exact_number
from echelon.dynamics import moved
from echelon.robot import (
    GROUND,
    Coordinates,
    Mat,
    Mechanism,
    Motion,
    MotionKind,
    RecordedStep,
    Recorder,
    Vec,
    X,
    Z,
    add,
    apply,
    dot,
    forward,
    identity,
    scale,
)
from echelon.shared import CalibrationErrors, InputError

Frame = tuple[Mat, Vec]

COMPONENTS = ("px", "py", "pz", "rx", "ry", "rz")
"""Errors of a frame: shifts along its axes, then turns about them."""

USUAL_SHIFT = 0.01
"""Standard deviation of a shift before anything is measured, m: ten times what a maker's tolerances allow."""
USUAL_TURN = 0.03
"""Standard deviation of a turn, rad: a zero position that is set by eye."""
USUAL_RATIO = 0.01
"""Standard deviation of a gear ratio, as a share of it."""
USUAL_COMPLIANCE = 1e-4
"""Standard deviation of a compliance, rad/(N·m) or m/N: a joint of 10 kN·m/rad."""


@dataclass(frozen=True)
class GeometryError:
    """One error of the geometry."""

    name: str  # ``px3``: of the frame that joint 3 moves, along its x axis
    unit: str
    usual: float  # standard deviation before anything is measured; infinite for a frame that nobody knows


class ErredRecorder(Recorder):
    """Records steps with errors between them.

    Attributes
    ----------
    errors : dict of str to GeometryError
        By the names of the program's inputs, in the order in which they were recorded.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        program: Program,
        kinds: Collection[CalibrationErrors],
    ) -> None:
        super().__init__(mechanism, program)
        self.kinds, self.errors = frozenset(kinds), dict[str, GeometryError]()
        self._labels = labels_of(mechanism)

    def steps(self, body: int) -> list[RecordedStep]:
        """Recorded steps from a body's parent to the body, with errors behind its motions."""
        joint = self.mechanism.bodies[body].joint
        found, mount = list[RecordedStep](), list[RecordedStep]()
        if "frames" in self.kinds and self._branches(body):
            for motion in joint.motions[:1]:
                mount += self.frame(f"{self._labels[motion.name]}b")
        elif "modified_dh" in self.kinds:
            for motion in joint.motions[:1]:
                self._check_table(motion, body)
                mount += self.frame(f"{self._labels[motion.name]}b", ("px", "rx"))
        for step in joint.steps:
            if isinstance(step, Motion):
                if step is joint.motions[0]:
                    found += mount
                found += [*self._motion(step), *self._behind(step, body)]
            else:
                found.append(self.placement(step))
        if "standard_dh" in self.kinds:
            for motion in joint.motions[:1]:
                self._check_table(motion, body)
                found += self.frame(f"{self._labels[motion.name]}a", ("px", "rx"))
        return found

    def _branches(self, body: int) -> bool:
        """Whether what carries the body carries others beside it, so that its mount is no error of theirs."""
        bodies = self.mechanism.bodies

        def carrier(index: int) -> int:
            parent = bodies[index].parent
            still = parent != GROUND and not bodies[parent].joint.motions
            return carrier(parent) if still else parent

        moving = [k for k, one in enumerate(bodies) if one.joint.motions]
        beside = [k for k in moving if carrier(k) == carrier(body)]
        return len(beside) > 1

    def frame(
        self,
        label: str,
        components: Sequence[str] = COMPONENTS,
        *,
        known: bool = True,
    ) -> list[RecordedStep]:
        """Steps of a frame's errors: shifts, then turns about x, y and z."""
        usual = (USUAL_SHIFT, USUAL_TURN) if known else (float("inf"),) * 2
        found: list[RecordedStep] = []
        for name in components:
            turns, axis = name[0] == "r", "xyz".index(name[1])
            amount = self.error(f"{name}{label}", "rad" if turns else "m", usual[turns])
            rotation = self.turn(axis, amount.cos(), amount.sin()) if turns else None
            shift = None if turns else scale(self._axis(axis, 1), amount)
            found.append(RecordedStep(rotation, shift))
        return found

    def error(self, name: str, unit: str, usual: float) -> Scalar:
        """The input of an error."""
        key = f"e[{name}]"
        self.errors.setdefault(key, GeometryError(name, unit, usual))
        return self.program.input(key)

    def _behind(self, motion: Motion, body: int) -> list[RecordedStep]:
        """Steps behind a motion, of the errors that are chosen."""
        label = self._labels[motion.name]
        found: list[RecordedStep] = []
        if "frames" in self.kinds:
            found += self.frame(label)
        if self.kinds & {"modified_dh", "standard_dh"}:
            self._check_table(motion, body)
            found += self.frame(label, ("pz", "rz"))
        if motion.kind is MotionKind.BALL or motion.name in self.mechanism.dependent:
            return found
        unit = "m" if motion.kind is MotionKind.TRANSLATION else "rad"
        usual = USUAL_SHIFT if unit == "m" else USUAL_TURN
        if "offsets" in self.kinds:
            amount = self.error(f"offset{label}", unit, usual)
            found += self._along(motion, amount)
        if "gears" in self.kinds:
            ratio = self.error(f"ratio{label}", "1", USUAL_RATIO)
            found += self._along(motion, ratio * self._travel(motion))
        if "stiffness" in self.kinds:
            per = "m/N" if unit == "m" else "rad/(N·m)"
            compliance = self.error(f"compliance{label}", per, USUAL_COMPLIANCE)
            found += self._along(motion, compliance * self.loads[motion.name])
        return found

    def _along(self, motion: Motion, amount: Scalar) -> list[RecordedStep]:
        """Steps of a motion that goes on by some amount and then stays."""
        still = replace(motion, name=f"{motion.name} beside")
        coordinates = Coordinates((amount,), self.zeros[:1], self.zeros[:1])
        self.coordinates = {**self.coordinates, still.name: coordinates}
        return [replace(step, freedoms=()) for step in self._motion(still)]

    def _travel(self, motion: Motion) -> Scalar:
        """The position that a wrong gear ratio multiplies.

        An angle is an input of its own here: it is algebraically independent of its sine and cosine, so that rows are
        rational in what varies.
        """
        if motion.kind is MotionKind.TRANSLATION:
            return self.coordinates[motion.name].position[0]
        return self.program.input(f"turned[{motion.name}]")

    def _check_table(self, motion: Motion, body: int) -> None:
        """Refuse frames that no table of Denavit–Hartenberg parameters has."""
        joint = self.mechanism.bodies[body].joint
        placements = [step for step in joint.steps if not isinstance(step, Motion)]
        along_x = all(not p.rotation[k][X] for p in placements for k in (1, 2))
        if len(joint.motions) > 1 or motion.axis != Z or not along_x:
            raise InputError(
                "its frames are not those of a table of Denavit–Hartenberg parameters; choose the errors  frames, or "
                "describe the robot by a table",
                element=f"joint '{joint.name}'",
            )

    @cached_property
    def loads(self) -> dict[str, Scalar]:
        """Force of gravity at every free coordinate, N·m or N, by the stated masses."""
        mechanism, program = self.mechanism, self.program
        if mechanism.closures:
            raise InputError(
                "Echelon does not model compliances of mechanisms with loops: leave out  stiffness"
            )
        plain = Recorder(mechanism, program)
        start: Frame = (identity(program), self.zeros)
        frames = forward(
            mechanism, start, lambda frame, k: reduce(moved, plain.steps(k), frame)
        )
        energy = program.zero
        for index, body in enumerate(mechanism.bodies):
            if body.massless:
                continue
            if body.inertial is None:
                raise InputError(
                    "its mass is unknown, so the load of gravity is unknown: state inertial values, or leave out  "
                    "stiffness",
                    element=f"body '{body.name}'",
                )
            mx, my, mz, mass = (
                program.constant(exact_number(value)) for value in body.inertial[-4:]
            )
            rotation, origin = frames[index]
            moment = add(apply(rotation, (mx, my, mz)), scale(origin, mass))
            energy = energy + dot(self.gravity(), moment)
        names = [m.name for m in mechanism.free_motions if len(m.positions) == 1]
        nodes = [self.coordinates[name].position[0].node for name in names]
        slopes = derivatives(program, [energy.node], nodes, reverse=True)
        return {
            name: Scalar(program, slopes[0, k]) if (0, k) in slopes else program.zero
            for k, name in enumerate(names)
        }


def labels_of(mechanism: Mechanism) -> dict[str, str]:
    """Endings of errors' names by motion: the label of its body, and a number where the body has several motions."""
    found = dict[str, str]()
    for index, body in enumerate(mechanism.bodies):
        for count, motion in enumerate(body.joint.motions, 1):
            several = len(body.joint.motions) > 1
            label = mechanism.joint_label(index)
            found[motion.name] = f"{label}_{count}" if several else label
    return found


def erred_frames(recorder: ErredRecorder, wanted: Collection[int]) -> dict[int, Frame]:
    """Record the frames of some bodies, and of those between them and the ground, with errors."""
    found: dict[int, Frame] = {
        GROUND: (identity(recorder.program), recorder.zeros),
    }
    needed = set(wanted)
    for index in reversed(range(len(recorder.mechanism.bodies))):
        if index in needed:
            needed.add(recorder.mechanism.bodies[index].parent)
    for index, body in enumerate(recorder.mechanism.bodies):
        if index in needed:
            found[index] = reduce(moved, recorder.steps(index), found[body.parent])
    return found
