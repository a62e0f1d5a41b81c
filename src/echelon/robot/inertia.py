"""The ten standard parameters of a body as matrices and about another frame; which bodies can exist, and how far apart.

The pseudo-inertia J = ∫ [x; 1] [x; 1]ᵀ dm is a linear bijection of the ten parameters (Wensing, Kim & Slotine, "Linear
matrix inequalities for physically consistent inertial parameter identification", 2018).  A change of frame is a
congruence, J' = H J Hᵀ with the homogeneous H, so one short function serves floats and exact numbers alike.  A rigid
body has a density of mass that is not negative, so J is positive semidefinite, and every J ≻ 0 belongs to some density:
constraints on bodies are linear matrix inequalities.  The Bregman divergence of −log det (Lee, Wensing & Park 2020)
compares bodies independently of units and frames: it sees only the eigenvalues of J J₀⁻¹.

Other programs' conventions are one table.  Linear ones are other orders of the same ten numbers; regressor columns
follow them.  The others state the mass, its centre, and the inertia about that centre, which no regressor is linear in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.shared import PER_BODY, Floats, InputError, public

Array = npt.NDArray[Any]

UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Places of XX XY XZ YY YZ ZZ in the inertia tensor."""


def parameter_array(values: npt.ArrayLike) -> Floats:
    """Values as an array of floats with ten parameters in the last axis."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 0 or array.shape[-1] != PER_BODY:
        raise InputError(
            f"expected {PER_BODY} parameters per body in the last axis, got shape {array.shape}"
        )
    return array


def tensor_and_moment(values: Array) -> tuple[Array, Array, Array]:
    """Inertia tensor (..., 3, 3), first moments (..., 3) and mass (...) of standard parameters (..., 10)."""
    tensor = np.zeros((*values.shape[:-1], 3, 3), dtype=values.dtype)
    for k, (i, j) in enumerate(UPPER):
        tensor[..., i, j] = tensor[..., j, i] = values[..., k]
    return tensor, values[..., 6:9], values[..., 9]


def from_tensor(tensor: Array, moment: Array, mass: Array) -> Array:
    """Standard parameters (..., 10) of an inertia tensor about the frame's origin, first moments and mass."""
    return np.stack(
        [
            *(tensor[..., i, j] for i, j in UPPER),
            *(moment[..., k] for k in range(3)),
            np.asarray(mass),
        ],
        axis=-1,
    )


def pseudo_inertia(values: Array) -> Array:
    """Pseudo-inertia J = [[Σ, h], [hᵀ, m]] of standard parameters, with Σ = ½ tr(I) 1 − I."""
    # shapes: values (..., 10), floats or exact objects; returns (..., 4, 4)
    tensor, moment, mass = tensor_and_moment(values)
    half = Fraction(1, 2) if values.dtype == object else 0.5
    trace = (tensor[..., 0, 0] + tensor[..., 1, 1] + tensor[..., 2, 2]) * half
    pseudo = np.zeros((*values.shape[:-1], 4, 4), dtype=values.dtype)
    pseudo[..., :3, :3] = -tensor
    for k in range(3):
        pseudo[..., k, k] = trace - tensor[..., k, k]
    pseudo[..., :3, 3] = pseudo[..., 3, :3] = moment
    pseudo[..., 3, 3] = mass
    return pseudo


def from_pseudo_inertia(pseudo: Array) -> Array:
    """Standard parameters (..., 10) of a pseudo-inertia (..., 4, 4)."""
    second = pseudo[..., :3, :3]
    trace = second[..., 0, 0] + second[..., 1, 1] + second[..., 2, 2]
    tensor = -second
    for k in range(3):
        tensor[..., k, k] = trace - second[..., k, k]
    return from_tensor(tensor, pseudo[..., :3, 3], pseudo[..., 3, 3])


def spatial_inertia(values: npt.ArrayLike) -> Floats:
    """Featherstone's spatial inertia of standard parameters, as in spatial_v2: [[I, h×], [(h×)ᵀ, m 1]]."""
    # shapes: values (..., 10); returns (..., 6, 6)
    tensor, moment, mass = tensor_and_moment(parameter_array(values))
    spatial = np.zeros((*mass.shape, 6, 6))
    spatial[..., :3, :3] = tensor
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        spatial[..., i, 3 + j] = spatial[..., 3 + j, i] = -moment[..., k]
        spatial[..., j, 3 + i] = spatial[..., 3 + i, j] = moment[..., k]
        spatial[..., 3 + i, 3 + i] = mass
    return spatial


