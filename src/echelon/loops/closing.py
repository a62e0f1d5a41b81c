"""Mechanisms with loops: whether they close, how they can move, and which coordinates the others depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import flint
import numpy as np

from echelon.algebra import BALL_BITS, Program
from echelon.loops.assembly import NEARLY_FREE, Assembly
from echelon.loops.closed_balls import closed_states
from echelon.loops.closed_motion import CLEAR, NEGLIGIBLE, ClosedMotion, places
from echelon.loops.coordinates import independent_coordinates
from echelon.loops.recorded_loops import floats_of, loops_of
from echelon.robot import (
    Mechanism,
    Recorder,
    has_values,
    inexact_coupling,
    loop_motions,
    shown_loops,
    with_numeric_ratios,
)
from echelon.shared import Floats, InputError, one_thread

_EXACTLY = "Write exact values: directions and angles as expressions such as pi/3 or sqrt(2)/2, equal lengths as equal numbers"


@one_thread()
def close(
    mechanism: Mechanism,
    wanted: Sequence[str] | None = None,
    *,
    prefer: Sequence[str] = (),
) -> Mechanism:
    """A mechanism with loops, its independent coordinates chosen: the wanted ones, or preferably some, such as drives.

    InputError if the loops cannot close or cannot move, or the wanted coordinates are too many, too few, or tied.
    """
    if not mechanism.closures:
        if wanted:
            raise InputError(
                "without loops all coordinates are independent; leave it out",
                element="independent",
            )
        return mechanism
    mechanism = with_numeric_ratios(mechanism)
    names = list(mechanism.velocities)
    for name in wanted or ():
        if name not in names:
            raise InputError(
                f"there is no coordinate '{name}' (valid: {', '.join(names)})",
                element="independent",
            )
    first = (
        list(wanted)
        if wanted is not None
        else [name for name in prefer if name in names]
    )
    if not has_values(mechanism) and (inexact := inexact_coupling(mechanism)):
        problem = f"with loops, {inexact[1]}: give all symbols values, ratios exact ones such as 3/2"
        raise InputError(problem, element=inexact[0])
    real = _Real(mechanism)
    chosen = real.independent(first)
    real.check()
    if wanted is not None:
        _check_wanted(mechanism, wanted, chosen, real.velocities)
        chosen = tuple(wanted)
    return replace(mechanism, independent=chosen)


def check_independent(mechanism: Mechanism, velocities: Floats) -> None:
    """Refuse stated independent coordinates that loops tie, by orthonormal free velocities (velocities, freedoms)."""
    columns = [mechanism.velocities.index(name) for name in mechanism.independent]
    ranked = partial(_rank, velocities, NEGLIGIBLE)
    if (
        mechanism.independent
        and not ranked(columns) == len(columns) == velocities.shape[1]
    ):
        chosen = independent_coordinates(
            mechanism, ranked, mechanism.independent, velocities
        )
        _check_wanted(mechanism, mechanism.independent, chosen, velocities)


class _Real:
    """The mechanism in double precision, near its own pose."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.loops = loops_of(mechanism, Recorder(mechanism, Program()))
        self.assembly = self.loops.assembly
        pose = self.assembly.pose
        if self.assembly.assembled is not None and has_values(mechanism):
            self.assembly.assembled.check()
        if self.assembly.mobility(pose[None])[0] == 0:
            raise InputError(
                _rigid(mechanism, self.assembly, self.assembly.moving_pose())
            )
        if self._locked(pose):
            raise InputError(_rigid(mechanism, self.assembly))
        self.states = self.loops.near_poses
        if np.ptp(self.states, axis=0).max() < CLEAR or self._held_elsewhere:
            raise InputError(_shaky(mechanism))
        self.mobility = int(self.assembly.mobility(self.states).min())
        self.velocities = self.assembly.free_velocities(self.states[0])

    @property
    def _held_elsewhere(self) -> bool:
        """Whether equations that rounding seemed to make redundant at the pose stop motions away from it.

        At the end of its reach a chain resists no motion to first order; what rounding makes does not grow so.
        """
        held = len(self.assembly.held)
        every = ClosedMotion(
            self.mechanism, floats_of(self.loops.values), self.loops.equations
        )
        sizes = every.singular_values(self.states).max(axis=0)
        return held < len(sizes) and bool(sizes[held] > self.assembly.tolerance)

    def check(self) -> None:
        """Refuse loops that are not shown to close near the pose in ball arithmetic, as the numbers stand."""
        with flint.ctx.workprec(BALL_BITS):
            _ = closed_states(self.loops, [{}], self.states[:1]).poses

    def _locked(self, pose: Floats) -> bool:
        """Whether rounding has locked a loop while others, or what carries it, can move."""
        if self.assembly.easiest(pose)[2] > NEARLY_FREE:
            return False
        moving = _moving(self.mechanism, [self.assembly.free_velocities(pose)], CLEAR)
        return any(
            moving.isdisjoint(loop_motions(self.mechanism, [c]))
            for c in self.mechanism.closures
        )

    def independent(self, first: Sequence[str]) -> tuple[str, ...]:
        """Coordinates that the others depend on; see :func:`independent_coordinates`."""
        chosen = self._chosen(self.velocities, first)
        here = self.assembly.free_velocities(self.assembly.pose)
        columns = [self.mechanism.velocities.index(name) for name in chosen]
        if (
            not first
            and here.shape[1] == self.mobility
            and _rank(here, NEGLIGIBLE, columns) < self.mobility
        ):
            return self._chosen(
                here, first
            )  # arms of a Delta robot do not move it where all its rods are parallel
        return chosen

    def _chosen(self, velocities: Floats, first: Sequence[str]) -> tuple[str, ...]:
        chosen: tuple[str, ...] = ()
        for least in (
            CLEAR,
            NEGLIGIBLE,
        ):  # what hardly moves on its own only if nothing else does
            chosen = independent_coordinates(
                self.mechanism, partial(_rank, velocities, least), first, velocities
            )
            if len(chosen) == self.mobility:
                break
        return chosen


