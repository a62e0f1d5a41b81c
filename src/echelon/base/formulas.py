"""The entries of a regressor as formulas: short ones, or with names for what is used more than once.

Small regressors are multiplied out and shortened; large ones stay as they were recorded.

An entry is a polynomial in rates, lengths, and sines and cosines of the coordinates.  What multiplies one product of
rates and lengths is a polynomial in sines and cosines alone, and there are several ways to write it: with the angles
themselves, with the absolute angles of joints whose axes are parallel (cos q₁ cos q₂ − sin q₁ sin q₂ = cos(q₁ + q₂)),
or as a Fourier series.  The shortest is taken; then terms with the same sines and cosines are collected.
"""

from __future__ import annotations

import keyword
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

from echelon.algebra import (
    FUNCTIONS,
    Monomial,
    Number,
    Op,
    Polynomial,
    Program,
    cosine,
    is_trigonometric,
    shared_nodes,
    sine,
    symbol_of,
    sympy_number,
    to_sympy,
)
from echelon.base.symbolic import IMPORTED, SymbolicRegressor
from echelon.dynamics import LinearForms
from echelon.robot import GROUND, Mechanism, MotionKind, Placement
from echelon.shared import ClosedFormError, Form, extra

with extra("symbolic"):
    import sympy

SHORT_TERMS = 64
"""Terms of one value, multiplied out, up to which short forms are taken."""
LONGEST_TERMS = SHORT_TERMS**2
"""Terms up to which they are tried if they are asked for."""

_RESERVED = {*keyword.kwlist, *IMPORTED, "sympy", "X"}

Combination = tuple[tuple[str, int], ...]
"""A sum of angles: coordinates with whole factors."""


def absolute_angles(mechanism: Mechanism) -> dict[str, Combination]:
    """For every rotation whose axis is parallel to that of the rotation before it, the sum of angles up to it."""
    found: dict[str, Combination] = {}
    ends: dict[int, tuple[Combination, int, Placement | None]] = {GROUND: ((), 0, None)}
    for index, body in enumerate(mechanism.bodies):
        angles, axis, between = ends[body.parent]
        for step in body.joint.steps:
            if isinstance(step, Placement):
                between = step if between is None else between @ step
            elif step.kind in (MotionKind.ROTATION, MotionKind.SCREW):
                parallel = _sign_along(between, axis, step.axis) if angles else 0
                before = (
                    tuple((name, sign * parallel) for name, sign in angles)
                    if parallel
                    else ()
                )
                angles = (*before, (f"q[{step.name}]", step.sign))
                axis = step.axis
                between = None
                if len(angles) > 1 and step.name not in mechanism.dependent:
                    found[f"q[{step.name}]"] = angles
            elif step.kind is MotionKind.BALL:
                angles, between = (), None
            if not isinstance(step, Placement) and step.name in mechanism.dependent:
                angles = ()
        ends[index] = angles, axis, between
    return found


def _sign_along(between: Placement | None, first: int, second: int) -> int:
    """1 or −1 where the second axis is along the first one, else 0."""
    if between is None:
        return int(first == second)
    column = [between.rotation[row][second].number for row in range(3)]
    return next(
        (
            s
            for s in (1, -1)
            if all(v == s * (row == first) for row, v in enumerate(column))
        ),
        0,
    )


Series = dict[tuple[bool, Combination], Number]
"""Coefficients of a Fourier series: whether of a sine, and of which sum of angles."""

HIGHEST_POWER = 8
"""Power of a sine or cosine up to which a product is written as a Fourier series."""


