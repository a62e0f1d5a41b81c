"""MJCF: the model format of MuJoCo.

MuJoCo itself compiles the file (see :mod:`echelon.formats.mjcf_spec`).  Its doubles become exact numbers through their
shortest decimal, so 0.333 is 333/1000 although it went through a double.  Rotations become angles about fixed axes,
chosen so that what was meant as a multiple of 15° is recognised later.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import asin, atan2, floor, hypot, log10, pi
from pathlib import Path

import numpy as np
import numpy.typing as npt

from echelon.exact.angle import STEPS_PER_HALF_TURN
from echelon.exact.numbers import Rational, parse_decimal
from echelon.formats.inertia import central_inertial, rotation_matrix
from echelon.formats.literal import (
    LiteralLink,
    LiteralMotion,
    LiteralPlacement,
    LiteralStep,
    LiteralTree,
    Triple,
)
from echelon.formats.mjcf_equality import read_equality, resolve, take_equalities
from echelon.formats.mjcf_spec import NO_MASS, CompiledModel, compile_spec, import_mujoco, parse_spec
from echelon.mechanism.joint import MotionKind

_KINDS = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
_SINGLE = {"slide": MotionKind.TRANSLATION, "hinge": MotionKind.ROTATION}
_UNNAMED = "MuJoCo Model"
_SOME_MASS = 2 * NO_MASS
_NOISE = 1e-14  # what a few roundings of MuJoCo's compiler leave of a zero or of a multiple of 15°
_LOCK = 1e-2  # cosine of the pitch below which roll and yaw are hardly told apart
_DIGITS = 15  # significant decimal digits that a double always keeps


def read_mjcf(text: str | bytes, source: str, directory: Path | None, *, mimics: bool = True) -> LiteralTree:
    """Parse an MJCF document.

    The coordinates are MuJoCo's: q counts from the joint's ``ref``, a ball joint has a unit quaternion w, x, y, z and
    its angular velocity in the moved frame, a free joint the position and velocity of the body's origin in the world's
    axes and then the same as a ball joint.

    Parameters
    ----------
    text : str or bytes
    source : str
        File name for messages.
    directory : Path, optional
        Where included files and meshes are.
    mimics : bool
        Whether couplings between joints are read (and checked), or ignored.

    Returns
    -------
    LiteralTree
        The world and its bodies in depth-first order.

    Raises
    ------
    InputError
        If MuJoCo refuses the model, or it is not a tree of rigid bodies with linear couplings; names the element.
    MissingExtraError
        If the package ``mujoco`` is not installed.
    """
    spec = parse_spec(text, source, directory)
    equalities, notes = take_equalities(spec, source)
    relations = [read_equality(equality, source) for equality in equalities if mimics or not equality.name2]
    reader = _Reader(compile_spec(spec, source, directory))
    held, couplings = resolve(relations, reader.reference, source)
    notes += [f"joint '{name}' is held by an equality and cannot move" for name in held]
    model = reader.model
    weightless = model.opt.disableflags & import_mujoco().mjtDisableBit.mjDSBL_GRAVITY
    gravity: Triple = (0, 0, 0) if weightless else _triple(model.opt.gravity)
    return LiteralTree(
        "robot" if spec.modelname == _UNNAMED else str(spec.modelname),
        source,
        tuple(reader.link(index, held) for index in range(model.nbody)),
        couplings,
        gravity,
        (*notes, *reader.compiled.notes),
        root_is_world=True,
    )


class _Reader:
    """Links of a compiled model.

    Attributes
    ----------
    reference : dict of str to number
        Reference position of every hinge and slide joint.
    """

    def __init__(self, compiled: CompiledModel) -> None:
        self.compiled, self.model = compiled, compiled.model
        self.bodies = {body.name: body for body in compiled.spec.bodies}
        self.joints = {joint.name: joint for joint in compiled.spec.joints}
        self.reference: dict[str, Rational] = {}
        for index in range(self.model.njnt):
            if self._kind(index) in _SINGLE:
                value = float(self.model.qpos0[self.model.jnt_qposadr[index]])
                self.reference[self._name(index)] = _angle(value) if self._kind(index) == "hinge" else _exact(value)

    def _kind(self, joint: int) -> str:
        return _KINDS[int(self.model.jnt_type[joint])]

    def _name(self, joint: int) -> str:
        return str(self.model.joint(joint).name)

    # -- links -----------------------------------------------------------------------------------------------------

    def link(self, index: int, held: Mapping[str, Rational]) -> LiteralLink:
        """One body with the joints that connect it to its parent."""
        name = str(self.model.body(index).name)
        if index == 0:
            return LiteralLink(name, -1, "", "root", ())
        first = int(self.model.body_jntadr[index])
        joints = range(first, first + int(self.model.body_jntnum[index]))
        moving = [j for j in joints if self._name(j) not in held]
        return LiteralLink(
            name,
            int(self.model.body_parentid[index]),
            "+".join(self._name(j) for j in moving) or name,
            "+".join(self._kind(j) for j in moving) or "fixed",
            tuple(self._steps(index, name, joints, held)),
            self._inertial(index, name),
        )

    def _steps(self, index: int, name: str, joints: range, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        if any(self._kind(j) == "free" for j in joints):  # its position is the whole pose: body_pos does not count
            yield from (LiteralMotion(f"joint '{self._name(j)}'", self._name(j), "floating") for j in joints)
            return
        xyz = _triple(self.model.body_pos[index], self.bodies[name].pos)
        yield from placements(f"body '{name}'", xyz, self.model.body_quat[index])
        for joint in joints:
            yield from self._joint(joint, held)

    def _joint(self, joint: int, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        name, kind = self._name(joint), self._kind(joint)
        x, y, z = _triple(self.model.jnt_pos[joint], self.joints[name].pos)
        if kind == "slide" or not (x or y or z):  # where a straight line is anchored makes no difference
            yield from self._freedom(joint, name, kind, held)
            return
        yield LiteralPlacement(f"joint '{name}' anchor", (x, y, z))
        yield from self._freedom(joint, name, kind, held)
        yield LiteralPlacement(f"joint '{name}' anchor", (-x, -y, -z))

    def _freedom(self, joint: int, name: str, kind: str, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        where = f"joint '{name}'"
        if kind == "ball":
            yield LiteralMotion(where, name, MotionKind.BALL)
            return
        axis = _cleaned(self.model.jnt_axis[joint])
        displacement = held.get(name, -self.reference[name])
        motion = () if name in held else (LiteralMotion(where, name, _SINGLE[kind], axis),)
        if not displacement:
            yield from motion
            return
        yield from _displaced(where, kind, axis, displacement, motion)

    def _inertial(self, index: int, name: str) -> tuple[float, ...] | None:
        mass, moments = float(self.model.body_mass[index]), np.array(self.model.body_inertia[index])
        stated = self.bodies[name].explicitinertial or mass > _SOME_MASS
        if not stated or name in self.compiled.unknown:
            return None
        moments[moments <= _SOME_MASS] = 0.0
        mass = mass if mass > _SOME_MASS else 0.0
        rotation = quaternion_matrix(self.model.body_iquat[index])
        inertial = central_inertial(mass, self.model.body_ipos[index], np.diag(moments), rotation)
        return tuple(float(v) for v in inertial)


# -- geometry ----------------------------------------------------------------------------------------------------------


def quaternion_matrix(quaternion: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Rotation matrix of a quaternion w, x, y, z of any length but zero."""
    q = np.asarray(quaternion, dtype=float)
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def placements(element: str, xyz: Triple, quaternion: npt.ArrayLike) -> tuple[LiteralPlacement, ...]:
    """A pose as placements whose angles, where they are nearly multiples of 15°, are all seen to be.

    With a pitch of nearly ±90° a rounded quaternion has arbitrary roll and yaw, and only their sum or difference means
    anything.  Then the first placement has roll 0 and pitch ±90° exactly, and a second one, of three small angles, the
    remainder.
    """
    matrix = quaternion_matrix(quaternion)
    if hypot(matrix[0, 0], matrix[1, 0]) >= _LOCK:
        return (LiteralPlacement(element, xyz, _rpy(matrix)),)
    pitch, yaw = (pi / 2 if matrix[2, 0] < 0 else -pi / 2), atan2(-matrix[0, 1], matrix[1, 1])
    locked = LiteralPlacement(element, xyz, (0, _angle(pitch), _angle(yaw)))
    remainder = _rpy(rotation_matrix(0.0, pitch, float(locked.rpy[2])).T @ matrix)
    return (locked, LiteralPlacement(f"{element} remainder", (0, 0, 0), remainder)) if any(remainder) else (locked,)


