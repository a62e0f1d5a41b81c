"""Prior information: reference bodies, and the inertias that another description of the robot states.

Reference bodies are what estimates are measured against, and drawn to where data are silent: the prior where one is
given.  Priors from files are not always bodies: links without inertia, masses at a point, tensors that break the
triangle inequality.  They are repaired by raising the eigenvalues of the pseudo-inertia, measured in the size of the
body, to a least value; that is the nearest body in this measure.  Placeholders in files, such as 0.05 kg·m² for a
flange of 0.3 kg, would need bodies wider than the longest link: mass and centre of mass are kept, the extent becomes
that of a plain body.  Where there is no prior, a reference is a body of a plain shape: all bodies have one size and a
common mass, with which they explain the data best.

A set-up is often a DH table and the prior a URDF file from CAD, with other frames on the same bodies.  At the zero pose
the axes of one lie over those of the other (:mod:`echelon.base.kinematic_match`), so a body's frame in one description
can be placed in the other; the inertias follow by a change of frame.  Every joint axis must be the same line, with the
same direction.  (Descriptions whose zero poses differ cannot be told apart from wrong ones by this, and are refused.)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel, Correspondence, bare_tree, correspondences
from echelon.identification.logs.finding import Finding, note, warning
from echelon.identification.physics.bounds import Roles
from echelon.robot import (
    GROUND,
    Mechanism,
    characteristic_length,
    from_pseudo_inertia,
    lock_joints,
    move,
    pseudo_inertia,
    warn_of_impossible,
)
from echelon.shared import PER_BODY, Floats, InputError

LEAST = 1e-4
"""Least eigenvalue of a repaired pseudo-inertia relative to that of a body of its mass and size: a plate of a hundredth
of its width, which is thinner than links are."""

LEAST_MASS = 1e-2
"""Share of the outputs that the weight of plain bodies explains at least: less is a mass of the wrong order."""

RADIUS = 0.25  # radius of gyration along each axis of a plain body relative to the size of the mechanism, as of a rod

WIDEST = 1.25
"""Radius of gyration along an axis, relative to the size of the mechanism, beyond which inertia is a placeholder."""


@dataclass(frozen=True)
class Reference:
    """A body for every pseudo-inertia, and values for the other parameters."""

    bodies: Floats  # shape (b, 10); each one can exist
    # shape (b,); whether it is the prior's, not a plain shape
    informed: npt.NDArray[np.bool_]
    values: Floats  # shape (p,); for parameters outside the pseudo-inertias, nan where nothing is known
    findings: tuple[Finding, ...]  # which bodies of the prior had to be repaired


def reference(role: Roles, prior: npt.ArrayLike | None, mass: float = 1.0) -> Reference:
    """Reference bodies from a prior, completed by plain shapes."""
    values = (
        np.full(role.size, np.nan)
        if prior is None
        else np.asarray(prior, dtype=float).copy()
    )
    if values.shape != (role.size,) or np.isinf(values).any():
        raise InputError(
            f"expected a prior of {role.size} standard parameters, got an array of shape {values.shape}"
        )
    size = characteristic_length(role.mechanism)
    plain = plain_body(mass, size)
    bodies, informed, findings = [], [], []
    for (name, _), body in zip(role.bodies, role.blocks(values), strict=True):
        known = bool(np.isfinite(body).all() and np.any(body))
        informed.append(known)
        if not known:
            bodies.append(plain)
            continue
        fixed, finding = repaired(body, size, name)
        bodies.append(fixed)
        if finding:
            findings.append(finding)
    return Reference(
        np.array(bodies).reshape(-1, PER_BODY),
        np.array(informed, dtype=bool),
        values,
        tuple(findings),
    )


def plain_body(mass: float, size: float) -> Floats:
    """A body of a plain shape: mass in a cloud about the origin, equal along all axes; shape (10,)."""
    second = mass * (RADIUS * size) ** 2
    return np.array([2 * second, 0, 0, 2 * second, 0, 2 * second, 0, 0, 0, mass])


def repaired(body: Floats, size: float, name: str) -> tuple[Floats, Finding | None]:
    """The nearest body that can exist, and a finding if the given one cannot; shape (10,)."""
    root = _scale(body, size)
    inverse = np.diag(1 / np.diagonal(root))
    values, vectors = np.linalg.eigh(inverse @ pseudo_inertia(body) @ inverse)
    if values[0] >= LEAST * 1e-3:
        return body, None
    raised = np.maximum(values, LEAST)
    fixed = from_pseudo_inertia(root @ (vectors * raised) @ vectors.T @ root)
    why = "has no extent" if values[0] > -1e-9 else "cannot exist"
    text = f"the prior's body {why} (a pseudo-inertia with eigenvalue {values[0]:.2g} in its own scale); "
    text += "it is replaced by the nearest body that can exist"
    return np.asarray(fixed), warning("unphysical prior", f"body '{name}'", text)


def without_placeholder(
    body: Floats, size: float, name: str
) -> tuple[Floats, Finding | None]:
    """A body of a file, with an extent that it can have where the file's inertia is a placeholder.

    Arguments and results are those of :func:`repaired`.
    """
    width = _widest(body)
    if width <= WIDEST * size:
        return body, None
    text = f"the prior's inertia needs a radius of gyration of {width:.2g} m, with links of {size:.2g} m at most; its "
    text += "mass and centre are kept, a plain body replaces its extent"
    finding = warning("implausible prior", f"body '{name}'", text)
    return _shrunk(body, RADIUS * size / width), finding


def _widest(body: Floats) -> float:
    """Largest radius of gyration along an axis through the centre of mass, m; 0 without mass."""
    mass = body[9]
    if mass <= 0:
        return 0.0
    centre = body[6:9] / mass
    second = pseudo_inertia(body)[:3, :3] / mass - np.outer(centre, centre)
    return float(np.sqrt(max(np.linalg.eigvalsh(second)[-1], 0.0)))


def _shrunk(body: Floats, factor: float) -> Floats:
    """The body with its distances from the centre of mass multiplied by a factor."""
    pseudo = pseudo_inertia(body)
    carried = np.outer(body[6:9], body[6:9]) / body[9]
    pseudo[:3, :3] = carried + factor**2 * (pseudo[:3, :3] - carried)
    return np.asarray(from_pseudo_inertia(pseudo))


def _scale(body: Floats, size: float) -> Floats:
    """A diagonal factor in whose square a body of this mass and size is about the identity, shape (4, 4)."""
    mass = (
        body[9] if body[9] > 0 else max(float(np.abs(body[:6]).max()) / size**2, 1e-9)
    )
    moment = float(np.abs(body[[0, 3, 5]]).sum()) / 2
    length = float(np.sqrt(moment / mass)) if moment > 0 else 1e-2 * size
    return np.diag(np.sqrt(mass) * np.array([length, length, length, 1.0]))


def common_mass(role: Roles, design: Floats, target: Floats) -> float:
    """The mass with which plain bodies, all alike, explain data best; 1 kg where data are zero."""
    if not role.bodies:
        return 1.0
    unit = np.zeros(role.size)
    shape = plain_body(1.0, characteristic_length(role.mechanism))
    for start in role.starts:
        unit[start : start + PER_BODY] = shape
    others = [*role.positive, *role.free]
    columns = np.column_stack([design @ unit, design[:, others]])
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    found = float(np.linalg.lstsq(columns / scale, target, rcond=None)[0][0] / scale[0])
    # where no positive mass explains the data, one that makes them as large is still of the right size
    least = LEAST_MASS * float(np.linalg.norm(target)) / scale[0]
    return max(found, least) if least > 0 else 1.0


APART = 1e-3  # distance of joint axes that are the same, m and rad at most: files round both


@dataclass(frozen=True, repr=False)
class Prior:
    """Standard parameters as another description states them."""

    name: str  # of the description
    values: Floats  # shape (p,); standard parameters in the set-up's frames, SI units; nan where it says nothing
    # what is missing, was repaired, or was taken as fixed
    findings: tuple[Finding, ...]

    def base_values(
        self, base: BaseModel, symbols: Mapping[str, float] | None = None
    ) -> Floats | None:
        """Base parameters, shape (r,); unknown friction counts as none, unknown bodies make it useless.

        ``symbols`` are values of those that the model's file does not state.
        """
        inertial = [column.body is not None for column in base.mechanism.columns]
        if np.isnan(self.values[inertial]).any():
            return None
        return base.values(np.nan_to_num(self.values), symbols)

    def __repr__(self) -> str:
        known = int(np.isfinite(self.values).sum())
        return f"Prior({self.name}: {known} of {len(self.values)} standard parameters)"


def known_before(base: BaseModel, other: Mechanism | None) -> Prior | None:
    """Prior values of the standard parameters: from another description, or else those of the robot's own."""
    if other is not None:
        return prior_from(base, other)
    stated = np.array(
        [
            np.nan if value is None else value
            for value in base.mechanism.standard_values()
        ]
    )
    return None if np.isnan(stated).all() else Prior(base.mechanism.name, stated, ())


