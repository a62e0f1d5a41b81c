"""Structure: which standard parameters are representatives (pivots) and which depend on others.

Cost must follow the chain and not the whole robot, so dependent columns are first looked for joint by joint: whatever
parameters of a body can be moved to its parent when the *parent moves freely* can be moved in every mechanism, because
the true motions of the parent are among the free ones.  These pairs of bodies are tiny.  Of what remains, most columns
are shown to be independent block by block (see :mod:`echelon.dynamics.blocks`), which are tiny, too.  The rest, near
the base and around couplings, is eliminated at once.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import matmul

import numpy as np

from echelon.algebra import (
    AGREEING_POINTS,
    MOST_ATTEMPTS,
    SURPLUS_ROWS,
    FieldSampler,
    PrimeField,
    by_pivots,
    persistent,
)
from echelon.base.ball_tables import vanishes
from echelon.base.elimination import Independent
from echelon.base.real_states import RealStates
from echelon.base.spectrum import RankSpectrum, spectrum_of, units_of
from echelon.dynamics import (
    FEW_COLUMNS,
    LinearForms,
    Rows,
    energy_changes,
    energy_form,
    rows_of,
)
from echelon.robot import (
    ALL,
    GROUND,
    Body,
    Joint,
    Mechanism,
    Motion,
    Placement,
    Step,
    floating_motions,
)
from echelon.shared import (
    DegenerateSampleError,
    EchelonError,
    SingularPoseError,
    one_thread,
    public,
)

BRANCHES = 6
"""Poses near a singular one whose ranks tell assembly modes apart."""


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
    ways : tuple of int
        With loops, the ranks of ways of assembly that meet at the stated pose; empty if that is regular.
    singular : bool
        With loops, whether more motions are possible at the assembly pose than near it, so that ways of assembly may
        meet there.
    real : Independent, optional
        Independent columns at real states, where primes do not show them; of columns that are not in ``by_joint``.
    spectrum : RankSpectrum, optional
        With loops, how much each shows, and what of it rounding of a file explains.
    functions_are_free : bool
        Whether all relations hold for free values of functions such as exp, too.
    """

    parameters: int
    pivots: tuple[int, ...]
    by_joint: Mapping[int, tuple[int, ...]]
    by_robot: Mapping[int, tuple[int, ...]]
    singular: bool = False
    real: Independent | None = field(default=None, repr=False, compare=False)
    spectrum: RankSpectrum | None = None
    ways: tuple[int, ...] = ()
    functions_are_free: bool = False

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.pivots)

    @property
    def doubt(self) -> str:
        """Reason to doubt the rank; empty if there is none."""
        if self.ways:
            ranks = " and ".join(map(str, self.ways))
            return (
                f"the assembly pose is singular, and ways of assembly may meet there; near it {ranks} base "
                f"parameters appear, and the answer is {min(self.ways)}: state a pose away from it"
            )
        return self.where_modes_meet or (self.spectrum.doubt if self.spectrum else "")

    @property
    def where_modes_meet(self) -> str:
        """Doubt about a singular assembly pose; empty if it is regular."""
        if not self.singular:
            return ""
        return (
            "the assembly pose is singular: it allows more motions than poses near it, and ways of assembly may "
            "meet; the answer holds near it: state a pose away from it"
        )


def find_structure(
    mechanism: Mechanism, rng: np.random.Generator, *, generic: bool = True
) -> Structure:
    """Rank and pivots in base-to-tip order, for generic values of the geometry symbols.

    With loops, these are values near the stated ones, or with ``generic=False`` the stated ones.  SingularPoseError if
    the loops are not proved to close.
    """
    whole = rows_of(mechanism)
    if whole.forms.rational:
        return _modulo_primes(mechanism, whole, rng)
    freed = whole.freed
    if freed is not None:
        structure = _modulo_primes(mechanism, freed, rng)
        if _independent(whole.columns(structure.pivots)):
            return replace(structure, functions_are_free=True)
    return real_structure(mechanism, rng, whole, generic=generic)


