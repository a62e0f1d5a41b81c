"""Limits of mechanisms with loops as constraints of the independent state.

All of them ask for the same closed states, so they are one constraint: that the loops can be closed and stay away from
singular configurations, and then what the whole state has to keep: forces, points, distances.  Between samples nothing
is bounded here; a trajectory is checked at a fine grid instead, with what a parabola through neighbours adds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.functions import robot_function
from echelon.excite.constraints.effort import check_model, effort_output
from echelon.excite.constraints.effort_bounds import EffortBounds, EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.state import Slopes as StateSlopes
from echelon.excite.constraints.state import StateConstraint
from echelon.excite.loops.motion import LoopMotion, Slopes
from echelon.excite.loops.positions import Closed
from echelon.excite.loops.regressor import SEEN, outputs_of
from echelon.excite.margins import Margin
from echelon.excite.pullback import ADJOINT, pullback
from echelon.excite.trajectory import Trajectory
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.rewriting import smooth_function

Floats = npt.NDArray[np.float64]
Triple = tuple[Floats, Floats, Floats]

OPEN = 0.15
"""Least openness that a solver has to keep, as a share of :attr:`LoopMotion.reference`."""

_RATE = 10_000  # Hz, at which a trajectory is checked
_PHASES = 80  # samples that far apart are followed together, then moved on by one
_JUMP = 3.0  # times what velocities explain: another way of assembly
_ROUNDING = 1e-9  # rad or characteristic lengths


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

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each function, the derivatives by the independent q, q̇ and q̈."""
        parts = self.constraint.slopes(closed.q, closed.qd, closed.qdd)
        found = []
        for row in range(len(self.labels)):
            by_state = [None if part is None else np.ascontiguousarray(part[:, row]) for part in parts]
            found.append(motion.pulled(closed, Slopes(*by_state)))
        return found


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
        check_model(mechanism, model)
        bounds = EffortBounds.of(limits, model, margin)
        self.labels, self.units, self.low, self.high = bounds.labels, bounds.units, bounds.low, bounds.high
        outputs = tuple(effort_output(mechanism, limit) for limit in limits)
        measured, self._model = replace(mechanism, measured=outputs, reading=None), model
        kind, parameters = ("inverse_dynamics", {"parameters": model.values}) if model.certain else ("regressor", {})
        recorded = robot_function(kind, measured, model.places(mechanism))
        function = recorded if smooth is None else smooth_function(recorded, smooth)
        self._uniform = {**parameters, **geometry_values(mechanism, function.arguments, symbols)}
        self._columns = [index[-1] for index in function.entries]
        self._kernel, self._pullback = Kernel(function), Kernel(pullback(function))
        self._given = LoopMotion(measured, symbols).given_speeds()

    def values(self, motion: LoopMotion, closed: Closed) -> Floats:
        """The efforts, shape (N, m)."""
        given = outputs_of(motion, closed, self._virtual(motion, closed), self._uniform)
        found = [self._kernel(values) for values in given]
        return np.hstack(found if self._model.certain else [self._model.extremes(x[:, 0]) for x in found])

    def slopes(self, motion: LoopMotion, closed: Closed) -> list[Triple]:
        """Of each effort, the derivatives by the independent q, q̇ and q̈."""
        virtual, found = self._virtual(motion, closed), []
        p, n = closed.q.shape[1], closed.qd.shape[1]
        for k, values in enumerate(outputs_of(motion, closed, virtual, self._uniform)):
            for adjoint in self._adjoints(values):
                pulled = self._pullback({**values, ADJOINT: adjoint})
                by_state = pulled[:, :p], pulled[:, p : p + n], pulled[:, p + n : p + 2 * n]
                by_v = pulled[:, p + 2 * n :, None]
                found.append(motion.pulled(closed, Slopes(*by_state, by_v, virtual[:, :, k : k + 1])))
        return found

    def _adjoints(self, values: dict[str, Floats]) -> Iterable[Floats]:
        """Derivatives of an effort, or of both that stand for it, by the entries of what is recorded."""
        if self._model.certain:
            return [np.ones((len(values["q"]), 1))]
        return self._model.adjoints(self._kernel(values)[:, 0])[:, :, self._columns]

    def _virtual(self, motion: LoopMotion, closed: Closed) -> Floats:
        given = np.zeros((closed.jacobian.shape[2], self._given.shape[1]))
        given[: len(self._given)] = self._given  # sensors stay at rest
        return motion.virtual(closed, given)


