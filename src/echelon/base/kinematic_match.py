"""Two robots joint by joint: which motions correspond, and how far their geometry is apart.

Positions move a tree by a product of exponentials of the screws that its motions have in the pose of zero (R. W.
Brockett, "Robotic manipulators and the product of exponentials formula", 1984).  So two trees move alike in the same
positions exactly if these screws are the same in one base frame, wherever the frames of links are put.  Screws are
compared from the base on, and each difference is taken up before the next joint is looked at: a longer link shows once.

Several explanations may be possible: a joint that counts the other way round may also be half a turn of the joint
before it.  Explanations are therefore followed side by side, and the simplest are kept.  Another zero or direction of a
joint is another convention of the same robot, and simpler than another axis.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain

import numpy as np

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.dynamics import CompiledAssembly, Kinematics
from echelon.loops import normalised
from echelon.robot import (
    GROUND,
    Mechanism,
    Motion,
    MotionKind,
)
from echelon.shared import Floats, InputError, listed

PARALLEL = 1e-6
"""Sine of an angle, or distance of axes in m, that counts as zero."""
_ALIKE = 1e-12
"""Weight of the identity beside axes when two bases are laid over one another: it decides what they leave open."""
_POSES = 4
"""Random poses in which all frames are compared: a coupling or a loop that differs shows in almost every one."""
_MOST_EXPLANATIONS = 16
"""Explanations that are followed side by side: four joints in a row may leave open which of two zeros each has."""
_CONVENTIONS = ("zero", "positive direction")
"""Differences by which a description counts positions otherwise, but describes the same axes."""


@dataclass(frozen=True)
class GeometryDifference:
    """One difference of geometry, with its size.

    Attributes
    ----------
    joint : str
        The joint of the first robot, or ``"base"``.
    kind : str
        What differs: ``"axis direction"``, ``"axis position"``, ``"positive direction"``, ``"zero"``, ``"pitch"``,
        ``"gravity"``, or ``"motion"`` for couplings and loops.
    size : float
        In the unit.
    unit : str
        ``"rad"``, ``"m"``, ``"m/rad"`` or ``"m/s²"``.
    """

    joint: str
    kind: str
    size: float
    unit: str

    def __str__(self) -> str:
        return f"{self.joint}: {self.kind} differs by {self.size:.4g} {self.unit}"


@dataclass(frozen=True, eq=False)
class JointAxis:
    """A joint axis; a prismatic joint's is nowhere in particular."""

    turns: bool
    point: Floats
    direction: Floats

    def moved_by(self, amount: float) -> Floats:
        """The displacement of the joint, shape (4, 4)."""
        move = np.eye(4)
        if self.turns:
            move[:3, :3] = turn_about(self.direction, amount)
            move[:3, 3] = self.point - move[:3, :3] @ self.point
        else:
            move[:3, 3] = amount * self.direction
        return move

    def amounts(self, child: JointAxis, wanted: JointAxis) -> list[float]:
        """Displacements of this joint that bring another axis into place: one or two, or none that matters."""
        normal = np.cross(child.direction, self.direction)
        apart = wanted.point - child.point
        parallel = np.linalg.norm(normal) < PARALLEL
        if not self.turns:
            if parallel or not child.turns:
                return []
            return [
                float(normal @ np.cross(child.direction, apart) / (normal @ normal))
            ]
        if not parallel:
            # an axis may count the other way round
            ends = wanted.direction, -wanted.direction
            return [_angle(self.direction, child.direction, end) for end in ends]
        radius = np.cross(self.direction, child.point - self.point)
        if not child.turns or np.linalg.norm(radius) < PARALLEL:
            return []
        ends = child.point - self.point, wanted.point - self.point
        return [_angle(self.direction, *ends)]


