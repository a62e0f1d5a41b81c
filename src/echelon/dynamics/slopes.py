"""Derivatives of all freedoms' efforts by positions and velocities, by composite bodies.

When a joint's position or velocity changes, all bodies behind it get other accelerations.  With r the place and u the
velocity of a point against the joint's origin, and ω the frame's angular velocity, the point's acceleration changes by

    δα × r + 2 δω × u + δa,        δα = δω̇ + ω × δω,

where δω, δω̇ and δa are the changes of the frame behind the joint, seen from it.  δα and δω are the same about every
origin.  So the wrench of the bodies behind changes by a linear function of (δω, δα, δa) whose coefficients are the
composite inertia, D = 2 Σ m r uᵀ and p = 2 Σ m u.  Carried to the ground it changes the efforts on the way; and what a
freedom further out reads is a linear form in (δω, δα, δa), which is carried to the ground, too.  On arms of six or
seven joints this takes a fifth to two fifths fewer operations than differentiating the recursion as a program, and on
larger robots half of them.  The idea of composite bodies for derivatives is that of Carpentier and Mansard (2018) and
of Singh, Russo and Wensing (2022); frames here are those of the bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.dynamics.composite import Falling, before, tensor
from echelon.dynamics.grouping import MASS
from echelon.dynamics.recursion import Descent, Passage, Recursion
from echelon.dynamics.wrenches import Kinematics, Wrench, body_wrench
from echelon.inertia.spatial import Array
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.program.tape import Scalar
from echelon.regressor.spatial import Mat, Vec, add, apply, cross, dot, scale
from echelon.regressor.steps import Freedom, Recorder, into_frame

Entries = dict[tuple[str, str], Scalar]
"""Derivatives of the effort of one freedom by the coordinate of another; zero where absent."""


@dataclass(frozen=True)
class Change:
    """Changes of a frame's motion: δω, δα and δa."""

    spin: Vec
    turn: Vec
    linear: Vec


@dataclass(frozen=True)
class Behind:
    """All that is behind a joint: pseudo-inertia, D, p, and the wrench that its motion needs."""

    pseudo: Array
    spread: Array
    momentum: Vec
    wrench: Wrench

    @property
    def first(self) -> Vec:
        """First moments."""
        return (self.pseudo[0, MASS], self.pseudo[1, MASS], self.pseudo[2, MASS])

    def spread_column(self, direction: Vec) -> Vec:
        """(tr D − D) e."""
        return self._turned(direction, self.spread)

    def changed(self, by: Change) -> Wrench:
        """Change of the wrench."""
        moment = apply(tensor(self.pseudo), by.turn)
        moment = add(add(moment, self._turned(by.spin, self.spread.T)), cross(self.first, by.linear))
        force = add(cross(by.turn, self.first), cross(by.spin, self.momentum))
        return moment, add(force, scale(by.linear, self.pseudo[MASS, MASS]))

    def _turned(self, v: Vec, spread: Array) -> Vec:
        rows: list[Vec] = []
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            row = [-spread[k, n] for n in range(3)]
            row[k] = self.spread[i, i] + self.spread[j, j]
            rows.append((row[0], row[1], row[2]))
        return apply((rows[0], rows[1], rows[2]), v)

    def plus(self, other: Behind) -> Behind:
        """Both together, about one origin."""
        wrench = add(self.wrench[0], other.wrench[0]), add(self.wrench[1], other.wrench[1])
        momentum = add(self.momentum, other.momentum)
        return Behind(self.pseudo + other.pseudo, self.spread + other.spread, momentum, wrench)


def body_behind(at: Kinematics, pseudo: Array) -> Behind:
    """One body alone."""
    x, y, z = at.angular
    zero = x * 0
    hat: Mat = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    rows = [[2 * pseudo[i, j] for j in range(3)] for i in range(3)]
    spread = np.array([apply(hat, (row[0], row[1], row[2])) for row in rows], dtype=object)
    first: Vec = (2 * pseudo[0, MASS], 2 * pseudo[1, MASS], 2 * pseudo[2, MASS])
    return Behind(pseudo, spread, cross(at.angular, first), body_wrench(at, pseudo))


