"""Bounds of all coordinates of a mechanism with loops in cells of time, while the independent ones stay in intervals.

From a closed configuration the dependent coordinates move at rates D q̇, D = −J_D⁻¹ J_I, with q̇ of the independent ones.
A box about it is large enough for a while if the rates that are possible in it do not lead out of it: the first
configuration that left it would have got there within it.  With P a left inverse of J_D in the middle, P J_D stays near
the identity there, which bounds all that follows from J: D, velocities, accelerations and virtual velocities.  Where it
is regular all over the box, no second way of assembly lies in it.

Intervals are a middle and a radius here, because most of this is products of matrices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.excite.loops.motion import LoopMotion
from echelon.excite.loops.positions import Closed
from echelon.program.intervals import Interval

Around = tuple[Floats, Floats]
"""Middle and radius, of one shape."""

_TRIES = 6  # for a box that is large enough
_WIDER = 1.25  # than what would do at the least
_REGULAR = 0.9  # largest deviation of P J_D from the identity, in the norm of row sums
_ROUNDING = 1e-10  # of closed configurations, rad or characteristic lengths; relative to their size elsewhere


@dataclass(frozen=True, eq=False)
class Located:
    """Boxes about closed configurations.

    Attributes
    ----------
    closed : Closed
        In the middle.
    found : array of bool, shape (cells,)
        Where the box is known to hold all configurations; elsewhere nothing is known.
    q : (array, array)
        Least and largest positions, shape (cells, positions).
    inverse : array of shape (cells, dependent, equations)
        P; zero where the loops are not closed.
    product : (array, array)
        P J, shape (cells, dependent, velocities).
    """

    closed: Closed
    found: Flags
    q: Interval
    inverse: Floats
    product: Around


class LoopEnclosures:
    """Bounds of whole states.

    Parameters
    ----------
    motion : LoopMotion
    """

    def __init__(self, motion: LoopMotion) -> None:
        self.motion = motion

    def located(self, ranges: Mapping[str, Interval]) -> Located:
        """Positions.

        Parameters
        ----------
        ranges : mapping of str to (array, array)
            See :func:`echelon.excite.cells.ranges`: configurations are followed from the middle of each cell.
        """
        motion, free = self.motion, self.motion.columns[0]
        begin, end = ranges["t"]
        half, (centre, way), given = (end - begin) / 2, _around(ranges["q"]), self._given(ranges["qd"])
        closed = motion.positioned(centre)
        inverse, jacobian = self._inverse(closed)
        rates = _times(inverse @ jacobian[:, :, free], given[0])
        size = _WIDER * half * np.abs(rates) + _ROUNDING
        found = np.zeros(len(way), dtype=bool)
        for _ in range(_TRIES):
            q = self._box(closed, way / motion.independent_units, size)
            product = self._product(inverse, q)
            (rates, wide), regular = self._rates(product, given)
            needed = half * (np.abs(rates) + wide) + _ROUNDING
            found = closed.done & regular & np.all(needed <= size, axis=1)
            if np.all(found | ~closed.done):
                break
            size = np.where(found[:, None], size, np.minimum(_WIDER * np.maximum(needed, size), 1.0))
        return Located(closed, found, q, inverse, product)

    def states(self, located: Located, ranges: Mapping[str, Interval]) -> dict[str, Interval]:
        """Positions, velocities and accelerations of all coordinates.

        Parameters
        ----------
        located : Located
        ranges : mapping of str to (array, array)
            Least and largest independent ``q``, ``qd`` and ``qdd``.
        """
        speeds, inverse = _ends(self._completed(located, ranges["qd"], None)), located.inverse
        middle, radius = _around(self.motion.bounds.bias_enclosures(located.q, speeds))
        opening = _times(inverse, middle), _times(np.abs(inverse), radius)
        return {"q": located.q, "qd": speeds, "qdd": _ends(self._completed(located, ranges["qdd"], opening))}

    def virtual(self, located: Located, given: Floats) -> Interval:
        """Virtual velocities of all coordinates, shape (cells, velocities, outputs), rad/s or m/s.

        Parameters
        ----------
        located : Located
        given : array of shape (velocities, outputs)
            Those that outputs determine, in units of speeds; zero for the others.
        """
        units, (_, dependent) = self.motion.speed_units, self.motion.columns
        opened = located.product[0] @ given, located.product[1] @ np.abs(given)
        (middle, radius), _ = _solved(located.product, dependent, opened)
        found = np.repeat(given[None], len(middle), axis=0)
        wide = np.zeros_like(found)
        found[:, dependent] -= middle
        wide[:, dependent] += radius
        return _ends((found * units[:, None], wide * units[:, None]))

    def openness(self, located: Located) -> Interval:
        """Bounds of :attr:`Closed.openness`, each of shape (cells,).

        Of all left inverses of J_D the one that openness is made of is the least, and (P J_D)⁻¹ P is another one.
        """
        inverse, (_, dependent) = located.inverse, self.motion.columns
        away = _deviation(located.product, dependent)
        bound = np.linalg.solve(_nearby(away), np.abs(inverse))
        with np.errstate(divide="ignore"):
            low = 1 / np.linalg.norm(bound, axis=(1, 2))
        high = (1 + np.linalg.norm(away, axis=(1, 2))) * located.closed.openness
        return low, high

    # -- parts -----------------------------------------------------------------------------------------------------

    def _box(self, closed: Closed, way: Floats, size: Floats) -> Interval:
        """Positions that are that far away, in units of speeds."""
        motion, (free, dependent) = self.motion, self.motion.columns
        moved = np.zeros((len(way), len(motion.speed_units)))
        moved[:, free], moved[:, dependent] = way, size
        radius = motion.position_reach(moved * motion.speed_units)
        return closed.q - radius, closed.q + radius

    def _inverse(self, closed: Closed) -> tuple[Floats, Floats]:
        """P, the left inverse of J_D, and J."""
        jacobian = self.motion.bounds.jacobian(closed.q)
        found = np.zeros((len(jacobian), len(self.motion.columns[1]), jacobian.shape[1]))
        found[closed.done] = np.linalg.pinv(jacobian[closed.done][:, :, self.motion.columns[1]])
        return found, jacobian

    def _product(self, inverse: Floats, q: Interval) -> Around:
        middle, radius = _around(self.motion.bounds.jacobian_enclosures(q))
        found = inverse @ middle
        return found, np.abs(inverse) @ radius + _ROUNDING * np.abs(found)

    def _given(self, independent: Interval) -> Around:
        middle, radius = _around(independent)
        units = self.motion.speed_units[self.motion.columns[0]]
        return middle / units, radius / units

    def _rates(self, product: Around, given: Around, opening: Around | None = None) -> tuple[Around, Flags]:
        """Rates of the dependent coordinates, from those of the independent ones and P times what opens the loops."""
        free, dependent = self.motion.columns
        middle = _times(product[0][:, :, free], given[0])
        radius = _times(np.abs(product[0][:, :, free]), given[1])
        radius += _times(product[1][:, :, free], np.abs(given[0]) + given[1])
        if opening is not None:
            middle, radius = middle + opening[0], radius + opening[1]
        (found, wide), regular = _solved(product, dependent, (middle[:, :, None], radius[:, :, None]))
        return (-found[:, :, 0], wide[:, :, 0]), regular

    def _completed(self, located: Located, independent: Interval, opening: Around | None) -> Around:
        """Rates of all coordinates, SI units."""
        units, (free, dependent) = self.motion.speed_units, self.motion.columns
        given = self._given(independent)
        solved, _ = self._rates(located.product, given, opening)
        found = np.zeros((len(given[0]), len(units))), np.zeros((len(given[0]), len(units)))
        for whole, part, own in zip(found, given, solved, strict=True):
            whole[:, free], whole[:, dependent] = part, own
        return found[0] * units, found[1] * units


def _solved(product: Around, dependent: list[int], right: Around) -> tuple[Around, Flags]:
    """Bounds of (P J_D)⁻¹ R, and where P J_D is regular.

    With E = P J_D − 1, z = R − E z, and |z| ≤ (1 − |E|)⁻¹ |R|.
    """
    away = _deviation(product, dependent)
    most = np.linalg.solve(_nearby(away), np.abs(right[0]) + right[1])
    return (right[0], right[1] + away @ most), _regular(away)


def _deviation(product: Around, dependent: list[int]) -> Floats:
    """|P J_D − 1|, at the most."""
    found: Floats = np.abs(product[0][:, :, dependent] - np.eye(len(dependent))) + product[1][:, :, dependent]
    return found


def _regular(away: Floats) -> Flags:
    found: Flags = np.all(away.sum(axis=2) < _REGULAR, axis=1)
    return found


def _nearby(away: Floats) -> Floats:
    """1 − |E| where that is regular, else 1: what follows from it is of no use there."""
    found: Floats = np.eye(away.shape[1]) - np.where(_regular(away)[:, None, None], away, 0.0)
    return found


def _times(matrix: Floats, vector: Floats) -> Floats:
    found: Floats = (matrix @ vector[:, :, None])[:, :, 0]
    return found


def _around(ends: Interval) -> Around:
    low, high = ends
    middle = (low + high) / 2
    return middle, (high - low) / 2 + _ROUNDING * 1e-4 * np.abs(middle)


def _ends(found: Around) -> Interval:
    return found[0] - found[1], found[0] + found[1]