def prior_from(base: BaseModel, other: Mechanism) -> Prior:
    """Standard parameters of a set-up as another description of the robot states them.

    Joints are matched by their names where all of the set-up's are there, else in order.  Bodies that are fixed to
    others count as part of them, as in :func:`echelon.load`, and so do bodies on joints that only the other description
    has, at their zero position.  Base frames may stand anywhere.
    """
    mechanism = base.mechanism
    found = _laid_over(mechanism, other)
    _check_axes(found)
    pairs = _body_pairs(found)
    ours = found.first
    totals = _lumped(other, found.second.frames, set(pairs.values()))
    values = np.full(len(mechanism.columns), np.nan)
    findings = _locked(other, set(pairs.values()))
    for body in mechanism.carriers:
        carried, first = mechanism.bodies[body].carried, mechanism.first_column[body]
        sharing = [
            k
            for k in mechanism.sharing[body]
            if k in pairs and np.any(totals.get(pairs[k], 0.0))
        ]
        if sharing:
            # bodies that share their parameters get the mean of what is stated, which is a body, too
            frames = {k: found.moves[ours.node[k]] @ ours.frames[k] for k in sharing}
            each = [move(totals[pairs[k]], np.linalg.inv(frames[k])) for k in sharing]
            own, mended = _mended(np.mean(each, axis=0), mechanism, body)
            values[first : first + len(carried)] = own[list(carried)]
            findings += mended
        elif len(carried) == PER_BODY:
            text = f"{other.name} states no inertia for it; it is drawn towards a plain shape only"
            findings.append(
                note("no prior", f"body '{mechanism.bodies[body].name}'", text)
            )
    stated = {(effect.parameter, effect.unit): effect.value for effect in other.effects}
    for column, effect in enumerate(
        mechanism.effects, len(values) - len(mechanism.effects)
    ):
        known = stated.get((effect.parameter, effect.unit))
        values[column] = np.nan if known is None else known
    return Prior(other.name, values, tuple(findings))


