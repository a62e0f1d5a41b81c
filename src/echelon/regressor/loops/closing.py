"""Mechanisms with loops: whether they close, how they can move, and which coordinates the others depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf

import flint
import numpy as np

from echelon.arrays import Floats, one_thread
from echelon.errors import DegenerateSampleError, InputError, ShakyPoseError, SingularPoseError
from echelon.exact.field import DEFAULT_SEED, PrimeField, Residues, null_vectors, random_generator, rank
from echelon.mechanism.closed_pose import loop_motions, shown_loops
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import (
    all_symbols,
    has_values,
    inexact_symbols,
    known_values,
    symbol_roles,
    value_texts,
)
from echelon.mechanism.substitute import inexact_coupling, with_numeric_ratios
from echelon.program.tape import Program
from echelon.regressor.loops.assembly import NEARLY_FREE, Assembled, Assembly
from echelon.regressor.loops.closed_balls import ClosedBalls
from echelon.regressor.loops.closed_motion import RANK_TOLERANCE
from echelon.regressor.loops.closures import Loops
from echelon.regressor.loops.coordinates import independent_coordinates
from echelon.regressor.loops.curves import CurveSampler
from echelon.regressor.loops.recorded_loops import loops_of
from echelon.regressor.steps import Recorder

_ATTEMPTS = 2
_ORDER = 16  # of the coefficients of a curve that show whether the loops really move
_STANDS_STILL = 1e-3  # rad or m
_BALL_BITS = 512
_EXACTLY = (
    "Write what is meant exactly: directions and angles as expressions such as pi/3 or sqrt(2)/2, equal lengths as "
    "equal numbers"
)
_STATES, _NEAR = 8, 0.5  # random configurations at which the mobility is counted numerically, and how far they stray
# what a closed pose modulo a prime may take: operations to write down what is solved, and numbers that are added; five
# to ten seconds without values, one where closed forms in names depend on it, no more than balls take where none do
_LIMITS, _NAMED, _IN_NUMBERS = (inf, 1.5e7), (inf, 2e6), (1e5, 5e4)
_INDEPENDENT = (1e-3, 1e-5, 1e-6)  # singular values of independent motions, the wanted one first


@one_thread()
def close(mechanism: Mechanism, wanted: Sequence[str] | None = None, *, prefer: Sequence[str] = ()) -> Mechanism:
    """A mechanism with loops, its independent coordinates chosen: the wanted ones, or preferably some, such as drives.

    InputError if the loops cannot close or cannot move, or the wanted coordinates are too many, too few, or tied.
    """
    if not mechanism.closures:
        if wanted:
            raise InputError("without loops all coordinates are independent; leave it out", element="independent")
        return mechanism
    mechanism = with_numeric_ratios(mechanism)
    names, velocities = list(mechanism.velocities), None
    for name in wanted or ():
        if name not in names:
            raise InputError(f"there is no coordinate '{name}' (valid: {', '.join(names)})", element="independent")
    first = list(wanted) if wanted is not None else [name for name in prefer if name in names]
    if not has_values(mechanism):
        if inexact := inexact_coupling(mechanism):
            problem = f"with loops, {inexact[1]}: give all symbols values, ratios exact ones such as 3/2"
            raise InputError(problem, element=inexact[0])
        field, jacobian = _jacobian(_recorded(mechanism))
        freedom = np.array(null_vectors(jacobian, field), dtype=np.int64).reshape(-1, len(names))
        chosen = independent_coordinates(mechanism, lambda columns: rank(freedom[:, columns], field), first)
    else:
        real = _Real(mechanism)
        chosen, velocities = real.independent(first), real.velocities
        mechanism = _closed_exactly(replace(mechanism, independent=chosen), real)
    if wanted is not None:
        _check_wanted(mechanism, wanted, chosen, velocities)
        chosen = tuple(wanted)
    return replace(mechanism, independent=chosen)


def check_independent(mechanism: Mechanism, velocities: Floats) -> None:
    """Refuse stated independent coordinates that loops tie, by orthonormal free velocities (velocities, freedoms)."""
    columns = [mechanism.velocities.index(name) for name in mechanism.independent]
    ranked = partial(_rank, velocities, _INDEPENDENT[-1])
    if mechanism.independent and not ranked(columns) == len(columns) == velocities.shape[1]:
        chosen = independent_coordinates(mechanism, ranked, mechanism.independent, velocities)
        _check_wanted(mechanism, mechanism.independent, chosen, velocities)


def assembled(mechanism: Mechanism) -> Assembled | None:
    """What had to be moved to close the loops of a mechanism; None without loops, or if symbols have no values."""
    return Assembly(mechanism).assembled if mechanism.closures and has_values(mechanism) else None


class _Real:
    """The mechanism in double precision, near its own pose."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism, self.loops = mechanism, _recorded(mechanism)
        self.assembly = Assembly(mechanism, equations=self.loops.equations)
        pose = self.assembly.pose
        if self.assembly.assembled is not None:
            self.assembly.assembled.check()
        if self.assembly.mobility(pose[None])[0] == 0:
            raise InputError(_rigid(mechanism, self.assembly, self.assembly.moving_pose()))
        if self._locked(pose):
            raise InputError(_rigid(mechanism, self.assembly))
        self.states, _, _ = self.assembly.random_closed_states(random_generator(DEFAULT_SEED), _STATES, _NEAR)
        if np.ptp(self.states, axis=0).max() < _STANDS_STILL:
            raise InputError(_shaky(mechanism))
        self.mobility = int(self.assembly.mobility(self.states).min())
        self.velocities = self.assembly.free_velocities(self.states[0])

    def _locked(self, pose: Floats) -> bool:
        """Whether rounding has locked a loop while others, or what carries it, can move."""
        if self.assembly.easiest(pose)[2] > NEARLY_FREE:
            return False
        names, free = self.mechanism.velocities, np.abs(self.assembly.free_velocities(pose)).max(axis=1)
        moving = {name for name, speed in zip(names, free, strict=True) if speed > _STANDS_STILL}
        motions = {motion.name: moving.intersection(motion.velocities) for motion in self.mechanism.motions}
        return not all(any(motions[n] for n in loop_motions(self.mechanism, [c])) for c in self.mechanism.closures)

    @property
    def closes_in_balls(self) -> bool:
        """Whether balls show that the loops close exactly near the pose, as the numbers stand."""
        real = {f"q[{name}]": self.states[:, k] for k, name in enumerate(self.mechanism.positions)}
        real |= {name: np.array([value]) for name, value in known_values(self.mechanism).items()}
        texts = value_texts(self.mechanism, all_symbols(self.mechanism))
        try:
            with flint.ctx.workprec(_BALL_BITS):
                _ = ClosedBalls(self.loops.equations.program, self.loops, texts, real).poses
        except InputError:
            return False
        return True

    def singular(self) -> str:
        """That more motions are possible at the pose than near it; empty if not."""
        here = int(self.assembly.mobility(self.assembly.pose[None])[0])
        if here <= self.mobility:
            return ""
        return (
            f"no exact closed pose was found for {shown_loops(self.mechanism)}: the assembly pose is singular, with "
            f"{here} possible motions, and {self.mobility} nearby.  State a pose away from it, such as  "
            f"{self.assembly.written(self.states[-1])}"
        )

    def independent(self, first: Sequence[str]) -> tuple[str, ...]:
        """Coordinates that the others depend on; see :func:`independent_coordinates`."""
        chosen, here = self._chosen(self.velocities, first), self.assembly.free_velocities(self.assembly.pose)
        columns = [self.mechanism.velocities.index(name) for name in chosen]
        if not first and here.shape[1] == self.mobility and _rank(here, _INDEPENDENT[-1], columns) < self.mobility:
            return self._chosen(here, first)  # arms of a Delta robot do not move it where all its rods are parallel
        return chosen

    def _chosen(self, velocities: Floats, first: Sequence[str]) -> tuple[str, ...]:
        chosen: tuple[str, ...] = ()
        for threshold in _INDEPENDENT:  # what hardly moves on its own only if nothing else does
            chosen = independent_coordinates(self.mechanism, partial(_rank, velocities, threshold), first, velocities)
            if len(chosen) == self.mobility:
                break
        return chosen


