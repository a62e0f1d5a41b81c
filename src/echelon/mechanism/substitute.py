"""A mechanism with other expressions put in for its geometry symbols."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from echelon.exact.polynomial import Polynomial, as_polynomial
from echelon.mechanism.joint import Motion, Step, merge
from echelon.mechanism.mechanism import Body, Mechanism
from echelon.mechanism.placement import Matrix, Placement, Vector


def substituted(mechanism: Mechanism, values: Mapping[str, Polynomial]) -> Mechanism:
    """Put expressions in for generators of joints, gravity and couplings.

    Parameters
    ----------
    mechanism : Mechanism
    values : mapping of str to Polynomial
        By generator: ``a`` for a length, ``cos(b)`` and ``sin(b)`` for an angle.
    """
    put = _Substitution(values)
    gravity = None if mechanism.gravity is None else put.vector(mechanism.gravity)
    return replace(
        mechanism,
        bodies=tuple(put.body(body) for body in mechanism.bodies),
        gravity=gravity if gravity is not None and any(gravity) else None,
        couplings=tuple(
            replace(c, terms=tuple((name, function.mapped(put.polynomial)) for name, function in c.terms))
            for c in mechanism.couplings
        ),
        closures=tuple(
            replace(c, first_frame=put.placement(c.first_frame), second_frame=put.placement(c.second_frame))
            for c in mechanism.closures
        ),
        reading=None,
    )


class _Substitution:
    def __init__(self, values: Mapping[str, Polynomial]) -> None:
        self.values = values

    def polynomial(self, p: Polynomial) -> Polynomial:
        generators = p.generators()
        if not any(g in self.values for g in generators):
            return p
        known = {g: self.values.get(g, Polynomial.generator(g)) for g in generators}
        return p.evaluate(known, as_polynomial)

    def vector(self, vector: Vector) -> Vector:
        x, y, z = (self.polynomial(part) for part in vector)
        return (x, y, z)

    def matrix(self, matrix: Matrix) -> Matrix:
        a, b, c = (self.vector(row) for row in matrix)
        return (a, b, c)

    def body(self, body: Body) -> Body:
        steps: tuple[Step, ...] = tuple(self.step(step) for step in body.joint.steps)
        return replace(body, joint=replace(body.joint, steps=merge(steps)))

    def step(self, step: Step) -> Step:
        if isinstance(step, Motion):
            return replace(step, pitch=self.polynomial(step.pitch))
        return self.placement(step)

    def placement(self, placement: Placement) -> Placement:
        return Placement(self.matrix(placement.rotation), self.vector(placement.translation))
