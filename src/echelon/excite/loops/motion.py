"""Motions of mechanisms with loops, and what functions of the whole state are as functions of the independent one.

With x̂ the velocities in units of :attr:`ClosureValues.units`, D the dependent ones and P a left inverse of the columns
J_D, all dependent quantities are −P times what the independent ones leave open, and all multipliers Pᵀ times the slope
by the dependent ones.  Redundant equations are compatible, so any left inverse gives the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.excite.loops.positions import Closed, LoopPositions, quaternion_parts

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Slopes:
    """Derivatives of one function by the state of all coordinates, one for each sample; None where there are none.

    Attributes
    ----------
    q : array of shape (N, positions)
    qd, qdd : array of shape (N, velocities)
    v : array of shape (N, velocities, outputs)
        By virtual velocities, rad/s or m/s.
    virtual : array of shape (N, freedoms, outputs)
        These, as :meth:`LoopMotion.virtual` found them.
    openness : array of shape (N,)
    """

    q: Floats | None = None
    qd: Floats | None = None
    qdd: Floats | None = None
    v: Floats | None = None
    virtual: Floats | None = None
    openness: Floats | None = None


class LoopMotion(LoopPositions):
    """Closed states from independent ones, and derivatives.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    def at(self, q: Floats, qd: Floats, qdd: Floats) -> Closed:
        """States of all coordinates.

        Parameters
        ----------
        q, qd, qdd : arrays of shape (N, k)
            Of the independent coordinates.
        """
        closed = self.positioned(q)
        rates = self._completed_rates(closed, qd, np.zeros(closed.jacobian.shape[:2]))
        bias = self.kernels.bias(closed.q, rates)
        return replace(closed, qd=rates, qdd=self._completed_rates(closed, qdd, bias))

    def virtual(self, closed: Closed, given: Floats) -> Floats:
        """Virtual velocities of all freedoms that belong to outputs, shape (N, freedoms, outputs), in units of speeds.

        Parameters
        ----------
        closed : Closed
        given : array of shape (freedoms, outputs)
            Those that outputs determine, see :meth:`given_speeds`.
        """
        moved = np.repeat(given[None], len(closed.q), axis=0)
        moved[:, self._dependent] -= closed.inverse @ (closed.jacobian @ given)
        return moved

    def given_speeds(self) -> Floats:
        """Virtual velocities that the outputs determine, shape (freedoms, outputs), in units of speeds."""
        found = np.zeros((len(self.closures.freedoms), len(self._virtual)))
        for column, motion in enumerate(self._virtual):
            for name, speed in motion.items():
                place = self.closures.freedoms.index(name)
                found[place, column] = speed / self.closures.units[place]
        return found

    def _completed_rates(self, closed: Closed, independent: Floats, bias: Floats) -> Floats:
        units = self._speed_units
        given = independent / units[self._independent]
        opening = (closed.jacobian[:, :, self._independent] @ given[:, :, None])[:, :, 0] + bias
        found = np.zeros((len(given), len(units)))
        found[:, self._independent] = given
        found[:, self._dependent] = -(closed.inverse @ opening[:, :, None])[:, :, 0]
        found[~closed.done] = 0.0
        rates: Floats = found * units
        return rates

    # -- derivatives -----------------------------------------------------------------------------------------------

    def pulled(self, closed: Closed, slopes: Slopes) -> tuple[Floats, Floats, Floats]:
        """Derivatives by the independent q, q̇ and q̈, each of shape (N, k), from those by the whole state.

        Zero for samples whose loops are not closed.

        Parameters
        ----------
        closed : Closed
            As :meth:`at` found it.
        slopes : Slopes
        """
        free, units = self._independent, self._speed_units
        by_q = np.zeros_like(closed.q) if slopes.q is None else slopes.q.copy()
        by_qd = np.zeros_like(closed.qd) if slopes.qd is None else slopes.qd * units
        by_qdd = np.zeros_like(closed.qdd) if slopes.qdd is None else slopes.qdd * units
        A = self._by_jacobian(closed, slopes)
        # J q̈ + b = 0, then J q̇ = 0, then c = 0
        multiplier = self._multiplier(closed, by_qdd)
        A[:, :, : len(units)] -= multiplier[:, :, None] * (closed.qdd / units)[:, None, :]
        from_bias = self.kernels.pulled_bias(closed.q, closed.qd, multiplier)
        by_q, by_qd = by_q - from_bias[0], by_qd - from_bias[1] * units
        third = by_qdd[:, free] - self._left(closed, multiplier)
        multiplier = self._multiplier(closed, by_qd)
        A[:, :, : len(units)] -= multiplier[:, :, None] * (closed.qd / units)[:, None, :]
        second = by_qd[:, free] - self._left(closed, multiplier)
        by_q += self.kernels.pulled_jacobian(closed.q, A)
        turned = self._by_motion(closed.q, by_q) * units
        first = turned[:, free] - self._left(closed, self._multiplier(closed, turned))
        found = [np.where(closed.done[:, None], part / units[free], 0.0) for part in (first, second, third)]
        return found[0], found[1], found[2]

    def _by_jacobian(self, closed: Closed, slopes: Slopes) -> Floats:
        """Derivatives by J, of what depends on it directly and through virtual velocities: J v = 0."""
        A = np.zeros_like(closed.jacobian)
        if slopes.openness is not None:
            # d(tr PPᵀ) = −2 tr(PPᵀ P dJ)
            weight = (slopes.openness * closed.openness**3)[:, None, None]
            inner = closed.inverse @ closed.inverse.swapaxes(1, 2) @ closed.inverse
            A[:, :, self._dependent] += weight * inner.swapaxes(1, 2)
        if slopes.v is not None and slopes.virtual is not None:
            by_v = (slopes.v * self._speed_units[:, None])[:, self._dependent]
            A -= closed.inverse.swapaxes(1, 2) @ by_v @ slopes.virtual.swapaxes(1, 2)
        return A

    def _multiplier(self, closed: Closed, slope: Floats) -> Floats:
        found: Floats = (closed.inverse.swapaxes(1, 2) @ slope[:, self._dependent, None])[:, :, 0]
        return found

    def _left(self, closed: Closed, multiplier: Floats) -> Floats:
        independent = closed.jacobian[:, :, self._independent]
        found: Floats = (independent.swapaxes(1, 2) @ multiplier[:, :, None])[:, :, 0]
        return found

    def _by_motion(self, q: Floats, by_q: Floats) -> Floats:
        """Derivatives along the motions of all velocity coordinates, from those by the positions."""
        found = np.zeros((len(q), len(self._speed_units)))
        found[:, self._single[1]] = by_q[:, self._single[0]]
        for place, speed in self._balls:  # the transpose of half a product with the velocity
            (w, vector), (by_w, by_vector) = quaternion_parts(q, place), quaternion_parts(by_q, place)
            found[:, speed : speed + 3] = (w * by_vector - vector * by_w - np.cross(vector, by_vector)) / 2
        return found