def _rank(velocities: Floats, threshold: float, columns: Sequence[int]) -> int:
    return int((np.linalg.svd(velocities[list(columns)], compute_uv=False) > threshold).sum()) if columns else 0


def _closed_exactly(mechanism: Mechanism, real: _Real) -> Mechanism:
    """The mechanism, if its loops close exactly and move as in doubles: modulo a prime, or else in ball arithmetic."""
    if mechanism.closed_in_balls:
        return mechanism
    problem = ""
    if inexact := inexact_coupling(mechanism):
        problem = unsolved(mechanism, f"{inexact[0]}: {inexact[1]}, and balls do not show one")
    else:
        roles = symbol_roles(mechanism)
        limits = _NAMED if roles.symbols - roles.angles else _IN_NUMBERS
        try:
            field, jacobian = _jacobian(replace(real.loops, mechanism=mechanism), limits)
        except InputError as error:
            problem = str(error)
        else:
            freedom = jacobian.shape[1] - rank(jacobian, field)
            if freedom >= real.mobility:
                return mechanism
            problem = _locked(mechanism, freedom, real)
    if real.closes_in_balls:
        return replace(mechanism, closed_in_balls=True)
    raise InputError(real.singular() or problem)


def _recorded(mechanism: Mechanism) -> Loops:
    return loops_of(mechanism, Recorder(mechanism, Program()))


