"""From a mechanism or a linear model to its certified base parameters.

The robot's own numbers decide.  A set for general symbols may be too large for the robot at hand, because some of its
numbers are zero, equal or otherwise related.  At special values the rank can only fall, and while the general
representatives stay independent it does not, and they stay the representatives: one non-zero minor at the stated values
proves it.  Otherwise the relations that matter are looked for (:mod:`echelon.base.stated_values`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    MOST_PRIMES,
    Polynomial,
    RationalFunction,
    Work,
    random_generator,
)
from echelon.base.ball_checks import check_in_balls
from echelon.base.ball_rows import irrational_roots
from echelon.base.certificate import AtStatedValues, certify
from echelon.base.closed_form import assembled, closed_columns, relations
from echelon.base.elimination import Independent
from echelon.base.firm_pivots import doubt_of_coefficients, exchange_note, firm_order
from echelon.base.linear_base import LinearBase, linear_base_parameters
from echelon.base.matrix import BaseMatrix, column_order, reordered
from echelon.base.model import BaseModel
from echelon.base.reading_report import doubt_of_loops, report_reading
from echelon.base.real_matrix import in_numbers
from echelon.base.real_states import RealStates
from echelon.base.stated_columns import StatedColumns
from echelon.base.stated_values import (
    RelationSearch,
    SpecialValues,
    at_stated_values,
    stated_structure,
    with_values,
)
from echelon.base.structure import (
    Structure,
    find_structure,
    from_regular_pose,
    real_structure,
)
from echelon.dynamics import (
    LinearForms,
    LinearModel,
    model_of,
    rows_of,
    virtual_power_form,
)
from echelon.robot import (
    Experiment,
    Mechanism,
    Readable,
    all_symbols,
    has_values,
    inexact_symbols,
    joined,
    known_values,
    loaded,
    mechanism_of,
    named_symbols,
    stated_values,
    symbol_roles,
    value_texts,
)
from echelon.shared import (
    CertificateError,
    ClosedFormError,
    DegenerateSampleError,
    DoubtWarning,
    EchelonError,
    InputError,
    NotNegative,
    Order,
    public,
)


def silent(_: str) -> None:
    """Report no progress."""


@overload
def base_parameters(
    mechanism: Mechanism | Experiment | Sequence[Experiment],
    *,
    order: Order = ...,
    prefer: str | Sequence[str] = ...,
    generic: bool = ...,
    seed: int = ...,
    budget: float = ...,
    progress: Callable[[str], None] = ...,
) -> BaseModel: ...


@overload
def base_parameters(
    mechanism: LinearModel,
    *,
    order: Order = ...,
    prefer: str | Sequence[str] = ...,
    generic: bool = ...,
    seed: int = ...,
    budget: float = ...,
    progress: Callable[[str], None] = ...,
) -> LinearBase: ...


@overload
def base_parameters(
    mechanism: Readable,
    *,
    order: Order = ...,
    prefer: str | Sequence[str] = ...,
    generic: bool = ...,
    seed: int = ...,
    budget: float = ...,
    progress: Callable[[str], None] = ...,
) -> BaseModel | LinearBase: ...


@public
def base_parameters(
    mechanism: Mechanism | LinearModel | Readable | Experiment | Sequence[Experiment],
    *,
    order: Order = "base-to-tip",
    prefer: str | Sequence[str] = (),
    generic: bool = False,
    seed: int = DEFAULT_SEED,
    budget: NotNegative = 1.0,
    progress: Callable[[str], None] = silent,
) -> BaseModel | LinearBase:
    """Base parameters in closed form, with a certificate.

    The stated values of the symbols decide the number of base parameters and their representatives; the closed forms
    keep the symbols.  Where relations among the values matter (``a2 = 0``), they are put in, and
    :attr:`BaseModel.special` names them.

    Parameters
    ----------
    mechanism : Mechanism, LinearModel, path-like, Experiment or sequence of Experiment
        A robot, a linear model, or the file of one; or experiments, whose rows are stacked.
    order : "base-to-tip" or "tip-to-base"
        ``"base-to-tip"`` for the classical groupings, or ``"tip-to-base"``; for mechanisms.
    prefer : str or sequence of str
        Parameters (``"M7"``) or kinds (``"MX"``) that should be representatives, most wanted first.
    generic : bool
        Answer for general values of the symbols instead of the stated ones.
    seed : int
        Seed of the random points; the result does not depend on it.
    budget : float
        How much work closed forms may take, counted in operations: 1 for a few seconds, 0 for numbers only.  Columns
        of B that are not done have numbers at the stated values instead (see ``matrix.numbers``).
    progress : callable
        Called with the step that starts, as text.

    Returns
    -------
    BaseModel or LinearBase

    Raises
    ------
    InputError
        If a linear model is to be put in the order of a mechanism, or the budget is negative.
    ClosedFormError
        If a coefficient has no closed form within the budget, and no stated values to give a number at.
    CertificateError
        If the result does not pass its own check.

    Examples
    --------
    >>> import echelon as ec
    >>> base = ec.base_parameters(ec.load("examples/panda.yaml"))
    >>> base.rank, len(base.parameters)
    (43, 70)
    """
    if isinstance(mechanism, Experiment | Sequence) and not isinstance(mechanism, str):
        mechanism = joined(
            [mechanism] if isinstance(mechanism, Experiment) else mechanism
        )
    model = model_of(mechanism)
    if isinstance(model, LinearModel):
        if order != "base-to-tip":
            raise InputError(
                "a linear model has no base and tip: choose representatives with prefer"
            )
        return linear_base_parameters(model, prefer, seed, budget, generic=generic)
    mechanism, rng = model, random_generator(seed)
    columns = column_order(mechanism.columns, order, prefer)
    progress("structure")
    recorded = virtual_power_form(mechanism)
    stated = model_at_stated_values(mechanism, recorded)
    found = specialised(mechanism, rng, stated, generic=generic)
    own, structure = found.mechanism, found.structure
    matrix = base_matrix(own, structure, columns, rng, budget, progress)
    classical = matrix
    if not generic and (firm := firm_order(own, matrix)) is not None:
        progress("other representatives")
        matrix = base_matrix(own, structure, firm, rng, budget, progress)
    progress("certificate")
    if own is not mechanism:
        recorded = virtual_power_form(own)
        stated = model_at_stated_values(own, recorded)
    certificate = certify(
        recorded, matrix, seed, None if generic else stated, structure.where_modes_meet
    )
    stated_rank = structure.rank if found.special is None else found.special.rank
    reading = report_reading(
        mechanism,
        stated_rank,
        rng,
        recorded,
        None if generic else matrix,
        structure.spectrum,
    )
    if matrix is not classical:
        reading = replace(
            reading, notes=(*reading.notes, exchange_note(own, classical, matrix))
        )
    if (
        doubt := found.doubt
        or reading.doubt
        or ("" if generic else doubt_of_coefficients(own, matrix, recorded))
    ):
        reading = replace(reading, doubt=doubt)
    return BaseModel(own, matrix, certificate, reading, seed, found.special, generic)


def base_matrix(
    mechanism: Mechanism,
    structure: Structure,
    order: tuple[int, ...],
    rng: np.random.Generator,
    budget: float,
    report: Callable[[str], None],
) -> BaseMatrix:
    """B for a column order."""
    if (
        structure.real is not None
        and not structure.by_joint
        and not named_symbols(mechanism)
    ):
        return _in_numbers(mechanism, structure.real, order)
    work = Work.of(budget)
    found = relations(mechanism, structure)
    zero = [column for column, support in structure.by_robot.items() if not support]
    classical = tuple(range(structure.parameters))
    closed = closed_columns(found, zero, rng, work, report)
    open_columns = [
        c for relation in found for c in relation.targets if c not in closed
    ]
    if not open_columns:
        matrix = assembled(mechanism.parameters, structure.pivots, closed, classical)
        other = matrix if order == classical else reordered(matrix, order, rng, work)
        if other is not None:
            return other
    report("numbers in place of closed forms")
    if any(
        isinstance(r.dependence.sampler, RealStates)
        and not closed.keys() >= {*r.targets}
        for r in found
    ):
        silent = sorted(all_symbols(mechanism) - known_values(mechanism).keys())
        if silent:
            raise ClosedFormError(
                f"not all coefficients have closed forms within the budget, and the symbol '{silent[0]}' has no value: "
                "give it a value, or give a larger budget (--budget)"
            )
        stated = real_structure(mechanism, rng, rows_of(mechanism), in_numbers=True)
        assert stated.real is not None
        return _in_numbers(
            mechanism, stated.real, order, closed if order == classical else {}
        )
    # fractions that were not found although enough work was left are longer than anybody reads
    cheap = (
        r
        for r in found
        if not r.dependence.symbols
        and MOST_PRIMES * r.dependence.cost < work.operations
    )
    short = all(closed.keys() >= {*r.targets} for r in cheap)
    columns = StatedColumns(mechanism, found, zero, order, rng, exact=short)
    if order != classical:  # an exchange of representatives mixes the columns
        pivots = set(columns.pivots)
        closed, open_columns = {}, [c for c in classical if c not in pivots]
    numbers, meaning = columns.numbers(open_columns)
    return assembled(
        mechanism.parameters, columns.pivots, closed | numbers, order, meaning
    )


def _in_numbers(
    mechanism: Mechanism,
    independent: Independent,
    order: tuple[int, ...],
    known: Mapping[int, Mapping[int, RationalFunction]] | None = None,
) -> BaseMatrix:
    """B in numbers at the stated values of all symbols, but for columns with known closed forms."""
    at = value_texts(mechanism, all_symbols(mechanism))
    roots = zip(
        symbol_roles(mechanism).irrational,
        irrational_roots(rows_of(mechanism).forms),
        strict=True,
    )
    first, second = (a or b for a, b in roots)
    named = bool(named_symbols(mechanism))
    return in_numbers(
        mechanism.parameters,
        independent,
        order,
        at,
        (first, second),
        named=named,
        known=known,
    )


def base_of(source: BaseModel | Mechanism | Readable) -> BaseModel:
    """A set of base parameters: as given, as saved, or derived from a robot or its file."""
    found = source if isinstance(source, BaseModel | Mechanism) else loaded(source)
    if isinstance(found, BaseModel):
        return found
    if not isinstance(found, Mechanism):
        raise InputError(
            f"a robot is needed, not a {type(found).__name__}", source=str(source)
        )
    return base_parameters(found)


@public
def base_structure(
    mechanism: Mechanism | Readable, *, generic: bool = False, seed: int = DEFAULT_SEED
) -> Structure:
    """Rank and representatives only, without closed forms.

    Warns with a :class:`~echelon.DoubtWarning` of what speaks against the rank, which :attr:`BaseModel.reading` tells
    as its ``doubt``.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        A robot, or the file of one.
    generic : bool
        Answer for general values of the symbols instead of the stated ones.
    seed : int

    Returns
    -------
    Structure
    """
    model, rng = mechanism_of(mechanism), random_generator(seed)
    if model.closures and not generic:
        beside, ways = from_regular_pose(model, rng)
        answer = SpecialisedMechanism(
            beside, replace(stated_structure(beside, rng), ways=ways)
        )
    else:
        answer = specialised(model, rng, generic=generic)
    if doubt := answer.doubt or doubt_of_loops(answer.mechanism):
        warnings.warn(
            doubt, DoubtWarning, stacklevel=3
        )  # of the caller, behind the door
    return answer.structure


# -- the stated values -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SpecialisedMechanism:
    """A mechanism with the relations among its stated values that its structure depends on put in."""

    mechanism: Mechanism
    structure: Structure  # for general values of the symbols that are left, which is that at the stated values
    special: SpecialValues | None = (
        None  # none where the stated values are like any others
    )
    undecided: str = ""  # why the structure at the stated values was not found

    @property
    def doubt(self) -> str:
        """Reason to doubt the set; empty if there is none."""
        return self.undecided or self.structure.doubt


def specialised(
    mechanism: Mechanism,
    rng: np.random.Generator,
    stated: AtStatedValues | None = None,
    *,
    generic: bool = False,
) -> SpecialisedMechanism:
    """A mechanism for its stated values, and its structure there; ``stated`` spares recording the model again."""
    mechanism, ways = from_regular_pose(mechanism, rng)
    values = stated_values(mechanism)
    try:
        structure = replace(find_structure(mechanism, rng), ways=ways)
    except (
        DegenerateSampleError
    ):  # loops such as Bennett's, whose lengths cannot be chosen freely
        if generic:
            raise InputError(
                "the loops close only at the stated lengths: leave generic out"
            ) from None
        return SpecialisedMechanism(
            mechanism, replace(stated_structure(mechanism, rng), ways=ways)
        )
    if not values.names:
        return SpecialisedMechanism(mechanism, structure)
    if structure.functions_are_free:  # as at the stated values
        return SpecialisedMechanism(mechanism, structure)
    if structure.real is None:
        stated = stated or model_at_stated_values(mechanism)
        if _is_general(structure, stated, rng):
            related = stated.fractions_of_pi and not _shown_in_balls(
                mechanism, structure, stated, rng
            )
            return SpecialisedMechanism(
                mechanism, structure, undecided=_FRACTIONS_OF_PI if related else ""
            )
    try:
        at_values = stated_structure(mechanism, rng)
    except EchelonError as error:
        if mechanism.closures:
            raise
        undecided = f"for general symbols, since at the stated values {error}"
        return SpecialisedMechanism(mechanism, structure, undecided=undecided)
    if at_values.pivots == structure.pivots:
        return SpecialisedMechanism(mechanism, structure)

    def pivots_of(put_in: Mapping[str, Polynomial]) -> tuple[int, ...]:
        return find_structure(with_values(mechanism, put_in), rng).pivots

    relations = RelationSearch(values, at_values.pivots, pivots_of).find()
    own = with_values(mechanism, relations.put_in(values))
    special = SpecialValues(structure.rank, at_values.rank, relations.texts(values))
    if generic:
        return SpecialisedMechanism(mechanism, structure, special)
    return SpecialisedMechanism(
        own, replace(find_structure(own, rng), ways=ways), special
    )


def _is_general(
    structure: Structure, stated: AtStatedValues, rng: np.random.Generator
) -> bool:
    """Whether the general representatives are proved independent at the stated values."""
    try:
        return stated.minor(structure.pivots, rng).rank == structure.rank
    except InputError:  # what that means is found with the structure there
        return False


_FRACTIONS_OF_PI = (
    "for general angles; at the stated values sums of angles leave fewer, and Echelon does not detect such sums: "
    "write one angle in terms of the other, such as  alpha: pi - beta"
)


def _shown_in_balls(
    mechanism: Mechanism,
    structure: Structure,
    stated: AtStatedValues,
    rng: np.random.Generator,
) -> bool:
    """Whether the representatives are independent at the true sines of fractions of π."""
    others = set(range(structure.parameters)) - set(structure.pivots)
    rows = tuple({pivot: RationalFunction(1)} for pivot in structure.pivots)
    matrix = BaseMatrix(
        mechanism.parameters,
        structure.pivots,
        rows,
        (*structure.pivots, *sorted(others)),
    )
    try:
        check_in_balls(virtual_power_form(mechanism), matrix, (), stated.texts, rng)
    except CertificateError:
        return False
    return True


def model_at_stated_values(
    mechanism: Mechanism, recorded: LinearForms | None = None
) -> AtStatedValues:
    """Rows of a mechanism with values put in for its symbols, for certificates.

    Parameters
    ----------
    mechanism : Mechanism
    recorded : LinearForms, optional
        Its rows for general values, if they are known.
    """

    def record() -> LinearForms:
        put_in = at_stated_values(mechanism)
        if put_in is mechanism and recorded is not None:
            return recorded
        return virtual_power_form(put_in)

    values = stated_values(mechanism)
    texts = value_texts(mechanism, all_symbols(mechanism))
    fractions_of_pi = any(turns for _, _, turns in values.multiples.values())
    rounded = [
        name
        for name in inexact_symbols(mechanism)
        if mechanism.symbols[name].tangent_squared is None
    ]
    approximate = tuple(sorted(rounded))
    everywhere = has_values(mechanism)
    in_effects = {name for effect in mechanism.effects for name in effect.symbols}
    plain = recorded is not None and in_effects.isdisjoint(values.names)
    drawn = (recorded, values) if recorded is not None and plain else None
    return AtStatedValues(
        record,
        texts,
        bool(values.names),
        everywhere,
        fractions_of_pi,
        approximate,
        drawn,
    )