class ZeroPose:
    """Motions of a robot as a tree, with their screws and the bodies' frames in the pose of zero, base frame."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        opened = bare_tree(mechanism)
        places = {name: k for k, name in enumerate(opened.positions)}
        balls = [m.positions[0] for m in opened.motions if m.kind is MotionKind.BALL]
        zero = np.array([[float(name in balls) for name in opened.positions]])
        kinematics = Kinematics(opened)
        self.frames = homogeneous(kinematics.frames(zero)[0])
        slopes = kinematics.slopes(zero)[0]
        self.motions: list[Motion] = []
        self.parents: list[int] = []
        self.screws: list[Floats] = []
        self.bodies: list[int] = []  # of every motion: the body whose joint has it
        self.node = {GROUND: GROUND}  # of every body: the motion that it rides on
        for k, body in enumerate(mechanism.bodies):
            at = self.node[body.parent]
            for motion in body.joint.motions:
                columns = [places[name] for name in motion.positions][-3:]
                self.motions.append(motion)
                self.parents.append(at)
                self.bodies.append(k)
                self.screws.append(_screws(self.frames[k], slopes[k][..., columns]))
                at = len(self.motions) - 1
            self.node[k] = at

    def children(self, node: int) -> list[int]:
        """Motions that start from what another one moves."""
        return [k for k, parent in enumerate(self.parents) if parent == node]

    def before(self, node: int) -> list[int]:
        """A motion, and those that move it, the nearest first."""
        found = list[int]()
        while node != GROUND:
            found.append(node)
            node = self.parents[node]
        return found

    def axis(self, node: int, place: Floats) -> JointAxis:
        """The axis of a motion in a base frame that stands somewhere; of a ball, the first of its three."""
        direction, moment = _moved(place, self.screws[node])[0].reshape(2, 3)
        if self.motions[node].kind is MotionKind.TRANSLATION:
            return JointAxis(False, np.zeros(3), moment)
        # its point next to the origin of a body that it moves
        origin = (place @ self.frames[self.bodies[node]])[:3, 3]
        along = direction * (direction @ origin)
        return JointAxis(True, np.cross(direction, moment) + along, direction)

    def shape(self, node: int) -> str:
        """The kinds of a motion and of all behind it, whatever their order."""
        behind = sorted(self.shape(child) for child in self.children(node))
        return f"{self.motions[node].kind.value}({' '.join(behind)})"


def bare_tree(mechanism: Mechanism) -> Mechanism:
    """The bodies and joints of a robot alone, so that all joints move freely."""
    return replace(
        mechanism,
        couplings=(),
        closures=(),
        independent=(),
        actuators=(),
        effects=(),
        measured=None,
    )


def homogeneous(frames: Floats) -> Floats:
    """Frames (..., 3, 4) as matrices (..., 4, 4)."""
    last = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*frames.shape[:-2], 1, 4))
    return np.concatenate([frames, last], axis=-2)


def _screws(frame: Floats, slopes: Floats) -> Floats:
    """Direction and moment about the base's origin of the motions that slopes (3, 4, n) of a frame belong to."""
    found = []
    for slope in np.moveaxis(slopes, -1, 0):
        spin = slope[:, :3] @ frame[:3, :3].T
        turn = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        screw = np.concatenate([turn, slope[:, 3] - spin @ frame[:3, 3]])
        size = np.linalg.norm(turn)
        found.append(screw / (size if size > 0.5 else np.linalg.norm(screw[3:])))
    return np.array(found)


def _moved(place: Floats, screws: Floats) -> Floats:
    """Screws (n, 6) in another base frame."""
    directions = screws[:, :3] @ place[:3, :3].T
    moments = screws[:, 3:] @ place[:3, :3].T + np.cross(place[:3, 3], directions)
    return np.hstack([directions, moments])


