"""A design: everything that is decided before the solver starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.excite.constraints.effort import effort_limits
from echelon.excite.constraints.frames import PointLimit, point_limits
from echelon.excite.constraints.state import StateConstraint
from echelon.excite.criteria import Criterion
from echelon.excite.families.basis import Basis, resting_ends
from echelon.excite.families.bsplines import uniform_splines
from echelon.excite.families.fourier import Fourier
from echelon.excite.families.sums import Sum
from echelon.excite.information import Information
from echelon.excite.limits import ResolvedLimits, resolved_limits
from echelon.excite.poses import start_pose
from echelon.excite.problem import Problem
from echelon.excite.pullback import StateRegressor
from echelon.formats.limits import stated_limits
from echelon.formats.schema_excite import EVERY, ExcitationEntry, FrameEntry
from echelon.hints import nearest_of
from echelon.identification.physics.prior import prior_from
from echelon.identification.settings import Setup
from echelon.logs.finding import Finding, Severity
from echelon.mechanism.hold import held
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

Floats = npt.NDArray[np.float64]

DURATION = 8.0
"""Seconds, where none is stated."""
_SMOOTH = 0.02  # share of the smallest speed limit within which dry friction changes sign gradually


@dataclass(frozen=True)
class Design:
    """What is to be optimised.

    Attributes
    ----------
    setup : Setup
    entry : ExcitationEntry
    base : BaseModel
        Of the robot with what does not move held.
    held : mapping of str to float
        Motions that are held, and where.
    limits : ResolvedLimits
    constraints : tuple of StateLimits
        Torques and points.
    centre : array of shape (n,)
        Where motions start.
    problem : Problem
    findings : tuple of Finding
    """

    setup: Setup
    entry: ExcitationEntry
    base: BaseModel
    held: Mapping[str, float]
    limits: ResolvedLimits
    constraints: tuple[StateConstraint, ...]
    centre: Floats
    problem: Problem
    findings: tuple[Finding, ...]

    @property
    def mechanism(self) -> Mechanism:
        """What moves."""
        return self.base.mechanism


def designed(setup: Setup, entry: ExcitationEntry, known: Floats | None = None) -> Design:
    """Decide everything that the solver needs.

    Parameters
    ----------
    setup : Setup
    entry : ExcitationEntry
        The section ``excitation`` of the set-up, as it is or changed.
    known : array of shape (r, r), optional
        Information that there is already, from other logs.

    Raises
    ------
    InputError
        If names are unknown, limits are missing or in each other's way, nothing can be seen, or effects need inputs.
    """
    return _Designer(setup, entry).design(known)


class _Designer:
    def __init__(self, setup: Setup, entry: ExcitationEntry) -> None:
        self.setup, self.entry, self.source = setup, entry, setup.source
        self.findings: list[Finding] = []

    def design(self, known: Floats | None) -> Design:
        if self.setup.mechanism.closures:
            raise InputError("trajectories of mechanisms with loops are not designed yet", source=self.source)
        positions = self._held()
        mechanism = held(self.setup.mechanism, positions)
        if not mechanism.velocities:
            raise InputError("nothing moves: every coordinate is held", source=self.source, element="excitation")
        base = base_parameters(mechanism, seed=self.setup.settings.seed)
        if not base.rank:
            nothing = "the outputs see no parameter, however the robot moves: the base set is empty"
            raise InputError(nothing, source=self.source)
        file = self.setup.robot_file
        limits = resolved_limits(
            mechanism, self.entry.limits, stated_limits(file, mechanism) if file else {}, self.source
        )
        self.findings += limits.findings
        smooth = _SMOOTH * min([limit.high for limit in limits.motion if limit.order == 1], default=1.0)
        constraints = tuple(self._constraints(mechanism, limits, smooth))
        centre = start_pose(self._centre(mechanism), limits.low, limits.high, constraints, self.entry.seed)
        problem = self._problem(base, limits, constraints, centre, smooth, known)
        found = tuple(self.findings)
        return Design(self.setup, self.entry, base, positions, limits, constraints, centre, problem, found)

    # -- what moves ------------------------------------------------------------------------------------------------

    def _held(self) -> dict[str, float]:
        """Motions that do not move, and where they are."""
        mechanism, entry = self.setup.mechanism, self.entry
        motions = [m for m in mechanism.motions if m.name not in mechanism.dependent]
        names = [m.name for m in motions]
        for name in (*(entry.move or ()), *entry.hold):
            if name not in names:
                raise InputError(
                    f"there is no coordinate '{name}'{nearest_of(name, names)}",
                    source=self.source,
                    element="excitation",
                )
        free = {m.name for body in mechanism.bodies if body.joint.kind == "floating" for m in body.joint.motions}
        free |= {m.name for m in motions if m.kind is MotionKind.BALL}
        moving = [name for name in names if name not in free] if entry.move is None else list(entry.move)
        balls = [name for name in moving if name in free]
        if balls:
            raise InputError(
                f"'{balls[0]}' is not driven by a motor of its own: it can only be held",
                source=self.source,
                element="move",
            )
        if entry.move is None and free:
            text = f"{', '.join(sorted(free))} are held: a floating base is moved by nothing but its joints"
            self.findings.append(Finding(Severity.NOTE, "held", self.source, text))
        return {name: float(entry.hold.get(name, 0.0)) for name in names if name not in moving or name in entry.hold}

    def _centre(self, mechanism: Mechanism) -> Floats:
        names = list(mechanism.velocities)
        for name in self.entry.centre:
            if name not in names:
                raise InputError(
                    f"'{name}' does not move{nearest_of(name, names)}", source=self.source, element="centre"
                )
        return np.array([self.entry.centre.get(name, np.nan) for name in names])

    # -- limits ----------------------------------------------------------------------------------------------------

    def _constraints(self, mechanism: Mechanism, limits: ResolvedLimits, smooth: float) -> Sequence[StateConstraint]:
        found: list[StateConstraint] = []
        if limits.efforts:
            standard = self._standard(mechanism)
            if standard is not None:
                margin = self.entry.effort_margin
                found.append(effort_limits(mechanism, limits.efforts, standard, margin, smooth))
        else:
            text = "there are no limits of torques or forces: the trajectory may ask for more than the drives can give"
            self.findings.append(Finding(Severity.WARNING, "effort", self.source, text))
        points = [limit for entry in self.entry.frames for limit in _point_limits(entry)]
        if points:
            found.append(point_limits(mechanism, points))
        return found

    def _standard(self, mechanism: Mechanism) -> Floats | None:
        """Standard parameters of the prior model; friction without a value counts as none."""
        prior = self.setup.prior
        if prior is not None:
            whole = base_parameters(self.setup.mechanism, seed=self.setup.settings.seed)
            given = dict(zip(self.setup.mechanism.parameters, prior_from(whole, prior).values.tolist(), strict=True))
        else:
            stated = self.setup.mechanism.standard_values()
            given = {
                name: np.nan if value is None else value
                for name, value in zip(self.setup.mechanism.parameters, stated, strict=True)
            }
        values = np.array([given[name] for name in mechanism.parameters])
        inertial = np.array([column.body is not None for column in mechanism.columns])
        if np.isnan(values[inertial]).any():
            if self.entry.limits.effort:
                problem = "limits of torques need inertial values: state them, or a file under identification: prior"
                raise InputError(problem, source=self.source, element="effort limits")
            text = "torques are not limited, because the robot file states no inertial values to predict them with"
            self.findings.append(Finding(Severity.WARNING, "effort", self.source, text))
            return None
        if np.isnan(values).any():
            text = "friction has no values in the prior model: it is left to the margin of the torque limits"
            self.findings.append(Finding(Severity.NOTE, "effort", self.source, text))
        known: Floats = np.nan_to_num(values)
        return known

    # -- problem ---------------------------------------------------------------------------------------------------

    def _problem(
        self,
        base: BaseModel,
        limits: ResolvedLimits,
        constraints: Sequence[StateConstraint],
        centre: Floats,
        smooth: float,
        known: Floats | None,
    ) -> Problem:
        basis = resting_ends(family(self.entry))
        regressor = StateRegressor(base.mechanism, base.matrix.pivots, smooth)
        prior = np.zeros((base.rank, base.rank)) if known is None else known
        times = sample_times(basis.duration, self.entry.rate)
        information = Information(regressor, basis, times, self._weights(base), prior)
        n = len(base.mechanism.velocities)
        problem = Problem(
            basis,
            n,
            information,
            Criterion(self.entry.criterion, np.ones(base.rank)),
            limits.motion,
            tuple(constraints),
            centre,
        )
        if self.entry.criterion != "a_optimal":
            return problem
        # variances are compared in units in which every parameter contributes alike to a random motion
        seen = information(problem.start(np.random.default_rng(self.entry.seed)).reshape(problem.shape))
        sizes = np.sqrt(np.diag(seen.F))
        scales = 1 / np.where(sizes > 0, sizes, 1.0)
        return replace(problem, criterion=Criterion("a_optimal", scales))

    def _weights(self, base: BaseModel) -> Floats:
        names = [output.name for output in base.mechanism.outputs]
        given = self.entry.noise
        every = [output.name for output in self.setup.mechanism.outputs]
        for name in given:
            if name not in (EVERY, *every):
                raise InputError(
                    f"there is no output '{name}'{nearest_of(name, every)}", source=self.source, element="noise"
                )
        return np.array([1 / given.get(name, given.get(EVERY, 1.0)) ** 2 for name in names])


def sample_times(duration: float, rate: float) -> Floats:
    """Samples that a criterion counts, from 0 on, the end left out."""
    return np.arange(max(round(duration * rate), 1)) / rate


def family(entry: ExcitationEntry) -> Basis:
    """The family of motions that a set-up asks for, with any ends."""
    duration = DURATION if entry.duration is None else entry.duration
    series, splines = Fourier(duration, entry.harmonics), uniform_splines(duration, entry.pieces)
    return {"fourier": series, "bspline": splines, "sum": Sum((series, splines))}[entry.family]


def _point_limits(entry: FrameEntry) -> list[PointLimit]:
    name = entry.body if not any(entry.point) else f"{entry.body} at {', '.join(f'{x:g}' for x in entry.point)}"
    if entry.above is not None:
        normal = entry.above.normal
        label = f"height of {name} above the plane {', '.join(f'{x:g}' for x in normal)}"
        return [PointLimit(label, entry.body, entry.point, normal, entry.above.offset + entry.radius, np.inf)]
    found = []
    for axis, letter in enumerate("xyz"):
        ends = getattr(entry.box, letter)
        if ends is not None:
            direction = (float(axis == 0), float(axis == 1), float(axis == 2))
            low, high = ends[0] + entry.radius, ends[1] - entry.radius
            found.append(PointLimit(f"{letter} of {name}", entry.body, entry.point, direction, low, high))
    return found


def changed(entry: ExcitationEntry, changes: Mapping[str, Any], source: str) -> ExcitationEntry:
    """A section with some fields replaced, checked like the section itself."""
    from pydantic import ValidationError

    stated = entry.model_dump(exclude_unset=True)
    try:
        return ExcitationEntry.model_validate(stated | dict(changes))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(
            first["msg"].removeprefix("Value error, "), source=source, element=f"excitation.{where}"
        ) from None
