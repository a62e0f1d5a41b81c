"""The job: pair the bodies of two robots, compare geometry, then inertial values in base parameters, then outputs.

Inertias of both are moved into the base frame of the pose of zero, where corresponding bodies lie over one another, and
their difference Δζ about the first robot's frames.  With one geometry, B Δζ is all that can be seen: what of Δζ lies in
the null space of B shows in no output, whatever its size.  Differences that the last decimals of the files explain count
as none; the default tolerance of an output is what these decimals can move it by.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from echelon.base import BaseModel, Correspondence, base_of, correspondence
from echelon.comparison.outputs import PARTS, OutputDifference, StateBox, Term
from echelon.comparison.result import (
    BaseDifference,
    Comparison,
    Equality,
    Largest,
    OutputComparison,
    ParameterDifference,
)
from echelon.excite import changed, resolved_limits
from echelon.formats import (
    ExcitationEntry,
    StatedLimits,
    inertial_rounding,
    stated_limits,
)
from echelon.robot import (
    ALL,
    GROUND,
    Action,
    Effect,
    Mechanism,
    MotionKind,
    Readable,
    characteristic_length,
    mechanism_of,
    move,
)
from echelon.shared import PER_BODY, Floats, InputError, listed, public, unused

COMPUTED = 1e-9
"""Share of a number by which computing with it in doubles, along a chain of bodies, may move it."""
_ALIGNED = 1e-6
"""rad, or a share of the robot's size, up to which axes of exact files agree."""
_NEGLIGIBLE = 0.1
"""Share of the tolerance below which bounds of a part need not be sharper: all four together stay below it."""
_ROOM = 1.0  # m to each side for a floating base, where no output depends on the place
_ANYWHERE = 1e3  # rad or m, beyond all positions that loops lead to


@public
def compare(
    first: Mechanism | Readable,
    second: Mechanism | Readable,
    *,
    tolerance: float | None = None,
    limits: Mapping[str, Any] | None = None,
) -> Comparison:
    """Compare two robots by what their sensors see: geometry, base parameters, and outputs over all states within limits.

    Joints correspond by name, or by the tree and their axes where names differ.  Outputs are compared as functions of
    the same positions, velocities and accelerations.

    Parameters
    ----------
    first, second : Mechanism or path-like
        Robots with the same joints, in any format.
    tolerance : float, optional
        Difference of outputs up to which robots count as equal, N·m or N.  By default what the last decimals of both
        files can move each output by; it stands beside each output.
    limits : mapping, optional
        ``position``, ``velocity`` and ``acceleration`` by joint, as in ``excitation: limits`` of a description:
        ``{"velocity": 2, "position": {"j1": [-1, 1]}}``.  They come before those of the files.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If the robots have other joints or outputs, or a file states no inertial values.

    Notes
    -----
    Bounds hold for every state within the limits, by interval arithmetic over boxes of states (R. E. Moore, Interval
    Analysis, 1966); with loops there are none, and the largest differences are those of closed states that were met.

    Examples
    --------
    >>> import echelon as ec
    >>> found = ec.compare("examples/so101.urdf", "examples/so101.urdf")
    >>> found.verdict
    <Equality.EQUAL: 'equal'>
    """
    one, two = (_with_stated_effects(mechanism_of(robot)) for robot in (first, second))
    pairs = correspondence(one, two, _ALIGNED + one.rounding + two.rounding)
    one = _with_effects_of(one, two, pairs.names)
    base = base_of(one)
    two = _with_same_inputs(two, base.mechanism, pairs)
    inertial = _InertialDifference(base, two, pairs)
    box, ranges, notes = _states(base.mechanism, two, pairs, limits or {})
    terms = _terms(base, two, pairs, inertial)
    difference = OutputDifference(terms, box)
    noise = inertial.base_noise
    x = base.regressor(*box.cut(difference.samples))
    allowed = (np.abs(x) @ noise).max(axis=0, initial=0.0)
    if tolerance is not None:
        allowed = np.full(len(allowed), tolerance)
    attained, states = difference.largest()
    bounds = difference.bounds(attained, _NEGLIGIBLE * allowed)
    explained = len(terms) == 1 and bool((np.abs(inertial.base) <= noise).all())
    return Comparison(
        one.name,
        two.name,
        _verdict(
            attained[-1],
            None if bounds is None else bounds[-1],
            allowed,
            explained and tolerance is None,
        ),
        tuple(
            (pairs.first.motions[i].name, pairs.second.motions[j].name)
            for i, j in pairs.pairs
        ),
        pairs.differences,
        _size(pairs.moves[GROUND], characteristic_length(one) * _ALIGNED),
        base.rank,
        tuple(_base_differences(base, inertial, np.abs(x).max(axis=0, initial=0.0))),
        inertial.parameters(),
        tuple(_outputs(base.mechanism, box, attained, bounds, states, allowed)),
        {
            "q": base.mechanism.positions,
            "qd": base.mechanism.independent_velocities,
            "qdd": base.mechanism.independent_velocities,
        },
        ranges,
        (*notes, *inertial.notes),
    )