def _rpy(matrix: npt.NDArray[np.float64]) -> Triple:
    roll = atan2(matrix[2, 1], matrix[2, 2])
    pitch = atan2(-matrix[2, 0], hypot(matrix[0, 0], matrix[1, 0]))
    return _angle(roll), _angle(pitch), _angle(atan2(matrix[1, 0], matrix[0, 0]))


def _displaced(
    where: str, kind: str, axis: Triple, displacement: Rational, motion: tuple[LiteralMotion, ...]
) -> Iterator[LiteralStep]:
    """A constant displacement and then a motion along or about one axis, which becomes z meanwhile.

    So both have exactly the same direction, however the angles of the axis are read.
    """
    x, y, z = (float(v) for v in axis)
    if hypot(x, y) < _LOCK:
        turns = ((1, _angle(atan2(x, z))), (0, _angle(-asin(y))))
    else:
        turns = ((2, _angle(atan2(y, x))), (1, _angle(atan2(hypot(x, y), z))))
    yield from (_turn(f"{where} axis", k, angle) for k, angle in turns)
    along: Triple = (0, 0, displacement)
    element = f"{where} ref"
    yield LiteralPlacement(element, rpy=along) if kind == "hinge" else LiteralPlacement(element, along)
    yield from (replace(m, axis=(0, 0, 1)) for m in motion)
    yield from (_turn(f"{where} axis", k, -angle) for k, angle in reversed(turns))


