"""Values modulo p of closure equations and their Jacobian, at poses and along curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from echelon.arrays import Integers
from echelon.errors import UnknownRelationsError
from echelon.exact import series
from echelon.exact.field import PrimeField, Residues
from echelon.program.arithmetics import SeriesArithmetic
from echelon.program.canonical import Turn
from echelon.program.operations import Op
from echelon.program.schedule import Schedule
from echelon.program.tape import Program
from echelon.program.zero_dimensional import Solver
from echelon.regressor.loops.closures import Wrist
from echelon.regressor.loops.moving import Layout, MovingCoordinates, Pose, times


@dataclass(frozen=True)
class Recorded:
    """Closure equations on a program, and what its leaves mean."""

    program: Program
    functions: Sequence[int]  # nodes that are evaluated as a whole, such as sines
    layout: Layout
    nodes: Sequence[int]  # the closure equations
    equations: Schedule  # of these
    slopes: Schedule  # of the entries of the Jacobian
    entries: Sequence[tuple[int, str]]  # equation and freedom of every entry of the Jacobian
    owners: tuple[str, ...]  # name of the closure of every equation
    wrists: Sequence[Wrist]
    stated: Schedule  # of the exact positions of the stated pose
    # the motions that have some, in how many parts an angle counts, and how many numbers each has
    closing_motions: Sequence[tuple[str, int, int]]
    turns: Mapping[int, Turn]  # angles of the nodes that are sines and cosines
    # generators that are parts of angles of coordinates, with their place among those that turn
    turning: Mapping[str, int]
    units: Residues  # (turning coordinates,): the number of parts
    solver: Solver = field(default_factory=Solver)  # of loops, which may be alike

    @property
    def threaded(self) -> list[int]:
        """Turning coordinates whose angle as such occurs in the closure equations."""
        inputs = self.program.inputs
        names = {inputs[node].name for node in self.equations.leaves if node in inputs}
        places = zip(self.layout.turning, self.layout.turn_places[:, 0].tolist(), strict=True)
        return [place for motion, place in places if f"q[{motion.name}]" in names]

    @property
    def geared(self) -> list[int]:
        """Turning coordinates of which sines and cosines of multiples occur in the closure equations."""
        turns = [self.turns[node] for node in self.equations.leaves if node in self.turns]
        found = {
            self.turning[g] for turn in turns for g, n in turn.multiples.items() if g in self.turning and abs(n) > 1
        }
        return [int(self.layout.turn_places[k, 0]) for k in sorted(found)]

    def moving(self, leaves: Iterable[int]) -> set[str]:
        """Names of the velocities of what some leaves depend on."""
        leaves, inputs, layout = list(leaves), self.program.inputs, self.layout
        turns = {g for node in leaves if node in self.turns for g in self.turns[node].multiples}
        found = {layout.turning[self.turning[g]] for g in turns if g in self.turning}
        names = {inputs[node].name for node in leaves if node in inputs}
        found |= {m for m in layout.motions if not names.isdisjoint(f"q[{p}]" for p in m.positions)}
        return {name for motion in found for name in motion.velocities}

    def schedule(self, nodes: Sequence[int], known: Iterable[int] = ()) -> Schedule:
        """Schedule of some nodes that depend on positions, from others that are known."""
        return Schedule(self.program, nodes, [*self.functions, *known])

    def unmoved(self, nodes: Sequence[int], unknown: Set[str]) -> list[int]:
        """What some nodes are computed from that does not depend on some coordinates, given by their velocities."""
        program, functions = self.program, set(self.functions)
        moved, found = set[int](), set[int]()
        for node in program.needed(nodes, functions):
            if node in functions or node in program.inputs:
                if not unknown.isdisjoint(self.moving([node])):
                    moved.add(node)
            elif not moved.isdisjoint(operands := {program.lhs[node], program.rhs[node]} - {-1}):
                moved.add(node)
                found |= operands
        return sorted((found | set(nodes)) - moved)


@dataclass(frozen=True)
class Positions:
    """Evaluates what depends on positions, for the constants of some samples."""

    recorded: Recorded
    field: PrimeField
    samples: int
    leaves: Mapping[int, Residues]  # values of leaves that do not move
    circles: Mapping[str, Residues]  # circle points (samples, 2) of angles that do not, by generator
    geometry: Mapping[str, Residues]  # the symbols' values that they were found from

    def at(self, samples: Integers) -> Positions:
        """Positions of the samples with the given indices, which may repeat."""
        leaves = {node: x[samples] for node, x in self.leaves.items()}
        circles, geometry = ({k: x[samples] for k, x in part.items()} for part in (self.circles, self.geometry))
        return replace(self, samples=len(samples), leaves=leaves, circles=circles, geometry=geometry)

    def resting(self, pose: Pose) -> MovingCoordinates:
        """Coordinates at a pose, as series of one coefficient."""
        return MovingCoordinates.resting(self.recorded.layout, self.recorded.units, self.field, pose)

    def equations(
        self, pose: Pose, schedule: Schedule | None = None, known: Mapping[int, Residues] | None = None
    ) -> Residues:
        """Closure equations at poses, all or those of a schedule from what is known, (samples, equations)."""
        return self._run(schedule or self.recorded.equations, self.resting(pose), known)[..., 0].T

    def along(self, moving: MovingCoordinates) -> Residues:
        """Closure equations along curves, (samples, equations, order)."""
        return self._run(self.recorded.equations, moving).transpose(1, 0, 2)

    def slopes(self, moving: MovingCoordinates, names: Sequence[str] | None = None) -> Residues:
        """Derivatives of the equations by all or the named velocities, (samples, equations, velocities, order)."""
        recorded = self.recorded
        columns = {name: k for k, name in enumerate(names or recorded.layout.names)}
        jacobian = np.zeros((moving.samples, len(recorded.owners), len(columns), moving.order), dtype=np.int64)
        for (row, name), value in zip(recorded.entries, self._run(recorded.slopes, moving), strict=True):
            if name in columns:
                jacobian[:, row, columns[name]] = value
        return jacobian

    def exact_pose(self, pose: Pose) -> Pose | None:
        """A pose changed to the stated one where loops are concerned; None if that is not exact.

        There is none either where functions need smaller parts of angles than couplings do.
        """
        recorded, layout = self.recorded, self.recorded.layout
        if not recorded.closing_motions:
            return None
        values = self._run(recorded.stated, self.resting(pose))[..., 0]
        travels = [layout.names[place] for place in recorded.threaded]
        for name, parts, size in recorded.closing_motions:
            own, values = values[:size], values[size:]
            place = next((k for k, motion in enumerate(layout.turning) if motion.name == name), None)
            if place is not None:
                count, rest = divmod(parts, int(recorded.units[place]))
                if rest and not (own[0] == 1).all():
                    return None
                if name in travels:
                    pose.angles[:, place] = own[-1]
                own = np.stack(self.field.multiply_angle((own[0], own[1]), count))
            pose.numbers[:, layout.columns[name]] = own.T
        return pose

    def jacobian(self, pose: Pose) -> Residues:
        """Derivatives of the closure equations by all velocities at poses, (samples, equations, velocities)."""
        result: Residues = self.slopes(self.resting(pose))[..., 0]
        return result

    def leaf(self, node: int, moving: MovingCoordinates) -> Residues:
        """Value of a constant, of a function of positions, or of a position, (samples, order)."""
        recorded = self.recorded
        if node in self.leaves:
            return series.constant(self.leaves[node], moving.order)
        if node in recorded.turns:
            return self._turned(node, moving)
        name = recorded.program.inputs[node].name
        if name not in recorded.layout.inputs:
            raise UnknownRelationsError(f"{name} in a mechanism with loops")
        kind, place = recorded.layout.inputs[name]
        values: Residues = getattr(moving, kind)[:, place]
        return values

    def _run(
        self, schedule: Schedule, moving: MovingCoordinates, known: Mapping[int, Residues] | None = None
    ) -> Residues:
        known = known or {}
        leaves = {n: known[n][..., None] if n in known else self.leaf(n, moving) for n in schedule.leaves}
        return schedule.run(SeriesArithmetic(self.field, moving.order), leaves, moving.samples)

    def _turned(self, node: int, moving: MovingCoordinates) -> Residues:
        """Sine or cosine of a sum of angles."""
        recorded, points = self.recorded, []
        for generator, count in recorded.turns[node].multiples.items():
            if generator in recorded.turning:
                point = moving.numbers[:, recorded.layout.turns[recorded.turning[generator]]]
            else:
                point = series.constant(self.circles[generator], moving.order)
            points.append(_multiplied(point, count, self.field))
        point = reduce(lambda a, b: times(a, b, self.field), points)
        return point[:, 0 if recorded.program.ops[node] == Op.COS else 1]


def _multiplied(point: Residues, count: int, field: PrimeField) -> Residues:
    """A multiple of an angle, from its cosine and sine (samples, 2, order)."""
    turned = point.copy()
    if count < 0:
        turned[:, 1] = -point[:, 1] % field.p
    total = turned
    for bit in bin(abs(count))[3:]:  # doubled for every binary digit, so that large ratios cost little
        total = times(total, total, field)
        total = times(total, turned, field) if bit == "1" else total
    return total
