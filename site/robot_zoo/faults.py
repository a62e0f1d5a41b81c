"""Faults of the inertias that a robot file states, and whether any torque can show them.

A body is possible if its pseudo-inertia J is positive semidefinite (Wensing, Kim & Slotine 2018).  Torques contain the
parameters ζ of a body only as B ζ, with the body's columns of B; so what matters is whether *some* ζ + z with B z = 0
has J ⪰ 0.  That is a linear matrix inequality in at most ten unknowns, which a barrier method decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echelon.base.model import BaseModel
from echelon.excite.problem.robot_shapes import carrying_bodies
from echelon.excite.problem.shapes import placed
from echelon.formats.literal import LiteralTree
from echelon.formats.robot_file import RobotFile
from echelon.robot.impossible import ROUNDED, impossibility, principal_moments
from echelon.robot.inertia import pseudo_inertia
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import characteristic_length
from echelon.shared.arrays import Floats
from echelon.shared.conventions import PER_BODY
from echelon.shared.errors import EchelonError, one_line

_WIDE = 3.0  # a radius of gyration of so many lengths of the robot is a placeholder
_LIGHT = 1e-3  # kg; points of less mass only mark a frame
_STEPS = 60
MISSING = "it has a shape, but no inertia is stated"
POINT = "it has mass, but no rotational inertia: it is a point"


@dataclass(frozen=True)
class Fault:
    """A fault of a link, and whether torques show it."""

    link: str
    problem: str
    matters: (
        bool | None
    )  # whether torques show it; None where that could not be decided
    reason: str  # why it does, or does not


def faults(base: BaseModel) -> list[Fault]:
    """Faults of all links, in the order of the file."""
    found = []
    verdicts: dict[tuple[int, bool], tuple[bool | None, str]] = {}
    for link, body, problem in _problems(base):
        missing = problem in (MISSING, POINT)
        if (body, missing) not in verdicts:
            verdicts[body, missing] = _verdict(base, body, missing=missing)
        found.append(Fault(one_line(link), problem, *verdicts[body, missing]))
    return found


def _problems(base: BaseModel) -> Iterator[tuple[str, int, str]]:
    """Links with a problem: name, the body that it is part of, and the problem."""
    size, bodies = characteristic_length(base.mechanism), base.mechanism.bodies
    robot, tree = read_from(base.mechanism)
    if tree is None:
        stated = [(body.name, k, body.inertial) for k, body in enumerate(bodies)]
    else:
        places = carrying_bodies(tree, base.mechanism)
        stated = [
            (link.name, body, link.inertial)
            for link, (body, _) in zip(tree.links, places, strict=True)
        ]
    for name, body, inertial in stated:
        problem = "" if inertial is None else problem_of(np.array(inertial), size)
        if problem:
            yield name, body, problem
    if robot is not None:
        shown = {body for name, body, _ in stated if name in _solid(robot)}
        yield from (
            (body.name, k, MISSING)
            for k, body in enumerate(bodies)
            if body.inertial is None and k in shown
        )


def read_from(mechanism: Mechanism) -> tuple[RobotFile | None, LiteralTree | None]:
    """The URDF, SDF or MJCF file that a robot was read from, and its links; None where a description states both."""
    reading = mechanism.reading
    robot = (
        reading.file.robot
        if reading is not None and isinstance(reading.file, RobotFile)
        else None
    )
    if reading is None or robot is None:
        return None, None
    return robot, robot.tree(mimics=not reading.options.independent_mimics)


def _solid(robot: RobotFile) -> set[str]:
    """Links of a URDF that have a shape."""
    links = robot.root.findall("link") if robot.root.tag == "robot" else []
    return {
        link.get("name")
        for link in links
        if link.find("visual") is not None or link.find("collision") is not None
    }


def problem_of(inertial: Floats, size: float) -> str:
    """The fault in a body's standard parameters, shape (10,); empty if there is none.  ``size`` of the robot, m."""
    impossible, mass = impossibility(inertial), inertial[-1]
    if impossible or mass == 0:
        return impossible
    largest = float(principal_moments(inertial)[-1])
    if largest == 0:
        return POINT if mass > _LIGHT else ""
    radius = float(np.sqrt(largest / mass))
    if radius > _WIDE * size:
        return f"its radius of gyration is {radius:.3g} m, on a robot with lengths of at most {size:.3g} m: a placeholder"
    return ""