def _mended(
    values: Floats, mechanism: Mechanism, body: int
) -> tuple[Floats, list[Finding]]:
    """The body as one that can exist, of a size that it can have, and what had to be changed for that."""
    if len(mechanism.bodies[body].carried) < PER_BODY:
        return values, []
    size = characteristic_length(mechanism)
    name = mechanism.bodies[body].name
    findings = []
    for mend in (repaired, without_placeholder):
        values, finding = mend(values, size, name)
        if finding:
            findings.append(finding)
    return values, findings


def _laid_over(mechanism: Mechanism, other: Mechanism) -> Correspondence:
    """The axes of both at the zero pose, without joints that only the other description has."""
    mine, yours = _moving(mechanism), _moving(other)
    if len(yours) < len(mine):
        problem = f"the prior {other.name} has {len(yours)} moving bodies, the set-up {len(mine)}: not the same robot"
        raise InputError(problem)
    names = {mechanism.bodies[k].joint.name for k in mine}
    named = [k for k in yours if other.bodies[k].joint.name in names]
    kept = named if len(named) == len(mine) else yours[: len(mine)]
    trees = _only(mechanism, mine), _only(other, kept)
    anywhere = np.zeros(3), np.zeros(3)
    return correspondences(*trees, APART, APART, anywhere, same_positions=True)[0]