def from_spatial_inertia(spatial: npt.ArrayLike) -> Floats:
    """Standard parameters (..., 10) of a spatial inertia (..., 6, 6), angular part first."""
    array = np.asarray(spatial, dtype=float)
    moment = np.stack([array[..., 2, 4], array[..., 0, 5], array[..., 1, 3]], axis=-1)
    return from_tensor(array[..., :3, :3], moment, array[..., 3, 3])


def move(values: Array, homogeneous: Array) -> Array:
    """Parameters of the same body about the frame in which its own frame is placed: x_new = R x + t, m."""
    # shapes: values (..., 10); homogeneous (4, 4); returns (..., 10)
    return from_pseudo_inertia(homogeneous @ pseudo_inertia(values) @ homogeneous.T)


def frame_change(homogeneous: Array) -> Array:
    """The matrix T of :func:`move`: new parameters = T · parameters.  Shapes: homogeneous (4, 4); returns (10, 10)."""
    units = np.eye(PER_BODY, dtype=int).astype(homogeneous.dtype)
    return move(units, homogeneous).T


SIZE = 4
"""Rows of a pseudo-inertia."""


def divergence(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Bregman divergence of −log det: tr(J J₀⁻¹) − log det(J J₀⁻¹) − 4.

    Zero for equal bodies, infinite where J is not positive definite; convex in ``values``, the same in all frames.
    """
    whitened = whiten(values, factor(reference))
    eigenvalues = np.linalg.eigvalsh(whitened)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = np.where(eigenvalues > 0, eigenvalues - np.log(eigenvalues) - 1, np.inf)
    return np.asarray(np.maximum(parts.sum(axis=-1), 0.0))


def factor(values: npt.ArrayLike) -> Floats:
    """Lower triangle L with J = L Lᵀ, shape (..., 4, 4), in the body frame's units (m√kg, √kg)."""
    array = parameter_array(values)
    # masses and lengths of any size: Cholesky of the matrix with ones on its diagonal decides relatively
    matrices = pseudo_inertia(array)
    diagonal = np.diagonal(matrices, axis1=-2, axis2=-1)
    if not (np.isfinite(array).all() and (diagonal > 0).all()):
        raise InputError(
            "a pseudo-inertia is not positive definite: no body has these inertial parameters"
        )
    scale: Floats = np.sqrt(diagonal)
    try:
        unit = np.linalg.cholesky(
            matrices / (scale[..., :, None] * scale[..., None, :])
        )
    except np.linalg.LinAlgError:
        raise InputError(
            "a pseudo-inertia is not positive definite: no body has these inertial parameters"
        ) from None
    return np.asarray(scale[..., :, None] * unit, dtype=np.float64)


def whiten(values: npt.ArrayLike, root: Floats) -> Floats:
    """K = L⁻¹ J L⁻ᵀ, shape (..., 4, 4): the identity for the reference body itself, without units."""
    half = np.linalg.solve(root, pseudo_inertia(parameter_array(values)))
    whitened = np.linalg.solve(root, np.swapaxes(half, -1, -2))
    return np.asarray((whitened + np.swapaxes(whitened, -1, -2)) / 2, dtype=np.float64)


def margins(values: npt.ArrayLike, reference: npt.ArrayLike) -> Floats:
    """Smallest eigenvalue of each body's J relative to a reference body's, shape (...); not positive: cannot exist."""
    return np.asarray(
        np.linalg.eigvalsh(whiten(values, factor(reference)))[..., 0], dtype=np.float64
    )


_XX, _XY, _XZ, _YY, _YZ, _ZZ, _MX, _MY, _MZ, _M = range(PER_BODY)


@dataclass(frozen=True)
class Convention:
    """One way of writing the inertia of a body."""

    shape: tuple[int, ...]  # of one body's numbers
    read: Callable[
        [Floats], Floats
    ]  # to standard parameters: shape (..., *shape) to (..., 10)
    write: Callable[[Floats], Floats]  # back
    order: tuple[int, ...] | None = (
        None  # for a linear convention: which standard parameter stands at each place
    )
    needs_mass: bool = False  # whether it divides by the mass when written


def _ordered(*order: int) -> Convention:
    inverse = [order.index(k) for k in range(PER_BODY)]
    return Convention(
        (PER_BODY,), lambda v: v[..., inverse], lambda v: v[..., list(order)], order
    )


def _central(inertia: tuple[int, ...], *, about_centre: bool = True) -> Convention:
    """Mass, centre, then six moments in an order of XX … ZZ."""
    inverse = [4 + inertia.index(k) for k in range(6)]

    def read(values: Floats) -> Floats:
        mass, centre = values[..., 0], values[..., 1:4]
        moment = mass[..., None] * centre
        tensor, _, _ = tensor_and_moment(
            np.concatenate([values[..., inverse], moment, mass[..., None]], axis=-1)
        )
        return from_tensor(tensor + about_centre * _steiner(mass, centre), moment, mass)

    def write(values: Floats) -> Floats:
        tensor, centre, mass = _about_centre(values)
        moments = from_tensor(
            tensor if about_centre else tensor + _steiner(mass, centre), centre, mass
        )
        return np.concatenate(
            [mass[..., None], centre, moments[..., list(inertia)]], axis=-1
        )

    return Convention((PER_BODY,), read, write, needs_mass=True)


def _steiner(mass: Floats, centre: Floats) -> Floats:
    """Term of the parallel-axis theorem for a centre of mass, (..., 3, 3)."""
    square = (centre * centre).sum(axis=-1)[..., None, None] * np.eye(3)
    added: Floats = mass[..., None, None] * (
        square - centre[..., :, None] * centre[..., None, :]
    )
    return added


def _about_centre(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Inertia tensor about the centre of mass, centre of mass, and mass."""
    tensor, moment, mass = tensor_and_moment(values)
    centre = moment / mass[..., None]
    return tensor - _steiner(mass, centre), centre, mass


def _read_principal(values: Floats) -> Floats:
    mass = values[..., 0]
    centre = values[..., 1:4]
    quaternion = values[..., 4:8]
    moments = values[..., 8:11]
    axes = rotation_of(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True))
    tensor = axes @ (moments[..., :, None] * np.swapaxes(axes, -1, -2))
    return from_tensor(tensor + _steiner(mass, centre), mass[..., None] * centre, mass)


def _write_principal(values: Floats) -> Floats:
    tensor, centre, mass = _about_centre(values)
    moments, axes = np.linalg.eigh(tensor)
    moments, axes = (
        moments[..., ::-1],
        axes[..., ::-1].copy(),
    )  # largest first, as MuJoCo's compiler does
    axes[..., :, 2] *= np.linalg.det(axes)[..., None]
    return np.concatenate(
        [mass[..., None], centre, rotation_quaternion(axes), moments], axis=-1
    )


def rotation_of(quaternion: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions w, x, y, z (..., 4)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_quaternion(r: Floats) -> Floats:
    """Unit quaternion (w, x, y, z), w ≥ 0, as an eigenvector, which needs no case distinctions (Bar-Itzhack 2000)."""
    k = np.zeros((*r.shape[:-2], 4, 4))
    k[..., 0, 0] = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        k[..., 1 + a, 1 + a] = r[..., a, a] - r[..., b, b] - r[..., c, c]
        k[..., 1 + a, 1 + b] = k[..., 1 + b, 1 + a] = r[..., a, b] + r[..., b, a]
        k[..., 0, 1 + a] = k[..., 1 + a, 0] = r[..., c, b] - r[..., b, c]
    quaternion: Floats = np.linalg.eigh(k)[1][..., -1]
    return np.where(quaternion[..., :1] < 0, -quaternion, quaternion)


CONVENTIONS: dict[str, Convention] = {
    # about the body frame's origin
    "echelon": _ordered(_XX, _XY, _XZ, _YY, _YZ, _ZZ, _MX, _MY, _MZ, _M),
    "pinocchio": _ordered(_M, _MX, _MY, _MZ, _XX, _XY, _YY, _XZ, _YZ, _ZZ),
    "idyntree": _ordered(_M, _MX, _MY, _MZ, _XX, _XY, _XZ, _YY, _YZ, _ZZ),
    # rigidBody of the Robotics System Toolbox: Mass, CenterOfMass, Inertia [Ixx Iyy Izz Iyz Ixz Ixy] about the origin
    "matlab": _central((_XX, _YY, _ZZ, _YZ, _XZ, _XY), about_centre=False),
    "spatial_v2": Convention((6, 6), from_spatial_inertia, spatial_inertia),
    "pseudo_inertia": Convention((4, 4), from_pseudo_inertia, pseudo_inertia),
    # about the centre of mass, along the body frame's axes
    "urdf": _central((_XX, _XY, _XZ, _YY, _YZ, _ZZ)),
    "mujoco_full": _central((_XX, _YY, _ZZ, _XY, _XZ, _YZ)),
    # about the centre of mass, along the principal axes: mass, ipos, iquat (w x y z), inertia
    "mujoco": Convention((11,), _read_principal, _write_principal, needs_mass=True),
}


@public
def convert(values: npt.ArrayLike, source: str, target: str) -> Floats:
    """Inertial parameters of bodies in another program's convention.

    Conventions: ``echelon``, ``pinocchio``, ``idyntree`` (orders of the ten numbers about the frame's origin),
    ``matlab``, ``urdf``, ``mujoco_full`` (mass, centre, six moments), ``mujoco`` (mass, ipos, iquat, inertia),
    ``spatial_v2`` (6 × 6, angular part first), ``pseudo_inertia`` (4 × 4).  The frame stays the same.

    Parameters
    ----------
    values : array of shape (..., *shape of the source)
        SI units; ten numbers, or a matrix, per body.
    source, target : str
        Names of conventions.

    Returns
    -------
    array of shape (..., *shape of the target)

    Raises
    ------
    InputError
        For an unknown convention, another shape, or a centre of mass that is wanted of a body without mass.

    Examples
    --------
    >>> import echelon as ec
    >>> ec.convert([1, 0, 0, 2, 0, 3, 0.4, 0.5, 0.6, 7], "echelon", "pinocchio")
    array([7. , 0.4, 0.5, 0.6, 1. , 0. , 2. , 0. , 0. , 3. ])
    """
    start, end = convention(source), convention(target)
    array = np.asarray(values, dtype=float)
    if array.shape[array.ndim - len(start.shape) :] != start.shape:
        raise InputError(
            f"{source} has numbers of shape {start.shape} per body, got an array of shape {array.shape}"
        )
    standard = start.read(array)
    if end.needs_mass:
        _check_mass(standard, target)
    return end.write(standard)


def _check_mass(standard: Floats, target: str) -> None:
    masses = np.atleast_1d(standard[..., _M])
    bad = np.argwhere(~(masses > 0))
    if len(bad):
        place = tuple(int(k) for k in bad[0])
        problem = f"its mass is {masses[place]:g} kg; {target} states a centre of mass, which needs a positive mass"
        raise InputError(
            problem, element=f"body {place[0] if len(place) == 1 else place}"
        )


@public
def convert_columns(regressor: npt.ArrayLike, source: str, target: str) -> Floats:
    """Regressor columns in another program's order, so that X · parameters stays the same.

    Parameters
    ----------
    regressor : array of shape (..., 10 · bodies)
    source, target : str
        Linear conventions: ``echelon``, ``pinocchio``, ``idyntree``.

    Returns
    -------
    array of shape (..., 10 · bodies)

    Raises
    ------
    InputError
        If the columns are not ten per body, or a convention is not another order of the same numbers.
    """
    orders = []
    for name in (source, target):
        order = convention(name).order
        if order is None:
            valid = ", ".join(
                known for known, entry in CONVENTIONS.items() if entry.order
            )
            raise InputError(
                f"no regressor has columns in the convention '{name}' (valid: {valid})"
            )
        orders.append(order)
    array = np.asarray(regressor, dtype=float)
    if array.ndim == 0 or array.shape[-1] % PER_BODY:
        raise InputError(
            f"expected {PER_BODY} columns per body, got an array of shape {array.shape}"
        )
    blocks = array.reshape(*array.shape[:-1], -1, PER_BODY)
    # a permutation is orthogonal: its inverse transposed, which columns need, is itself
    permuted: Floats = blocks[..., [orders[0].index(k) for k in orders[1]]].reshape(
        array.shape
    )
    return permuted


def convention(name: str) -> Convention:
    """A convention by its name."""
    if name not in CONVENTIONS:
        raise InputError(
            f"unknown convention '{name}' (valid: {', '.join(CONVENTIONS)})"
        )
    return CONVENTIONS[name]


SOLVER_TOLERANCE = 1e-9
"""Share of its size that a solver of semidefinite programmes leaves of a zero."""
_PRODUCTS = {
    _XY: (0, 1),
    _XZ: (0, 2),
    _YZ: (1, 2),
    _MX: (0, 3),
    _MY: (1, 3),
    _MZ: (2, 3),
}
"""Places of products of inertia and first moments in the pseudo-inertia."""


def with_zeros(values: Floats) -> Floats:
    """Standard parameters of a fitted body, shape (10,), with zeros for what a solver has left of them.

    An entry of a pseudo-inertia is at most the root of the product of its two diagonal entries, which is its size.
    """
    found = np.array(values, dtype=float)
    size = np.sqrt(np.maximum(np.diag(pseudo_inertia(found)), 0.0))
    for k, (i, j) in _PRODUCTS.items():
        if abs(found[k]) < SOLVER_TOLERANCE * size[i] * size[j]:
            found[k] = 0.0
    return found


def about_centre(values: Floats) -> tuple[float, Floats, Floats]:
    """Mass, centre of mass (3,) and moments about it (6,) of a fitted body, with zeros as in ``with_zeros``."""
    mass, x, y, z, *moments = convert(with_zeros(values), "echelon", "urdf")
    central = with_zeros(np.array([*moments, 0.0, 0.0, 0.0, mass]))
    return float(mass), np.array([x, y, z]), central[:_MX]
