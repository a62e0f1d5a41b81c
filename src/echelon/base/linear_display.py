"""A LinearBase as text, Markdown and LaTeX."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from echelon.base.expression import LatexStyle, latex_symbol, render
from echelon.errors import one_line

if TYPE_CHECKING:
    from echelon.base.linear_base import LinearBase


class _PlainLatex(LatexStyle):
    """Parameters are symbols like others."""

    def parameter(self, name: str) -> str:
        """E.g. ``C_{1}``."""
        return latex_symbol(name)


def headline(base: LinearBase) -> str:
    """The count in one line."""
    rank, outputs = base.rank, len(base.model.outputs)
    count = f"{rank} base parameter{'s' * (rank != 1)} of {len(base.parameters)} parameters"
    return f"{one_line(base.model.name)}: {count}, {outputs} output{'s' * (outputs != 1)}"


def facts(base: LinearBase) -> list[tuple[str, str]]:
    """What else a reader should know."""
    found = [("route", base.route)]
    values = {n: v for n, v in base.model.constants.items() if v is not None and n in base.matrix.symbols}
    if values:
        found.append(("constants", ", ".join(f"{n} = {v}" for n, v in values.items())))
    if base.definitions:
        found.append(("functions of constants", ", ".join(f"{n} = {d}" for n, d in base.definitions.items())))
    if base.special is not None:
        found.append(("stated values", base.special.text("model")))
    found.append(("certificate", str(base.certificate)))
    return [(label, one_line(text)) for label, text in found]


def classes(base: LinearBase) -> list[tuple[str, str]]:
    """Each class with its parameters."""
    grouped: dict[str, list[str]] = {}
    for name, kind in base.classification.items():
        grouped.setdefault(kind.value, []).append(one_line(name))
    return [(kind, ", ".join(names)) for kind, names in grouped.items()]


def to_text(base: LinearBase) -> str:
    """Plain text: count, expressions, classification, route, certificate."""
    width = max((len(str(i + 1)) for i in range(base.rank)), default=1)
    lines = [headline(base), ""]
    lines += [f"{i + 1:>{width}}  {expression}" for i, expression in enumerate(base.expressions)]
    return "\n".join([*lines, "", *(f"{label}: {text}" for label, text in (*classes(base), *facts(base)))])


def to_markdown(base: LinearBase) -> str:
    """A Markdown table of the closed forms, and a list of the rest."""
    lines = [f"# Base parameters of {_cell(base.model.name)}", "", _cell(headline(base)) + ".", ""]
    lines += ["| # | base parameter | unit |", "|--:|---|---|"]
    lines += [f"| {i + 1} | {_cell(str(e))} | {_cell(e.unit)} |" for i, e in enumerate(base.expressions)]
    lines += ["", *(f"- {label}: {_cell(text)}" for label, text in (*classes(base), *facts(base)))]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return re.sub(r"([\\|<`*\[])", r"\\\1", one_line(text))


def to_latex(base: LinearBase) -> str:
    """Aligned equations that need only amsmath, and a comment with the facts."""
    comments = [f"% {line}" for line in (headline(base), *(f"{a}: {b}" for a, b in facts(base)))]
    return "\n".join([*comments, "\\begin{align*}\n" + " \\\\\n".join(_rows(base)) + "\n\\end{align*}"]) + "\n"


def aligned_latex(base: LinearBase) -> str:
    """All equations in one ``aligned`` block, for notebooks."""
    return "\\begin{aligned}" + " \\\\ ".join(_rows(base)) + "\\end{aligned}"


def _rows(base: LinearBase) -> list[str]:
    return [f"\\bar\\zeta_{{{i + 1}}} &= {render(e, _PlainLatex())}" for i, e in enumerate(base.expressions)]