def _independent(rows: Rows) -> bool:
    """Whether all columns are shown to be independent at the stated values of the symbols, and so for general ones."""
    try:
        found = persistent(RealStates(rows).independent)
    except SingularPoseError:
        return False
    return len(found.pivots) == rows.forms.shape[1] - rows.auxiliary


def _modulo_primes(
    mechanism: Mechanism, whole: Rows, rng: np.random.Generator
) -> Structure:
    """Structure of a mechanism whose rows are rational functions of free variables."""
    by_joint = _dependent_by_joint(mechanism, rng)
    remaining = _not_local(mechanism, by_joint)
    settled = _shown_by_blocks(mechanism, whole, remaining, rng)
    remaining = [c for c in remaining if c not in settled]
    supports = _confirmed_dependence(whole.columns(remaining), rng)
    pivots = tuple(
        sorted(
            (
                *settled,
                *(remaining[k] for k in range(len(remaining)) if k not in supports),
            )
        )
    )
    by_robot = {
        remaining[k]: tuple(remaining[s] for s in support)
        for k, support in supports.items()
    }
    return Structure(len(mechanism.parameters), pivots, by_joint, by_robot)


def from_regular_pose(
    mechanism: Mechanism, rng: np.random.Generator
) -> tuple[Mechanism, tuple[int, ...]]:
    """A mechanism that is assembled next to a singular pose, where it shows least, and the ranks that were seen there.

    Ways of assembly meet at such a pose: equal lengths are there to make motions special.  The mechanism itself, and no
    ranks, where its pose is regular or there are no loops.
    """
    loops = rows_of(mechanism).forms.loops
    if loops is None or not loops.singular:
        return mechanism, ()
    seen = dict[int, Mechanism]()
    for pose in loops.known_poses(0, BRANCHES):
        beside = replace(
            mechanism,
            assembly=dict(zip(mechanism.positions, map(float, pose), strict=True)),
        )
        structure = real_structure(beside, rng, rows_of(beside))
        if not structure.singular:
            seen.setdefault(structure.rank, beside)
    if not seen:
        return mechanism, ()
    return seen[min(seen)], tuple(sorted(seen))


@one_thread()
def real_structure(
    mechanism: Mechanism,
    rng: np.random.Generator,
    rows: Rows,
    *,
    generic: bool = False,
    in_numbers: bool = False,
) -> Structure:
    """Structure at real states, of all columns for numbers at the stated values.

    Else, where symbols have names or states are free, columns that depend on others by their joint alone are left to
    closed forms.
    """
    named = (
        bool(RealStates(rows).symbols) or rows.forms.loops is None
    ) and not in_numbers
    by_joint = _dependent_by_joint(mechanism, rng) if named else {}
    columns = _not_local(mechanism, by_joint)
    states = RealStates(
        rows.columns(columns), units_of(mechanism, columns, rows.auxiliary)
    )
    found = _real_elimination(states, rng, generic=generic)
    order, spectrum = range(len(columns)), None
    ordered = found.in_order(order)
    if rows.forms.loops is not None:
        from echelon.loops import (
            check_independent,
        )  # robots without loops do without it

        check_independent(mechanism, states.free_velocities)
        spectrum = spectrum_of(mechanism, states, columns, found)
        if spectrum.intended < spectrum.literal:
            ordered = found.without_faint(spectrum.intended, order)
    supports = _supports(ordered)
    by_robot = {
        columns[k]: tuple(columns[p] for p in support)
        for k, support in supports.items()
    }
    pivots = tuple(columns[k] for k in ordered.pivots)
    return Structure(
        len(mechanism.parameters),
        pivots,
        by_joint,
        by_robot,
        states.singular,
        ordered,
        spectrum,
    )


def _real_elimination(
    states: RealStates, rng: np.random.Generator, *, generic: bool
) -> Independent:
    """Independent columns at the stated values of the symbols, or at random ones next to them."""
    return persistent(
        lambda: states.independent(
            states.elsewhere(rng) if generic and states.symbols else {}
        )
    )


def _supports(ordered: Independent) -> dict[int, tuple[int, ...]]:
    """The pivots that dependent columns depend on."""
    found = {}
    for dependent, values in zip(ordered.others, ordered.solution.T, strict=True):
        pairs = zip(ordered.pivots, values, strict=True)
        found[dependent] = tuple(p for p, x in pairs if not vanishes(x, ordered.bits))
    return found


