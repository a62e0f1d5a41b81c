"""Assembly modes: a mechanism with loops can often be put together in several ways, each with a rank of its own.

Modulo a prime there is no telling which of its closed poses belongs to which mode.  But modes that differ in what can
be seen differ in which columns depend on which; that is found pose by pose, and it sorts poses afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.base.rows import Rows, rows_of
from echelon.errors import DegenerateSampleError, EchelonError, InputError, SingularPoseError
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField, Residues
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.linear import LinearForms
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.curves import CurveSampler
from echelon.regressor.loops.moving import Pose
from echelon.regressor.virtual_power import virtual_power_form
from echelon.seeds import DEFAULT_SEED, random_generator

Dependence = dict[int, tuple[int, ...]]
"""Dependent columns, with the columns that each depends on."""

_Key = tuple[tuple[int, tuple[int, ...]], ...]

_POSES, _FEW_POSES = 6, 1  # variants tried at each random geometry
_ATTEMPTS = 8
_FIRST_ORDER, _LARGEST_ORDER = 12, 96
_SURPLUS_ROWS = 8
_STATES, _NEAR = 20, 0.2  # real states
_FITS, _NOISE = 1e-6, 1e-8  # how well a mode's relations hold there, and what counts as nothing
_ANY = ""  # name of no symbol, to count geometries where there are no symbols


@dataclass(frozen=True)
class Mode:
    """What depends on what in one assembly mode.

    Attributes
    ----------
    dependence : mapping of int to tuple of int
        Dependent columns of the rows, with the columns that each depends on.
    order : int
        Number of coefficients along curves that showed it.
    """

    dependence: Mapping[int, tuple[int, ...]]
    order: int


def find_modes(rows: Rows, rng: np.random.Generator) -> list[Mode]:
    """All assembly modes that random closed poses are in, those with the lowest rank first.

    Parameters
    ----------
    rows : Rows
        Of a mechanism with loops.
    rng : numpy Generator

    Raises
    ------
    SingularPoseError
        If no closed pose is found.
    EchelonError
        If random points keep contradicting each other, which has no natural cause.
    """
    orders: dict[_Key, list[int]] = {}
    order, poses, failure = _FIRST_ORDER, _POSES, ""
    for _ in range(_ATTEMPTS):
        try:
            found = {tuple(sorted(d.items())) for d in _dependences(rows, PrimeField.random(rng), rng, order, poses)}
        except DegenerateSampleError as error:
            failure = str(error)
            continue
        new = found - orders.keys()
        for key in found:
            orders.setdefault(key, []).append(order)
        if not new:
            break
        # the rank may grow with the number of coefficients, so the next attempt takes more
        order, poses = min(2 * order, _LARGEST_ORDER), _POSES if len(orders) > 1 else _FEW_POSES
    if not orders:
        raise SingularPoseError(failure)
    confirmed = [Mode(dict(key), min(seen)) for key, seen in orders.items() if len(seen) > 1]
    if not confirmed:
        raise EchelonError("random points keep contradicting each other; please report this model")
    return sorted(confirmed, key=lambda mode: -len(mode.dependence))


def _dependences(rows: Rows, field: PrimeField, rng: np.random.Generator, order: int, poses: int) -> list[Dependence]:
    """What depends on what at some random closed poses of a random geometry."""
    sampler = rows.forms.sampler(order)
    assert isinstance(sampler, CurveSampler)
    geometry = {s: field.draw(rng, (1,)) for s in sampler.symbols}
    pose = sampler.pose_variants(field, rng, geometry, poses)
    distinct = _distinct(pose)
    repeated = {s: np.repeat(value, len(distinct)) for s, value in geometry.items()}
    repeated[_ANY] = np.zeros(len(distinct), dtype=np.int64)
    tables = _tables(rows, sampler, field, rng, repeated, pose.at(distinct))
    return [dependence(table, rows.auxiliary, field) for table in tables]


def _distinct(pose: Pose) -> npt.NDArray[np.intp]:
    flat = np.concatenate([part.reshape(len(part), -1) for part in pose.parts[:3]], axis=1)
    _, first = np.unique(flat, axis=0, return_index=True)
    return np.sort(first)


def _tables(
    rows: Rows,
    sampler: CurveSampler,
    field: PrimeField,
    rng: np.random.Generator,
    geometry: Mapping[str, Residues],
    pose: Pose,
) -> Residues:
    """Rows at poses, (poses, states, columns)."""
    states = rows.forms.shape[1] + _SURPLUS_ROWS
    return rows.forms.stacked(sampler.evaluate_at(field, rng, states, geometry, pose))


def dependence(table: Residues, auxiliary: int, field: PrimeField) -> Dependence:
    """Dependent columns of a table, counted after the auxiliary ones, with the columns that each depends on."""
    reduced, pivots = reduced_echelon(table, field)
    return {
        column - auxiliary: tuple(
            p - auxiliary for row, p in enumerate(pivots) if auxiliary <= p < column and int(reduced[row, column])
        )
        for column in sorted(set(range(table.shape[1])) - set(pivots))
    }


@dataclass(frozen=True)
class InMode:
    """Accepts the poses that are in one mode.

    Attributes
    ----------
    rows : Rows
        Those that the mode was found with.
    mode : Mode
    """

    rows: Rows
    mode: Mode

    def __call__(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], pose: Pose
    ) -> npt.NDArray[np.bool_]:
        """Which poses are in the mode."""
        sampler = self.rows.forms.sampler(self.mode.order)
        assert isinstance(sampler, CurveSampler)
        count = len(pose.turns)
        # symbols that the asking forms do not depend on have any value
        own = {s: geometry[s] if s in geometry else field.draw(rng, (count,)) for s in sampler.symbols}
        own[_ANY] = np.zeros(count, dtype=np.int64)
        tables = _tables(self.rows, sampler, field, rng, own, pose)
        wanted = self.mode.dependence
        return np.array([dependence(table, self.rows.auxiliary, field).keys() == wanted.keys() for table in tables])


def in_mode(forms: LinearForms, accepted: InMode | None) -> LinearForms:
    """The forms at configurations of one assembly mode only."""
    if accepted is None or forms.loops is None:
        return forms
    return replace(forms, loops=replace(forms.loops, accepts=accepted))


def assembly_modes(mechanism: Mechanism, *, seed: int = DEFAULT_SEED) -> tuple[int, ...]:
    """Ranks of all ways to assemble a mechanism with loops that differ in what can be seen, the lowest first.

    Parameters
    ----------
    mechanism : Mechanism
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
    if not mechanism.closures:
        raise InputError("a mechanism without loops has no assembly modes")
    rows = rows_of(mechanism)
    assert rows.forms.loops is not None
    anywhere = Rows(replace(rows.forms, loops=replace(rows.forms.loops, stated=False)), rows.auxiliary)
    try:
        modes = find_modes(anywhere, random_generator(seed))
    except SingularPoseError as error:
        raise InputError(f"no other closed poses were found: {error}") from None
    return tuple(len(mechanism.parameters) - len(mode.dependence) for mode in modes)


