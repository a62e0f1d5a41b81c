"""The job: pair the bodies of two robots, compare geometry, then inertial values in base parameters, then outputs.

Differences that the last decimals of the files explain count as none; the default tolerance of an output is what these
decimals can move it by.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from echelon.base import (
    BaseModel,
    Correspondence,
    base_of,
    correspondences,
)
from echelon.comparison.inertias import (
    InertialDifference,
    with_effects_of,
    with_stated_effects,
)
from echelon.comparison.outputs import PARTS, OutputDifference, OutputTerm, StateBox
from echelon.comparison.result import (
    BaseDifference,
    Comparison,
    Equality,
    Largest,
    OutputComparison,
)
from echelon.comparison.states import states_of
from echelon.dynamics import STATE
from echelon.formats import load
from echelon.robot import (
    GROUND,
    Mechanism,
    characteristic_length,
    gravity_value,
    lock_joints,
    mechanism_of,
    renamed,
)
from echelon.shared import Floats, InputError, NotNegative, listed, nearest_of, public

_ALIGNED = 1e-6
"""rad, or a share of the robot's size, up to which axes of exact files agree."""
_NEGLIGIBLE = 0.1
"""Share of the tolerance below which bounds of a part need not be sharper: all four together stay below it."""


@public
def compare(
    first: Any,
    second: Any,
    *,
    tolerance: NotNegative | None = None,
    limits: Mapping[str, Any] | None = None,
    locked: Mapping[str, float] | None = None,
) -> Comparison:
    """Compare two robots by what their sensors see: geometry, base parameters, and outputs within limits of the motion.

    Joints correspond by name, or by the tree and their axes where names differ.  Outputs are compared as functions of
    the same positions, velocities and accelerations.

    Parameters
    ----------
    first, second : Mechanism, path-like, or model
        Robots with the same joints: what :func:`echelon.load` takes, or a saved set of base parameters.
    tolerance : float, optional
        Difference of outputs up to which robots count as equal, N·m or N.  By default what the last decimals of both
        files can move each output by; it stands beside each output.
    limits : mapping, optional
        ``position``, ``velocity`` and ``acceleration`` by joint, as in ``excitation: limits`` of a description:
        ``{"velocity": 2, "position": {"j1": [-1, 1]}}``.  They come before those of the files.
    locked : mapping of str to float, optional
        Joints that do not move, in each robot that has them, and where they stand, rad or m: such as those of a hand
        that only one of the robots has.

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
    robots = [with_stated_effects(_robot(source)) for source in (first, second)]
    one, two = _with_locked(robots, locked or {})
    ways = _ways(one, two)
    names = ways[0].names
    box, ranges, notes = states_of(one, two, names, limits or {})
    two = _renamed(two, names)
    one = with_effects_of(one, two)
    base = base_of(one)
    inertial = _plainest([InertialDifference(base, one, two, way) for way in ways])
    pairs = inertial.pairs
    for way in ways:
        if way is not pairs:
            found = "; ".join(map(str, way.differences))
            notes.append(f"other differences explain the same axes: {found}")
    difference = OutputDifference(_terms(base, two, inertial), box)
    q, qd, qdd = box.cut(difference.samples)
    x = np.abs(base.regressor(q, qd, qdd))
    noise = inertial.noise_of_base
    allowed = (x @ noise).max(axis=0, initial=0.0)
    if tolerance is not None:
        allowed = np.full(len(allowed), tolerance)
    attained, states = difference.largest()
    bounds = difference.bounds(attained, _NEGLIGIBLE * allowed)
    rounded = len(difference.terms) == 1 and not inertial.apart.any()
    verdict = (
        Equality.EQUAL
        if rounded and tolerance is None
        else _verdict(attained, bounds, allowed)
    )
    motions = pairs.first.motions, pairs.second.motions
    return Comparison(
        one.name,
        two.name,
        verdict,
        tuple((motions[0][i].name, motions[1][j].name) for i, j in pairs.pairs),
        pairs.differences,
        _size(pairs.moves[GROUND], characteristic_length(one) * _ALIGNED),
        base.rank,
        int(inertial.rounded.sum()),
        tuple(_base_differences(base, inertial, x.max(axis=0, initial=0.0))),
        inertial.parameters(),
        tuple(tuple(one.bodies[k].name for k in group) for group in inertial.cancelled),
        tuple(_outputs(one, box, attained, bounds, states, allowed)),
        dict(
            zip(STATE, (one.positions, *[one.independent_velocities] * 2), strict=True)
        ),
        ranges,
        (*notes, *inertial.notes),
    )


def _robot(source: Any) -> Mechanism:
    """A robot, or what is read from a path, a text or a model of another program."""
    named = isinstance(source, Mechanism | str | os.PathLike)
    return mechanism_of(source) if named else load(source)


def _with_locked(
    robots: Sequence[Mechanism], locked: Mapping[str, float]
) -> list[Mechanism]:
    """Robots with some joints locked, each those that it has."""
    found, names = [], set[str]()
    for robot in robots:
        if robot.contacts or robot.experiments:
            raise InputError(
                f"{robot.name} has contacts or consists of experiments: compare the robots themselves, without these"
            )
        own = {motion.name for motion in robot.motions}
        own |= {body.joint.name for body in robot.bodies}
        held = lock_joints(robot, {n: at for n, at in locked.items() if n in own})
        if not held.velocities:
            raise InputError(f"nothing moves in {robot.name}: lock fewer joints")
        found.append(held if robot.reading is None else held.as_read(robot.reading))
        names |= own
    if strange := [name for name in locked if name not in names]:
        raise InputError(
            f"neither robot has a joint '{strange[0]}' to lock{nearest_of(strange[0], sorted(names))}"
        )
    return found


def _ways(one: Mechanism, two: Mechanism) -> list[Correspondence]:
    """The simplest ways to lay the axes of one robot over those of the other."""
    angle = _ALIGNED + one.rounding + two.rounding
    length = angle * characteristic_length(one)
    pulls = gravity_value(one), gravity_value(two)
    return correspondences(one, two, angle, length, pulls, same_positions=True)


def _plainest(found: Sequence[InertialDifference]) -> InertialDifference:
    """The comparison, of several that explain the axes, in which the fewest values differ."""
    return min(found, key=lambda one: (one.apart.sum(), one.differs.sum()))


def _renamed(two: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """The second robot with the first one's names of joints and outputs; bodies get names that no joint has."""

    def new_name(name: str) -> str:
        joint, dot, component = name.rpartition(".")
        return names.get(name, names.get(joint, joint) + dot + component)

    bodies = (replace(b, name=f".{k}") for k, b in enumerate(two.bodies))
    found = renamed(replace(two, bodies=tuple(bodies)), new_name)
    return found if two.reading is None else found.as_read(two.reading)


