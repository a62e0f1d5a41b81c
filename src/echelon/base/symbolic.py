"""The base regressor X̄ as formulas, with all symbols kept.

Small regressors are multiplied out and shortened (:mod:`echelon.base.short_form`).  Large ones stay as they were
recorded: what is used more than once gets a name.
"""

from __future__ import annotations

import keyword
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from echelon.base.expression import latex_symbol
from echelon.base.short_form import Combination, ShortForms
from echelon.errors import ClosedFormError, InputError, one_line
from echelon.extras import extra
from echelon.program.operations import FUNCTIONS, Op
from echelon.program.sympy_bridge import shared_nodes, to_sympy
from echelon.regressor.linear_forms import LinearForms

if TYPE_CHECKING:
    import sympy

Form = Literal["auto", "short", "named"]

SHORT_TERMS, MOST_TERMS = 64, 4096
"""Terms of one value, multiplied out: where short forms are taken, and how far they are tried if asked for."""


_IMPORTED = tuple("Abs" if op is Op.ABS else op.name.lower() for op in FUNCTIONS)
_RESERVED = {*keyword.kwlist, *_IMPORTED, "sympy", "X"}


@dataclass(frozen=True)
class SymbolicRegressor:
    """X̄ as formulas.

    Attributes
    ----------
    name : str
        Of the model.
    rows, columns : tuple of str
        Outputs, and representatives of base parameters.
    entries : sympy matrix
        In the symbols and the names of subexpressions.
    subexpressions : tuple of (sympy Symbol, sympy expression)
        Each uses symbols and names before it; none where entries are short.
    inputs : mapping of str to str
        What the symbols of states stand for, ``{"q1": "q[shoulder]"}``; all others are constants under their own names,
        unless Python reserves these.
    """

    name: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    entries: sympy.ImmutableMatrix
    subexpressions: tuple[tuple[Any, Any], ...]
    inputs: Mapping[str, str]

    @property
    def matrix(self) -> sympy.ImmutableMatrix:
        """The entries with all subexpressions put in, which may be long."""
        with extra("symbolic"):
            import sympy

        known: dict[Any, Any] = {}
        for symbol, formula in self.subexpressions:
            known[symbol] = formula.xreplace(known)
        return sympy.ImmutableMatrix(self.entries.applyfunc(lambda entry: entry.xreplace(known)))

    def latex(self) -> str:
        """LaTeX of one equation for every subexpression and entry that is not zero; needs only amsmath."""
        with extra("symbolic"):
            import sympy

        names = {s: _latex_name(s.name, self.inputs) for s in self._symbols()}

        def tex(formula: Any) -> str:
            return str(sympy.latex(formula, symbol_names=names))

        lines = [f"{names[symbol]} &= {tex(formula)}" for symbol, formula in self.subexpressions]
        for (i, j), entry in sorted(self.entries.todok().items()):
            lines.append(f"\\bar X_{{{i + 1},{j + 1}}} &= {tex(entry)}")
        head = [f"% {line}" for line in self._head()]
        return "\n".join([*head, "\\begin{align*}", " \\\\\n".join(lines), "\\end{align*}"]) + "\n"

    def python(self) -> str:
        """Python text that needs sympy alone and, when run, leaves the matrix as ``X``."""
        symbols = sorted((s for s in self._symbols() if s not in dict(self.subexpressions)), key=str)
        lines = [f"# {line}" for line in self._head()]
        lines += ["import sympy", f"from sympy import {', '.join(sorted(_IMPORTED))}", ""]
        lines += [f"{s.name} = sympy.Symbol({s.name!r})" for s in symbols]
        lines += [f"{symbol} = {_exact_text(formula)}" for symbol, formula in self.subexpressions]
        lines += [f"X = sympy.zeros({self.entries.rows}, {self.entries.cols})"]
        lines += [f"X[{i}, {j}] = {_exact_text(entry)}" for (i, j), entry in sorted(self.entries.todok().items())]
        return "\n".join(lines) + "\n"

    def _symbols(self) -> set[Any]:
        found = set(self.entries.free_symbols)
        for symbol, formula in self.subexpressions:
            found |= {symbol} | formula.free_symbols
        return found

    def _head(self) -> list[str]:
        states = ", ".join(f"{symbol} = {meaning}" for symbol, meaning in self.inputs.items())
        return [
            one_line(f"base regressor of {self.name}: {self.entries.rows} × {self.entries.cols}"),
            one_line(f"rows: {', '.join(self.rows)}"),
            one_line(f"columns, by representative: {', '.join(self.columns)}"),
            one_line(f"states: {states}"),
        ]

    def __repr__(self) -> str:
        named = f", {len(self.subexpressions)} subexpressions" if self.subexpressions else ""
        return f"SymbolicRegressor({self.name}: {self.entries.rows} × {self.entries.cols}{named})"

    def _repr_latex_(self) -> str:
        return "\n".join(line for line in self.latex().splitlines() if not line.startswith("%"))


def symbolic_regressor(
    name: str,
    forms: LinearForms,
    rows: Sequence[str],
    columns: Sequence[str],
    form: Form = "auto",
    absolute: Mapping[str, Combination] | None = None,
) -> SymbolicRegressor:
    """Recorded forms as formulas."""
    with extra("symbolic"):
        import sympy

    if form not in ("auto", "short", "named"):
        raise InputError(f"unknown form '{form}' (valid: auto, short, named)")
    program, nodes = forms.program, list(forms.entries.values())
    symbols, inputs = _symbols_of(forms)
    shared: tuple[tuple[Any, Any], ...] = ()
    formulas: list[Any] | None = None
    if form != "named":
        most = SHORT_TERMS if form == "auto" else MOST_TERMS
        try:
            formulas = ShortForms(program, symbols, absolute or {}, most).formulas(nodes)
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
    with extra("symbolic"):
        import sympy

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


def _named(forms: LinearForms, symbols: Mapping[str, Any]) -> tuple[list[Any], tuple[tuple[Any, Any], ...]]:
    """Entries, and what they use more than once."""
    with extra("symbolic"):
        import sympy

    program, nodes = forms.program, list(forms.entries.values())
    taken = {str(s) for s in symbols.values()}
    prefix = next(p for p in ("x", "t", "x_", "t_", "x__") if not any(name.startswith(p) for name in taken))
    known = {node: symbols[given.name] for node, given in program.inputs.items()}
    shared: list[tuple[Any, Any]] = []
    for number, node in enumerate(shared_nodes(program, nodes), start=1):
        formula = to_sympy(program, [node], known)[0]
        known[node] = sympy.Symbol(f"{prefix}{number}")
        shared.append((known[node], formula))
    return to_sympy(program, nodes, known), tuple(shared)


def _latex_name(name: str, inputs: Mapping[str, str]) -> str:
    """A symbol's name in LaTeX: rates and accelerations have dots."""
    meaning = inputs.get(name, "")
    for kind, dots in (("qdd[", "\\ddot q"), ("qd[", "\\dot q"), ("q[", "q")):
        if meaning.startswith(kind):
            return f"{dots}_{{{name[len(kind) - 1 :]}}}"
    return latex_symbol(name)


def _exact_text(formula: Any) -> str:
    """A formula as Python text whose fractions stay exact."""
    with extra("symbolic"):
        from sympy.printing.str import StrPrinter

    return str(StrPrinter({"sympy_integers": True}).doprint(formula)).replace("S(", "sympy.S(")
