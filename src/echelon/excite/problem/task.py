"""A task: what moves, what its outputs see, and every limit that a trajectory has to keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.excite.problem.clearance import Clearance, clearance_of
from echelon.excite.problem.closed_loops import LoopEfforts, LoopLimits, LoopPart, check_loops
from echelon.excite.problem.effort_limits import effort_limits, effort_model
from echelon.excite.problem.loop_motion import LoopMotion, LoopPositions
from echelon.excite.problem.motion_limits import ResolvedLimits, resolved_limits
from echelon.excite.problem.robot_shapes import read_geometry
from echelon.excite.problem.state_limits import PointLimit, StateConstraint, point_limits
from echelon.excite.problem.stated_shapes import entry_shapes
from echelon.formats.limits import stated_limits
from echelon.formats.schema_excite import EVERY, ExcitationEntry, FrameEntry
from echelon.hints import nearest_of
from echelon.identification.settings import Setup
from echelon.logs.finding import Finding, Severity
from echelon.mechanism.hold import held
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

_SMOOTH = 0.02  # share of the smallest speed limit within which dry friction changes sign gradually


@dataclass(frozen=True)
class Task:
    """What a trajectory is designed for, or judged by."""

    setup: Setup
    entry: ExcitationEntry
    base: BaseModel  # of the robot with what does not move held
    held: Mapping[str, float]  # motions that are held, and where
    limits: ResolvedLimits
    constraints: tuple[StateConstraint, ...]  # torques, points and distances
    weights: Floats  # shape (m,); 1/σ² of each output's noise
    smooth: float  # velocity within which dry friction changes sign gradually while a solver is at work, rad/s or m/s
    findings: tuple[Finding, ...]

    @property
    def mechanism(self) -> Mechanism:
        """What moves."""
        return self.base.mechanism

    @property
    def units(self) -> tuple[str, ...]:
        """Of the coordinates that move, ``"rad"`` or ``"m"``."""
        return self.limits.units


def task_of(setup: Setup, entry: ExcitationEntry) -> Task:
    """Work out what moves and what limits there are."""
    try:
        return _Reader(setup, entry).task()
    except InputError as error:
        raise error.located(setup.source) from None


def names_of(mechanism: Mechanism) -> frozenset[str]:
    """Coordinates and actuators of a mechanism."""
    return frozenset((*mechanism.velocities, *(actuator.name for actuator in mechanism.actuators)))


class _Reader:
    def __init__(self, setup: Setup, entry: ExcitationEntry) -> None:
        self.setup, self.entry, self.source = setup, entry, setup.source
        self.findings: list[Finding] = []

    def task(self) -> Task:
        positions = self._held()
        mechanism = held(self.setup.mechanism, positions)
        if not mechanism.velocities:
            raise InputError("nothing moves: every coordinate is held", source=self.source, element="excitation")
        base = base_parameters(mechanism, seed=self.setup.settings.seed)
        if not base.rank:
            problem = "the outputs see no parameter, however the robot moves: the base set is empty"
            raise InputError(problem, source=self.source)
        file = self.setup.robot_file
        stated = stated_limits(file, mechanism) if file else {}
        limits = resolved_limits(mechanism, self.entry.limits, stated, self.source, names_of(self.setup.mechanism))
        self.findings += limits.findings
        smooth = _SMOOTH * min([limit.high for limit in limits.motion if limit.order == 1], default=1.0)
        constraints = tuple(self._constraints(mechanism, limits, smooth))
        weights, found = self._weights(base), tuple(self.findings)
        return Task(self.setup, self.entry, base, positions, limits, constraints, weights, smooth, found)

    # -- what moves ------------------------------------------------------------------------------------------------

    def _held(self) -> dict[str, float]:
        """Motions that do not move, and where they are."""
        mechanism, entry = self.setup.mechanism, self.entry
        if mechanism.closures:
            check_loops(mechanism, entry.move, entry.hold, self.source)
            return {}
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

    # -- limits ----------------------------------------------------------------------------------------------------

    def _constraints(self, mechanism: Mechanism, limits: ResolvedLimits, smooth: float) -> Sequence[StateConstraint]:
        found: list[StateConstraint] = []
        efforts: list[LoopEfforts] = []
        if limits.efforts:
            model, findings = effort_model(self.setup, self.entry, mechanism, limits.efforts)
            self.findings += findings
            if model is not None:
                given = mechanism, limits.efforts, model, self.entry.effort_margin, smooth
                if mechanism.closures:
                    efforts.append(LoopEfforts(*given))
                else:
                    found.append(effort_limits(*given))
        else:
            text = "there are no limits of torques or forces: the trajectory may ask for more than the drives can give"
            self.findings.append(Finding(Severity.WARNING, "effort", self.source, text))
        points = [limit for entry in self.entry.frames for limit in _point_limits(entry)]
        if points:
            found.append(point_limits(mechanism, points))
        clearance = self._clearance(mechanism, limits)
        found += [] if clearance is None else [clearance]
        if not mechanism.closures:
            return found
        return [LoopLimits(LoopMotion(mechanism), (*efforts, *map(LoopPart, found)))]

    def _clearance(self, mechanism: Mechanism, limits: ResolvedLimits) -> Clearance | None:
        """Distances between bodies, and to obstacles."""
        entry, file, folder = self.entry.collisions, self.setup.robot_file, Path(self.source).parent
        if "collisions" not in self.entry.model_fields_set:
            text = "collisions are not checked: state the section collisions, with obstacles and shapes"
            self.findings.append(Finding(Severity.WARNING, "collisions", self.source, text))
            return None
        shapes, excluded = list(entry_shapes(mechanism, entry.shapes, folder)), list(entry.exclude)
        if file is not None and not file.is_description:
            # shapes that the set-up states stand in for those of the file that cannot be read
            geometry = read_geometry(mechanism, file, tolerant=bool(shapes))
            shapes, excluded = [*geometry.shapes, *shapes], [*geometry.excluded, *excluded]
            self._note("collisions", geometry.notes)
        around = entry_shapes(mechanism, [{"body": "world", **obstacle} for obstacle in entry.obstacles], folder)
        shapes += [replace(shape, obstacle=True) for shape in around]
        if not entry.self:
            names = [body.name for body in mechanism.bodies]
            excluded += [(a, b) for k, a in enumerate(names) for b in names[:k]]
        start = [
            self.entry.centre.get(name, middle)
            for name, middle in zip(mechanism.independent_velocities, limits.middle, strict=True)
        ]
        if mechanism.closures:
            start = LoopPositions(mechanism).positioned(np.array([start])).q[0].tolist()
        found = clearance_of(
            mechanism,
            shapes,
            entry.clearance,
            excluded,
            reference=start,
            ignore_touching=entry.ignore_touching,
        )
        self.findings += [Finding(Severity.WARNING, "collisions", self.source, text) for text in found.notes]
        return found

    def _note(self, kind: str, texts: Sequence[str]) -> None:
        self.findings += [Finding(Severity.NOTE, kind, self.source, text) for text in texts]

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
    stated = entry.model_dump(mode="json", exclude_unset=True)  # where what is unlimited is written none
    try:
        return ExcitationEntry.model_validate(stated | dict(changes))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(("excitation", *map(str, first["loc"])))
        raise InputError(first["msg"].removeprefix("Value error, "), source=source, element=where) from None
