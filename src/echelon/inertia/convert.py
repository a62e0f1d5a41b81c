"""Other programs' conventions for the inertia of a body, as one table.

Linear conventions are other orders of the same ten numbers; regressor columns follow them.  The others state the mass,
its centre, and the inertia about that centre, which no regressor is linear in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.inertia.spatial import (
    from_pseudo_inertia,
    from_spatial_inertia,
    from_tensor,
    pseudo_inertia,
    spatial_inertia,
    tensor_and_moment,
)

_XX, _XY, _XZ, _YY, _YZ, _ZZ, _MX, _MY, _MZ, _M = range(PER_BODY)


@dataclass(frozen=True)
class Convention:
    """One way of writing the inertia of a body."""

    shape: tuple[int, ...]  # of one body's numbers
    read: Callable[[Floats], Floats]  # to standard parameters: shape (..., *shape) to (..., 10)
    write: Callable[[Floats], Floats]  # back
    order: tuple[int, ...] | None = None  # for a linear convention: which standard parameter stands at each place
    needs_mass: bool = False  # whether it divides by the mass when written


def _ordered(*order: int) -> Convention:
    inverse = [order.index(k) for k in range(PER_BODY)]
    return Convention((PER_BODY,), lambda v: v[..., inverse], lambda v: v[..., list(order)], order)


def _central(inertia: tuple[int, ...], *, about_centre: bool = True) -> Convention:
    """Mass, centre, then six moments in an order of XX … ZZ."""
    inverse = [4 + inertia.index(k) for k in range(6)]

    def read(values: Floats) -> Floats:
        mass, centre = values[..., 0], values[..., 1:4]
        moment = mass[..., None] * centre
        tensor, _, _ = tensor_and_moment(np.concatenate([values[..., inverse], moment, mass[..., None]], axis=-1))
        return from_tensor(tensor + about_centre * _steiner(mass, centre), moment, mass)

    def write(values: Floats) -> Floats:
        tensor, centre, mass = _about_centre(values)
        moments = from_tensor(tensor if about_centre else tensor + _steiner(mass, centre), centre, mass)
        return np.concatenate([mass[..., None], centre, moments[..., list(inertia)]], axis=-1)

    return Convention((PER_BODY,), read, write, needs_mass=True)


def _steiner(mass: Floats, centre: Floats) -> Floats:
    """What the parallel-axis theorem adds for a centre of mass, (..., 3, 3)."""
    square = (centre * centre).sum(axis=-1)[..., None, None] * np.eye(3)
    added: Floats = mass[..., None, None] * (square - centre[..., :, None] * centre[..., None, :])
    return added


def _about_centre(values: Floats) -> tuple[Floats, Floats, Floats]:
    """Inertia tensor about the centre of mass, centre of mass, and mass."""
    tensor, moment, mass = tensor_and_moment(values)
    centre = moment / mass[..., None]
    return tensor - _steiner(mass, centre), centre, mass


def _read_principal(values: Floats) -> Floats:
    mass, centre, quaternion, moments = values[..., 0], values[..., 1:4], values[..., 4:8], values[..., 8:11]
    axes = rotation_of(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True))
    tensor = axes @ (moments[..., :, None] * np.swapaxes(axes, -1, -2))
    return from_tensor(tensor + _steiner(mass, centre), mass[..., None] * centre, mass)


def _write_principal(values: Floats) -> Floats:
    tensor, centre, mass = _about_centre(values)
    moments, axes = np.linalg.eigh(tensor)
    moments, axes = moments[..., ::-1], axes[..., ::-1].copy()  # largest first, as MuJoCo's compiler does
    axes[..., :, 2] *= np.linalg.det(axes)[..., None]
    return np.concatenate([mass[..., None], centre, rotation_quaternion(axes), moments], axis=-1)


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
        raise InputError(f"{source} has numbers of shape {start.shape} per body, got an array of shape {array.shape}")
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
        raise InputError(problem, element=f"body {place[0] if len(place) == 1 else place}")


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
            valid = ", ".join(known for known, entry in CONVENTIONS.items() if entry.order)
            raise InputError(f"no regressor has columns in the convention '{name}' (valid: {valid})")
        orders.append(order)
    array = np.asarray(regressor, dtype=float)
    if array.ndim == 0 or array.shape[-1] % PER_BODY:
        raise InputError(f"expected {PER_BODY} columns per body, got an array of shape {array.shape}")
    blocks = array.reshape(*array.shape[:-1], -1, PER_BODY)
    # a permutation is orthogonal: its inverse transposed, which columns need, is itself
    permuted: Floats = blocks[..., [orders[0].index(k) for k in orders[1]]].reshape(array.shape)
    return permuted


def convention(name: str) -> Convention:
    """A convention by its name."""
    if name not in CONVENTIONS:
        raise InputError(f"unknown convention '{name}' (valid: {', '.join(CONVENTIONS)})")
    return CONVENTIONS[name]
