"""Coordinates of poses modulo p, and along curves that start at a pose.

Curves are power series over GF(p) that start at a pose.  A rotation is a complex number of size one, a ball a unit
quaternion.  Small turns multiply them by 1 + δ with an imaginary δ, which keeps their size but for δ², and Newton's
step for 1/√ mends the rest.  So all is rational, and there are no local coordinates but velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
            **{f"q[{n}]": ("balls", k, i) for k, m in enumerate(self.balls) for i, n in enumerate(m.positions)},
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


@dataclass(frozen=True)
class MovingCoordinates:
    """All coordinates along curves, as series."""

    layout: Layout
    units: Residues  # (turning coordinates,): in how many parts their angles count
    field: PrimeField
    turns: Residues  # (samples, turning coordinates, 2, order)
    slides: Residues  # (samples, sliding coordinates, order)
    balls: Residues  # (samples, balls, 4, order)
    start: Residues  # (samples, turning coordinates): angles as such at t = 0

    @staticmethod
    def resting(layout: Layout, units: Residues, field: PrimeField, pose: Pose) -> MovingCoordinates:
        """Coordinates at poses, as series of one coefficient."""
        turns, slides, balls = (part[..., None] for part in pose.parts[:3])
        return MovingCoordinates(layout, units, field, turns, slides, balls, pose.angles)

    @property
    def samples(self) -> int:
        """Number of curves."""
        return len(self.start)

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return int(self.turns.shape[-1])

    def extended(self, order: int) -> MovingCoordinates:
        """With more coefficients, at most twice as many; the new ones are zero but for what keeps unit sizes."""
        turns, slides, balls = (series.padded(x, order) for x in (self.turns, self.slides, self.balls))
        return replace(self, turns=_unit(turns, self.field), slides=slides, balls=_unit(balls, self.field))

    def moved(self, change: Residues) -> MovingCoordinates:
        """Moved on by small turns and slides (samples, velocities, order), of which products vanish to this order."""
        layout, field = self.layout, self.field
        turned = change[:, layout.turn_places] * field.invert_array(self.units)[:, None]
        halves = change[:, layout.ball_places] * field.invert(2)
        return replace(
            self,
            turns=_moved(self.turns, turned[:, :, None] % field.p, field),
            slides=(self.slides + change[:, layout.slide_places]) % field.p,
            balls=_moved(self.balls, halves % field.p, field),
        )

    def rates(self) -> Residues:
        """Velocity coordinates, (samples, velocities, order); the last coefficient is not known."""
        layout, field = self.layout, self.field
        result = np.empty((self.samples, len(layout.names), self.order), dtype=np.int64)
        result[:, layout.turn_places] = self._turning
        result[:, layout.slide_places] = series.derivative(self.slides, field)
        result[:, layout.ball_places] = 2 * _rates(self.balls, field) % field.p
        return result

    @cached_property
    def angles(self) -> Residues:
        """Angles of the turning coordinates as such, (samples, turning coordinates, order)."""
        result = series.integral(self._turning, self.field)
        result[..., 0] = self.start
        return result

    @property
    def _turning(self) -> Residues:
        return _rates(self.turns, self.field)[:, :, 0] * self.units[:, None] % self.field.p


# signs of a_j b_k in component i of a product of quaternions, where i, j and k are tied by k = i xor j; complex numbers
# are the quaternions of two components
_SIGNS = np.array([[1, -1, -1, -1], [1, 1, 1, -1], [1, -1, 1, 1], [1, 1, -1, 1]])


def times(a: Residues, b: Residues, field: PrimeField) -> Residues:
    """Products of complex numbers or quaternions, (..., components, order)."""
    index = np.arange(a.shape[-2])
    terms = series.product(a[..., None, :, :], b[..., index[:, None] ^ index, :], field)
    return np.asarray((terms * _SIGNS[: len(index), : len(index), None]).sum(axis=-2) % field.p)


def _moved(numbers: Residues, change: Residues, field: PrimeField) -> Residues:
    """Unit numbers turned by an imaginary change: their products with 1 + change."""
    one = np.zeros_like(change[..., :1, :])
    one[..., 0] = 1
    return times(numbers, np.concatenate([one, change], axis=-2), field)


def _unit(numbers: Residues, field: PrimeField) -> Residues:
    """Numbers of size one up to half of their order, made so to the whole of it: times 1 − (|n|² − 1)/2."""
    square = series.product(numbers, numbers, field).sum(axis=-2, keepdims=True)
    factor = -square * field.invert(2) % field.p
    factor[..., 0] = 1  # 3/2 - 1/2
    return series.product(numbers, factor, field)


def _rates(numbers: Residues, field: PrimeField) -> Residues:
    """Imaginary parts of n̄ ṅ."""
    conjugate = numbers.copy()
    conjugate[..., 1:, :] = -numbers[..., 1:, :] % field.p
    return times(conjugate, series.derivative(numbers, field), field)[..., 1:, :]