def _jacobian(loops: Loops, limits: tuple[float, float] = _LIMITS) -> tuple[PrimeField, Residues]:
    """The Jacobian of the closures at a closed pose of a random geometry, found within some limits."""
    mechanism, rng, (work, search) = loops.mechanism, random_generator(DEFAULT_SEED), limits
    sampler = CurveSampler(loops.equations.program, [], replace(loops, work=work, search=search))
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            return field, sampler.jacobian(field, rng, _ORDER)
        except DegenerateSampleError:
            continue
        except ShakyPoseError:
            raise InputError(_shaky(mechanism)) from None
        except SingularPoseError as error:
            raise InputError(unsolved(mechanism, str(error))) from None
    raise InputError(unsolved(mechanism, "the equations have no solution at random points"))


def _rigid(mechanism: Mechanism, assembly: Assembly, moving: Floats | None = None) -> str:
    """That the loops leave no motion: what stops the easiest one, and another pose where they move, if there is one."""
    coordinate, closure, size = assembly.easiest(assembly.pose)
    problem = (
        f"{shown_loops(mechanism)} leave no motion: that of '{coordinate}' is stopped by "
        f"'{closure}' (singular value {size:.1g} of the equations)"
    )
    if moving is not None:
        return f"{problem}.  They move where they are put together otherwise: write  {assembly.written(moving)}"
    if size < NEARLY_FREE:
        return f"{problem}.  If rounding has locked it: {_EXACTLY}"
    return f"{problem}.  Check the frames of that closure, or give it a kind that holds less, such as  joint: spherical"


def _shaky(mechanism: Mechanism) -> str:
    return (
        f"{shown_loops(mechanism)} can move infinitesimally, but not really.  If they are meant to "
        f"move, rounding has locked them.  {_EXACTLY}"
    )


def unsolved(mechanism: Mechanism, reason: str) -> str:
    """That no exact closed pose was found."""
    return (
        f"no exact closed pose was found for {shown_loops(mechanism)}: {reason}.  Give frames with which the loops are "
        "closed where all coordinates are zero, or at an assembly pose of multiples of 15 degrees (leave out the "
        "second frame and it is where the first one is)"
    )


