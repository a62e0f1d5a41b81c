"""Mechanisms with loops in Pinocchio: inverse dynamics of the tree, and constraint forces as Lagrange multipliers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from echelon.algebra.exact.polynomial import Polynomial, float_generators
from echelon.robot.closure import Closure, ClosureKind
from echelon.robot.joint import GROUND, Motion, MotionKind, Placement
from echelon.robot.mechanism import Mechanism

Array = npt.NDArray[np.float64]

TURNS = {
    ClosureKind.WELD: (0, 1, 2),
    ClosureKind.REVOLUTE: (0, 1),
    ClosureKind.PRISMATIC: (0, 1, 2),
    ClosureKind.CYLINDRICAL: (0, 1),
    ClosureKind.PLANAR: (0, 1),
}
"""Axes of the first frame about which closures forbid to turn."""


class Constrained:
    """A mechanism with given standard parameters.

    ``closing`` is the Jacobian J and ``dynamics`` gives τ and λ of M q̈ + h = Sᵀτ + Jᵀλ, where S picks the independent
    coordinates.
    """

    def __init__(self, mechanism: Mechanism, zeta: Array) -> None:
        self.mechanism, self.model, self.places = (
            mechanism,
            pin.Model(),
            {GROUND: (0, pin.SE3.Identity())},
        )
        self.joints: dict[str, int] = {}
        gravity = mechanism.gravity
        self.model.gravity.linear = (
            np.zeros(3)
            if gravity is None
            else np.array([self._number(g) for g in gravity])
        )
        for index, body in enumerate(mechanism.bodies):
            joint, place = self.places[body.parent]
            for step in body.joint.steps:
                if isinstance(step, Placement):
                    place = place * self._placed(step)
                else:
                    joint, place = self._joint(joint, step, place), pin.SE3.Identity()
            self.places[index] = joint, place
            xx, xy, xz, yy, yz, zz, *moments, mass = zeta[10 * index : 10 * index + 10]
            inertia = pin.Inertia.FromDynamicParameters(
                np.array([mass, *moments, xx, xy, yy, xz, yz, zz])
            )
            self.model.appendBodyToJoint(joint, inertia, place)
        self.data = self.model.createData()
        self.couplings = self._couplings()

    # -- building --------------------------------------------------------------------------------------------------

    def _number(self, expression: Polynomial) -> float:
        known = {name: s.value for name, s in self.mechanism.symbols.items()}
        return expression.evaluate(
            float_generators(expression.generators(), known), float
        )

    def _placed(self, placement: Placement) -> pin.SE3:
        rotation = np.array(
            [[self._number(e) for e in row] for row in placement.rotation]
        )
        return pin.SE3(
            rotation, np.array([self._number(e) for e in placement.translation])
        )

    def _joint(self, parent: int, motion: Motion, place: pin.SE3) -> int:
        axis = motion.sign * np.eye(3)[motion.axis]
        kinds = {
            MotionKind.ROTATION: lambda: pin.JointModelRevoluteUnaligned(axis),
            MotionKind.TRANSLATION: lambda: pin.JointModelPrismaticUnaligned(axis),
            MotionKind.SCREW: lambda: pin.JointModelHelicalUnaligned(
                axis, self._number(motion.pitch)
            ),
            MotionKind.BALL: pin.JointModelSpherical,
        }
        self.joints[motion.name] = self.model.addJoint(
            parent, kinds[motion.kind](), place, motion.name
        )
        return self.joints[motion.name]

    def _couplings(self) -> Array:
        """Velocities of all joints by those of the mechanism."""
        names = self.mechanism.velocities
        matrix = np.zeros((self.model.nv, len(names)))
        for motion in self.mechanism.motions:
            first = self.model.joints[self.joints[motion.name]].idx_v
            for k, name in enumerate(motion.velocities):
                if name in names:
                    matrix[first + k, names.index(name)] = 1
        for coupling in self.mechanism.couplings:
            row = self.model.joints[self.joints[coupling.coordinate]].idx_v
            for name, function in coupling.terms:
                assert function.ratio is not None
                matrix[row, names.index(name)] = self._number(function.ratio)
        return matrix

    # -- states ----------------------------------------------------------------------------------------------------

    def joint_positions(self, q: Array) -> Array:
        """Pinocchio's configuration; its quaternions end with w."""
        known = dict(zip(self.mechanism.positions, q, strict=True))
        for coupling in self.mechanism.couplings:
            known[coupling.coordinate] = sum(
                self._number(f.ratio) * known[n] for n, f in coupling.terms
            )
        result = np.zeros(self.model.nq)
        for motion in self.mechanism.motions:
            values = [known[name] for name in motion.positions]
            first = self.model.joints[self.joints[motion.name]].idx_q
            result[first : first + len(values)] = (
                values[1:] + values[:1] if len(values) > 1 else values
            )
        return result

    def energy(self, q: Array, qd: Array) -> float:
        positions, velocities = self.joint_positions(q), self.couplings @ qd
        kinetic = pin.computeKineticEnergy(self.model, self.data, positions, velocities)
        return float(
            kinetic + pin.computePotentialEnergy(self.model, self.data, positions)
        )

    def frames(self, closure: Closure) -> list[tuple[int, pin.SE3]]:
        """Joints of both sides of a closure, and where the frames sit on them."""
        sides = (
            (closure.first, closure.first_frame),
            (closure.second, closure.second_frame),
        )
        return [
            (self.places[body][0], self.places[body][1] * self._placed(frame))
            for body, frame in sides
        ]

    def basis(self, closure: Closure) -> tuple[pin.SE3, Array]:
        """The second frame seen from the first, and constrained twists in axes of the first, (constraints, 6)."""
        (a, at_a), (b, at_b) = self.frames(closure)
        seen = (self.data.oMi[a] * at_a).actInv(self.data.oMi[b] * at_b)
        rows = [np.eye(6)[k] for k in closure.kind.positions]
        rows += [np.eye(6)[3 + k] for k in TURNS.get(closure.kind, ())]
        if closure.kind is ClosureKind.UNIVERSAL:
            rows.append(np.r_[0, 0, 0, np.cross([1, 0, 0], seen.rotation[:, 1])])
        return seen, np.array(rows)

    def closing(self, q: Array) -> Array:
        """Jacobian of the closures at closed configurations."""
        pin.computeJointJacobians(self.model, self.data, self.joint_positions(q))
        rows = []
        for closure in self.mechanism.closures:
            seen, basis = self.basis(closure)
            first, second = (
                place.toActionMatrixInverse()
                @ pin.getJointJacobian(self.model, self.data, joint, pin.LOCAL)
                for joint, place in self.frames(closure)
            )
            moved = first[:3] - pin.skew(seen.translation) @ first[3:]
            relative = np.vstack(
                [
                    seen.rotation @ second[:3] - moved,
                    seen.rotation @ second[3:] - first[3:],
                ]
            )
            rows.append(basis @ relative @ self.couplings)
        return np.vstack(rows)

    def dynamics(self, q: Array, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Forces of the independent coordinates and Lagrange multipliers."""
        effort = pin.rnea(
            self.model,
            self.data,
            self.joint_positions(q),
            self.couplings @ qd,
            self.couplings @ qdd,
        )
        names = self.mechanism.velocities
        chosen = np.eye(len(names))[
            [names.index(n) for n in self.mechanism.independent_velocities]
        ]
        matrix, effort = (
            np.vstack([chosen, self.closing(q)]).T,
            self.couplings.T @ effort,
        )
        solved = np.linalg.lstsq(matrix, effort, rcond=1e-9)[0]
        np.testing.assert_allclose(
            matrix @ solved, effort, atol=1e-8 * np.abs(effort).max()
        )
        return solved[: len(chosen)], solved[len(chosen) :]

    def wrenches(self, q: Array, qd: Array, qdd: Array) -> list[Array]:
        """Force and moment that each body gets from its parent, about and in axes of its frame."""
        _, multipliers = self.dynamics(q, qd, qdd)
        outside = [pin.Force.Zero() for _ in range(self.model.njoints)]
        for closure in self.mechanism.closures:
            seen, basis = self.basis(closure)
            here, multipliers = (
                multipliers[: len(basis)] @ basis,
                multipliers[len(basis) :],
            )
            (a, at_a), (b, at_b) = self.frames(closure)
            around = pin.SE3(np.eye(3), seen.translation).act(pin.Force(here))
            outside[a] -= at_a.act(around)
            outside[b] += at_b.act(seen.actInv(around))
        forces = pin.StdVec_Force()
        forces.extend(outside)
        velocity, acceleration = self.couplings @ qd, self.couplings @ qdd
        pin.rnea(
            self.model,
            self.data,
            self.joint_positions(q),
            velocity,
            acceleration,
            forces,
        )
        places = (self.places[k] for k in range(len(self.mechanism.bodies)))
        return [place.actInv(self.data.f[joint]).vector for joint, place in places]
