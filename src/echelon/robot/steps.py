"""Recorded steps: a mechanism's placements and motions as scalars on one program, and vectors of such scalars.

Each step turns and shifts the current frame.  A :class:`RecordedStep` holds the recorded rotation and shift and, for
a motion,
its rate and acceleration, so that the recursions need no case distinction by joint type.  Sensors are freedoms that
never move, effects are forces, and an output stands for a virtual motion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from echelon.algebra import Program, Scalar, heaviside, record_expression
from echelon.robot.effect import Action, Effect, Side
from echelon.robot.joint import (
    GROUND,
    Motion,
    MotionKind,
    Placement,
    transpose,
    turned,
)
from echelon.robot.mechanism import Cut, Mechanism
from echelon.robot.term import read_term
from echelon.shared import Floats, InputError

Vec = tuple[Scalar, Scalar, Scalar]
Mat = tuple[Vec, Vec, Vec]


def add(a: Vec, b: Vec) -> Vec:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def scale(a: Vec, factor: Scalar) -> Vec:
    """factor · a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def dot(a: Vec, b: Vec) -> Scalar:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec, b: Vec) -> Vec:
    """a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def apply(matrix: Mat, v: Vec) -> Vec:
    """Matrix times vector."""
    return (dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v))


def product(left: Mat, right: Mat) -> Mat:
    """Matrix product."""
    columns = transpose(right)
    return transpose(
        (apply(left, columns[0]), apply(left, columns[1]), apply(left, columns[2]))
    )


def identity(program: Program) -> Mat:
    """The unit matrix."""
    zero, one = program.zero, program.one
    return ((one, zero, zero), (zero, one, zero), (zero, zero, one))


def quaternion_times(
    quaternion: Iterable[Any], vector: Iterable[Any]
) -> tuple[Any, Any, Any, Any]:
    """The product of a quaternion (w, x, y, z) and a vector, of any numbers; half of it with a velocity is its rate."""
    (w, x, y, z), (a, b, c) = quaternion, vector
    return (
        -x * a - y * b - z * c,
        w * a + y * c - z * b,
        w * b + z * a - x * c,
        w * c + x * b - y * a,
    )


T = TypeVar("T")


@dataclass(frozen=True)
class Freedom:
    """One velocity coordinate of a step."""

    name: str  # velocity coordinate
    angular: Vec  # angular velocity that a unit of it causes, in the moved frame's axes
    linear: Vec  # linear velocity that a unit of it causes, in the same axes
    rate: Scalar  # its value
    acceleration: Scalar


@dataclass(frozen=True)
class RecordedStep:
    """A frame change: the new frame has axes ``rotation`` and origin ``shift`` in the old one (None: unchanged)."""

    rotation: Mat | None
    shift: Vec | None
    freedoms: tuple[Freedom, ...] = ()


@dataclass(frozen=True)
class Coordinates:
    """The recorded coordinates of one motion."""

    position: tuple[Scalar, ...]
    rate: tuple[Scalar, ...]
    acceleration: tuple[Scalar, ...]


class Recorder:
    """Writes a mechanism's coordinates and steps onto a program.

    ``given`` holds values that stand in for inputs, by the input's name: ``{"qdd[j1]": program.zero}``.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        program: Program,
        given: Mapping[str, Scalar] | None = None,
    ) -> None:
        self.mechanism, self.program, self._given = mechanism, program, given or {}
        self.zeros: Vec = (program.zero, program.zero, program.zero)
        self.slopes: dict[
            str, dict[str, Scalar]
        ] = {}  # of dependent coordinates, by those that they follow
        self.coordinates = self._record_coordinates()

    def steps(self, body: int) -> list[RecordedStep]:
        """Recorded steps from a body's parent to the body."""
        recorded: list[RecordedStep] = []
        for step in self.mechanism.bodies[body].joint.steps:
            if isinstance(step, Placement):
                recorded.append(self.placement(step))
            else:
                recorded.extend(self._motion(step))
        return recorded

    def gravity(self) -> Vec:
        """Gravity in the base frame."""
        if self.mechanism.gravity is None:
            return self.zeros
        x, y, z = (self.program.polynomial(g) for g in self.mechanism.gravity)
        return (x, y, z)

    def moved_positions(
        self, speeds: Mapping[str, Scalar]
    ) -> Iterator[tuple[tuple[Scalar, ...], list[Scalar]]]:
        """The positions of every motion and their rates; a quaternion's is half its product with the velocity."""
        for motion in self.mechanism.free_motions:
            position = self.coordinates[motion.name].position
            rate = [speeds.get(name, self.program.zero) for name in motion.velocities]
            if motion.kind is MotionKind.BALL:
                rate = [value / 2 for value in quaternion_times(position, rate)]
            yield position, rate

    def position_rates(self, speeds: Mapping[str, Scalar]) -> dict[int, Scalar]:
        """Rates of the positions' inputs, by node, from those of velocity coordinates; zero where absent."""
        pairs = (
            zip(position, change, strict=True)
            for position, change in self.moved_positions(speeds)
        )
        return {
            position.node: rate
            for pair in pairs
            for position, rate in pair
            if not rate.is_zero
        }

    # -- coordinates ---------------------------------------------------------------------------------------------

    def _record_coordinates(self) -> Mapping[str, Coordinates]:
        dependent = self.mechanism.dependent
        known = {
            m.name: self._inputs(m)
            for m in self.mechanism.motions
            if m.name not in dependent
        }
        for coupling in self.mechanism.couplings:
            position = rate = acceleration = self.program.zero
            slopes = self.slopes[coupling.coordinate] = {}
            for name, function in coupling.terms:
                at = known[name]
                value, slope, curvature = function.derivatives(
                    at.position[0], self.program.polynomial, heaviside
                )
                slopes[name] = slope
                position, rate = position + value, rate + at.rate[0] * slope
                acceleration = (
                    acceleration
                    + at.acceleration[0] * slope
                    + at.rate[0] * at.rate[0] * curvature
                )
            known[coupling.coordinate] = Coordinates(
                (position,), (rate,), (acceleration,)
            )
        return known

    def _inputs(self, motion: Motion) -> Coordinates:
        position = tuple(self._input(f"q[{n}]") for n in motion.positions)
        if motion.kind is MotionKind.BALL:
            self.program.unit_groups.append(tuple(x.node for x in position))
        return Coordinates(
            position,
            tuple(self._input(f"qd[{n}]") for n in motion.velocities),
            tuple(self._input(f"qdd[{n}]") for n in motion.velocities),
        )

    def _input(self, name: str) -> Scalar:
        value = self._given.get(name)
        return self.program.input(name) if value is None else value

    # -- steps ---------------------------------------------------------------------------------------------------

    def placement(self, placement: Placement) -> RecordedStep:
        """A constant change of frame."""
        record = self.program.polynomial
        rows = [tuple(record(entry) for entry in row) for row in placement.rotation]
        shift = tuple(record(entry) for entry in placement.translation)
        return RecordedStep((rows[0], rows[1], rows[2]), shift)  # type: ignore[arg-type]

    def _motion(self, motion: Motion) -> list[RecordedStep]:
        coordinates = self.coordinates[motion.name]
        if motion.kind is MotionKind.BALL:
            return [self._ball(motion, coordinates)]
        axis = self._axis(motion.axis, motion.sign)
        rate, acceleration = coordinates.rate[0], coordinates.acceleration[0]
        position = coordinates.position[0]
        if motion.kind is MotionKind.TRANSLATION:
            shift = scale(axis, position)
            return [
                RecordedStep(
                    None,
                    shift,
                    (Freedom(motion.name, self.zeros, axis, rate, acceleration),),
                )
            ]
        turned = self.turn(motion.axis, position.cos(), position.sin() * motion.sign)
        if motion.kind is MotionKind.ROTATION:
            return [
                RecordedStep(
                    turned,
                    None,
                    (Freedom(motion.name, axis, self.zeros, rate, acceleration),),
                )
            ]
        travel = scale(axis, self.program.polynomial(motion.pitch))
        # a screw shifts along the axis it turns about, so both directions are the same in old and new axes
        return [
            RecordedStep(
                turned,
                scale(travel, position),
                (Freedom(motion.name, axis, travel, rate, acceleration),),
            )
        ]

    def _axis(self, axis: int, sign: int) -> Vec:
        unit = self.program.constant(sign)
        x, y, z = (unit if k == axis else self.program.zero for k in range(3))
        return (x, y, z)

    def turn(self, axis: int, c: Scalar, s: Scalar) -> Mat:
        """Axes of a frame that is turned about a coordinate axis, by the angle's cosine and sine."""
        return turned(identity(self.program), axis, c, s)

    def _ball(self, motion: Motion, coordinates: Coordinates) -> RecordedStep:
        w, x, y, z = coordinates.position
        two = self.program.constant(2)
        xx, yy, zz = two * x * x, two * y * y, two * z * z
        xy = two * x * y
        xz = two * x * z
        yz = two * y * z
        wx = two * w * x
        wy = two * w * y
        wz = two * w * z
        one = self.program.one
        rotation: Mat = (
            (one - yy - zz, xy - wz, xz + wy),
            (xy + wz, one - xx - zz, yz - wx),
            (xz - wy, yz + wx, one - xx - yy),
        )
        freedoms = tuple(
            Freedom(
                name,
                self._axis(k, 1),
                self.zeros,
                coordinates.rate[k],
                coordinates.acceleration[k],
            )
            for k, name in enumerate(motion.velocities)
        )
        return RecordedStep(rotation, None, freedoms)


