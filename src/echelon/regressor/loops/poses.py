"""Closed poses modulo p: the zero or the assembly pose where that is closed, else solutions of the closure equations.

Loop after loop, as many coordinates as the closure has independent equations are unknown; the others are drawn.  Loops
that cannot be closed one after the other are closed together.  Where a loop has a wrist, a ball or three rotations
about one point, three equations bring its centre to its place, and its rotations follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from echelon.errors import DegenerateSampleError, SingularPoseError
from echelon.exact.field import Residues, rank
from echelon.regressor.loops.closed_curve import choose
from echelon.regressor.loops.closure_block import ClosureBlock
from echelon.regressor.loops.closures import Loops, Wrist
from echelon.regressor.loops.moving import Pose
from echelon.regressor.loops.positions import Positions, Recorded

_ROUNDS = 200
_FIRST_TRIES, _MOST_TRIES = 1 << 10, 1 << 12  # together, in the first round and in one of the last
_MOST_POINTS = 3**6  # at which the equations of a block are evaluated, for each sample
_LEAST_KEPT = 64  # variants of poses while loops are closed one after the other
_FAILURES = 8  # of the tries that close a loop with one unknown about once in two

Indices = npt.NDArray[np.intp]


class PoseFinder:
    """Finds closed poses of one mechanism."""

    def __init__(self, loops: Loops, names: Sequence[str]) -> None:
        self._preferred = [names.index(name) for name in loops.mechanism.independent]
        self._accepts, self._work, self._stated = loops.accepts, loops.work, loops.stated
        self._most = loops.search  # numbers that are added until one pose is found
        self.takes_stated = False  # whether the poses that are found are the stated one
        self._blocks: list[ClosureBlock] | None = None
        self._spent = 0.0  # work since a pose was found last, over all primes

    def find(self, positions: Positions, rng: np.random.Generator) -> Pose:
        """A closed pose for every sample."""
        samples, recorded = positions.samples, positions.recorded
        pose = positions.exact_pose(_random_pose(positions, rng, samples)) if self._stated else None
        self._stated = self.takes_stated = pose is not None and not positions.equations(pose).any()
        if self.takes_stated and pose is not None:
            return pose
        if self._blocks is None:
            self._blocks = self._planned(positions, rng)
            operations = len(recorded.program.needed(list(recorded.nodes)))
            # frames that follow instead would part centres that coincide, so no work is too much there
            coincide = any(len(wrist.freedoms) > len(wrist.centre) for wrist in recorded.wrists)
            if not coincide and sum(block.points for block in self._blocks) * operations > self._work:
                raise SingularPoseError("so many coordinates would have to be solved for at once that no search ends")
        found = self._solved(positions, rng, samples, self._blocks)
        self._spent = 0.0
        return found

    def variants(self, positions: Positions, pose: Pose, count: int, rng: np.random.Generator) -> Pose:
        """Closed poses of one sample that share the coordinates that were drawn, among them the given one."""
        if self.takes_stated or self._blocks is None:
            return pose
        one = np.zeros(1, dtype=np.intp)
        _, others = self._completed(positions, rng, one, pose.at(one), self._blocks, max(count, _LEAST_KEPT))
        return pose + others.at(np.sort(rng.permutation(len(others.numbers))[:count]))

    def leave_stated(self) -> bool:
        """No longer take the zero or assembly pose, because it is singular; returns whether it was taken so far."""
        before, self._stated, self.takes_stated = self.takes_stated, False, False
        return before

    # -- plan ------------------------------------------------------------------------------------------------------

    def _planned(self, positions: Positions, rng: np.random.Generator) -> list[ClosureBlock]:
        first = positions.at(np.zeros(1, dtype=np.intp))
        field = positions.field
        jacobian, owners = first.jacobian(_random_pose(positions, rng, 1))[0], positions.recorded.owners
        groups: list[tuple[list[int], list[int]]] = []  # equations, coordinates that they are the first to involve
        for owner in dict.fromkeys(owners):
            rows = [k for k, name in enumerate(owners) if name == owner]
            involved = _involved(jacobian[rows], positions)
            taken = {c for _, columns in groups for c in columns}
            columns = [c for c in involved if c not in taken]
            earlier = [k for group, _ in groups for k in group]
            needed = rank(jacobian[earlier + rows], field) - rank(jacobian[earlier], field)
            while rank(jacobian[np.ix_(rows, columns)], field) < needed:
                # what it involves is fixed by earlier loops already: close it together with the latest of them
                last = next(k for k in reversed(range(len(groups))) if set(groups[k][1]) & set(involved))
                more_rows, more = groups.pop(last)
                rows, columns, involved = more_rows + rows, more + columns, sorted({*involved, *more})
                involved = sorted({*involved, *_involved(jacobian[rows], positions)})
                earlier = [k for group, _ in groups for k in group]
                needed = rank(jacobian[earlier + rows], field) - rank(jacobian[earlier], field)
            groups.append((rows, columns))
        return [b for rows, columns in groups for b in self._planned_for(jacobian, rows, columns, positions)]

    def _planned_for(
        self, jacobian: Residues, rows: list[int], columns: list[int], positions: Positions
    ) -> list[ClosureBlock]:
        """Loops that are closed together; of wrists that are solved for, the centres come first."""
        recorded, field = positions.recorded, positions.field
        balls = recorded.layout.ball_places.ravel().tolist()
        wrists = self._wrists(jacobian, rows, columns, recorded)
        turns = {c for own in wrists.values() for c in own}
        # what gears multiply, components of balls, then screws, then what is preferred, should rather be drawn
        # solving for slides takes the least work
        preferred = [c for c in self._preferred if c not in recorded.layout.slide_places]
        wanted = [*recorded.geared, *balls, *recorded.threaded, *preferred, *(columns if turns else ())]
        last = [columns.index(c) for c in wanted if c in columns and c not in turns]
        rest = [columns[k] for k in choose(jacobian[np.ix_(rows, columns)], field, last).dependent]
        nodes: dict[str, list[int]] = {}
        for k in rows:
            nodes.setdefault(recorded.owners[k], []).append(recorded.nodes[k])
        later = []
        for wrist, own in wrists.items():
            solved = [c for c in rest if c in own]
            if len(solved) == len(wrist.centre):
                rest = [c for c in rest if c not in own]
                later.append(_block(recorded, nodes[wrist.owner][len(wrist.centre) :], solved))
                nodes[wrist.owner] = list(wrist.centre)
        return [_block(recorded, [node for own_nodes in nodes.values() for node in own_nodes], rest), *later]

    def _wrists(
        self, jacobian: Residues, rows: list[int], columns: list[int], recorded: Recorded
    ) -> dict[Wrist, list[int]]:
        """A wrist for each loop that has some of its own, with its coordinates: that of fewest preferred ones."""
        owners = {recorded.owners[k] for k in rows}
        found: dict[str, tuple[int, Wrist, list[int]]] = {}
        for wrist in (w for w in recorded.wrists if w.owner in owners):
            others = [k for k in rows if recorded.owners[k] != wrist.owner]
            turns = [c for name in wrist.freedoms if (c := recorded.layout.names.index(name)) in columns]
            if len(turns) >= len(wrist.centre) and not jacobian[np.ix_(others, turns)].any():
                shared = int(jacobian[:, turns].any(axis=1).sum()) + len(set(turns) & set(self._preferred))
                entry = shared, wrist, turns
                found[wrist.owner] = min(found.get(wrist.owner, entry), entry, key=lambda e: e[0])
        return {wrist: turns for _, wrist, turns in found.values()}

    # -- solutions -------------------------------------------------------------------------------------------------

    def _solved(self, positions: Positions, rng: np.random.Generator, samples: int, blocks: list[ClosureBlock]) -> Pose:
        found = positions.recorded.layout.empty_pose(samples)
        # a loop closes at about half of the random points, one with more unknowns more rarely, in one way on average;
        # loops that share what is drawn all close at few points, but there in many ways
        most, count = max(len(b.unknown) for b in blocks), len(blocks)
        pending, tries = np.arange(samples), 4 * count
        ever, tried, enough = np.zeros(samples, dtype=bool), 0, _FAILURES * count * 2 ** max(most, count)
        for number in range(_ROUNDS):
            tries = max(2, min(tries, min(_FIRST_TRIES << number, _MOST_TRIES) // len(pending)))
            owners = np.repeat(pending, tries)
            drawn = _random_pose(positions, rng, len(owners))
            owners, pose = self._completed(positions, rng, owners, drawn, blocks, len(owners))
            ever[owners], tried = True, tried + tries
            if tried > enough and not ever[pending].all():
                break
            if np.setdiff1d(pending, owners).size:
                tries *= 2  # not where poses are found that are in another mode
            owners, pose = self._in_mode(positions, rng, owners, pose)
            _, first = np.unique(owners, return_index=True)
            found.numbers[owners[first]], found.angles[owners[first]] = pose.numbers[first], pose.angles[first]
            pending = np.setdiff1d(pending, owners)
            if not pending.size:
                return found
        raise DegenerateSampleError("they do not close at random points")

    def _spend(self, work: float) -> None:
        """Go on while the budget lasts: loops that do not close could be tried at random points for ever."""
        self._spent += work
        if self._spent > self._most:
            raise SingularPoseError("no random point within the budget of the search has a solution")

    def _in_mode(
        self, positions: Positions, rng: np.random.Generator, owners: Indices, pose: Pose
    ) -> tuple[Indices, Pose]:
        """One closed pose for each owner that has one; those that are in another mode are dropped."""
        if self._accepts is None or not owners.size:
            return owners, pose
        _, first = np.unique(owners, return_index=True)  # which is any of them, as these come in random order
        pose, owners = pose.at(first), owners[first]
        geometry = positions.at(owners).geometry
        good = np.flatnonzero(self._accepts(positions.field, rng, geometry, pose))
        return owners[good], pose.at(good)

    def _completed(
        self,
        positions: Positions,
        rng: np.random.Generator,
        owners: Indices,
        pose: Pose,
        blocks: list[ClosureBlock],
        most: int,
    ) -> tuple[Indices, Pose]:
        """Poses closed block by block, in random order; those that do not close are dropped.

        Of every drawn pose some solutions of a block are kept, up to a number of samples, so that loops in series do
        not need more tries than others: what is lost at one block is made up for where another closes in several ways.
        """
        drawn, wanted = np.arange(len(owners)), len(np.unique(owners))
        for block in _ordered(blocks):
            chosen, pose = _closed(positions.at(owners), pose, block, lambda work: self._spend(work / wanted))
            kept = _thinned(drawn[chosen], most, rng)
            owners, drawn, pose = owners[chosen[kept]], drawn[chosen[kept]], pose.at(kept)
            if not owners.size:
                return owners, pose
        if positions.at(owners).equations(pose).any():
            raise SingularPoseError("the closure equations are not linear in each coordinate")
        return owners, pose


def _block(recorded: Recorded, nodes: Sequence[int], unknown: list[int]) -> ClosureBlock:
    screws = [recorded.layout.names[c] for c in unknown if c in recorded.threaded]
    if screws:
        problem = f"screw '{screws[0]}' would have to be solved for"
        raise SingularPoseError(
            f"{problem}: state its origin where it is while the loops are closed, so that it is zero"
        )
    geared = [recorded.layout.names[c] for c in unknown if c in recorded.geared]
    if geared:
        raise SingularPoseError(f"'{geared[0]}', of which gears take multiples or parts, would have to be solved for")
    return ClosureBlock(recorded, nodes, tuple(unknown))


def _ordered(blocks: Sequence[ClosureBlock]) -> list[ClosureBlock]:
    """Each block after those that solve for what moves in it, otherwise those that sort out most for their work first.

    Where legs carry one platform, most random poses fail to close one of them, and rotations of wrists can wait.
    """
    ordered, left = list[ClosureBlock](), list(blocks)
    while left:
        ready = [b for b in left if all(other.solved.isdisjoint(b.moving) for other in left if other is not b)]
        if not ready:
            raise SingularPoseError("loops that are closed one after the other need one another's coordinates")
        ordered.append(min(ready, key=lambda block: block.work / block.fails))
        left.remove(ordered[-1])
    return ordered


def _involved(jacobian: Residues, positions: Positions) -> list[int]:
    """Coordinates that some equations involve, balls as a whole."""
    involved = np.asarray(jacobian.any(axis=0))
    for ball in positions.recorded.layout.ball_places:
        involved[ball] = involved[ball].any()
    return [int(column) for column in np.flatnonzero(involved)]


def _random_pose(positions: Positions, rng: np.random.Generator, samples: int) -> Pose:
    layout, field = positions.recorded.layout, positions.field
    pose = layout.empty_pose(samples)
    pose.numbers[:, layout.turns] = np.stack(field.circle(field.draw(rng, (samples, len(layout.turns)))), axis=-1)
    balls = field.sphere(field.draw(rng, (3, samples, len(layout.balls))))
    pose.numbers[:, layout.balls] = np.moveaxis(balls, 0, -1)
    pose.numbers[:, layout.slides] = field.draw(rng, (samples, len(layout.slides), 1))
    pose.angles[:] = field.draw(rng, pose.angles.shape)
    return pose


def _thinned(drawn: Indices, most: int, rng: np.random.Generator) -> Indices:
    """A number of random solutions, in random order, of as many different drawn poses as there are."""
    order = rng.permutation(len(drawn))
    _, first = np.unique(drawn[order], return_index=True)
    rest = np.setdiff1d(np.arange(len(drawn)), first)[: max(len(first), _LEAST_KEPT)]
    return rng.permutation(order[np.concatenate([first, rest])[:most]])


def _closed(
    positions: Positions, pose: Pose, block: ClosureBlock, spend: Callable[[float], None]
) -> tuple[Indices, Pose]:
    """The samples for which a block closes, as often as it does, and their poses.

    Where links lie upon each other, or its equations depend on one another, they leave infinitely many solutions; there
    one more coordinate is drawn.
    """
    if not block.unknown:
        good = np.flatnonzero(~positions.equations(pose, block.equations).any(axis=1))
        return good, pose.at(good)
    if block.is_open:
        return _closed(positions, pose, block.fewer, spend)
    if block.points > _MOST_POINTS:
        raise SingularPoseError(f"{len(block.unknown)} coordinates would have to be solved for at once")
    solutions = block.solve(positions, pose, spend)
    samples = np.repeat(np.arange(len(solutions.counts)), np.maximum(solutions.counts, 0))
    closed = pose.at(samples)
    if samples.size:
        block.put(closed, np.concatenate([solutions.points[k] for k in np.unique(samples)]), positions.field)
    open_ = np.flatnonzero(solutions.counts < 0)
    if open_.size:
        more, others = _closed(positions.at(open_), pose.at(open_), block.fewer, spend)
        samples, closed = np.concatenate([samples, open_[more]]), closed + others
    return samples, closed
