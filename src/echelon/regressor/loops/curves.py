"""Random motions of a mechanism with loops, modulo primes: power series along random curves of closed configurations.

There are no random points of a finite field at which loops close; but from one closed pose, random series for some
coordinates continue to closed series for all (Newton's iteration, which doubles the number of known coefficients).  The
coefficients of a row along such curves span what the row spans at all configurations that the pose can be moved to.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import islice
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, one_thread
from echelon.errors import ShakyPoseError, SingularPoseError, UnknownRelationsError
from echelon.exact import series
from echelon.exact.field import DEFAULT_SEED, PrimeField, Residues, random_generator, rank
from echelon.mechanism.closed_pose import angle_parts, shown_loops
from echelon.program.canonical import Turn
from echelon.program.generators import GeneratorValues, generators_of
from echelon.program.operations import Op
from echelon.program.region import COMPLETE, SAMPLED, RegionReport, one_sided
from echelon.program.sampling import FunctionSampler
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.surfaces import IndependentRegions, find_surfaces, monomials
from echelon.program.tape import Program
from echelon.regressor.loops.closed_curve import ClosedCurve, Exponentials, lift
from echelon.regressor.loops.closures import Loops
from echelon.regressor.loops.moving import Layout, Pose
from echelon.regressor.loops.poses import PoseFinder
from echelon.regressor.loops.positions import Positions, Recorded

_LOST = 2  # coefficients that are not known of accelerations
_PRODUCT, _LIFTS = 0.25, 3  # what a product of series costs, of order², and how often closures are evaluated
_VARIANTS = 6  # closed poses that are looked at for the one with the most freedom
_SURPLUS = 3  # halves: that many more coefficients are taken than states, because some are not independent

_REAL_STATES = 256
_SPEEDS = 10 ** np.linspace(-6, 6, 25)
_MOST_PRODUCTS, _MOST_REGIONS = 512, 64

T = TypeVar("T")


class CurveSampler(FunctionSampler):
    """Evaluates outputs of a program along random curves of closed configurations."""

    def __init__(self, program: Program, outputs: Sequence[int], loops: Loops) -> None:
        if loops.mechanism.closed_in_balls:
            problem = f"no exact closed pose is known for {shown_loops(loops.mechanism)}"
            raise SingularPoseError(f"{problem}: take base_parameters or sensor_report, which do without one")
        closing = loops.equations
        known = [node for nodes in loops.exact_pose.values() for node in nodes]
        wrists = list(loops.wrists())
        centres = [node for wrist in wrists for node in wrist.centre]
        parts = [outputs, closing.equations, closing.jacobian.values(), known, (loops.speeds or {}).values(), centres]
        super().__init__(program, [node for part in parts for node in part])
        self.loops, self.order = loops, loops.order
        layout = Layout(loops.mechanism.free_motions)
        functions = [n for n in self._schedule.leaves if n not in self.program.inputs]
        nodes = iter(self.outputs)  # the same on the program of the sampler
        main, equations, slopes, known, speeds, centres = (list(islice(nodes, len(part))) for part in parts)
        if self._arcs:
            raise UnknownRelationsError("an arc tangent of what moves in a mechanism with loops")
        self._main_outputs = main
        self._main = Schedule(self.program, main, functions)
        self._speeds = Schedule(self.program, speeds, functions)
        turns, turning = self._moving_turns(layout)
        angles = angle_parts(loops.mechanism) if loops.exact_pose else {}
        moving = [n for n in self._functions if self.program.ops[n] == Op.EXP and self._moves(n)]
        self._exponentials = Exponentials(self.canonical, moving, self._sign_leaves, functions)
        units = np.ones(len(layout.turning), dtype=np.int64)
        for generator, place in turning.items():
            units[place] = self.canonical.unit(generator)
        self._recorded = Recorded(
            self.program,
            functions,
            layout,
            equations,
            Schedule(self.program, equations, functions),
            Schedule(self.program, slopes, functions),
            list(closing.jacobian),
            closing.owners,
            [replace(wrist, centre=tuple(centres[3 * k : 3 * k + 3])) for k, wrist in enumerate(wrists)],
            Schedule(self.program, known, functions),
            [(name, angles.get(name, 1), len(nodes)) for name, nodes in loops.exact_pose.items()],
            turns,
            turning,
            units,
        )
        self._poses = PoseFinder(loops, layout.names)

    def with_order(self, order: int | None) -> CurveSampler:
        """The sampler with another number of coefficients along curves; both know the poses that were found."""
        other = copy(self)
        other.order = self.order if order is None else order
        return other

    def evaluate(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues]
    ) -> Residues:
        """Evaluate along random curves for given geometries.

        The coefficients of all curves of a geometry are put together to as many random combinations as there are
        states, so that each state is as good as any.

        See :meth:`echelon.program.schedule.FieldSampler.evaluate`.
        """
        return self.from_pose(field, rng, geometry, lambda pose: self.evaluate_at(field, rng, states, geometry, pose))

    @one_thread()
    def from_pose(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], found: Callable[[Pose], T]
    ) -> T:
        """What is found from a closed pose for every geometry; where the stated one is singular, from another."""
        positions = self._positions(field, rng, geometry)
        while True:
            try:
                return found(self._poses.find(positions, rng))
            except SingularPoseError:
                if not self._poses.leave_stated():
                    raise

    @property
    def at_stated_pose(self) -> bool:
        """Whether the poses that were found are the stated one, exactly."""
        return self._poses.takes_stated

    def variants(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], pose: Pose, count: int
    ) -> Pose:
        """A closed pose of one geometry and others that share some of its coordinates."""
        return self._poses.variants(self._positions(field, rng, geometry), pose, count, rng)

    def evaluate_at(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues], pose: Pose
    ) -> Residues:
        """Evaluate along random curves from given closed poses; see :meth:`evaluate`."""
        positions = self._positions(field, rng, geometry)
        geometries, curves = positions.samples, self._curves(states)
        positions = positions.at(np.repeat(np.arange(geometries), curves))
        signs = self._signs(field, rng, geometries * curves)
        moving = lift(positions, pose.repeated(curves), self.order + _LOST, rng)
        curve = ClosedCurve(positions, moving, rng, self.loops.speeds, self._speeds, signs, self._exponentials)
        values = self._main.run(curve.arithmetic, curve.leaves(self._main), geometries * curves)[..., : self.order]
        return _mixed(values.reshape(len(values), geometries, curves * self.order), states, field, rng)

    def cost(self, program: int, states: int) -> float:
        """Operations on residues that the states of one geometry take."""
        closing = len(self.program.needed(self._recorded.nodes)) + len(self._recorded.entries)
        return _PRODUCT * self._curves(states) * self.order**2 * (program + _LIFTS * closing)

    def _curves(self, states: int) -> int:
        return max(1 + -(-_SURPLUS * states // (2 * self.order)), len(self._closed_regions[0]))

    def jacobian(self, field: PrimeField, rng: np.random.Generator, order: int = 0) -> Residues:
        """Jacobian of the closures by all coordinates at a closed pose of a random geometry.

        Of some poses it is the one with the most freedom from which a curve goes on, as half of the coefficients up to
        an order show; ShakyPoseError if there is none.
        """
        geometry = {s: field.draw(rng, (1,)) for s in self.symbols}
        positions = self._positions(field, rng, geometry)

        def found(pose: Pose) -> Residues:
            several = self._poses.variants(positions, pose, _VARIANTS, rng)
            jacobians: Residues = positions.at(np.zeros(len(several.numbers), dtype=np.intp)).jacobian(several)
            for k in sorted(range(len(jacobians)), key=lambda k: rank(jacobians[k], field)):
                try:
                    if order:
                        lift(positions, several.at(np.array([k])), order, rng)
                except SingularPoseError:
                    continue
                chosen: Residues = jacobians[k]
                return chosen
            raise ShakyPoseError("at closed poses, velocities are possible from which no motion goes on")

        return self.from_pose(field, rng, geometry, found)

    # -- signs -----------------------------------------------------------------------------------------------------

    @property
    def regions(self) -> int:
        """1: every state is a combination of curves through all regions."""
        return 1

    @property
    def signs(self) -> tuple[int, str]:
        """Number of regions of signs that are visited, 0 without signs, and what is known of others."""
        report = self._closed_regions[1]
        return (report.count, str(report)) if self._sign_leaves else (0, "")

    @property
    def unseen_regions(self) -> str:
        """Words about regions of signs that may add something and were not visited; empty if there are none."""
        return self._closed_regions[1].unseen if self._sign_leaves else ""

    @cached_property
    def _closed_regions(self) -> tuple[npt.NDArray[np.int64], RegionReport]:
        """Signs that occur together on closed configurations, (regions, nodes that are signs), and what is said."""
        if not self._sign_leaves:
            return np.ones((1, 0), dtype=np.int64), RegionReport(1, COMPLETE)
        states = self.loops.real(random_generator(DEFAULT_SEED), _REAL_STATES)
        return _regions_at(self.program, self._main_outputs, self._sign_leaves, states)

    def _signs(self, field: PrimeField, rng: np.random.Generator, samples: int) -> dict[int, Residues]:
        """Values of the nodes that are signs: regions take turns, in random order."""
        regions = self._closed_regions[0]
        order = np.concatenate([rng.permutation(len(regions)) for _ in range(1 + samples // len(regions))])
        chosen = regions[order[:samples]] % field.p
        return {node: chosen[:, k] for k, node in enumerate(self._sign_leaves)}

    # -- leaves ----------------------------------------------------------------------------------------------------

    def _moving_turns(self, layout: Layout) -> tuple[dict[int, Turn], dict[str, int]]:
        """Sines and cosines of what moves, and the generators that are parts of angles of coordinates."""
        place = {f"q[{m.name}]": k for k, m in enumerate(layout.turning)}
        sources = {self.canonical.input_generator(n).name: e.name for n, e in self.program.inputs.items()}
        turns: dict[int, Turn] = {}
        turning: dict[str, int] = {}
        for node in self._functions:
            if self._moves(node) and self.program.ops[node] == Op.EXP:
                continue
            unknown = f"{Op(self.program.ops[node]).name.lower()} of what moves in a mechanism with loops"
            if self.canonical.signed(node):
                raise UnknownRelationsError(unknown)
            form = self.canonical.form(node, ())
            moving = {g for g in generators_of(form) if not self.canonical.generators[g].constant}
            for name in moving:
                inner = self.canonical.generators[name].element.symbols()
                source = sources.get(inner[0], "") if len(inner) == 1 else ""
                if not isinstance(form, Turn) or source not in place:
                    raise UnknownRelationsError(unknown)
                turning[name] = place[source]
                turns[node] = form
        return turns, turning

    def _moves(self, node: int) -> bool:
        """Whether a function's argument depends on the motion."""
        needed = self.program.needed([self.program.lhs[node]])
        return any(n in self.program.inputs and self.program.inputs[n].role == "state" for n in needed)

    def _positions(self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues]) -> Positions:
        """The given geometries, with random values for what else is constant."""
        samples = len(next(iter(geometry.values()))) if geometry else 1
        inputs = [n for n in self._inputs if self._is_symbol(n)]
        forms = {n: self.canonical.form(n, ()) for n in self._functions if n not in self._exponentials.nodes}
        wanted = {g for form in forms.values() for g in generators_of(form)} - self._recorded.turning.keys()
        drawn = GeneratorValues(self.canonical, field, rng, geometry, {}, samples, self._constants())
        generators = drawn.draw(wanted, inputs)
        circles = self._circles(generators, field)
        values = {n: drawn.inputs[n] for n in inputs}
        everywhere = np.arange(samples)
        for node in forms.keys() - self._recorded.turns.keys():
            values[node] = self._combined(node, [((), everywhere)], generators, circles, field, samples)
        points = {name: np.stack(point, axis=-1) for name, point in circles.items()}
        return Positions(self._recorded, field, samples, values, points, geometry)


