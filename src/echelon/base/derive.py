"""From a mechanism or a linear model to its certified base parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import overload

import numpy as np

from echelon.base.certificate import certify
from echelon.base.closed_form import assembled, closed_columns, relations
from echelon.base.linear_base import LinearBase, linear_base_parameters
from echelon.base.matrix import BaseMatrix, column_order, reordered
from echelon.base.model import BaseModel
from echelon.base.own import own_answer
from echelon.base.reading_report import firm_first, report_reading
from echelon.base.stated_columns import StatedColumns
from echelon.base.structure import Structure
from echelon.errors import InputError
from echelon.exact.field import DEFAULT_SEED, random_generator
from echelon.exact.unknown import Work
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import stated_values
from echelon.models import LinearModel
from echelon.regressor.virtual_power import virtual_power_form


def _silent(_: str) -> None:
    """Report no progress."""


@overload
def base_parameters(
    mechanism: Mechanism,
    *,
    order: str = ...,
    prefer: Sequence[str] = ...,
    generic: bool = ...,
    seed: int = ...,
    budget: float = ...,
    progress: Callable[[str], None] = ...,
) -> BaseModel: ...


@overload
def base_parameters(
    mechanism: LinearModel,
    *,
    order: str = ...,
    prefer: Sequence[str] = ...,
    generic: bool = ...,
    seed: int = ...,
    budget: float = ...,
    progress: Callable[[str], None] = ...,
) -> LinearBase: ...


def base_parameters(
    mechanism: Mechanism | LinearModel,
    *,
    order: str = "base-to-tip",
    prefer: Sequence[str] = (),
    generic: bool = False,
    seed: int = DEFAULT_SEED,
    budget: float = 1.0,
    progress: Callable[[str], None] = _silent,
) -> BaseModel | LinearBase:
    """Base parameters in closed form, with a certificate.

    The stated values of the symbols decide the number of base parameters and their representatives; the closed forms
    keep the symbols.  Where relations among the values matter (``a2 = 0``), they are put in, and
    :attr:`BaseModel.special` names them.

    Parameters
    ----------
    mechanism : Mechanism or LinearModel
    order : str
        ``"base-to-tip"`` for the classical groupings, or ``"tip-to-base"``; for mechanisms.
    prefer : sequence of str
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
    if not budget >= 0:
        raise InputError(f"a budget of {budget} is not possible: 0 for numbers only, 1 is the default")
    if isinstance(mechanism, LinearModel):
        if order != "base-to-tip":
            raise InputError("a linear model has no base and tip: choose representatives with prefer")
        return linear_base_parameters(mechanism, prefer, seed, budget, generic=generic)
    rng = random_generator(seed)
    columns = column_order(mechanism.columns, order, prefer)
    progress("structure")
    recorded = virtual_power_form(mechanism)
    answer = own_answer(mechanism, rng, recorded, generic=generic)
    own, structure = answer.mechanism, answer.structure
    if own.closed_at:  # frames were moved by rounding
        columns = firm_first(own, columns, structure.rank, rng)
    matrix = base_matrix(own, structure, columns, rng, budget, progress)
    progress("certificate")
    forms = structure.on_curves(recorded if own is mechanism else virtual_power_form(own))
    certificate = certify(forms, matrix, seed, None if generic else stated_values(own), structure.modes)
    stated_rank = structure.rank if answer.special is None else answer.special.rank
    reading = report_reading(mechanism, stated_rank, rng, recorded, None if generic else matrix)
    if answer.undecided:
        reading = replace(reading, doubt=answer.undecided)
    return BaseModel(own, matrix, certificate, reading, seed, answer.special, generic)


def base_matrix(
    mechanism: Mechanism,
    structure: Structure,
    order: tuple[int, ...],
    rng: np.random.Generator,
    budget: float,
    report: Callable[[str], None],
) -> BaseMatrix:
    """B for a column order."""
    work = Work.of(budget)
    found = relations(mechanism, structure)
    zero = [column for column, support in structure.by_robot.items() if not support]
    classical = tuple(range(structure.parameters))
    closed = closed_columns(found, zero, rng, work, report)
    open_columns = [c for relation in found for c in relation.targets if c not in closed]
    if not open_columns:
        matrix = assembled(mechanism.parameters, structure.pivots, closed, classical)
        other = matrix if order == classical else reordered(matrix, order, rng, work)
        if other is not None:
            return other
    report("numbers in place of closed forms")
    stated = StatedColumns(mechanism, found, zero, order, rng)
    if order != classical:  # an exchange of representatives mixes the columns
        pivots = set(stated.pivots)
        closed, open_columns = {}, [c for c in classical if c not in pivots]
    numbers, meaning = stated.numbers(open_columns)
    return assembled(mechanism.parameters, stated.pivots, closed | numbers, order, meaning)


def base_structure(mechanism: Mechanism, *, generic: bool = False, seed: int = DEFAULT_SEED) -> Structure:
    """Rank and representatives only, without closed forms.

    Parameters
    ----------
    mechanism : Mechanism
    generic : bool
        Answer for general values of the symbols instead of the stated ones.
    seed : int

    Returns
    -------
    Structure
    """
    return own_answer(mechanism, random_generator(seed), generic=generic).structure