@dataclass(frozen=True, eq=False)
class Correspondence:
    """Motions of two robots that correspond, and what their geometry has apart.

    Attributes
    ----------
    first, second : ZeroPose
    pairs : tuple of (int, int)
        Places of motions that correspond, parents first.
    moves : mapping of int to array of shape (4, 4)
        For every motion of the first, and the ground, the movement from the first base frame to the second that lays
        what it carries over its counterpart in the pose of zero.
    zeros : mapping of int to float
        Displacements of motions of the first that lay its axes over those of the second, rad or m, where not zero.
    differences : tuple of GeometryDifference
    deviation : float
        The largest difference that counts as none, rad or a share of the robot's size.
    """

    first: ZeroPose
    second: ZeroPose
    pairs: tuple[tuple[int, int], ...]
    moves: Mapping[int, Floats]
    zeros: Mapping[int, float]
    differences: tuple[GeometryDifference, ...]
    deviation: float

    @property
    def grave(self) -> tuple[GeometryDifference, ...]:
        """Differences of what is described, not of how positions are counted."""
        return tuple(d for d in self.differences if d.kind not in _CONVENTIONS)

    @cached_property
    def names(self) -> dict[str, str]:
        """Names of coordinates of the first robot by those of the second."""
        found: dict[str, str] = {}
        for i, j in self.pairs:
            ours, theirs = self.first.motions[i], self.second.motions[j]
            found[theirs.name] = ours.name
            found |= dict(zip(theirs.positions, ours.positions, strict=True))
            found |= dict(zip(theirs.velocities, ours.velocities, strict=True))
        return found

    def places(self, first: Sequence[str], second: Sequence[str]) -> list[int]:
        """For every coordinate of the second robot, the place of its counterpart among those of the first."""
        return [list(first).index(self.names[name]) for name in second]


def correspondences(
    first: Mechanism,
    second: Mechanism,
    angle: float,
    length: float,
    pulls: tuple[Floats, Floats],
    *,
    same_positions: bool,
) -> list[Correspondence]:
    """Pair the motions of two robots and name the differences of their geometry, in all of the simplest ways.

    Axes agree up to an angle (rad) and a length (m).  ``pulls`` are the gravities of both, or their directions.
    Without ``same_positions`` another zero or direction of a joint is as simple as none, and preferred to another base.
    Robots with other joints are refused.
    """
    ours, theirs = ZeroPose(first), ZeroPose(second)
    pairs = _paired(first, second, ours, theirs)
    limits = {"rad": angle, "m": length, "m/rad": length}
    turns = [np.eye(3)]
    if pairs:
        turns += _base_turns(ours, theirs, pairs, pulls)
    starts = []
    for k, turn in enumerate(turns):
        place = np.eye(4)
        place[:3, :3] = turn
        apart = float(np.linalg.norm(turn @ pulls[0] - pulls[1]))
        tilted = apart > angle * max(float(np.linalg.norm(pulls[0])), 1.0)
        tilt = [GeometryDifference("base", "gravity", apart, "m/s²")] * tilted
        # the base as it stands, or shifted by what axes ask for
        free = np.eye(3)[:, : 3 if k else 0]
        start = {GROUND: place}, tuple(tilt), free
        starts.append(_Explanation(ours, theirs, limits, same_positions, *start))
    found = dict[str, Correspondence]()
    for best in _simplest(starts, pairs):
        same = Correspondence(
            ours,
            theirs,
            tuple(pairs),
            best.moves,
            best.zeros,
            best.found,
            best.deviation,
        )
        if all(difference.kind == "gravity" for difference in best.found):
            away = _moves_otherwise(first, second, same, length)
            same = replace(same, differences=(*best.found, *away))
        found.setdefault("; ".join(map(str, same.differences)), same)
    return list(found.values())


def _simplest(
    starts: Sequence[_Explanation], pairs: Sequence[tuple[int, int]]
) -> list[_Explanation]:
    """The simplest explanations, the plainest way first: where nothing differs no other one is sought."""
    found = list(starts)
    for most in (1, _MOST_EXPLANATIONS):
        found = list(starts)
        for i, j in pairs:
            further = chain.from_iterable(one.steps(i, j) for one in found)
            found = sorted(further, key=lambda one: one.cost)[:most]
        if not any(found[0].cost):
            break
    return [one for one in found if one.cost == found[0].cost]


