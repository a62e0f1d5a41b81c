"""Base parameters of a general linear model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from echelon.algebra import Polynomial, Work, random_generator
from echelon.base.ball_rows import irrational_roots
from echelon.base.certificate import AtStatedValues, Certificate, certify
from echelon.base.closed_form import assembled, closed_columns, linear_relations
from echelon.base.matrix import BaseMatrix
from echelon.base.model import BaseSet
from echelon.base.real_matrix import in_numbers
from echelon.base.real_states import RealStates
from echelon.base.stated_values import RelationSearch, SpecialValues
from echelon.base.structure import linear_structure
from echelon.dynamics import LinearForms, LinearModel, Rows, evaluate_model
from echelon.robot import StatedValues
from echelon.shared import ClosedFormError, Floats, Form, InputError, extra, public

if TYPE_CHECKING:
    import sympy

    from echelon.base.symbolic import SymbolicRegressor


@public
@dataclass(frozen=True, repr=False)
class LinearBase(BaseSet):
    """Base parameters ζ̄ = B ζ of a linear model, with their evidence.

    Made by :func:`echelon.base_parameters`.

    Attributes
    ----------
    model : LinearModel
    matrix : BaseMatrix
        Exact sparse B.
    certificate : Certificate
    seed : int
    special : SpecialValues, optional
        Change of the answer by the stated values of constants; None if there is none.
    generic : bool
        Whether the answer is for general values of the constants and not for the stated ones.
    """

    model: LinearModel
    matrix: BaseMatrix
    certificate: Certificate
    seed: int
    special: SpecialValues | None = None
    generic: bool = False

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of every base parameter."""
        return tuple(self.model.units[p] for p in self.matrix.pivots)

    @cached_property
    def B_exact(self) -> sympy.ImmutableSparseMatrix:
        """B with the constants' exact values put in.

        Raises
        ------
        InputError
            If a constant has no value.
        """
        with extra("symbolic"):
            import sympy

        used = self._constants_used()
        silent = [n for n in used if self.model.constants[n] is None]
        if silent:
            raise InputError(f"constant '{silent[0]}' has no value")
        return self.matrix.sympy(
            {n: sympy.Rational(str(self.model.constants[n])) for n in used}
        )

    def B_float(self, constants: Mapping[str, float] | None = None) -> Floats:
        """B in double precision.

        Parameters
        ----------
        constants : mapping of str to float, optional
            Values that replace or complete those of the model.

        Returns
        -------
        array of shape (base parameters, parameters)
        """
        known = {**self.model.values, **(constants or {})}
        other = (
            next(
                (n for n in self.matrix.numbers.at if known[n] != self.model.values[n]),
                None,
            )
            if self.matrix.numbers
            else None
        )
        if other is not None:
            raise InputError(
                f"columns of B are numbers at {other} = {self.model.values[other]}: derive again with the other value"
            )
        silent = [n for n in self._constants_used() if n not in known]
        if silent:
            raise InputError(
                f"constant '{silent[0]}' has no value: give it in constants="
            )
        return self.matrix.floats(known)

    def values(
        self, parameters: npt.ArrayLike, constants: Mapping[str, float] | None = None
    ) -> Floats:
        """Base parameters ζ̄ = B ζ.

        Parameters
        ----------
        parameters : array of shape (n,)
            In the order of :attr:`parameters`.
        constants : mapping of str to float, optional

        Returns
        -------
        array of shape (r,)
        """
        zeta = np.asarray(parameters, dtype=float)
        if zeta.shape != (len(self.parameters),):
            raise InputError(
                f"expected {len(self.parameters)} parameters, got an array of shape {zeta.shape}"
            )
        result: Floats = self.B_float(constants) @ zeta
        return result

    def regressor(
        self,
        variables: Mapping[str, npt.ArrayLike],
        constants: Mapping[str, float] | None = None,
    ) -> Floats:
        """The reduced regressor X̄, the pivot columns of X, at given samples.

        Parameters
        ----------
        variables : mapping of str to array of shape (N,), or to float for one sample
        constants : mapping of str to float, optional

        Returns
        -------
        array of shape (N, outputs, base parameters), or (outputs, base parameters) for one sample
        """
        return evaluate_model(
            self.model,
            self.model.regressor.columns(self.matrix.pivots),
            variables,
            constants,
        )

    def full_regressor(
        self,
        variables: Mapping[str, npt.ArrayLike],
        constants: Mapping[str, float] | None = None,
    ) -> Floats:
        """The regressor X at given samples.

        Parameters
        ----------
        variables : mapping of str to array of shape (N,), or to float for one sample
        constants : mapping of str to float, optional

        Returns
        -------
        array of shape (N, outputs, parameters), or (outputs, parameters) for one sample
        """
        return evaluate_model(self.model, self.model.regressor, variables, constants)

    def symbolic_regressor(self, form: Form = "auto") -> SymbolicRegressor:
        """The reduced regressor X̄ as formulas in the variables and constants.

        Parameters
        ----------
        form : "auto", "short" or "named"
            As for :meth:`BaseModel.symbolic_regressor`.

        Returns
        -------
        SymbolicRegressor
        """
        from echelon.base.formulas import symbolic_regressor

        forms = self.model.regressor.columns(self.matrix.pivots)
        return symbolic_regressor(
            self.model.name, forms, self.model.outputs, self.pivots, form
        )

    @property
    def _known(self) -> Mapping[str, float]:
        return self.model.values

    def _constants_used(self) -> list[str]:
        return sorted(self.matrix.symbols)

    def __repr__(self) -> str:
        return f"LinearBase({self.model.name}: {self.rank} base parameters of {len(self.parameters)})"

    def __str__(self) -> str:
        from echelon.base.display import to_text

        return to_text(self)

    def _repr_latex_(self) -> str:
        from echelon.base.display import aligned_latex

        return f"$${aligned_latex(self)}$$"