def forward(
    mechanism: Mechanism, ground: T, behind: Callable[[T, int], T]
) -> dict[int, T]:
    """A quantity of every body's frame, each from that of its parent: ``behind(of parent, body)``."""
    found = {GROUND: ground}
    for index, body in enumerate(mechanism.bodies):
        found[index] = behind(found[body.parent], index)
    return found


def backward(
    mechanism: Mechanism,
    own: dict[int, T],
    before: Callable[[T, int], T],
    plus: Callable[[T, T], T],
) -> None:
    """Sums of a quantity over all that is behind each body, from the tips to the ground, in place of each body's own.

    ``before(sum, body)`` is the sum as seen from the parent's frame.
    """
    for index in reversed(range(GROUND, len(mechanism.bodies))):
        moved = before(own[index], index)
        if index != GROUND:
            parent = mechanism.bodies[index].parent
            own[parent] = plus(own[parent], moved)


def into_frame(step: RecordedStep, v: Vec) -> Vec:
    """A vector's components after the step's rotation."""
    if step.rotation is None:
        return v
    return apply(transpose(step.rotation), v)


def cut_names(mechanism: Mechanism) -> dict[Cut, str]:
    """Names of the freedoms of sensors, which no coordinate can have."""
    return {cut: f"cut*{number}" for number, cut in enumerate(mechanism.cuts)}


