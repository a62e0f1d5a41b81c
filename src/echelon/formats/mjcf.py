"""MJCF: the model format of MuJoCo.

MuJoCo itself compiles the file (see :mod:`echelon.formats.mjcf_spec`).  Its doubles become exact numbers through their
shortest decimal, so 0.333 is 333/1000 although it went through a double.  Rotations become angles about fixed axes,
chosen so that what was meant as a multiple of 15° is recognised later.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from echelon.errors import InputError
from echelon.exact.numbers import Rational
from echelon.formats.inertia import central_inertial
from echelon.formats.literal import (
    LiteralLink,
    LiteralMotion,
    LiteralPlacement,
    LiteralStep,
    LiteralTree,
    Triple,
)
from echelon.formats.mjcf_document import check_document
from echelon.formats.mjcf_equality import JOINT, TENDON, equality_kind, read_relation, resolve, take_equalities
from echelon.formats.mjcf_loops import driven_joints, named_frames, read_closures, read_keyframes, read_poses
from echelon.formats.mjcf_numbers import (
    cleaned,
    displaced,
    exact_angle,
    exact_number,
    exact_triple,
    placements,
    quaternion_matrix,
)
from echelon.formats.mjcf_sensors import Sensors
from echelon.formats.mjcf_spec import NO_MASS, CompiledModel, compile_spec, import_mujoco, parse_spec
from echelon.mechanism.joint import MotionKind

_KINDS = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
_SINGLE = {"slide": MotionKind.TRANSLATION, "hinge": MotionKind.ROTATION}
_UNNAMED = "MuJoCo Model"
_SOME_MASS = 2 * NO_MASS


def read_mjcf(text: str | bytes, source: str, directory: Path | None, *, mimics: bool = True) -> LiteralTree:
    """Parse an MJCF document.

    The coordinates are MuJoCo's: q counts from the joint's ``ref``, a ball joint has a unit quaternion w, x, y, z and
    its angular velocity in the moved frame, a free joint the position and velocity of the body's origin in the world's
    axes and then the same as a ball joint.
    """
    *_, missing = check_document(text, source, directory)
    if not missing:
        return _read(text, source, directory, mimics, lenient=False)
    names = ", ".join(f"'{name}'" for name in missing)
    try:
        tree = _read(text, source, directory, mimics, lenient=True)
        if not any(isinstance(step, LiteralMotion) for link in tree.links for step in link.steps):
            raise InputError("nothing moves", source=source)
    except InputError as error:
        problem = f"{error.problem}; included files are missing: {names}"
        raise InputError(problem, source=error.source, element=error.element) from None
    return replace(tree, notes=(f"included files are missing, read without what they define: {names}", *tree.notes))


def _read(text: str | bytes, source: str, directory: Path | None, mimics: bool, *, lenient: bool) -> LiteralTree:
    spec = parse_spec(text, source, directory)
    equalities, notes = take_equalities(spec, source)
    couples = [equality for equality in equalities if equality_kind(equality) in (JOINT, TENDON)]
    relations = [read_relation(e, spec, source) for e in couples if mimics or (e.name1 and not e.name2)]
    relations = [relation for relation in relations if mimics or len(relation.terms) == 1]
    driven, keyframes = driven_joints(spec), read_keyframes(spec)
    sensors = Sensors(spec)
    reader = _Reader(compile_spec(spec, source, directory, lenient=lenient), source)
    held, couplings, found = resolve(relations, reader.reference, driven, source)
    notes += found
    notes += [f"joint '{name}' is held by an equality and cannot move" for name in held]
    model = reader.model
    loops = [equality for equality in equalities if equality not in couples]
    measured = tuple(sensors.read(model))
    weightless = model.opt.disableflags & import_mujoco().mjtDisableBit.mjDSBL_GRAVITY
    gravity: Triple = (0, 0, 0) if weightless else exact_triple(model.opt.gravity)
    return LiteralTree(
        "robot" if spec.modelname == _UNNAMED else str(spec.modelname),
        source,
        tuple(reader.link(index, held) for index in range(model.nbody)),
        couplings,
        gravity,
        (*notes, *reader.compiled.notes, *sensors.notes),
        root_is_world=True,
        closures=tuple(read_closures(loops, model, spec)),
        poses=read_poses(model, keyframes) if loops else {},
        driven=driven,
        has_mimics=bool(couplings) or len(relations) < len(couples),
        sensors=measured,
        frames=tuple(named_frames(model, spec)),
    )


class _Reader:
    """Links of a compiled model."""

    def __init__(self, compiled: CompiledModel, source: str) -> None:
        self.compiled, self.model, self.source = compiled, compiled.model, source
        self.bodies = {body.name: body for body in compiled.spec.bodies}
        self.joints = {joint.name: joint for joint in compiled.spec.joints}
        self.reference: dict[str, Rational] = {}
        for index in range(self.model.njnt):
            if self._kind(index) in _SINGLE:
                self.reference[self._name(index)] = self._reference(index)

    def _reference(self, joint: int) -> Rational:
        value = float(self.model.qpos0[self.model.jnt_qposadr[joint]])
        try:
            return exact_angle(value) if self._kind(joint) == "hinge" else exact_number(value)
        except InputError as error:
            raise InputError(error.problem, source=self.source, element=f"joint '{self._name(joint)}' ref") from None

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
        try:
            return self._moving_link(index, name, held)
        except InputError as error:
            raise InputError(error.problem, source=self.source, element=error.element or f"body '{name}'") from None

    def _moving_link(self, index: int, name: str, held: Mapping[str, Rational]) -> LiteralLink:
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
            self._rest(index, name),
        )

    def _rest(self, index: int, name: str) -> tuple[LiteralPlacement, ...]:
        xyz = exact_triple(self.model.body_pos[index], self.bodies[name].pos)
        return placements(f"body '{name}'", xyz, self.model.body_quat[index])

    def _steps(self, index: int, name: str, joints: range, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        if any(self._kind(j) == "free" for j in joints):  # its position is the whole pose: body_pos does not count
            yield from (LiteralMotion(f"joint '{self._name(j)}'", self._name(j), "floating") for j in joints)
            return
        yield from self._rest(index, name)
        for joint in joints:
            yield from self._joint(joint, held)

    def _joint(self, joint: int, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        name, kind = self._name(joint), self._kind(joint)
        x, y, z = exact_triple(self.model.jnt_pos[joint], self.joints[name].pos)
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
        axis = cleaned(self.model.jnt_axis[joint])
        displacement = held.get(name, -self.reference[name])
        motion = () if name in held else (LiteralMotion(where, name, _SINGLE[kind], axis),)
        if not displacement:
            yield from motion
            return
        yield from displaced(where, kind, axis, displacement, motion)

    def _inertial(self, index: int, name: str) -> tuple[float, ...] | None:
        mass, moments = float(self.model.body_mass[index]), np.array(self.model.body_inertia[index])
        stated = self.bodies[name].explicitinertial or mass > _SOME_MASS
        if not stated or name in self.compiled.unknown:
            return None
        moments[moments <= _SOME_MASS] = 0.0
        mass = mass if mass > _SOME_MASS else 0.0
        rotation = quaternion_matrix(self.model.body_iquat[index])
        centre = [float(v) for v in exact_triple(self.model.body_ipos[index])]
        inertial = central_inertial(float(exact_number(mass)), centre, np.diag(moments), rotation)
        return tuple(float(v) for v in inertial)
