"""Finite Fourier series: periodic, so that repetitions average noise, and derivatives are known without filters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.arrays import Floats
from echelon.excite.families.basis import Basis


@dataclass(frozen=True)
class Fourier(Basis):
    """1, sin(ωt), cos(ωt), sin(2ωt), … of a period (J. Swevers et al., IEEE Trans. Robotics and Automation 13, 1997).

    Attributes
    ----------
    duration : float
        The period 2π/ω, s.
    harmonics : int
    """

    duration: float
    harmonics: int

    @property
    def size(self) -> int:
        """One constant, two functions per harmonic."""
        return 1 + 2 * self.harmonics

    @property
    def frequency(self) -> float:
        """Of the last harmonic, Hz."""
        return self.harmonics / self.duration

    @property
    def periodic(self) -> bool:
        """Always."""
        return True

    def values(self, t: Floats, order: int = 0) -> Floats:
        """Derivatives of all functions, shape (N, size)."""
        found = np.zeros((len(t), self.size))
        found[:, 0] = float(order == 0)
        for k, rate in enumerate(self._rates):
            # every derivative turns by a quarter
            angle = rate * t + order * np.pi / 2
            found[:, 1 + 2 * k] = rate**order * np.sin(angle)
            found[:, 2 + 2 * k] = rate**order * np.cos(angle)
        return found

    def bounds(self, coefficients: Floats, order: int) -> Floats:
        """Sum of the amplitudes, shape (n,)."""
        pairs = coefficients[1:].reshape(self.harmonics, 2, -1)
        amplitudes: Floats = np.vstack([np.abs(coefficients[:1]), np.linalg.norm(pairs, axis=1)])
        rates: Floats = np.append(0.0, self._rates)
        total: Floats = np.asarray(rates**order) @ amplitudes
        return total

    @property
    def _rates(self) -> Floats:
        found: Floats = 2 * np.pi / self.duration * np.arange(1.0, self.harmonics + 1)
        return found