class Probes:
    """The force and torque sensors of a mechanism, recorded as freedoms that never move."""

    def __init__(self, mechanism: Mechanism, recorder: Recorder) -> None:
        self.recorder, self.names = recorder, cut_names(mechanism)

    def steps(self, body: int, on_parent: bool) -> list[RecordedStep]:
        """Steps of the cuts at a body: into the sensor's frame, the freedom, and back."""
        recorded: list[RecordedStep] = []
        for cut, name in self.names.items():
            if cut.body == body and cut.on_parent == on_parent:
                there, back = map(
                    self.recorder.placement, (cut.frame, cut.frame.inverse())
                )
                recorded += [there, self._freedom(cut, name), back]
        return recorded

    def _freedom(self, cut: Cut, name: str) -> RecordedStep:
        program, zeros = self.recorder.program, self.recorder.zeros
        x, y, z = (program.one if k == cut.axis else program.zero for k in range(3))
        direction = (x, y, z)
        angular, linear = (direction, zeros) if cut.angular else (zeros, direction)
        return RecordedStep(
            None, None, (Freedom(name, angular, linear, program.zero, program.zero),)
        )


@dataclass(frozen=True)
class VirtualMotion:
    """Virtual velocities that belong to one output, or to all of them together."""

    freedoms: Mapping[
        str, Scalar
    ]  # of joint coordinates (dependent ones included) and cuts; absent where zero
    drives: Mapping[str, Scalar]  # of actuators, whose effects the output sees
    # weights of measured values by the output that they are of, in whose effects the output shares
    measured: Mapping[str, Scalar]
    # those of freedoms that the outputs determine; in a mechanism with loops the others follow, unless it is empty
    chosen: Mapping[str, Scalar]

    def at(self, side: Side) -> Mapping[str, Scalar]:
        """Velocities by the names of places where effects act."""
        match side:
            case Side.JOINT:
                return self.freedoms
            case Side.ACTUATOR:
                return self.drives
            case Side.OUTPUT:
                return self.measured