def own_mode(mechanism: Mechanism, columns: Sequence[int], modes: Sequence[Mode]) -> Mode | None:
    """The mode that the mechanism's own assembly pose is in.

    Parameters
    ----------
    mechanism : Mechanism
    columns : sequence of int
        Those of the mechanism's parameters that the modes count.
    modes : sequence of Mode
        Those with the lowest rank first.

    Returns
    -------
    Mode or None
        None where it cannot be told, because symbols have no values or modes meet at the pose.
    """
    states = _STATES + 4 * len(columns) // max(1, len(mechanism.outputs))
    try:
        # near the pose: farther away the walk could pass to another mode
        real = Assembly(mechanism).random_closed_states(random_generator(DEFAULT_SEED), states, _NEAR)
        values = evaluate_floats(virtual_power_form(mechanism), mechanism, *real)
    except InputError:
        return None
    table = values.reshape(-1, values.shape[2])[:, list(columns)]
    # columns that vanish but for rounding stay small
    table = table / np.maximum(np.abs(table).max(axis=0), _NOISE * np.abs(table).max())
    for mode in modes:
        pivots = [k for k in range(len(columns)) if k not in mode.dependence]
        others = list(mode.dependence)
        solution = np.linalg.lstsq(table[:, pivots], table[:, others], rcond=None)[0]
        if np.abs(table[:, others] - table[:, pivots] @ solution).max(initial=0.0) < _FITS:
            return mode
    return None