# -- effects -----------------------------------------------------------------------------------------------------------


def _with_stated_effects(mechanism: Mechanism) -> Mechanism:
    """The robot with the friction, springs and rotors of which its file states values."""
    reading = mechanism.reading
    if reading is None or mechanism.effects:
        return mechanism
    usual = reading.file.mechanism(replace(reading.options, usual_effects=True))
    stated = tuple(
        e for e in usual.effects if e.value is not None and isfinite(e.value)
    )
    return replace(mechanism, effects=stated).as_read(reading)


def _with_effects_of(
    one: Mechanism, two: Mechanism, names: Mapping[str, str]
) -> Mechanism:
    """The first robot with the effects that only the second has, as parameters of value zero."""
    own = {effect.actions for effect in one.effects}
    effects = list(one.effects)
    for effect in two.effects:
        actions = _actions(effect, names)
        if actions not in own:
            name = unused(
                effect.parameter, [*one.parameters, *(e.parameter for e in effects)]
            )
            effects.append(replace(effect, parameter=name, actions=actions, value=0.0))
    changed = replace(one, effects=tuple(effects))
    return changed if one.reading is None else changed.as_read(one.reading)


def _actions(effect: Effect, names: Mapping[str, str]) -> tuple[Action, ...]:
    """Where an effect acts, by names of the first robot."""
    renamed = any(name != other for name, other in names.items())
    for action in effect.actions:
        if renamed and "[" in action.term:
            raise InputError(
                f"'{action.term}' names coordinates, which have other names in the first robot: give both the same",
                element=f"effect '{effect.parameter}'",
            )
    return tuple(replace(a, at=names.get(a.at, a.at)) for a in effect.actions)


def _with_same_inputs(
    two: Mechanism, one: Mechanism, pairs: Correspondence
) -> Mechanism:
    """The second robot with the independent coordinates of the first."""
    if not one.independent:
        return two
    places = pairs.places(one.velocities, two.velocities)
    wanted = [one.velocities.index(name) for name in one.independent]
    independent = tuple(two.velocities[places.index(place)] for place in wanted)
    return replace(two, independent=independent)


# -- inertial values ---------------------------------------------------------------------------------------------------