def _base_differences(
    base: BaseModel, inertial: InertialDifference, largest: Floats
) -> Any:
    """Base parameters that differ by more than rounding, those that show most first."""
    values, columns = inertial.matrix @ inertial.first, base.mechanism.columns
    found = []
    for k in np.flatnonzero(inertial.apart).tolist():
        effects = largest[:, k] * abs(inertial.base[k])
        row = int(np.argmax(effects))
        body = columns[base.matrix.pivots[k]].body
        found.append(
            BaseDifference(
                base.pivots[k],
                "" if body is None else base.mechanism.bodies[body].name,
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
    base: BaseModel, two: Mechanism, inertial: InertialDifference
) -> tuple[OutputTerm, ...]:
    """The difference of outputs: of one robot with the differences of base parameters, or of both."""
    one = base.mechanism
    two = replace(two, independent=one.independent)
    ours, theirs = ([output.name for output in robot.outputs] for robot in (one, two))
    if sorted(ours) != sorted(theirs):
        raise InputError(
            f"the outputs differ: {listed(ours)} in {one.name}, {listed(theirs)} in {two.name}; state the same in both"
        )
    moves = inertial.pairs.moves.values()
    # a sensor of wrenches is the same one if its frame is
    still = all(_size(place, 0.0) == (0.0, 0.0) for place in moves)
    same = set(one.outputs) == set(two.outputs) and one.actuators == two.actuators
    alike = not inertial.pairs.differences and inertial.complete
    if alike and same and (still or not one.cuts):
        apart = np.flatnonzero(inertial.base).tolist() or [0][: base.rank]
        pivots = [base.matrix.pivots[k] for k in apart]
        return (OutputTerm(one, one, pivots, inertial.base[apart]),)
    return (
        OutputTerm(one, one, range(len(one.parameters)), inertial.first),
        OutputTerm(one, two, range(len(two.parameters)), -inertial.second),
    )


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
            example = dict(zip(STATE, map(tuple, state), strict=True))
            found.append(Largest(float(attained[part, row]), bound, example))
        parts = dict(zip(PARTS, found, strict=False))
        yield OutputComparison(
            output.name, output.unit, float(allowed[row]), found[-1], parts
        )


def _verdict(attained: Floats, bounds: Floats | None, allowed: Floats) -> Equality:
    if (attained[-1] > allowed).any():
        return Equality.DIFFERENT
    if bounds is not None and (bounds[-1] <= allowed).all():
        return Equality.EQUAL
    return Equality.UNDECIDED


def _size(place: Floats, least: float) -> tuple[float, float]:
    """Translation and turn of a movement, zero below a least size."""
    half = np.linalg.norm(place[:3, :3] - np.eye(3)) / np.sqrt(8)
    sizes = float(np.linalg.norm(place[:3, 3])), float(2 * np.arcsin(min(half, 1.0)))
    shift, turn = (size if size > least else 0.0 for size in sizes)
    return shift, turn