Speeds = Callable[[Mapping[str, Scalar]], Mapping[str, Scalar]]
"""Virtual velocities of the coordinates that depend on given ones through loops."""


def virtual_motion(
    mechanism: Mechanism,
    probes: Probes,
    speeds: Mapping[str, Scalar],
    solved: Speeds | None = None,
) -> VirtualMotion:
    """The virtual motion whose power is Σ speed · output."""
    program = probes.recorder.program
    freedoms: dict[str, Scalar] = {}
    drives: dict[str, Scalar] = {}
    measured: dict[str, Scalar] = {}
    if mechanism.closures:
        freedoms.update(dict.fromkeys(mechanism.independent_velocities, program.zero))

    def increase(target: dict[str, Scalar], name: str, speed: Scalar) -> None:
        target[name] = target[name] + speed if name in target else speed

    for output in mechanism.outputs:
        if output.name not in speeds:
            continue
        increase(measured, output.reads or output.name, speeds[output.name])
        for cut, weight in output.cuts:
            increase(
                freedoms,
                probes.names[cut],
                speeds[output.name] * program.polynomial(weight),
            )
        for force, weight in output.forces:
            speed = speeds[output.name] * program.polynomial(weight)
            if force.side is Side.JOINT:
                increase(freedoms, force.at, speed)
                continue
            increase(drives, force.at, speed)
            for joint, inverse in mechanism.transmission.inverse[force.at].items():
                factor = program.polynomial(inverse.numerator) / program.polynomial(
                    inverse.denominator
                )
                increase(freedoms, joint, speed * factor)
    chosen = dict(freedoms)
    names = mechanism.dependent_velocities
    freedoms.update(
        {n: program.input(f"v[{n}]") for n in names}
        if solved is None
        else solved(chosen)
    )
    complete = _coupled(probes.recorder, freedoms)
    return VirtualMotion(complete, drives, measured, chosen)


def measured_motion(
    mechanism: Mechanism,
    probes: Probes,
    dependent: Mapping[str, Scalar] | None = None,
) -> VirtualMotion:
    """Any virtual motion that the outputs see: its speeds are inputs ``u[...]`` of the outputs.

    Those of outputs that depend on others, by which unknown forces at contacts do no work, are given.
    With loops, where the outputs are all forces, it is :func:`any_motion`, which needs nothing to be solved.
    """
    if mechanism.closures and mechanism.measures_every_force:
        return any_motion(mechanism, probes.recorder)
    program = probes.recorder.program
    known = dependent or {}
    speeds = {
        output.name: known[output.name]
        if output.name in known
        else program.input(f"u[{output.name}]")
        for output in mechanism.outputs
    }
    return virtual_motion(mechanism, probes, speeds)


def any_motion(
    mechanism: Mechanism, recorder: Recorder, kind: str = "v"
) -> VirtualMotion:
    """A virtual motion whose velocities, of all coordinates that no coupling makes dependent, are inputs ``v[...]``."""
    program = recorder.program
    freedoms = {name: program.input(f"{kind}[{name}]") for name in mechanism.velocities}
    return motion_of_joints(mechanism, recorder, freedoms)


def motion_of_joints(
    mechanism: Mechanism, recorder: Recorder, freedoms: dict[str, Scalar]
) -> VirtualMotion:
    """The virtual motion in which some independent coordinates have given velocities, and the drives follow."""
    program = recorder.program
    drives = {}
    for actuator in mechanism.transmission.actuators:
        moving = [(n, ratio) for n, ratio in actuator.terms if n in freedoms]
        if moving:
            parts = (freedoms[n] * program.polynomial(ratio) for n, ratio in moving)
            drives[actuator.name] = sum(parts, program.zero)
    return VirtualMotion(_coupled(recorder, freedoms), drives, {}, {})


