"""Output-error fit: parameters with which the simulated motion of servos is nearest to the measured one.

First positions of windows are as uncertain as any measured one, first velocities may be anything, and what they explain
of a window counts for nothing else.  The fit takes Gauss–Newton steps with Levenberg's damping.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.linalg import norm

from echelon.identification.autocorrelation import CorrelationSums
from echelon.identification.servos.servo_limits import Limits
from echelon.identification.servos.servo_motion import ServoMotion, Windows
from echelon.shared import Flags, Floats, InputError

FIRST_SPEED = 10.0  # error of first velocities, in noise of positions from one sample to the next: they may be anything

ROUNDED = 0.05  # share of limits within which corners are rounded at first, so that unreached limits have derivatives


@dataclass(frozen=True)
class ServoSolution:
    """Parameters, delay and limits that an output-error fit finds."""

    values: Floats  # shape (r,)
    delay: float  # s
    limits: Limits
    covariance: Floats  # of values, delay and limits, shape (r + 1 + l, r + 1 + l)
    noise: Floats  # of the joints, shape (n,)
    converged: bool  # whether steps became small


@dataclass(frozen=True)
class OutputErrorProblem:
    """Weighted squares of the differences between measured and simulated positions, and of those from the file."""

    motion: ServoMotion
    windows: Windows
    start: Floats
    delay: float  # at the start, s
    limits: Limits  # at the start; those that there are change
    positive: Flags  # shape (r,)
    prior: Floats  # see prior_rows
    fixed: Floats  # shape (c, r): directions along which nothing changes
    most_steps: int = 60
    settled: float = 1e-2  # standard deviations by which a last step moves at most
    stuck: float = 1e8  # damping from which on no step helps

    def solve(self, step: Callable[[str], None]) -> ServoSolution:
        """The values from which the motion is nearest to the measured one."""
        values = np.concatenate([self.start, [self.delay], self.limits.values])
        for corner in (ROUNDED, 0.0) if self.limits.active else (0.0,):
            values, solution = replace(
                self, limits=replace(self.limits, corner=corner)
            )._descended(values, step)
        return solution

    def _descended(
        self, values: Floats, step: Callable[[str], None]
    ) -> tuple[Floats, ServoSolution]:
        """Values from which the motion is nearest, from others on, corners of limits being as rounded as they are."""
        free = self._free()
        rest, slopes = self._linearised(values)
        if not np.isfinite(rest).all():
            raise InputError(
                "the robot cannot be simulated with its starting values: check signs, units and order of the "
                "commands, and whether the file's mass matrix is positive"
            )
        noise, damping, converged, count = _noise(rest), 1e-3, False, 0
        while not converged and count < self.most_steps and damping < self.stuck:
            count += 1
            step(f"simulating (step {count} of at most {self.most_steps})")
            hessian, gradient = self._normal(rest, slopes, noise, values, free)
            change = -np.linalg.solve(
                hessian + damping * np.diag(_sizes(hessian)), gradient
            )
            tried = self._moved(values, free @ change)
            new, new_slopes = self._linearised(tried, noise)
            worse = self._cost(new, noise, tried) - self._cost(rest, noise, values)
            # what first states explain changes a little from step to step
            if worse <= self.settled * len(change):
                converged = bool(
                    self._distance(tried - values, slopes, noise)
                    < self.settled * np.sqrt(len(change))
                )
                values = tried
                rest = new
                slopes = new_slopes
                noise = _noise(new)
                damping = max(damping / 5, 1e-9)
            else:
                damping *= 8
        inflated = noise * np.sqrt(_inflation(rest))
        hessian, _ = self._normal(rest, slopes, inflated, values, free)
        scale = 1 / np.sqrt(_sizes(hessian))
        inverse = (
            scale[:, None]
            * np.linalg.pinv(hessian * np.outer(scale, scale), hermitian=True)
            * scale
        )
        r = len(self.start)
        limits = self.limits.moved(values[r + 1 :])
        return values, ServoSolution(
            values[:r],
            float(values[r]),
            limits,
            free @ inverse @ free.T,
            noise,
            converged,
        )

    def _free(self) -> Floats:
        """Basis of the changes that are allowed, of parameters, delay and limits, shape (r + 1 + l, d)."""
        count, more = len(self.start), self.limits.values
        held = np.hstack([self.fixed, np.zeros((len(self.fixed), 1 + len(more)))])
        sizes = np.abs(self.start)
        scale = np.concatenate([np.where(sizes > 0, sizes, 1.0), [1e-2], more])
        _, singular, right = np.linalg.svd(held * scale, full_matrices=True)
        rank = int(np.sum(singular > 1e-12 * singular.max(initial=1e-300)))
        basis: Floats = scale[:, None] * right[rank:].T
        return basis.reshape(count + 1 + len(more), -1)

    def _moved(self, values: Floats, change: Floats) -> Floats:
        """Values after a step that leaves positive ones positive: their logarithms change, by no more than 1."""
        tried = values + change
        some = np.flatnonzero(
            np.concatenate(
                [self.positive, [False], np.ones(len(self.limits.values), dtype=bool)]
            )
        )
        tried[some] = values[some] * np.exp(
            np.clip(change[some] / values[some], -1.0, 1.0)
        )
        return tried

    def _linearised(
        self, values: Floats, noise: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Differences of positions, and their derivatives, apart from those that first states explain."""
        r, n = len(self.start), len(self.motion.names)
        limits = self.limits.moved(values[r + 1 :])
        found, slopes = self.motion.derivatives(
            self.windows, values[:r], float(values[r]), limits
        )
        rest = found - self.windows.measured
        if not np.isfinite(rest).all():
            return rest, slopes[..., : -2 * n]
        noise = _noise(rest) if noise is None else noise
        states = np.concatenate([noise, FIRST_SPEED * self.windows.rate * noise])
        both = np.concatenate([rest[..., None], slopes[..., : -2 * n]], axis=3)
        both = (
            _apart(
                both / noise[:, None], slopes[..., -2 * n :] * states / noise[:, None]
            )
            * noise[:, None]
        )
        return both[..., 0], both[..., 1:]

    def _cost(self, rest: Floats, noise: Floats, values: Floats) -> float:
        return float(
            np.sum((rest / noise) ** 2)
            + np.sum((self.prior @ (values[: len(self.start)] - self.start)) ** 2)
        )

    def _distance(self, change: Floats, slopes: Floats, noise: Floats) -> float:
        """Standard deviations by which values move."""
        return float(
            np.hypot(
                norm(slopes @ change / noise),
                norm(self.prior @ change[: len(self.start)]),
            )
        )

    def _normal(
        self, rest: Floats, slopes: Floats, noise: Floats, values: Floats, free: Floats
    ) -> tuple[Floats, Floats]:
        along = (slopes / noise[:, None]).reshape(-1, slopes.shape[-1]) @ free
        weighted = (rest / noise).reshape(-1)
        r = len(self.start)
        prior = self.prior @ free[:r]
        hessian = along.T @ along + prior.T @ prior
        gradient = along.T @ weighted + prior.T @ (
            self.prior @ (values[:r] - self.start)
        )
        return hessian, gradient


def _apart(values: Floats, states: Floats) -> Floats:
    """Values (W, length, n, …) in units of noise that is white again where first states add theirs, (…, 2n) each."""
    table, by = (
        some.reshape(len(some), -1, some.shape[3]) for some in (values, states)
    )
    left, singular, _ = np.linalg.svd(by, full_matrices=False)
    kept = 1 / np.sqrt(1 + singular**2)
    found = table + left @ ((kept - 1)[:, :, None] * (left.swapaxes(1, 2) @ table))
    return np.asarray(found.reshape(values.shape))


def _sizes(hessian: Floats) -> Floats:
    """Its diagonal, which is positive where a limit that the data do not reach leaves none."""
    diagonal = np.diagonal(hessian)
    found: Floats = np.maximum(diagonal, 1e-12 * diagonal.max())
    return found


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
