"""A task: what moves, what its outputs see, and every limit that a trajectory has to keep.

Limits of positions, velocities, accelerations and jerks are linear in the coefficients of every family.  The set-up's
come before those of the robot file; defaults fill what neither states, and are reported.  Nothing is unlimited unless
the set-up says ``none``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from echelon.base import BaseModel, base_parameters
from echelon.dynamics import coordinate_units
from echelon.excite.problem.allowances import POSES, allowances_of, without_touching
from echelon.excite.problem.clearance import Clearance, clearance_of
from echelon.excite.problem.closed_loops import (
    LoopMotion,
    check_loops,
    loop_limits,
    loop_motion,
    passive_motions,
)
from echelon.excite.problem.prior_model import identified_efforts, prior_efforts
from echelon.excite.problem.state_limits import (
    ORDERS,
    EffortLimit,
    MotionLimit,
    PointLimit,
    StateConstraint,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.task_shapes import task_shapes
from echelon.formats import (
    EVERY,
    NO_LIMIT,
    ExcitationEntry,
    FrameEntry,
    LimitsEntry,
    StatedLimits,
    stated_limits,
)
from echelon.identification import Finding, Setup, check_single, listed, note, warning
from echelon.robot import Mechanism, known_values, lock_joints, lockable
from echelon.shared import (
    Floats,
    InputError,
    UnfitError,
    locating,
    nearest_of,
    plain_data,
)

_PER = ("", "/s", "/s²", "/s³")
_SPEEDS = {
    "rad": 1.0,
    "m": 0.25,
}  # speeds that are taken where none is stated: those of a careful first run
_ONSETS = (1.0, 0.1, 0.05)
"""By orders from the velocity on, seconds to the full value of the order below, where limits are not stated."""


MOST_TURNS = (
    4 * pi
)  # rad, beyond which a stated position is taken for degrees: no joint of an arm turns so far
ROUNDED_RANGE = 1e-3
"""Length, rad or m, by which a stated range may exceed the file's: rounded decimals."""


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
            return np.where(
                both, (self.low + self.high) / 2, np.clip(0.0, self.low, self.high)
            )


def resolved_limits(
    mechanism: Mechanism,
    entry: LimitsEntry,
    stated: Mapping[str, StatedLimits],
    source: str,
    idle: Collection[str] = (),
) -> ResolvedLimits:
    """Limits of all independent coordinates: those of an entry, else of the robot file, else defaults, with notes."""
    return _Resolver(mechanism, entry, stated, source, idle).resolved()