def _mixed(values: Residues, states: int, field: PrimeField, rng: np.random.Generator) -> Residues:
    """Random combinations of the coefficients of all curves of a geometry."""
    weights = field.draw(rng, (values.shape[2], states))
    return series.matrix_product(values[..., None], weights[..., None], field)[..., 0]


def _regions_at(
    program: Program, outputs: Sequence[int], signs: Sequence[int], states: Mapping[str, Floats]
) -> tuple[npt.NDArray[np.int64], RegionReport]:
    """Signs that occur together in closed states, and what is said of them.

    Closed states cannot be moved at will, but a motion can be run at any speed: q̇ times s and q̈ times s² keep loops
    closed.  So random states, each at speeds of all orders of magnitude, show which signs occur together, however
    narrow a dead zone of a speed is.  Of these regions those are kept that add something.
    """
    arguments = [program.lhs[node] for node in signs]
    schedule = Schedule(program, arguments)
    inputs = {node: _at_all_speeds(program.inputs[node].name, states) for node in schedule.leaves}
    count = len(next(iter(states.values()))) * len(_SPEEDS)
    table = np.sign(schedule.run(FloatArithmetic(), inputs, count)).astype(np.int8)
    found = np.unique(table[:, (table != 0).all(axis=0)], axis=1)
    row = {node: k for k, node in enumerate(arguments)}
    surfaces = find_surfaces(program, outputs)
    products = monomials(surfaces, {n: 0 for n in surfaces.nodes if n not in row}, _MOST_PRODUCTS)
    rows = None if products is None else [tuple((row[n], e) for n, e in p) for p in products]
    independent = IndependentRegions(rows)
    kept = independent.include(found, lambda _: True)[:_MOST_REGIONS]
    ended = COMPLETE if independent.complete and len(kept) == independent.rank else SAMPLED
    seen = [(node, set(found[k].tolist())) for k, node in enumerate(arguments)]
    remarks = tuple(one_sided(program, node, side.pop()) for node, side in seen if len(side) == 1)
    return found[:, kept].T.astype(np.int64), RegionReport(len(kept), ended, remarks)


def _at_all_speeds(name: str, states: Mapping[str, Floats]) -> Floats:
    power = {"qd": 1, "qdd": 2}.get(name.partition("[")[0], 0)
    scaled: Floats = (states[name][:, None] * _SPEEDS**power).ravel()
    return scaled
