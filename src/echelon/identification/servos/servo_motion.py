"""The motion of a robot whose joints are servos, with its derivatives by all parameters, fitted to measured positions.

A hobby servo is commanded to a position u and pulls with Kp (u − q); with friction and the bodies' inertia the robot's
equation is y(q, q̇, q̈; u) = 0, where y = X̄ ζ̄ holds the gains among its parameters.  The implicit midpoint rule, of
second order and stable however stiff friction is (Hairer, Lubich and Wanner, "Geometric Numerical Integration", 2006),
asks for the acceleration a of a step h with y(q + h/2 v + h²/4 a, v + h/2 a, a; ū) = 0, ū being the command's mean over
the step.  Newton's matrix is M + h/2 ∂y/∂q̇ + h²/4 ∂y/∂q, and the same matrix gives the derivatives of a by the
parameters: they are those of the computed motion, not of an idealised one.

Many windows of a log are simulated side by side, each a little before it counts: what its first state has wrong the
servos take away in that time.  The fit takes Gauss–Newton steps with Levenberg's damping.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Flags, Floats, Integers
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.correlation import CorrelationSums
from echelon.logs.recording import Segment
from echelon.mechanism.mechanism import Mechanism

Slopes = tuple[Floats, Floats, Floats]
"""Newton's matrix, and derivatives of the forces by positions and velocities, shapes (W, n, n)."""

_STEP = 5e-3
"""Longest step, s: a servo's bandwidth is some 10 Hz."""
_NEWTON, _KEPT = 24, 6
_CONVERGED = 1e-6
_SIGN = re.compile(r"sign\(")


def smooth(mechanism: Mechanism, speed: float) -> Mechanism:
    """The mechanism with friction that turns its sign within some speed, rad/s or m/s: tanh(q̇/speed)."""
    effects = tuple(
        replace(e, actions=tuple(replace(a, term=_smoothed(a.term, speed)) for a in e.actions))
        for e in mechanism.effects
    )
    return replace(mechanism, effects=effects)


def _smoothed(term: str, speed: float) -> str:
    """``sign(x)`` as ``tanh((x)*k)``, also where x has parentheses."""
    found = _SIGN.search(term)
    if found is None:
        return term
    depth, end = 1, found.end()
    while depth:
        depth += {"(": 1, ")": -1}.get(term[end], 0)
        end += 1
    inner = term[found.end() : end - 1]
    return f"{term[: found.start()]}tanh(({inner})*{1 / speed:.6g}){_smoothed(term[end:], speed)}"


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
        return max(1, int(np.ceil(1 / (self.rate * _STEP) - 1e-9)))

    @property
    def step(self) -> float:
        """Length of a step, s."""
        return 1 / (self.rate * self.substeps)

    @cached_property
    def measured(self) -> Floats:
        """Positions that count, shape (W, length, n)."""
        first = self.run_in + 1
        return np.stack([self.segments[k].signals["q"][b + first : b + first + self.length] for k, b in self.begins])

    @cached_property
    def start(self) -> tuple[Floats, Floats]:
        """Measured positions, and velocities as differences, where the windows begin, shapes (W, n)."""
        q = np.stack([self.segments[k].signals["q"][b] for k, b in self.begins])
        after = np.stack([self.segments[k].signals["q"][b + 1] for k, b in self.begins])
        before = np.stack([self.segments[k].signals["q"][max(b - 1, 0)] for k, b in self.begins])
        spans = np.where(self.begins[:, 1] > 0, 2.0, 1.0)
        return q, (after - before) / spans[:, None] * self.rate

    def commands(self, names: Sequence[str], delay: float) -> tuple[Floats, Floats]:
        """Means of the held commands over the steps, and their derivatives by the delay, shapes (W, steps, n)."""
        steps = (self.run_in + self.length) * self.substeps
        edges = np.arange(steps + 1) * self.step
        means, slopes = [], []
        for k, first in self.begins:
            held = np.stack([self.segments[k].inputs[name] for name in names], axis=1)
            late = first / self.rate + edges - delay
            integral, value = _integral(held, self.rate, late)
            means.append(np.diff(integral, axis=0) / self.step)
            slopes.append(-np.diff(value, axis=0) / self.step)
        return np.stack(means), np.stack(slopes)


def _integral(held: Floats, rate: float, times: Floats) -> tuple[Floats, Floats]:
    """Integral from 0 of values that are held from sample to sample, and the values themselves, shapes (T, n).

    Before the first sample its value is taken, after the last one the last.
    """
    total = np.vstack([np.zeros_like(held[:1]), np.cumsum(held, axis=0) / rate])
    place = np.clip(np.floor(times * rate + 1e-9).astype(np.intp), 0, len(held) - 1)
    value = held[place]
    integral: Floats = total[place] + (times - place / rate)[:, None] * value
    return integral, value