class _Resolver:
    """Limits of the coordinates that move."""

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
        all_units = dict(
            zip(mechanism.velocities, coordinate_units(mechanism, "qdd"), strict=True)
        )
        self.units = {name: all_units[name].removesuffix("/s²") for name in self.names}
        self.stated = {name: stated.get(name, StatedLimits()) for name in self.names}
        self.drives = _drives(mechanism, self.names)
        self.defaults: dict[str, dict[str, list[str]]] = {}
        self.unlimited: list[str] = []  # efforts that a file states as zero

    def resolved(self) -> ResolvedLimits:
        self._check_names()
        positions = {name: self._position(name) for name in self.names}
        limits = [self._limit(name, 0, *positions[name]) for name in self.names]
        # velocities, accelerations and jerks
        values = {name: _SPEEDS[unit] for name, unit in self.units.items()}
        for order, onset in enumerate(_ONSETS, 1):
            values = {
                name: self._rate(order, name, value / onset)
                for name, value in values.items()
            }
            limits += [
                self._limit(name, order, -value, value)
                for name, value in values.items()
            ]
        limits += self._of_drives()
        low, high = (
            np.array([positions[name][k] for name in self.names]) for k in (0, 1)
        )
        kept = tuple(
            limit for limit in limits if isfinite(limit.low) or isfinite(limit.high)
        )
        efforts = tuple(self._efforts())
        return ResolvedLimits(
            kept,
            efforts,
            low,
            high,
            tuple(self.units.values()),
            tuple(self._findings()),
        )

    # -- names -----------------------------------------------------------------------------------------------------

    def _check_names(self) -> None:
        valid = [EVERY, *self.names, *self.drives]
        for kind in (*ORDERS, "effort"):
            for name in getattr(self.entry, kind):
                if name not in valid and name not in self.idle:
                    problem = f"there is no moving coordinate or actuator '{name}'{nearest_of(name, valid)}"
                    raise InputError(
                        problem, source=self.source, element=f"{kind} limits"
                    )

    def _stated(self, kind: str, name: str) -> float | tuple[float, float] | None:
        """The limit that the set-up states."""
        given: Mapping[str, float | tuple[float, float]] = getattr(self.entry, kind)
        return given.get(name, given.get(EVERY))

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
        if not self.entry.beyond_file:
            self._check_width(name, found)
        return found

    def _check_width(self, name: str, found: tuple[float, float]) -> None:
        """Refuse a range that is wider than the file's, or wider than any joint's, as degrees are."""
        stated = self.stated[name].position or (-inf, inf)
        rotates = self.units[name] == "rad"
        finite = [abs(end) for end in found if isfinite(end)]
        told = ""
        if rotates and max(finite, default=0.0) > MOST_TURNS:
            told = "is beyond 4π: ranges are in rad, and 180° is pi"
        elif finite and (
            found[0] < stated[0] - ROUNDED_RANGE or found[1] > stated[1] + ROUNDED_RANGE
        ):
            told = f"is wider than the robot file's, [{stated[0]:g}, {stated[1]:g}] {self.units[name]}"
        if told:
            shown = f"[{found[0]:g}, {found[1]:g}]"
            problem = f"the position range of '{name}', {shown}, {told}; if it is right, write beyond_file: true"
            raise InputError(problem, source=self.source, element="position limits")

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
        return MotionLimit(
            name, self.units[name] + _PER[order], order, weights, low, high
        )

    def _default(self, kind: str, name: str, value: str) -> None:
        self.defaults.setdefault(kind, {}).setdefault(value, []).append(name)

    def _note_zero_effort(self, name: str) -> None:
        """Remember an effort that the file states as zero and that nothing replaces."""
        if any(" effort 0 " in text for text in self.stated[name].notes):
            self.unlimited.append(name)

    def _findings(self) -> Iterator[Finding]:
        """Defaults that were taken, by kind."""
        for kind, taken in self.defaults.items():
            values = "; ".join(
                f"{', '.join(names)} {value}" for value, names in taken.items()
            )
            text = f"no {kind} limits are stated; these are used: {values}"
            yield note("default limit", self.source, text)
        if self.unlimited:
            names = listed(self.unlimited)
            text = f"the robot file states an effort of 0 for {names}, which counts as unknown: no limit"
            advice = f"write limits: effort: {{{self.unlimited[0]}: 50}}, or none if it is right"
            yield warning("effort", self.source, f"{text}; {advice}")

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
                    found.append(
                        MotionLimit(name, unit + _PER[order], order, weights, low, high)
                    )
        return found

    def _efforts(self) -> Sequence[EffortLimit]:
        found = []
        for name in [
            *self.names,
            *(drive for drive in self.drives if drive not in self.names),
        ]:
            value = (
                self._stated("effort", name)
                if name in self.names
                else self.entry.effort.get(name)
            )
            if (
                value is None
                and name in self.names
                and (effort := self.stated[name].effort) is not None
            ):
                value = effort * self.entry.scale
            if value is None and name in self.names:
                self._note_zero_effort(name)
            if value is not None and value != inf:
                first = (
                    name
                    if name in self.names
                    else self.names[int(np.flatnonzero(self.drives[name])[0])]
                )
                unit = "N·m" if self.units[first] == "rad" else "N"
                assert not isinstance(value, tuple)
                found.append(EffortLimit(name, unit, float(value)))
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


# -- the task ----------------------------------------------------------------------------------------------------------

SMOOTH_SPEED = 0.02
"""Share of the smallest speed limit within which dry friction changes its sign gradually."""


@dataclass(frozen=True)
class Task:
    """The robot and the limits for which a trajectory is designed, or by which it is judged."""

    setup: Setup
    entry: ExcitationEntry
    base: BaseModel  # of the robot with what does not move held
    held: Mapping[str, float]  # motions that are held, and where
    limits: ResolvedLimits
    constraints: tuple[StateConstraint, ...]  # torques, points and distances
    weights: Floats  # shape (m,); 1/σ² of each output's noise
    smooth: float  # velocity within which dry friction changes sign gradually while a solver is at work, rad/s or m/s
    findings: tuple[Finding, ...]
    unchecked: tuple[str, ...]  # what no limit says anything about, in sentences

    @property
    def mechanism(self) -> Mechanism:
        """The robot with what does not move held."""
        return self.base.mechanism


