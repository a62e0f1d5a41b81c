"""Structure: which standard parameters are representatives (pivots) and which depend on others.

Cost must follow the chain and not the whole robot, so dependent columns are first looked for joint by joint: whatever
parameters of a body can be moved to its parent when the *parent moves freely* can be moved in every mechanism, because
the true motions of the parent are among the free ones.  These pairs of bodies are tiny.  Of what remains, most columns
are shown to be independent block by block (see :mod:`echelon.regressor.blocks`), which are tiny, too.  The rest, near
the base and around couplings, is eliminated at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from operator import matmul

import numpy as np

from echelon.arrays import one_thread
from echelon.base.ball_relations import BallRelations, ball_relations
from echelon.base.modes import Dependence, InMode, Mode, elsewhere, find_modes, in_mode
from echelon.base.near_pose import NearPose
from echelon.base.own_mode import OwnMode
from echelon.doors import public
from echelon.errors import (
    BrokenRelationsError,
    DegenerateSampleError,
    EchelonError,
    InputError,
    OtherModeError,
    SingularPoseError,
    UnknownRelationsError,
)
from echelon.exact.field import PrimeField, by_pivots, rank
from echelon.mechanism.closed_pose import shown_loops
from echelon.mechanism.joint import ALL, GROUND, Body, Joint, Motion, Placement, Step, floating_motions
from echelon.mechanism.mechanism import Cut, Mechanism
from echelon.mechanism.stated import UNITS, has_values, inexact_symbols, stated_values
from echelon.program.schedule import FieldSampler
from echelon.regressor.linear_forms import FEW_COLUMNS, LinearForms, Rows, energy_changes, energy_form, rows_of
from echelon.regressor.loops.closing import broken_relations, check_independent, unsolved
from echelon.regressor.loops.curves import CurveSampler

_SURPLUS_ROWS = 8
_ATTEMPTS, _PASSES = 8, 2
_SURPLUS_ORDER = 16
LEFT_TO_BALLS = (OtherModeError, SingularPoseError, UnknownRelationsError, BrokenRelationsError)
"""Why primes may not tell the structure of a mechanism with loops where ball arithmetic does."""

SEARCH = 1e6
"""Numbers that are added for a closed pose modulo a prime in half a second; balls take no longer then."""


@public
@dataclass(frozen=True)
class Structure:
    """Pivots of B and where the dependence of every other column can be found.

    Attributes
    ----------
    parameters : int
        Number of standard parameters n.
    pivots : tuple of int
        Columns of the representatives; their number is the rank.
    by_joint : mapping of int to tuple of int
        For a body's index, its columns that depend on its other columns and its parent's, whatever the motion.
    by_robot : mapping of int to tuple of int
        For every other dependent column, the pivots it depends on (none: the column is zero).
    modes : tuple of int
        With loops, the ranks of all assembly modes that were seen.
    accepted : InMode, optional
        Sorts out poses in other assembly modes, if there are several.
    singular : bool
        Whether they may meet at the stated assembly pose: with primes the one with the lowest rank was taken.
    order : int
        With loops, the number of coefficients along curves that showed the dependences.
    balls : BallRelations, optional
        With loops of which no exact closed pose is known, what was found in ball arithmetic instead.
    """

    parameters: int
    pivots: tuple[int, ...]
    by_joint: Mapping[int, tuple[int, ...]]
    by_robot: Mapping[int, tuple[int, ...]]
    modes: tuple[int, ...] = ()
    accepted: InMode | None = None
    singular: bool = False
    order: int = 0
    balls: BallRelations | None = None

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.pivots)

    @property
    def tells_mode(self) -> bool:
        """Whether coefficients tell its assembly mode from others with the same dependences."""
        return self.accepted is None or self.accepted.mode.marks is not None

    @property
    def doubt(self) -> str:
        """What speaks against the rank; empty if nothing does."""
        return self.where_modes_meet or (self.balls.doubt if self.balls else "")

    @property
    def where_modes_meet(self) -> str:
        """Doubt about a singular assembly pose; empty if it is regular."""
        if self.singular:
            ranks = ", ".join(map(str, sorted(set(self.modes))))
            taken = f"the lowest rank that was seen was taken ({ranks})" if ranks else "what shows near it was counted"
            return (
                "the assembly pose is singular: more motions are possible there than near it, and ways of assembly may "
                f"meet; {taken}: state a pose away from it"
            )
        return ""

    def on_curves(self, forms: LinearForms) -> LinearForms:
        """Forms with loops where the structure holds: in its assembly mode, with as many coefficients as show it.

        Parameters
        ----------
        forms : LinearForms
            Of the same mechanism.

        Raises
        ------
        InputError
            If it is not known which of several modes with the same dependence it is.
        """
        if forms.loops is None or self.balls is not None:
            return forms
        # few freedoms that have to show many parameters need more
        each = self.rank // max(1, len(forms.loops.mechanism.independent))
        order = max(forms.loops.order, self.order, each + _SURPLUS_ORDER)
        stated = forms.loops.stated and not self.singular
        return in_mode(replace(forms, loops=replace(forms.loops, order=order, stated=stated)), self.accepted)


def find_structure(mechanism: Mechanism, rng: np.random.Generator, search: float | None = None) -> Structure:
    """Rank and pivots in base-to-tip order, for generic values of the geometry symbols.

    SingularPoseError if no closed pose modulo a prime is found, with at most so many numbers added for it.
    """
    if mechanism.closed_in_balls:
        return _from_balls(mechanism, rng)
    by_joint = _dependent_by_joint(mechanism, rng)
    local = {column for columns in by_joint.values() for column in columns}
    remaining = [c for c in range(len(mechanism.parameters)) if c not in local]
    whole = rows_of(mechanism)
    if search is not None and (loops := whole.forms.loops):
        whole = Rows(replace(whole.forms, loops=replace(loops, search=search)), whole.auxiliary)
    settled = _shown_by_blocks(mechanism, whole, remaining, rng)
    remaining = [c for c in remaining if c not in settled]
    rows, accepted, order, singular = whole.columns(remaining), None, 0, False
    modes: list[Mode] = []
    if mechanism.closures:
        try:
            modes, mode, singular = _modes(mechanism, rows, remaining, rng)
        except SingularPoseError as error:
            raise SingularPoseError(unsolved(mechanism, str(error))) from None
        supports, order, rows = mode.dependence, mode.order, elsewhere(rows) if singular else rows
        accepted = InMode(rows, mode) if len(modes) > 1 or mode.marks is None else None
    else:
        supports = _confirmed_dependence(rows, rng)
    pivots = tuple(sorted((*settled, *(remaining[k] for k in range(len(remaining)) if k not in supports))))
    by_robot = {remaining[k]: tuple(remaining[s] for s in support) for k, support in supports.items()}
    ranks = tuple(len(remaining) - len(mode.dependence) for mode in modes)
    return Structure(len(mechanism.parameters), pivots, by_joint, by_robot, ranks, accepted, singular, order)


def settled_structure(mechanism: Mechanism, rng: np.random.Generator) -> tuple[Mechanism, Structure]:
    """The structure, in ball arithmetic where primes do not show the own mode, and the mechanism that it belongs to."""
    search = None if stated_values(mechanism).names else SEARCH
    try:
        return mechanism, find_structure(mechanism, rng, search)
    except LEFT_TO_BALLS as error:
        return in_balls_instead(mechanism, rng, error)


def in_balls_instead(
    mechanism: Mechanism, rng: np.random.Generator, error: EchelonError
) -> tuple[Mechanism, Structure]:
    """A mechanism with loops that is closed in ball arithmetic, and its structure there, where primes end in an error.

    That error if balls do not tell, either.
    """
    if mechanism.closed_in_balls or not mechanism.closures:
        raise error
    closed = replace(mechanism, closed_in_balls=True)
    try:
        found = find_structure(closed, rng)
    except (InputError, SingularPoseError, UnknownRelationsError):
        raise error from None
    # relations that rounding has broken are not restored by more digits
    if isinstance(error, BrokenRelationsError) and found.doubt:
        raise error
    return closed, found


def _from_balls(mechanism: Mechanism, rng: np.random.Generator) -> Structure:
    count = len(mechanism.parameters)
    found = ball_relations(mechanism, count - sum(map(len, _dependent_by_joint(mechanism, rng).values())))
    by_robot = {column: tuple(combination) for column, combination in found.columns.items()}
    return Structure(count, found.pivots, {}, by_robot, singular=found.singular, balls=found)


def linear_structure(forms: LinearForms, rng: np.random.Generator) -> Structure:
    """Rank and pivots of any recorded rows without loops, all columns eliminated at once, the first ones preferred."""
    supports = _confirmed_dependence(Rows(forms, 0), rng)
    pivots = tuple(column for column in range(forms.shape[1]) if column not in supports)
    return Structure(forms.shape[1], pivots, {}, supports)


@one_thread()
def _modes(
    mechanism: Mechanism, rows: Rows, columns: Sequence[int], rng: np.random.Generator
) -> tuple[list[Mode], Mode, bool]:
    """All assembly modes, the one of the mechanism's own pose, and whether several may meet there.

    Where that cannot be told, because symbols have no values or modes meet at the pose, it is the one with the lowest
    rank: equal lengths are there to make motions special.
    """
    if not has_values(mechanism):
        modes, own = find_modes(rows, rng)
        return modes, own or _lowest(modes), False
    pose = NearPose(mechanism, rows, columns)
    here, rows = OwnMode(pose), elsewhere(rows) if pose.is_singular else rows
    sampler = rows.forms.sampler()
    assert isinstance(sampler, CurveSampler)

    def wanted(found: Sequence[Mode]) -> Mode | None:
        at_pose = sampler.at_stated_pose  # where all curves began
        if not pose.is_singular and not (at_pose and _determine(mechanism, sampler, rng)):
            check_independent(mechanism, pose.free_velocities)
        if at_pose and len(found) == 1:
            return found[0]
        if pose.is_singular:  # modes meet there
            return _lowest(found)
        # what is special about the stated values is in no mode of general ones
        general = not set(sampler.symbols) <= {*UNITS, *inexact_symbols(mechanism)}
        return here.likely(found) if general else here.mode(found)

    modes, own = find_modes(rows, rng, wanted)
    if own is None:
        ranks = ", ".join(str(len(columns) - len(mode.dependence)) for mode in modes)
        raise OtherModeError(
            f"{shown_loops(mechanism)} have several assembly modes, of rank {ranks} at random poses, and the assembly "
            "pose is in another one.  State a pose farther from where modes meet"
        )
    count = len(columns) - len(own.dependence)
    if inexact_symbols(mechanism) and pose.shows_less(count):
        problem = f"{shown_loops(mechanism)}: {count} base parameters would show, but fewer do in floating point"
        raise BrokenRelationsError(f"{problem}.  {broken_relations(mechanism)}")
    return modes, own, pose.is_singular


def _determine(mechanism: Mechanism, sampler: CurveSampler, rng: np.random.Generator) -> bool:
    """Whether the independent coordinates determine all others at the stated pose."""
    field = PrimeField.random(rng)
    dependent = [k for k, name in enumerate(mechanism.velocities) if name not in mechanism.independent_velocities]
    jacobian = sampler.jacobian(field, rng)
    return rank(jacobian, field) == len(dependent) == rank(jacobian[:, dependent], field)


def _lowest(modes: Sequence[Mode]) -> Mode:
    """The mode with the lowest rank, with what tells it from the others where these differ in more than that."""
    return modes[0] if len(modes) == 1 else replace(modes[0], marks=None if modes[0].marks else modes[0].marks)


def floating_pair(mechanism: Mechanism, index: int) -> Mechanism:
    """A body with its parent set free: the mechanism of two bodies that moves all ways the true one can, and more.

    On a whole parent the joint is placed at the parent's frame instead of :func:`joint_frame`.
    """
    child, parent = mechanism.bodies[index], mechanism.bodies[mechanism.bodies[index].parent]
    name = "free"
    while any(motion.name.startswith(name) for motion in child.joint.motions):
        name += "_"
    free = Joint(name, "floating", floating_motions(name))
    hung = replace(child, parent=0, inertial=None, joint=replace(child.joint, steps=_own_steps(child, parent)))
    return Mechanism("pair", (replace(parent, parent=GROUND, joint=free, inertial=None), hung), gravity=None)


def joint_frame(mechanism: Mechanism, index: int) -> Placement:
    """The frame in which a joint begins to move, in that of the parent; the parent's own if that is not a whole body.

    What moves to a parent that moves freely does not depend on it: the ten parameters of a whole body about one frame
    are combinations of those about another.  Of only some of them this is not true.
    """
    body = mechanism.bodies[index]
    parent = mechanism.bodies[body.parent]
    before = body.joint.steps[: len(body.joint.steps) - len(_own_steps(body, parent))]
    return reduce(matmul, (step for step in before if isinstance(step, Placement)), Placement())


def pair_signature(mechanism: Mechanism, index: int) -> tuple[object, ...]:
    """All that matters of :func:`floating_pair`: what the bodies carry and the joint without names."""
    body = mechanism.bodies[index]
    parent = mechanism.bodies[body.parent]
    steps = (replace(s, name="") if isinstance(s, Motion) else s for s in _own_steps(body, parent))
    return (parent.carried, body.carried, *steps)


def _own_steps(body: Body, parent: Body) -> tuple[Step, ...]:
    """The joint without what comes before its :func:`joint_frame`."""
    steps = body.joint.steps
    if parent.carried != ALL:
        return steps
    return steps[next((k for k, step in enumerate(steps) if isinstance(step, Motion)), len(steps)) :]


def pair_columns(mechanism: Mechanism, index: int) -> list[int]:
    """Columns of a body's parent and of the body, in the whole mechanism."""
    first = mechanism.first_column
    pair = [b for b in (mechanism.bodies[index].parent, index) if b in first]
    return [first[b] + k for b in pair for k in range(len(mechanism.bodies[b].carried))]


