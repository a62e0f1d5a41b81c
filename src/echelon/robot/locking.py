"""A mechanism with some joints locked: what remains to be seen when only the others move."""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from fractions import Fraction
from math import tan

from echelon.algebra import as_polynomial, circle_point
from echelon.robot.coupling import Coupling, Spline
from echelon.robot.effect import Effect, Side
from echelon.robot.joint import (
    Body,
    Joint,
    Motion,
    MotionKind,
    Placement,
    merge,
    moved_by,
)
from echelon.robot.mechanism import Actuator, Mechanism, Output
from echelon.robot.stated import known_values
from echelon.robot.term import read_term
from echelon.shared import InputError, nearest_of

_DENOMINATOR = (
    10**8
)  # of tangents of half angles: a rational point of the circle within 2e-8 rad of any angle


def lock_joints(mechanism: Mechanism, positions: Mapping[str, float]) -> Mechanism:
    """The mechanism with some joints locked.

    Bodies and their parameters stay; actuators, effects and outputs of what is held go, so do outputs of the forces
    that hold it.  A ball (floating bases have one) is held upright.

    >>> import echelon as ec
    >>> arm = ec.load("examples/double_pendulum.yaml")
    >>> lock_joints(arm, {"j1": 0}).velocities
    ('j2',)
    """
    if not positions:
        return mechanism
    motions = {motion.name: motion for motion in mechanism.motions}
    positions = _of_motions(mechanism, positions)
    strange = next((name for name in positions if name not in motions), None)
    if strange is not None:
        raise InputError(
            f"there is no coordinate '{strange}' to hold{nearest_of(strange, list(motions))}"
        )
    if not lockable(mechanism):
        raise InputError("joints of a mechanism with loops cannot be locked")
    all_positions = _with_coupled(mechanism, positions)
    gone = {name for key in all_positions for name in (key, *motions[key].velocities)}
    actuators = tuple(_actuators(mechanism, gone))
    gone |= {a.name for a in mechanism.actuators} - {a.name for a in actuators}
    measured = mechanism.measured
    if measured is not None:
        measured = tuple(_outputs(measured, gone))
    return replace(
        mechanism,
        bodies=tuple(_body(body, all_positions) for body in mechanism.bodies),
        couplings=tuple(c for c in mechanism.couplings if c.coordinate not in gone),
        actuators=actuators,
        effects=tuple(_effects(mechanism, gone, all_positions, measured or ())),
        measured=measured,
        locked={**mechanism.locked, **_standing(mechanism, all_positions)},
    )


def lockable(mechanism: Mechanism) -> bool:
    """Whether joints can be locked, which with loops would lock others."""
    return not mechanism.closures


def _standing(mechanism: Mechanism, held: Mapping[str, float]) -> dict[str, float]:
    """Where coordinates that are held stand, and drives that move nothing else."""
    known, drives = known_values(mechanism), dict[str, float]()
    for actuator in mechanism.actuators:
        if all(name in held for name, _ in actuator.terms):
            turns = (ratio.at(known) * held[name] for name, ratio in actuator.terms)
            drives[actuator.name] = sum(turns)
    return {**drives, **held}


def _of_motions(
    mechanism: Mechanism, positions: Mapping[str, float]
) -> dict[str, float]:
    """Positions by motion: a joint stands for all of its motions."""
    joints = {
        body.joint.name: [motion.name for motion in body.joint.motions]
        for body in mechanism.bodies
    }
    return {
        motion: at
        for name, at in positions.items()
        for motion in joints.get(name) or [name]
    }


def _with_coupled(
    mechanism: Mechanism, positions: Mapping[str, float]
) -> dict[str, float]:
    """Positions of what is held, and of what follows it."""
    found = dict(positions)
    for coupling in mechanism.couplings:
        leaders = [name for name, _ in coupling.terms]
        here = [name for name in leaders if name in positions]
        if coupling.coordinate in positions:
            raise InputError(
                f"'{coupling.coordinate}' follows {', '.join(leaders)}; hold these instead"
            )
        if here and len(here) < len(leaders):
            raise InputError(
                f"'{coupling.coordinate}' follows {', '.join(leaders)}: hold all of them or none"
            )
        if here:
            found[coupling.coordinate] = sum(
                _known(coupling, f).floats(positions[name], {})[0]
                for name, f in coupling.terms
            )
    return found