def effort_slopes(
    mechanism: Mechanism, recorder: Recorder, recursion: Recursion, inertias: Mapping[int, Array], gravity: Vec
) -> tuple[Entries, Entries]:
    """Derivatives of every effort by the positions and by the velocities of all freedoms.

    Parameters
    ----------
    mechanism : Mechanism
    recorder : Recorder
        Of the coordinates.
    recursion : Recursion
        Knows the steps between the bodies.
    inertias : mapping of int to array of shape (4, 4) of Scalar
        Pseudo-inertias.
    gravity : 3 of Scalar

    Returns
    -------
    (Entries, Entries)
        The position of a ball's freedom is the angle of a further turn about its axis of the moved frame.
    """
    zeros, zero = recorder.zeros, recorder.program.zero
    bodies, (passages, motions) = mechanism.bodies, recursion.passages(gravity)
    empty = Behind(np.full((4, 4), zero), np.full((3, 3), zero), zeros, (zeros, zeros))
    loads = {i: body_behind(motions[i], inertias[i]) if i in inertias else empty for i in range(GROUND, len(bodies))}
    sweep = _Sweep(zeros)
    items: dict[int, list[_Item]] = {index: [] for index in loads}
    for index in reversed(range(GROUND, len(bodies))):
        load, carried = loads[index], items[index]
        for passage in reversed(passages[index]):
            load = sweep.passed(passage, load, carried)
        if index != GROUND:
            loads[bodies[index].parent] = loads[bodies[index].parent].plus(load)
            items[bodies[index].parent] += carried
    return sweep.by_position, sweep.by_rate


@dataclass(eq=False)
class _Item:
    """What one freedom sends to the ground: changes of wrenches, and what it reads of changes further in."""

    name: str
    moved: Falling
    sped: Falling
    form: Wrench
    spin_form: Vec


class _Sweep:
    """One way from the tips to the ground."""

    def __init__(self, zeros: Vec) -> None:
        self.by_position: Entries = {}
        self.by_rate: Entries = {}
        self._zeros = zeros

    def passed(self, passage: Passage, load: Behind, items: list[_Item]) -> Behind:
        """Take one step; what is behind it, seen from before."""
        step = passage.step
        changes = {f.name: (_by_position(passage, f), _by_rate(passage, f)) for f in step.freedoms}
        for item in items:
            for freedom in step.freedoms:
                moved, sped = changes[freedom.name]
                self.by_position[item.name, freedom.name] = _read(item, moved)
                self.by_rate[item.name, freedom.name] = _read(item, sped)
        fresh = [self._started(freedom, step.freedoms, load, changes[freedom.name]) for freedom in step.freedoms]
        twist = _origin_velocity(passage, self._zeros)
        for item in (*items, *fresh):
            for found, falling in ((self.by_position, item.moved), (self.by_rate, item.sped)):
                efforts = falling.carry(passage)
                if item not in fresh:
                    found |= {(name, item.name): effort for name, effort in efforts.items()}
            item.form = self._wrench_before(passage, item.form)
            item.spin_form = add(_back(passage, item.spin_form), cross(twist, item.form[1]))
        items += fresh
        return self._load_before(passage, load, twist)

    def _started(
        self, freedom: Freedom, freedoms: tuple[Freedom, ...], load: Behind, changes: tuple[Change, Change]
    ) -> _Item:
        moved, sped = (load.changed(by) for by in changes)
        for other in freedoms:
            self.by_position[other.name, freedom.name] = _effort(other, moved)
            self.by_rate[other.name, freedom.name] = _effort(other, sped)
        angular, linear = freedom.angular, freedom.linear
        moment, force = load.wrench
        # further in, the wrench also turns with the bodies, and acts at another place
        turned = add(add(moved[0], cross(angular, moment)), cross(linear, force)), add(moved[1], cross(angular, force))
        unit: Change = Change(self._zeros, angular, linear)
        spin_form = add(load.spread_column(angular), cross(load.momentum, linear))
        falling = Falling(self._zeros, turned), Falling(self._zeros, sped)
        return _Item(freedom.name, *falling, load.changed(unit), spin_form)

    def _wrench_before(self, passage: Passage, wrench: Wrench) -> Wrench:
        """A wrench about the frame before a step, all of it at once."""
        return Descent(self._zeros).carry([replace(passage, turn=None)], wrench)

    def _load_before(self, passage: Passage, load: Behind, twist: Vec) -> Behind:
        pseudo, step = before(passage, load.pseudo), passage.step
        wrench = self._wrench_before(passage, load.wrench)
        spread, momentum = _turned_spread(passage, load.spread), _back(passage, load.momentum)
        if step.shift is not None:
            later = pseudo[:3, MASS]
            extra = [[step.shift[i] * momentum[j] + later[i] * twist[j] for j in range(3)] for i in range(3)]
            spread = spread + np.array(extra, dtype=object)
            momentum = add(momentum, scale(twist, pseudo[MASS, MASS]))
        return Behind(pseudo, spread, momentum, wrench)