class LoopLimits:
    """What a motion of the independent coordinates has to keep; a :class:`StateConstraint`.

    The first function is the openness of the loops as a share of the usual one; where they cannot be closed, it is
    negative, by how far it is back to where they can.  All others count as kept there.

    Parameters
    ----------
    motion : LoopMotion
    parts : sequence of LoopPart or LoopEfforts
    """

    def __init__(self, motion: LoopMotion, parts: Sequence[LoopPart | LoopEfforts] = ()) -> None:
        self.motion, self.parts = motion, tuple(parts)

    @property
    def labels(self) -> tuple[str, ...]:
        """What each function is, for messages."""
        return ("distance of the loops from singular poses", *(label for part in self.parts for label in part.labels))

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the functions."""
        return ("1", *(unit for part in self.parts for unit in part.units))

    @property
    def low(self) -> Floats:
        """Least values, shape (m,)."""
        return np.concatenate([[OPEN], *(part.low for part in self.parts)])

    @property
    def high(self) -> Floats:
        """Largest values, shape (m,)."""
        return np.concatenate([[np.inf], *(part.high for part in self.parts)])

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at independent states of shape (N, k), shape (N, m)."""
        return self._at(self.motion.at(q, qd, qdd))

    def _at(self, closed: Closed) -> Floats:
        away = np.linalg.norm(closed.missing, axis=1)
        found = np.column_stack(
            [
                np.where(closed.done, closed.openness / self.motion.reference, -away),
                *(part.values(self.motion, closed) for part in self.parts),
            ]
        )
        kept = np.clip(0.0, self.low, self.high)
        return np.where(closed.done[:, None] | (np.arange(len(kept)) == 0), found, kept)

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> StateSlopes:
        """Their derivatives, each of shape (N, m, k)."""
        closed = self.motion.at(q, qd, qdd)
        scale = np.full(len(q), 1 / self.motion.reference)
        first = self.motion.pulled(closed, Slopes(openness=scale))
        away = np.linalg.norm(closed.missing, axis=1, keepdims=True)
        back = -closed.missing / np.maximum(away, 1e-300) / self.motion.independent_units
        first = (np.where(closed.done[:, None], first[0], back), first[1], first[2])
        rows = [first, *(row for part in self.parts for row in part.slopes(self.motion, closed))]
        by_q, by_qd, by_qdd = (np.stack([row[order] for row in rows], axis=1) for order in range(3))
        return by_q, by_qd, by_qdd

    def margins(self, trajectory: Trajectory) -> list[Margin]:
        """How far a trajectory stays from the limits, at a fine grid of times.

        Where another way of assembly turns up from one sample to the next, the loops count as not closed.

        Parameters
        ----------
        trajectory : Trajectory
            Of the independent coordinates.
        """
        values = self._fine(trajectory)
        bent = np.abs(np.diff(values, 2, axis=0)).max(axis=0, initial=0.0) / 8
        least, largest = values.min(axis=0) - bent, values.max(axis=0) + bent
        low = self.low
        low[0] = SEEN
        fields = (self.labels, self.units, low.tolist(), self.high.tolist(), least.tolist(), largest.tolist())
        return [Margin(*row) for row in zip(*fields, strict=True)]

    def _fine(self, trajectory: Trajectory) -> Floats:
        """The functions at the fine grid."""
        count = int(np.ceil(trajectory.duration * _RATE / _PHASES))
        times = np.linspace(0.0, trajectory.duration, count * _PHASES).reshape(count, _PHASES)
        found, poses, speeds = [], [], []
        for phase in range(_PHASES):
            closed = self.motion.at(*trajectory.states(times[:, phase]))
            found.append(self._at(closed))
            poses.append(closed.q)
            speeds.append(np.abs(closed.qd).max(axis=1, initial=0.0))
        values = np.stack(found, axis=1).reshape(count * _PHASES, -1)
        # followed each for itself up to here: from the end of one sample's way to the next one's beginning
        step = times[0, 1] - times[0, 0]
        moved = np.abs(poses[0][1:] - poses[-1][:-1]).max(axis=1, initial=0.0)
        jumped = moved > _JUMP * step * (speeds[0][1:] + speeds[-1][:-1]) + _ROUNDING + step**2 * 1e3
        values[_PHASES - 1 : -1 : _PHASES, 0][jumped] = 0.0
        return values
