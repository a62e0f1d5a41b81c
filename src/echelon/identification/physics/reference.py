"""Reference bodies: what estimates are measured against, and drawn to where data are silent.

A reference is the prior where one is given.  Priors from files are not always bodies: links without inertia, masses at
a point, tensors that break the triangle inequality.  They are repaired by raising the eigenvalues of the
pseudo-inertia, measured in the size of the body, to a least value; that is the nearest body in this measure.
Placeholders in files, such as 0.05 kg·m² for a flange of 0.3 kg, would need bodies wider than the longest link: mass
and centre of mass are kept, the extent becomes that of a plain body.  Where there is no prior, a reference is a body of
a plain shape: all bodies have one size and a common mass, with which they explain the data best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.identification.physics.constraints import Roles
from echelon.identification.physics.pseudo_inertia import unwhitening
from echelon.inertia.spatial import from_pseudo_inertia, pseudo_inertia
from echelon.logs.finding import Finding, Severity
from echelon.mechanism.values import characteristic_length

LEAST = 1e-4
"""Least eigenvalue of a repaired pseudo-inertia relative to that of a body of its mass and size."""
_SHARE = 1e-2
_RADIUS = 0.25
"""Radius of gyration along each axis of a plain body relative to the size of the mechanism."""
_WIDEST = 1.25
"""Radius of gyration along an axis, relative to the size of the mechanism, beyond which inertia is a placeholder."""


@dataclass(frozen=True)
class Reference:
    """A body for every pseudo-inertia, and values for the other parameters.

    Attributes
    ----------
    bodies : array of shape (b, 10)
        Each one can exist.
    informed : array of bool of shape (b,)
        Whether it is the prior's, not a plain shape.
    values : array of shape (p,)
        For parameters outside the pseudo-inertias, nan where nothing is known; unused elsewhere.
    findings : tuple of Finding
        Which bodies of the prior had to be repaired.
    """

    bodies: Floats
    informed: npt.NDArray[np.bool_]
    values: Floats
    findings: tuple[Finding, ...]


def reference(role: Roles, prior: npt.ArrayLike | None, mass: float = 1.0) -> Reference:
    """Reference bodies from a prior, completed by plain shapes.

    Parameters
    ----------
    role : Roles
    prior : array of shape (p,), optional
        Standard parameters, SI units; nan where unknown.  A body with any unknown value counts as unknown.
    mass : float
        Of plain bodies, kg.

    Raises
    ------
    InputError
        If the prior has a wrong shape or is infinite.
    """
    values = np.full(role.size, np.nan) if prior is None else np.asarray(prior, dtype=float).copy()
    if values.shape != (role.size,) or np.isinf(values).any():
        raise InputError(f"expected a prior of {role.size} standard parameters, got an array of shape {values.shape}")
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
        findings += [finding] if finding else []
    return Reference(np.array(bodies).reshape(-1, PER_BODY), np.array(informed, dtype=bool), values, tuple(findings))


def plain_body(mass: float, size: float) -> Floats:
    """A body of a plain shape: mass in a cloud about the origin, equal along all axes; shape (10,)."""
    second = mass * (_RADIUS * size) ** 2
    return np.array([2 * second, 0, 0, 2 * second, 0, 2 * second, 0, 0, 0, mass])


def repaired(body: Floats, size: float, name: str) -> tuple[Floats, Finding | None]:
    """The nearest body that can exist, and a finding if the given one cannot.

    Parameters
    ----------
    body : array of shape (10,)
    size : float
        Size of the mechanism, m.
    name : str
        For the finding.

    Returns
    -------
    array of shape (10,)
    Finding, optional
    """
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
    return np.asarray(fixed), Finding(Severity.WARNING, "unphysical prior", f"body '{name}'", text)


def without_placeholder(body: Floats, size: float, name: str) -> tuple[Floats, Finding | None]:
    """A body of a file, with an extent that it can have where the file's inertia is a placeholder.

    Arguments and results are those of :func:`repaired`.
    """
    width = _widest(body)
    if width <= _WIDEST * size:
        return body, None
    text = f"the prior's inertia needs a radius of gyration of {width:.2g} m, with links of {size:.2g} m at most; its "
    text += "mass and centre are kept, its extent is taken to be that of a plain body"
    finding = Finding(Severity.WARNING, "implausible prior", f"body '{name}'", text)
    return _shrunk(body, _RADIUS * size / width), finding


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
    mass = body[9] if body[9] > 0 else max(float(np.abs(body[:6]).max()) / size**2, 1e-9)
    moment = float(np.abs(body[[0, 3, 5]]).sum()) / 2
    length = float(np.sqrt(moment / mass)) if moment > 0 else 1e-2 * size
    return np.diag(np.sqrt(mass) * np.array([length, length, length, 1.0]))


def common_mass(role: Roles, design: Floats, target: Floats) -> float:
    """The mass with which plain bodies, all alike, explain data best; 1 kg where data are zero.

    Parameters
    ----------
    role : Roles
    design : array of shape (k, p)
        Rows over the standard parameters.
    target : array of shape (k,)
    """
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
    least = _SHARE * float(np.linalg.norm(target)) / scale[0]
    return max(found, least) if least > 0 else 1.0


def unwhitenings(bodies: Floats, roots: Floats) -> Floats:
    """For every body the map from the ten parameters of K to those of J, shape (b, 10, 10)."""
    return np.array([unwhitening(root) for root in roots]).reshape(len(bodies), PER_BODY, PER_BODY)
