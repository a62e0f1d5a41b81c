"""The motion of a robot whose joints are servos, with its derivatives by all parameters.

A hobby servo is commanded to a position u and pulls with Kp (u − q); with friction and the bodies' inertia the robot's
equation is y(q, q̇, q̈; u) = 0, where y = X̄ ζ̄ holds the gains among its parameters.  The implicit midpoint rule, of
second order and stable however stiff friction is (Hairer, Lubich and Wanner, "Geometric Numerical Integration", 2006),
asks for the acceleration a of a step h with y(q + h/2 v + h²/4 a, v + h/2 a, a; ū) = 0, ū being the command's mean over
the step.  Newton's matrix is M + h/2 ∂y/∂q̇ + h²/4 ∂y/∂q, and the same matrix gives the derivatives of a by the
parameters: they are those of the computed motion, not of an idealised one.

Many windows of a log are simulated side by side, each a little before it counts: what its first state has wrong the
servos take away in that time.  A servo that pulls as hard as it can takes nothing away, so that the motion has
derivatives by first states as well.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.base import BaseModel
from echelon.identification.logs.recording import Segment
from echelon.identification.servos.servo_limits import Limits
from echelon.robot import Mechanism, read_term
from echelon.shared import Floats, Integers

Slopes = tuple[Floats, Floats, Floats]
"""Newton's matrix, and derivatives of the forces by positions and velocities, shapes (W, n, n)."""

LONGEST_STEP = 5e-3
"""Longest step, s: a servo's bandwidth is some 10 Hz."""


def smooth(mechanism: Mechanism, speed: float) -> Mechanism:
    """The mechanism with friction that turns its sign within some speed, rad/s or m/s: tanh(q̇/speed)."""

    def smoothed(term: str) -> str:
        return _smoothed(term, speed)

    effects = tuple(effect.with_terms(smoothed) for effect in mechanism.effects)
    return replace(mechanism, effects=effects)


def _smoothed(term: str, speed: float) -> str:
    """``sign(x)`` as ``tanh((x)*k)``."""
    read = read_term(term)
    for part in read.parts:
        match part:
            case ast.Call(func=ast.Name(id="sign"), args=[inner]):
                tanh = f"tanh(({read.source(inner)})*{1 / speed:.6g})"
                return _smoothed(read.replaced({part: tanh}), speed)
    return read.text


@dataclass(frozen=True)
class Windows:
    """Parts of segments that are simulated side by side, all of one length."""

    segments: tuple[Segment, ...]
    begins: Integers  # shape (W, 2): segment and first sample
    run_in: int  # samples before a window counts
    length: int  # samples that count
    rate: float

    @cached_property
    def substeps(self) -> int:
        """Steps of a sample."""
        return max(1, int(np.ceil(1 / (self.rate * LONGEST_STEP) - 1e-9)))

    @property
    def step(self) -> float:
        """Length of a step, s."""
        return 1 / (self.rate * self.substeps)

    @cached_property
    def measured(self) -> Floats:
        """Positions that count, shape (W, length, n)."""
        first = self.run_in + 1
        return np.stack(
            [
                self.segments[k].signals["q"][b + first : b + first + self.length]
                for k, b in self.begins
            ]
        )

    @cached_property
    def start(self) -> tuple[Floats, Floats]:
        """Measured positions, and velocities as differences, where the windows begin, shapes (W, n)."""
        q = np.stack([self.segments[k].signals["q"][b] for k, b in self.begins])
        after = np.stack([self.segments[k].signals["q"][b + 1] for k, b in self.begins])
        before = np.stack(
            [self.segments[k].signals["q"][max(b - 1, 0)] for k, b in self.begins]
        )
        spans = np.where(self.begins[:, 1] > 0, 2.0, 1.0)
        return q, (after - before) / spans[:, None] * self.rate

    def commands(self, names: Sequence[str], delay: float, limits: Limits) -> Commands:
        """Followed commands in the steps of all windows."""
        steps = (self.run_in + self.length) * self.substeps
        edges = np.arange(steps + 1) * self.step
        asked = [
            np.stack([segment.inputs[name] for name in names], axis=1)
            for segment in self.segments
        ]
        rate, followed = self.rate, [(held, np.zeros_like(held)) for held in asked]
        if np.isfinite(limits.speed).any():
            rate = 1 / self.step
            followed = [
                limits.followed(held, self.rate, self.substeps) for held in asked
            ]
        values, shares, slopes = [], [], []
        for k, first in self.begins:
            held, by_speed = followed[k]
            # in samples; before the first its value is taken
            late = (first / self.rate + edges - delay) * rate
            place = np.clip(np.floor(late + 1e-9).astype(np.intp), 0, len(held) - 1)
            after = np.clip((late - place)[1:] / (rate * self.step), 0.0, 1.0)
            values.append([held[place[:-1]], held[place[1:]]])
            slopes.append([by_speed[place[:-1]], by_speed[place[1:]]])
            shares.append(np.stack([1 - after, after])[..., None])
        return Commands(
            *(
                np.moveaxis(np.array(some), (0, 2), (2, 0))
                for some in (values, slopes, shares)
            )
        )