def linear_base_parameters(
    model: LinearModel,
    prefer: Sequence[str],
    seed: int,
    budget: float = 1.0,
    *,
    generic: bool = False,
) -> LinearBase:
    """Base parameters of a linear model."""
    strangers = [p for p in prefer if p not in model.parameters]
    if strangers:
        raise InputError(
            f"'{strangers[0]}' is not a parameter (parameters: {', '.join(model.parameters)})"
        )
    wanted = [model.parameters.index(p) for p in dict.fromkeys(prefer)]
    order = (*wanted, *(c for c in range(len(model.parameters)) if c not in wanted))
    rng = random_generator(seed)
    own, special = _own_model(model, order, rng)
    own = model if generic else own
    matrix = _matrix(own, order, rng, Work.of(budget), generic=generic)
    stated = None if generic else model_at_stated_values(own)
    certificate = certify(own.regressor, matrix, seed, stated)
    return LinearBase(own, matrix, certificate, seed, special, generic)


def _matrix(
    model: LinearModel,
    order: tuple[int, ...],
    rng: np.random.Generator,
    work: Work,
    *,
    generic: bool,
) -> BaseMatrix:
    """B for an order of the columns, all at once: unlike a robot, a linear model has no chain to follow.

    Coefficients that are no rational functions of constants, such as exp(k), are numbers at the stated values.
    """
    forms = model.regressor.columns(order)
    structure = linear_structure(forms, rng)
    zero = [column for column, support in structure.by_robot.items() if not support]
    closed = closed_columns(
        linear_relations(forms, structure), zero, rng, work, lambda _: None, share=1.0
    )
    found = {
        order[t]: {order[p]: c for p, c in combination.items()}
        for t, combination in closed.items()
    }
    open_columns = [column for column in structure.by_robot if column not in closed]
    if not open_columns:
        return assembled(
            model.parameters, tuple(order[p] for p in structure.pivots), found, order
        )
    silent = sorted(model.constants.keys() - stated_texts(model).keys())
    if silent or generic:
        missing = sum(len(structure.by_robot[column]) for column in open_columns)
        raise ClosedFormError(
            f"{missing} coefficients have no closed form within the budget; give constants values"
            f"{f' (such as {silent[0]})' if silent else ''}, or a name of their own to products or functions of them, "
            "or a larger budget (--budget)"
        )
    independent = RealStates(Rows(model.regressor, 0)).independent()
    at = stated_texts(model)
    return in_numbers(
        model.parameters,
        independent,
        order,
        at,
        irrational_roots(model.regressor),
        named=bool(at),
        known=found,
    )


def linear_special(
    model: LinearModel, order: tuple[int, ...], rng: np.random.Generator
) -> SpecialValues | None:
    """The change of the rank by the stated constants, against general ones; None where they change nothing.

    Parameters
    ----------
    model : LinearModel
    order : tuple of int
        Columns from most to least preferred as representative.
    rng : numpy.random.Generator
    """
    return _own_model(model, order, rng)[1]


def _own_model(
    model: LinearModel, order: tuple[int, ...], rng: np.random.Generator
) -> tuple[LinearModel, SpecialValues | None]:
    """The model with the relations among its stated constants put in that change its structure."""
    values = _stated_values(model)

    def pivots_of(put_in: Mapping[str, Polynomial]) -> tuple[int, ...]:
        forms = model.with_constants(put_in).regressor if put_in else model.regressor
        return tuple(
            order[p] for p in linear_structure(forms.columns(order), rng).pivots
        )

    general = pivots_of({})
    stated = pivots_of(values.put_in(values.names)) if values.names else general
    if stated == general:
        return model, None
    relations = RelationSearch(values, stated, pivots_of).find()
    own = model.with_constants(relations.put_in(values))
    return own, SpecialValues(len(general), len(stated), relations.texts(values))


def model_at_stated_values(model: LinearModel) -> AtStatedValues:
    """Rows of a linear model with values put in for its constants, for certificates."""
    values = _stated_values(model)

    def record() -> LinearForms:
        return (
            model.with_constants(values.put_in(values.names)).regressor
            if values.names
            else model.regressor
        )

    texts = stated_texts(model)
    return AtStatedValues(
        record, texts, bool(texts), len(texts) == len(model.constants)
    )


def stated_texts(model: LinearModel) -> dict[str, str]:
    """Exact values of the constants that have one, as text."""
    numbers = sorted(_stated_values(model).numbers.items())
    return {name: str(value) for name, value in numbers} | dict(model.generic)


def _stated_values(model: LinearModel) -> StatedValues:
    """Exact values of the constants that have one."""
    return StatedValues(
        {name: value for name, value in model.constants.items() if value is not None},
        {},
        {},
    )
