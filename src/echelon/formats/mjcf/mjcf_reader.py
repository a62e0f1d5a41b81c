"""MJCF, the model format of MuJoCo: bodies and joints, loops, force sensors.

MuJoCo itself compiles the file (see :mod:`echelon.formats.mjcf.mjcf_model`).  Its doubles become exact numbers through
their shortest decimal, so 0.333 is 333/1000 although it went through a double.  Rotations become angles about fixed
axes, chosen so that what was meant as a multiple of 15° is recognised later.

Loops are the equality constraints ``connect`` and ``weld``.  Between bodies, ``connect`` states its point on the first
body and ``weld`` on the second.  The other body has it where it is at the reference pose, unless a weld states the
relative pose.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from math import isfinite, nan
from typing import Any

import numpy as np

from echelon.algebra import Rational, parse_decimal
from echelon.formats.literal import (
    LiteralClosure,
    LiteralEffort,
    LiteralFrame,
    LiteralLink,
    LiteralMotion,
    LiteralPlacement,
    LiteralSensor,
    LiteralStep,
    LiteralTree,
    LiteralWrench,
    Triple,
    central_inertial,
)
from echelon.formats.mjcf.mjcf_equality import (
    JOINT,
    TENDON,
    equality_kind,
    equality_label,
    read_relation,
    resolve,
    take_equalities,
)
from echelon.formats.mjcf.mjcf_model import (
    NO_MASS,
    CompiledModel,
    MjcfDocument,
    compile_spec,
    import_mujoco,
    name_all,
    parse_spec,
)
from echelon.formats.mjcf.mjcf_numbers import (
    cleaned,
    displaced,
    exact_angle,
    exact_number,
    exact_triple,
    placements,
    quaternion_matrix,
)
from echelon.robot import FLOATING, ClosureKind, MotionKind
from echelon.shared import InputError, unused

_JOINT_TYPES = ("free", "ball", "slide", "hinge")  # in the order of MuJoCo's mjtJoint
_KINDS = {"free": FLOATING}  # of joints, where another name is usual
_SINGLE = {"slide": MotionKind.TRANSLATION, "hinge": MotionKind.ROTATION}
_UNNAMED = "MuJoCo Model"
_SOME_MASS = 2 * NO_MASS


def read_mjcf(document: MjcfDocument, *, mimics: bool = True) -> LiteralTree:
    """The tree of an MJCF document.

    The coordinates are MuJoCo's: q counts from the joint's ``ref``, a ball joint has a unit quaternion w, x, y, z and
    its angular velocity in the moved frame, a free joint the position and velocity of the body's origin in the world's
    axes and then the same as a ball joint.
    """
    if not document.missing:
        return _read(document, mimics)
    names = ", ".join(f"'{name}'" for name in document.missing)
    try:
        tree = _read(document, mimics)
        if not any(
            isinstance(step, LiteralMotion)
            for link in tree.links
            for step in link.steps
        ):
            raise InputError("nothing moves", source=document.source)
    except InputError as error:
        problem = f"{error.problem}; included files are missing: {names}"
        raise InputError(problem, source=error.source, element=error.element) from None
    return replace(
        tree,
        notes=(
            f"included files are missing, read without what they define: {names}",
            *tree.notes,
        ),
    )


def _read(document: MjcfDocument, mimics: bool) -> LiteralTree:
    spec, source = parse_spec(document), document.source
    equalities, notes = take_equalities(spec, source)
    couples = [
        equality
        for equality in equalities
        if equality_kind(equality) in (JOINT, TENDON)
    ]
    relations = [
        read_relation(e, spec, source)
        for e in couples
        if mimics or (e.name1 and not e.name2)
    ]
    relations = [
        relation for relation in relations if mimics or len(relation.terms) == 1
    ]
    name_all("joint", spec.joints)
    driven = tuple(
        dict.fromkeys(
            str(actuator.target)
            for actuator in spec.actuators
            if drives_joint(actuator)
        )
    )
    drives = stated_drives(spec)
    keyframes = {str(k.name) or str(n): list(k.qpos) for n, k in enumerate(spec.keys)}
    sensors = Sensors(spec)
    reader = _MjcfReader(compile_spec(spec, document), source)
    loops = [equality for equality in equalities if equality not in couples]
    sliding = [
        str(j.name)
        for j in spec.joints
        if loops and _JOINT_TYPES[int(j.type)] == "slide"
    ]
    held, couplings, found = resolve(
        relations, reader.reference, driven, source, sliding
    )
    notes += found
    notes += [f"joint '{name}' is held by an equality and cannot move" for name in held]
    model = reader.model
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
        drives=drives,
        has_mimics=bool(couplings) or len(relations) < len(couples),
        sensors=measured,
        frames=tuple(
            LiteralFrame(s.name, *site_frame(model, s, "frame"))
            for s in spec.sites
            if s.name
        ),
        turned=tuple(
            exact_number(v)
            for part in (*spec.bodies, *spec.joints)
            for v in _direction(part)
        ),
        placed=tuple(exact_number(v) for point in _points(spec, loops) for v in point),
    )


def _direction(part: Any) -> Any:
    """The quaternion of a body or the axis of a joint, as written."""
    return part.quat if hasattr(part, "quat") else part.axis


def _points(spec: Any, loops: Sequence[Any]) -> Iterator[Any]:
    """Places of bodies and joints, and of what loops join, as written."""
    joined = {name for equality in loops for name in (equality.name1, equality.name2)}
    sites = [site for site in spec.sites if site.name in joined]
    for part in (*spec.bodies, *spec.joints, *sites):
        yield part.pos
    for equality in loops:
        yield equality.data[:6]  # the anchor, and of a weld where the second body is


class _MjcfReader:
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
            if self._kind(joint) == "hinge":
                return exact_angle(value)
            return exact_number(value)
        except InputError as error:
            raise InputError(
                error.problem,
                source=self.source,
                element=f"joint '{self._name(joint)}' ref",
            ) from None

    def _kind(self, joint: int) -> str:
        return _JOINT_TYPES[int(self.model.jnt_type[joint])]

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
            raise InputError(
                error.problem,
                source=self.source,
                element=error.element or f"body '{name}'",
            ) from None

    def _moving_link(
        self, index: int, name: str, held: Mapping[str, Rational]
    ) -> LiteralLink:
        first = int(self.model.body_jntadr[index])
        joints = range(first, first + int(self.model.body_jntnum[index]))
        moving = [j for j in joints if self._name(j) not in held]
        return LiteralLink(
            name,
            int(self.model.body_parentid[index]),
            "+".join(self._name(j) for j in moving) or name,
            "+".join(_KINDS.get(k, k) for k in map(self._kind, moving)) or "fixed",
            tuple(self._steps(index, name, joints, held)),
            self._inertial(index, name),
            self._rest(index, name),
        )

    def _rest(self, index: int, name: str) -> tuple[LiteralPlacement, ...]:
        xyz = exact_triple(self.model.body_pos[index], self.bodies[name].pos)
        return placements(f"body '{name}'", xyz, self.model.body_quat[index])

    def _steps(
        self, index: int, name: str, joints: range, held: Mapping[str, Rational]
    ) -> Iterator[LiteralStep]:
        if any(
            self._kind(j) == "free" for j in joints
        ):  # its position is the whole pose: body_pos does not count
            yield from (
                LiteralMotion(f"joint '{self._name(j)}'", self._name(j), FLOATING)
                for j in joints
            )
            return
        yield from self._rest(index, name)
        for joint in joints:
            yield from self._joint(joint, held)

    def _joint(self, joint: int, held: Mapping[str, Rational]) -> Iterator[LiteralStep]:
        name, kind = self._name(joint), self._kind(joint)
        x, y, z = exact_triple(self.model.jnt_pos[joint], self.joints[name].pos)
        if kind == "slide" or not (
            x or y or z
        ):  # where a straight line is anchored makes no difference
            yield from self._freedom(joint, name, kind, held)
            return
        yield LiteralPlacement(f"joint '{name}' anchor", (x, y, z))
        yield from self._freedom(joint, name, kind, held)
        yield LiteralPlacement(f"joint '{name}' anchor", (-x, -y, -z))

    def _freedom(
        self, joint: int, name: str, kind: str, held: Mapping[str, Rational]
    ) -> Iterator[LiteralStep]:
        where = f"joint '{name}'"
        if kind == "ball":
            yield LiteralMotion(where, name, MotionKind.BALL)
            return
        axis = cleaned(self.model.jnt_axis[joint])
        displacement = held.get(name, -self.reference[name])
        motion = (
            () if name in held else (LiteralMotion(where, name, _SINGLE[kind], axis),)
        )
        if not displacement:
            yield from motion
            return
        yield from displaced(where, kind, axis, displacement, motion)

    def _inertial(self, index: int, name: str) -> tuple[float, ...] | None:
        mass = float(self.model.body_mass[index])
        moments = np.array(self.model.body_inertia[index])
        stated = self.bodies[name].explicitinertial or mass > _SOME_MASS
        if not stated or name in self.compiled.unknown:
            return None
        moments[moments <= _SOME_MASS] = 0.0
        mass = mass if mass > _SOME_MASS else 0.0
        rotation = quaternion_matrix(self.model.body_iquat[index])
        centre = [float(v) for v in exact_triple(self.model.body_ipos[index])]
        xx, yy, zz = moments.tolist()
        return central_inertial(
            float(exact_number(mass)), centre, (xx, 0.0, 0.0, yy, 0.0, zz), rotation
        )


_WRENCHES = {"mjSENS_FORCE": False, "mjSENS_TORQUE": True}


class Sensors:
    """The sensors of a spec, kept while it is compiled without them."""

    def __init__(self, spec: Any) -> None:
        self.notes: list[str] = []
        self._sites = {site.name: site for site in spec.sites}
        self._drives = {actuator.name: actuator for actuator in spec.actuators}
        self._driven = Counter(
            str(actuator.target)
            for actuator in spec.actuators
            if drives_joint(actuator)
        )
        self._single = {
            joint.name
            for joint in spec.joints
            if _JOINT_TYPES[int(joint.type)] in _SINGLE
        }
        self._wrenches: list[tuple[str, str, Any, bool]] = []
        self._efforts: list[LiteralEffort] = []
        self._taken: set[str] = {sensor.name for sensor in spec.sensors if sensor.name}
        others: Counter[str] = Counter()
        for sensor in spec.sensors:
            kind, target = str(sensor.type.name), str(sensor.objname)
            label = f"sensor {kind.removeprefix('mjSENS_').lower()} '{sensor.name or target}'"
            if kind in _WRENCHES:
                name = self._named(sensor.name, target)
                self._wrenches.append(
                    (label, name, self._sites[target], _WRENCHES[kind])
                )
            elif kind == "mjSENS_JOINTACTFRC":
                self._efforts.append(
                    LiteralEffort(label, self._named(sensor.name, target), target)
                )
            elif kind == "mjSENS_ACTUATORFRC":
                self._efforts += self._of_actuator(
                    label, self._named(sensor.name, target), self._drives[target]
                )
            else:
                others[kind.removeprefix("mjSENS_").lower()] += 1
        if others and (self._wrenches or self._efforts):
            counts = ", ".join(
                f"{kind} ({count})" for kind, count in sorted(others.items())
            )
            self.notes.append(
                f"sensors of other quantities than drive forces and wrenches are left out: {counts}"
            )

    def read(self, model: Any) -> Iterator[LiteralSensor]:
        """The force sensors in terms of the compiled model."""
        for label, name, site, angular in self._wrenches:
            link, placements = site_frame(model, site, label)
            if link:
                yield LiteralWrench(label, name, link, placements, angular)
            else:
                self.notes.append(f"{label} is left out: the world has no parent")
        yield from self._efforts

    def _named(self, stated: str, target: str) -> str:
        """The sensor's name, or one made from the name of its site, joint or actuator."""
        if stated:
            return str(stated)
        name = unused(target, self._taken)
        self._taken.add(name)
        return name

    def _of_actuator(
        self, label: str, name: str, actuator: Any
    ) -> Iterator[LiteralEffort]:
        joint, gear = str(actuator.target), parse_decimal(repr(float(actuator.gear[0])))
        if not drives_joint(actuator):
            self.notes.append(
                f"{label} is left out: it does not drive a joint directly"
            )
        elif joint not in self._single:
            self.notes.append(
                f"{label} is left out: joint '{joint}' has more than one axis"
            )
        elif self._driven[joint] > 1:
            self.notes.append(
                f"{label} is left out: joint '{joint}' has other actuators, too"
            )
        elif not gear:
            self.notes.append(f"{label} is left out: its gear is zero")
        else:
            yield LiteralEffort(label, name, joint, 1 / Fraction(gear))


