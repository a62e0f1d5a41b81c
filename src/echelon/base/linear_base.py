"""Base parameters of a general linear model.

Unlike a robot, a linear model has no chain to follow: all columns are eliminated at once.  Every sample set visits all
known regions of signs.  Samples are added until twice as many, in another field, give the same dependences: had a
region more to show, one more point of it would have shown some of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.base.base_set import BaseSet
from echelon.base.certificate import Certificate, certify
from echelon.base.matrix import BaseMatrix
from echelon.base.value_relations import RelationSearch, SpecialValues
from echelon.errors import ClosedFormError, DegenerateSampleError, EchelonError, InputError, UnknownRelationsError
from echelon.exact.ansatz import Geometry
from echelon.exact.elimination import reduced_echelon, solve_batched
from echelon.exact.field import PrimeField, Residues
from echelon.exact.interpolation import interpolate
from echelon.exact.numbers import Surd, parts_of
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction
from echelon.exact.unknown import UnknownFunctions, Work
from echelon.mechanism.stated import StatedValues
from echelon.models.evaluation import definition_values, evaluate_model
from echelon.models.linear_model import LinearModel
from echelon.program.sympy_bridge import to_sympy
from echelon.regressor.linear import LinearForms
from echelon.seeds import random_generator

if TYPE_CHECKING:
    import sympy

    from echelon.base.symbolic import Form, SymbolicRegressor


_SURPLUS_ROWS, _ATTEMPTS, _MOST_ROWS = 8, 64, 20_000

Supports = Mapping[int, tuple[int, ...]]
"""For every dependent column, the pivots that it depends on."""


class LinearStructure:
    """Elimination of the columns of a model's regressor."""

    def __init__(
        self, forms: LinearForms, parameters: tuple[str, ...], order: tuple[int, ...], rng: np.random.Generator
    ) -> None:
        self.forms, self.parameters, self.order, self.rng = forms, parameters, order, rng
        self.sampler = forms.sampler()

    def dependences(self) -> Supports:
        """Dependent columns, confirmed by more samples in another field."""
        rows, previous = max(self.forms.shape[1] + _SURPLUS_ROWS, self.sampler.regions * self.forms.shape[0]), None
        for _ in range(_ATTEMPTS):
            field = PrimeField.random(self.rng)
            try:
                current = self._supports(field, rows)
            except DegenerateSampleError:
                continue
            if current == previous:
                return current
            previous, rows = current, min(2 * rows, max(_MOST_ROWS, 2 * self.sampler.regions * self.forms.shape[0]))
        raise EchelonError("random points keep contradicting each other; please report this model")

    def matrix(self, supports: Supports, work: Work) -> BaseMatrix:
        """B in closed form."""
        pivots = tuple(c for c in self.order if c not in supports)
        rows: dict[int, dict[int, RationalFunction]] = {p: {p: RationalFunction(1)} for p in pivots}
        pairs = [(s, t) for t in supports for s in supports[t]]
        for (source, target), function in zip(pairs, self._interpolated(pairs, work), strict=True):
            rows[source][target] = function
        return BaseMatrix(self.parameters, pivots, tuple(dict(sorted(rows[p].items())) for p in pivots), self.order)

    # -- samples -------------------------------------------------------------------------------------------------

    def _sample(self, field: PrimeField, geometry: Geometry, states: int) -> Residues:
        """X at random states: array of shape (geometries, states · outputs, parameters)."""
        return self.forms.stacked(self.sampler.evaluate(field, self.rng, states, geometry))

    def _supports(self, field: PrimeField, rows: int) -> Supports:
        states = -(-rows // self.forms.shape[0])
        geometry = {s: field.draw(self.rng, (1,)) for s in self.sampler.symbols}
        reduced, pivots = reduced_echelon(self._sample(field, geometry, states)[0][:, list(self.order)], field)
        free = [k for k in range(len(self.order)) if k not in set(pivots)]
        return {
            self.order[k]: tuple(self.order[p] for row, p in enumerate(pivots) if int(reduced[row, k])) for k in free
        }

    # -- closed forms --------------------------------------------------------------------------------------------

    def _interpolated(self, pairs: list[tuple[int, int]], work: Work) -> list[RationalFunction]:
        if not pairs:
            return []
        sources, targets = sorted({s for s, _ in pairs}), sorted({t for _, t in pairs})
        wanted = np.array([sources.index(s) * len(targets) + targets.index(t) for s, t in pairs])

        def evaluate(field: PrimeField, geometry: Geometry) -> Residues:
            found: Residues = self._coefficients(field, geometry, sources, targets)[wanted]
            return found

        unknown = UnknownFunctions(
            evaluate,
            self.sampler.symbols,
            self.sampler.angles,
            frozenset(),
            [0] * len(pairs),
            _irrational(self.forms),
            self._cost(len(sources), len(targets)),
        )
        advice = "give constants values, or a name of their own to products of them, or a larger budget (--budget)"
        try:
            functions = interpolate(unknown, self.rng, work)
        except ClosedFormError as error:
            raise ClosedFormError(f"{error}; {advice}") from None
        found = [f for f in functions if f is not None]
        if len(found) < len(functions):
            missing = len(functions) - len(found)
            raise ClosedFormError(f"{missing} coefficients have no closed form within the budget; {advice}")
        return found

    def _cost(self, sources: int, targets: int) -> float:
        """Operations of one evaluation."""
        program = len(self.forms.program.needed(list(self.forms.entries.values())))
        return float((sources + 2) * (program + sources * (sources + targets)))

    def _coefficients(self, field: PrimeField, geometry: Geometry, sources: list[int], targets: list[int]) -> Residues:
        """Coefficients at given constants: array of shape (sources · targets, geometries)."""
        rows = len(sources) + 2
        for _ in range(_ATTEMPTS):
            table = self._sample(field, geometry, -(-rows // self.forms.shape[0]))
            try:
                solution = solve_batched(table[:, :, sources], table[:, :, targets], field)
            except DegenerateSampleError:
                rows = 2 * rows  # regions of signs may need more samples
                if rows > _MOST_ROWS:
                    raise
                continue
            return solution.reshape(len(solution), -1).T
        raise DegenerateSampleError("dependent samples")


def _irrational(forms: LinearForms) -> tuple[bool, bool]:
    """Whether √2 and √3 occur in the model."""
    program = forms.program
    needed = program.needed(forms.entries.values())
    parts = [parts_of(c) for n in needed if isinstance(c := program.constants.get(n), Surd)]
    return any(p[1] or p[3] for p in parts), any(p[2] or p[3] for p in parts)


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
    special : SpecialValues, optional
        What the stated values of constants change against general ones; None where they change nothing.
    """

    model: LinearModel
    matrix: BaseMatrix
    definitions: Mapping[str, str]
    route: str
    certificate: Any
    seed: int
    special: SpecialValues | None = None

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
        import sympy

        used = self._constants_used()
        silent = [n for n in used if self.model.constants[n] is None]
        if silent:
            raise InputError(f"constant '{silent[0]}' has no value")
        values = {n: sympy.Rational(str(self.model.constants[n])) for n in used}
        return self.matrix.sympy(self._formulas(values))

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
        from echelon.base.symbolic import symbolic_regressor

        forms = self.model.regressor.columns(self.matrix.pivots)
        return symbolic_regressor(self.model.name, forms, self.model.outputs, self.pivots, form)

    def _constants_used(self) -> list[str]:
        from echelon.models.evaluation import recorded_definitions

        plain = {s for s in self.matrix.symbols if s not in self.definitions}
        program, _ = recorded_definitions({n: d for n, d in self.definitions.items() if n in self.matrix.symbols})
        return sorted(plain | {i.name for i in program.inputs.values()})

    def _formulas(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Constants with values put in, and functions of constants as sympy expressions."""
        import sympy

        from echelon.models.evaluation import recorded_definitions

        program, nodes = recorded_definitions(self.definitions)
        replaced = {sympy.Symbol(name): value for name, value in values.items()}
        formulas = to_sympy(program, list(nodes.values()))
        return dict(values) | {name: e.subs(replaced) for name, e in zip(nodes, formulas, strict=True)}

    def __repr__(self) -> str:
        return f"LinearBase({self.model.name}: {self.rank} base parameters of {len(self.parameters)})"

    def __str__(self) -> str:
        from echelon.base.linear_display import to_text

        return to_text(self)

    def _repr_latex_(self) -> str:
        from echelon.base.linear_display import aligned_latex

        return f"$${aligned_latex(self)}$$"


def linear_base_parameters(
    model: LinearModel, prefer: Sequence[str], seed: int, budget: float = 1.0, *, generic: bool = False
) -> LinearBase:
    """Base parameters of a linear model: exact where relations are known, by ball arithmetic where not.

    Ball arithmetic also gives numbers where closed forms take more than the budget and all constants have values.
    """
    from echelon.base.linear_balls import BallStructure
    from echelon.base.linear_base import LinearStructure

    strangers = [p for p in prefer if p not in model.parameters]
    if strangers:
        raise InputError(f"'{strangers[0]}' is not a parameter (parameters: {', '.join(model.parameters)})")
    wanted = [model.parameters.index(p) for p in dict.fromkeys(prefer)]
    order = (*wanted, *(c for c in range(len(model.parameters)) if c not in wanted))
    rng = random_generator(seed)
    try:
        own, special = _own_model(model, order, rng)
        own = model if generic else own
        structure = LinearStructure(own.regressor, own.parameters, order, rng)
        matrix = structure.matrix(structure.dependences(), Work.of(budget))
    except (UnknownRelationsError, ClosedFormError) as error:
        try:
            found, decimals, evidence = BallStructure(model, order, rng).solve()
        except ClosedFormError as second:
            raise (error if isinstance(error, ClosedFormError) else second) from None
        if isinstance(error, UnknownRelationsError):
            evidence = replace(evidence, reason=error.reason)
        return LinearBase(model, found, decimals, BALLS, evidence, seed)
    certificate: Certificate = certify(own.regressor, matrix, seed)
    definitions = {n: d for n, d in structure.sampler.definitions.items() if n in matrix.symbols}
    return LinearBase(own, matrix, definitions, FINITE_FIELD, certificate, seed, special)


def _own_model(
    model: LinearModel, order: tuple[int, ...], rng: np.random.Generator
) -> tuple[LinearModel, SpecialValues | None]:
    """The model with the relations among its stated constants put in that change its structure."""
    from echelon.base.linear_base import LinearStructure

    values = StatedValues({name: value for name, value in model.constants.items() if value is not None}, {}, {})

    def pivots_of(put_in: Mapping[str, Polynomial]) -> tuple[int, ...]:
        forms = model.with_constants(put_in).regressor if put_in else model.regressor
        supports = LinearStructure(forms, model.parameters, order, rng).dependences()
        return tuple(c for c in order if c not in supports)

    general = pivots_of({})
    stated = pivots_of(values.put_in(values.names)) if values.names else general
    if stated == general:
        return model, None
    relations = RelationSearch(values, stated, pivots_of).find()
    own = model.with_constants(relations.put_in(values))
    return own, SpecialValues(len(general), len(stated), relations.texts(values))
