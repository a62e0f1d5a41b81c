"""Recursive Newton–Euler with parameters: the effort of every freedom, sensors included.

Forward, every frame's angular velocity ω, angular acceleration ω̇ and acceleration a of its origin minus gravity.
Backward, the bodies' wrenches are summed up towards the ground, and each freedom on the way reads its effort.
Parameters that are structurally zero cost nothing, so with base parameters this is the customised Newton–Euler
algorithm of Khalil and Kleinfinger (1987).

Rotations about parallel axes that follow each other turn by the sum of their angles: what does not lie along the axis
goes between the frame before the first of them and the frame behind any of them in one turn.  That frame's vectors are
often simple, as behind a vertical first axis.  The sum's sine and cosine follow from those of its parts, which are
needed anyway, in six operations; a new pair costs as much as fifty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from echelon.dynamics.wrenches import Kinematics, Wrench, body_wrench
from echelon.inertia.spatial import Array
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.joint import Step as Described
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Scalar
from echelon.regressor.probes import Probes
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, dot, scale, transposed
from echelon.regressor.steps import Freedom, Recorder, Step, into_frame


@dataclass(frozen=True)
class Turn:
    """Rotations about parallel axes.

    Attributes
    ----------
    start : Kinematics
        Before the first of them.
    axis : int
        Coordinate axis of that frame.
    cosine, sine : Scalar
        Of the sum of the angles.
    rate : Scalar
        Sum of the rates.
    fixed : 3 × 3 of Scalar
        The frame's axes in the turned frame.
    count : int
        Number of rotations.
    """

    start: Kinematics
    axis: int
    cosine: Scalar
    sine: Scalar
    rate: Scalar
    fixed: Mat
    count: int = 1


@dataclass(frozen=True)
class Passage:
    """A step that was taken, and how the frames before and behind it move.

    Attributes
    ----------
    step : Step
    start, end : Kinematics
    turn : Turn, optional
        What a rotation has continued.
    rotation : 3 × 3 of Scalar, optional
        The turn's whole rotation.
    axis : int
        The rotation's coordinate axis.
    """

    step: Step
    start: Kinematics
    end: Kinematics
    turn: Turn | None = None
    rotation: Mat | None = None
    axis: int = 0


@dataclass(frozen=True)
class Place:
    """How a frame moves, and the turn that it has made last."""

    motion: Kinematics
    turn: Turn | None


class Recursion:
    """Newton–Euler on one mechanism.

    Parameters
    ----------
    mechanism : Mechanism
    recorder : Recorder
        Of the coordinates and their rates.
    probes : Probes
        The sensors.
    sums : bool
        Whether to use sums of angles.
    """

    def __init__(self, mechanism: Mechanism, recorder: Recorder, probes: Probes, sums: bool) -> None:
        self._mechanism, self._recorder, self._probes = mechanism, recorder, probes
        self._sums = sums and not probes.names  # a sensor reads all of the moment on its way
        self._passages: dict[int, list[Passage]] = {}

    def efforts(self, inertias: Mapping[int, Array], gravity: Vec) -> dict[str, Scalar]:
        """Generalised force of every freedom: velocity coordinates of the tree and sensors.

        Parameters
        ----------
        inertias : mapping of int to array of shape (4, 4) of Scalar
            Pseudo-inertias of the bodies that have some.
        gravity : 3 of Scalar
            In the base frame, m/s².
        """
        zeros, bodies = self._recorder.zeros, self._mechanism.bodies
        places = self._forward(gravity)
        wrenches: dict[int, Wrench] = dict.fromkeys(range(GROUND, len(bodies)), (zeros, zeros))
        for index, inertia in inertias.items():
            wrenches[index] = body_wrench(places[index].motion, inertia)
        down = Descent(zeros)
        for index in reversed(range(GROUND, len(bodies))):
            moment, force = down.carry(self._passages[index], wrenches[index])
            if index != GROUND:
                parent = bodies[index].parent
                wrenches[parent] = (add(wrenches[parent][0], moment), add(wrenches[parent][1], force))
        return down.efforts

    def passages(self, gravity: Vec) -> tuple[dict[int, list[Passage]], dict[int, Kinematics]]:
        """Steps from the parent's frame to every body's, those of sensors included, and the bodies' motion."""
        places = self._forward(gravity)
        return self._passages, {index: place.motion for index, place in places.items()}

    # -- forward ------------------------------------------------------------------------------------------------------

    def _forward(self, gravity: Vec) -> dict[int, Place]:
        gx, gy, gz = gravity
        zeros = self._recorder.zeros
        places = {GROUND: Place(Kinematics(zeros, zeros, (-gx, -gy, -gz)), None)}
        for index, body in enumerate(self._mechanism.bodies):
            place, passages = places[body.parent], []
            for described, step in zip(body.joint.steps, self._recorder.steps(index), strict=True):
                place, passage = self._advanced(place, described, step)
                passages.append(passage)
            before = self._sensed(places[body.parent], self._probes.steps(index, on_parent=True))
            behind = self._sensed(place, self._probes.steps(index, on_parent=False))
            places[index], self._passages[index] = place, [*before, *passages, *behind]
        self._passages[GROUND] = self._sensed(places[GROUND], self._probes.steps(GROUND, on_parent=False))
        return places

    def _sensed(self, place: Place, steps: Sequence[Step]) -> list[Passage]:
        """Steps into the frames of sensors and back, on which nothing moves."""
        found = []
        for step in steps:
            place, passage = self._advanced(place, None, step)
            found.append(passage)
        return found

    def _advanced(self, place: Place, described: Described | None, step: Step) -> tuple[Place, Passage]:
        start = now = place.motion
        turn = place.turn
        if step.shift is not None:
            now = Kinematics(now.angular, now.angular_rate, add(now.linear, apply(now.field, step.shift)))
        if isinstance(described, Motion) and described.kind is MotionKind.ROTATION:
            return self._turned(now, turn, described, step)
        if step.rotation is not None:
            angular, angular_rate, linear = (into_frame(step, v) for v in (now.angular, now.angular_rate, now.linear))
            now = Kinematics(angular, angular_rate, linear)
        before = now.angular
        for freedom in step.freedoms:
            now = _moved(now, before, freedom)
        if turn is not None and step.rotation is not None:
            turn = None if step.freedoms else replace(turn, fixed=_product(turn.fixed, step.rotation))
        return Place(now, turn), Passage(step, start, now)

    def _turned(self, now: Kinematics, turn: Turn | None, motion: Motion, step: Step) -> tuple[Place, Passage]:
        """A rotation about a coordinate axis."""
        (freedom,) = step.freedoms
        axis, sign = motion.axis, motion.sign
        angle, program = self._recorder.coordinates[motion.name].position[0], self._recorder.program
        c, s = program.cos(angle), program.sin(angle) * sign
        way = 0 if turn is None or not self._sums else _along(turn, axis)
        if turn is None or not way:
            turn = Turn(now, axis, c, s, sign * freedom.rate, _identity(self._recorder))
            way = 1
        else:
            s, rate = way * s, turn.rate + way * sign * freedom.rate
            c, s = turn.cosine * c - turn.sine * s, turn.sine * c + turn.cosine * s
            turn = replace(turn, cosine=c, sine=s, rate=rate, count=turn.count + 1)
        rotation = _product(self._recorder.turn(turn.axis, turn.cosine, turn.sine), turn.fixed)
        back, unit = transposed(rotation), _with(self._recorder.zeros, axis, program.one)
        angular, carried = apply(back, turn.start.angular), apply(back, turn.start.angular_rate)
        angular_rate = add(carried, cross(angular, scale(unit, way * turn.rate)))
        # points on the axis move as before the turn: where ω has no part along it, only ω̇ moves them
        along = (axis, cross(carried, unit)) if turn.start.angular[turn.axis].is_zero else None
        moved = Kinematics(
            _with(angular, axis, now.angular[axis] + sign * freedom.rate),
            _with(angular_rate, axis, now.angular_rate[axis] + sign * freedom.acceleration),
            into_frame(step, now.linear),
            along,
        )
        return Place(moved, turn), Passage(step, now, moved, turn, rotation, axis)


