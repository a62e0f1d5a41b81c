"""Linear forms: a sparse matrix of program nodes, y = X ζ with X recorded as a program; and blocks of it.

Blocks are groups of joints that are moved alone, so that only the bodies that they carry are seen.  Rows of X in which
one block alone has a virtual motion, like differences of the energy between two positions of one block, contain nothing
but the columns of the bodies that the block carries.  Written block by block, from the tips to the base, such rows make
a block triangular matrix.  Where the small matrix of every block's own columns has full rank, all these columns are
independent, whatever stands beside the diagonal: that proves most of the rank of a long chain or a large tree at the
cost of its bodies.

Energy rows are the total mechanical energy as a linear form in the standard parameters.  When every independent
coordinate's generalised force is measured, y = X ζ vanishes for all motions exactly if the kinetic energy vanishes and
the potential energy is constant: y = M q̈ + C q̇ + g is linear in q̈ with coefficient M, the Hessian of the kinetic
energy, and then g is the gradient of the potential.  So the rows [1, E(q, q̇)] have the null space of X (with a leading
column for the constant), need no accelerations, and cost a fraction of Newton–Euler.  They find the structure; the
certificate then checks the result on X itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial, reduce
from typing import TYPE_CHECKING

import numpy as np

from echelon.exact.field import PrimeField, Residues, rank, reduced_echelon
from echelon.exact.polynomial import Rational
from echelon.mechanism.effect import Side
from echelon.mechanism.joint import ALL, GROUND
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import GENERAL, StatedValues
from echelon.program.sampling import FieldSampler
from echelon.program.tape import Program, Scalar
from echelon.regressor.steps import Recorder, Step, Vec, add, cross, dot, forward, into_frame, scale

if TYPE_CHECKING:
    from echelon.regressor.loops.closures import Loops

FEW_COLUMNS = 120
"""So many columns are eliminated at once in less time than block by block."""

_SURPLUS_ROWS = 4
_FIRST_STATES, _SURPLUS_STATES = 32, 8


@dataclass(frozen=True)
class Block:
    """Joints that are moved together."""

    bodies: tuple[int, ...]  # the bodies of these joints
    coordinates: tuple[str, ...]  # velocity coordinates of these joints that no coupling makes dependent
    effects: tuple[int, ...]  # effects that act there, by their place in ``mechanism.effects``
    carried: tuple[int, ...]  # blocks whose bodies hang on these bodies


def blocks_of(mechanism: Mechanism) -> tuple[Block, ...]:
    """The smallest blocks that can be moved alone and may show what their bodies carry.

    Coordinates that a coupling, an effect or shared parameters tie are moved together, with all joints between them.  A
    body whose parent
    does not carry all ten parameters keeps some that would else move to the parent; to be seen they need the parent's
    joint, too.
    """
    bodies = mechanism.bodies
    owner = {name: i for i, body in enumerate(bodies) for m in body.joint.motions for name in m.velocities}
    groups = _Groups(len(bodies))
    for index, body in enumerate(bodies):
        if body.parent != GROUND and bodies[body.parent].carried != ALL:
            groups.join((index, body.parent))
    for sharing in mechanism.sharing:
        groups.join(sharing)
    for coupling in mechanism.couplings:
        groups.join(owner[name] for name in (coupling.coordinate, *(name for name, _ in coupling.terms)))
    places = _places_of_effects(mechanism, owner)
    for some in places:
        groups.join(some)
    groups.close_paths([body.parent for body in bodies])
    number = {root: k for k, root in enumerate(dict.fromkeys(map(groups.find, range(len(bodies)))))}
    block_of = [number[groups.find(index)] for index in range(len(bodies))]
    members: list[list[int]] = [[] for _ in number]
    carried: list[set[int]] = [set() for _ in number]
    effects: list[list[int]] = [[] for _ in number]
    for index, body in enumerate(bodies):
        members[block_of[index]].append(index)
        if body.parent != GROUND and block_of[body.parent] != block_of[index]:
            carried[block_of[body.parent]].add(block_of[index])
    for k, some in enumerate(places):
        if some:
            effects[block_of[some[0]]].append(k)
    names = [[n for m in b.joint.motions if m.name not in mechanism.dependent for n in m.velocities] for b in bodies]
    return tuple(
        Block(tuple(inside), tuple(n for i in inside for n in names[i]), tuple(e), tuple(sorted(c)))
        for inside, e, c in zip(members, effects, carried, strict=True)
    )


def _places_of_effects(mechanism: Mechanism, owner: Mapping[str, int]) -> list[list[int]]:
    """For every effect, the bodies of the joints whose rows it is in."""
    drives = {a.name: [name for name, _ in a.terms] for a in mechanism.transmission.actuators}
    return [
        [owner[name] for a in effect.actions for name in ([a.at] if a.side is Side.JOINT else drives[a.at])]
        for effect in mechanism.effects
    ]


class _Groups:
    """Disjoint sets of bodies."""

    def __init__(self, size: int) -> None:
        self._above = list(range(size))

    def find(self, index: int) -> int:
        while self._above[index] != index:
            self._above[index] = index = self._above[self._above[index]]
        return index

    def join(self, bodies: Iterable[int]) -> None:
        roots = [self.find(index) for index in bodies]
        for root in roots[1:]:
            self._above[self.find(root)] = self.find(roots[0])

    def close_paths(self, parents: list[int]) -> None:
        """Join what lies between two bodies of one set, one of which carries the other."""
        changed = True
        while changed:
            changed = False
            size = Counter(map(self.find, range(len(parents))))
            for index in range(len(parents)):
                root = self.find(index)
                if size[root] == 1:
                    continue
                between, at = [index], parents[index]
                while at != GROUND and self.find(at) != root:
                    between.append(at)
                    at = parents[at]
                if at != GROUND and len(between) > 1:
                    self.join(between)
                    changed = True


@dataclass(frozen=True)
class BlockRows:
    """Rows in which one block alone moves, restricted to the block's own columns."""

    program: Program
    columns: tuple[tuple[int, ...], ...]  # for every block, the columns of its bodies and effects
    # for every block, the nodes of its entries in these columns that are not structurally zero
    entries: tuple[Mapping[tuple[int, int], int], ...]
    carried: tuple[tuple[int, ...], ...]  # for every block, those whose columns its rows contain besides

    def independent(
        self,
        columns: Collection[int],
        field: PrimeField,
        rng: np.random.Generator,
        values: StatedValues = GENERAL,
    ) -> set[int]:
        """Columns proved to be independent of one another and of all others, modulo a prime."""
        present = set(columns)
        chosen = [{key: n for key, n in entries.items() if key[1] in present} for entries in self.entries]
        owned = [[column for column in columns if column in present] for columns in self.columns]
        sampler = FieldSampler(self.program, [n for entries in chosen for n in entries.values()])
        geometry = values.draw(sampler.symbols, field, rng)
        states = max(map(len, owned), default=0) + _SURPLUS_ROWS
        residues = iter(sampler.evaluate(field, rng, states, geometry)[:, 0])
        full = []
        for entries, own in zip(chosen, owned, strict=True):
            place = {column: k for k, column in enumerate(own)}
            matrix = np.zeros((states, 1 + max((row for row, _ in entries), default=0), len(own)), dtype=np.int64)
            for row, column in entries:
                matrix[:, row, place[column]] = next(residues)
            full.append(rank(np.concatenate(matrix), field) == len(own))
        return {c for k in self._settled(full) for c in owned[k]}

    def _settled(self, full: list[bool]) -> set[int]:
        """Blocks of full rank that carry such blocks only."""
        settled: set[int] = set()
        pending = [k for k in reversed(range(len(full))) if full[k]]
        count = -1
        while count < len(settled):
            count = len(settled)
            settled |= {k for k in pending if settled.issuperset(self.carried[k])}
        return settled