@dataclass
class ShortForms:
    """Writes nodes of a program as short formulas."""

    program: Program
    symbols: Mapping[str, Any]  # for the inputs of the program
    absolute: Mapping[
        str, Combination
    ]  # see :func:`echelon.base.formulas.absolute_angles`
    most_terms: int  # of an intermediate value, multiplied out
    _atoms: dict[str, Any] = field(default_factory=dict)
    _sums: dict[str, Combination] = field(default_factory=dict)
    _known: dict[int, Polynomial] = field(default_factory=dict)

    def formulas(self, nodes: Sequence[int]) -> list[Any]:
        """Sympy expressions of nodes."""
        for node in self.program.needed(nodes):
            self._known[node] = value = self._polynomial(node)
            if len(value.terms) > self.most_terms:
                raise ClosedFormError(
                    f"the regressor has values of more than {self.most_terms} terms"
                )
        return [self._written(self._known[node]) for node in nodes]

    @cached_property
    def _states(self) -> set[str]:
        return {
            given.name
            for given in self.program.inputs.values()
            if given.role == "state"
        }

    # -- multiplied out ------------------------------------------------------------------------------------------

    def _polynomial(self, node: int) -> Polynomial:
        program = self.program
        op = Op(program.ops[node])
        a = self._known.get(program.lhs[node])
        b = self._known.get(program.rhs[node])
        if op is Op.INPUT:
            return Polynomial.generator(program.inputs[node].name)
        if op is Op.CONSTANT:
            return Polynomial.constant(program.constants[node])
        assert a is not None
        if op in FUNCTIONS:
            return self._function(op, node, a)
        if op is Op.NEG:
            return -a
        assert b is not None
        if op is Op.DIV:
            return a * self._atom(f"#{program.rhs[node]}", lambda: 1 / self._written(b))
        if op is Op.MUL and len(a.terms) * len(b.terms) > 8 * self.most_terms:
            raise ClosedFormError(
                f"the regressor has values of more than {self.most_terms} terms"
            )
        return a * b if op is Op.MUL else a + b if op is Op.ADD else a - b

    def _function(self, op: Op, node: int, argument: Polynomial) -> Polynomial:
        """Sines and cosines of coordinates are polynomials; other functions stand for themselves."""
        angle = self.program.inputs.get(self.program.lhs[node])
        if op in (Op.SIN, Op.COS):
            label = angle.name if angle is not None else f"#{self.program.lhs[node]}"
            if angle is None:
                self._atom(label, lambda: self._written(argument))
            return Polynomial.generator(cosine(label) if op is Op.COS else sine(label))
        name = "Abs" if op is Op.ABS else op.name.lower()
        return self._atom(
            f"#{node}", lambda: getattr(sympy, name)(self._written(argument))
        )

    def _atom(self, label: str, formula: Any) -> Polynomial:
        if label not in self._atoms:
            self._atoms[label] = formula()
        return Polynomial.generator(label)

    # -- written shortly -----------------------------------------------------------------------------------------

    def _written(self, value: Polynomial) -> Any:
        """Terms with equal sines and cosines collected, their coefficients factored."""
        by_plain: dict[Monomial, dict[Monomial, Number]] = {}
        for monomial, coefficient in value.terms.items():
            circular = tuple((g, e) for g, e in monomial if self._varies(g))
            plain = tuple((g, e) for g, e in monomial if not self._varies(g))
            by_plain.setdefault(plain, {})[circular] = coefficient
        by_circular: dict[Monomial, list[Any]] = {}
        for plain, terms in by_plain.items():
            for circular, coefficient in self._shortest(
                Polynomial(terms)
            ).terms.items():
                by_circular.setdefault(circular, []).append(
                    sympy_number(coefficient) * self._product(plain)
                )
        factors = [sympy.Add(*terms) for terms in by_circular.values()]
        factors = [
            sympy.factor(f) if f.is_Add and f.is_polynomial() else f for f in factors
        ]
        return sympy.Add(
            *(f * self._product(c) for f, c in zip(factors, by_circular, strict=True))
        )

    def _varies(self, generator: str) -> bool:
        return is_trigonometric(generator) and symbol_of(generator) in self._states

    def _product(self, monomial: Monomial) -> Any:
        return sympy.Mul(*(self._generator(g) ** e for g, e in monomial))

    def _generator(self, generator: str) -> Any:
        if not is_trigonometric(generator):
            if generator in self._atoms:
                return self._atoms[generator]
            return self.symbols[generator]
        label = symbol_of(generator)
        if label in self._sums:
            angle = sympy.Add(
                *(factor * self.symbols[name] for name, factor in self._sums[label])
            )
        else:
            angle = self._atoms[label] if label in self._atoms else self.symbols[label]
        return sympy.cos(angle) if generator.startswith("cos(") else sympy.sin(angle)

    def _shortest(self, circular: Polynomial) -> Polynomial:
        return min(self._ways(circular), key=_length)

    def _ways(self, circular: Polynomial) -> Iterator[Polynomial]:
        """Equal expressions of a polynomial in sines and cosines."""
        yield circular
        if len(circular.terms) == 1:
            return
        yield _without_squares_of_cosines(circular)
        if any(symbol_of(g) in self.absolute for g in circular.generators()):
            turned = self._in_absolute_angles(circular)
            yield turned
            yield _without_squares_of_cosines(turned)
        degree = max(
            (sum(e for _, e in monomial) for monomial in circular.terms), default=0
        )
        if len(circular.terms) <= SHORT_TERMS and degree <= HIGHEST_POWER:
            yield self._series(circular)

    def _in_absolute_angles(self, circular: Polynomial) -> Polynomial:
        """A relative angle is the difference of two absolute ones."""
        values = {}
        for generator in circular.generators():
            label = symbol_of(generator)
            values[generator] = Polynomial.generator(generator)
            if label in self.absolute:
                *before, (_, sign) = self.absolute[label]
                c1, s1 = self._circle(tuple(before))
                c2, s2 = self._circle(self.absolute[label])
                # sign · angle = after − before
                values[generator] = (
                    c2 * c1 + s2 * s1
                    if generator.startswith("cos(")
                    else (s2 * c1 - c2 * s1) * sign
                )
        return circular.evaluate(values, Polynomial.constant)

    def _circle(self, angles: Combination) -> tuple[Polynomial, Polynomial]:
        """Cosine and sine of a sum of angles."""
        label, sign = self._label(angles)
        return Polynomial.generator(cosine(label)), Polynomial.generator(
            sine(label)
        ) * sign

    def _label(self, angles: Combination) -> tuple[str, int]:
        """A name for a sum of angles or its negative, and which of both."""
        ordered = tuple(sorted((name, factor) for name, factor in angles if factor))
        sign = 1 if ordered[0][1] > 0 else -1
        angles = tuple((name, factor * sign) for name, factor in ordered)
        if len(angles) == 1 and angles[0][1] == 1:
            return angles[0][0], sign
        label = "+".join(f"{factor}·{name}" for name, factor in angles)
        self._sums[label] = angles
        return label, sign

    def _series(self, circular: Polynomial) -> Polynomial:
        """Products of sines and cosines as sums."""
        total: Series = {}
        for monomial, coefficient in circular.terms.items():
            unit: Series = {(False, ()): 1}
            factors = (g for g, e in monomial for _ in range(e))
            for key, factor in reduce(_times, factors, unit).items():
                total[key] = total.get(key, 0) + factor * coefficient
        one, zero = Polynomial.constant(1), Polynomial({})
        points = {
            angles: self._circle(angles) if angles else (one, zero)
            for _, angles in total
        }
        return Polynomial.sum(
            points[angles][int(odd)] * number for (odd, angles), number in total.items()
        )


