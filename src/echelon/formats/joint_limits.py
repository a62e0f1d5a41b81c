"""The limits of joints that robot files state.

A mechanism carries what its base parameters depend on, and limits are not of that kind.  So they are taken from the
file, and only when motions are designed.  What a file leaves unsaid stays unknown: zeros that stand where a format
demands a number are not taken for limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from echelon.formats.literal import resolved
from echelon.formats.robot_file import RobotFile
from echelon.formats.urdf.urdf_reader import SINGLE_AXIS
from echelon.robot import Mechanism
from echelon.shared import InputError

Interval = tuple[float, float]

_FREE: Interval = (-math.inf, math.inf)
_ENDS = ("lower", "upper")
_LARGEST = ("velocity", "acceleration", "deceleration", "jerk", "effort")
_SOFT = ("soft_lower_limit", "soft_upper_limit")


@dataclass(frozen=True)
class StatedLimits:
    """Limits of one coordinate that a robot file states; None where it is silent."""

    # lowest and highest position, rad or m; one end is infinite where the file limits the other only
    position: Interval | None = None
    velocity: float | None = None  # largest speed, rad/s or m/s
    acceleration: float | None = None  # largest acceleration, rad/s² or m/s²
    jerk: float | None = None  # largest jerk, rad/s³ or m/s³
    effort: float | None = (
        None  # largest torque or force that acts on the joint in both directions, N·m or N
    )
    notes: tuple[str, ...] = ()  # what stands in the file and was not taken for a limit


def stated_limits(file: RobotFile, mechanism: Mechanism) -> dict[str, StatedLimits]:
    """The limits that a robot file states, by velocity coordinate.

    URDF: ``limit``, narrowed by the soft limits of ``safety_controller``.  Zero or less as a velocity, acceleration,
    jerk or effort means that it is unknown, and so does a ``limit`` with neither end of the range.

    MJCF: ranges of joints, and the forces that the actuators of a joint can exert together: ``forcerange`` times gear,
    or ``ctrlrange`` times gain and gear for motors, within the joint's ``actuatorfrcrange``.  Actuators that act
    through tendons, sites or cranks are not counted.
    """
    robot = file.robot
    if robot is None or robot.root.tag == "sdf":
        return {}
    if robot.root.tag == "mujoco":
        found = _of_mjcf(robot)
    else:
        joints = [
            joint
            for joint in robot.root.findall("joint")
            if joint.get("type") in SINGLE_AXIS
        ]
        found = {
            str(joint.get("name")): _of_joint(joint, robot.source) for joint in joints
        }
    offsets = _offsets(robot, mechanism)
    names = [motion.name for motion in mechanism.motions if len(motion.velocities) == 1]
    said: dict[str, StatedLimits] = {}
    for name in names:
        limits = found.get(name, StatedLimits())
        if limits.position is not None:
            low, high = (end - offsets.get(name, 0.0) for end in limits.position)
            limits = replace(limits, position=(low, high))
        if limits != StatedLimits():
            said[name] = limits
    return said


def _offsets(robot: RobotFile, mechanism: Mechanism) -> dict[str, float]:
    """The constant parts of couplings: a file counts them as part of a joint's position, a mechanism does not."""
    if not mechanism.dependent:
        return {}
    couplings = resolved(
        robot.tree().couplings,
        lambda element, problem: InputError(problem, element=element),
    )
    return {
        name: coupling.offset.evaluate({}, float)
        for name, coupling in couplings.items()
    }


# -- URDF -------------------------------------------------------------------------------------------------------------


def _of_joint(joint: Any, source: str) -> StatedLimits:
    where = f"joint '{joint.get('name')}'"
    stated = _numbers(
        joint.find("limit"), (*_ENDS, *_LARGEST), source, f"{where} limit"
    )
    soft = _numbers(
        joint.find("safety_controller"), _SOFT, source, f"{where} safety_controller"
    )
    unknown = [
        f"{key} {stated[key]:g}" for key in _LARGEST if stated.get(key, 1.0) <= 0
    ]
    if len(soft) == len(_SOFT) and not any(soft.values()):
        unknown, soft = [*unknown, "soft limits 0"], {}
    notes = [f"{where}: {value} counts as not stated" for value in unknown]
    position = None
    if joint.get("type") != "continuous":
        position = _range_of_joint(stated, soft, source, where)
        if stated and position is None and not any(key in stated for key in _ENDS):
            notes.append(
                f"{where}: it states neither lower nor upper, and counts as free, not as locked at 0"
            )

    def least(*keys: str) -> float | None:
        return min(
            (stated[key] for key in keys if 0 < stated.get(key, 0.0) < math.inf),
            default=None,
        )

    return StatedLimits(
        position,
        least("velocity"),
        least("acceleration", "deceleration"),
        least("jerk"),
        least("effort"),
        tuple(notes),
    )


