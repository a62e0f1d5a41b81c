"""Constants of laws that the rows are not linear in, such as a Stribeck velocity: profiles of the likelihood.

With the constants given, the rest is linear.  So the likelihood of a constant is that of the linear fit, with the noise
of each output from its residual as in the main fit, and its interval is where twice the logarithm of the likelihood is
within a quantile of χ² of the best (variable projection: Golub and Pereyra, SIAM J. Numerical Analysis 10, 1973;
profiles: Bates and Watts, Nonlinear Regression Analysis, 1988, chapter 6).  The rows are those of the main fit.

While a constant leaves its best value, the others follow along the line on which a quadratic form would be least.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from statistics import NormalDist

import numpy as np

from echelon.compute import Observation
from echelon.identification.estimators.estimate import solved
from echelon.identification.estimators.least_squares import (
    fixed_noise,
    least_squares,
    noise_estimate,
    noise_floor,
)
from echelon.identification.fitting import BaseFit, correlation
from echelon.identification.logs.finding import Finding, note, warning
from echelon.identification.logs.preparation.prepare import with_bristles
from echelon.identification.logs.recording import Samples
from echelon.identification.passes_over_data import PassesOverData
from echelon.identification.rows.rows import ModelRows
from echelon.robot import Mechanism
from echelon.shared import Floats, InputError, extra

_GRID = 12  # values of each constant that are tried first: peaks of likelihood are wider than a step
_MOST_FITS = 2000  # linear fits of one search: minutes for the logs of an arm
_PRECISION = 1e-4  # of a place in its range
_DIGITS = 5  # of values, far below any interval


Path = Callable[[float], Floats]
"""Places of all constants, by that of one of them."""


@dataclass(frozen=True)
class Constant:
    """A constant of a law, and what logs say of it."""

    name: str
    value: float
    interval: tuple[float | None, float | None]  # None where it is open in the range
    searched: tuple[float, float]
    fits: int  # linear fits of all constants together

    def finding(self, level: float) -> Finding:
        """The value with its interval, and the line of a set-up that states it."""
        low, high = self.interval
        begin, end = self.searched
        line = f"symbols: {{{self.name}: {self.value}}}"
        if low is not None and high is not None:
            text = f"{self.value}, {level:.0%} of the likelihood from {low:.4g} to {high:.4g}"
            return note("constant", f"symbol '{self.name}'", f"{text}; {line}")
        if low is None and high is None:
            text = f"these logs do not determine it: all from {begin:g} to {end:g} explains them as well as {line}"
        elif low is None:
            text = f"anything from {begin:g}, where the range begins, to {high:.4g} explains the logs as well as {line}"
        else:
            text = f"anything from {low:.4g} to {end:g}, where the range ends, explains the logs as well as {line}"
        return warning("constant", f"symbol '{self.name}'", text)


def started(mechanism: Mechanism) -> Mechanism:
    """A mechanism with constants that are to be fitted in the middle of their ranges."""
    return _with_values(
        mechanism,
        {
            name: _at(symbol.fit, 0.5)
            for name, symbol in mechanism.symbols.items()
            if symbol.fit is not None
        },
    )


def _with_values(mechanism: Mechanism, values: dict[str, float]) -> Mechanism:
    if not values:
        return mechanism
    found = {
        name: replace(mechanism.symbols[name], value=value, exact=repr(value), fit=None)
        for name, value in values.items()
    }
    return replace(mechanism, symbols={**mechanism.symbols, **found})


def _at(ends: tuple[float, float], place: float) -> float:
    """The value at a place from 0 to 1 in a range; of positive ones by the logarithm."""
    low, high = ends
    value = low * (high / low) ** place if low > 0 else low + (high - low) * place
    return float(f"{value:.{_DIGITS}g}")


@dataclass
class Profile:
    """The likelihood of some constants, which have places from 0 to 1 in their ranges."""

    data: PassesOverData
    ranges: dict[str, tuple[float, float]]
    best: Floats  # shape (constants,)
    fits: int = field(default=0, init=False)

    @staticmethod
    def of(data: PassesOverData, mechanism: Mechanism) -> Profile | None:
        """The best values of all constants that logs have to tell; None if there are none."""
        found = {n: s.fit for n, s in mechanism.symbols.items() if s.fit is not None}
        if not found:
            return None
        profile = Profile(data, found, np.full(len(found), 0.5))
        # the first pass takes the samples into memory, if there is room for them
        _ = data.batches
        profile._search()
        return profile

    def fitted(self, mechanism: Mechanism) -> Mechanism:
        """A mechanism with the best values."""
        return _with_values(mechanism, self._values(self.best))

    def judged(
        self, fit: BaseFit, level: float
    ) -> tuple[tuple[Constant, ...], BaseFit]:
        """The best values with intervals, and a fit with these values whose covariance counts what they leave open."""
        quantile = NormalDist().inv_cdf((1 + level) / 2)
        rises = [self._inflation(fit, name) * quantile**2 for name in self.ranges]
        curvature = self._curvature(rises) if len(rises) > 1 else None
        values, estimate = self._values(self.best), fit.estimate
        found, covariance = [], estimate.covariance
        for k, (name, ends) in enumerate(self.ranges.items()):
            path = self._beside(k, curvature)
            low, high = self._reach(k, rises[k], path)
            above, below = (
                self._linear(path(end), estimate.parameters)
                for end in np.clip((high, low), 0.0, 1.0)
            )
            moved = (above - below) / (2 * quantile)
            covariance = covariance + np.outer(moved, moved)
            interval = (
                _at(ends, low) if low >= 0 else None,
                _at(ends, high) if high <= 1 else None,
            )
            found.append(Constant(name, values[name], interval, ends, 0))
        fit = replace(fit, estimate=replace(estimate, covariance=covariance))
        return tuple(replace(some, fits=self.fits) for some in found), fit

    def _inflation(self, fit: BaseFit, name: str) -> float:
        """Variance of parameters that a constant belongs to, by that of rows that do not resemble one another."""
        mechanism = self.data.plan.base.mechanism
        own = {e.parameter for e in mechanism.effects if name in e.symbols}
        estimate = fit.estimate
        mine = [n in own for n in estimate.parameters]
        if not (fit.conditions.is_complete and any(mine)):
            return correlation(estimate)
        alone = solved(fit.observation, estimate.units, fit.weights).inverse
        ratios = np.diagonal(estimate.covariance)[mine] / np.diagonal(alone)[mine]
        return max(1.0, float(ratios.mean()))

    # -- likelihood ----------------------------------------------------------------------------------------------

    def _values(self, places: Floats) -> dict[str, float]:
        pairs = zip(self.ranges.items(), places, strict=True)
        return {name: _at(ends, float(place)) for (name, ends), place in pairs}

    def _deviance(self, places: Floats) -> float:
        """Minus twice the logarithm of the likelihood at places, shape (constants,), of the best linear parameters."""
        return deviance(self._observed(places))[0]

    def _linear(self, places: Floats, names: Sequence[str]) -> Floats:
        """The best linear parameters of some names, zero where there are none."""
        observation = self._observed(places)
        found = dict(
            zip(observation.layout.parameters, deviance(observation)[1], strict=True)
        )
        return np.array([found.get(name, 0.0) for name in names])

    def _observed(self, places: Floats) -> Observation:
        self.fits += 1
        if self.fits > _MOST_FITS:
            raise InputError(
                f"the constants {', '.join(self.ranges)} were not found in {_MOST_FITS} fits: state some of them"
            )
        base, values = self.data.plan.base, self._values(places)

        def samples() -> Iterator[Samples]:
            for some in self.data.fitted():
                mechanism = rows.own(some).base.mechanism
                yield with_bristles(some, mechanism, values)

        rows = ModelRows(base, samples, values)
        return rows.observation()

    def _search(self) -> None:
        """Best values: by a grid, each beside the others, then by Powell's method."""
        with extra("identify"):
            from scipy.optimize import minimize
        count = len(self.ranges)
        for k in [*range(count), *range(count if count > 1 else 0)]:
            tried = map(self._beside(k), np.linspace(0, 1, _GRID))
            self.best = min(tried, key=self._deviance)
        least = self._deviance(self.best)

        def above(places: Floats) -> float:
            return self._deviance(places) - least

        found = minimize(
            above,
            self.best.tolist(),
            method="Powell",
            bounds=[(0.0, 1.0)] * count,
            tol=_PRECISION,
        )
        if found.fun < 0:
            self.best = np.asarray(found.x, dtype=float)

    # -- intervals -----------------------------------------------------------------------------------------------

    def _beside(self, k: int, curvature: Floats | None = None) -> Path:
        """Places with that of one constant given, the others at their best, or along the line of a quadratic form."""
        slopes = np.zeros(len(self.best))
        if curvature is not None:
            others = np.arange(len(slopes)) != k
            inner = curvature[np.ix_(others, others)]
            slopes[others] = -np.linalg.lstsq(inner, curvature[others, k])[0]
        slopes[k] = 1.0
        start = self.best
        return lambda place: np.clip(start + slopes * (place - start[k]), 0.0, 1.0)

    def _reach(self, k: int, rise: float, path: Path) -> tuple[float, float]:
        """Places of a constant between which the deviance is within some rise; infinite where it stays so."""
        with extra("identify"):
            from scipy.optimize import brentq
        limit, own = self._deviance(self.best) + rise, float(self.best[k])

        def above(place: float) -> float:
            return self._deviance(path(place)) - limit

        found = [-inf, inf]
        for side, end in enumerate((0.0, 1.0)):
            if end != own and above(end) > 0:
                found[side] = brentq(above, end, own, xtol=_PRECISION)
        return found[0], found[1]

    def _curvature(self, rises: Sequence[float]) -> Floats:
        """Second derivatives of the deviance by the places, from differences within some rises of it."""
        count = len(self.best)
        reaches = [self._reach(k, rises[k], self._beside(k)) for k in range(count)]
        steps = np.diag(np.diff(np.clip(reaches, 0.0, 1.0)).ravel() / 4)
        sizes = steps.sum(axis=0)
        middle = np.clip(self.best, 2 * sizes, 1 - 2 * sizes)
        found = np.zeros((count, count))
        for j in range(count):
            for k in range(j + 1):
                corners = [
                    sign
                    * other
                    * self._deviance(middle + sign * steps[j] + other * steps[k])
                    for sign in (1, -1)
                    for other in (1, -1)
                ]
                found[j, k] = found[k, j] = sum(corners) / (4 * sizes[j] * sizes[k])
        return found


def deviance(observation: Observation) -> tuple[float, Floats]:
    """Minus twice the logarithm of the likelihood of the best parameters, up to a constant, and these.

    Where the rows do not determine all parameters, they are the smallest.
    """
    counts, floor = np.array(observation.counts), noise_floor(observation)
    values = np.zeros(len(observation.layout.parameters))

    def updated(noise: Floats) -> Floats:
        nonlocal values
        values = least_squares(observation.combined(1 / noise))
        left = observation.misfits(values) / np.sqrt(np.maximum(counts, 1))
        return np.where(counts > 0, np.maximum(left, floor), inf)

    noise, _, _ = fixed_noise(updated, noise_estimate(observation))
    told = counts > 0
    return float(2 * counts[told] @ np.log(noise[told])), values