def drives_joint(actuator: Any) -> bool:
    """Whether an actuator acts on a joint, rather than through a tendon or the like."""
    kinds = import_mujoco().mjtTrn
    return actuator.trntype in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)


def is_motor(actuator: Any) -> bool:
    """Whether an actuator's force is its control times a gain; that of other ones depends on the state as well."""
    mujoco = import_mujoco()
    plain = (
        mujoco.mjtGain.mjGAIN_FIXED,
        mujoco.mjtBias.mjBIAS_NONE,
        mujoco.mjtDyn.mjDYN_NONE,
    )
    return bool((actuator.gaintype, actuator.biastype, actuator.dyntype) == plain)


_ANCHOR, _POSITION, _QUATERNION = slice(0, 3), slice(3, 6), slice(6, 10)
_TORQUE_SCALE = 10  # place of the data of a weld; it holds turns unless this is zero
_BALL = ("w", "x", "y", "z")


DRIVES = {
    "damping": "viscous",
    "frictionloss": "coulomb",
    "armature": "rotor_inertia",
    "stiffness": "spring",
}
"""Attributes of joints, and the effects that they are."""


def stated_drives(spec: Any) -> dict[str, dict[str, float]]:
    """Effects that joints state, and which of them actuators drive through gears."""
    found: dict[str, dict[str, float]] = {}
    for joint in spec.joints:
        numbers = {
            kind: float(np.ravel(getattr(joint, key))[0])
            for key, kind in DRIVES.items()
        }
        found[str(joint.name)] = {
            kind: value for kind, value in numbers.items() if value
        }
    for actuator in spec.actuators:
        if drives_joint(actuator) and abs(actuator.gear[0]) not in (0.0, 1.0):
            found.setdefault(str(actuator.target), {}).setdefault("rotor_inertia", nan)
    return {name: numbers for name, numbers in found.items() if numbers}