class _InertialDifference:
    """What the inertial values of two robots have apart, in standard and base parameters of the first."""

    def __init__(self, base: BaseModel, two: Mechanism, pairs: Correspondence) -> None:
        self.one, self.two, self.pairs = base.mechanism, two, pairs
        self.matrix = base.B_float()
        self.notes: list[str] = []
        self.first = self._stated(self.one)
        self.second = self._stated(two)
        count = len(self.first)
        self.standard, self.noise = np.zeros(count), np.zeros(count)
        self.complete = (
            True  # whether the first robot has a column for every difference
        )
        units = [_units(robot) for robot in (self.one, two)]
        shares = COMPUTED + pairs.deviation
        self._units = np.sum(units, axis=0), shares, characteristic_length(self.one)
        for i, j in [(GROUND, GROUND), *pairs.pairs]:
            self._compare_bodies(i, j)
        self._compare_effects()
        self.base = self.matrix @ self.standard
        self.base_noise = np.abs(self.matrix) @ self.noise

    def _stated(self, robot: Mechanism) -> Floats:
        """Standard parameters, zero where a file is silent, which is noted."""
        stated = robot.standard_values()
        silent = [
            c.name for c, v in zip(robot.columns, stated, strict=True) if v is None
        ]
        if len(silent) == len(stated) and silent:
            raise InputError(
                f"{robot.name} states no inertial values, so there is nothing to compare; add them to its file"
            )
        if silent:
            self.notes.append(
                f"{robot.name} states no values of {listed(silent)}: they count as 0"
            )
        return np.array([0.0 if value is None else value for value in stated])

    def _compare_bodies(self, i: int, j: int) -> None:
        """The difference of all that rides on a motion, in the columns of a body there that has all ten."""
        one, pose = self.one, self.pairs.first
        riders = [k for k, node in pose.node.items() if node == i and k != GROUND]
        host = next(
            (
                k
                for k in riders
                if one.bodies[k].carried == ALL and len(one.sharing[k]) == 1
            ),
            None,
        )
        back = np.linalg.inv(self.pairs.moves[i])
        theirs = self._gathered(self.two, self.pairs.second, j, back)
        ours = self._gathered(one, pose, i, np.eye(4))
        noise = self._noise(
            ours if host is None else move(ours, np.linalg.inv(pose.frames[host]))
        )
        if host is None:
            self.complete &= bool(
                (np.abs(ours - theirs) <= self._noise(ours) + self._noise(theirs)).all()
            )
            return
        start = one.first_column[host]
        own = slice(start, start + PER_BODY)
        self.standard[own] = move(ours - theirs, np.linalg.inv(pose.frames[host]))
        self.noise[own] = noise

    def _gathered(
        self, robot: Mechanism, pose: Any, node: int, place: Floats
    ) -> Floats:
        """Inertial values of all bodies that ride on a motion, in a base frame that stands somewhere, pose of zero."""
        total = np.zeros(PER_BODY)
        for k, at in pose.node.items():
            if at == node and k != GROUND and robot.bodies[k].inertial is not None:
                kept = np.isin(range(PER_BODY), robot.bodies[k].carried)
                total += move(
                    np.where(kept, robot.bodies[k].inertial, 0.0),
                    place @ pose.frames[k],
                )
        return total

    def _noise(self, values: Floats) -> Floats:
        """What the last decimals of both files can move ten values by, and computing with them."""
        (mass, centre, moment), share, length = self._units
        weight = abs(values[-1])
        arm = float(np.linalg.norm(values[6:9])) / (weight or 1.0)
        reach = arm + length
        first = weight * (centre + share * reach) + arm * mass
        second = moment + weight * (2 * arm * centre + share * reach**2) + arm**2 * mass
        second += COMPUTED * float(np.abs(values[:6]).max())
        return np.array([*[second] * 6, *[first] * 3, mass + COMPUTED * weight])

    def _compare_effects(self) -> None:
        names = self.pairs.names
        theirs = {_actions(e, names): e.value or 0.0 for e in self.two.effects}
        start = len(self.first) - len(self.one.effects)
        for column, effect in enumerate(self.one.effects, start):
            value = theirs.get(effect.actions, 0.0)
            self.standard[column] = self.first[column] - value
            self.noise[column] = COMPUTED * abs(self.first[column])

    def parameters(self) -> tuple[ParameterDifference, ...]:
        """Standard parameters that differ by more than rounding."""
        seen = np.abs(self.base) > self.base_noise
        shown = (np.abs(self.matrix[seen]) > 0).any(axis=0)
        columns = enumerate(self.one.columns)
        return tuple(
            ParameterDifference(
                column.name,
                "" if column.body is None else self.one.bodies[column.body].name,
                column.unit,
                float(self.first[k]),
                float(self.first[k] - self.standard[k]),
                bool(shown[k]),
            )
            for k, column in columns
            if abs(self.standard[k]) > self.noise[k]
        )