def _length(circular: Polynomial) -> int:
    """Terms and their factors; 1 and −1 are not written."""
    return sum(
        2 + len(monomial) + (number not in (1, -1))
        for monomial, number in circular.terms.items()
    )


def _without_squares_of_cosines(circular: Polynomial) -> Polynomial:
    """A polynomial with 1 − sin² in place of cos²; Polynomial itself would turn it back."""
    terms: dict[Monomial, Number] = {}
    pending = list(circular.terms.items())
    while pending:
        monomial, coefficient = pending.pop()
        square = next((g for g, e in monomial if e > 1 and g.startswith("cos(")), None)
        if square is None:
            terms[monomial] = terms.get(monomial, 0) + coefficient
            continue
        rest = {g: e - 2 * (g == square) for g, e in monomial}
        partner = sine(symbol_of(square))
        squared = {**rest, partner: rest.get(partner, 0) + 2}
        pending += [(_sorted(rest), coefficient), (_sorted(squared), -coefficient)]
    return Polynomial(terms)


def _sorted(exponents: Mapping[str, int]) -> Monomial:
    return tuple(sorted((g, e) for g, e in exponents.items() if e))


def _times(series: Series, generator: str) -> Series:
    """A Fourier series times one sine or cosine."""
    odd, name, half = generator.startswith("sin("), symbol_of(generator), Fraction(1, 2)
    product: Series = {}
    for (is_sine, angles), coefficient in series.items():
        for sign in (1, -1):
            added = dict(angles)
            added[name] = added.get(name, 0) + sign
            key, weight = (is_sine != odd, _sorted(added)), coefficient * half
            # sin·sin = (cos(−) − cos(+))/2, cos·sin = (sin(+) − sin(−))/2
            if odd:
                weight = weight * (-sign if is_sine else sign)
            product[key] = product.get(key, 0) + weight
    return product


