"""Limits that the electronics of a servo set to its pull Kp (u − q): of torque and of speed, and a dead band.

The error e = u − q counts less a dead band d, and up to where the torque is largest: p(e) = clip(e − clip(e, ±d), ±L).
The command u follows what was asked for at a speed of V at most.  Since the pull is continuous, motions have
derivatives by all of these, which are fitted as the gains are.  Corners may be rounded, so that a limit that no error
reaches yet has derivatives, too; what is fitted in the end has sharp ones, since rounded ones bias gains and friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.shared import Flags, Floats

LIMITS = ("torque", "dead", "speed")


@dataclass(frozen=True)
class Pull:
    """A servo's pull over its gain, with its derivatives by the error, the torque's limit and the dead band."""

    value: Floats
    by_error: Floats
    by_torque: Floats
    by_dead: Floats


@dataclass(frozen=True)
class Limits:
    """Limits of all servos, shape (n,): none where they are infinite, no dead band where it is 0."""

    torque: Floats  # error from which on the torque does not grow, rad or m
    dead: Floats  # error below which there is no torque, rad or m
    speed: Floats  # of the command that is followed, rad/s or m/s
    corner: float = 0.0  # share of limits of torque and of dead bands within which the pull is rounded

    @staticmethod
    def none(count: int) -> Limits:
        """Limits of servos that have none."""
        return Limits(np.full(count, np.inf), np.zeros(count), np.full(count, np.inf))

    @property
    def active(self) -> tuple[tuple[str, int], ...]:
        """Kinds and joints of the limits that there are."""
        found = dict(
            zip(
                LIMITS,
                (np.isfinite(self.torque), self.dead > 0, np.isfinite(self.speed)),
                strict=True,
            )
        )
        return tuple(
            (kind, int(joint))
            for kind, some in found.items()
            for joint in np.flatnonzero(some)
        )

    @property
    def values(self) -> Floats:
        """Their values in this order."""
        return np.array([getattr(self, kind)[joint] for kind, joint in self.active])

    def having(self, kind: str, joint: int, value: float) -> Limits:
        """These limits with one of them at another value."""
        values = getattr(self, kind).copy()
        values[joint] = value
        return replace(self, **{kind: values})

    def without(self, some: Sequence[tuple[str, int]]) -> Limits:
        """These limits without some of them."""
        found, none = self, Limits.none(len(self.dead))
        for kind, joint in some:
            found = found.having(kind, joint, float(getattr(none, kind)[joint]))
        return found

    def moved(self, values: Floats) -> Limits:
        """These limits at other values."""
        found = self
        for (kind, joint), value in zip(self.active, values, strict=True):
            found = found.having(kind, joint, float(value))
        return found

    def held(self, error: Floats) -> Floats:
        """Pulls of servos over their gains, by their errors, shape (…, n)."""
        inner = error - _clipped(error, self._dead, self.corner)
        return np.where(self._free, inner, _clipped(inner, self._torque, self.corner))

    def pull(self, error: Floats) -> Pull:
        """Pulls of servos over their gains, with their derivatives."""
        by_error, by_dead = _slopes(error, self._dead, self.corner)
        inner, slope = error - _clipped(error, self._dead, self.corner), 1 - by_error
        by_inner, by_torque = _slopes(inner, self._torque, self.corner)
        by_inner = np.where(self._free, 1.0, by_inner)
        return Pull(self.held(error), by_inner * slope, by_torque, -by_inner * by_dead)

    @cached_property
    def _free(self) -> Flags:
        return ~np.isfinite(self.torque)

    @cached_property
    def _torque(self) -> Floats:
        return np.where(self._free, 1.0, self.torque)

    @cached_property
    def _dead(self) -> Floats:
        return np.maximum(self.dead, 1e-12)

    def followed(self, asked: Floats, rate: float, steps: int) -> tuple[Floats, Floats]:
        """Commands that are followed, as means over steps of samples, and derivatives by the speed, (N steps, n)."""
        speed, period = np.where(np.isfinite(self.speed), self.speed, 1e12), 1 / rate
        now, slope = asked[0].copy(), np.zeros_like(asked[0])
        part = np.arange(steps + 1)[:, None] * (period / steps)
        found: list[Floats] = []
        slopes: list[Floats] = []
        for goal in asked:
            way = goal - now
            late = np.abs(way) > speed * part
            edges = now + np.where(late, np.sign(way) * speed * part, way)
            by_speed = np.where(late, slope + np.sign(way) * part, 0.0)
            # else the goal is there at once
            ramp = late[1:] | (late[:-1] & (part[:-1] > 0))
            for means, values in ((found, edges), (slopes, by_speed)):
                means.append(
                    np.where(ramp, 0.5 * (values[:-1] + values[1:]), values[1:])
                )
            now, slope = edges[-1], by_speed[-1]
        return np.concatenate(found), np.concatenate(slopes)


def _clipped(values: Floats, limit: Floats, corner: float) -> Floats:
    """clip(x, ±s) with corners that are rounded within a share of s."""
    if not corner:
        return np.clip(values, -limit, limit)
    found: Floats = 0.5 * (
        np.hypot(values + limit, corner * limit)
        - np.hypot(values - limit, corner * limit)
    )
    return found


def _slopes(values: Floats, limit: Floats, corner: float) -> tuple[Floats, Floats]:
    """Its derivatives by x and by s."""
    width = corner * limit
    above, below = (
        np.maximum(np.hypot(values + side * limit, width), 1e-300) for side in (1, -1)
    )
    up, down = (values + limit) / above, (values - limit) / below
    return 0.5 * (up - down), 0.5 * (up + down) + 0.5 * corner * width * (
        1 / above - 1 / below
    )