def _coupled(recorder: Recorder, freedoms: dict[str, Scalar]) -> dict[str, Scalar]:
    """Virtual velocities completed by those of dependent coordinates."""
    complete = dict(freedoms)
    for coordinate, slopes in recorder.slopes.items():
        moved = [
            freedoms[name] * slope for name, slope in slopes.items() if name in freedoms
        ]
        if moved:
            complete[coordinate] = sum(
                moved, complete.get(coordinate, recorder.program.zero)
            )
    return complete


class EffectRecorder:
    """Writes the terms of effects onto a program."""

    def __init__(self, mechanism: Mechanism, recorder: Recorder) -> None:
        self.mechanism, self.recorder = mechanism, recorder
        self._states = self._all_states() if mechanism.effects else {}

    def forces(self, effect: Effect) -> list[tuple[Side, str, Scalar]]:
        """Side, place there, and force per unit of the parameter."""
        return [(a.side, a.at, self._record(effect, a)) for a in effect.actions]

    def _record(self, effect: Effect, action: Action) -> Scalar:
        program = self.recorder.program
        names: dict[str, Scalar] = dict(self._states)
        for kind in ("q", "qd", "qdd"):
            if f"{kind}[{action.at}]" in names:
                names[kind] = names[f"{kind}[{action.at}]"]
        names["i"] = program.input(f"i[{action.at}]")
        for quantity in read_term(action.term).quantities:
            if quantity.name == "i" and quantity.at is not None:
                names[f"i[{quantity.at}]"] = program.input(f"i[{quantity.at}]")
        for name in self.mechanism.symbols:
            names.setdefault(name, program.input(name, "symbol"))
        return record_expression(
            action.term,
            names,
            f"effect '{effect.parameter}'",
            program,
            rounded_phases=True,
        )

    def _all_states(self) -> dict[str, Scalar]:
        """Positions, velocities and accelerations of all coordinates and actuators, by the names used in terms."""
        names: dict[str, Scalar] = {}
        recorder = self.recorder
        for motion in self.mechanism.motions:
            at = recorder.coordinates[motion.name]
            for name, rate, acceleration in zip(
                motion.velocities, at.rate, at.acceleration, strict=True
            ):
                names |= {f"qd[{name}]": rate, f"qdd[{name}]": acceleration}
            if (
                len(at.position) == 1
            ):  # a free rotation has no coordinate that a term could use
                names[f"q[{motion.name}]"] = at.position[0]
        for actuator in self.mechanism.transmission.actuators:
            terms = [
                (recorder.coordinates.get(n), recorder.program.polynomial(r))
                for n, r in actuator.terms
            ]
            if any(c is None or len(c.position) != 1 for c, _ in terms):
                continue
            zero = recorder.program.zero
            known = [(c, r) for c, r in terms if c is not None]
            names[f"q[{actuator.name}]"] = sum(
                (c.position[0] * r for c, r in known), zero
            )
            names[f"qd[{actuator.name}]"] = sum((c.rate[0] * r for c, r in known), zero)
            names[f"qdd[{actuator.name}]"] = sum(
                (c.acceleration[0] * r for c, r in known), zero
            )
        return names


def state_inputs(
    mechanism: Mechanism, q: Floats, qd: Floats, qdd: Floats
) -> dict[str, Floats]:
    """Values of the inputs of states of all coordinates, by name."""
    velocities, found = mechanism.velocities, dict[str, Floats]()
    for kind, array, names in (
        ("q", q, mechanism.positions),
        ("qd", qd, velocities),
        ("qdd", qdd, velocities),
    ):
        if array.ndim != 2 or array.shape[1] != len(names):
            raise InputError(
                f"{kind} has shape {array.shape}; expected (samples, {len(names)}): {', '.join(names)}"
            )
        found |= {f"{kind}[{name}]": array[:, k] for k, name in enumerate(names)}
    return found
