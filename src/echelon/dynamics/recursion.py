"""Recursive Newton–Euler with parameters: the effort of every freedom, sensors included.

Forward, every frame's angular velocity ω, angular acceleration ω̇ and acceleration a of its origin minus gravity.
Backward, the bodies' wrenches are summed up towards the ground, and each freedom on the way reads its effort.
Parameters that are structurally zero cost nothing, so with base parameters this is the customised Newton–Euler
algorithm of Khalil and Kleinfinger (1987).

Rotations about parallel axes that follow each other turn by the sum of their angles: what does not lie along the axis
goes between the frame before the first of them and the frame behind any of them in one turn.  That frame's vectors are
often simple, as behind a vertical first axis.  The sum's sine and cosine follow from those of its parts, which are
needed anyway, in six operations; a new pair costs as much as fifty.

With the pseudo-inertia [[Σ, h], [hᵀ, m]] of a body and U = ω̂̇ + ω̂², the force that its motion needs is m a + U h and the
moment h × a + vee(U Σ).  The entries of U are at hand from the motion of the next body's origin.  What vanishes or is
uniform is used: each component of the moment has a pair of terms that can be written with Σ and U, or with the inertia
tensor, ω̇ and ω ωᵀ.

This recursion has nothing in common with the one that certificates rest on (:mod:`echelon.dynamics.linear_forms`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from echelon.algebra import Scalar
from echelon.robot import (
    GROUND,
    Array,
    Freedom,
    Mat,
    Motion,
    MotionKind,
    Probes,
    RecordedStep,
    Recorder,
    Vec,
    add,
    apply,
    backward,
    cross,
    dot,
    forward,
    identity,
    into_frame,
    product,
    scale,
    transpose,
)
from echelon.robot import Step as Described

MASS = 3  # row of the mass and of first moments in a pseudo-inertia

Wrench = tuple[Vec, Vec]  # moment about the frame's origin and force


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Motion of a frame, in its own axes; another frame is another object, even if it moves alike."""

    angular: Vec  # angular velocity and acceleration
    angular_rate: Vec  # angular velocity and acceleration
    linear: Vec  # acceleration of the origin, minus gravity
    # an axis, and what the field has across it in the axis's column, where a simpler form than the sum is known
    along: tuple[int, Vec] | None = None

    @cached_property
    def products(self) -> Mat:
        """ω ωᵀ."""
        x, y, z = self.angular
        return (scale(self.angular, x), scale(self.angular, y), scale(self.angular, z))

    @cached_property
    def field(self) -> Mat:
        """U = ω̂̇ + ω̂²: the point at r accelerates by U r against the origin."""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = self.products
        dx, dy, dz = self.angular_rate
        rows = [
            [-(yy + zz), xy - dz, xz + dy],
            [xy + dz, -(xx + zz), yz - dx],
            [xz - dy, yz + dx, -(xx + yy)],
        ]
        if self.along is not None:
            axis, column = self.along
            for k in range(3):
                rows[k][axis] = rows[k][axis] if k == axis else column[k]
        (a, b, c), (d, e, f), (g, h, i) = rows
        return ((a, b, c), (d, e, f), (g, h, i))


@dataclass(frozen=True)
class ParallelRotations:
    """Rotations about parallel axes."""

    start: FrameMotion  # before the first of them
    axis: int  # coordinate axis of that frame
    cosine: Scalar  # of the sum of the angles
    sine: Scalar
    rate: Scalar  # sum of the rates
    fixed: Mat  # the current frame's axes in the frame behind the rotations
    count: int = 1  # number of rotations


@dataclass(frozen=True)
class Transform:
    """A step that was taken, and how the frames before and behind it move."""

    step: RecordedStep
    start: FrameMotion
    end: FrameMotion
    parallel: ParallelRotations | None = None  # those that a rotation has continued
    rotation: Mat | None = None  # of all of them together
    axis: int = 0  # the rotation's coordinate axis


# -- forward -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _MovingFrame:
    """Motion of a frame, and the parallel rotations just before it."""

    motion: FrameMotion
    parallel: ParallelRotations | None


