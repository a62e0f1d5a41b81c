"""A prior from another description of the same robot: its inertias in the frames of the set-up.

A set-up is often a DH table and the prior a URDF file from CAD, with other frames on the same bodies.  At the zero pose
both stand in the same place, so a body's frame in one description can be placed in the other; the inertias follow by a
change of frame.  What makes this right is checked: every joint axis must be the same line, with the same direction.
(Descriptions whose zero poses differ cannot be told apart from wrong ones by this, and are refused.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.identification.physics.reference import repaired, without_placeholder
from echelon.inertia.spatial import move
from echelon.logs.finding import Finding, Severity
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.placement import Placement
from echelon.mechanism.values import all_symbols, characteristic_length, placement_matrix, symbol_values

TOLERANCE = 1e-3
"""How far apart joint axes may be, m and rad; files round both."""
_ACROSS = 0.1
"""Sine of the least angle between axes that show where the base stands."""


@dataclass(frozen=True, repr=False)
class Prior:
    """What another description says of the standard parameters.

    Attributes
    ----------
    name : str
        Of the description.
    values : array of shape (p,)
        Standard parameters in the set-up's frames, SI units; nan where it says nothing.
    findings : tuple of Finding
        What is missing, was repaired, or was taken as fixed.
    """

    name: str
    values: Floats
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        known = int(np.isfinite(self.values).sum())
        return f"Prior({self.name}: {known} of {len(self.values)} standard parameters)"


def prior_from(base: BaseModel, other: Mechanism, *, tolerance: float = TOLERANCE) -> Prior:
    """Standard parameters of a set-up as another description of the robot states them.

    Bodies are matched by the names of their joints where all of the set-up's are there, else in order.  Bodies that
    are fixed to others count as part of them, as in :func:`echelon.load`, and so do bodies on joints that only the
    other description has, at their zero position.  Base frames may stand in different places but must have parallel
    axes, because gravity is given in them.

    Parameters
    ----------
    base : BaseModel
    other : Mechanism
    tolerance : float
        How far apart joint axes may be, m and rad.

    Returns
    -------
    Prior

    Raises
    ------
    InputError
        If there are too few joints, or a joint's axis is elsewhere or of another kind; names the joint.

    Examples
    --------
    >>> import echelon as ec
    >>> base = ec.base_parameters(ec.load("examples/panda.yaml"))
    >>> prior_from(base, base.mechanism)
    Prior(panda: 0 of 70 standard parameters)
    """
    mechanism = base.mechanism
    pairs = _matched(mechanism, other)
    ours, theirs = _Posed.of(mechanism), _Posed.of(other)
    theirs = theirs.shifted(_offset(ours, theirs, pairs))
    for mine, yours in pairs.items():
        _compare(ours, theirs, mine, yours, tolerance)
    totals = _lumped(other, theirs, set(pairs.values()))
    values = np.full(len(mechanism.columns), np.nan)
    findings = _locked(other, set(pairs.values()))
    for body in mechanism.carriers:
        carried, first = mechanism.bodies[body].carried, mechanism.first_column[body]
        sharing = [k for k in mechanism.sharing[body] if k in pairs and np.any(totals.get(pairs[k], 0.0))]
        if sharing:
            # bodies that share their parameters get the mean of what is stated, which is a body, too
            own = np.mean([move(totals[pairs[k]], np.linalg.inv(ours.frames[k])) for k in sharing], axis=0)
            moved, found = _mended(own, mechanism, body)
            values[first : first + len(carried)] = moved[list(carried)]
            findings += found
        elif len(carried) == PER_BODY:
            text = f"{other.name} states no inertia for it; it is drawn towards a plain shape only"
            findings.append(Finding(Severity.NOTE, "no prior", f"body '{mechanism.bodies[body].name}'", text))
    stated = {(effect.parameter, effect.unit): effect.value for effect in other.effects}
    for column, effect in enumerate(mechanism.effects, len(values) - len(mechanism.effects)):
        known = stated.get((effect.parameter, effect.unit))
        values[column] = np.nan if known is None else known
    return Prior(other.name, values, tuple(findings))


def _mended(values: Floats, mechanism: Mechanism, body: int) -> tuple[Floats, list[Finding]]:
    """The body as one that can exist, of a size that it can have, and what had to be changed for that."""
    if len(mechanism.bodies[body].carried) < PER_BODY:
        return values, []
    size, name, findings = characteristic_length(mechanism), mechanism.bodies[body].name, []
    for mend in (repaired, without_placeholder):
        values, finding = mend(values, size, name)
        findings += [finding] if finding else []
    return values, findings


@dataclass(frozen=True)
class _Axis:
    """An elementary motion at the zero pose: its frame, and what it is."""

    frame: Floats
    motion: Motion

    @property
    def direction(self) -> Floats:
        return np.asarray(self.frame[:3, self.motion.axis] * self.motion.sign)

    @property
    def fixed(self) -> Floats:
        """Projection onto the directions in which the frame's origin matters, shape (3, 3)."""
        if self.motion.kind is MotionKind.TRANSLATION:
            return np.zeros((3, 3))
        if self.motion.kind is MotionKind.BALL:
            return np.eye(3)
        return np.eye(3) - np.outer(self.direction, self.direction)