@dataclass(frozen=True)
class ServoMotion:
    """Simulates windows of logs."""

    base: BaseModel  # with servos at all joints, and smooth friction
    names: tuple[str, ...]  # joints
    gains: tuple[int, ...]  # places of the servos' gains among the base parameters

    def positions(self, windows: Windows, values: Floats, delay: float) -> Floats:
        """Simulated positions, shape (W, length, n); nan if the motion cannot be computed."""
        return self._run(windows, values, delay, derivatives=False)[0]

    def derivatives(self, windows: Windows, values: Floats, delay: float) -> tuple[Floats, Floats]:
        """The same, and derivatives by the base parameters and the delay, shape (W, length, n, r + 1)."""
        return self._run(windows, values, delay, derivatives=True)

    def _run(self, windows: Windows, values: Floats, delay: float, *, derivatives: bool) -> tuple[Floats, Floats]:
        q, v = windows.start
        h, count = windows.step, len(values) + 1
        u, slope = windows.commands(self.names, delay)
        a = np.zeros_like(q)
        by_q = np.zeros((*q.shape, count if derivatives else 0))
        by_v = np.zeros_like(by_q)
        found, slopes = [], []
        newton = None
        for k in range(u.shape[1]):
            inputs = dict(zip(self.names, u[:, k].T, strict=True))
            solved = self._accelerations(q, v, a, inputs, values, h, newton)
            if solved is None:
                shape = (len(q), windows.length, q.shape[1])
                return np.full(shape, np.nan), np.zeros((*shape, by_q.shape[2]))
            a, middle, speed, newton = solved
            if derivatives:
                newton = self._newton(middle, speed, a, values, inputs, h) or newton
                by_a = self._change(middle, speed, a, inputs, slope[:, k], values, newton, by_q, by_v, h)
                by_q = by_q + h * by_v + h**2 / 2 * by_a
                by_v = by_v + h * by_a
            q, v = q + h * speed, v + h * a
            if (k + 1) % windows.substeps == 0 and (k + 1) // windows.substeps > windows.run_in:
                found.append(q)
                slopes.append(by_q)
        return np.stack(found, axis=1), np.stack(slopes, axis=1)

    def _accelerations(
        self,
        q: Floats,
        v: Floats,
        a: Floats,
        inputs: dict[str, Floats],
        values: Floats,
        h: float,
        newton: Slopes | None,
    ) -> tuple[Floats, Floats, Floats, Slopes] | None:
        """Accelerations of a step, its middle state, and the slopes that were used last; None if there are none."""
        for count in range(1, _NEWTON + 1):
            speed = v + h / 2 * a
            middle = q + h / 2 * speed
            if newton is None or count % _KEPT == 0:  # slopes change little from step to step, and cost the most
                newton = self._newton(middle, speed, a, values, inputs, h)
            rest = self.base.predict(middle, speed, a, values, inputs=inputs)
            if newton is None or not np.isfinite(rest).all():
                return None
            change = np.linalg.solve(newton[0], rest[..., None])[..., 0]
            a = a - change
            if np.abs(change).max() <= _CONVERGED * (1 + np.abs(a).max()):
                return a, middle, speed, newton
        return None

    def _newton(
        self, q: Floats, v: Floats, a: Floats, values: Floats, inputs: dict[str, Floats], h: float
    ) -> Slopes | None:
        """Newton's matrix, and slopes by positions and velocities; None where the matrix is singular."""
        by_q, by_v = self.base.inverse_dynamics_derivatives(q, v, a, values, inputs=inputs)
        matrix = self.base.mass_matrix(q, values) + h / 2 * by_v + h**2 / 4 * by_q
        regular = np.isfinite(matrix).all() and np.linalg.cond(matrix).max() < 1 / np.finfo(float).eps
        return (matrix, by_q, by_v) if regular else None

    def _change(
        self,
        middle: Floats,
        speed: Floats,
        a: Floats,
        inputs: dict[str, Floats],
        slope: Floats,
        values: Floats,
        newton: Slopes,
        by_q: Floats,
        by_v: Floats,
        h: float,
    ) -> Floats:
        """Derivatives of the accelerations of a step, shape (W, n, r + 1)."""
        matrix, slope_q, slope_v = newton
        right = slope_q @ (by_q + h / 2 * by_v) + slope_v @ by_v
        right[:, :, :-1] += self.base.regressor(middle, speed, a, inputs=inputs)
        right[:, :, -1] -= values[list(self.gains)] * slope
        return np.asarray(-np.linalg.solve(matrix, right), dtype=np.float64)


_STEPS = 60
_STUCK = 1e8  # damping from which on no step helps
_SETTLED = 1e-2  # standard deviations by which a last step moves


