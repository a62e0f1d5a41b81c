"""Blocks: groups of joints that are moved alone, so that only the bodies that they carry are seen.

Rows of X in which one block alone has a virtual motion, like differences of the energy between two positions of one
block, contain nothing but the columns of the bodies that the block carries.  Written block by block, from the tips to
the base, such rows make a block triangular matrix.  Where the small matrix of every block's own columns has full rank,
all these columns are independent, whatever stands beside the diagonal: that proves most of the rank of a long chain or
a large tree at the cost of its bodies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.algebra import (
    SURPLUS_ROWS,
    FieldSampler,
    PrimeField,
    Program,
    rank,
    sampler_of,
)
from echelon.robot import ALL, GROUND, Mechanism, Side, StatedValues


@dataclass(frozen=True)
class MovingBlock:
    """Joints that are moved together."""

    bodies: tuple[int, ...]  # the bodies of these joints
    coordinates: tuple[
        str, ...
    ]  # velocity coordinates of these joints that no coupling makes dependent
    effects: tuple[
        int, ...
    ]  # effects that act there, by their place in ``mechanism.effects``
    carried: tuple[int, ...]  # blocks whose bodies hang on these bodies


def blocks_of(mechanism: Mechanism) -> tuple[MovingBlock, ...]:
    """The smallest blocks that can be moved alone and may show what their bodies carry.

    Coordinates that a coupling, an effect or shared parameters tie are moved together, with all joints between them.  A
    body whose parent
    does not carry all ten parameters keeps some that would else move to the parent; to be seen they need the parent's
    joint, too.
    """
    bodies = mechanism.bodies
    owner = {
        name: i
        for i, body in enumerate(bodies)
        for m in body.joint.motions
        for name in m.velocities
    }
    places = _places_of_effects(mechanism, owner)
    block_of = _tied_bodies(mechanism, owner, places)
    count = max(block_of, default=-1) + 1
    members: list[list[int]] = [[] for _ in range(count)]
    carried: list[set[int]] = [set() for _ in range(count)]
    effects: list[list[int]] = [[] for _ in range(count)]
    for index, body in enumerate(bodies):
        members[block_of[index]].append(index)
        if body.parent != GROUND and block_of[body.parent] != block_of[index]:
            carried[block_of[body.parent]].add(block_of[index])
    for k, some in enumerate(places):
        if some:
            effects[block_of[some[0]]].append(k)
    found = []
    for inside, own, behind in zip(members, effects, carried, strict=True):
        motions = [m for i in inside for m in bodies[i].joint.motions]
        free = [m for m in motions if m.name not in mechanism.dependent]
        names = tuple(name for motion in free for name in motion.velocities)
        block = MovingBlock(tuple(inside), names, tuple(own), tuple(sorted(behind)))
        found.append(block)
    return tuple(found)


def _tied_bodies(
    mechanism: Mechanism, owner: Mapping[str, int], places: Sequence[Sequence[int]]
) -> list[int]:
    """For every body the number of its block, in the order of the first bodies of blocks."""
    bodies = mechanism.bodies
    groups = _Groups(len(bodies))
    for index, body in enumerate(bodies):
        if body.parent != GROUND and bodies[body.parent].carried != ALL:
            groups.join((index, body.parent))
    for sharing in mechanism.sharing:
        groups.join(sharing)
    for coupling in mechanism.couplings:
        leaders = [name for name, _ in coupling.terms]
        groups.join(owner[name] for name in (coupling.coordinate, *leaders))
    for some in places:
        groups.join(some)
    groups.close_paths([body.parent for body in bodies])
    roots = [groups.find(index) for index in range(len(bodies))]
    number = {root: k for k, root in enumerate(dict.fromkeys(roots))}
    return [number[root] for root in roots]


def _places_of_effects(
    mechanism: Mechanism, owner: Mapping[str, int]
) -> list[list[int]]:
    """For every effect, the bodies of the joints whose rows it is in."""
    drives = {
        a.name: [name for name, _ in a.terms] for a in mechanism.transmission.actuators
    }
    found = []
    for effect in mechanism.effects:
        names: list[str] = []
        for action in effect.actions:
            match action.side:
                case Side.JOINT:
                    names.append(action.at)
                case Side.ACTUATOR:
                    names += drives[action.at]
        found.append([owner[name] for name in names])
    return found


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
    columns: tuple[
        tuple[int, ...], ...
    ]  # for every block, the columns of its bodies and effects
    # for every block, the nodes of its entries in these columns that are not structurally zero
    entries: tuple[Mapping[tuple[int, int], int], ...]
    carried: tuple[
        tuple[int, ...], ...
    ]  # for every block, those whose columns its rows contain besides

    def independent(
        self,
        columns: Collection[int],
        field: PrimeField,
        rng: np.random.Generator,
        values: StatedValues | None = None,
    ) -> set[int]:
        """Columns proved to be independent of one another and of all others, modulo a prime; none with functions."""
        present = set(columns)
        chosen = [
            {key: n for key, n in entries.items() if key[1] in present}
            for entries in self.entries
        ]
        owned = [
            [column for column in columns if column in present]
            for columns in self.columns
        ]
        nodes = [n for entries in chosen for n in entries.values()]
        if not FieldSampler.suits(self.program, nodes):
            return set()
        sampler = sampler_of(self.program, nodes)
        names = sampler.symbols
        geometry = (
            values.draw(names, field, rng)
            if values
            else {name: field.draw(rng, (1,)) for name in names}
        )
        states = max(map(len, owned), default=0) + SURPLUS_ROWS
        residues = iter(sampler.evaluate(field, rng, states, geometry)[:, 0])
        full = []
        for entries, own in zip(chosen, owned, strict=True):
            place = {column: k for k, column in enumerate(own)}
            matrix = np.zeros(
                (states, 1 + max((row for row, _ in entries), default=0), len(own)),
                dtype=np.int64,
            )
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
