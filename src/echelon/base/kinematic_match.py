"""Two robots joint by joint: which motions correspond, and how far their geometry is apart.

Positions move a tree by a product of exponentials of the screws that its motions have in the pose of zero (R. W.
Brockett, "Robotic manipulators and the product of exponentials formula", 1984).  So two trees move alike in the same
positions exactly if these screws are the same in one base frame, wherever the frames of links are put.  Screws are
compared from the base on, and each difference is taken up before the next joint is looked at: a longer link shows once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.base.match import JointAxis, gravity_value, shortest_turn, turn_about
from echelon.dynamics import CompiledAssembly, Kinematics
from echelon.loops import normalised
from echelon.robot import (
    GROUND,
    Mechanism,
    Motion,
    MotionKind,
    characteristic_length,
)
from echelon.shared import Floats, InputError, listed

_POSES = 4
"""Random poses in which all frames are compared: a coupling or a loop that differs shows in almost every one."""
_ALIKE = 1e-9
"""Weight of the identity beside axes when two bases are laid over one another: it decides what they leave open."""

_FAR, _OTHER_SHAPE, _OTHER_NAME = 1e2, 1e3, 1e6
"""Costs of pairing motions: the most that screws may count, other trees behind, other names; each beats the last."""


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


class ZeroPose:
    """Motions of a robot as a tree, with their screws and the bodies' frames in the pose of zero, base frame."""

    def __init__(self, mechanism: Mechanism) -> None:
        opened = replace(
            mechanism,
            couplings=(),
            closures=(),
            independent=(),
            actuators=(),
            effects=(),
            measured=None,
        )
        places = {name: k for k, name in enumerate(opened.positions)}
        balls = [m.positions[0] for m in opened.motions if m.kind is MotionKind.BALL]
        zero = np.array([[float(name in balls) for name in opened.positions]])
        kinematics = Kinematics(opened)
        self.frames = homogeneous(kinematics.frames(zero)[0])
        slopes = kinematics.slopes(zero)[0]
        self.motions: list[Motion] = []
        self.parents: list[int] = []
        self.screws: list[Floats] = []
        self.node = {GROUND: GROUND}  # of every body: the motion that it rides on
        for k, body in enumerate(mechanism.bodies):
            at = self.node[body.parent]
            for motion in body.joint.motions:
                columns = [places[name] for name in motion.positions][-3:]
                self.motions.append(motion)
                self.parents.append(at)
                self.screws.append(_screws(self.frames[k], slopes[k][..., columns]))
                at = len(self.motions) - 1
            self.node[k] = at

    def children(self, node: int) -> list[int]:
        """Motions that start from what another one moves."""
        return [k for k, parent in enumerate(self.parents) if parent == node]

    def axis(self, node: int, place: Floats) -> JointAxis:
        """The axis of a motion in a base frame that stands somewhere; of a ball, the first of its three."""
        direction, moment = _moved(place, self.screws[node])[0].reshape(2, 3)
        if self.motions[node].kind is MotionKind.TRANSLATION:
            return JointAxis(False, np.zeros(3), moment)
        return JointAxis(True, np.cross(direction, moment), direction)

    def shape(self, node: int) -> str:
        """The kinds of a motion and of all behind it, whatever their order."""
        behind = sorted(self.shape(child) for child in self.children(node))
        return f"{self.motions[node].kind.value}({' '.join(behind)})"


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
    by_name : bool
        Whether all pairs have one name.
    moves : mapping of int to array of shape (4, 4)
        For every motion of the first, and the ground, the movement from the first base frame to the second that lays
        what it carries over its counterpart in the pose of zero.
    differences : tuple of GeometryDifference
    deviation : float
        The largest difference that counts as none, rad or a share of the robot's size.
    """

    first: ZeroPose
    second: ZeroPose
    pairs: tuple[tuple[int, int], ...]
    by_name: bool
    moves: dict[int, Floats]
    differences: tuple[GeometryDifference, ...]
    deviation: float

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


def correspondence(
    first: Mechanism, second: Mechanism, tolerance: float
) -> Correspondence:
    """Pair the motions of two robots and name the differences of their geometry.

    ``tolerance`` is in rad, and a share of the robot's size for lengths.  Robots with other joints are refused.
    """
    ours, theirs = ZeroPose(first), ZeroPose(second)
    pairs = _paired(first, second, ours, theirs)
    length = tolerance * characteristic_length(first)
    pulls = gravity_value(first), gravity_value(second)
    candidates = [np.eye(4), _base_move(ours, theirs, pairs, pulls)]
    walks = [_Walk(ours, theirs, place, tolerance, length) for place in candidates]
    for walk in walks:
        for i, j in pairs:
            walk.step(i, j)
    walk = min(walks, key=lambda walk: len(walk.found))
    turned = walk.moves[GROUND][:3, :3] @ pulls[0]
    apart = float(np.linalg.norm(turned - pulls[1]))
    if apart > tolerance * max(float(np.linalg.norm(turned)), 1.0):
        walk.found.append(GeometryDifference("base", "gravity", apart, "m/s²"))
    names = [(ours.motions[i].name, theirs.motions[j].name) for i, j in pairs]
    by_name = all(name == other for name, other in names)
    found = Correspondence(
        ours, theirs, tuple(pairs), by_name, walk.moves, (), walk.deviation
    )
    if not any(difference.kind != "gravity" for difference in walk.found):
        walk.found += _moves_otherwise(first, second, found, length)
    return replace(found, differences=tuple(walk.found))


def _paired(
    first: Mechanism, second: Mechanism, ours: ZeroPose, theirs: ZeroPose
) -> list[tuple[int, int]]:
    """Motions that correspond, parents first: by name where the names agree, else by shape of the tree and axes."""
    names = [{motion.name for motion in robot.motions} for robot in (ours, theirs)]
    only = names[0] - names[1], names[1] - names[0]
    if len(ours.motions) != len(theirs.motions):
        told = [
            f"only {robot.name} has {listed(sorted(mine))}"
            for robot, mine in zip((first, second), only, strict=True)
            if mine
        ]
        raise InputError(
            f"{first.name} has {len(ours.motions)} moving joints, {second.name} {len(theirs.motions)}: "
            f"{'; '.join(told)}; lock what one of them lacks (locked={{...}}) to compare the others"
        )
    pairs: list[tuple[int, int]] = []
    waiting = [(GROUND, GROUND)]
    while waiting:
        at = waiting.pop(0)
        mine, others = ours.children(at[0]), theirs.children(at[1])
        where = "the base" if at[0] == GROUND else f"'{ours.motions[at[0]].name}'"
        if len(mine) != len(others):
            raise InputError(
                f"{where} carries {len(mine)} joints of {first.name} and {len(others)} of {second.name}"
            )
        costs = [(_cost(ours, theirs, i, j), i, j) for i in mine for j in others]
        chosen: dict[int, int] = {}
        for _, i, j in sorted(costs):
            if i not in chosen and j not in chosen.values():
                chosen[i] = j
        for i, j in chosen.items():
            _check_pair(ours.motions[i], theirs.motions[j], only[0])
        pairs += chosen.items()
        waiting += chosen.items()
    return pairs


def _check_pair(one: Motion, other: Motion, lacking: set[str]) -> None:
    where = f"joints '{one.name}' and '{other.name}'"
    if one.kind is not other.kind:
        raise InputError(
            f"one is a {one.kind.value}, the other a {other.kind.value}", element=where
        )
    if one.name != other.name and one.name not in lacking:
        problem = f"'{one.name}' hangs elsewhere in the second robot: the trees differ"
        raise InputError(problem, element=where)


def _cost(ours: ZeroPose, theirs: ZeroPose, i: int, j: int) -> float:
    """How badly two motions go together: not at all under other names or trees, then by their axes."""
    same_name = ours.motions[i].name == theirs.motions[j].name
    same_shape = ours.shape(i) == theirs.shape(j)
    if not same_shape:
        return _OTHER_NAME * (not same_name) + _OTHER_SHAPE
    apart = float(np.linalg.norm(ours.screws[i] - theirs.screws[j]))
    return _OTHER_NAME * (not same_name) + min(apart, _FAR)


def _base_move(
    ours: ZeroPose,
    theirs: ZeroPose,
    pairs: Sequence[tuple[int, int]],
    pulls: tuple[Floats, Floats],
) -> Floats:
    """The least movement of the first base that lays its axes over the second's, in least squares."""
    one = np.vstack([np.zeros((0, 6)), *(ours.screws[i] for i, _ in pairs)])
    two = np.vstack([np.zeros((0, 6)), *(theirs.screws[j] for _, j in pairs)])
    turns = np.linalg.norm(one[:, :3], axis=1) > 0.5
    directions = [np.where(turns[:, None], s[:, :3], s[:, 3:]) for s in (one, two)]
    sizes = [np.linalg.norm(pull) or 1.0 for pull in pulls]
    gathered = directions[1].T @ directions[0] + _ALIKE * np.eye(3)
    gathered += 1e3 * _ALIKE * np.outer(pulls[1] / sizes[1], pulls[0] / sizes[0])
    left, _, right = np.linalg.svd(gathered)
    place = np.eye(4)
    place[:3, :3] = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    turned, wanted = _moved(place, one[turns]), two[turns]
    # t × ω = the difference of the moments
    rows = [np.zeros((0, 3)), *(-np.cross(np.eye(3), s[:3]).T for s in turned)]
    rest = (wanted - turned)[:, 3:].ravel()
    place[:3, 3] = np.linalg.lstsq(-np.vstack(rows), rest, rcond=1e-9)[0]
    return place


