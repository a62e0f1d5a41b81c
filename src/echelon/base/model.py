"""BaseModel: all that is known about what outputs can see of a mechanism; and what all sets of base parameters have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.algebra import RationalFunction, pi_generators, sympy_number
from echelon.base.certificate import Certificate
from echelon.base.evaluation import Evaluation
from echelon.base.expression import Expression, collect
from echelon.base.lift import Metric, lift, metric_matrix, pseudo_inverse_floats
from echelon.base.matrix import (
    BaseMatrix,
    Identifiability,
    Row,
    classify,
    coefficient_value,
)
from echelon.base.reading_report import ReadingReport
from echelon.base.stated_values import SpecialValues, at_values
from echelon.dynamics import (
    LinearForms,
    inverse_dynamics_regressor,
    virtual_power_form,
)
from echelon.robot import (
    Mechanism,
    characteristic_length,
    experiment_of,
    known_values,
    stated_values,
    symbol_values,
)
from echelon.shared import Floats, Form, InputError, extra, public

if TYPE_CHECKING:
    import sympy

    from echelon.base.pseudo_inverse import ExactMetric
    from echelon.base.symbolic import SymbolicRegressor


@public
class BaseSet(ABC):
    """Base parameters ζ̄ = B ζ."""

    matrix: BaseMatrix  # exact sparse B

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return self.matrix.rank

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the standard parameters, the columns of B."""
        return self.matrix.parameters

    @property
    def pivots(self) -> tuple[str, ...]:
        """Names of the representatives, one per row of B."""
        return tuple(self.parameters[p] for p in self.matrix.pivots)

    @property
    @abstractmethod
    def units(self) -> tuple[str, ...]:
        """Unit of every base parameter."""

    @abstractmethod
    def B_float(self) -> Floats:
        """B in double precision, shape (base parameters, standard parameters), at the stated values."""

    @cached_property
    def largest_coefficient(self) -> float | None:
        """The largest absolute value in B at the stated values; None where these are missing or give it no double."""
        try:
            return float(np.abs(self.B_float()).max(initial=0.0))
        except InputError:
            return None

    @cached_property
    def expressions(self) -> tuple[Expression, ...]:
        """Every base parameter in closed form, terms with equal coefficients collected."""
        decimals = (
            [self.parameters[c] for c in self.matrix.numbers.columns]
            if self.matrix.numbers
            else []
        )
        found = []
        each = zip(self.pivots, self.units, self._shown_rows, strict=True)
        for name, unit, row in each:
            terms = [(self.parameters[c], value) for c, value in sorted(row.items())]
            found.append(collect(name, unit, terms, decimals))
        return tuple(found)

    @cached_property
    def readable(self) -> tuple[Expression, ...]:
        """The expressions with coefficients of more than a dozen terms as their values at the stated numbers.

        Where symbols have no values, the number of terms stands in their place.
        """
        return tuple(
            expression.readable(self._value) for expression in self.expressions
        )

    def _value(self, coefficient: RationalFunction) -> float | None:
        """A coefficient at the stated values; None where these are missing or give it no double."""
        known = self._known
        if not set(coefficient.symbols()) <= known.keys():
            return None
        try:
            return coefficient_value(coefficient, known)
        except InputError:
            return None

    @property
    @abstractmethod
    def _known(self) -> Mapping[str, float]:
        """Stated values of symbols of B."""

    @cached_property
    def classification(self) -> dict[str, Identifiability]:
        """For every standard parameter, whether it can be identified alone, in combination, or not at all."""
        return classify(self.matrix)

    @cached_property
    def B(self) -> sympy.ImmutableSparseMatrix:
        """B as a sympy matrix in the model's constants, shape (base parameters, standard parameters)."""
        return self.matrix.sympy(self._formulas({}))

    def pseudo_inverse(self, metric: ExactMetric = "identity") -> sympy.ImmutableMatrix:
        """B† = S Bᵀ (B S Bᵀ)⁻¹ in closed form, for a given metric S (Theorem 1 of the paper); B · B† = 1 is checked.

        >>> import echelon as ec
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> base.pseudo_inverse()[19, 1]
        l1/(l1**4 + l1**2 + 1)
        """
        from echelon.base.pseudo_inverse import pseudo_inverse

        return pseudo_inverse(self.matrix, metric, self._formulas({}))

    @property
    def _shown_rows(self) -> Sequence[Row]:
        """Rows of B with the coefficients that people read."""
        return self.matrix.rows

    def _formulas(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Sympy expressions for constants of B that are not symbols, with values put in."""
        return dict(values)


ROUNDED_COEFFICIENT = 1e-11
"""Coefficient up to which rounding of doubles where loops close may have made it."""


@public
@dataclass(frozen=True, repr=False)
class BaseModel(BaseSet, Evaluation):
    """Base parameters ζ̄ = B ζ of a mechanism, with their evidence.

    Made by :func:`echelon.base_parameters` or :func:`echelon.load_base`.

    Attributes
    ----------
    mechanism : Mechanism
    matrix : BaseMatrix
        Exact sparse B.
    certificate : Certificate
        Evidence that the set is complete and minimal.
    reading : ReadingReport
        Rounded numbers taken as exact, and whether they mattered.
    seed : int
        Seed of all random points.
    special : SpecialValues, optional
        Change of the answer by the stated values of symbols; None if there is none.
    generic : bool
        Whether the answer is for general values of the symbols and not for the stated ones.

    Examples
    --------
    >>> import echelon as ec
    >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
    >>> base.rank, [str(e) for e in base.expressions][:2]
    (6, ['ZZ1 + l1²·M2', 'MX1 + l1·M2'])
    """

    mechanism: Mechanism
    matrix: BaseMatrix
    certificate: Certificate
    reading: ReadingReport
    seed: int
    special: SpecialValues | None = None
    generic: bool = False

    # -- the set -----------------------------------------------------------------------------------------------

    @property
    def units(self) -> tuple[str, ...]:
        """SI unit of every base parameter."""
        return tuple(self.mechanism.columns[p].unit for p in self.matrix.pivots)

    @cached_property
    def classification(self) -> dict[str, Identifiability]:
        """For every standard parameter, what the outputs say about it, at the stated values of the symbols."""
        shown = replace(self.matrix, rows=tuple(self._shown_rows))
        return classify(
            shown if self.generic else at_values(shown, stated_values(self.mechanism))
        )

    @property
    def _shown_rows(self) -> Sequence[Row]:
        """Rows of B without what is only there because of rounding."""
        return [
            {c: v for c, v in row.items() if not self._is_rounding(v)}
            for row in self.matrix.rows
        ]

    def _is_rounding(self, coefficient: RationalFunction) -> bool:
        number = coefficient.numerator.number if coefficient.is_polynomial else None
        return (
            bool(self.mechanism.dependent_velocities)
            and number is not None
            and abs(float(number)) < ROUNDED_COEFFICIENT
        )

    @property
    def hidden(self) -> int:
        """Number of coefficients below 1e-11, from rounding of loop closures, that no expression shows."""
        return sum(
            self._is_rounding(c) for row in self.matrix.rows for c in row.values()
        )

    @property
    def _known(self) -> Mapping[str, float]:
        return known_values(self.mechanism)

    def experiment(self, name: str) -> BaseModel:
        """The model of one of several experiments, in the base parameters of all of them together.

        Its regressor has a column for every base parameter, zero for what this experiment does not see, so that the
        observations of all experiments can be added.

        Parameters
        ----------
        name : str
            Of ``mechanism.experiments``.

        Raises
        ------
        InputError
            If there is no such experiment.

        Examples
        --------
        >>> import echelon as ec
        >>> both = ec.base_parameters(ec.load("examples/experiments/panda_mounted.yaml"))
        >>> wall = both.experiment("wall")
        >>> wall.mechanism.positions[:2], wall.rank
        (('j1', 'j2'), 45)
        """
        if name not in self._experiments:
            self._experiments[name] = self._experiment(name)
        return self._experiments[name]

    @cached_property
    def _experiments(self) -> dict[str, BaseModel]:
        return {}

    def _experiment(self, name: str) -> BaseModel:
        own = experiment_of(self.mechanism, name)
        of_all = "this experiment alone may not show all: the set belongs to all experiments together"
        certificate = replace(
            self.certificate, unchecked=(*self.certificate.unchecked, of_all)
        )
        return replace(
            self,
            mechanism=own,
            matrix=self.matrix.arranged(own.parameters),
            certificate=certificate,
        )

    # -- B in other forms --------------------------------------------------------------------------------------

    @cached_property
    def B_exact(self) -> sympy.ImmutableSparseMatrix:
        """B with the symbols' exact values put in.

        Raises
        ------
        InputError
            If a symbol has no value, or a denominator is zero at the values.
        """
        with extra("symbolic"):
            import sympy

        values: dict[str, sympy.Expr] = {}
        for name in self.matrix.symbols:
            symbol = self.mechanism.symbols.get(name)
            if symbol is None or symbol.value is None:
                raise InputError(f"symbol '{name}' has no value")
            stated = symbol.expression
            values[name] = (
                sympy.Float(symbol.value)
                if stated is None
                else stated.evaluate(pi_generators(sympy.pi), sympy_number)
            )
        return self.matrix.sympy(values)

    def B_float(self, symbols: Mapping[str, float] | None = None) -> Floats:
        """B in double precision.

        Parameters
        ----------
        symbols : mapping of str to float, optional
            Values that replace or complete those of the file, SI units.

        Returns
        -------
        array of shape (base parameters, standard parameters)

        Raises
        ------
        InputError
            If a symbol has no value, or another than the stated one while columns of B are numbers at that.
        """
        self._check_stated(symbols or {})
        return self.matrix.floats(
            symbol_values(self.mechanism, self.matrix.symbols, symbols)
        )

    def _check_stated(self, symbols: Mapping[str, float]) -> None:
        numbers = self.matrix.numbers
        for name in numbers.at if numbers else ():
            stated = self.mechanism.symbols[name].value
            if name in symbols and symbols[name] != stated:
                raise InputError(
                    f"columns of B are numbers at {name} = {stated}: derive again with the other value, or with a "
                    "larger budget for closed forms"
                )

    # -- numbers -----------------------------------------------------------------------------------------------

    def values(
        self,
        standard: Sequence[float] | Floats | None = None,
        symbols: Mapping[str, float] | None = None,
    ) -> Floats:
        """Base parameters ζ̄ = B ζ.

        Parameters
        ----------
        standard : array of shape (n,), optional
            Standard parameters, SI units, in the order of :attr:`parameters`; those of the file if omitted.
        symbols : mapping of str to float, optional
            Values of geometry symbols that replace or complete those of the file.

        Returns
        -------
        array of shape (r,)

        Raises
        ------
        InputError
            If parameters or symbol values are missing or the shape is wrong.
        """
        zeta = (
            self.standard_values()
            if standard is None
            else np.asarray(standard, dtype=float)
        )
        if zeta.shape != (len(self.parameters),):
            raise InputError(
                f"expected {len(self.parameters)} standard parameters, got an array of shape {zeta.shape}"
            )
        result: Floats = self.B_float(symbols) @ zeta
        return result

    def standard_values(self) -> Floats:
        """Standard parameters stated by the file, shape (n,).

        Raises
        ------
        InputError
            If the file does not state those of every body.
        """
        stated = self.mechanism.standard_values()
        owner = [
            self.mechanism.bodies[k].name
            for k in self.mechanism.carriers
            for _ in self.mechanism.bodies[k].carried
        ]
        owner += [effect.parameter for effect in self.mechanism.effects]
        silent = list(
            dict.fromkeys(
                name for name, value in zip(owner, stated, strict=True) if value is None
            )
        )
        if silent:
            shown = ", ".join(f"'{name}'" for name in silent[:6])
            raise InputError(
                f"the file has no values for {len(silent)} bodies or parameters ({shown}); give them as standard="
            )
        return np.array(stated, dtype=float)

    def lift(
        self,
        values: Sequence[float] | Floats,
        prior: Sequence[float] | Floats | None = None,
        metric: Metric = "physical",
        length: float | None = None,
        symbols: Mapping[str, float] | None = None,
    ) -> Floats:
        """Standard parameters that have given base parameters and are nearest to a prior (Theorem 1 of the paper).

        Parameters
        ----------
        values : array of shape (r,)
            Base parameters, SI units.
        prior : array of shape (n,), optional
            Standard parameters to stay near to; zero if omitted.
        metric : "identity", "physical" or array
            The metric S; see :func:`echelon.base.lift.metric_matrix`.
        length : float, optional
            Characteristic length of the physical metric, m; the largest joint offset if omitted.
        symbols : mapping of str to float, optional

        Returns
        -------
        array of shape (n,)
        """
        size = len(self.parameters)
        target = np.asarray(values, dtype=float)
        start = np.zeros(size) if prior is None else np.asarray(prior, dtype=float)
        if target.shape != (self.rank,) or start.shape != (size,):
            raise InputError(
                f"expected {self.rank} base parameters and a prior of {size} standard parameters"
            )
        if not (np.isfinite(target).all() and np.isfinite(start).all()):
            raise InputError("base parameters and prior must be finite numbers")
        return lift(self.B_float(symbols), target, start, self._metric(metric, length))

    def pseudo_inverse_float(
        self,
        metric: Metric = "physical",
        length: float | None = None,
        symbols: Mapping[str, float] | None = None,
    ) -> Floats:
        """B† = S Bᵀ (B S Bᵀ)⁻¹ in double precision, with which :meth:`lift` corrects a prior.

        Parameters
        ----------
        metric, length, symbols
            As for :meth:`lift`.

        Returns
        -------
        array of shape (n, r)
        """
        return pseudo_inverse_floats(
            self.B_float(symbols), self._metric(metric, length)
        )

    def _metric(self, metric: Metric, length: float | None) -> Floats:
        scale = characteristic_length(self.mechanism) if length is None else length
        return metric_matrix(
            metric, [c.length_degree for c in self.mechanism.columns], scale
        )

    # -- recorded forms -----------------------------------------------------------------------------------------

    @cached_property
    def standard_forms(self) -> LinearForms:
        """The standard regressor X as recorded forms; with loops, its one row uᵀX in virtual velocities."""
        if self.mechanism.dependent_velocities:
            return virtual_power_form(self.mechanism)
        return inverse_dynamics_regressor(self.mechanism)

    @cached_property
    def reduced(self) -> LinearForms:
        """X̄, the pivot columns of X, as recorded forms; evaluating it needs only the operations that it uses."""
        return self.standard_forms.columns(self.matrix.pivots)

    def symbolic_regressor(self, form: Form = "auto") -> SymbolicRegressor:
        """The base regressor X̄ as formulas in the states and the geometry's symbols.

        With loops it is the one row uᵀX̄ in virtual velocities.

        Parameters
        ----------
        form : "auto", "short" or "named"
            Short formulas where no value has more than 64 terms when multiplied out, or up to 4096 if ``"short"`` is
            asked for; otherwise what is used more than once gets a name.

        Returns
        -------
        SymbolicRegressor

        Raises
        ------
        ClosedFormError
            If short formulas are asked for and a value has too many terms.

        Examples
        --------
        >>> import echelon as ec
        >>> base = ec.base_parameters(ec.load("examples/double_pendulum.yaml"))
        >>> base.symbolic_regressor().entries[1, 4]
        g*cos(q1 + q2) + l1*qd1**2*sin(q2) + l1*qdd1*cos(q2)
        """
        from echelon.base.formulas import absolute_angles, symbolic_regressor

        robot = self.mechanism
        rows = (
            ["power"]
            if self.reduced.loops
            else [output.name for output in robot.outputs]
        )
        return symbolic_regressor(
            robot.name, self.reduced, rows, self.pivots, form, absolute_angles(robot)
        )

    # -- showing ------------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        return f"BaseModel({self.mechanism.name}: {self.rank} base parameters of {len(self.parameters)})"

    def __str__(self) -> str:
        from echelon.base.display import to_text

        return to_text(self)

    def _repr_latex_(self) -> str:
        from echelon.base.display import aligned_latex

        return f"$${aligned_latex(self)}$$"

    def _repr_html_(self) -> str:
        from echelon.base.display import to_html

        return to_html(self)