def task_of(setup: Setup, entry: ExcitationEntry) -> Task:
    """Work out what moves and what limits there are, for the section ``excitation`` as it is or changed."""
    with locating(setup.source):
        findings: list[Finding] = []
        check_single(setup)
        positions = _held(setup, entry, findings)
        mechanism = lock_joints(setup.mechanism, positions)
        if not mechanism.velocities:
            raise InputError(
                "nothing moves: every coordinate is held", element="excitation"
            )
        if mechanism.springs:
            raise InputError(
                "motors of elastic drives move as loads bend their springs: plan the motion of the same robot with stiff "
                "drives, without 'elastic'",
                element="rotors",
            )
        base = base_parameters(mechanism, seed=setup.seed)
        if not base.rank:
            raise InputError(
                "no output depends on any parameter: the base set is empty"
            )
        stated = stated_limits(setup.robot_file, mechanism) if setup.robot_file else {}
        limits = resolved_limits(
            mechanism, entry.limits, stated, setup.source, names_of(setup.mechanism)
        )
        findings += limits.findings
        smooth = SMOOTH_SPEED * min(
            [limit.high for limit in limits.motion if limit.order == 1], default=1.0
        )
        unchecked: list[str] = []
        constraints = _constraints(
            setup, entry, mechanism, limits, smooth, findings, unchecked
        )
        weights = _weights(setup, entry, base)
        return Task(
            setup,
            entry,
            base,
            positions,
            limits,
            constraints,
            weights,
            smooth,
            tuple(findings),
            tuple(unchecked),
        )


def names_of(mechanism: Mechanism) -> frozenset[str]:
    """Coordinates and actuators of a mechanism."""
    return frozenset(
        (*mechanism.velocities, *(actuator.name for actuator in mechanism.actuators))
    )


def _held(
    setup: Setup, entry: ExcitationEntry, findings: list[Finding]
) -> dict[str, float]:
    """Motions that do not move, and where they are."""
    mechanism = setup.mechanism
    if not lockable(mechanism):
        check_loops(mechanism, entry.move, entry.hold, setup.source)
        return {}
    motions = mechanism.free_motions
    names = [m.name for m in motions]
    for name in (*(entry.move or ()), *entry.hold):
        if name not in names:
            raise InputError(
                f"there is no coordinate '{name}'{nearest_of(name, names)}",
                element="excitation",
            )
    free = {m.name for m in passive_motions(mechanism)}
    moving = (
        [name for name in names if name not in free]
        if entry.move is None
        else list(entry.move)
    )
    undriven = [name for name in moving if name in free]
    if undriven:
        problem = (
            f"'{undriven[0]}' is not driven by a motor of its own: it can only be held"
        )
        raise InputError(problem, element="move")
    if entry.move is None and free:
        text = (
            f"{', '.join(sorted(free))} are held: only its joints move a floating base"
        )
        findings.append(note("held", setup.source, text))
    return {
        name: float(entry.hold.get(name, 0.0))
        for name in names
        if name not in moving or name in entry.hold
    }


def _constraints(
    setup: Setup,
    entry: ExcitationEntry,
    mechanism: Mechanism,
    limits: ResolvedLimits,
    smooth: float,
    findings: list[Finding],
    unchecked: list[str],
) -> tuple[StateConstraint, ...]:
    """Limits of torques, points and distances; one constraint of all of them where there are loops."""
    model = None
    if limits.efforts and entry.model is not None:
        model = identified_efforts(
            setup, entry.model, entry.deviations, mechanism, limits.efforts
        )
    elif limits.efforts:
        model = prior_efforts(setup, entry, mechanism, findings)
    else:
        text = "no limits of torques or forces: the trajectory may exceed what the drives can give"
        findings.append(warning("effort", setup.source, text))
    found: list[StateConstraint] = []
    points = [limit for frame in entry.frames for limit in _point_limits(frame)]
    if points:
        found.append(point_limits(mechanism, points))
    clearance = _clearance(setup, entry, mechanism, limits, findings, unchecked)
    found += [] if clearance is None else [clearance]
    if model is not None:
        found.insert(
            0,
            effort_limits(
                mechanism, limits.efforts, model, entry.effort_margin, smooth
            ),
        )
    motion = loop_motion(mechanism)
    return (loop_limits(motion, found),) if motion else tuple(found)