def _turn(element: str, axis: int, angle: Rational) -> LiteralPlacement:
    roll, pitch, yaw = (angle if k == axis else 0 for k in range(3))
    return LiteralPlacement(element, rpy=(roll, pitch, yaw))


# -- numbers -----------------------------------------------------------------------------------------------------------


def _exact(value: float) -> Rational:
    """The shortest decimal that is this double, which is the number in the file unless that has over 15 digits."""
    return parse_decimal(repr(float(value)))


def _angle(value: float) -> Rational:
    """An angle in rad without the noise of computing it, if it is a multiple of 15°."""
    step = pi / STEPS_PER_HALF_TURN
    nearest = round(value / step) * step
    return _exact(nearest if abs(value - nearest) <= _NOISE else value)


def _triple(vector: npt.NDArray[np.float64], written: npt.NDArray[np.float64] | None = None) -> Triple:
    """Exact numbers of a vector; one that is not as written was computed and keeps 15 digits of its largest entry."""
    largest = float(np.max(np.abs(vector)))
    if written is None or np.array_equal(vector, written) or not largest:
        x, y, z = (_exact(v) for v in vector)
    else:
        x, y, z = (_exact(round(float(v), _DIGITS - 1 - floor(log10(largest)))) for v in vector)
    return x, y, z


def _cleaned(direction: npt.NDArray[np.float64]) -> Triple:
    """A unit vector without the noise of computing it."""
    x, y, z = (_exact(v) if abs(v) > _NOISE else 0 for v in direction)
    return x, y, z
