"""Recursive Newton–Euler with parameters: the effort of every freedom, sensors included.

Forward, every frame's angular velocity ω, angular acceleration ω̇ and acceleration a of its origin minus gravity.  The
matrix U = ω̂̇ + ω̂², the acceleration of the points of a body against its origin, is shared by what a body does to the
next one's origin (U·shift), to its own force (U·MS) and to its moment.  Backward, the bodies' wrenches are summed up
towards the ground, and each freedom on the way reads its effort.

Parameters that are structurally zero cost nothing.  So with base parameters in the place of the pivots and zero
elsewhere this is the customised Newton–Euler algorithm of Khalil and Kleinfinger (1987).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Scalar
from echelon.regressor.probes import Probes
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, dot, scale
from echelon.regressor.steps import Freedom, Recorder, Step, into_frame

Inertia = Sequence[Scalar]
"""XX … M of a body."""

Wrench = tuple[Vec, Vec]
"""Moment about the frame's origin and force."""


@dataclass(frozen=True)
class Kinematics:
    """Angular velocity, angular acceleration, and acceleration of the origin minus gravity, in a frame's own axes."""

    angular: Vec
    angular_rate: Vec
    linear: Vec

    @cached_property
    def field(self) -> Mat:
        """U = ω̂̇ + ω̂²: the point at r accelerates by U r against the origin."""
        (x, y, z), (dx, dy, dz) = self.angular, self.angular_rate
        xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
        return ((-(yy + zz), xy - dz, xz + dy), (xy + dz, -(xx + zz), yz - dx), (xz - dy, yz + dx, -(xx + yy)))


def efforts(
    mechanism: Mechanism, recorder: Recorder, probes: Probes, inertias: Mapping[int, Inertia], gravity: Vec
) -> dict[str, Scalar]:
    """Generalised force of every freedom: velocity coordinates of the tree and sensors.

    Parameters
    ----------
    mechanism : Mechanism
    recorder : Recorder
        Of the coordinates and their rates.
    probes : Probes
        The sensors.
    inertias : mapping of int to 10 of Scalar
        Standard parameters of the bodies that have some, about the bodies' frames.
    gravity : 3 of Scalar
        In the base frame, m/s².
    """
    steps = {index: recorder.steps(index) for index in range(len(mechanism.bodies))}
    motions = _forward(mechanism, recorder, steps, gravity)
    zeros = recorder.zeros
    wrenches: dict[int, Wrench] = dict.fromkeys((GROUND, *steps), (zeros, zeros))
    for index, inertia in inertias.items():
        wrenches[index] = body_wrench(motions[index], inertia)
    found: dict[str, Scalar] = {}
    for index in reversed(range(len(mechanism.bodies))):
        chain = [*probes.steps(index, True), *steps[index], *probes.steps(index, False)]
        moment, force = _carried(chain, wrenches[index], found)
        parent = mechanism.bodies[index].parent
        wrenches[parent] = (add(wrenches[parent][0], moment), add(wrenches[parent][1], force))
    _carried(probes.steps(GROUND, on_parent=False), wrenches[GROUND], found)
    return found


def _forward(
    mechanism: Mechanism, recorder: Recorder, steps: Mapping[int, Sequence[Step]], gravity: Vec
) -> dict[int, Kinematics]:
    gx, gy, gz = gravity
    known = {GROUND: Kinematics(recorder.zeros, recorder.zeros, (-gx, -gy, -gz))}
    for index, body in enumerate(mechanism.bodies):
        current = known[body.parent]
        for step in steps[index]:
            current = _advanced(current, step)
        known[index] = current
    return known


def _advanced(now: Kinematics, step: Step) -> Kinematics:
    if step.shift is not None:
        now = Kinematics(now.angular, now.angular_rate, add(now.linear, apply(now.field, step.shift)))
    if step.rotation is not None:
        turned = (into_frame(step, v) for v in (now.angular, now.angular_rate, now.linear))
        now = Kinematics(*turned)
    before = now.angular
    for freedom in step.freedoms:
        now = _moved(now, before, freedom)
    return now


def _moved(now: Kinematics, before: Vec, freedom: Freedom) -> Kinematics:
    turning, sliding = scale(freedom.angular, freedom.rate), scale(freedom.linear, freedom.rate)
    coriolis = cross(before, sliding)
    rate = add(now.angular_rate, add(cross(before, turning), scale(freedom.angular, freedom.acceleration)))
    linear = add(now.linear, add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)))
    return Kinematics(add(now.angular, turning), rate, linear)


def body_wrench(at: Kinematics, inertia: Inertia) -> Wrench:
    """Wrench about the body's origin that its motion needs: J ω̇ + ω × J ω + MS × a, and M a + U MS."""
    first, mass = (inertia[6], inertia[7], inertia[8]), inertia[9]
    force = add(apply(at.field, first), scale(at.linear, mass))
    return add(_moment_of_inertia(at, inertia), cross(first, at.linear)), force


def _moment_of_inertia(at: Kinematics, inertia: Inertia) -> Vec:
    """J ω̇ + ω × J ω with the products that U holds."""
    xx, xy, xz, yy, yz, zz = inertia[:6]
    (x, y, z), (dx, dy, dz), u = at.angular, at.angular_rate, at.field
    return (
        xx * dx + (zz - yy) * (y * z) + xz * u[1][0] - xy * u[2][0] + yz * (u[1][1] - u[2][2]),
        yy * dy + (xx - zz) * (x * z) + xy * u[2][1] - yz * u[0][1] + xz * (u[2][2] - u[0][0]),
        zz * dz + (yy - xx) * (x * y) + yz * u[0][2] - xz * u[1][2] + xy * (u[0][0] - u[1][1]),
    )


def _carried(chain: Sequence[Step], wrench: Wrench, found: dict[str, Scalar]) -> Wrench:
    """A wrench seen from the frame before a chain of steps; the freedoms on the way read their efforts."""
    moment, force = wrench
    for step in reversed(chain):
        for freedom in step.freedoms:
            found[freedom.name] = dot(freedom.angular, moment) + dot(freedom.linear, force)
        if step.rotation is not None:
            moment, force = apply(step.rotation, moment), apply(step.rotation, force)
        if step.shift is not None:
            moment = add(moment, cross(step.shift, force))
    return moment, force