def _check_wanted(
    mechanism: Mechanism, wanted: Sequence[str], chosen: Sequence[str], velocities: Floats | None = None
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
    raise InputError(f"{problem}.  Write  independent: [{', '.join(chosen)}]", element="independent")


def _follows(mechanism: Mechanism, name: str, chosen: Sequence[str], velocities: Floats | None) -> str:
    """That a coordinate depends on the chosen ones, through which loops, and how much."""
    said = f"'{name}' follows from the others through {shown_loops(mechanism, name)}"
    if velocities is None or not chosen:
        return said
    place = mechanism.velocities.index
    ratios = np.linalg.lstsq(velocities[[place(n) for n in chosen]].T, velocities[place(name)], rcond=None)[0]
    most = int(np.abs(ratios).argmax())
    more = "" if np.abs(ratios).sum() == np.abs(ratios[most]) else ", among others"
    return f"{said}: its rate is {ratios[most]:.2g} times that of '{chosen[most]}'{more}"


def _independent(count: int) -> str:
    return "1 coordinate is independent" if count == 1 else f"{count} coordinates are independent"


def _locked(mechanism: Mechanism, freedom: int, real: _Real) -> str:
    sizes = real.assembly.singular_values(real.states).max(axis=0)
    size = sizes[sizes <= RANK_TOLERANCE].max(initial=0.0)
    return (
        f"rounding has locked {shown_loops(mechanism)}: a mobility of {real.mobility} is meant, which their equations "
        f"resist by no more than {size:.1g} (singular value), and to the letter it is {freedom}.  "
        + broken_relations(mechanism)
    )


def broken_relations(mechanism: Mechanism) -> str:
    """Why relations between stated numbers may not hold to the letter, and what to write instead."""
    names = ", ".join(dict.fromkeys(mechanism.symbols[name].meaning for name in inexact_symbols(mechanism)))
    if names:
        return (
            f"Directions of irrational length, such as (1, 2, 0), count as generic ({names}), so points that are "
            "stated along them lie beside them: put the origins of these joints where axes meet, or take directions "
            "such as (3, 4, 0)"
        )
    return (
        "Rounded numbers, or several turns by general angles one after another, break relations such as parallel axes: "
        f"state frames that are turned by multiples of 15 degrees, with axes in them.  {_EXACTLY}"
    )


def locked_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints that loops keep from moving in closed poses near the assembly pose, of coupled ones too.

    Where symbols have no values, these are the joints that stand still in any geometry.
    """
    if not mechanism.closures:
        return ()
    if has_values(mechanism):
        assembly = Assembly(mechanism)
        states, _, _ = assembly.random_closed_states(random_generator(DEFAULT_SEED), _STATES, _NEAR)
        # a joint may stand still in one pose, such as a dead centre, but not in all
        speeds = np.max([np.abs(assembly.free_velocities(q)).max(axis=1, initial=0.0) for q in states], axis=0)
    else:
        field, jacobian = _jacobian(_recorded(mechanism))
        freedom = np.array(null_vectors(jacobian, field), dtype=np.int64).reshape(-1, len(mechanism.velocities))
        speeds = freedom.any(axis=0).astype(float)
    moving = {name for name, speed in zip(mechanism.velocities, speeds, strict=True) if speed > RANK_TOLERANCE}
    locked = {motion.name for motion in mechanism.free_motions if moving.isdisjoint(motion.velocities)}
    followers = {c.coordinate for c in mechanism.couplings if locked.issuperset(name for name, _ in c.terms)}
    return tuple(motion.name for motion in mechanism.motions if motion.name in locked | followers)


def nearly_free(mechanism: Mechanism) -> list[str]:
    """What is said of motions that the loops nearly allow; nothing where symbols have no values."""
    if not has_values(mechanism):
        return []
    assembly = Assembly(mechanism)
    here = assembly.singular_values(assembly.pose[None])
    if not (here[here > RANK_TOLERANCE] < NEARLY_FREE).any():
        return []
    states, _, _ = assembly.random_closed_states(random_generator(DEFAULT_SEED), _STATES, _NEAR)
    sizes = np.vstack([here, assembly.singular_values(states)]).max(axis=0)
    near = sizes[(sizes > RANK_TOLERANCE) & (sizes < NEARLY_FREE)]
    if not near.size:
        return []
    freedoms, (coordinate, closure, _) = len(mechanism.independent_velocities), assembly.easiest(states[-1])
    more = "a motion" if len(near) == 1 else f"{len(near)} motions"
    return [
        f"{shown_loops(mechanism)} nearly allow {more} (singular value {near.max():.1g} of their "
        f"equations): that of '{coordinate}' is stopped by closure '{closure}'.  If rounding has locked "
        f"it, the mechanism is meant to have {freedoms + len(near)} degrees of freedom instead of {freedoms}: write "
        "directions and angles as expressions such as pi/3, lengths exactly"
    ]