def column_sums(
    mechanism: Mechanism,
    bodies: Iterable[int],
    unit: Callable[[int, int], Scalar],
    wanted: Collection[int] | None = None,
) -> dict[int, Scalar]:
    """What a unit of each standard parameter gives; bodies that share a parameter are added up."""
    total: dict[int, Scalar] = {}
    for index in bodies:
        for column, kind in enumerate(mechanism.bodies[index].carried, mechanism.first_column.get(index, 0)):
            if wanted is None or column in wanted:
                value = unit(index, kind)
                total[column] = total[column] + value if column in total else value
    return total


@dataclass(frozen=True)
class LinearForms:
    """Rows of coefficients of some parameters, recorded on a program."""

    program: Program
    entries: Mapping[tuple[int, int], int]  # node of every entry that is not structurally zero
    shape: tuple[int, int]  # numbers of rows and columns
    loops: Loops | None = None  # what keeps motions on closed configurations, where there are loops
    blocks: BlockRows | None = None  # combinations of rows, over all columns, that see little at a time
    # stated values of constants, on which the regions of signs depend
    values: Mapping[str, Rational | float] = field(default_factory=dict)
    # the same columns are asked for again and again, and a schedule costs as much as an evaluation
    _restricted: dict[tuple[int, ...], LinearForms] = field(init=False, default_factory=dict, repr=False, compare=False)
    _samplers: dict[int | None, FieldSampler] = field(init=False, default_factory=dict, repr=False, compare=False)

    def columns(self, keep: Collection[int]) -> LinearForms:
        """The forms restricted to some columns, renumbered in the given order."""
        kept = tuple(keep)
        if kept not in self._restricted:
            position = {column: i for i, column in enumerate(kept)}
            entries = {(r, position[c]): node for (r, c), node in self.entries.items() if c in position}
            self._restricted[kept] = replace(self, entries=entries, shape=(self.shape[0], len(position)))
        return self._restricted[kept]

    def sampler(self, order: int | None = None) -> FieldSampler:
        """Evaluates all entries at random states modulo primes."""
        if not self._samplers:
            nodes = list(self.entries.values())
            if self.loops is None:
                self._samplers[None] = FieldSampler(self.program, nodes, self.values)
            else:
                from echelon.regressor.loops.curves import CurveSampler  # robots without loops do without it

                self._samplers[None] = CurveSampler(self.program, nodes, self.loops)
        if order not in self._samplers:
            self._samplers[order] = self._samplers[None].with_order(order)
        return self._samplers[order]

    def stacked(self, values: Residues) -> Residues:
        """Sampled entries as matrices, one for each geometry."""
        # shapes: values (entries, geometries, states); returns (geometries, states · rows, columns)
        _, geometries, states = values.shape
        matrix = np.zeros((geometries, states, *self.shape), dtype=np.int64)
        for (row, column), value in zip(self.entries, values, strict=True):
            matrix[:, :, row, column] = value
        return matrix.reshape(geometries, states * self.shape[0], self.shape[1])

    def row_space(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], auxiliary: int = 0
    ) -> Residues:
        """A basis of the row space at one geometry; of rows that are free of auxiliary columns, without these.

        Most forms show much less than they have columns, so states are few at first.
        """
        sampler, columns = self.sampler(), self.shape[1]
        states, seen = max(min(_FIRST_STATES, columns + _SURPLUS_STATES), sampler.regions), -1
        while True:
            reduced, pivots = reduced_echelon(self.stacked(sampler.evaluate(field, rng, states, geometry))[0], field)
            enough = states >= min(len(pivots), columns) + _SURPLUS_STATES
            if enough and (sampler.regions == 1 or len(pivots) == seen):
                break
            # with too few states, or because a region of signs may have more to show
            states, seen = 2 * states, len(pivots) if enough else -1
        kept = [k for k, pivot in enumerate(pivots) if pivot >= auxiliary]
        rows = [[int(reduced[k, c]) for c in range(auxiliary, columns)] for k in kept]
        return np.array(rows, dtype=np.int64).reshape(len(kept), columns - auxiliary)

    def operations(self) -> dict[str, int]:
        """Operations needed to evaluate all entries, by kind."""
        return self.program.count(self.entries.values())

    def __repr__(self) -> str:
        return f"LinearForms({self.shape[0]} × {self.shape[1]}, {len(self.entries)} entries, {self.program})"