def _range_of_joint(
    stated: Mapping[str, float], soft: Mapping[str, float], source: str, where: str
) -> Interval | None:
    low, high = _FREE
    if (
        "lower" in stated or "upper" in stated
    ):  # the format says that either is 0 where it is absent
        low, high = stated.get("lower", 0.0), stated.get("upper", 0.0)
    low, high = max(low, soft.get(_SOFT[0], low)), min(high, soft.get(_SOFT[1], high))
    if low > high:
        problem = f"its positions have an empty range: the lowest is {low:g} and the highest {high:g}"
        raise InputError(problem, source=source, element=where)
    return None if (low, high) == _FREE else (low, high)


def _numbers(
    element: Any, keys: Sequence[str], source: str, where: str
) -> dict[str, float]:
    """The attributes that are there; infinite where a file says so, which some do instead of saying nothing."""
    found: dict[str, float] = {}
    for key in keys:
        text = None if element is None else element.get(key)
        if text is None:
            continue
        try:
            found[key] = float(text)
        except ValueError:
            found[key] = math.nan
        if math.isnan(found[key]):
            raise InputError(
                f"needs a number, found '{text}'",
                source=source,
                element=f"{where} {key}",
            )
    return found


# -- MJCF -------------------------------------------------------------------------------------------------------------


def _of_mjcf(robot: RobotFile) -> dict[str, StatedLimits]:
    from echelon.formats.mjcf.mjcf_equality import take_equalities
    from echelon.formats.mjcf.mjcf_model import compile_spec, import_mujoco, parse_spec

    kinds = import_mujoco().mjtJoint
    single = (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE))
    spec = parse_spec(robot.mjcf)
    take_equalities(spec, robot.source)
    forces = _actuator_forces(spec)  # before compiling, which removes them
    model = compile_spec(spec, robot.mjcf).model
    found = {}
    for index in range(model.njnt):
        if int(model.jnt_type[index]) not in single:
            continue
        name = str(model.joint(index).name)
        low, high = (
            (float(end) for end in model.jnt_range[index])
            if model.jnt_limited[index]
            else _FREE
        )
        if math.isnan(low) or math.isnan(high):
            raise InputError(
                "needs a range of two numbers",
                source=robot.source,
                element=f"joint '{name}' range",
            )
        force = forces.get(name, _FREE)
        if model.jnt_actfrclimited[index]:
            force = _clamped(
                force, [float(end) for end in model.jnt_actfrcrange[index]]
            )
        effort = min(-force[0], force[1])
        one_way = f"joint '{name}': its actuators push one way only, so they limit no effort here"
        found[name] = StatedLimits(
            None if (low, high) == _FREE else (low, high),
            effort=effort if 0 < effort < math.inf else None,
            notes=(one_way,) if effort <= 0 else (),
        )
    return found


def _actuator_forces(spec: Any) -> dict[str, Interval]:
    """The forces that the actuators of each joint can exert on it together."""
    from echelon.formats.mjcf.mjcf_reader import drives_joint

    found: dict[str, Interval] = {}
    for actuator in spec.actuators:
        gear = float(actuator.gear[0])
        if gear and drives_joint(actuator):
            low, high = sorted(
                gear * end
                for end in _actuator_force(actuator, spec.compiler.autolimits)
            )
            before = found.get(str(actuator.target), (0.0, 0.0))
            found[str(actuator.target)] = (before[0] + low, before[1] + high)
    return found


def _actuator_force(actuator: Any, automatic: bool) -> Interval:
    """The least and the largest force of an actuator, before its gear."""
    from echelon.formats.mjcf.mjcf_model import import_mujoco
    from echelon.formats.mjcf.mjcf_reader import is_motor

    mujoco = import_mujoco()

    def limited(flag: int, ends: Sequence[float]) -> bool:
        stated = automatic and any(ends)
        return bool(
            flag == mujoco.mjtLimited.mjLIMITED_TRUE
            or (flag == mujoco.mjtLimited.mjLIMITED_AUTO and stated)
        )

    force = _FREE
    if is_motor(actuator) and limited(actuator.ctrllimited, actuator.ctrlrange):
        low, high = sorted(
            float(actuator.gainprm[0]) * float(end) for end in actuator.ctrlrange
        )
        force = (low, high)
    if limited(actuator.forcelimited, actuator.forcerange):
        force = _clamped(force, [float(end) for end in actuator.forcerange])
    return force


def _clamped(interval: Interval, to: Sequence[float]) -> Interval:
    low, high = (min(max(end, to[0]), to[1]) for end in interval)
    return (low, high)
