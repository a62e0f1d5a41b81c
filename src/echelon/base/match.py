"""Two descriptions of one robot, such as a DH table and a URDF: the parameters of one by those of the other.

Frames, zero poses and directions of joints differ between descriptions; joint axes do not.  So the axes of the first
are laid over those of the second (:mod:`echelon.base.kinematic_match`).  Then ζ' = T ζ holds body by body, and both
sets of base parameters see the same if B' T = M B.  What the axes leave open (along and about the last one) is settled
by the zero poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, pi

import numpy as np

from echelon.base.derive import base_of
from echelon.base.kinematic_match import (
    Correspondence,
    correspondences,
)
from echelon.base.model import BaseModel
from echelon.robot import (
    Mechanism,
    MotionKind,
    Readable,
    frame_change,
    gravity_value,
)
from echelon.shared import PER_BODY, Floats, InputError, public


@public
@dataclass(frozen=True, repr=False)
class Match:
    """One robot in two descriptions.

    Made by :func:`echelon.match`.

    Attributes
    ----------
    first, second : BaseModel
    order : tuple of int
        The first's coordinate for every one of the second.
    sign, offset : array of shape (coordinates,)
        Coordinates of the second are sign · those of the first, in this order, + offset, rad or m.
    standard_map : array of shape (n, n)
        T: standard parameters of the second are T · those of the first.
    base_map : array of shape (r, r)
        M: base parameters of the second are M · those of the first.
    """

    first: BaseModel
    second: BaseModel
    order: tuple[int, ...]
    sign: Floats
    offset: Floats
    standard_map: Floats
    base_map: Floats

    def __str__(self) -> str:
        one = self.first.mechanism.name
        two = self.second.mechanism.name
        names = self.first.pivots
        lines = [f"{one} and {two}: the same {self.first.rank} base parameters"]
        for k, (name, row) in enumerate(
            zip(self.second.pivots, self.base_map, strict=True), 1
        ):
            terms = [
                f"{x:+.9g}·[{names[i]}]" for i, x in enumerate(row) if abs(x) > 1e-12
            ]
            plain = (
                " ".join(terms)
                .replace("+", "+ ")
                .replace("-", "− ")
                .replace(" 1·[", " [")
            )
            lines.append(f"{k:>3}  [{name}]' = {plain.removeprefix('+ ')}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Match({self.first.mechanism.name} = {self.second.mechanism.name}: {self.first.rank} base parameters)"


@public
def match(
    first: BaseModel | Mechanism | Readable,
    second: BaseModel | Mechanism | Readable,
    *,
    tolerance: float = 1e-6,
) -> Match:
    """Match two descriptions of the same robot, such as a DH table and a URDF.

    Parameters
    ----------
    first, second : BaseModel, Mechanism or path-like
        Sets, robots, or their files.  Trees of revolute and prismatic joints without effects; all symbols need values.
    tolerance : float
        How far apart joint axes may be, m and rad.

    Returns
    -------
    Match

    Raises
    ------
    InputError
        If the geometry differs (names the first joints that do), or one description sees what the other does not.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/rx90.yaml")
    >>> ec.match(robot, robot)
    Match(rx90 = rx90: 36 base parameters)
    """
    one, two = base_of(first), base_of(second)
    robots = one.mechanism, two.mechanism
    for robot in robots:
        _check(robot)
    down, their_down = (_down(robot) for robot in robots)
    if down.any() != their_down.any():
        raise InputError("one description has gravity, the other has none")
    pulls = down, their_down
    found = correspondences(*robots, tolerance, tolerance, pulls, same_positions=False)[
        0
    ]
    _check_geometry(found)
    standard = np.zeros((len(two.parameters), len(one.parameters)))
    starts, ends = (robot.first_column for robot in robots)
    order, sign, offset = [], [], []
    # every body has one motion, so that their places are the same
    for i, j in sorted(found.pairs, key=lambda pair: pair[1]):
        if (i in starts) != (j in ends):
            problem = "it has parameters in one description only"
            raise InputError(problem, element=f"body '{two.mechanism.bodies[j].name}'")
        if i in starts:
            ours = found.moves[i] @ found.first.frames[i]
            change = np.linalg.solve(found.second.frames[j], ours)
            rows, columns = (slice(k, k + PER_BODY) for k in (ends[j], starts[i]))
            standard[rows, columns] = frame_change(change)
        axes = found.first.axis(i, found.moves[i]), found.second.axis(j, np.eye(4))
        order.append(i)
        sign.append(np.sign(axes[0].direction @ axes[1].direction))
        shift = -sign[-1] * found.zeros.get(i, 0.0)
        # half a turn is positive
        offset.append(pi - (pi - shift) % (2 * pi) if axes[0].turns else shift)
    base_map = _base_map(one, two, standard, tolerance)
    coordinates = tuple(order), np.array(sign), np.array(offset)
    return Match(one, two, *coordinates, standard, base_map)


def _base_map(
    one: BaseModel, two: BaseModel, standard: Floats, tolerance: float
) -> Floats:
    """M of B' T = M B: the pivot columns of the left side, since those of B are unit vectors."""
    if one.rank != two.rank:
        raise InputError(
            f"the first description has {one.rank} base parameters, the second {two.rank}"
        )
    moved = two.B_float() @ standard
    found: Floats = moved[:, [one.parameters.index(name) for name in one.pivots]]
    rest = np.abs(moved - found @ one.B_float()).max(axis=1, initial=0.0)
    worst = int(np.argmax(rest)) if len(rest) else 0
    if len(rest) and rest[worst] > 10 * tolerance * max(
        1.0, float(np.abs(moved).max())
    ):
        raise InputError(
            f"the base parameter {two.pivots[worst]} of the second description is none of the first"
        )
    return found


def _check_geometry(found: Correspondence) -> None:
    """Refuse axes that differ by more than conventions, and name the first."""
    for difference in found.grave:
        if difference.kind == "gravity":
            raise InputError(
                f"the geometry differs: gravity has another direction, by {difference.size:.4g}"
            )
        names = {ours: theirs for theirs, ours in found.names.items()}
        size = f"{difference.size:.4g} m"
        if difference.unit == "rad":
            size = f"{degrees(difference.size):.4g}°"
        raise InputError(
            f"the geometry differs: their axes are {size} apart",
            element=f"joints '{difference.joint}' and '{names[difference.joint]}'",
        )


def _check(mechanism: Mechanism) -> None:
    if mechanism.couplings or mechanism.dependent_velocities or mechanism.effects:
        raise InputError(
            "couplings, loops and effects cannot be matched", element=mechanism.name
        )
    for body in mechanism.bodies:
        kinds = [motion.kind for motion in body.joint.motions]
        if kinds not in ([MotionKind.ROTATION], [MotionKind.TRANSLATION]):
            raise InputError(
                f"it is {body.joint.kind}; only revolute and prismatic joints can be matched",
                element=f"{mechanism.name}: joint '{body.joint.name}'",
            )
        if len(body.carried) not in (0, PER_BODY):
            raise InputError(
                "it carries some inertial parameters only",
                element=f"body '{body.name}'",
            )
    shared = next(
        (k for k in mechanism.carriers if len(mechanism.sharing[k]) > 1), None
    )
    if shared is not None:
        problem = "share their parameters, which cannot be matched: give each a label of its own"
        raise InputError(problem, element=f"bodies {mechanism.carrier_name(shared)}")


def _down(mechanism: Mechanism) -> Floats:
    """Direction of gravity; zero where there is none."""
    vector = gravity_value(mechanism)
    size = float(np.linalg.norm(vector))
    return vector / (size or 1.0)