def read_poses(
    model: Any, keyframes: Mapping[str, Sequence[float]]
) -> dict[str, dict[str, float]]:
    """The coordinates of the reference pose and of the keyframes, by name of the pose."""
    names: list[str] = []
    for index in range(model.njnt):
        joint = model.joint(index)
        ball = tuple(f"{joint.name}.{c}" for c in _BALL)
        free = (
            *(f"{joint.name}.t{c}" for c in "xyz"),
            *(f"{joint.name}.r.{c}" for c in _BALL),
        )
        names += {1: (str(joint.name),), len(ball): ball, len(free): free}[
            len(joint.qpos0)
        ]
    stated = {"the reference pose": model.qpos0} | {
        f"keyframe '{name}'": qpos for name, qpos in keyframes.items()
    }
    poses = {}
    for element, qpos in stated.items():
        if len(qpos) == len(names) and all(map(isfinite, qpos)):
            pairs = zip(names, map(float, qpos), strict=True)
            # a rotation without w would be taken for none
            poses[element] = {n: v for n, v in pairs if v or n.endswith(".w")}
    return poses


def read_closures(
    equalities: Sequence[Any], model: Any, spec: Any
) -> Iterator[LiteralClosure]:
    """The closures of a compiled model."""
    sites = {site.name: site for site in spec.sites}
    taken = {equality.name for equality in equalities}
    for number, equality in enumerate(equalities, 1):
        kind, label = _kind(equality), equality_label(equality)
        name = str(equality.name) or unused(f"loop{number}", taken)
        if equality.objtype == import_mujoco().mjtObj.mjOBJ_SITE:
            (first, at), (second, on_second) = (
                site_frame(model, sites[str(site)], label)
                for site in (equality.name1, equality.name2)
            )
            yield LiteralClosure(label, name, kind, first, second, at, on_second)
        else:
            yield _between_bodies(equality, model, label, name, kind)


