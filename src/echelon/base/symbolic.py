"""The base regressor X̄ as formulas, with all symbols kept (they are written in :mod:`echelon.base.formulas`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from echelon.algebra import FUNCTIONS, Op
from echelon.base.expression import latex_symbol
from echelon.shared import extra, one_line, public

if TYPE_CHECKING:
    import sympy

IMPORTED = tuple("Abs" if op is Op.ABS else op.name.lower() for op in FUNCTIONS)


@public
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
        Meaning of the symbols of states, ``{"q1": "q[shoulder]"}``; all others are constants under their own names,
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
        return sympy.ImmutableMatrix(
            self.entries.applyfunc(lambda entry: entry.xreplace(known))
        )

    def latex(self) -> str:
        """LaTeX of one equation for every subexpression and entry that is not zero; needs only amsmath."""
        with extra("symbolic"):
            import sympy

        names = {s: _latex_name(s.name, self.inputs) for s in self._symbols()}

        def tex(formula: Any) -> str:
            return str(sympy.latex(formula, symbol_names=names))

        lines = [
            f"{names[symbol]} &= {tex(formula)}"
            for symbol, formula in self.subexpressions
        ]
        for (i, j), entry in sorted(self.entries.todok().items()):
            lines.append(f"\\bar X_{{{i + 1},{j + 1}}} &= {tex(entry)}")
        head = [f"% {line}" for line in self._head()]
        return (
            "\n".join(
                [*head, "\\begin{align*}", " \\\\\n".join(lines), "\\end{align*}"]
            )
            + "\n"
        )

    def python(self) -> str:
        """Python text that needs sympy alone and, when run, leaves the matrix as ``X``."""
        symbols = sorted(
            (s for s in self._symbols() if s not in dict(self.subexpressions)), key=str
        )
        lines = [f"# {line}" for line in self._head()]
        lines += [
            "import sympy",
            f"from sympy import {', '.join(sorted(IMPORTED))}",
            "",
        ]
        lines += [f"{s.name} = sympy.Symbol({s.name!r})" for s in symbols]
        lines += [
            f"{symbol} = {_exact_text(formula)}"
            for symbol, formula in self.subexpressions
        ]
        lines += [f"X = sympy.zeros({self.entries.rows}, {self.entries.cols})"]
        lines += [
            f"X[{i}, {j}] = {_exact_text(entry)}"
            for (i, j), entry in sorted(self.entries.todok().items())
        ]
        return "\n".join(lines) + "\n"

    def _symbols(self) -> set[Any]:
        found = set(self.entries.free_symbols)
        for symbol, formula in self.subexpressions:
            found |= {symbol} | formula.free_symbols
        return found

    def _head(self) -> list[str]:
        states = ", ".join(
            f"{symbol} = {meaning}" for symbol, meaning in self.inputs.items()
        )
        return [
            one_line(
                f"base regressor of {self.name}: {self.entries.rows} × {self.entries.cols}"
            ),
            one_line(f"rows: {', '.join(self.rows)}"),
            one_line(f"columns, by representative: {', '.join(self.columns)}"),
            one_line(f"states: {states}"),
        ]

    def __repr__(self) -> str:
        named = (
            f", {len(self.subexpressions)} subexpressions"
            if self.subexpressions
            else ""
        )
        return f"SymbolicRegressor({self.name}: {self.entries.rows} × {self.entries.cols}{named})"

    def _repr_latex_(self) -> str:
        return "\n".join(
            line for line in self.latex().splitlines() if not line.startswith("%")
        )


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

    return str(StrPrinter({"sympy_integers": True}).doprint(formula)).replace(
        "S(", "sympy.S("
    )
