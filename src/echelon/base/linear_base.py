"""Base parameters of a general linear model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.base.base_set import BaseSet
from echelon.base.certificate import Certificate, certify
from echelon.base.matrix import BaseMatrix
from echelon.errors import ClosedFormError, InputError, UnknownRelationsError
from echelon.exact.work import Work
from echelon.models.evaluation import definition_values, evaluate_model
from echelon.models.linear_model import LinearModel
from echelon.program.sympy_bridge import to_sympy
from echelon.seeds import random_generator

if TYPE_CHECKING:
    import sympy

Floats = npt.NDArray[np.float64]
FINITE_FIELD, BALLS = "finite field", "balls"


@dataclass(frozen=True, repr=False)
class LinearBase(BaseSet):
    """Base parameters ζ̄ = B ζ of a linear model, with their evidence.

    Made by :func:`echelon.base_parameters`.

    Attributes
    ----------
    model : LinearModel
    matrix : BaseMatrix
        Exact sparse B.
    definitions : mapping of str to str
        Functions of constants that occur in B, such as ``exp[k]``, as expressions.
    route : str
        ``"finite field"`` for exact algebra, ``"balls"`` where relations between functions were not known.
    certificate : Certificate or BallEvidence
    seed : int
    """

    model: LinearModel
    matrix: BaseMatrix
    definitions: Mapping[str, str]
    route: str
    certificate: Any
    seed: int

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of every base parameter."""
        return tuple(self.model.units[p] for p in self.matrix.pivots)

    @cached_property
    def B(self) -> sympy.ImmutableSparseMatrix:
        """B as a sympy matrix in the model's constants, shape (base parameters, parameters)."""
        return self.matrix.sympy(self._defined({}))

    @cached_property
    def B_exact(self) -> sympy.ImmutableSparseMatrix:
        """B with the constants' exact values put in.

        Raises
        ------
        InputError
            If a constant has no value.
        """
        import sympy

        used = self._constants_used()
        silent = [n for n in used if self.model.constants[n] is None]
        if silent:
            raise InputError(f"constant '{silent[0]}' has no value")
        values = {n: sympy.Rational(str(self.model.constants[n])) for n in used}
        return self.matrix.sympy({**values, **self._defined(values)})

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
        silent = [n for n in self._constants_used() if n not in known]
        if silent:
            raise InputError(f"constant '{silent[0]}' has no value: give it in constants=")
        return self.matrix.floats({**known, **definition_values(self.definitions, known)})

    def values(self, parameters: npt.ArrayLike, constants: Mapping[str, float] | None = None) -> Floats:
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
            raise InputError(f"expected {len(self.parameters)} parameters, got an array of shape {zeta.shape}")
        result: Floats = self.B_float(constants) @ zeta
        return result

    def regressor(self, variables: Mapping[str, npt.ArrayLike], constants: Mapping[str, float] | None = None) -> Floats:
        """The reduced regressor X̄, the pivot columns of X, at given samples.

        Parameters
        ----------
        variables : mapping of str to array of shape (N,)
        constants : mapping of str to float, optional

        Returns
        -------
        array of shape (N, outputs, base parameters)
        """
        return evaluate_model(self.model, self.model.regressor.columns(self.matrix.pivots), variables, constants)

    def full_regressor(
        self, variables: Mapping[str, npt.ArrayLike], constants: Mapping[str, float] | None = None
    ) -> Floats:
        """The regressor X at given samples.

        Parameters
        ----------
        variables : mapping of str to array of shape (N,)
        constants : mapping of str to float, optional

        Returns
        -------
        array of shape (N, outputs, parameters)
        """
        return evaluate_model(self.model, self.model.regressor, variables, constants)

    def _constants_used(self) -> list[str]:
        from echelon.models.evaluation import recorded_definitions

        plain = {s for s in self.matrix.symbols if s not in self.definitions}
        program, _ = recorded_definitions({n: d for n, d in self.definitions.items() if n in self.matrix.symbols})
        return sorted(plain | {i.name for i in program.inputs.values()})

    def _defined(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The functions of constants as sympy expressions."""
        import sympy

        from echelon.models.evaluation import recorded_definitions

        program, nodes = recorded_definitions(self.definitions)
        replaced = {sympy.Symbol(name): value for name, value in values.items()}
        formulas = to_sympy(program, list(nodes.values()))
        return {name: e.subs(replaced) for name, e in zip(nodes, formulas, strict=True)}

    def __repr__(self) -> str:
        return f"LinearBase({self.model.name}: {self.rank} base parameters of {len(self.parameters)})"

    def __str__(self) -> str:
        from echelon.base.linear_display import to_text

        return to_text(self)

    def _repr_latex_(self) -> str:
        from echelon.base.linear_display import aligned_latex

        return f"$${aligned_latex(self)}$$"


def linear_base_parameters(model: LinearModel, prefer: Sequence[str], seed: int, budget: float = 1.0) -> LinearBase:
    """Base parameters of a linear model: exact where relations are known, by ball arithmetic where not.

    Ball arithmetic also gives numbers where closed forms take more than the budget and all constants have values.

    Parameters
    ----------
    model : LinearModel
    prefer : sequence of str
        Parameters that should be representatives, most wanted first.
    seed : int
    budget : float
        How much work closed forms may take.

    Raises
    ------
    ClosedFormError
        If a coefficient has no closed form within the budget, and a constant has no value.
    """
    from echelon.base.linear_balls import BallStructure
    from echelon.base.linear_structure import LinearStructure

    strangers = [p for p in prefer if p not in model.parameters]
    if strangers:
        raise InputError(f"'{strangers[0]}' is not a parameter (parameters: {', '.join(model.parameters)})")
    wanted = [model.parameters.index(p) for p in dict.fromkeys(prefer)]
    order = (*wanted, *(c for c in range(len(model.parameters)) if c not in wanted))
    rng = random_generator(seed)
    try:
        structure = LinearStructure(model.regressor, model.parameters, order, rng)
        matrix = structure.matrix(structure.dependences(), Work.of(budget))
    except (UnknownRelationsError, ClosedFormError) as error:
        try:
            found, decimals, evidence = BallStructure(model, order, rng).solve()
        except ClosedFormError as second:
            raise (error if isinstance(error, ClosedFormError) else second) from None
        return LinearBase(model, found, decimals, BALLS, evidence, seed)
    certificate: Certificate = certify(model.regressor, matrix, seed)
    definitions = {n: d for n, d in structure.sampler.definitions.items() if n in matrix.symbols}
    return LinearBase(model, matrix, definitions, FINITE_FIELD, certificate, seed)
