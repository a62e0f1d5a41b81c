"""Assembly modes: a mechanism with loops can often be put together in several ways, each with a rank of its own.

Modulo a prime there is no telling which of its closed poses belongs to which mode.  But modes that differ in what can
be seen differ in which columns depend on which, or in how; that is found pose by pose, and it sorts poses afterwards.

Coefficients at different geometries and primes cannot be compared, but those that are simple rational numbers can: two
cranks in one guide turn by q₂ = ±q₁, and the first moments of the second one count with the sign.  Modes with the same
dependences are told apart by such coefficients only; where there are none, it is said and nothing is mixed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from echelon.doors import public
from echelon.errors import DegenerateSampleError, EchelonError, InputError, SingularPoseError
from echelon.exact.field import DEFAULT_SEED, PrimeField, Residues, by_pivots, random_generator
from echelon.exact.interpolation import rational
from echelon.exact.polynomial import Rational
from echelon.mechanism.closed_pose import shown_loops
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.sources import Readable, mechanism_of
from echelon.regressor.linear_forms import LinearForms, Rows, rows_of
from echelon.regressor.loops.curves import CurveSampler
from echelon.regressor.loops.moving import Pose

Dependence = dict[int, tuple[int, ...]]
"""Dependent columns, with the columns that each depends on."""

_Relations = dict[int, dict[int, int]]
"""Dependent columns as combinations of others, modulo a prime."""

_Marks = tuple[tuple[tuple[int, int], Rational], ...]
_Key = tuple[tuple[tuple[int, tuple[int, ...]], ...], _Marks | None]

_POSES, _FEW_POSES = 6, 1  # variants tried at each random geometry
_ATTEMPTS, _MORE_ATTEMPTS = 8, 24
_FIRST_ORDER, _LARGEST_ORDER = 12, 96
_SURPLUS_ROWS = 8
_ANY = ""  # name of no symbol, to count geometries where there are no symbols


@dataclass(frozen=True)
class Mode:
    """What depends on what in one assembly mode, and how."""

    dependence: Mapping[int, tuple[int, ...]]  # dependent columns of the rows, with the columns that each depends on
    order: int  # number of coefficients along curves that showed it
    # coefficients, by dependent column and the column it depends on, in which it differs from modes with the same
    # dependence; None for several modes that no simple coefficient tells apart
    marks: Mapping[tuple[int, int], Rational] | None = field(default_factory=dict)


def find_modes(
    rows: Rows, rng: np.random.Generator, own: Callable[[Sequence[Mode]], Mode | None] | None = None
) -> tuple[list[Mode], Mode | None]:
    """All assembly modes that random closed poses are in, those with the lowest rank first, and the wanted one.

    ``own`` tells which of some modes is wanted, None if none is: then random poses go on being drawn for a while.
    SingularPoseError if no closed pose is found.
    """
    orders: dict[_Key, list[int]] = {}
    order, poses, failure = _FIRST_ORDER, _POSES, ""
    confirmed: list[Mode] = []
    wanted: Mode | None = None
    for attempt in range(_ATTEMPTS if own is None else _MORE_ATTEMPTS):
        try:
            prime = PrimeField.random(rng)
            found = _keys(_relations_at_poses(rows, prime, rng, order, poses), prime)
        except DegenerateSampleError as error:
            failure = str(error)
            continue
        new = found - orders.keys()
        for key in found:
            orders.setdefault(key, []).append(order)
        if not new or attempt >= _ATTEMPTS:
            known, confirmed = confirmed, _confirmed(orders)
            if own is not None and confirmed != known:
                wanted = own(confirmed)
            if own is None or wanted is not None:
                break
        # the rank may grow with the number of coefficients, so the next attempt takes more
        order, poses = min(2 * order, _LARGEST_ORDER), _POSES if len(found) > 1 else _FEW_POSES
    if not orders:
        raise SingularPoseError(failure)
    confirmed = confirmed or _confirmed(orders)
    if not confirmed:
        raise EchelonError("random points keep contradicting each other; please report this model")
    return confirmed, wanted


def _confirmed(orders: Mapping[_Key, Sequence[int]]) -> list[Mode]:
    """Modes whose dependence was seen at two geometries or more.

    A geometry may show one of several modes with the same dependence only, and then without marks.
    """
    found: list[Mode] = []
    for support in dict.fromkeys(support for support, _ in orders):
        seen = {marks: orders[s, marks] for s, marks in orders if s == support}
        at = [order for several in seen.values() for order in several]
        if len(at) < 2:
            continue
        marked = [Mode(dict(support), min(o), dict(m)) for m, o in seen.items() if m and len(o) > 1]
        alone = Mode(dict(support), min(at), {} if set(seen) == {()} else None)
        found += marked or [alone]
    return sorted(found, key=lambda mode: -len(mode.dependence))


def _keys(poses: Sequence[_Relations], field: PrimeField) -> set[_Key]:
    """What sets the modes of some poses of one geometry apart, in terms that hold for other geometries and primes."""
    by_support: dict[tuple[tuple[int, tuple[int, ...]], ...], list[_Relations]] = {}
    for relations in poses:
        support = tuple((column, tuple(combination)) for column, combination in sorted(relations.items()))
        others = by_support.setdefault(support, [])
        if relations not in others:
            others.append(relations)
    return {(support, marks) for support, found in by_support.items() for marks in _marks(found, field)}


def _marks(modes: Sequence[_Relations], field: PrimeField) -> list[_Marks | None]:
    """Simple coefficients that tell some modes with the same dependence apart, for each; None where none do."""
    differing = [(c, s) for c in modes[0] for s in modes[0][c] if len({mode[c][s] for mode in modes}) > 1]
    simple: list[tuple[tuple[int, int], list[Rational]]] = []
    for c, s in differing:
        values = [rational(mode[c][s], field.p) for mode in modes]
        known = [value for value in values if value is not None]
        if len(known) == len(modes):
            simple.append(((c, s), known))
    found: list[_Marks | None] = [tuple((place, values[k]) for place, values in simple) for k in range(len(modes))]
    return found if len(set(found)) == len(modes) else [None]


def _relations_at_poses(
    rows: Rows, field: PrimeField, rng: np.random.Generator, order: int, poses: int
) -> list[_Relations]:
    """How columns depend on others at some random closed poses of a random geometry."""
    sampler = rows.forms.sampler(order)
    assert isinstance(sampler, CurveSampler)
    geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}

    def relations(pose: Pose) -> list[_Relations]:
        pose = sampler.variants(field, rng, geometry, pose, poses)
        distinct = np.unique(pose.numbers, axis=0, return_index=True)[1]
        repeated = {s: np.repeat(value, len(distinct)) for s, value in geometry.items()}
        repeated[_ANY] = np.zeros(len(distinct), dtype=np.int64)
        found = _relations_of(rows, sampler, field, rng, repeated, pose.at(distinct))
        known = [relations for relations in found if relations is not None]
        if not known:
            raise SingularPoseError("no motion goes on from a closed pose: redundant constraints contradict each other")
        return known

    return sampler.from_pose(field, rng, geometry, relations)


def _relations_of(
    rows: Rows,
    sampler: CurveSampler,
    field: PrimeField,
    rng: np.random.Generator,
    geometry: Mapping[str, Residues],
    pose: Pose,
) -> list[_Relations | None]:
    """How columns depend on others at poses, one of each geometry; None where a pose is singular."""
    states = rows.forms.shape[1] + _SURPLUS_ROWS
    try:
        tables = rows.forms.stacked(sampler.evaluate_at(field, rng, states, geometry, pose))
        return [_relations(table, rows.auxiliary, field) for table in tables]
    except (DegenerateSampleError, SingularPoseError):
        if len(pose.numbers) == 1:
            return [None]
    # one is singular, or modes differ in what follows from what
    found: list[_Relations | None] = []
    for k in range(len(pose.numbers)):
        one = {name: values[k : k + 1] for name, values in geometry.items()}
        found += _relations_of(rows, sampler, field, rng, one, pose.at(np.array([k])))
    return found


def _relations(table: Residues, auxiliary: int, field: PrimeField) -> _Relations:
    return {
        column - auxiliary: {p - auxiliary: value for p, value in combination.items() if p >= auxiliary}
        for column, combination in by_pivots(table, field).items()
    }


@dataclass(frozen=True)
class InMode:
    """Accepts the poses that are in one mode."""

    rows: Rows  # those that the mode was found with
    mode: Mode

    def __call__(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], pose: Pose
    ) -> npt.NDArray[np.bool_]:
        """Which poses are in the mode."""
        sampler = self.rows.forms.sampler(self.mode.order)
        assert isinstance(sampler, CurveSampler)
        count = len(pose.numbers)
        # symbols that the asking forms do not depend on have any value
        own = {s: geometry[s] if s in geometry else field.draw(rng, (count,)) for s in sampler.symbols}
        own[_ANY] = np.zeros(count, dtype=np.int64)
        found = _relations_of(self.rows, sampler, field, rng, own, pose)
        return np.array([relations is not None and self._holds(relations, field) for relations in found])

    def _holds(self, relations: _Relations, field: PrimeField) -> bool:
        wanted = self.mode.dependence
        if {column: tuple(sources) for column, sources in relations.items()} != wanted:
            return False
        return all(relations[c][s] == field.embed(value) for (c, s), value in (self.mode.marks or {}).items())


def in_mode(forms: LinearForms, accepted: InMode | None) -> LinearForms:
    """The forms at configurations of one assembly mode only."""
    if accepted is None or forms.loops is None:
        return forms
    if accepted.mode.marks is None:
        raise InputError(alike(forms.loops.mechanism), element="assembly")
    return replace(forms, loops=replace(forms.loops, accepts=accepted))


def alike(mechanism: Mechanism) -> str:
    """That only the ways in which the same parameters combine set modes apart, and none that is simple."""
    return (
        f"{shown_loops(mechanism)} can be assembled in several ways in which the same parameters combine differently, "
        "such as q2 = q1 and q2 = -q1, and no simple coefficient tells which is meant.  Give all symbols values, and "
        "an assembly pose that closes the loops exactly and at which these ways do not meet"
    )


def elsewhere(rows: Rows) -> Rows:
    """The rows at closed poses of which none is the stated one."""
    assert rows.forms.loops is not None
    return Rows(replace(rows.forms, loops=replace(rows.forms.loops, stated=False)), rows.auxiliary)


@public
def assembly_modes(mechanism: Mechanism | Readable, *, seed: int = DEFAULT_SEED) -> tuple[int, ...]:
    """Ranks of all ways to assemble a mechanism with loops that differ in what can be seen, the lowest first.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        A robot, or the file of one.
    seed : int

    Returns
    -------
    tuple of int
        One rank for each mode; :func:`echelon.base_structure` tells that of the mechanism's own one.

    Raises
    ------
    InputError
        If there are no loops, or no closed poses can be found but the stated one.

    Examples
    --------
    >>> import echelon as ec
    >>> ec.assembly_modes(ec.load("examples/loops/parallelogram.yaml"))
    (3, 8)
    """
    mechanism = mechanism_of(mechanism)
    if not mechanism.closures:
        raise InputError("a mechanism without loops has no assembly modes")
    rows = rows_of(mechanism)
    try:
        modes, _ = find_modes(elsewhere(rows), random_generator(seed))
    except SingularPoseError as error:
        raise InputError(f"no other closed poses were found: {error}") from None
    return tuple(len(mechanism.parameters) - len(mode.dependence) for mode in modes)
