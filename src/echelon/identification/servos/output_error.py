"""The output-error problem of servos: Gauss–Newton steps with Levenberg's damping towards the measured positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.identification.correlation import CorrelationSums
from echelon.identification.servos.servo_motion import ServoMotion, Windows

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
            raise InputError("the robot with its starting values cannot be simulated: is its mass matrix positive?")
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