def _not_local(
    mechanism: Mechanism, by_joint: Mapping[int, tuple[int, ...]]
) -> list[int]:
    """Columns that do not depend on others by their joint alone."""
    local = {column for columns in by_joint.values() for column in columns}
    return [
        column for column in range(len(mechanism.parameters)) if column not in local
    ]


def linear_structure(forms: LinearForms, rng: np.random.Generator) -> Structure:
    """Rank and pivots of any recorded rows without loops, all columns eliminated at once, the first ones preferred."""
    rows, freed = Rows(forms, 0), forms.freed
    if forms.rational:
        return _of_supports(forms, _confirmed_dependence(rows, rng))
    if freed is not None:
        structure = _of_supports(forms, _confirmed_dependence(Rows(freed, 0), rng))
        if _independent(rows.columns(structure.pivots)):
            return replace(structure, functions_are_free=True)
    found = _real_elimination(RealStates(rows), rng, generic=True)
    return _of_supports(forms, _supports(found.in_order(range(forms.shape[1]))))


def _of_supports(
    forms: LinearForms, supports: Mapping[int, tuple[int, ...]]
) -> Structure:
    """Structure of rows whose dependent columns are known with the pivots that they depend on."""
    pivots = tuple(column for column in range(forms.shape[1]) if column not in supports)
    return Structure(forms.shape[1], pivots, {}, supports)


def floating_pair(mechanism: Mechanism, index: int) -> Mechanism:
    """A body with its parent set free: the mechanism of two bodies that moves all ways the true one can, and more.

    On a whole parent the joint is placed at the parent's frame instead of :func:`joint_frame`.
    """
    child = mechanism.bodies[index]
    parent = mechanism.bodies[mechanism.bodies[index].parent]
    name = "free"
    while any(motion.name.startswith(name) for motion in child.joint.motions):
        name += "_"
    free = Joint(name, "floating", floating_motions(name))
    hung = replace(
        child,
        parent=0,
        inertial=None,
        joint=replace(child.joint, steps=_own_steps(child, parent)),
    )
    return Mechanism(
        "pair",
        (replace(parent, parent=GROUND, joint=free, inertial=None), hung),
        gravity=None,
    )


def joint_frame(mechanism: Mechanism, index: int) -> Placement:
    """The frame in which a joint begins to move, in that of the parent; the parent's own if that is not a whole body.

    What moves to a parent that moves freely does not depend on it: the ten parameters of a whole body about one frame
    are combinations of those about another.  Of only some of them this is not true.
    """
    body = mechanism.bodies[index]
    parent = mechanism.bodies[body.parent]
    before = body.joint.steps[: len(body.joint.steps) - len(_own_steps(body, parent))]
    return reduce(
        matmul, (step for step in before if isinstance(step, Placement)), Placement()
    )


def pair_signature(mechanism: Mechanism, index: int) -> tuple[object, ...]:
    """All that matters of :func:`floating_pair`: what the bodies carry and the joint without names."""
    body = mechanism.bodies[index]
    parent = mechanism.bodies[body.parent]
    steps = (
        replace(s, name="") if isinstance(s, Motion) else s
        for s in _own_steps(body, parent)
    )
    return (parent.carried, body.carried, *steps)


def _own_steps(body: Body, parent: Body) -> tuple[Step, ...]:
    """The joint without what comes before its :func:`joint_frame`."""
    steps = body.joint.steps
    if parent.carried != ALL:
        return steps
    return steps[
        next(
            (k for k, step in enumerate(steps) if isinstance(step, Motion)), len(steps)
        ) :
    ]


def pair_columns(mechanism: Mechanism, index: int) -> list[int]:
    """Columns of a body's parent and of the body, in the whole mechanism."""
    first = mechanism.first_column
    pair = [b for b in (mechanism.bodies[index].parent, index) if b in first]
    return [first[b] + k for b in pair for k in range(len(mechanism.bodies[b].carried))]