def _effort(freedom: Freedom, wrench: Wrench) -> Scalar:
    return dot(freedom.angular, wrench[0]) + dot(freedom.linear, wrench[1])


def _read(item: _Item, by: Change) -> Scalar:
    return dot(item.spin_form, by.spin) + (dot(item.form[0], by.turn) + dot(item.form[1], by.linear))


def _base(passage: Passage) -> tuple[Kinematics, Kinematics]:
    """Motion of the frame before the freedoms of a step, in the moved frame's axes; and of the moved frame."""
    if len(passage.step.freedoms) == 1:
        # what lies along the only axis drops out below, so the moved frame's own motion does
        return passage.end, passage.end
    angular, rate = (into_frame(passage.step, v) for v in (passage.start.angular, passage.start.angular_rate))
    return Kinematics(angular, rate, passage.end.linear), passage.end


def _by_position(passage: Passage, freedom: Freedom) -> Change:
    base, end = _base(passage)
    linear = add(cross(end.linear, freedom.angular), apply(base.field, freedom.linear))
    return Change(cross(base.angular, freedom.angular), apply(base.field, freedom.angular), linear)


def _by_rate(passage: Passage, freedom: Freedom) -> Change:
    base, end = _base(passage)
    if base is end:
        turn = scale(cross(end.angular, freedom.angular), end.angular[0].program.constant(2))
    else:
        turn = cross(add(base.angular, end.angular), freedom.angular)
    sliding = scale(cross(base.angular, freedom.linear), end.angular[0].program.constant(2))
    return Change(freedom.angular, turn, sliding)


def _origin_velocity(passage: Passage, zeros: Vec) -> Vec:
    """Twice the velocity of the new origin against the old one, in the old axes."""
    shift = passage.step.shift
    if shift is None:
        return zeros
    two = shift[0].program.constant(2)
    twist = cross(passage.start.angular, scale(shift, two))
    for freedom in passage.step.freedoms:
        twist = add(twist, scale(freedom.linear, two * freedom.rate))
    return twist


def _back(passage: Passage, v: Vec) -> Vec:
    return v if passage.step.rotation is None else apply(passage.step.rotation, v)


def _turned_spread(passage: Passage, spread: Array) -> Array:
    if passage.step.rotation is None:
        return spread
    matrix = np.array(passage.step.rotation, dtype=object)
    turned: Array = matrix @ spread @ matrix.T
    if passage.rotation is not None:
        # trace and difference of what lies across the axis stay
        i, j = (passage.axis + 1) % 3, (passage.axis + 2) % 3
        turned[j, j] = (spread[i, i] + spread[j, j]) - turned[i, i]
        turned[j, i] = turned[i, j] + (spread[j, i] - spread[i, j])
    return turned


def by_quaternion(quaternion: Sequence[Scalar], by_angles: Sequence[Scalar]) -> list[Scalar]:
    """Derivatives by a unit quaternion (w, x, y, z), from those by turns about the axes of the turned frame.

    The angles change by twice the vector part of the conjugate quaternion times its change.
    """
    w, x, y, z = quaternion
    v: Vec = (x, y, z)
    a, b, c = (2 * slope for slope in by_angles)
    turned: Vec = (a, b, c)
    return [-dot(v, turned), *add(scale(turned, w), cross(v, turned))]
