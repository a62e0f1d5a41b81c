"""Limits of positions, velocities, accelerations and jerks, which are linear in the coefficients of every family.

The set-up's limits come before those of the robot file; defaults fill what neither states, and are reported.  Nothing
is unlimited unless the set-up says ``none``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, pi

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.arguments import coordinate_units
from echelon.errors import InputError
from echelon.excite.problem.effort_limits import EffortLimit
from echelon.excite.problem.state_limits import ORDERS, MotionLimit
from echelon.formats.schema.schema_excite import EVERY, LimitsEntry
from echelon.formats.stated_limits import StatedLimits
from echelon.hints import nearest_of
from echelon.logs.finding import Finding, note
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import known_values

_PER = ("", "/s", "/s²", "/s³")
_SPEEDS = {"rad": 1.0, "m": 0.25}
"""Speeds that are taken where none is stated: those of a careful first run."""
_SPEED_UP, _ONSET = 0.1, 0.05
"""Seconds to the full speed, and to the full acceleration, where accelerations and jerks are not stated."""


@dataclass(frozen=True)
class ResolvedLimits:
    """All limits of a motion."""

    motion: tuple[MotionLimit, ...]
    efforts: tuple[EffortLimit, ...]
    low: Floats  # shape (n,); positions of the coordinates that move; infinite where the set-up says so
    high: Floats
    units: tuple[str, ...]  # of these coordinates, ``"rad"`` or ``"m"``
    findings: tuple[Finding, ...]  # defaults that were taken

    @property
    def middle(self) -> Floats:
        """The middle of the ranges; of unlimited ones, what is next to zero."""
        both = np.isfinite(self.low) & np.isfinite(self.high)
        with np.errstate(invalid="ignore"):
            return np.where(both, (self.low + self.high) / 2, np.clip(0.0, self.low, self.high))


def resolved_limits(
    mechanism: Mechanism,
    entry: LimitsEntry,
    stated: Mapping[str, StatedLimits],
    source: str,
    idle: Collection[str] = (),
) -> ResolvedLimits:
    """Limits of the coordinates that move."""
    return _Resolver(mechanism, entry, stated, source, idle).resolved()


class _Resolver:
    def __init__(
        self,
        mechanism: Mechanism,
        entry: LimitsEntry,
        stated: Mapping[str, StatedLimits],
        source: str,
        idle: Collection[str],
    ) -> None:
        self.entry, self.source, self.idle = entry, source, idle
        self.names = list(mechanism.independent_velocities)
        all_units = dict(zip(mechanism.velocities, coordinate_units(mechanism, "qdd"), strict=True))
        self.units = {name: all_units[name].removesuffix("/s²") for name in self.names}
        self.stated = {name: stated.get(name, StatedLimits(None, None, None, None, None)) for name in self.names}
        self.drives = _drives(mechanism, self.names)
        self.defaults: dict[str, dict[str, list[str]]] = {}

    def resolved(self) -> ResolvedLimits:
        self._check_names()
        positions = {name: self._position(name) for name in self.names}
        limits = [self._limit(name, 0, *positions[name]) for name in self.names]
        # velocities, accelerations and jerks
        values = {name: _SPEEDS[unit] for name, unit in self.units.items()}
        for order, onset in ((1, 1.0), (2, _SPEED_UP), (3, _ONSET)):
            values = {name: self._rate(order, name, value / onset) for name, value in values.items()}
            limits += [self._limit(name, order, -value, value) for name, value in values.items()]
        limits += self._of_drives()
        low, high = (np.array([positions[name][k] for name in self.names]) for k in (0, 1))
        kept = tuple(limit for limit in limits if isfinite(limit.low) or isfinite(limit.high))
        return ResolvedLimits(
            kept, tuple(self._efforts()), low, high, tuple(self.units.values()), tuple(self._findings())
        )

    # -- names -----------------------------------------------------------------------------------------------------

    def _check_names(self) -> None:
        valid = [EVERY, *self.names, *self.drives]
        for kind in (*ORDERS, "effort"):
            for name in getattr(self.entry, kind):
                if name not in valid and name not in self.idle:
                    problem = f"there is no moving coordinate or actuator '{name}'{nearest_of(name, valid)}"
                    raise InputError(problem, source=self.source, element=f"{kind} limits")

    def _stated(self, kind: str, name: str) -> float | tuple[float, float] | None:
        """The limit that the set-up states."""
        given = getattr(self.entry, kind)
        if name in given or EVERY in given:
            found: float | tuple[float, float] = given.get(name, given.get(EVERY))
            return found
        return None

    # -- coordinates -----------------------------------------------------------------------------------------------

    def _position(self, name: str) -> tuple[float, float]:
        found, scale = self._stated("position", name), self.entry.scale
        if found is None and (range_ := self.stated[name].position) is not None:
            middle, half = (range_[0] + range_[1]) / 2, (range_[1] - range_[0]) / 2
            found = (middle - scale * half, middle + scale * half)
        if found is None and self.units[name] != "rad":
            problem = f"'{name}' is prismatic and has no position limits; state them under limits: position (or none)"
            raise InputError(problem, source=self.source, element="excitation")
        if found is None:
            self._default("position", name, "−π to π")
            found = (-pi, pi)
        assert isinstance(found, tuple)
        if found[0] >= found[1]:
            problem = f"the position range of '{name}' has length zero: hold it, or give a longer one"
            raise InputError(problem, source=self.source, element="position limits")
        return found

    def _rate(self, order: int, name: str, default: float) -> float:
        """The limit of a velocity, an acceleration or a jerk."""
        kind = ORDERS[order]
        found = self._stated(kind, name)
        if found is None and (value := getattr(self.stated[name], kind)) is not None:
            found = value * self.entry.scale
        if found is None:
            found = default
            if isfinite(default):
                self._default(kind, name, f"{found:g} {self.units[name]}{_PER[order]}")
        assert isinstance(found, float)
        return found

    def _limit(self, name: str, order: int, low: float, high: float) -> MotionLimit:
        weights = np.eye(len(self.names))[self.names.index(name)]
        return MotionLimit(name, self.units[name] + _PER[order], order, weights, low, high)

    def _default(self, kind: str, name: str, value: str) -> None:
        self.defaults.setdefault(kind, {}).setdefault(value, []).append(name)

    def _findings(self) -> Iterator[Finding]:
        """Defaults that were taken, by kind."""
        for kind, taken in self.defaults.items():
            values = "; ".join(f"{', '.join(names)} {value}" for value, names in taken.items())
            text = f"no {kind} limits are stated, so these are taken: {values}"
            yield note("default limit", self.source, text)

    # -- drives ----------------------------------------------------------------------------------------------------

    def _of_drives(self) -> list[MotionLimit]:
        """Limits that name actuators, through the transmission."""
        found = []
        for name, weights in self.drives.items():
            unit = self.units[self.names[int(np.flatnonzero(weights)[0])]]
            for order, kind in enumerate(ORDERS):
                value = getattr(self.entry, kind).get(name)
                if value is not None and name not in self.names:
                    low, high = value if order == 0 else (-value, value)
                    found.append(MotionLimit(name, unit + _PER[order], order, weights, low, high))
        return found

    def _efforts(self) -> Sequence[EffortLimit]:
        found = []
        for name in [*self.names, *(drive for drive in self.drives if drive not in self.names)]:
            value = self._stated("effort", name) if name in self.names else self.entry.effort.get(name)
            if value is None and name in self.names and (effort := self.stated[name].effort) is not None:
                value = effort * self.entry.scale
            if value is not None and value != inf:
                first = name if name in self.names else self.names[int(np.flatnonzero(self.drives[name])[0])]
                found.append(EffortLimit(name, "N·m" if self.units[first] == "rad" else "N", float(value)))  # type: ignore[arg-type]
        return found


def _drives(mechanism: Mechanism, names: Sequence[str]) -> dict[str, Floats]:
    """Rows of the transmission, by actuator."""
    known = known_values(mechanism)
    found = {}
    for actuator in mechanism.transmission.actuators:
        row = np.zeros(len(names))
        for name, ratio in actuator.terms:
            row[names.index(name)] = ratio.at(known)
        found[actuator.name] = row
    return found