@dataclass(frozen=True)
class OutputErrorProblem:
    """Weighted squares of the differences between measured and simulated positions, and of those from the file."""

    motion: ServoMotion
    windows: Windows
    start: Floats
    delay: float  # at the start, s
    positive: Flags  # shape (r,)
    prior: Floats  # see prior_rows
    fixed: Floats  # shape (c, r): directions along which nothing changes

    def solve(self, step: Callable[[str], None]) -> tuple[Floats, float, Floats, Floats, bool]:
        """Values, delay, covariance of both, noise of the joints, and whether steps became small."""
        free = self._free()
        values = np.append(self.start, self.delay)
        rest, slopes = self._linearised(values)
        if not np.isfinite(rest).all():
            raise InputError(
                "the robot with its starting values cannot be simulated: do servos reach limits of torque or speed, "
                "which the model does not have, or is the mass matrix of the file not positive?"
            )
        noise, damping, converged, count = _noise(rest), 1e-3, False, 0
        while not converged and count < _STEPS and damping < _STUCK:
            count += 1
            step(f"simulating (step {count} of at most {_STEPS})")
            hessian, gradient = self._normal(rest, slopes, noise, values, free)
            change = -np.linalg.solve(hessian + damping * np.diag(np.diagonal(hessian)), gradient)
            tried = self._moved(values, free @ change)
            new, new_slopes = self._linearised(tried)
            if np.isfinite(new).all() and self._cost(new, noise, tried) <= self._cost(rest, noise, values):
                converged = bool(np.sqrt(change @ hessian @ change / len(change)) < _SETTLED)
                values, rest, slopes, noise, damping = tried, new, new_slopes, _noise(new), max(damping / 5, 1e-9)
            else:
                damping *= 8
        inflated = noise * np.sqrt(_inflation(rest))
        hessian, _ = self._normal(rest, slopes, inflated, values, free)
        scale = 1 / np.sqrt(np.diagonal(hessian))
        inverse = scale[:, None] * np.linalg.pinv(hessian * np.outer(scale, scale), hermitian=True) * scale
        return values[:-1], float(values[-1]), free @ inverse @ free.T, noise, converged

    def _free(self) -> Floats:
        """Basis of the changes that are allowed, of parameters and delay, shape (r + 1, d)."""
        count = len(self.start)
        held = np.hstack([self.fixed, np.zeros((len(self.fixed), 1))])
        sizes = np.abs(self.start)
        scale = np.append(np.where(sizes > 0, sizes, 1.0), 1e-2)
        _, singular, right = np.linalg.svd(held * scale, full_matrices=True)
        rank = int(np.sum(singular > 1e-12 * singular.max(initial=1e-300)))
        basis: Floats = scale[:, None] * right[rank:].T
        return basis.reshape(count + 1, -1)

    def _moved(self, values: Floats, change: Floats) -> Floats:
        """Values after a step that leaves positive ones positive: their logarithms change, by no more than 1."""
        tried = values + change
        some = np.flatnonzero(self.positive)
        tried[some] = values[some] * np.exp(np.clip(change[some] / values[some], -1.0, 1.0))
        return tried

    def _linearised(self, values: Floats) -> tuple[Floats, Floats]:
        found, slopes = self.motion.derivatives(self.windows, values[:-1], float(values[-1]))
        return found - self.windows.measured, slopes

    def _cost(self, rest: Floats, noise: Floats, values: Floats) -> float:
        return float(np.sum((rest / noise) ** 2) + np.sum((self.prior @ (values[:-1] - self.start)) ** 2))

    def _normal(
        self, rest: Floats, slopes: Floats, noise: Floats, values: Floats, free: Floats
    ) -> tuple[Floats, Floats]:
        along = (slopes / noise[:, None]).reshape(-1, slopes.shape[-1]) @ free
        weighted = (rest / noise).reshape(-1)
        prior = self.prior @ free[:-1]
        hessian = along.T @ along + prior.T @ prior
        gradient = along.T @ weighted + prior.T @ (self.prior @ (values[:-1] - self.start))
        return hessian, gradient


def _noise(rest: Floats) -> Floats:
    """Standard deviations of joints, shape (n,)."""
    found: Floats = np.maximum(np.sqrt(np.mean(rest**2, axis=(0, 1))), 1e-9)
    return found


def _inflation(rest: Floats) -> Floats:
    """Samples that say as much as one, because differences resemble their neighbours, shape (n,)."""
    found = []
    for joint in range(rest.shape[2]):
        sums = CorrelationSums(rest.shape[1])
        for window, values in enumerate(rest[:, :, joint]):
            sums.add(np.arange(float(len(values))), values, window)
        found.append(max(1.0, sums.result().time))
    return np.array(found)