@dataclass(frozen=True)
class _Rates:
    """Angular and linear velocity and gravity in a frame's axes; ``lift`` is −g·p of its origin."""

    angular: Vec
    linear: Vec
    gravity: Vec
    lift: Scalar


def energy_form(mechanism: Mechanism) -> LinearForms:
    """Record E(q, q̇) = kinetic + potential energy, one row: the constant 1, then a column per standard parameter."""
    program = Program()
    recorder = Recorder(mechanism, program)
    rates = _all_rates(recorder)
    energies = {index: _energy_of_body(rates[index]) for index in mechanism.first_column}
    entries = {(0, 0): program.one.node}
    for column, energy in column_sums(mechanism, energies, partial(_entry, energies)).items():
        if not energy.is_zero:
            entries[0, 1 + column] = energy.node
    loops = None
    if mechanism.closures:
        from echelon.regressor.loops.recorded_loops import loops_of  # robots without loops do without it

        loops = loops_of(mechanism, recorder)
    return LinearForms(program, entries, (1, 1 + len(mechanism.parameters)), loops)


@dataclass(frozen=True)
class Rows:
    """Forms whose null space is that of X, with some auxiliary columns before those of the parameters."""

    forms: LinearForms
    auxiliary: int  # 1 for energies, which are known up to a constant; 0 for forces

    def columns(self, keep: Sequence[int]) -> Rows:
        """The rows restricted to some parameters, renumbered in the given order."""
        chosen = [*range(self.auxiliary), *(self.auxiliary + column for column in keep)]
        return Rows(self.forms.columns(chosen), self.auxiliary)