@dataclass(frozen=True)
class Commands:
    """Commands before and after they change, which they do once in a step at most."""

    values: Floats  # shape (steps, 2, W, n)
    # derivatives by the speed that limits them, shape (steps, 2, W, n)
    by_speed: Floats
    shares: Floats  # of the step, shape (steps, 2, W, 1)

    @property
    def means(self) -> Floats:
        """Means over the steps, shape (steps, W, n)."""
        found: Floats = (self.shares * self.values).sum(axis=1)
        return found


@dataclass(frozen=True)
class ServoMotion:
    """Simulates windows of logs."""

    base: BaseModel  # with servos at all joints, and smooth friction
    names: tuple[str, ...]  # joints
    gains: tuple[int, ...]  # places of the servos' gains among the base parameters
    most_steps: int = 60  # of Newton's method, for the acceleration of a step
    kept: int = 6  # steps for which slopes are kept; after twice as many they are made anew, then steps are halved
    converged: float = 1e-6  # relative change of accelerations that is none: far below what positions show

    def positions(
        self,
        windows: Windows,
        values: Floats,
        delay: float,
        limits: Limits | None = None,
    ) -> Floats:
        """Simulated positions, shape (W, length, n); nan if the motion cannot be computed."""
        return self._run(
            windows,
            values,
            delay,
            limits or Limits.none(len(self.names)),
            derivatives=False,
        )[0]

    def derivatives(
        self,
        windows: Windows,
        values: Floats,
        delay: float,
        limits: Limits | None = None,
    ) -> tuple[Floats, Floats]:
        """Simulated positions, and their derivatives by parameters, delay, limits and first states.

        Shapes (W, length, n) and (W, length, n, r + 1 + l + 2n).
        """
        return self._run(
            windows,
            values,
            delay,
            limits or Limits.none(len(self.names)),
            derivatives=True,
        )

    def _run(
        self,
        windows: Windows,
        values: Floats,
        delay: float,
        limits: Limits,
        *,
        derivatives: bool,
    ) -> tuple[Floats, Floats]:
        q, v = windows.start
        h = windows.step
        n = q.shape[1]
        count = len(values) + 1 + len(limits.active) + 2 * q.shape[1]
        commands = windows.commands(self.names, delay, limits)
        a = np.zeros_like(q)
        by_q = np.zeros((*q.shape, count if derivatives else 0))
        by_v = np.zeros_like(by_q)
        if derivatives:
            by_q[:, :, -2 * n : -n] = by_v[:, :, -n:] = np.eye(n)
        found, slopes = [], []
        newton = None
        gains = values[list(self.gains)]
        for k, (u, by_speed, shares) in enumerate(
            zip(commands.values, commands.by_speed, commands.shares, strict=True)
        ):
            servos = _Servos(self.names, u, by_speed, shares, gains, limits)
            solved = self._accelerations(q, v, a, servos, values, h, newton)
            if solved is None:
                shape = (len(q), windows.length, n)
                return np.full(shape, np.nan), np.zeros((*shape, by_q.shape[2]))
            a, middle, speed, newton = solved
            if derivatives:
                newton = self._newton(middle, speed, a, values, servos, h) or newton
                by_a = self._change(
                    middle, speed, a, servos, values, newton, by_q, by_v, h
                )
                by_q = by_q + h * by_v + h**2 / 2 * by_a
                by_v = by_v + h * by_a
            q, v = q + h * speed, v + h * a
            if (k + 1) % windows.substeps == 0 and (
                k + 1
            ) // windows.substeps > windows.run_in:
                found.append(q)
                slopes.append(by_q)
        return np.stack(found, axis=1), np.stack(slopes, axis=1)

    def _accelerations(
        self,
        q: Floats,
        v: Floats,
        a: Floats,
        servos: _Servos,
        values: Floats,
        h: float,
        newton: Slopes | None,
    ) -> tuple[Floats, Floats, Floats, Slopes] | None:
        """Accelerations of a step, its middle state, and the slopes that were used last; None if there are none."""
        for count in range(1, self.most_steps + 1):
            speed = v + h / 2 * a
            middle = q + h / 2 * speed
            # slopes change little from step to step, and cost the most, but for friction that turns its sign
            if newton is None or count % self.kept == 0 or count > 2 * self.kept:
                newton = self._newton(middle, speed, a, values, servos, h)
            rest = self.base.predict(
                middle, speed, a, values, inputs=servos.inputs(middle)
            )
            if newton is None or not np.isfinite(rest).all():
                return None
            change = np.linalg.solve(newton[0], rest[..., None])[..., 0]
            a = a - change * (1.0 if count <= 3 * self.kept else 0.5)
            if np.abs(change).max() <= self.converged * (1 + np.abs(a).max()):
                return a, middle, speed, newton
        return None

    def _newton(
        self, q: Floats, v: Floats, a: Floats, values: Floats, servos: _Servos, h: float
    ) -> Slopes | None:
        """Newton's matrix, and slopes by positions and velocities; None where the matrix is singular."""
        by_q, by_v = self.base.inverse_dynamics_derivatives(
            q, v, a, values, inputs=servos.inputs(q)
        )
        by_q = servos.with_stiffness(by_q, q)
        matrix = self.base.mass_matrix(q, values) + h / 2 * by_v + h**2 / 4 * by_q
        regular = (
            np.isfinite(matrix).all()
            and np.linalg.cond(matrix).max() < 1 / np.finfo(float).eps
        )
        return (matrix, by_q, by_v) if regular else None

    def _change(
        self,
        middle: Floats,
        speed: Floats,
        a: Floats,
        servos: _Servos,
        values: Floats,
        newton: Slopes,
        by_q: Floats,
        by_v: Floats,
        h: float,
    ) -> Floats:
        """Derivatives of the accelerations of a step, shape (W, n, r + 1 + l + 2n)."""
        matrix, slope_q, slope_v = newton
        right = slope_q @ (by_q + h / 2 * by_v) + slope_v @ by_v
        right[:, :, : len(values)] += self.base.regressor(
            middle, speed, a, inputs=servos.inputs(middle)
        )
        driven = servos.slopes(middle, h)
        right[:, :, len(values) : len(values) + driven.shape[2]] -= driven
        return np.asarray(-np.linalg.solve(matrix, right), dtype=np.float64)