def _rank(velocities: Floats, least: float, columns: Sequence[int]) -> int:
    return int(
        (np.linalg.svd(velocities[list(columns)], compute_uv=False) > least).sum()
    )


def _rigid(
    mechanism: Mechanism, assembly: Assembly, moving: Floats | None = None
) -> str:
    """That the loops leave no motion: what stops the easiest one, and another pose where they move, if there is one."""
    coordinate, closure, size = assembly.easiest(assembly.pose)
    problem = (
        f"{shown_loops(mechanism)} leave no motion: that of '{coordinate}' is stopped by "
        f"'{closure}' (singular value {size:.1g} of the equations)"
    )
    if moving is not None:
        return f"{problem}.  They move in another assembly: write  {assembly.written(moving)}"
    if size < NEARLY_FREE:
        return f"{problem}.  If rounding has locked it: {_EXACTLY}"
    return f"{problem}.  Check the frames of that closure, or give it a kind that holds less, such as  joint: spherical"


def _shaky(mechanism: Mechanism) -> str:
    return (
        f"{shown_loops(mechanism)} can move infinitesimally, but not really.  If they should move, rounding has "
        f"locked them.  {_EXACTLY}"
    )


def _check_wanted(
    mechanism: Mechanism,
    wanted: Sequence[str],
    chosen: Sequence[str],
    velocities: Floats | None = None,
) -> None:
    """Refuse wanted coordinates that are not as many as are chosen, or follow from others."""
    bound = [name for name in wanted if name not in chosen]
    more = ", ".join(name for name in chosen if name not in wanted)
    count = f"{_independent(len(chosen))}, not {len(wanted)}"
    if len(wanted) < len(chosen):
        problem = f"{count}; add for example {more}"
    elif bound and len(wanted) > len(chosen):
        problem = f"{count}; {_follows(mechanism, bound[0], chosen, velocities)}"
    elif bound:
        problem = f"{_follows(mechanism, bound[0], chosen, velocities)}; take for example {more}"
    else:
        return
    raise InputError(
        f"{problem}.  Write  independent: [{', '.join(chosen)}]", element="independent"
    )


def _follows(
    mechanism: Mechanism, name: str, chosen: Sequence[str], velocities: Floats | None
) -> str:
    """That a coordinate depends on the chosen ones, through which loops, and how much."""
    said = f"'{name}' follows from the others through {shown_loops(mechanism, name)}"
    if velocities is None or not chosen:
        return said
    place = mechanism.velocities.index
    ratios = np.linalg.lstsq(
        velocities[[place(n) for n in chosen]].T, velocities[place(name)], rcond=None
    )[0]
    most = int(np.abs(ratios).argmax())
    more = "" if np.abs(ratios).sum() == np.abs(ratios[most]) else ", among others"
    return (
        f"{said}: its rate is {ratios[most]:.2g} times that of '{chosen[most]}'{more}"
    )


def _independent(count: int) -> str:
    if count == 1:
        return "1 coordinate is independent"
    return f"{count} coordinates are independent"


def locked_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints that loops keep from moving in closed poses near the assembly pose, of coupled ones too."""
    loops = loops_of(mechanism, Recorder(mechanism, Program()))
    states, assembly = loops.near_poses, loops.assembly
    # a joint may stand still in one pose, such as a dead centre, but not in all
    moving = _moving(
        mechanism, [assembly.free_velocities(q) for q in states], NEGLIGIBLE
    )
    locked = {motion.name for motion in mechanism.free_motions} - moving
    followers = {
        c.coordinate
        for c in mechanism.couplings
        if locked.issuperset(name for name, _ in c.terms)
    }
    return tuple(
        motion.name for motion in mechanism.motions if motion.name in locked | followers
    )


def _moving(mechanism: Mechanism, poses: Sequence[Floats], least: float) -> set[str]:
    """Names of motions that move at any of some poses, by orthonormal velocities (velocities, freedoms) there."""
    speeds = np.max(
        [np.abs(velocities).max(axis=1, initial=0.0) for velocities in poses], axis=0
    )
    return {
        motion.name
        for motion, _, place in places(mechanism)
        if speeds[place].max() > least
    }