def _moved(now: Kinematics, before: Vec, freedom: Freedom) -> Kinematics:
    turning, sliding = scale(freedom.angular, freedom.rate), scale(freedom.linear, freedom.rate)
    coriolis = cross(before, sliding)
    rate = add(now.angular_rate, add(cross(before, turning), scale(freedom.angular, freedom.acceleration)))
    linear = add(now.linear, add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)))
    return Kinematics(add(now.angular, turning), rate, linear)


def _along(turn: Turn, axis: int) -> int:
    """1 or −1 if a coordinate axis of the frame lies along the turn's axis or its opposite, else 0."""
    column = [row[axis].number for row in turn.fixed]
    value = column.pop(turn.axis)
    return int(value) if value in (1, -1) and column == [0, 0] else 0  # type: ignore[arg-type]


def _with(v: Vec, axis: int, value: Scalar) -> Vec:
    x, y, z = (value if k == axis else v[k] for k in range(3))
    return (x, y, z)


def _product(a: Mat, b: Mat) -> Mat:
    columns = transposed(b)
    return transposed((apply(a, columns[0]), apply(a, columns[1]), apply(a, columns[2])))


def _identity(recorder: Recorder) -> Mat:
    zero, one = recorder.program.zero, recorder.program.one
    return ((one, zero, zero), (zero, one, zero), (zero, zero, one))


# -- backward ----------------------------------------------------------------------------------------------------------


class Descent:
    """Carries wrenches back, and reads efforts.

    Attributes
    ----------
    efforts : dict of str to Scalar
        Found on the way, by freedom.
    """

    def __init__(self, zeros: Vec) -> None:
        self.efforts: dict[str, Scalar] = {}
        self._zeros = zeros
        self._waiting: dict[Kinematics, Vec] = {}
        """Moments across the axis of a turn, by the frame before it and in its axes."""

    def carry(self, chain: Sequence[Passage], wrench: Wrench) -> Wrench:
        """The wrench seen from the frame before a chain of steps."""
        moment, force = wrench
        for passage in reversed(chain):
            step = passage.step
            for freedom in step.freedoms:
                self.efforts[freedom.name] = dot(freedom.angular, moment) + dot(freedom.linear, force)
            if step.rotation is not None:
                force = apply(step.rotation, force)
                moment = self._turned(passage, step.rotation, moment)
            if step.shift is not None:
                moment = add(moment, cross(step.shift, force))
        return moment, force

    def _turned(self, passage: Passage, rotation: Mat, moment: Vec) -> Vec:
        turn, zeros = passage.turn, self._zeros
        if turn is None or passage.rotation is None:
            return apply(rotation, moment)
        if turn.count == 1:
            return add(apply(rotation, moment), self._waiting.pop(turn.start, zeros))
        across = _with(moment, passage.axis, zeros[0])
        waiting = self._waiting.get(turn.start, zeros)
        self._waiting[turn.start] = add(waiting, apply(passage.rotation, across))
        return _with(zeros, passage.axis, moment[passage.axis])