def _dependent_by_joint(mechanism: Mechanism, rng: np.random.Generator) -> dict[int, tuple[int, ...]]:
    cache: dict[object, tuple[int, ...]] = {}
    dependent = {}
    # a sensor between a body and its parent sees what moves from one to the other
    watched = {c.body for output in mechanism.outputs for c, _ in output.terms if isinstance(c, Cut)}
    for index, body in enumerate(mechanism.bodies):
        if body.parent == GROUND or body.massless or index in watched:
            continue
        # columns of bodies that share parameters are sums, which the relations of one joint do not hold for
        if len(mechanism.sharing[index]) > 1 or len(mechanism.sharing[body.parent]) > 1:
            continue
        signature = pair_signature(mechanism, index)
        if signature not in cache:
            supports = _confirmed_dependence(Rows(energy_form(floating_pair(mechanism, index)), 1), rng)
            offset = len(mechanism.bodies[body.parent].carried)
            cache[signature] = tuple(sorted(k - offset for k in supports if k >= offset))
        columns = pair_columns(mechanism, index)[-len(body.carried) :]
        if cache[signature]:
            dependent[index] = tuple(columns[k] for k in cache[signature])
    return dependent


def _shown_by_blocks(mechanism: Mechanism, rows: Rows, columns: Sequence[int], rng: np.random.Generator) -> set[int]:
    """Columns that small blocks of rows show to be independent of all others.

    To show a column to be independent modulo one prime is a proof, so one attempt is enough.
    """
    if len(columns) <= FEW_COLUMNS or mechanism.closures:
        return set()
    blocks = energy_changes(mechanism) if rows.auxiliary else rows.forms.blocks
    if blocks is None:
        return set()
    seen = {column - rows.auxiliary for _, column in rows.forms.entries}
    for _ in range(_ATTEMPTS):
        try:
            return blocks.independent(seen.intersection(columns), PrimeField.random(rng), rng)
        except DegenerateSampleError:
            continue
    return set()