@dataclass(frozen=True)
class _Servos:
    """Servos in a step of all windows, before and after their commands change."""

    names: tuple[str, ...]
    commands: Floats  # followed, shape (2, W, n)
    by_speed: Floats  # their derivatives by the speed that limits them, shape (2, W, n)
    shares: Floats  # of the step, shape (2, W, 1)
    gains: Floats  # shape (n,)
    limits: Limits

    @cached_property
    def _are_limited(self) -> bool:
        return any(kind != "speed" for kind, _ in self.limits.active)

    def _mean(self, values: Floats) -> Floats:
        found: Floats = (self.shares * values).sum(axis=0)
        return found

    def inputs(self, q: Floats) -> dict[str, Floats]:
        """Commands that servos without limits would pull alike for, by joint."""
        limited = self._are_limited
        u = (
            q + self._mean(self.limits.held(self.commands - q))
            if limited
            else self._mean(self.commands)
        )
        return dict(zip(self.names, u.T, strict=True))

    def with_stiffness(self, by_q: Floats, q: Floats) -> Floats:
        """Derivatives of the forces by positions, (W, n, n), where servos at their limits pull no more."""
        if not self._are_limited:
            return by_q
        missing = self.gains * (
            self._mean(self.limits.pull(self.commands - q).by_error) - 1
        )
        return by_q + missing[:, :, None] * np.eye(len(self.names))

    def slopes(self, q: Floats, h: float) -> Floats:
        """Derivatives of the pulls by the delay and the limits, shape (W, n, 1 + l)."""
        pull, active = self.limits.pull(self.commands - q), self.limits.active
        found = np.zeros((*q.shape, 1 + len(active)))
        found[:, :, 0] = self.gains * (pull.value[0] - pull.value[1]) / h
        by = {
            "torque": pull.by_torque,
            "dead": pull.by_dead,
            "speed": pull.by_error * self.by_speed,
        }
        for place, (kind, j) in enumerate(active, 1):
            found[:, j, place] = self.gains[j] * self._mean(by[kind])[:, j]
        return found