class ForwardPass:
    """The motion of all frames, those of sensors included.

    Rotations about parallel axes are taken together if ``sums`` says so; gravity is that of the base frame, m/s².
    """

    def __init__(
        self, recorder: Recorder, probes: Probes, gravity: Vec, *, sums: bool = False
    ) -> None:
        self.recorder = recorder
        self.mechanism = recorder.mechanism
        self._probes = probes
        self._sums = (
            sums and not probes.names
        )  # a sensor reads all of the moment on its way
        self.transforms: dict[
            int, list[Transform]
        ] = {}  # from the parent's frame to every body's
        gx, gy, gz = gravity
        ground = _MovingFrame(
            FrameMotion(recorder.zeros, recorder.zeros, (-gx, -gy, -gz)), None
        )
        frames = forward(self.mechanism, ground, self._body)
        self.transforms[GROUND] = self._sensed(
            ground, probes.steps(GROUND, on_parent=False)
        )
        self.motions = {index: frame.motion for index, frame in frames.items()}

    def _body(self, parent: _MovingFrame, index: int) -> _MovingFrame:
        """The frame of a body, from that of its parent."""
        frame, own = parent, []
        described = self.mechanism.bodies[index].joint.steps
        for part, step in zip(described, self.recorder.steps(index), strict=True):
            frame, transform = self._advanced(frame, part, step)
            own.append(transform)
        before = self._sensed(parent, self._probes.steps(index, on_parent=True))
        behind = self._sensed(frame, self._probes.steps(index, on_parent=False))
        self.transforms[index] = [*before, *own, *behind]
        return frame

    def _sensed(
        self, frame: _MovingFrame, steps: Sequence[RecordedStep]
    ) -> list[Transform]:
        """Steps into the frames of sensors and back, on which nothing moves."""
        found = []
        for step in steps:
            frame, transform = self._advanced(frame, None, step)
            found.append(transform)
        return found

    def _advanced(
        self, frame: _MovingFrame, described: Described | None, step: RecordedStep
    ) -> tuple[_MovingFrame, Transform]:
        start = now = frame.motion
        parallel = frame.parallel
        if step.shift is not None:
            now = FrameMotion(
                now.angular,
                now.angular_rate,
                add(now.linear, apply(now.field, step.shift)),
            )
        if isinstance(described, Motion) and described.kind is MotionKind.ROTATION:
            return self._rotated(now, parallel, described, step)
        if step.rotation is not None:
            angular, angular_rate, linear = (
                into_frame(step, v) for v in (now.angular, now.angular_rate, now.linear)
            )
            now = FrameMotion(angular, angular_rate, linear)
        before = now.angular
        for freedom in step.freedoms:
            now = _moved(now, before, freedom)
        if parallel is not None and step.rotation is not None:
            parallel = (
                None
                if step.freedoms
                else replace(parallel, fixed=product(parallel.fixed, step.rotation))
            )
        return _MovingFrame(now, parallel), Transform(step, start, now)

    def _rotated(
        self,
        now: FrameMotion,
        parallel: ParallelRotations | None,
        motion: Motion,
        step: RecordedStep,
    ) -> tuple[_MovingFrame, Transform]:
        """A rotation about a coordinate axis."""
        (freedom,) = step.freedoms
        axis, sign = motion.axis, motion.sign
        angle = self.recorder.coordinates[motion.name].position[0]
        program = self.recorder.program
        c, s = angle.cos(), angle.sin() * sign
        way = 0 if parallel is None or not self._sums else _along(parallel, axis)
        if parallel is None or not way:
            parallel = ParallelRotations(
                now, axis, c, s, sign * freedom.rate, identity(program)
            )
            way = 1
        else:
            s, rate = way * s, parallel.rate + way * sign * freedom.rate
            c, s = (
                parallel.cosine * c - parallel.sine * s,
                parallel.sine * c + parallel.cosine * s,
            )
            parallel = replace(
                parallel, cosine=c, sine=s, rate=rate, count=parallel.count + 1
            )
        rotation = product(
            self.recorder.turn(parallel.axis, parallel.cosine, parallel.sine),
            parallel.fixed,
        )
        back, unit = transpose(rotation), _with(self.recorder.zeros, axis, program.one)
        angular = apply(back, parallel.start.angular)
        carried = apply(back, parallel.start.angular_rate)
        angular_rate = add(carried, cross(angular, scale(unit, way * parallel.rate)))
        # points on the axis move as before the rotation: where ω has no part along it, only ω̇ moves them
        along = (
            (axis, cross(carried, unit))
            if parallel.start.angular[parallel.axis].is_zero
            else None
        )
        moved = FrameMotion(
            _with(angular, axis, now.angular[axis] + sign * freedom.rate),
            _with(
                angular_rate, axis, now.angular_rate[axis] + sign * freedom.acceleration
            ),
            into_frame(step, now.linear),
            along,
        )
        return _MovingFrame(moved, parallel), Transform(
            step, now, moved, parallel, rotation, axis
        )


def _moved(now: FrameMotion, before: Vec, freedom: Freedom) -> FrameMotion:
    turning = scale(freedom.angular, freedom.rate)
    sliding = scale(freedom.linear, freedom.rate)
    coriolis = cross(before, sliding)
    rate = add(
        now.angular_rate,
        add(cross(before, turning), scale(freedom.angular, freedom.acceleration)),
    )
    linear = add(
        now.linear,
        add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)),
    )
    return FrameMotion(add(now.angular, turning), rate, linear)