def _clearance(
    setup: Setup,
    entry: ExcitationEntry,
    mechanism: Mechanism,
    limits: ResolvedLimits,
    findings: list[Finding],
    unchecked: list[str],
) -> Clearance | None:
    """Distances between bodies, and to obstacles, as far as the robot can keep them."""
    if "collisions" not in entry.model_fields_set:
        text = "collisions are not checked: state the section collisions, with obstacles and shapes"
        findings.append(warning("collisions", setup.source, text))
        unchecked.append("collisions were not checked")
        return None
    section = entry.collisions
    shapes = task_shapes(setup, entry, mechanism)
    findings += shapes.findings
    if shapes.shapeless:
        names = listed(shapes.shapeless)
        unchecked.append(f"links without shapes were not checked: {names}")
    pure = replace(mechanism)  # without how the file was read
    clearance = clearance_of(pure, shapes.shapes, section.clearance, shapes.excluded)
    motion = loop_motion(mechanism)
    lowered: list[str] = []
    left_out: list[str] = []
    if section.ignore_touching:
        each = zip(mechanism.independent_velocities, limits.middle, strict=True)
        start = np.array([entry.centre.get(name, middle) for name, middle in each])
        pose = motion.positioned(start[None]).q[0] if motion else start
        found = without_touching(clearance, pose)
        clearance = found.clearance
        left_out += found.unchecked
    if len(clearance.pairs):
        found = allowances_of(clearance, _random_poses(limits, motion, entry.seed))
        clearance = found.clearance
        lowered += found.lowered
        left_out += found.unchecked
    findings += [note("collisions", setup.source, text) for text in lowered]
    findings += [warning("collisions", setup.source, text) for text in left_out]
    if left_out:
        number = len(left_out)
        pairs = (
            "a pair of shapes was" if number == 1 else f"{number} pairs of shapes were"
        )
        unchecked.append(f"{pairs} not checked")
    return clearance


def _random_poses(
    limits: ResolvedLimits, motion: LoopMotion | None, seed: int
) -> Floats:
    """Poses within the position limits, of all positions where there are loops."""
    low = np.where(np.isfinite(limits.low), limits.low, limits.middle - pi)
    high = np.where(np.isfinite(limits.high), limits.high, limits.middle + pi)
    poses = low + (high - low) * np.random.default_rng(seed).random((POSES, len(low)))
    if motion is None:
        return poses
    closed = motion.positioned(poses)
    return closed.q[closed.done]


def _weights(setup: Setup, entry: ExcitationEntry, base: BaseModel) -> Floats:
    """1/σ² of each output's noise."""
    every = [output.name for output in setup.mechanism.outputs]
    for name in entry.noise:
        if name not in (EVERY, *every):
            raise InputError(
                f"there is no output '{name}'{nearest_of(name, every)}", element="noise"
            )
    rest = entry.noise.get(EVERY, 1.0)
    return np.array(
        [
            1 / entry.noise.get(output.name, rest) ** 2
            for output in base.mechanism.outputs
        ]
    )


def _point_limits(entry: FrameEntry) -> list[PointLimit]:
    name = (
        entry.body
        if not any(entry.point)
        else f"{entry.body} at {', '.join(f'{x:g}' for x in entry.point)}"
    )
    if entry.above is not None:
        normal = entry.above.normal
        label = (
            f"height of {name} above the plane {', '.join(f'{x:g}' for x in normal)}"
        )
        return [
            PointLimit(
                label,
                entry.body,
                entry.point,
                normal,
                entry.above.offset + entry.radius,
                np.inf,
            )
        ]
    found = []
    for axis, letter in enumerate("xyz"):
        ends = getattr(entry.box, letter)
        if ends is not None:
            direction = (float(axis == 0), float(axis == 1), float(axis == 2))
            low, high = ends[0] + entry.radius, ends[1] - entry.radius
            found.append(
                PointLimit(
                    f"{letter} of {name}", entry.body, entry.point, direction, low, high
                )
            )
    return found


def changed(
    entry: ExcitationEntry, changes: Mapping[str, Any], source: str
) -> ExcitationEntry:
    """A section with some fields replaced, checked like the section itself."""
    stated = plain_data(entry.model_dump(exclude_unset=True), NO_LIMIT)
    try:
        return ExcitationEntry.model_validate(stated | dict(changes))
    except UnfitError as error:
        where = ".".join(("excitation", *map(str, error.where)))
        raise InputError(error.problem, source=source, element=where) from None