# -- whole regressors --------------------------------------------------------------------------------------------------


def symbolic_regressor(
    name: str,
    forms: LinearForms,
    rows: Sequence[str],
    columns: Sequence[str],
    form: Form = "auto",
    absolute: Mapping[str, Combination] | None = None,
) -> SymbolicRegressor:
    """Recorded forms as formulas."""
    program, nodes = forms.program, list(forms.entries.values())
    symbols, inputs = _symbols_of(forms)
    shared: tuple[tuple[Any, Any], ...] = ()
    formulas: list[Any] | None = None
    if form != "named":
        most = SHORT_TERMS if form == "auto" else LONGEST_TERMS
        try:
            formulas = ShortForms(program, symbols, absolute or {}, most).formulas(
                nodes
            )
        except ClosedFormError:
            if form == "short":
                raise
    if formulas is None:
        formulas, shared = _named(forms, symbols)
    entries = [sympy.S.Zero] * (forms.shape[0] * forms.shape[1])
    for (i, j), formula in zip(forms.entries, formulas, strict=True):
        entries[i * forms.shape[1] + j] = formula
    matrix = sympy.ImmutableMatrix(*forms.shape, entries, copy=False)
    return SymbolicRegressor(name, tuple(rows), tuple(columns), matrix, shared, inputs)


def _symbols_of(forms: LinearForms) -> tuple[dict[str, Any], dict[str, str]]:
    """A symbol for every input, and what those of states stand for; names with brackets become numbers."""
    needed = set(forms.program.needed(forms.entries.values()))
    taken = {i.name for i in forms.program.inputs.values()} | _RESERVED
    counts: dict[str, int] = {}
    symbols: dict[str, Any] = {}
    meanings: dict[str, str] = {}
    for node, given in forms.program.inputs.items():
        short = given.name
        if "[" in given.name:
            kind = given.name.partition("[")[0]
            counts[kind] = counts.get(kind, 0) + 1
            short = f"{kind}{counts[kind]}"
        while (short in taken and short != given.name) or short in _RESERVED:
            short += "_"
        symbols[given.name] = sympy.Symbol(short)
        if node in needed and (given.role == "state" or short != given.name):
            meanings[short] = given.name
    return symbols, dict(sorted(meanings.items()))


def _named(
    forms: LinearForms, symbols: Mapping[str, Any]
) -> tuple[list[Any], tuple[tuple[Any, Any], ...]]:
    """Entries, and what they use more than once."""
    program, nodes = forms.program, list(forms.entries.values())
    taken = {str(s) for s in symbols.values()}
    prefix = next(
        p
        for p in ("x", "t", "x_", "t_", "x__")
        if not any(name.startswith(p) for name in taken)
    )
    known = {node: symbols[given.name] for node, given in program.inputs.items()}
    shared: list[tuple[Any, Any]] = []
    for number, node in enumerate(shared_nodes(program, nodes), start=1):
        formula = to_sympy(program, [node], known)[0]
        known[node] = sympy.Symbol(f"{prefix}{number}")
        shared.append((known[node], formula))
    return to_sympy(program, nodes, known), tuple(shared)