def _dependent_by_joint(
    mechanism: Mechanism, rng: np.random.Generator
) -> dict[int, tuple[int, ...]]:
    cache: dict[object, tuple[int, ...]] = {}
    dependent = {}
    # a sensor between a body and its parent sees what moves from one to the other
    watched = {cut.body for cut in mechanism.cuts}
    for index in mechanism.carriers:
        if not _moves_alike(mechanism, index, watched):
            continue
        signature = pair_signature(mechanism, index)
        if signature not in cache:
            supports = _confirmed_dependence(
                Rows(energy_form(floating_pair(mechanism, index)), 1), rng
            )
            offset = len(mechanism.bodies[mechanism.bodies[index].parent].carried)
            cache[signature] = tuple(
                sorted(k - offset for k in supports if k >= offset)
            )
        columns = pair_columns(mechanism, index)[
            -len(mechanism.bodies[index].carried) :
        ]
        if cache[signature]:
            dependent[index] = tuple(columns[k] for k in cache[signature])
    return dependent


def _moves_alike(mechanism: Mechanism, index: int, watched: Collection[int]) -> bool:
    """Whether a body's joint relates its columns and its parent's, which are sums over all that share parameters.

    A relation holds for the sums if each of these bodies hangs on another one of those that share the parent's
    parameters, all of them by the same joint.
    """
    bodies, sharing = mechanism.bodies, mechanism.sharing
    parents = [bodies[k].parent for k in sharing[index]]
    if GROUND in parents or any(k in watched for k in sharing[index]):
        return False
    if sorted(parents) != list(sharing[parents[0]]):
        return False
    joints = {
        (joint_frame(mechanism, k), pair_signature(mechanism, k))
        for k in sharing[index]
    }
    return len(joints) == 1


def _shown_by_blocks(
    mechanism: Mechanism, rows: Rows, columns: Sequence[int], rng: np.random.Generator
) -> set[int]:
    """Columns that small blocks of rows show to be independent of all others.

    To show a column to be independent modulo one prime is a proof, so one attempt is enough.
    """
    if len(columns) <= FEW_COLUMNS:
        return set()
    blocks = energy_changes(mechanism) if rows.auxiliary else rows.forms.blocks
    if blocks is None:
        return set()
    seen = {column - rows.auxiliary for _, column in rows.forms.entries}
    for _ in range(MOST_ATTEMPTS):
        try:
            return blocks.independent(
                seen.intersection(columns), PrimeField.random(rng), rng
            )
        except DegenerateSampleError:
            continue
    return set()


def _confirmed_dependence(
    rows: Rows, rng: np.random.Generator
) -> dict[int, tuple[int, ...]]:
    """Dependent columns and the pivots they depend on, as several primes, geometries and states agree."""
    seen: list[dict[int, tuple[int, ...]]] = []
    sampler, count = rows.forms.sampler(), rows.forms.shape[1] + SURPLUS_ROWS
    for _ in range(MOST_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            current = dependent_columns(rows, sampler, count, field, rng)
        except DegenerateSampleError:
            continue
        seen.append(current)
        if (
            sampler.regions > 1
        ):  # had a region of signs more to show, twice the points would show some of it
            count *= 2
        # an unlucky point can only make more columns dependent, never fewer
        fewest = min(len(s) for s in seen)
        agreeing = [s for s in seen if len(s) == fewest and s == seen[-1]]
        if len(agreeing) >= AGREEING_POINTS:
            return seen[-1]
    raise EchelonError(
        "results at random points keep contradicting each other; please report this model"
    )


def dependent_columns(
    rows: Rows,
    sampler: FieldSampler,
    count: int,
    field: PrimeField,
    rng: np.random.Generator,
) -> dict[int, tuple[int, ...]]:
    """Dependence of columns at ``count`` random states, in all regions of signs, of one random geometry."""
    states = max(-(-count // max(1, rows.forms.shape[0])), sampler.regions)
    geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}
    matrix = rows.forms.stacked(sampler.evaluate(field, rng, states, geometry))[0]
    first = rows.auxiliary
    found = by_pivots(matrix, field)
    return {
        column - first: tuple(p - first for p in pivots if p >= first)
        for column, pivots in found.items()
    }
