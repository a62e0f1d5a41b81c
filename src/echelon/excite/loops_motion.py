"""Motions of mechanisms with loops, and what functions of the whole state are as functions of the independent one.

Configurations are followed from the assembly pose in short steps, as :class:`Assembly` does it, but samples that cannot
be closed are told and not refused: a solver tries motions beyond what the loops allow.  A sample that has moved little
since it was last asked for is followed from there.

With x̂ the velocities in units of :attr:`ClosureValues.units`, D the dependent ones and P a left inverse of the columns
J_D, all dependent quantities are −P times what the independent ones leave open, and all multipliers Pᵀ times the slope
by the dependent ones.  Redundant equations are compatible, so any left inverse gives the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.excite.loops_closures import ClosureKernels
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.closed_motion import largest
from echelon.regressor.loops.closure_values import normalised

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_STRIDE, _SHORTEST = 0.1, 1e-3  # of a step on the way to a configuration, rad or characteristic lengths
_FEW = 8  # iterations for one step
_LARGEST_CORRECTION = 0.05  # of what is predicted; more may be a jump to another way of assembly
_REMEMBERED = 4  # sets of samples: those of the criterion and of the constraints
_SINGULAR = 1e-9  # relative; beyond this there is no left inverse to speak of


@dataclass(frozen=True)
class Closed:
    """States of all coordinates, and how the dependent ones follow.

    Attributes
    ----------
    q, qd, qdd : arrays of shape (N, ...)
        Of all coordinates.  Where loops are not closed, q is as near as was reached, and the others are zero.
    done : array of bool, shape (N,)
        Where the loops are closed.
    missing : array of shape (N, k)
        What is left of the way to the independent positions, rad or characteristic lengths; 0 where they are reached.
    jacobian : array of shape (N, equations, freedoms)
        J, in units of lengths and speeds.
    inverse : array of shape (N, dependent, equations)
        P; zero where the loops are not closed.
    openness : array of shape (N,)
        (Σ 1/σ²)^(−1/2) over the singular values of J_D: how far the configuration is from a singular one, a smooth
        lower bound of the least of them; zero where the loops are not closed.
    """

    q: Floats
    qd: Floats
    qdd: Floats
    done: Bools
    missing: Floats
    jacobian: Floats
    inverse: Floats
    openness: Floats


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


class LoopMotion(Assembly):
    """Closed states from independent ones, and derivatives.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        mechanism = replace(mechanism, reading=None)  # how a file was read is of no use to another process
        super().__init__(mechanism, symbols)
        self._kernels = ClosureKernels(mechanism, symbols)
        self.closures = self._kernels
        names = mechanism.positions
        self._places = [names.index(name) for name in self.independent_positions]
        self._speed_units = self.closures.units[: len(mechanism.velocities)]
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    # -- states ----------------------------------------------------------------------------------------------------

    def at(self, q: Floats, qd: Floats, qdd: Floats) -> Closed:
        """States of all coordinates.

        Parameters
        ----------
        q, qd, qdd : arrays of shape (N, k)
            Of the independent coordinates.
        """
        closed = self._positioned(q)
        rates = self._completed_rates(closed, qd, np.zeros(closed.jacobian.shape[:2]))
        bias = self._kernels.bias(closed.q, rates)
        return replace(closed, qd=rates, qdd=self._completed_rates(closed, qdd, bias))

    def nearest(self, q: Floats) -> Floats:
        """Positions of all coordinates, shape (N, positions), or the nearest to them that were reached.

        Parameters
        ----------
        q : array of shape (N, k)
            Of the independent coordinates.
        """
        return self._positioned(q).q

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self._speed_units

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        found: Floats = self._position_units[self._places]
        return found

    @cached_property
    def reference(self) -> float:
        """Openness at the assembly pose."""
        return float(self._described(self.pose[None], np.ones(1, dtype=bool), np.zeros((1, 0))).openness[0])

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

    # -- configurations --------------------------------------------------------------------------------------------

    def _positioned(self, wanted: Floats) -> Closed:
        known = self._last.get(len(wanted))
        if known is not None and np.array_equal(known[0], wanted):
            return known[1]
        q = np.repeat(self.pose[None], len(wanted), axis=0)
        gone = np.zeros(len(wanted))
        if known is not None:
            near, done = self._stepped(known[1], wanted)
            q[done], gone[done] = near[done], 1.0
            far = known[1].done & ~done
            q[far], gone[far] = self._followed(known[1].q[far], wanted[far])
        left = gone < 1
        q[left], gone[left] = self._followed(np.repeat(self.pose[None], int(left.sum()), axis=0), wanted[left])
        units = self.independent_units
        missing = np.where(gone[:, None] < 1, (wanted - q[:, self._places]) / units, 0.0)
        closed = self._described(q, gone >= 1, missing)
        self._last = dict([*self._last.items(), (len(wanted), (wanted.copy(), closed))][-_REMEMBERED:])
        return closed

    def _stepped(self, last: Closed, wanted: Floats) -> tuple[Floats, Bools]:
        """One step from what was found before."""
        change = (wanted - last.q[:, self._places]) / self._speed_units[self._independent]
        speeds = np.zeros((len(wanted), len(self._speed_units)))
        speeds[:, self._independent] = change
        opened = last.jacobian[:, :, self._independent] @ change[:, :, None]
        speeds[:, self._dependent] = -(last.inverse @ opened)[:, :, 0]
        done = last.done & (largest(change) < _STRIDE)
        speeds[~done] = 0.0
        guess = self._moved(last.q, speeds)
        found, closed = self.closed(guess, self.mechanism.independent_velocities, _FEW)
        return found, done & closed & self._nearly(guess, found)

    def _followed(self, start: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        """Configurations on the straight ways from closed ones, and which shares of them were gone."""
        q = start.copy()
        begin, units = q[:, self._places], self.independent_units
        extent = np.maximum(largest((wanted - begin) / units), _STRIDE)
        gone, stride, trend = np.zeros(len(q)), _STRIDE / extent, np.zeros_like(q)
        on = np.arange(len(q))
        while len(on):
            reached = np.minimum(gone[on] + stride[on], 1.0)[:, None]
            guess = q[on] + trend[on] * (reached - gone[on, None])
            guess[:, self._places] = (1 - reached) * begin[on] + reached * wanted[on]
            guess = normalised(self.mechanism, guess)
            found, done = self.closed(guess, self.mechanism.independent_velocities, _FEW)
            done &= self._nearly(guess, found)
            trend[on[done]] = (found - q[on])[done] / (reached[:, 0] - gone[on])[done, None]
            q[on[done]], gone[on[done]] = found[done], reached[done, 0]
            stride[on] = np.where(done, np.minimum(1.5 * stride[on], _STRIDE / extent[on]), stride[on] / 2)
            on = on[(gone[on] < 1) & (stride[on] * extent[on] >= _SHORTEST)]
        return q, gone

    def _nearly(self, guess: Floats, found: Floats) -> Bools:
        near: Bools = largest((found - guess) / self._position_units) < _LARGEST_CORRECTION
        return near

    def _described(self, q: Floats, done: Bools, missing: Floats) -> Closed:
        """Configurations with how the dependent velocities follow there."""
        jacobian = self.closures.at(q)[1]
        left, upper = np.linalg.qr(jacobian[:, :, self._dependent])
        sizes = np.abs(np.diagonal(upper, axis1=1, axis2=2))
        done = done & (sizes.min(axis=1, initial=1.0) > _SINGULAR * sizes.max(axis=1, initial=1.0))
        upper[~done] = np.eye(upper.shape[1])
        inverse = np.linalg.solve(upper, left.swapaxes(1, 2))
        openness = (inverse**2).sum(axis=(1, 2)) ** -0.5
        inverse[~done], openness[~done] = 0.0, 0.0
        nothing = np.zeros((len(q), len(self._speed_units)))
        return Closed(q, nothing, nothing, done, missing, jacobian, inverse, openness)

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
        from_bias = self._kernels.pulled_bias(closed.q, closed.qd, multiplier)
        by_q, by_qd = by_q - from_bias[0], by_qd - from_bias[1] * units
        third = by_qdd[:, free] - self._left(closed, multiplier)
        multiplier = self._multiplier(closed, by_qd)
        A[:, :, : len(units)] -= multiplier[:, :, None] * (closed.qd / units)[:, None, :]
        second = by_qd[:, free] - self._left(closed, multiplier)
        by_q += self._kernels.pulled_jacobian(closed.q, A)
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
        place = speed = 0
        for motion in self.mechanism.motions:
            if motion.name in self.mechanism.dependent:
                continue
            if motion.kind is MotionKind.BALL:  # the transpose of half a product with the velocity
                (w, vector), (by_w, by_vector) = _parts(q, place), _parts(by_q, place)
                found[:, speed : speed + 3] = (w * by_vector - vector * by_w - np.cross(vector, by_vector)) / 2
            else:
                found[:, speed] = by_q[:, place]
            place, speed = place + len(motion.positions), speed + len(motion.velocities)
        return found


def _parts(q: Floats, place: int) -> tuple[Floats, Floats]:
    """A quaternion's scalar and vector."""
    return q[:, place, None], q[:, place + 1 : place + 4]