def _only(mechanism: Mechanism, moving: Collection[int]) -> Mechanism:
    """The tree in which only the joints of some bodies move, the others at zero."""
    held = {
        motion.name: 0.0
        for k, body in enumerate(mechanism.bodies)
        if k not in moving
        for motion in body.joint.motions
    }
    return lock_joints(bare_tree(mechanism), held)


def _body_pairs(found: Correspondence) -> dict[int, int]:
    """Bodies that correspond: moving ones by their joints, fixed ones by name."""
    one, two = found.first, found.second
    pairs = {one.bodies[i]: two.bodies[j] for i, j in found.pairs}
    for mine, yours in pairs.items():
        joints = one.mechanism.bodies[mine].joint, two.mechanism.bodies[yours].joint
        kinds = ["-".join(m.kind.value for m in joint.motions) for joint in joints]
        if kinds[0] != kinds[1]:
            problem = f"one is a {kinds[0]}, the other a {kinds[1]}"
            raise InputError(problem, element=_where(joints[0].name, joints[1].name))
    fixed = {b.name: k for k, b in enumerate(two.mechanism.bodies) if b.joint.is_fixed}
    for k, body in enumerate(one.mechanism.bodies):
        if body.joint.is_fixed and body.name in fixed:
            pairs[k] = fixed[body.name]
    return pairs


def _check_axes(found: Correspondence) -> None:
    """Refuse joints that are not the same at the zero pose, and name the first."""
    if not found.differences:
        return
    first = found.differences[0]
    size = f"{first.size:.4g} {first.unit}"
    if first.unit == "rad":
        size = f"{np.degrees(first.size):.4g}°"
    problem = f"the {first.kind} differs by {size}; the descriptions must have the same axes, zero pose and directions of "
    problem += "joints"
    theirs = {ours: theirs for theirs, ours in found.names.items()}[first.joint]
    raise InputError(problem, element=_where(first.joint, theirs))


def _where(ours: str, theirs: str) -> str:
    return f"joint '{ours}' of the set-up and '{theirs}' of the prior"


def _moving(mechanism: Mechanism) -> list[int]:
    """Bodies on joints; rotors, which carry a part of their inertia only, are not among them."""
    return [
        k
        for k, body in enumerate(mechanism.bodies)
        if body.joint.motions and len(body.carried) in (0, PER_BODY)
    ]


def _lumped(other: Mechanism, frames: Floats, hosts: set[int]) -> dict[int, Floats]:
    """For every host the parameters of itself and all that is taken as fixed to it, in the base frame."""
    totals: dict[int, Floats] = {}
    warn_of_impossible(
        [
            body
            for k, body in enumerate(other.bodies)
            if _host(other, k, hosts) != GROUND
        ]
    )
    for k, body in enumerate(other.bodies):
        host = _host(other, k, hosts)
        if host == GROUND or body.inertial is None:
            continue
        inertial = np.array(body.inertial)
        if body.carried and len(body.carried) < PER_BODY:
            inertial[[i for i in range(PER_BODY) if i not in body.carried]] = 0.0
        moved = move(inertial, frames[k])
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
            findings.append(
                note("locked joint", f"joint '{body.joint.name}' of {other.name}", text)
            )
    return findings