@dataclass(frozen=True)
class _Posed:
    """A mechanism at its zero pose: body frames in the base, and the axes of every body's joint."""

    mechanism: Mechanism
    frames: tuple[Floats, ...]
    axes: tuple[tuple[_Axis, ...], ...]

    @staticmethod
    def of(mechanism: Mechanism) -> _Posed:
        symbols = symbol_values(mechanism, sorted(_used(mechanism)))
        frames: list[Floats] = []
        axes = []
        for body in mechanism.bodies:
            frame = np.eye(4) if body.parent == GROUND else frames[body.parent]
            found = []
            for step in body.joint.steps:
                if isinstance(step, Placement):
                    frame = frame @ placement_matrix(step, symbols)
                else:
                    found.append(_Axis(frame, step))
            frames.append(frame)
            axes.append(tuple(found))
        return _Posed(mechanism, tuple(frames), tuple(axes))

    def shifted(self, offset: Floats) -> _Posed:
        """The same with the base moved."""
        shift = np.eye(4)
        shift[:3, 3] = offset
        axes = tuple(tuple(replace(axis, frame=shift @ axis.frame) for axis in some) for some in self.axes)
        return _Posed(self.mechanism, tuple(shift @ frame for frame in self.frames), axes)


def _used(mechanism: Mechanism) -> set[str]:
    needed = {name for body in mechanism.bodies for name in body.joint.symbols()}
    return needed & all_symbols(mechanism)


def _matched(mechanism: Mechanism, other: Mechanism) -> dict[int, int]:
    """Bodies that correspond: moving ones by joint name or in order, fixed ones by name."""
    mine, yours = _moving(mechanism), _moving(other)
    names = {other.bodies[k].joint.name: k for k in yours}
    if all(mechanism.bodies[k].joint.name in names for k in mine):
        pairs = {k: names[mechanism.bodies[k].joint.name] for k in mine}
    elif len(yours) < len(mine):
        problem = f"the prior {other.name} has {len(yours)} moving bodies, the set-up {len(mine)}: not the same robot"
        raise InputError(problem)
    else:
        pairs = dict(zip(mine, yours, strict=False))
    fixed = {body.name: k for k, body in enumerate(other.bodies) if body.joint.is_fixed}
    for k, body in enumerate(mechanism.bodies):
        if body.joint.is_fixed and body.name in fixed:
            pairs[k] = fixed[body.name]
    return pairs


def _moving(mechanism: Mechanism) -> list[int]:
    """Bodies on joints; rotors, which carry a part of their inertia only, are not among them."""
    return [k for k, body in enumerate(mechanism.bodies) if body.joint.motions and len(body.carried) in (0, PER_BODY)]


def _offset(ours: _Posed, theirs: _Posed, pairs: Mapping[int, int]) -> Floats:
    """How far the other base stands off, as axes show it one after another, so that the first wrong one is named."""
    offset, unknown = np.zeros(3), np.eye(3)
    for mine, yours in pairs.items():
        for a, b in zip(ours.axes[mine], theirs.axes[yours], strict=False):
            gap = a.fixed @ (a.frame[:3, 3] - b.frame[:3, 3] - offset)
            _, sizes, directions = np.linalg.svd(a.fixed @ unknown)
            seen = directions[sizes > _ACROSS]
            step, *_ = np.linalg.lstsq(a.fixed @ seen.T, gap, rcond=None)
            offset = offset + seen.T @ step
            unknown = unknown - seen.T @ seen
    return offset


def _compare(ours: _Posed, theirs: _Posed, mine: int, yours: int, tolerance: float) -> None:
    names = [posed.mechanism.bodies[k].joint.name for posed, k in ((ours, mine), (theirs, yours))]
    where = f"joint '{names[0]}' of the set-up and '{names[1]}' of the prior"
    first, second = ours.axes[mine], theirs.axes[yours]
    kinds = [[axis.motion.kind.value for axis in axes] for axes in (first, second)]
    if kinds[0] != kinds[1]:
        one, two = ("-".join(k) or "fixed" for k in kinds)
        raise InputError(f"one is a {one}, the other a {two}", element=where)
    for a, b in zip(first, second, strict=True):
        if a.motion.kind is MotionKind.BALL:
            apart = float(np.linalg.norm(a.frame[:3, :3] - b.frame[:3, :3]))
        else:
            apart = float(np.linalg.norm(a.direction - b.direction))
        if apart > tolerance:
            angle = np.degrees(2 * np.arcsin(min(1.0, apart / 2)))
            problem = f"their axes are {angle:.4g}° apart at the zero pose; the descriptions must have the same zero "
            raise InputError(problem + "pose, directions of joints and axes of the base", element=where)
        distance = float(np.linalg.norm(a.fixed @ (a.frame[:3, 3] - b.frame[:3, 3])))
        if distance > tolerance:
            raise InputError(f"their axes are {distance:.4g} m apart at the zero pose", element=where)


def _lumped(other: Mechanism, posed: _Posed, hosts: set[int]) -> dict[int, Floats]:
    """For every host the parameters of itself and all that is taken as fixed to it, in the base frame."""
    totals: dict[int, Floats] = {}
    for k, body in enumerate(other.bodies):
        host = _host(other, k, hosts)
        if host == GROUND or body.inertial is None:
            continue
        inertial = np.array(body.inertial)
        if body.carried and len(body.carried) < PER_BODY:
            inertial[[i for i in range(PER_BODY) if i not in body.carried]] = 0.0
        moved = move(inertial, posed.frames[k])
        totals[host] = totals[host] + moved if host in totals else moved
    return totals


def _host(other: Mechanism, body: int, hosts: set[int]) -> int:
    while body != GROUND and body not in hosts:
        body = other.bodies[body].parent
    return body


def _locked(other: Mechanism, hosts: set[int]) -> list[Finding]:
    findings = []
    for k in _moving(other):
        if k not in hosts and _host(other, k, hosts) != GROUND:
            body = other.bodies[k]
            text = f"the set-up has no such joint; body '{body.name}' counts as fixed at its zero position"
            findings.append(Finding(Severity.NOTE, "locked joint", f"joint '{body.joint.name}' of {other.name}", text))
    return findings