def _confirmed_dependence(rows: Rows, rng: np.random.Generator) -> dict[int, tuple[int, ...]]:
    """Dependent columns and the pivots they depend on, as several primes, geometries and states agree."""
    seen: list[dict[int, tuple[int, ...]]] = []
    sampler, count = rows.forms.sampler(), rows.forms.shape[1] + _SURPLUS_ROWS
    for _ in range(_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            current = dependent_columns(rows, sampler, count, field, rng)
        except DegenerateSampleError:
            continue
        seen.append(current)
        if sampler.regions > 1:  # had a region of signs more to show, twice the points would show some of it
            count *= 2
        # an unlucky point can only make more columns dependent, never fewer
        fewest = min(len(s) for s in seen)
        agreeing = [s for s in seen if len(s) == fewest and s == seen[-1]]
        if len(agreeing) >= _PASSES:
            return seen[-1]
    raise EchelonError("results at random points keep contradicting each other; please report this model")


def dependent_columns(
    rows: Rows, sampler: FieldSampler, count: int, field: PrimeField, rng: np.random.Generator
) -> Dependence:
    """Dependence of columns at ``count`` random states, in all regions of signs, of one random geometry."""
    states = max(-(-count // max(1, rows.forms.shape[0])), sampler.regions)
    geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}
    matrix = rows.forms.stacked(sampler.evaluate(field, rng, states, geometry))[0]
    first = rows.auxiliary
    found = by_pivots(matrix, field)
    return {column - first: tuple(p - first for p in pivots if p >= first) for column, pivots in found.items()}