def _known(coupling: Coupling, function: Spline) -> Spline:
    if any(value.number is None for value in function.expressions):
        raise InputError(
            f"the coupling of '{coupling.coordinate}' has symbols; only coordinates of known ratios can be held"
        )
    return function


def _body(body: Body, positions: Mapping[str, float]) -> Body:
    held = {
        m.name: _placed(m, positions[m.name])
        for m in body.joint.motions
        if m.name in positions
    }
    kind = body.joint.kind if len(held) < len(body.joint.motions) else "fixed"
    steps = tuple(
        held.get(step.name, step) if isinstance(step, Motion) else step
        for step in body.joint.steps
    )
    return replace(body, joint=Joint(body.joint.name, kind, merge(steps)))


def _placed(motion: Motion, position: float) -> Placement:
    """The placement that takes the place of a motion at a position."""
    if motion.kind is MotionKind.BALL:
        if position:
            raise InputError(f"'{motion.name}' turns freely; it can be held at 0 only")
        return Placement()
    angle = 0.0 if motion.kind is MotionKind.TRANSLATION else position
    cosine, sine = circle_point(
        Fraction(tan(angle / 2)).limit_denominator(_DENOMINATOR)
    )
    return moved_by(
        motion,
        as_polynomial(cosine),
        as_polynomial(sine),
        as_polynomial(Fraction(position)),
    )


def _actuators(mechanism: Mechanism, gone: Iterable[str]) -> Iterable[Actuator]:
    """Actuators that still move something, as many as there are coordinates that they move."""
    left = []
    for actuator in mechanism.actuators:
        terms = tuple(pair for pair in actuator.terms if pair[0] not in gone)
        if terms:
            left.append(replace(actuator, terms=terms))
    driven = {name for actuator in left for name, _ in actuator.terms}
    if len(driven) < len(left):
        names, joints = ", ".join(a.name for a in left), ", ".join(sorted(driven))
        raise InputError(
            f"{names} would drive {joints} alone: hold all joints that are coupled, or none of them"
        )
    return left


def _effects(
    mechanism: Mechanism,
    gone: set[str],
    positions: Mapping[str, float],
    measured: Collection[Output],
) -> Iterable[Effect]:
    """Effects where something moves or is measured, with what does not move standing still."""
    still = _still(mechanism, gone, positions)
    left = {output.name for output in measured}

    for effect in mechanism.effects:
        actions = []
        for action in effect.actions:
            term = read_term(action.term)
            texts: dict[ast.expr, str] = {}
            held = {q.name for q in term.quantities if q.at in gone}
            if action.side is Side.OUTPUT:
                acts = action.at in left
            else:
                acts = action.at not in gone
            if not acts or "i" in held:
                continue
            for q in term.quantities:
                if q.at is not None and q.at in gone:
                    position = f"({still.get(q.at, 0.0)!r})"
                    texts[q.node] = position if q.name == "q" else "0"
            actions.append(replace(action, term=term.replaced(texts)))
        if actions:
            yield replace(effect, actions=tuple(actions))


def _still(
    mechanism: Mechanism, gone: set[str], positions: Mapping[str, float]
) -> dict[str, float]:
    """Positions of coordinates and actuators that do not move."""
    known = known_values(mechanism)
    found = dict(positions)
    for actuator in mechanism.actuators:
        if actuator.name in gone:
            ratios = [(name, r.at(known)) for name, r in actuator.terms]
            found[actuator.name] = sum(
                ratio * positions.get(name, 0.0) for name, ratio in ratios
            )
    return found


def _outputs(outputs: Iterable[Output], gone: set[str]) -> Iterable[Output]:
    for output in outputs:
        left = replace(
            output,
            forces=tuple(
                (force, weight)
                for force, weight in output.forces
                if force.at not in gone
            ),
        )
        if left.forces or left.cuts:
            yield left