def _units(robot: Mechanism) -> tuple[float, float, float]:
    """Units of the last decimals of masses, centres and moments in the file of a robot; 0 without a file."""
    return (
        (0.0, 0.0, 0.0)
        if robot.reading is None
        else inertial_rounding(robot.reading.file)
    )


def _base_differences(
    base: BaseModel, inertial: _InertialDifference, largest: Floats
) -> Any:
    """Base parameters that differ by more than rounding, those that show most first."""
    values = inertial.matrix @ inertial.first
    found = []
    for k in np.flatnonzero(np.abs(inertial.base) > inertial.base_noise).tolist():
        effects = largest[:, k] * abs(inertial.base[k])
        row = int(np.argmax(effects))
        found.append(
            BaseDifference(
                base.pivots[k],
                str(base.readable[k]),
                base.units[k],
                float(values[k]),
                float(values[k] - inertial.base[k]),
                base.mechanism.outputs[row].name,
                float(effects[row]),
            )
        )
    return sorted(found, key=lambda difference: -difference.effect)


# -- outputs -----------------------------------------------------------------------------------------------------------


def _terms(
    base: BaseModel,
    two: Mechanism,
    pairs: Correspondence,
    inertial: _InertialDifference,
) -> tuple[Term, ...]:
    """The difference of outputs: of one robot with the differences of base parameters, or of both."""
    one = base.mechanism
    ours = [output.name for output in one.outputs]
    theirs = [_renamed(output.name, pairs.names) for output in two.outputs]
    if sorted(ours) != sorted(theirs):
        raise InputError(
            f"the outputs differ: {listed(ours)} in {one.name}, {listed(theirs)} in {two.name}; state the same in both"
        )
    all_positions, all_velocities = (
        range(len(one.positions)),
        range(len(one.independent_velocities)),
    )
    q, qd = range(len(one.positions)), range(len(one.independent_velocities))
    same_sensors = _same_outputs(one, two, pairs)
    if inertial.complete and not pairs.differences and same_sensors:
        apart = np.flatnonzero(inertial.base).tolist() or [0][: base.rank]
        pivots = [base.matrix.pivots[k] for k in apart]
        return (Term(one, pivots, inertial.base[apart], q, qd, range(len(ours))),)
    positions = two.independent_positions if two.closures else two.positions
    return (
        Term(one, range(len(one.parameters)), inertial.first, q, qd, range(len(ours))),
        Term(
            two,
            range(len(two.parameters)),
            -inertial.second,
            pairs.places(one.positions, positions),
            pairs.places(one.independent_velocities, two.independent_velocities),
            [theirs.index(name) for name in ours],
        ),
    )


def _renamed(output: str, names: Mapping[str, str]) -> str:
    """The name of an output after the first robot's joints."""
    joint, dot, component = output.rpartition(".")
    return names.get(output, names.get(joint, joint) + dot + component)


def _same_outputs(one: Mechanism, two: Mechanism, pairs: Correspondence) -> bool:
    """Whether outputs of the same name are the same function of wrenches: sensors of wrenches sit in the same frames."""
    if not pairs.by_name:
        return (
            one.measured is None
            and two.measured is None
            and not one.actuators
            and not two.actuators
        )
    still = all(_size(place, 0.0) == (0.0, 0.0) for place in pairs.moves.values())
    return (
        one.outputs == two.outputs
        and one.actuators == two.actuators
        and (still or not one.cuts)
    )