def _paired(
    first: Mechanism, second: Mechanism, ours: ZeroPose, theirs: ZeroPose
) -> list[tuple[int, int]]:
    """Motions that correspond, parents first: by name where the names agree, else by shape of the tree and axes."""
    names = [{motion.name for motion in robot.motions} for robot in (ours, theirs)]
    only = names[0] - names[1], names[1] - names[0]
    pairs: list[tuple[int, int]] = []
    waiting = [(GROUND, GROUND)]
    while waiting:
        at = waiting.pop(0)
        mine, others = ours.children(at[0]), theirs.children(at[1])
        if len(mine) != len(others):
            carriers = [
                "base" if k == GROUND else pose.motions[k].name
                for pose, k in zip((ours, theirs), at, strict=True)
            ]
            lacking = [
                f"only {robot.name} has {listed(sorted(own))}"
                for robot, own in zip((first, second), only, strict=True)
                if own
            ]
            raise InputError(
                f"'{carriers[0]}' carries {len(mine)} moving bodies, its counterpart '{carriers[1]}' {len(others)}: "
                f"{'; '.join(lacking) or 'the trees differ'}; lock what one of them lacks"
            )
        costs = [(_unlike(ours, theirs, i, j), i, j) for i in mine for j in others]
        chosen: dict[int, int] = {}
        for _, i, j in sorted(costs):
            if i not in chosen and j not in chosen.values():
                _check_pair(ours.motions[i], theirs.motions[j], only[0])
                chosen[i] = j
        pairs += chosen.items()
        waiting += chosen.items()
    return pairs


def _check_pair(one: Motion, other: Motion, lacking: set[str]) -> None:
    where = f"joints '{one.name}' and '{other.name}'"
    if one.kind is not other.kind:
        problem = f"one is a {one.kind.value}, the other a {other.kind.value}"
        raise InputError(problem, element=where)
    if one.name != other.name and one.name not in lacking:
        problem = f"'{one.name}' hangs elsewhere in the second robot: the trees differ"
        raise InputError(problem, element=where)


def _unlike(
    ours: ZeroPose, theirs: ZeroPose, i: int, j: int
) -> tuple[bool, bool, float]:
    """How badly two motions go together: other names, then other trees behind, then other axes."""
    other_shape = ours.shape(i) != theirs.shape(j)
    apart = 0.0
    if not other_shape:
        apart = float(np.linalg.norm(ours.screws[i] - theirs.screws[j]))
    return ours.motions[i].name != theirs.motions[j].name, other_shape, apart


def _base_turns(
    ours: ZeroPose,
    theirs: ZeroPose,
    pairs: Sequence[tuple[int, int]],
    pulls: tuple[Floats, Floats],
) -> Iterator[Floats]:
    """Turns of the first base that may lay its axes over the second's: by the first axis, either way, and by all."""
    one = [_directions(ours.screws[i]) for i, _ in pairs]
    two = [_directions(theirs.screws[j]) for _, j in pairs]
    for sign in (1, -1):
        yield _least_turn(one[0], sign * two[0], pulls)
    yield _least_turn(np.vstack(one), np.vstack(two), pulls)


def _directions(screws: Floats) -> Floats:
    """Directions of screws (n, 6)."""
    turns = np.linalg.norm(screws[:, :3], axis=1, keepdims=True) > 0.5
    return np.where(turns, screws[:, :3], screws[:, 3:])


def _least_turn(one: Floats, two: Floats, pulls: tuple[Floats, Floats]) -> Floats:
    """The least turn that lays directions over others, in least squares; gravity decides what parallel ones leave."""
    left, sizes, right = np.linalg.svd(two.T @ one + _ALIKE * np.eye(3))
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    if sizes[1] < PARALLEL * sizes[0]:
        turn = turn_about(two[0], _angle(two[0], turn @ pulls[0], pulls[1])) @ turn
    return np.asarray(turn)


