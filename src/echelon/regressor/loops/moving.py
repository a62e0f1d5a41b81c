"""Coordinates of poses modulo p, and along curves that start at a pose.

Curves are power series over GF(p) that start at a pose.  A rotation is a complex number of size one, a ball a unit
quaternion.  Small turns multiply them by 1 + δ with an imaginary δ, which keeps their size but for δ², and Newton's
step for 1/√ mends the rest.  So all is rational, and there are no local coordinates but velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Integers
from echelon.exact import series
from echelon.exact.field import PrimeField, Residues
from echelon.mechanism.joint import Motion, MotionKind

_ROUNDING = 1e-9  # of a step of 15°


@dataclass(frozen=True)
class Pose:
    """Values of all coordinates modulo p, one row for each sample."""

    # (samples, numbers): cosine and sine of an angle, divided by the coordinate's unit, for what turns; displacements;
    # unit quaternions (w, x, y, z)
    numbers: Residues
    # (samples, turning coordinates): for springs and screws; nothing algebraic ties them to their cosines and sines
    angles: Residues

    def at(self, samples: Integers) -> Pose:
        """A copy of some samples."""
        return Pose(self.numbers[samples], self.angles[samples])

    def __add__(self, others: Pose) -> Pose:
        """These samples and then others."""
        return Pose(np.concatenate([self.numbers, others.numbers]), np.concatenate([self.angles, others.angles]))

    def repeated(self, count: int) -> Pose:
        """Every sample repeated."""
        return self.at(np.repeat(np.arange(len(self.numbers)), count))


_WIDTHS = {MotionKind.ROTATION: 2, MotionKind.SCREW: 2, MotionKind.TRANSLATION: 1, MotionKind.BALL: 4}


class Layout:
    """Where the values of coordinates that turn, slide, or belong to a ball are among numbers and velocities."""

    def __init__(self, motions: Sequence[Motion]) -> None:
        self.motions, self.names = motions, tuple(name for motion in motions for name in motion.velocities)
        self.turning = [m for m in motions if m.kind in (MotionKind.ROTATION, MotionKind.SCREW)]
        sliding, balls = ([m for m in motions if m.kind is k] for k in (MotionKind.TRANSLATION, MotionKind.BALL))
        self.count, self.columns = 0, dict[str, list[int]]()  # of numbers, and which are a motion's own
        for motion in motions:
            self.columns[motion.name] = list(range(self.count, self.count + _WIDTHS[motion.kind]))
            self.count += _WIDTHS[motion.kind]
        # an array and the place there, for inputs
        self.inputs = {f"q[{m.name}]": ("angles", k) for k, m in enumerate(self.turning)}
        for motion in (*sliding, *balls):
            values = zip(motion.positions, self.columns[motion.name], strict=True)
            self.inputs |= {f"q[{name}]": ("numbers", column) for name, column in values}
        self.turns, self.slides, self.balls = (  # (turning coordinates, 2), (sliding coordinates, 1), (balls, 4)
            np.array([self.columns[m.name] for m in some], dtype=np.intp).reshape(-1, width)
            for some, width in ((self.turning, 2), (sliding, 1), (balls, 4))
        )
        self.turn_places, self.slide_places, self.ball_places = (  # the same of velocities; 1, 1 and 3 of them
            np.array([[self.names.index(n) for n in m.velocities] for m in some], dtype=np.intp).reshape(-1, width)
            for some, width in ((self.turning, 1), (sliding, 1), (balls, 3))
        )

    def empty_pose(self, samples: int) -> Pose:
        """A pose to be filled in; angles as such are zero."""
        return Pose(*(np.zeros((samples, n), dtype=np.int64) for n in (self.count, len(self.turning))))


@dataclass(frozen=True)
class MovingCoordinates:
    """All coordinates along curves, as series."""

    layout: Layout
    units: Residues  # (turning coordinates,): in how many parts their angles count
    field: PrimeField
    numbers: Residues  # (samples, numbers, order)
    start: Residues  # (samples, turning coordinates): angles as such at t = 0

    @staticmethod
    def resting(layout: Layout, units: Residues, field: PrimeField, pose: Pose) -> MovingCoordinates:
        """Coordinates at poses, as series of one coefficient."""
        return MovingCoordinates(layout, units, field, pose.numbers[..., None], pose.angles)

    @property
    def samples(self) -> int:
        """Number of curves."""
        return len(self.start)

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return int(self.numbers.shape[-1])

    def extended(self, order: int) -> MovingCoordinates:
        """With more coefficients, at most twice as many; the new ones are zero but for what keeps unit sizes."""
        numbers = series.padded(self.numbers, order)
        for places in (self.layout.turns, self.layout.balls):
            numbers[:, places] = _unit(numbers[:, places], self.field)
        return replace(self, numbers=numbers)

    def moved(self, change: Residues) -> MovingCoordinates:
        """Moved on by small turns and slides (samples, velocities, order), of which products vanish to this order."""
        layout, field, numbers = self.layout, self.field, self.numbers.copy()
        turned = change[:, layout.turn_places] * field.invert_array(self.units)[:, None, None] % field.p
        halves = change[:, layout.ball_places] * field.invert(2) % field.p
        for places, by in ((layout.turns, turned), (layout.balls, halves)):
            numbers[:, places] = _moved(numbers[:, places], by, field)
        numbers[:, layout.slides] = (numbers[:, layout.slides] + change[:, layout.slide_places]) % field.p
        return replace(self, numbers=numbers)

    def rates(self) -> Residues:
        """Velocity coordinates, (samples, velocities, order); the last coefficient is not known."""
        layout, field = self.layout, self.field
        result = np.empty((self.samples, len(layout.names), self.order), dtype=np.int64)
        result[:, layout.turn_places] = self._turning[:, :, None]
        result[:, layout.slide_places] = series.derivative(self.numbers[:, layout.slides], field)
        result[:, layout.ball_places] = 2 * _rates(self.numbers[:, layout.balls], field) % field.p
        return result

    @cached_property
    def angles(self) -> Residues:
        """Angles of the turning coordinates as such, (samples, turning coordinates, order)."""
        result = series.integral(self._turning, self.field)
        result[..., 0] = self.start
        return result

    @property
    def _turning(self) -> Residues:
        return _rates(self.numbers[:, self.layout.turns], self.field)[:, :, 0] * self.units[:, None] % self.field.p


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