def energy_changes(mechanism: Mechanism) -> BlockRows:
    """Record how the energy of its bodies changes when one block after the other moves from one state to another.

    A linear combination of columns whose energy is constant does not change either, so what these rows show to be
    independent is.  There is one row for each block; inputs of the second state are ``q'[...]`` and ``qd'[...]``.
    """
    program = Program()
    recorder = Recorder(mechanism, program)
    names = (f"q[{n}]" for n in mechanism.positions), (f"qd[{n}]" for n in mechanism.velocities)
    second = {name: program.input(name.replace("[", "'[", 1)) for some in names for name in some}
    moved = Recorder(mechanism, program, second)
    rates, blocks, first = _all_rates(recorder), blocks_of(mechanism), mechanism.first_column
    columns, changes = [], []
    for block in blocks:
        after: dict[int, _Rates] = {}
        differences: dict[int, list[Scalar]] = {}
        for index in block.bodies:
            parent = mechanism.bodies[index].parent
            after[index] = _advanced(after.get(parent, rates[parent]), moved.steps(index))
            if index in first:
                pairs = zip(_energy_of_body(after[index]), _energy_of_body(rates[index]), strict=True)
                differences[index] = [new - old for new, old in pairs]
        sums = column_sums(mechanism, differences, partial(_entry, differences))
        columns.append(tuple(sums))
        changes.append({(0, column): change.node for column, change in sums.items() if not change.is_zero})
    return BlockRows(program, tuple(columns), tuple(changes), tuple(block.carried for block in blocks))


def _entry(values: Mapping[int, Sequence[Scalar]], body: int, kind: int) -> Scalar:
    return values[body][kind]


def _all_rates(recorder: Recorder) -> dict[int, _Rates]:
    ground = _Rates(recorder.zeros, recorder.zeros, recorder.gravity(), recorder.program.zero)
    return forward(recorder.mechanism, ground, lambda rates, index: _advanced(rates, recorder.steps(index)))


def _advanced(rates: _Rates, steps: Iterable[Step]) -> _Rates:
    return reduce(_advance, steps, rates)


def _advance(rates: _Rates, step: Step) -> _Rates:
    linear, lift = rates.linear, rates.lift
    if step.shift is not None:
        linear = add(linear, cross(rates.angular, step.shift))
        lift = lift - dot(rates.gravity, step.shift)
    angular, linear = into_frame(step, rates.angular), into_frame(step, linear)
    for freedom in step.freedoms:
        angular = add(angular, scale(freedom.angular, freedom.rate))
        linear = add(linear, scale(freedom.linear, freedom.rate))
    return _Rates(angular, linear, into_frame(step, rates.gravity), lift)


def _energy_of_body(rates: _Rates) -> list[Scalar]:
    """Coefficients of XX … M in ½ωᵀIω + mc·(v×ω) + ½m v² − g·(m p + m c)."""
    half = Fraction(1, 2)
    wx, wy, wz = rates.angular
    vw = cross(rates.linear, rates.angular)
    first = [vw[k] - rates.gravity[k] for k in range(3)]
    inertia = [wx * wx * half, wx * wy, wx * wz, wy * wy * half, wy * wz, wz * wz * half]
    return [*inertia, *first, dot(rates.linear, rates.linear) * half + rates.lift]