def _along(parallel: ParallelRotations, axis: int) -> int:
    """1 or −1 if a coordinate axis of the frame lies along the axis of parallel rotations or its opposite, else 0."""
    column = [row[axis].number for row in parallel.fixed]
    value = column.pop(parallel.axis)
    return int(value) if value in (1, -1) and column == [0, 0] else 0  # type: ignore[arg-type]


def _with(v: Vec, axis: int, value: Scalar) -> Vec:
    x, y, z = (value if k == axis else v[k] for k in range(3))
    return (x, y, z)


# -- backward ----------------------------------------------------------------------------------------------------------


def efforts(inertias: Mapping[int, Array], motion: ForwardPass) -> dict[str, Scalar]:
    """Generalised force of every freedom: velocity coordinates of the tree and sensors, from pseudo-inertias."""
    zeros = motion.recorder.zeros
    down = BackwardPass(zeros)
    wrenches: dict[int, Wrench] = dict.fromkeys(motion.motions, (zeros, zeros))
    for index, inertia in inertias.items():
        wrenches[index] = body_wrench(motion.motions[index], inertia)
    backward(
        motion.mechanism,
        wrenches,
        lambda wrench, index: down.carry(motion.transforms[index], wrench),
        plus,
    )
    return down.efforts


def plus(a: Wrench, b: Wrench) -> Wrench:
    """The sum of two wrenches about one origin."""
    return add(a[0], b[0]), add(a[1], b[1])


class BackwardPass:
    """Carries wrenches towards the ground, and reads the efforts of the freedoms on the way."""

    def __init__(self, zeros: Vec) -> None:
        self.efforts: dict[str, Scalar] = {}
        self._zeros = zeros
        self._waiting: dict[FrameMotion, Vec] = {}
        """Moments across the axis of parallel rotations, by the frame before these and in its axes."""

    def carry(self, chain: Sequence[Transform], wrench: Wrench) -> Wrench:
        """The wrench about the frame before a chain of steps."""
        moment, force = wrench
        for transform in reversed(chain):
            step = transform.step
            for freedom in step.freedoms:
                self.efforts[freedom.name] = dot(freedom.angular, moment) + dot(
                    freedom.linear, force
                )
            if step.rotation is not None:
                force = apply(step.rotation, force)
                moment = self._rotated(transform, step.rotation, moment)
            if step.shift is not None:
                moment = add(moment, cross(step.shift, force))
        return moment, force

    def _rotated(self, transform: Transform, rotation: Mat, moment: Vec) -> Vec:
        parallel, zeros = transform.parallel, self._zeros
        if parallel is None or transform.rotation is None:
            return apply(rotation, moment)
        if parallel.count == 1:
            return add(
                apply(rotation, moment), self._waiting.pop(parallel.start, zeros)
            )
        across = _with(moment, transform.axis, zeros[0])
        waiting = self._waiting.get(parallel.start, zeros)
        self._waiting[parallel.start] = add(waiting, apply(transform.rotation, across))
        return _with(zeros, transform.axis, moment[transform.axis])


def body_wrench(at: FrameMotion, inertia: Array) -> Wrench:
    """Wrench about the body's origin that its motion needs."""
    first: Vec = (inertia[0, MASS], inertia[1, MASS], inertia[2, MASS])
    force = add(apply(at.field, first), scale(at.linear, inertia[MASS, MASS]))
    x, y, z = (
        _moment(at, inertia, *axes) for axes in ((1, 2, 0), (2, 0, 1), (0, 1, 2))
    )
    return add((x, y, z), cross(first, at.linear)), force


def _moment(at: FrameMotion, inertia: Array, i: int, j: int, k: int) -> Scalar:
    """Component k of vee(U Σ)."""
    u = at.field
    mixed = (
        (u[j][j] - u[i][i]) * inertia[i, j]
        + u[j][k] * inertia[i, k]
        - u[i][k] * inertia[j, k]
    )
    return sum(_pair(at, inertia, i, j, k), mixed)


def _pair(at: FrameMotion, inertia: Array, i: int, j: int, k: int) -> list[Scalar]:
    """U_ji Σ_ii − U_ij Σ_jj = ω̇_k (Σ_ii + Σ_jj) + ω_i ω_j (Σ_ii − Σ_jj), with as few terms as possible."""
    u, a, b = at.field, inertia[i, i], inertia[j, j]
    moments = [u[j][i] * a, -u[i][j] * b]
    tensor = [at.angular_rate[k] * (a + b), at.products[i][j] * (a - b)]
    first, second = (
        [term for term in form if not term.is_zero] for form in (moments, tensor)
    )
    return first if len(first) < len(second) else second