def _states(
    one: Mechanism, two: Mechanism, pairs: Correspondence, limits: Mapping[str, Any]
) -> tuple[StateBox, dict[str, tuple[float, float]], list[str]]:
    """States within the limits that are given, or that the first robot's file or the second's states."""
    names = pairs.names
    stated = _stated_limits(one)
    others = {names[name]: found for name, found in _stated_limits(two).items()}
    notes = []
    if unlike := [n for n in stated if n in others and stated[n] != others[n]]:
        notes.append(
            f"the files state other limits of {listed(unlike)}: those of {one.name} count"
        )
    entry = ExcitationEntry.model_construct()
    if one.reading is not None and one.reading.file.is_description:
        entry = one.reading.file.description.excitation
    floating = {
        name: (-_ROOM, _ROOM)
        for body in one.bodies
        if body.joint.kind == "floating"
        for motion in body.joint.motions
        if motion.kind is MotionKind.TRANSLATION
        for name in motion.velocities
    }
    own = entry.limits.model_dump(mode="json", exclude_unset=True) | dict(limits)
    entry = changed(entry, {"limits": own}, "limits")
    room = {**floating, **entry.limits.position}
    limited = entry.limits.model_copy(update={"position": room})
    found = resolved_limits(one, limited, {**others, **stated}, one.name)
    notes += [finding.text for finding in found.findings]
    free = one.independent_velocities
    rates = [{m.name: m.high for m in found.motion if m.order == k} for k in (1, 2)]
    ranges: dict[str, tuple[float, float]] = {}
    for k, name in enumerate(free):
        low, high = float(found.low[k]), float(found.high[k])
        if found.units[k] == "rad" and not isfinite(high - low):
            low, high = max(low, -pi), min(high, pi)  # a turn further all is the same
        ranges[f"q[{name}]"] = low, high
        for kind, rate in zip(("qd", "qdd"), rates, strict=True):
            ranges[f"{kind}[{name}]"] = -rate.get(name, inf), rate.get(name, inf)
    endless = [name for name, (low, high) in ranges.items() if not isfinite(high - low)]
    if endless:
        raise InputError(
            f"nothing limits {listed(endless)}: state limits, such as limits={{'velocity': 2}}"
        )
    ends = np.array(
        [
            _range_of(name, motion.kind, ranges)
            for motion in one.free_motions
            for name in motion.positions
        ]
    )
    sizes = [
        np.array([ranges[f"{kind}[{name}]"][1] for name in free])
        for kind in ("qd", "qdd")
    ]
    ends = ends.reshape(-1, 2)
    return StateBox(ends[:, 0], ends[:, 1], *sizes), ranges, notes


def _range_of(
    name: str, kind: MotionKind, ranges: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """The range of a position: of a component of a unit quaternion, or of what follows from loops, any value."""
    return (
        (-1.0, 1.0)
        if kind is MotionKind.BALL
        else ranges.get(f"q[{name}]", (-_ANYWHERE, _ANYWHERE))
    )


def _stated_limits(robot: Mechanism) -> Mapping[str, StatedLimits]:
    return {} if robot.reading is None else stated_limits(robot.reading.file, robot)


def _outputs(
    one: Mechanism,
    box: StateBox,
    attained: Floats,
    bounds: Floats | None,
    states: Floats,
    allowed: Floats,
) -> Any:
    """One comparison for each output."""
    for row, output in enumerate(one.outputs):
        found = []
        for part in range(len(PARTS) + 1):
            state = (values[0].tolist() for values in box.cut(states[part, row][None]))
            bound = None if bounds is None else float(bounds[part, row])
            example = dict(zip(("q", "qd", "qdd"), map(tuple, state), strict=True))
            found.append(Largest(float(attained[part, row]), bound, example))
        parts = dict(zip(PARTS, found, strict=False))
        yield OutputComparison(
            output.name, output.unit, float(allowed[row]), found[-1], parts
        )


def _verdict(
    attained: Floats, bounds: Floats | None, allowed: Floats, explained: bool
) -> Equality:
    if explained:
        return Equality.EQUAL
    if (attained > allowed).any():
        return Equality.DIFFERENT
    if bounds is not None and (bounds <= allowed).all():
        return Equality.EQUAL
    return Equality.UNDECIDED


def _size(place: Floats, least: float) -> tuple[float, float]:
    """Translation and turn of a movement, zero below a least size."""
    half = np.linalg.norm(place[:3, :3] - np.eye(3)) / np.sqrt(8)
    sizes = float(np.linalg.norm(place[:3, 3])), float(2 * np.arcsin(min(half, 1.0)))
    shift, turn = (size if size > least else 0.0 for size in sizes)
    return shift, turn
