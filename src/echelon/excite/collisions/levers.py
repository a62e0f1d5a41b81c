"""How fast two shapes can come nearer: bounds by the speeds of the joints between them.

A rigid motion of both shapes changes no distance, so only joints between their bodies and the nearest body that carries
both count.  A joint's lever is how far the points of the shape can be from its axis: the lengths of all placements
behind it along the chain, the travel of sliding joints, and the extent of the shape about its body's origin.  Poses do
not matter, so the bound holds for all of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import Polynomial, float_generators
from echelon.excite.collisions.shapes import Shape
from echelon.excite.collisions.supports import extent
from echelon.mechanism.joint import Motion, MotionKind, Step
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.placement import Placement
from echelon.mechanism.values import placement_matrix, symbol_values


class Levers:
    """Levers of a mechanism's joints.

    Parameters
    ----------
    mechanism : Mechanism
    positions : array of shape (n,)
        What no |q| exceeds, rad or m, for each velocity coordinate; of balls of no consequence.
    symbols : mapping of str to float, optional
        Values of geometry symbols that replace or complete those of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, positions: Floats, symbols: Mapping[str, float] | None = None) -> None:
        self.mechanism = mechanism
        self._column = {name: k for k, name in enumerate(mechanism.velocities)}
        used = {s for body in mechanism.bodies for s in body.joint.symbols()}
        functions = [function for coupling in mechanism.couplings for _, function in coupling.terms]
        used |= {s for function in functions for value in function.expressions for s in value.symbols()}
        self._symbols = symbol_values(mechanism, sorted(used), symbols)
        self._weights = {m.name: self._weighted(m.name, positions) for m in mechanism.motions}
        self._most = {name: float(weights @ positions) for name, weights in self._weights.items()}

    def between(self, first: Shape, second: Shape) -> Floats:
        """Bounds of the speed of points of one shape against those of another, per speed of a coordinate.

        Parameters
        ----------
        first, second : Shape

        Returns
        -------
        array of shape (n,)
            m per rad or m: distances fall by no more than this times |q̇|, summed over the coordinates, per second.
        """
        carried = set(self._up(first.body)) & set(self._up(second.body))
        return self._along(first, carried) + self._along(second, carried)

    def _along(self, shape: Shape, carried: set[int]) -> Floats:
        """Levers of the joints between a shape and the bodies that carry both."""
        total = np.zeros(len(self._column))
        path = [body for body in self._up(shape.body) if body not in carried]
        length = extent(shape) if path else 0.0
        for step in (step for body in path for step in reversed(self.mechanism.bodies[body].joint.steps)):
            if isinstance(step, Motion):
                total += self._lever(step, length) * self._weights[step.name]
            length += self._length(step)
        return total

    def _lever(self, motion: Motion, length: float) -> float:
        """Speed of points at most a length away from the moved frame's origin, per speed of the coordinate."""
        if motion.kind is MotionKind.TRANSLATION:
            return 1.0
        return float(np.hypot(length, self._number(motion.pitch)))

    def _length(self, step: Step) -> float:
        """How far a step can bring the frame."""
        if isinstance(step, Placement):
            return float(np.linalg.norm(placement_matrix(step, self._symbols)[:3, 3]))
        if step.kind is MotionKind.TRANSLATION:
            return self._most[step.name]
        return abs(self._number(step.pitch)) * self._most[step.name]

    def _weighted(self, name: str, positions: Floats) -> Floats:
        """What |dq/dq_k| of a coordinate by the independent ones does not exceed."""
        weights = np.zeros(len(self._column))
        coupling = next((c for c in self.mechanism.couplings if c.coordinate == name), None)
        if coupling is None:
            motion = next(m for m in self.mechanism.motions if m.name == name)
            weights[[self._column[velocity] for velocity in motion.velocities]] = 1.0
            return weights
        for leader, function in coupling.terms:
            column = self._column[leader]
            weights[column] += function.steepest(float(positions[column]), self._symbols)
        return weights

    def _number(self, value: Polynomial) -> float:
        return value.evaluate(float_generators(value.generators(), self._symbols), float) if value else 0.0

    def _up(self, body: int) -> Iterator[int]:
        while body != GROUND:
            yield body
            body = self.mechanism.bodies[body].parent