@dataclass(frozen=True, eq=False)
class _Explanation:
    """One way to lay the axes of a robot over those of another, from the base on, and what differs then."""

    ours: ZeroPose
    theirs: ZeroPose
    limits: Mapping[str, float]  # of differences that count as none, by unit
    same_positions: bool  # whether another zero or direction counts
    moves: Mapping[int, Floats]
    found: tuple[GeometryDifference, ...]
    free: Floats  # directions along which the base may still be shifted, shape (3, k)
    zeros: Mapping[int, float] = field(default_factory=dict)
    settled: frozenset[int] = frozenset()  # motions whose zero one behind has shown
    deviation: float = 0.0

    @cached_property
    def cost(self) -> tuple[int, int, int]:
        """Differences of axes, of gravity, and of what is convention: the fewer, the simpler."""
        kinds = [difference.kind for difference in self.found]
        conventions = sum(kind in _CONVENTIONS for kind in kinds)
        gravity = kinds.count("gravity")
        axes = len(kinds) - conventions - gravity
        return axes, gravity, conventions * self.same_positions

    def steps(self, i: int, j: int) -> Iterator[_Explanation]:
        """Explanations that compare one motion more with its counterpart."""
        shown = [node for node in self._open(i) if self._amounts(node, i, j)]
        found = [replace(self, settled=self.settled.union(shown))]
        for node in shown:
            for one in list(found):
                found += one._with_zeros(node, i, j)
        for k, one in enumerate(found):
            compared = one._shifted(i, j)._compared(i, j)
            if k == 0 or compared.cost[:2] == self.cost[:2]:
                yield compared

    def _open(self, i: int) -> list[int]:
        """Motions before one that may have another zero: those that turn first, since they decide directions."""
        free = [k for k in self.ours.before(i)[1:] if k not in self.settled]
        kinds = [self.ours.motions[k].kind for k in free]
        return [
            k
            for wanted in (MotionKind.ROTATION, MotionKind.TRANSLATION)
            for k, kind in zip(free, kinds, strict=True)
            if kind is wanted
        ]

    def _amounts(self, node: int, i: int, j: int) -> list[float]:
        """Displacements of a motion that may bring the axis of one behind it into place."""
        axis = self.ours.axis(node, self.moves[node])
        child = self.ours.axis(i, self.moves[self.ours.parents[i]])
        return axis.amounts(child, self.theirs.axis(j, np.eye(4)))

    def _with_zeros(self, node: int, i: int, j: int) -> Iterator[_Explanation]:
        """The explanation with other zeros of a motion, which move all that hangs on it."""
        axis = self.ours.axis(node, self.moves[node])
        unit = "rad" if axis.turns else "m"
        name = self.ours.motions[node].name
        for amount in self._amounts(node, i, j):
            if abs(amount) > self.limits[unit]:
                move = axis.moved_by(amount)
                behind = [k for k in self.moves if node in self.ours.before(k)]
                moves = {k: move @ self.moves[k] for k in behind}
                zero = GeometryDifference(name, "zero", abs(amount), unit)
                yield replace(
                    self,
                    moves={**self.moves, **moves},
                    zeros={**self.zeros, node: amount},
                    found=(*self.found, zero),
                )

    def _shifted(self, i: int, j: int) -> _Explanation:
        """The explanation with the base shifted, as far as it is free, so that an axis comes into place."""
        one = self.ours.axis(i, self.moves[self.ours.parents[i]])
        two = self.theirs.axis(j, np.eye(4))
        if not one.turns or not self.free.size:
            return self
        across = np.eye(3) - np.outer(two.direction, two.direction)
        _, sizes, axes = np.linalg.svd(across @ self.free)
        seen = sizes > PARALLEL
        gap = across @ (two.point - one.point)
        steps = np.linalg.lstsq(across @ self.free, gap, rcond=PARALLEL)[0]
        move = np.eye(4)
        move[:3, 3] = self.free @ steps
        moves = {k: move @ place for k, place in self.moves.items()}
        return replace(self, moves=moves, free=self.free @ axes[~seen].T)

    def _compared(self, i: int, j: int) -> _Explanation:
        """The explanation with the differences of one motion more."""
        place = self.moves[self.ours.parents[i]]
        one, two = self.ours.axis(i, place), self.theirs.axis(j, np.eye(4))
        sizes = self._sizes(i, j, place)
        parts = [part for part in sizes if part.size > self.limits[part.unit]]
        shares = [p.size / self.limits[p.unit] for p in sizes if p not in parts]
        deviation = max(shares, default=0.0) * self.limits["rad"]
        return replace(
            self,
            moves={**self.moves, i: _aligned(one, two) @ place if parts else place},
            found=(*self.found, *parts),
            deviation=max(self.deviation, deviation),
        )

    def _sizes(self, i: int, j: int, place: Floats) -> list[GeometryDifference]:
        """Differences of a motion and its counterpart, however small."""
        motion, name = self.ours.motions[i], self.ours.motions[i].name
        ours, theirs = _moved(place, self.ours.screws[i]), self.theirs.screws[j]
        if motion.kind is MotionKind.BALL:
            apart = np.abs(ours - theirs)
            turn, shift, along = apart[:, :3].max(), apart[:, 3:].max(), 1.0
        else:
            one, two = self.ours.axis(i, place), self.theirs.axis(j, np.eye(4))
            along = float(one.direction @ two.direction)
            normal = np.cross(one.direction, two.direction)
            turn = np.arctan2(np.linalg.norm(normal), abs(along))
            shift = np.linalg.norm(np.cross(two.direction, one.point - two.point))
        found = [
            GeometryDifference(name, "axis direction", float(turn), "rad"),
            GeometryDifference(name, "axis position", float(shift), "m"),
        ]
        if along < 0:
            found.append(GeometryDifference(name, "positive direction", np.pi, "rad"))
        if motion.kind is MotionKind.SCREW:
            pitches = [screws[0, :3] @ screws[0, 3:] for screws in (ours, theirs)]
            size = float(abs(pitches[0] - pitches[1]))
            found.append(GeometryDifference(name, "pitch", size, "m/rad"))
        return found


