"""Functions of the whole state of a mechanism with loops, as functions of the independent one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from echelon.arrays import Floats
from echelon.excite.constraints.effort import effort_limits, effort_output
from echelon.excite.constraints.effort_bounds import EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.state import Enclosed, StateConstraint
from echelon.excite.loops.enclosures import Located, LoopEnclosures
from echelon.excite.loops.motion import LoopMotion, Triple
from echelon.excite.loops.positions import Closed
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Argument
from echelon.program.intervals import Interval
from echelon.program.tape import Program
from echelon.regressor.loops.closed_motion import ClosedMotion
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.regressor.probes import Probes, virtual_motion
from echelon.regressor.steps import Recorder


class LoopPart:
    """Some functions of the whole state.

    Parameters
    ----------
    constraint : StateConstraint
        Of the whole state.
    """

    def __init__(self, constraint: StateConstraint) -> None:
        self.constraint = constraint
        self.labels, self.units = constraint.labels, constraint.units
        self.low, self.high = constraint.low, constraint.high

    def values(self, _motion: LoopMotion, closed: Closed) -> Floats:
        """The functions, shape (N, m)."""
        return self.constraint.values(closed.q, closed.qd, closed.qdd)

    def enclosures(self, _enclosures: LoopEnclosures, _located: Located, states: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while the whole state stays in intervals, each of shape (cells, m)."""
        assert isinstance(self.constraint, Enclosed)
        return self.constraint.enclosures(states)

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each function, the derivatives by the independent q, q̇ and q̈."""
        parts = self.constraint.slopes(closed.q, closed.qd, closed.qdd)
        rows = range(len(self.labels))
        return [motion.pulled(closed, *(None if part is None else part[:, row] for part in parts)) for row in rows]


class LoopEfforts:
    """Torques and forces, by a model that was known before.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    limits : sequence of EffortLimit
        At least one.
    model, margin, smooth, symbols
        See :func:`echelon.excite.constraints.effort.effort_limits`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        limits: Sequence[EffortLimit],
        model: EffortModel,
        margin: float,
        smooth: float | None,
        symbols: Mapping[str, float] | None = None,
    ) -> None:
        self.constraint = effort_limits(mechanism, limits, model, margin, smooth, symbols)
        self.labels, self.units = self.constraint.labels, self.constraint.units
        self.low, self.high = self.constraint.low, self.constraint.high
        outputs = tuple(effort_output(mechanism, limit) for limit in limits)
        measured = replace(mechanism, measured=outputs, reading=None)
        self._known = _known(measured, self.constraint.recorded.program)
        self._chosen = ClosedMotion(measured, symbols).chosen_speeds

    def values(self, motion: LoopMotion, closed: Closed) -> Floats:
        """The efforts, shape (N, m)."""
        return self.constraint.values(*motion.independent(closed).values())

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each effort, the derivatives by the independent q, q̇ and q̈."""
        by_q, *by_rates = self.constraint.slopes(*motion.independent(closed).values())
        assert by_q is not None
        found: list[Triple] = []
        for row in range(len(self.labels)):
            by_qd, by_qdd = (closed.counted(part[:, row]) for part in by_rates if part is not None)
            found.append((motion.along(closed, by_q[:, row]), by_qd, by_qdd))
        return found

    def enclosures(self, enclosures: LoopEnclosures, located: Located, states: Mapping[str, Interval]) -> Interval:
        """Bounds of the efforts while the whole state stays in intervals, without smoothing, (cells, m)."""
        names, units = enclosures.motion.mechanism.velocities, enclosures.motion.speed_units
        given = np.array([[chosen.get(name, 0.0) for chosen in self._chosen] for name in names]) / units[:, None]
        free = enclosures.motion.columns[0]
        low, high = enclosures.virtual(located, given)
        whole = {**states, **{f"v{k}": (low[:, :, k], high[:, :, k]) for k in range(low.shape[2])}}
        ranges = {"q": states["q"], **{kind: _columns(states[kind], free) for kind in ("qd", "qdd")}}
        for kind, places, argument in self._known:
            low, high = _columns(whole[kind], places)
            ranges[argument.name] = np.hstack([low, -high]), np.hstack([high, -low])
        return self.constraint.enclosures(ranges, [argument for _, _, argument in self._known])


def _known(mechanism: Mechanism, program: Program) -> list[tuple[str, list[int], Argument]]:
    """Nodes of a recorded function that are bounded before: kind, places of the velocity coordinates, and nodes.

    Kinds are rates of all coordinates, ``qd`` and ``qdd``, and virtual velocities for the outputs, ``v0``, ``v1``, …:
    recording them once more finds the same nodes.  Behind them are those of their opposites, by which programs go on
    where that saves a sign.
    """
    motion = DependentMotion(mechanism, program)
    given, probes = motion.given(), Probes(mechanism, Recorder(mechanism, program))
    values = {kind: {n: given[f"{kind}[{n}]"] for n in mechanism.velocities} for kind in ("qd", "qdd")}
    for k, output in enumerate(mechanism.outputs):
        chosen = virtual_motion(mechanism, probes, {output.name: program.one}).chosen
        values[f"v{k}"] = motion.speeds(chosen)
    known: list[tuple[str, list[int], Argument]] = []
    for kind, found in values.items():
        varying = {n: value for n, value in found.items() if value.number is None}
        nodes = (*(v.node for v in varying.values()), *((-v).node for v in varying.values()))
        labels = (*varying, *(f"-{name}" for name in varying))
        places = [mechanism.velocities.index(name) for name in varying]
        known.append((kind, places, Argument(f"known {kind}", nodes, labels, ("SI",) * len(nodes))))
    return known


def _columns(ends: Interval, places: Sequence[int]) -> Interval:
    return ends[0][:, places], ends[1][:, places]
