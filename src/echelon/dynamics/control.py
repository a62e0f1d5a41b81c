"""Forces, momenta and energies for controllers, and accelerations.

*Reference motions.*  Inertial forces are affine in the accelerations and in gravity, and quadratic in the velocities,
with Christoffel's symbols as half of their second derivatives.  So their rate in the direction (q̇ᵣ/2, q̈ᵣ, g) of
velocities, accelerations and gravity is M q̈ᵣ + C(q, q̇) q̇ᵣ + g, with Ṁ − 2 C skew-symmetric (Slotine and Li 1987).
Recorded forward, that rate costs a sixth more than inverse dynamics.  The velocities of a ball are no rates of
coordinates.  C of the Levi-Civita connection has half of the bracket of both motions on top, M (ω × ωᵣ) / 2.

*Momentum.*  The outputs are ṗ plus a bias without accelerations, where p = M q̇.  In coordinates the bias is
g − Cᵀ q̇ and effects; here it is the outputs at q̈ = 0 less the rate of p along q̇, which holds for all outputs.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cached_property

import numpy as np

from echelon.algebra import Scalar, rates
from echelon.dynamics.articulated import articulated_accelerations, solved
from echelon.dynamics.linear_forms import energies
from echelon.dynamics.outputs import Index, RecordedOutputs
from echelon.dynamics.recursion import efforts
from echelon.robot import Array, MotionKind, Recorder, VirtualMotion, cross
from echelon.shared import InputError


class ControlOutputs(RecordedOutputs):
    """Records what controllers need of outputs, or of the forces of all independent coordinates."""

    _by_coordinate = False

    def by_coordinate(self, name: str) -> ControlOutputs:
        """The forces of independent coordinates in the place of outputs, for a function that needs all of them."""
        if not self.mechanism.measures_every_force:
            raise InputError(
                f"{name} needs the force of every independent coordinate, and the outputs of {self.mechanism.name} are "
                "others: leave the list of outputs out of its description"
            )
        found = ControlOutputs(self.mechanism, self._pivots, self._sums)
        found._by_coordinate = True
        return found

    @cached_property
    def _motions(self) -> list[VirtualMotion]:
        if self._by_coordinate:
            return list(self._unit_motions.values())
        return super()._motions

    # -- references ----------------------------------------------------------------------------------------------

    def reference_forces(self) -> list[Scalar]:
        """Forces M q̈ᵣ + C q̇ᵣ + g with Christoffel's C(q, q̇), and effects at q̇, one for each row."""
        weight = self.program.input("weight")
        forces = self._rows(
            efforts(self._inertias, self._forward(self._given(), weight))
        )
        direction = self._reference_direction() | {weight.node: self.program.one}
        inertial = rates(self.program, [f.node for f in forces], direction)
        effects = self._total_effects(self._at_reference())
        return [a + b for a, b in zip(inertial, effects, strict=True)]

    def _reference_direction(self) -> dict[int, Scalar]:
        """Direction (q̇ᵣ/2, q̈ᵣ) of the rates' inputs, by node."""
        program, now, reference = self.program, self._speeds("qd"), self._speeds("qdr")
        found: dict[str, Scalar] = {}
        for name in self.mechanism.independent_velocities:
            found[f"qd[{name}]"] = reference[name] / 2
            found[f"qdd[{name}]"] = program.input(f"qddr[{name}]")
        for motion in self.mechanism.free_motions:
            if motion.kind is MotionKind.BALL:
                x, y, z = motion.velocities
                turning = (now[x], now[y], now[z])
                bracket = cross(turning, (reference[x], reference[y], reference[z]))
                for name, part in zip(motion.velocities, bracket, strict=True):
                    if (key := f"qdd[{name}]") in found:
                        found[key] = found[key] + part / 2
        return {program.input(name).node: value for name, value in found.items()}

    def _at_reference(self) -> Recorder:
        """Positions and velocities, with the rates of the reference velocities as accelerations."""
        program, state = self.program, self._recorder()
        given = {f"qd[{n}]": speed for n, speed in self._speeds("qdr").items()}
        reference = Recorder(self.mechanism, program, given).coordinates
        seeds = state.position_rates(self._speeds("qd"))
        for name in self.mechanism.independent_velocities:
            node = program.input(f"qdr[{name}]").node
            seeds[node] = program.input(f"qddr[{name}]")
        nodes = [rate.node for at in reference.values() for rate in at.rate]
        made = iter(rates(program, nodes, seeds))
        state.coordinates = {
            name: replace(at, acceleration=tuple(next(made) for _ in at.rate))
            for name, at in state.coordinates.items()
        }
        return state

    def _speeds(self, kind: str) -> dict[str, Scalar]:
        """Velocities of all coordinates from those of the independent ones, which are inputs."""
        free = self.mechanism.independent_velocities
        chosen = {name: self.program.input(f"{kind}[{name}]") for name in free}
        closed = self.dependent_motion
        return chosen if closed is None else chosen | closed.speeds(chosen)

    # -- momentum and energy -------------------------------------------------------------------------------------

    def momentum(self) -> list[Scalar]:
        """M q̇, one for each row."""
        given = {f"qdd[{n}]": speed for n, speed in self._speeds("qd").items()}
        given |= {f"qd[{n}]": self.program.zero for n in self.mechanism.velocities}
        motion = self._forward(given, self.program.zero)
        found = self._rows(efforts(self._inertias, motion))
        free = self.mechanism.independent_velocities
        for (row, column), slope in self.effect_inertia().items():
            speed = self.program.input(f"qd[{free[column]}]")
            found[row] = found[row] + slope * speed
        return found

    def momentum_bias(self) -> list[Scalar]:
        """Outputs less the rate of the momentum, one for each row; accelerations do not matter."""
        moved = self._recorder().position_rates(self._speeds("qd"))
        nodes = [p.node for p in self.momentum()]
        parts = (
            self.inertial(True, "qdd"),
            self.effects("qdd"),
            rates(self.program, nodes, moved),
        )
        return [a + b - change for a, b, change in zip(*parts, strict=True)]

    def kinetic_energy(self) -> list[Scalar]:
        """q̇ᵀ M q̇ / 2, of rows by coordinate."""
        total = self.program.zero
        free = self.mechanism.independent_velocities
        for name, momentum in zip(free, self.momentum(), strict=True):
            total = total + self.program.input(f"qd[{name}]") * momentum
        return [total * Fraction(1, 2)]

    def potential_energy(self) -> list[Scalar]:
        """Energy of the weight, up to a constant."""
        still = {f"qd[{n}]": self.program.zero for n in self.mechanism.velocities}
        heights = energies(Recorder(self.mechanism, self.program, still))
        total = self.program.zero
        for column, value in self._values.items():
            if column in heights:
                total = total + value * heights[column]
        return [total]

    # -- accelerations, of rows by coordinate --------------------------------------------------------------------

    @cached_property
    def applied(self) -> dict[Index, Scalar]:
        """Force on each coordinate by a unit of each output."""
        found: dict[Index, Scalar] = {}
        for column, output in enumerate(self.mechanism.outputs):
            ((force, _),) = output.forces
            for row, motion in enumerate(self._motions):
                if force.at in motion.drives:
                    found[row, column] = motion.drives[force.at]
        return found

    def accelerations(self, *, articulated: bool = True) -> list[Scalar]:
        """Accelerations that the outputs cause: of trees by articulated bodies, if wanted, else by the mass matrix."""
        outputs = self.mechanism.outputs
        given = [self.program.input(f"y[{output.name}]") for output in outputs]
        forces = [-effect for effect in self.effects("qdd")]
        for (row, column), rate in self.applied.items():
            forces[row] = forces[row] + rate * given[column]
        rotors = self.effect_inertia()
        tied = self.mechanism.couplings or self.mechanism.closures
        alone = all(row == column for row, column in rotors)
        if tied or not alone or not articulated:
            pairs = zip(forces, self.inertial(True, "qdd"), strict=True)
            rest = [[force - held] for force, held in pairs]
            found = solved(self.mass_array, np.array(rest, dtype=object))
            return list(found[:, 0])
        names = self.mechanism.independent_velocities
        caused = articulated_accelerations(
            self._inertias,
            self._motion("qdd"),
            dict(zip(names, forces, strict=True)),
            {names[row]: rotor for (row, _), rotor in rotors.items()},
        )
        return [caused[name] for name in names]

    @property
    def mass_array(self) -> Array:
        """The mass matrix, effects included."""
        size = len(self.mechanism.independent_velocities)
        found = np.empty((size, size), dtype=object)
        for index, entry in self.masses().items():
            found[index] = entry
        return found
