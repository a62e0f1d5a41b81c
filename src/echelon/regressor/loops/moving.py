"""Coordinates of poses modulo p, and along curves that start at a pose.

Curves are power series over GF(p) that start at a pose.  From there, a rotation goes on by τ = tan(δ/2), a translation
by its displacement, a ball by the Cayley vector of the rotation from the pose on.  With these local coordinates z,
everything is rational in z, its derivative and, for a ball, one square root of a series that begins with 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from echelon.arrays import Integers
from echelon.exact import series
from echelon.exact.expressions import STEPS_PER_HALF_TURN
from echelon.exact.field import PrimeField, Residues
from echelon.exact.numbers import cosine_of_turn, parse_decimal, sine_of_turn
from echelon.mechanism.joint import Motion, MotionKind

_ROUNDING = 1e-9  # of a step of 15°


@dataclass(frozen=True)
class Pose:
    """Values of all coordinates modulo p, one row for each sample."""

    # (samples, turning coordinates, 2): cosine and sine of the angle, divided by the coordinate's unit
    turns: Residues
    slides: Residues  # (samples, sliding coordinates)
    balls: Residues  # (samples, balls, 4): unit quaternions (w, x, y, z)
    # (samples, turning coordinates): for springs and screws; nothing algebraic ties them to their cosines and sines
    angles: Residues

    @property
    def parts(self) -> tuple[Residues, Residues, Residues, Residues]:
        """All arrays."""
        return self.turns, self.slides, self.balls, self.angles

    def at(self, samples: Integers) -> Pose:
        """A copy of some samples."""
        return Pose(*(part[samples] for part in self.parts))

    def repeated(self, count: int) -> Pose:
        """Every sample repeated."""
        return Pose(*(np.repeat(part, count, axis=0) for part in self.parts))


class Layout:
    """Which velocity coordinates turn, slide, or belong to a ball."""

    def __init__(self, motions: Sequence[Motion]) -> None:
        self.names = tuple(name for motion in motions for name in motion.velocities)
        self.turning = [m for m in motions if m.kind in (MotionKind.ROTATION, MotionKind.SCREW)]
        self.sliding = [m for m in motions if m.kind is MotionKind.TRANSLATION]
        self.balls = [m for m in motions if m.kind is MotionKind.BALL]
        # where the values of inputs are among those of moving coordinates
        self.inputs: dict[str, tuple[str | int, ...]] = {
            **{f"q[{m.name}]": ("angles", k) for k, m in enumerate(self.turning)},
            **{f"q[{m.name}]": ("slides", k) for k, m in enumerate(self.sliding)},
            **{f"q[{n}]": ("quaternions", k, i) for k, m in enumerate(self.balls) for i, n in enumerate(m.positions)},
        }
        place = {name: k for k, name in enumerate(self.names)}
        self.turn_places = np.array([place[m.name] for m in self.turning], dtype=np.intp)
        self.slide_places = np.array([place[m.name] for m in self.sliding], dtype=np.intp)
        self.ball_places = np.array([[place[n] for n in m.velocities] for m in self.balls], dtype=np.intp).reshape(
            -1, 3
        )

    def stated_pose(self, values: Mapping[str, float], units: Residues, field: PrimeField, samples: int) -> Pose | None:
        """The pose of positions, zero where absent; None if it has no exact sines, cosines or quaternions."""
        pose = self.zero_pose(samples)
        for k, motion in enumerate(self.turning):
            if motion.kind is MotionKind.SCREW and values.get(motion.name, 0.0):
                return None
            steps = values.get(motion.name, 0.0) * STEPS_PER_HALF_TURN / pi / int(units[k])
            if abs(steps - round(steps)) > _ROUNDING:
                return None
            pose.turns[:, k] = [field.embed(f(round(steps))) for f in (cosine_of_turn, sine_of_turn)]
        for k, motion in enumerate(self.sliding):
            pose.slides[:, k] = field.embed(parse_decimal(repr(float(values.get(motion.name, 0.0)))))
        for k, motion in enumerate(self.balls):
            parts = [parse_decimal(repr(float(values.get(n, n == motion.positions[0])))) for n in motion.positions]
            if sum(x * x for x in parts) != 1:
                return None
            pose.balls[:, k] = [field.embed(x) for x in parts]
        return pose

    def zero_pose(self, samples: int) -> Pose:
        """All coordinates zero."""
        turns = np.zeros((samples, len(self.turning), 2), dtype=np.int64)
        turns[..., 0] = 1
        balls = np.zeros((samples, len(self.balls), 4), dtype=np.int64)
        balls[..., 0] = 1
        slides, angles = (np.zeros((samples, len(c)), dtype=np.int64) for c in (self.sliding, self.turning))
        return Pose(turns, slides, balls, angles)


class MovingCoordinates:
    """All coordinates as series, from local coordinates."""

    def __init__(self, layout: Layout, field: PrimeField, units: Residues, pose: Pose, local: Residues) -> None:
        self.layout, self.field, self.units, self.pose, self.local = layout, field, units, pose, local

    @cached_property
    def _half_turns(self) -> tuple[Residues, Residues]:
        """τ and 1/(1 + τ²)."""
        tau = self.local[:, self.layout.turn_places]
        square = series.product(tau, tau, self.field)
        square[..., 0] += 1
        return tau, series.inverse(square, self.field)

    @cached_property
    def turns(self) -> tuple[Residues, Residues]:
        """Cosines and sines of the turning coordinates' parts, (samples, turning coordinates, order)."""
        p, (tau, scale) = self.field.p, self._half_turns
        cosine, sine = 2 * scale % p, 2 * series.product(tau, scale, self.field) % p
        cosine[..., 0] = (cosine[..., 0] - 1) % p  # (1 − τ²)/(1 + τ²) = 2/(1 + τ²) − 1
        c, s = self.pose.turns[..., 0, None], self.pose.turns[..., 1, None]
        return (c * cosine % p - s * sine % p) % p, (s * cosine % p + c * sine % p) % p

    @cached_property
    def slides(self) -> Residues:
        """Sliding coordinates, (samples, sliding coordinates, order)."""
        result = self.local[:, self.layout.slide_places].copy()
        result[..., 0] += self.pose.slides
        return result % self.field.p

    @cached_property
    def quaternions(self) -> Residues:
        """Quaternions, (samples, balls, 4, order)."""
        field, p = self.field, self.field.p
        vector = self.local[:, self.layout.ball_places]
        scale = _inverse_root(self._ball_sizes, field)
        x, y, z = (series.product(vector[:, :, k], scale, field) for k in range(3))
        w0, x0, y0, z0 = (self.pose.balls[:, :, k, None] for k in range(4))
        parts = (
            ((w0, scale, 1), (x0, x, -1), (y0, y, -1), (z0, z, -1)),
            ((w0, x, 1), (x0, scale, 1), (y0, z, 1), (z0, y, -1)),
            ((w0, y, 1), (x0, z, -1), (y0, scale, 1), (z0, x, 1)),
            ((w0, z, 1), (x0, y, 1), (y0, x, -1), (z0, scale, 1)),
        )
        components = [np.sum([sign * (a * b % p) for a, b, sign in part], axis=0) % p for part in parts]
        return np.stack(components, axis=2)

    @cached_property
    def _ball_sizes(self) -> Residues:
        """1 + |z|² of every ball."""
        vector = self.local[:, self.layout.ball_places]
        square: Residues = series.product(vector, vector, self.field).sum(axis=2) % self.field.p
        square[..., 0] += 1
        return square

    def rates(self) -> Residues:
        """Velocity coordinates, (samples, velocities, order); the last coefficient is not known."""
        return self.moved(series.derivative(self.local, self.field))

    def moved(self, change: Residues) -> Residues:
        """Velocities that belong to a change of the local coordinates, of the same shape."""
        result = change.copy()
        layout, field = self.layout, self.field
        if len(layout.turning):
            _, scale = self._half_turns
            factor = 2 * self.units[:, None] * scale % field.p
            result[:, layout.turn_places] = series.product(change[:, layout.turn_places], factor, field)
        if len(layout.balls):
            vector, speed = self.local[:, layout.ball_places], change[:, layout.ball_places]
            scale = 2 * series.inverse(self._ball_sizes, field) % field.p
            turned = (speed - _cross(vector, speed, field)) % field.p
            result[:, layout.ball_places] = series.product(turned, scale[:, :, None], field)
        return result

    def pulled_back(self, jacobian: Residues) -> Residues:
        """Derivatives by velocities as derivatives by local coordinates: (samples, equations, velocities, order)."""
        # most entries are zero: loops move few coordinates
        result, used = jacobian.copy(), np.asarray(jacobian.any(axis=(0, -1)))
        layout, field = self.layout, self.field
        if len(layout.turning):
            rows, turns = np.nonzero(used[:, layout.turn_places])
            entry = (slice(None), rows, layout.turn_places[turns])
            factor = 2 * self.units[:, None] * self._half_turns[1] % field.p
            result[entry] = series.product(jacobian[entry], factor[:, turns], field)
        if len(layout.balls):
            # the transpose of speed − z × speed is gradient + z × gradient
            rows, balls = np.nonzero(used[:, layout.ball_places].any(axis=-1))
            entry = (slice(None), rows[:, None], layout.ball_places[balls])
            turned = jacobian[entry] + _cross(self.local[:, layout.ball_places[balls]], jacobian[entry], field)
            scale = 2 * series.inverse(self._ball_sizes, field) % field.p
            result[entry] = series.product(turned % field.p, scale[:, balls, None], field)
        return result

    @cached_property
    def angles(self) -> Residues:
        """Angles of the turning coordinates as such, (samples, turning coordinates, order)."""
        tau, scale = self._half_turns
        rate = 2 * series.product(series.derivative(tau, self.field), scale, self.field) * self.units[:, None]
        result = series.integral(rate % self.field.p, self.field)
        result[..., 0] = self.pose.angles
        return result


def _cross(a: Residues, b: Residues, field: PrimeField) -> Residues:
    """Cross products along the last axis but one."""
    parts = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        first = series.product(a[..., i, :], b[..., j, :], field)
        parts.append((first - series.product(a[..., j, :], b[..., i, :], field)) % field.p)
    return np.stack(parts, axis=-2)


def _inverse_root(a: Residues, field: PrimeField) -> Residues:
    """1/√a for series that begin with 1, by Newton's iteration."""
    order, known, half = a.shape[-1], 1, field.invert(2)
    result = np.ones((*a.shape[:-1], 1), dtype=np.int64)
    while known < order:
        known = min(2 * known, order)
        guess = np.zeros((*a.shape[:-1], known), dtype=np.int64)
        guess[..., : result.shape[-1]] = result
        error = -series.product(a[..., :known], series.product(guess, guess, field), field)
        error[..., 0] += 3
        result = series.product(guess, error % field.p, field) * half % field.p
    return result
