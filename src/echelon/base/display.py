"""Sets of base parameters as text, Markdown, LaTeX and HTML."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING, Protocol

from echelon.base.certificate import Certificate
from echelon.base.expression import (
    MOST_TERMS,
    Expression,
    LatexStyle,
    count_terms,
    latex_polynomial,
    latex_symbol,
    render,
)
from echelon.base.matrix import BaseMatrix, Identifiability, StatedNumbers
from echelon.base.reading_report import ROUNDING, ReadingReport
from echelon.base.stated_values import SpecialValues
from echelon.dynamics import LinearModel
from echelon.robot import Mechanism, Symbol
from echelon.shared import PARAMETERS, PER_BODY, one_line, page

if TYPE_CHECKING:
    from typing_extensions import TypeIs

LATEX_ROWS_PER_PAGE = 40
"""Rows of a LaTeX array, which does not break across pages."""


class _Set(Protocol):
    """Common properties of sets of robots and of linear models, whose classes use this file."""

    @property
    def rank(self) -> int: ...
    @property
    def parameters(self) -> tuple[str, ...]: ...
    @property
    def matrix(self) -> BaseMatrix: ...
    @property
    def expressions(self) -> tuple[Expression, ...]: ...
    @property
    def readable(self) -> tuple[Expression, ...]: ...
    @property
    def classification(self) -> dict[str, Identifiability]: ...
    @property
    def special(self) -> SpecialValues | None: ...
    @property
    def certificate(self) -> Certificate: ...
    @property
    def largest_coefficient(self) -> float | None: ...


class _RobotSet(_Set, Protocol):
    """As :class:`echelon.BaseModel`."""

    @property
    def mechanism(self) -> Mechanism: ...
    @property
    def reading(self) -> ReadingReport: ...
    @property
    def hidden(self) -> int: ...


class _LinearSet(_Set, Protocol):
    """As :class:`echelon.LinearBase`."""

    @property
    def model(self) -> LinearModel: ...


class _PlainLatex(LatexStyle):
    """Parameters of linear models are symbols like others."""

    def parameter(self, name: str) -> str:
        """E.g. ``C_{1}``."""
        return latex_symbol(name)


def _is_linear(model: _RobotSet | _LinearSet) -> TypeIs[_LinearSet]:
    """Whether a set is that of a linear model, told without its class, which imports this file."""
    return hasattr(model, "model")


def headline(model: _RobotSet | _LinearSet) -> str:
    """The count in one line."""
    source = model.model if _is_linear(model) else model.mechanism
    rank, outputs = model.rank, len(source.outputs)
    kind = "parameters" if _is_linear(model) else "standard parameters"
    count = (
        f"{rank} base parameter{'s' * (rank != 1)} of {len(model.parameters)} {kind}"
    )
    return f"{one_line(source.name)}: {count}, {outputs} output{'s' * (outputs != 1)}"


def shown_expressions(
    model: _RobotSet | _LinearSet, *, full: bool
) -> tuple[Expression, ...]:
    """The expressions to print: with all formulas, or with values in the place of those that nobody can read."""
    return model.expressions if full else model.readable


def to_text(model: _RobotSet | _LinearSet, *, full: bool = False) -> str:
    """Plain text: count, expressions, classification, reading, symbols, certificate."""
    width = max((len(str(i + 1)) for i in range(model.rank)), default=1)
    lines = [headline(model), ""]
    shown = shown_expressions(model, full=full)
    lines += [f"{i + 1:>{width}}  {expression}" for i, expression in enumerate(shown)]
    lines += ["", *classification_lines(model)]
    lines += [f"{label}: {text}" for label, text in facts(model, full=full)]
    return "\n".join(lines)


_MARKS = {
    Identifiability.ALONE: "●",
    Identifiability.COMBINATION: "◐",
    Identifiability.UNIDENTIFIABLE: "·",
}


def legend(model: _RobotSet) -> str:
    """The meaning of the marks of :func:`classification_rows`, with counts."""
    found = list(model.classification.values())
    return "   ".join(
        f"{mark} {kind.value}: {found.count(kind)}" for kind, mark in _MARKS.items()
    )


def classification_rows(
    model: _RobotSet,
) -> list[tuple[str, list[tuple[str, Identifiability | None]]]]:
    """One row per body: its label and name, and a mark and class for each of XX … M; blank where it is not carried."""
    classes = list(model.classification.values())
    rows: list[tuple[str, list[tuple[str, Identifiability | None]]]] = []
    for index in model.mechanism.carriers:
        body, first = model.mechanism.bodies[index], model.mechanism.first_column[index]
        kinds = {kind: classes[first + k] for k, kind in enumerate(body.carried)}
        cells: list[tuple[str, Identifiability | None]] = [
            (_MARKS[kinds[k]], kinds[k]) if k in kinds else (" ", None)
            for k in range(PER_BODY)
        ]
        rows.append(
            (one_line(f"{body.label}  {model.mechanism.carrier_name(index)}"), cells)
        )
    return rows


def body_names(model: _RobotSet) -> str:
    """The bodies that numbers in names of base parameters stand for, such as ``7 tool0``."""
    mechanism, kinds = model.mechanism, model.classification
    seen = {
        parameter.body
        for parameter in mechanism.columns
        if kinds[parameter.name] is not Identifiability.UNIDENTIFIABLE
    }
    named = [
        (mechanism.bodies[body].label, mechanism.carrier_name(body))
        for body in mechanism.carriers
        if body in seen
    ]
    return ", ".join(
        one_line(f"{label} {name}") for label, name in named if label != name
    )


def classification_lines(model: _RobotSet | _LinearSet) -> list[str]:
    """The classification as a plain text table; for a linear model each class with its parameters."""
    if _is_linear(model):
        return [f"{kind}: {names}" for kind, names in _classes(model)]
    rows = classification_rows(model)
    if not rows:
        return []
    width = max(len("body"), *(len(title) for title, _ in rows))
    lines = [f"{'body':<{width}}  {'  '.join(PARAMETERS)}"]
    for title, marks in rows:
        cells = "  ".join(
            f"{mark:^{len(name)}}"
            for (mark, _), name in zip(marks, PARAMETERS, strict=True)
        )
        lines.append(f"{title:<{width}}  {cells}")
    return [*lines, legend(model)]


def _classes(base: _LinearSet) -> list[tuple[str, str]]:
    grouped: dict[str, list[str]] = {}
    for name, kind in base.classification.items():
        grouped.setdefault(kind.value, []).append(one_line(name))
    return [(kind, ", ".join(names)) for kind, names in grouped.items()]


def facts(
    model: _RobotSet | _LinearSet, *, full: bool = False
) -> list[tuple[str, str]]:
    """Further facts by label: symbols, snapping, notes, certificate; ``full`` where all formulas are shown."""
    found = _linear_facts(model) if _is_linear(model) else _robot_facts(model)
    found = [*([] if full else [("long formulas", _long_text(model))]), *found]
    return [(label, one_line(text)) for label, text in found if text]


def _linear_facts(base: _LinearSet) -> list[tuple[str, str]]:
    values = {
        n: v
        for n, v in {**base.model.constants, **base.model.generic}.items()
        if v is not None and n in base.matrix.symbols
    }
    return [
        ("constants", ", ".join(f"{n} = {v}" for n, v in values.items())),
        (
            "numbers",
            numbers_text(base, base.matrix.numbers) if base.matrix.numbers else "",
        ),
        ("stated values", base.special.text("model") if base.special else ""),
        ("largest coefficient", _size_text(base)),
        ("certificate", str(base.certificate)),
    ]


def _robot_facts(model: _RobotSet) -> list[tuple[str, str]]:
    used = [
        model.mechanism.symbols[s]
        for s in model.matrix.symbols
        if s in model.mechanism.symbols
    ]
    numbers, reading = model.matrix.numbers, model.reading
    rounding = "coefficients below 1e-11, from rounding of loop closures"
    return [
        (
            "symbols",
            ", ".join(f"{s.name} = {value_text(s.exact, s.value)}" for s in used),
        ),
        ("stated values", model.special.text("robot") if model.special else ""),
        ("numbers", numbers_text(model, numbers) if numbers else ""),
        ("largest coefficient", _size_text(model)),
        ("not shown", f"{model.hidden} {rounding}" if model.hidden else ""),
        ("rounded numbers", snap_summary(model) if reading.snaps else ""),
        ("mimic joints", str(reading.mimics or "")),
        ("assembly pose", str(reading.assembled or "")),
        *(("note", note) for note in reading.notes),
        ("doubt", reading.doubt),
        ("certificate", str(model.certificate)),
        (
            "assumes",
            f"{'; '.join(model.certificate.assumptions)} ({page('assumptions')})",
        ),
    ]


def _long_text(model: _RobotSet | _LinearSet) -> str:
    """How many formulas are not shown, and where they are; empty if none."""
    coefficients = [
        group.coefficient
        for expression in model.expressions
        for group in expression.groups
    ]
    lengths = [terms for terms in map(count_terms, coefficients) if terms > MOST_TERMS]
    if not lengths:
        return ""
    span = (
        f"{min(lengths)}"
        if len(set(lengths)) == 1
        else f"{min(lengths)} to {max(lengths)}"
    )
    return (
        f"{len(lengths)} coefficient{'s' * (len(lengths) != 1)} of {span} terms shown by value, or by the number of "
        "terms where symbols have no values; --full and saved sets have the formulas"
    )


def _size_text(model: _RobotSet | _LinearSet) -> str:
    largest = model.largest_coefficient
    return "" if largest is None else f"{largest:.3g}"


def numbers_text(model: _RobotSet | _LinearSet, numbers: StatedNumbers) -> str:
    """Which coefficients are numbers in place of closed forms, how exact they are, and how to ask for more."""
    within = "exact" if not numbers.radius else f"within {numbers.radius:.0e}"
    if len(numbers.columns) + model.matrix.rank == len(model.parameters):
        return f"all coefficients are numbers at the stated values, found in ball arithmetic ({within})"
    names = " ".join(model.parameters[column] for column in numbers.columns)
    return (
        f"the coefficients of {names} are numbers at the stated values, in place of closed forms "
        f"({within}; a larger --budget, without --numeric, finds more closed forms)"
    )


def value_text(exact: str | None, value: float | None) -> str:
    """Value of a symbol: exact text where there is one."""
    if exact is not None:
        return exact
    return "?" if value is None else f"{value:.9g}"


def snap_summary(model: _RobotSet) -> str:
    """The numbers that were read as exact ones, and whether that changed the rank."""
    reading = model.reading
    coarse = [snap for snap in reading.snaps if snap.difference > ROUNDING]
    text = f"{len(reading.snaps)} taken as exact, largest change {max(s.difference for s in reading.snaps):.2g}"
    if reading.literal_rank is None or not coarse:
        return f"{text} (rounding only)"
    if reading.literal_rank == model.rank:
        return f"{text}; the literal reading gives {reading.literal_rank} too"
    decisive = "; ".join(str(snap) for snap in reading.decisive)
    return f"{text}; the literal reading would give {reading.literal_rank} instead of {model.rank}, because of {decisive}"


def to_markdown(model: _RobotSet | _LinearSet, *, full: bool = False) -> str:
    """A Markdown table with closed forms and classification."""
    name = one_line(model.model.name if _is_linear(model) else model.mechanism.name)
    lines = [
        f"# Base parameters of {_cell(name)}",
        "",
        _cell(headline(model)) + ".",
        "",
    ]
    lines += ["| # | base parameter | unit |", "|--:|---|---|"]
    shown = shown_expressions(model, full=full)
    lines += [
        f"| {i + 1} | {_cell(str(e))} | {_cell(e.unit)} |" for i, e in enumerate(shown)
    ]
    noted = facts(model, full=full)
    if _is_linear(model):
        noted = [*_classes(model), *noted]
    else:
        lines += [
            "",
            f"| body | {' | '.join(PARAMETERS)} |",
            "|---|" + ":-:|" * PER_BODY,
        ]
        for title, marks in classification_rows(model):
            lines.append(
                f"| {_cell(title)} | {' | '.join(mark for mark, _ in marks)} |"
            )
        lines += ["", legend(model)]
    return (
        "\n".join([*lines, "", *(f"- {label}: {_cell(text)}" for label, text in noted)])
        + "\n"
    )


def _cell(text: str) -> str:
    """One line of text that is safe in Markdown and its tables."""
    return re.sub(r"([\\|<`*\[$])", r"\\\1", text)


def to_latex(model: _RobotSet | _LinearSet, *, full: bool = False) -> str:
    """A longtable-free LaTeX fragment: aligned equations that need only amsmath, and a comment with the facts."""
    comments = [f"% {headline(model)}"]
    comments += [f"% {name}: {text}" for name, text in facts(model, full=full)]
    rows = _latex_rows(model, full=full)
    pages = [
        rows[k : k + LATEX_ROWS_PER_PAGE]
        for k in range(0, len(rows), LATEX_ROWS_PER_PAGE)
    ]
    blocks = [
        "\\begin{align*}\n" + " \\\\\n".join(page) + "\n\\end{align*}" for page in pages
    ]
    symbols = {} if _is_linear(model) else model.mechanism.symbols
    values = [
        f"${latex_symbol(s)} = {_latex_value(symbols[s])}$"
        for s in model.matrix.symbols
        if s in symbols
    ]
    where = ["Values: " + ", ".join(values) + "."] if values else []
    return "\n".join([*comments, *blocks, *where]) + "\n"


def _latex_value(symbol: Symbol) -> str:
    """A value as people wrote it if that is a plain decimal, else as it was read."""
    exact = symbol.expression
    if exact is None or re.fullmatch(r"-?[0-9.]+", str(symbol.exact)):
        return value_text(symbol.exact, symbol.value)
    return latex_polynomial(exact)


def aligned_latex(model: _RobotSet | _LinearSet) -> str:
    """All equations in one ``aligned`` block, for notebooks."""
    return (
        "\\begin{aligned}"
        + " \\\\ ".join(_latex_rows(model, full=False))
        + "\\end{aligned}"
    )


def _latex_rows(model: _RobotSet | _LinearSet, *, full: bool) -> list[str]:
    style = _PlainLatex() if _is_linear(model) else LatexStyle()
    return [
        f"\\bar\\zeta_{{{i + 1}}} &= {render(e, style)}"
        for i, e in enumerate(shown_expressions(model, full=full))
    ]


def to_html(model: _RobotSet) -> str:
    """A small HTML table for notebooks."""
    left = "<td style='text-align:left'>"
    rows = classes = notes = ""
    for number, expression in enumerate(model.readable, 1):
        text, unit = escape(str(expression)), escape(expression.unit)
        rows += f"<tr><td>{number}</td>{left}{text}</td><td>{unit}</td></tr>"
    for title, marks in classification_rows(model):
        cells = "".join(f"<td>{mark}</td>" for mark, _ in marks)
        classes += f"<tr>{left}{escape(title)}</td>{cells}</tr>"
    for label, text in facts(model):
        notes += f"<li>{escape(f'{label}: {text}')}</li>"
    columns = "".join(f"<th>{name}</th>" for name in PARAMETERS)
    head = "<tr><th>#</th><th>base parameter</th><th>unit</th></tr>"
    table = f"<table>{head}{rows}</table>"
    seen = f"<table><tr><th>body</th>{columns}</tr>{classes}</table><p>{escape(legend(model))}</p>"
    return f"<p><b>{escape(headline(model))}</b></p>{table}{seen}<ul>{notes}</ul>"