def _kind(equality: Any) -> ClosureKind:
    # a weld that does not count rotations is a connect
    rigid = equality_kind(equality) == "weld" and equality.data[_TORQUE_SCALE]
    return ClosureKind.WELD if rigid else ClosureKind.SPHERICAL


def site_frame(
    model: Any, site: Any, label: str
) -> tuple[int, tuple[LiteralPlacement, ...]]:
    """The body that carries a site, and the site's frame on it."""
    compiled = model.site(site.name)
    xyz = exact_triple(compiled.pos, site.pos)
    return int(compiled.bodyid[0]), placements(
        f"{label} site '{site.name}'", xyz, compiled.quat
    )


def _between_bodies(
    equality: Any, model: Any, label: str, name: str, kind: ClosureKind
) -> LiteralClosure:
    # the second body may be left out, and is the world then
    stated, other = (
        int(model.body(name).id) if name else 0
        for name in (equality.name1, equality.name2)
    )
    related = None
    if equality_kind(equality) == "weld":
        stated, other = other, stated
        if any(equality.data[_QUATERNION]):
            related = placements(
                f"{label} pose",
                exact_triple(equality.data[_POSITION]),
                equality.data[_QUATERNION],
            )
    anchor = LiteralPlacement(f"{label} anchor", exact_triple(equality.data[_ANCHOR]))
    return LiteralClosure(label, name, kind, stated, other, (anchor,), related)