def _aligned(one: JointAxis, two: JointAxis) -> Floats:
    """The least movement that lays an axis over its counterpart."""
    move = np.eye(4)
    move[:3, :3] = shortest_turn(one.direction, two.direction)
    if one.turns:
        gap = two.point - one.point
        across = gap - two.direction * (two.direction @ gap)
        move[:3, 3] = one.point + across - move[:3, :3] @ one.point
    return move


def _moves_otherwise(
    first: Mechanism, second: Mechanism, found: Correspondence, length: float
) -> list[GeometryDifference]:
    """Differences that the screws do not show: couplings and loops move bodies otherwise in the same positions."""
    rng = random_generator(DEFAULT_SEED)
    q = normalised(first, rng.uniform(-1, 1, (_POSES, len(first.positions))))
    if first.closures:
        q = CompiledAssembly(first).random_closed_states(rng, _POSES)[0]
    other = q[:, found.places(first.positions, second.positions)]
    if second.closures:
        closed, done = CompiledAssembly(second).near(other)
        other = np.where(done[:, None], closed, np.inf)
    ours, theirs = (
        homogeneous(Kinematics(m).frames(x)) for m, x in ((first, q), (second, other))
    )
    away = []
    for i, j in found.pairs:
        k, n = found.first.bodies[i], found.second.bodies[j]
        if found.first.node[k] != i or found.second.node[n] != j:
            continue  # a motion within a joint, which no body rides on
        ours_at_zero = found.moves[i] @ found.first.frames[k]
        constant = np.linalg.solve(found.second.frames[n], ours_at_zero)
        apart = theirs[:, n] @ constant - found.moves[i] @ ours[:, k]
        size = float(np.abs(apart).max())
        if not size <= 10 * length:
            name = found.first.motions[i].name
            away.append(GeometryDifference(name, "motion", size, "m"))
    return away


def _angle(axis: Floats, start: Floats, end: Floats) -> float:
    """The angle of the turn about an axis that brings one vector next to another."""
    sine = axis @ np.cross(start, end)
    cosine = start @ end - (axis @ start) * (axis @ end)
    return float(np.arctan2(sine, cosine)) if np.hypot(sine, cosine) > PARALLEL else 0.0


def turn_about(axis: Floats, angle: float) -> Floats:
    """The matrix of a turn, by Rodrigues' formula."""
    cross = np.cross(np.eye(3), axis)
    turned: Floats = (
        np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    )
    return turned


def shortest_turn(start: Floats, end: Floats) -> Floats:
    """The least rotation that brings one line of a direction onto another: never more than a quarter turn."""
    end = end * (1 if start @ end >= 0 else -1)
    normal = np.cross(start, end)
    size = np.linalg.norm(normal)
    if size > 1e-15:
        return turn_about(normal / size, float(np.arctan2(size, start @ end)))
    return np.eye(3)
