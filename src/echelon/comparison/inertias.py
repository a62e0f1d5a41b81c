"""Inertial values and effects of two robots, as differences in the columns of the first robot's regressor.

In the pose of zero corresponding bodies lie over one another, so that their inertias have a difference, Δζ about the
first robot's frames.  With one geometry, B Δζ is all that can be seen: what of Δζ lies in the null space of B shows in
no output, whatever its size.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import combinations
from math import isfinite

import numpy as np

from echelon.base import BaseModel, Correspondence, ZeroPose
from echelon.comparison.result import ParameterDifference
from echelon.formats import RobotFile, inertial_rounding
from echelon.robot import (
    ALL,
    GROUND,
    Action,
    Mechanism,
    characteristic_length,
    move,
)
from echelon.shared import PER_BODY, Floats, InputError, listed, unused

_MOST_TOGETHER = 3
"""Bodies that are looked for whose differences cancel: mass that moves over a joint, or over two."""
COMPUTED = 1e-9
"""Share of a number by which computing with it in doubles, along a chain of bodies, may move it."""


def file_of(robot: Mechanism) -> RobotFile | None:
    """The file that a robot was read from; None if it was made or changed since."""
    file = None if robot.reading is None else robot.reading.file
    return file if isinstance(file, RobotFile) else None


def with_stated_effects(mechanism: Mechanism) -> Mechanism:
    """The robot with the friction, springs and rotors of which its file states values."""
    reading = mechanism.reading
    if reading is None or mechanism.effects:
        return mechanism
    usual = reading.file.mechanism(replace(reading.options, usual_effects=True))
    stated = tuple(
        e for e in usual.effects if e.value is not None and isfinite(e.value)
    )
    return replace(mechanism, effects=stated).as_read(reading)


def with_effects_of(one: Mechanism, two: Mechanism) -> Mechanism:
    """The first robot with the effects that only the second has, as parameters of value zero."""
    own = {effect.actions for effect in one.effects}
    effects = list(one.effects)
    for effect in two.effects:
        if effect.actions not in own:
            taken = *one.parameters, *(e.parameter for e in effects)
            name = unused(effect.parameter, taken)
            effects.append(replace(effect, parameter=name, value=0.0))
    changed = replace(one, effects=tuple(effects))
    return changed if one.reading is None else changed.as_read(one.reading)


class InertialDifference:
    """Differences of the inertial values of two robots, in standard and base parameters of the first."""

    def __init__(
        self, base: BaseModel, one: Mechanism, two: Mechanism, pairs: Correspondence
    ) -> None:
        self.one, self.two, self.pairs = base.mechanism, two, pairs
        self.matrix = base.B_float()
        self.notes: list[str] = []
        self.first = self._stated(self.one)
        self.second = self._stated(two)
        count = len(self.first)
        self.standard = np.zeros(count)
        # errors by rounding: of the files and of computing, and of computing alone
        self.noise, self.computed = np.zeros(count), np.zeros(count)
        self.complete = (
            True  # whether the first robot has a column for every difference
        )
        self._halves = _half_units(one) + _half_units(two)
        self._length = characteristic_length(one)
        for i, j in [(GROUND, GROUND), *pairs.pairs]:
            self._compare_bodies(i, j)
        self._compare_effects()
        # standard and base parameters that differ by more than rounding
        self.differs = np.abs(self.standard) > self.noise
        self.base = self.matrix @ self.standard
        self.noise_of_base = np.abs(self.matrix) @ self.noise
        self.apart = np.abs(self.base) > self.noise_of_base
        # base parameters that differ by no more than the last decimals of the files explain
        self.computed_of_base = np.abs(self.matrix) @ self.computed
        self.rounded = (np.abs(self.base) > self.computed_of_base) & ~self.apart

    def _stated(self, robot: Mechanism) -> Floats:
        """Standard parameters, zero where a file is silent, which is noted."""
        stated = robot.standard_values()
        silent = [
            c.name for c, v in zip(robot.columns, stated, strict=True) if v is None
        ]
        if len(silent) == len(stated) and silent:
            raise InputError(
                f"{robot.name} states no inertial values, so there is nothing to compare; add them to its file"
            )
        if silent:
            self.notes.append(
                f"{robot.name} states no values of {listed(silent)}: they count as 0"
            )
        return np.array([0.0 if value is None else value for value in stated])

    def _compare_bodies(self, i: int, j: int) -> None:
        """The difference of all that rides on a motion, in the columns of a body there that has all ten."""
        one, pose = self.one, self.pairs.first
        riders = [k for k, node in pose.node.items() if node == i and k != GROUND]
        hosts = [
            k
            for k in riders
            if one.bodies[k].carried == ALL and len(one.sharing[k]) == 1
        ]
        host = pose.frames[hosts[0]] if hosts else np.eye(4)
        back: Floats = np.asarray(np.linalg.inv(host), dtype=float)
        ours = self._gathered(one, pose, i, back)
        place = back @ np.linalg.inv(self.pairs.moves[i])
        theirs = self._gathered(self.two, self.pairs.second, j, place)
        computed = self._noise(ours, np.zeros(3), COMPUTED) + COMPUTED * np.abs(theirs)
        share = COMPUTED + self.pairs.deviation
        noise = self._noise(ours, self._halves, share) + COMPUTED * np.abs(theirs)
        if hosts:
            start = one.first_column[hosts[0]]
            self.standard[start : start + PER_BODY] = ours - theirs
            self.noise[start : start + PER_BODY] = noise
            self.computed[start : start + PER_BODY] = computed
        elif (np.abs(ours - theirs) > noise).any():
            self.complete = False
            name = pose.motions[i].name if i != GROUND else "the base"
            self.notes.append(
                f"{one.name} has no ten parameters for the difference behind {name}, so base parameters leave it out"
            )

    def _gathered(
        self, robot: Mechanism, pose: ZeroPose, node: int, place: Floats
    ) -> Floats:
        """Inertial values of all bodies that ride on a motion, in a base frame that stands somewhere, pose of zero."""
        total = np.zeros(PER_BODY)
        for k, at in pose.node.items():
            stated = None if k == GROUND else robot.bodies[k].inertial
            if at == node and stated is not None:
                kept = np.isin(range(PER_BODY), robot.bodies[k].carried)
                values = np.where(kept, np.array(stated), 0.0)
                total += move(values, place @ pose.frames[k])
        return total

    def _noise(self, values: Floats, halves: Floats, share: float) -> Floats:
        """Errors of ten values by rounding: of the last decimals of both files, and of a ``share`` of lengths."""
        (mass, centre, moment), length = halves, self._length
        weight = abs(values[-1])
        arm = float(np.linalg.norm(values[6:9])) / (weight or 1.0)
        reach = arm + length
        first = weight * (centre + share * reach) + arm * mass
        second = moment + weight * (2 * arm * centre + share * reach**2) + arm**2 * mass
        second += COMPUTED * float(np.abs(values[:6]).max())
        return np.array([*[second] * 6, *[first] * 3, mass + COMPUTED * weight])

    def _compare_effects(self) -> None:
        theirs: dict[tuple[Action, ...], float] = {}
        for effect in self.two.effects:
            known = theirs.get(effect.actions, 0.0)
            theirs[effect.actions] = known + (effect.value or 0.0)
        start = len(self.first) - len(self.one.effects)
        for column, effect in enumerate(self.one.effects, start):
            value = theirs.pop(effect.actions, 0.0)  # of several alike, the first
            self.standard[column] = self.first[column] - value
            self.noise[column] = COMPUTED * abs(self.first[column])
            self.computed[column] = self.noise[column]

    @cached_property
    def cancelled(self) -> tuple[tuple[int, ...], ...]:
        """Bodies whose differences no output shows, alone or together, the smallest groups first."""
        shown: dict[int, Floats] = {}
        for k, start in self.one.first_column.items():
            own = slice(start, start + PER_BODY)
            if self.differs[own].any() and len(self.one.bodies[k].carried) == PER_BODY:
                shown[k] = self.matrix[:, own] @ self.standard[own]
        found: list[tuple[int, ...]] = []
        for size in range(1, _MOST_TOGETHER + 1):
            for group in combinations(list(shown), size):
                left = all(k in shown for k in group)
                if left and self._is_noise(
                    group, np.sum([shown[k] for k in group], axis=0)
                ):
                    found.append(group)
                    for k in group:
                        del shown[k]
        return tuple(found)

    def _is_noise(self, group: tuple[int, ...], base: Floats) -> bool:
        """Whether a difference of base parameters by some bodies is one of rounding of their own values."""
        starts = [self.one.first_column[k] for k in group]
        own = np.concatenate([np.arange(start, start + PER_BODY) for start in starts])
        noise = np.abs(self.matrix[:, own]) @ self.noise[own]
        return bool((np.abs(base) <= noise).all())

    def parameters(self) -> tuple[ParameterDifference, ...]:
        """Standard parameters that differ by more than rounding."""
        shown = np.asarray((self.matrix[self.apart] != 0).any(axis=0))
        own = np.abs(self.matrix * self.standard)
        beyond = own > self.noise_of_base[:, None]
        there = own > self.computed_of_base[:, None]
        rounded = np.asarray(there.any(axis=0) & ~beyond.any(axis=0))
        for k in (k for group in self.cancelled for k in group):
            start = self.one.first_column[k]
            shown[start : start + PER_BODY] = rounded[start : start + PER_BODY] = False
        return tuple(
            ParameterDifference(
                column.name,
                "" if column.body is None else self.one.bodies[column.body].name,
                column.unit,
                float(self.first[k]),
                float(self.first[k] - self.standard[k]),
                bool(shown[k]),
                bool(rounded[k] and not shown[k]),
            )
            for k, column in enumerate(self.one.columns)
            if self.differs[k]
        )


def _half_units(robot: Mechanism) -> Floats:
    """Rounding errors of masses, centres and moments in the file of a robot; 0 without a file."""
    file = file_of(robot)
    return np.zeros(3) if file is None else np.array(inertial_rounding(file)) / 2
