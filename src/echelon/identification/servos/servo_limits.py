"""What the electronics of a servo do to its pull Kp (u − q): limits of torque and of speed, and a dead band.

The error e = u − q counts less a dead band d, and up to where the torque is largest: p(e) = clip(e − clip(e, ±d), ±L).
The command u follows what was asked for at a speed of V at most.  Corners are rounded a little, so that simulated
motions have derivatives by all of these, which are fitted as the gains are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats

_ROUNDED = {"torque": 0.05, "dead": 0.01}  # of a limit, within which its corner is rounded
LIMITS = ("torque", "dead", "speed")


@dataclass(frozen=True)
class Pull:
    """A servo's pull over its gain, with its derivatives by the error, the torque's limit and the dead band, (W, n)."""

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

    @staticmethod
    def none(count: int) -> Limits:
        """Of servos that have no limits."""
        return Limits(np.full(count, np.inf), np.zeros(count), np.full(count, np.inf))

    @property
    def active(self) -> tuple[tuple[str, int], ...]:
        """Kinds and joints of the limits that there are."""
        found = dict(zip(LIMITS, (np.isfinite(self.torque), self.dead > 0, np.isfinite(self.speed)), strict=True))
        return tuple((kind, int(joint)) for kind, some in found.items() for joint in np.flatnonzero(some))

    @property
    def values(self) -> Floats:
        """Their values in this order."""
        return np.array([getattr(self, kind)[joint] for kind, joint in self.active])

    def having(self, kind: str, joint: int, value: float) -> Limits:
        """The same with one limit at another value."""
        values = getattr(self, kind).copy()
        values[joint] = value
        return replace(self, **{kind: values})

    def without(self, some: Sequence[tuple[str, int]]) -> Limits:
        """The same without some of the limits."""
        found, none = self, Limits.none(len(self.dead))
        for kind, joint in some:
            found = found.having(kind, joint, float(getattr(none, kind)[joint]))
        return found

    def moved(self, values: Floats) -> Limits:
        """The same limits at other values."""
        found = self
        for (kind, joint), value in zip(self.active, values, strict=True):
            found = found.having(kind, joint, float(value))
        return found

    def pull(self, error: Floats) -> Pull:
        """What servos pull with, over their gains."""
        dead, by_error, by_dead = _clipped(error, np.maximum(self.dead, 1e-12), _ROUNDED["dead"])
        inner, slope, free = error - dead, 1 - by_error, ~np.isfinite(self.torque)
        value, by_inner, by_torque = _clipped(inner, np.where(free, 1.0, self.torque), _ROUNDED["torque"])
        value, by_inner = np.where(free, inner, value), np.where(free, 1.0, by_inner)
        return Pull(value, by_inner * slope, by_torque, -by_inner * by_dead)

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
            ramp = late[1:] | (late[:-1] & (part[:-1] > 0))  # else the goal is there at once
            for means, values in ((found, edges), (slopes, by_speed)):
                means.append(np.where(ramp, 0.5 * (values[:-1] + values[1:]), values[1:]))
            now, slope = edges[-1], by_speed[-1]
        return np.concatenate(found), np.concatenate(slopes)


def _clipped(values: Floats, limit: Floats, rounded: float) -> tuple[Floats, Floats, Floats]:
    """clip(x, ±s) with rounded corners, and its derivatives by x and by s."""
    width = rounded * limit
    above, below = np.hypot(values + limit, width), np.hypot(values - limit, width)
    up, down = (values + limit) / above, (values - limit) / below
    by_limit = 0.5 * (up + down) + 0.5 * rounded * width * (1 / above - 1 / below)
    return 0.5 * (above - below), 0.5 * (up - down), by_limit