def _verdict(base: BaseModel, body: int, *, missing: bool) -> tuple[bool | None, str]:
    """Whether torques can show a fault of a body, an inertia that is wrong or missing, and why."""
    first = base.mechanism.first_column.get(body)
    if body == GROUND:
        return False, "it never moves, so no torque contains it"
    if first is None or len(base.mechanism.bodies[body].carried) < PER_BODY:
        return None, "its body carries parameters only in part"
    try:
        columns = base.B_float()[:, first : first + PER_BODY]
    except EchelonError as error:
        return None, f"not decided: {one_line(str(error))}"
    entered = [
        name for name, row in zip(base.pivots, columns, strict=True) if row.any()
    ]
    if not entered:
        return False, "no torque contains any of its parameters"
    if missing:
        return (
            True,
            f"its true inertia enters {len(entered)} base parameters: {_some(entered)}",
        )
    inertial = base.mechanism.bodies[body].inertial
    if inertial is None:
        return None, "not decided: its body states no inertia"
    values = np.array(inertial)
    _, sizes, directions = np.linalg.svd(
        columns
    )  # entries of B are lengths to some power
    unseen = directions[
        int((sizes > 1e-9 * sizes[0]).sum()) :
    ]  # vectors z with B z = 0
    if can_exist(values, np.zeros((0, PER_BODY))):
        return False, "with what is fixed to it, it makes a body that can exist"
    if len(unseen) and can_exist(values, unseen):
        where = f"{len(unseen)} combinations" if len(unseen) > 1 else "a combination"
        return (
            False,
            f"the violation lies in {where} of its parameters that no torque contains",
        )
    return (
        True,
        f"torques show it in {_some(entered)}: no body with the same torques in its place can exist",
    )


def _some(names: list[str]) -> str:
    return ", ".join(map(one_line, names[:6])) + (
        f" and {len(names) - 6} more" if len(names) > 6 else ""
    )


def can_exist(values: Floats, free: Floats) -> bool:
    """Whether a body with parameters ζ + zᵀN can exist for some z; values of shape (10,), N of shape (k, 10)."""
    # the least t with J(ζ + zᵀN) + t·1 ⪰ 0 is sought in a scale where J is about 1: minimise t/μ − log det for ever
    # smaller μ by Newton's steps (Boyd & Vandenberghe 2004, 11.3), until t is negative or cannot become so
    normal = _normaliser(values)
    start = normal @ pseudo_inertia(values) @ normal.T
    least = float(np.linalg.eigvalsh(start)[0])
    if least >= -ROUNDED or not len(free):
        return least >= -ROUNDED
    basis = normal @ pseudo_inertia(free) @ normal.T
    basis /= np.linalg.norm(basis, axis=(1, 2))[:, None, None]
    directions = np.concatenate([basis, np.eye(4)[None]])
    x, cost = np.zeros(len(directions)), np.eye(len(directions))[-1]
    x[-1], mu = 1 - 2 * least, 1.0
    for _ in range(_STEPS):
        for _ in range(_STEPS):
            inverse = np.linalg.inv(start + np.tensordot(x, directions, 1))
            turned = inverse @ directions
            gradient = cost / mu - np.trace(turned, axis1=1, axis2=2)
            step = -np.linalg.lstsq(
                np.einsum("iab,jba->ij", turned, turned), gradient, rcond=None
            )[0]
            decrement = float(-gradient @ step)
            x = x + step / (
                1 + np.sqrt(max(decrement, 0.0))
            )  # a damped step stays inside
            if x[-1] < 0:
                return True
            if decrement < 1e-6:
                break
        if x[-1] > 8 * mu:  # the gap is 4 μ: no smaller t can be negative
            return False
        mu /= 5
        if mu < ROUNDED / 10:
            return True
    return False


def _normaliser(values: Floats) -> Floats:
    """A matrix G for which G J Gᵀ is about 1, with the centre of mass at the origin; shape (4, 4)."""
    mass = float(values[-1]) if values[-1] > 0 else 1.0
    moved = placed(np.eye(3), -values[6:9] / mass)
    second = float(
        np.abs(np.diagonal(moved @ pseudo_inertia(values) @ moved.T)[:3]).max()
    )
    second = max(
        second, 1e-9 * float(np.abs(values[:6]).max()), 1e-12 * mass
    )  # what is smaller is rounding
    return np.diag(np.array([second, second, second, mass]) ** -0.5) @ moved