class _Walk:
    """Differences of screws, from the base on."""

    def __init__(
        self,
        ours: ZeroPose,
        theirs: ZeroPose,
        place: Floats,
        angle: float,
        length: float,
    ) -> None:
        self.ours, self.theirs = ours, theirs
        self.limits = {"rad": angle, "m": length, "m/rad": length}
        self.deviation = 0.0
        self.moves: dict[int, Floats] = {GROUND: place}
        self.found: list[GeometryDifference] = []
        self._settled = {GROUND}  # motions whose zero a joint behind them has confirmed

    def step(self, i: int, j: int) -> None:
        """Compare one motion with its counterpart."""
        parent = self.ours.parents[i]
        if self._parts(i, j, self.moves[parent]) and parent not in self._settled:
            self._explain_by_zero(i, j, parent)
        self._settled.add(parent)
        parts = self._parts(i, j, self.moves[parent])
        self.found += parts
        shares = [
            part.size / self.limits[part.unit] * self.limits["rad"]
            for part in self._sizes(i, j, self.moves[parent])
            if part not in parts
        ]
        self.deviation = max([self.deviation, *shares])
        self.moves[i] = self.moves[parent]
        if parts:
            self.moves[i] = self._aligned(i, j, self.moves[parent])

    def _parts(self, i: int, j: int, place: Floats) -> list[GeometryDifference]:
        """Differences of a motion and its counterpart beyond the tolerance."""
        sizes = self._sizes(i, j, place)
        return [part for part in sizes if part.size > self.limits[part.unit]]

    def _sizes(self, i: int, j: int, place: Floats) -> list[GeometryDifference]:
        """Differences of a motion and its counterpart, however small."""
        motion, name = self.ours.motions[i], self.ours.motions[i].name
        ours, theirs = _moved(place, self.ours.screws[i]), self.theirs.screws[j]
        if motion.kind is MotionKind.BALL:
            apart = np.abs(ours - theirs)
            turn, shift, along = apart[:, :3].max(), apart[:, 3:].max(), 1.0
        else:
            one, two = self.ours.axis(i, place), self.theirs.axis(j, np.eye(4))
            normal = np.cross(one.direction, two.direction)
            along = float(one.direction @ two.direction)
            turn = np.arctan2(np.linalg.norm(normal), abs(along))
            at = self._near(i, one, place) if one.turns else one.point
            shift = np.linalg.norm(np.cross(two.direction, at - two.point))
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

    def _near(self, i: int, axis: JointAxis, place: Floats) -> Floats:
        """The point of an axis next to the origin of a body that it moves."""
        body = next(k for k, node in self.ours.node.items() if node >= i)
        origin = (place @ self.ours.frames[body])[:3, 3]
        along = float(axis.direction @ (origin - axis.point))
        return np.asarray(axis.point + along * axis.direction)

    def _explain_by_zero(self, i: int, j: int, parent: int) -> None:
        """Find another zero of the joint before that brings an axis into place."""
        if self.ours.motions[parent].kind not in (
            MotionKind.ROTATION,
            MotionKind.TRANSLATION,
        ):
            return
        before = self.ours.axis(parent, self.moves[parent])
        child = self.ours.axis(i, self.moves[parent])
        wanted = self.theirs.axis(j, np.eye(4))
        for amount in before.amounts(child, wanted):
            place = _by(before, amount) @ self.moves[parent]
            if not self._parts(i, j, place):
                unit = "rad" if before.turns else "m"
                name = self.ours.motions[parent].name
                self.found.append(GeometryDifference(name, "zero", abs(amount), unit))
                self.moves[parent] = place
                return

    def _aligned(self, i: int, j: int, place: Floats) -> Floats:
        """The least further movement that lays an axis over its counterpart."""
        one, two = self.ours.axis(i, place), self.theirs.axis(j, np.eye(4))
        move = np.eye(4)
        move[:3, :3] = shortest_turn(one.direction, two.direction)
        if one.turns:
            at = self._near(i, one, place)
            gap = two.point - at
            gap = gap - two.direction * (two.direction @ gap)
            move[:3, 3] = at + gap - move[:3, :3] @ at
        return move @ place


def _by(axis: JointAxis, amount: float) -> Floats:
    """The displacement of a joint."""
    move = np.eye(4)
    if not axis.turns:
        move[:3, 3] = amount * axis.direction
        return move
    move[:3, :3] = turn_about(axis.direction, amount)
    move[:3, 3] = axis.point - move[:3, :3] @ axis.point
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
        k = next(k for k, node in found.first.node.items() if node >= i)
        n = next(k for k, node in found.second.node.items() if node >= j)
        if found.first.node[k] == i and found.second.node[n] == j:
            constant = (
                np.linalg.inv(found.second.frames[n])
                @ found.moves[i]
                @ found.first.frames[k]
            )
            apart = theirs[:, n] @ constant - found.moves[i] @ ours[:, k]
            size = float(np.abs(apart).max())
            if not size <= 10 * length:
                away.append(
                    GeometryDifference(found.first.motions[i].name, "motion", size, "m")
                )
    return away
