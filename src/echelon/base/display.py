"""A BaseModel as text, Markdown, LaTeX and HTML."""

from __future__ import annotations

from html import escape

from echelon.base.expression import LatexStyle, TextStyle, latex_symbol, render
from echelon.base.model import BaseModel, Identifiability
from echelon.base.reading_report import ROUNDING

_LATEX_ROWS_PER_PAGE = 40


def headline(model: BaseModel) -> str:
    """The count in one line."""
    name, rank, total = model.mechanism.name, model.rank, len(model.parameters)
    return f"{name}: {rank} base parameters of {total} standard parameters, {model.mechanism.degrees_of_freedom} outputs"


def to_text(model: BaseModel) -> str:
    """Plain text: count, expressions, classification, reading, symbols, certificate."""
    width = max((len(str(i + 1)) for i in range(model.rank)), default=1)
    lines = [headline(model), ""]
    lines += [f"{i + 1:>{width}}  {expression}" for i, expression in enumerate(model.expressions)]
    lines += ["", *classification_lines(model)]
    lines += [f"{label}: {text}" for label, text in facts(model)]
    return "\n".join(lines)


def classification_lines(model: BaseModel) -> list[str]:
    """One line per class of standard parameters."""
    return [f"{kind.value} ({len(names)}): {compact_names(names)}" for kind, names in by_class(model)]


def by_class(model: BaseModel) -> list[tuple[Identifiability, list[str]]]:
    """Standard parameters by class, in column order."""
    return [
        (kind, [name for name, found in model.classification.items() if found is kind])
        for kind in (Identifiability.ALONE, Identifiability.COMBINATION, Identifiability.UNIDENTIFIABLE)
    ]


def compact_names(names: list[str]) -> str:
    """Names in one line."""
    return " ".join(names) or "none"


def facts(model: BaseModel) -> list[tuple[str, str]]:
    """What else a reader should know: bodies, symbols, snapping, notes, certificate."""
    found = []
    bodies = [f"{model.mechanism.bodies[b].label} = {model.mechanism.bodies[b].name}" for b in model.mechanism.carriers]
    if bodies:
        found.append(("bodies", ", ".join(bodies)))
    used = [model.mechanism.symbols[s] for s in model.matrix.symbols if s in model.mechanism.symbols]
    if used:
        found.append(("symbols", ", ".join(f"{s.name} = {value_text(s.exact, s.value)}" for s in used)))
    if model.reading.snaps:
        found.append(("read as exact", snap_summary(model)))
    found += [("note", note) for note in model.reading.notes]
    found.append(("certificate", str(model.certificate)))
    return found


def value_text(exact: str | None, value: float | None) -> str:
    """Value of a symbol: exact text where there is one."""
    if exact is not None:
        return exact
    return "?" if value is None else f"{value:.9g}"


def snap_summary(model: BaseModel) -> str:
    """What was snapped, and whether it made a difference."""
    reading = model.reading
    coarse = [snap for snap in reading.snaps if snap.difference > ROUNDING]
    text = f"{len(reading.snaps)} numbers, largest change {max(s.difference for s in reading.snaps):.2g}"
    if reading.literal_rank is None or not coarse:
        return f"{text} (rounding only)"
    if reading.literal_rank == model.rank:
        return f"{text}; the literal reading gives {reading.literal_rank} too"
    decisive = "; ".join(str(snap) for snap in reading.decisive)
    return f"{text}; the literal reading would give {reading.literal_rank} instead of {model.rank}, because of {decisive}"


def to_markdown(model: BaseModel) -> str:
    """A Markdown table with closed forms and classification."""
    lines = [f"# Base parameters of {model.mechanism.name}", "", headline(model) + ".", ""]
    lines += ["| # | base parameter | unit |", "|--:|---|---|"]
    lines += [
        f"| {i + 1} | {render(e, TextStyle()).replace('|', chr(92) + '|')} | {e.unit} |"
        for i, e in enumerate(model.expressions)
    ]
    lines += ["", *(f"- {line}" for line in classification_lines(model))]
    lines += [f"- {label}: {text}" for label, text in facts(model)]
    return "\n".join(lines) + "\n"


def to_latex(model: BaseModel) -> str:
    """A longtable-free LaTeX fragment: aligned equations that need only amsmath, and a comment with the facts."""
    comments = [f"% {line}" for line in (headline(model), *(f"{a}: {b}" for a, b in facts(model)))]
    rows = _latex_rows(model)
    pages = [rows[k : k + _LATEX_ROWS_PER_PAGE] for k in range(0, len(rows), _LATEX_ROWS_PER_PAGE)]
    blocks = ["\\begin{align*}\n" + " \\\\\n".join(page) + "\n\\end{align*}" for page in pages]
    used = [s for s in model.matrix.symbols if s in model.mechanism.symbols]
    values = [
        f"${latex_symbol(s)} = {value_text(model.mechanism.symbols[s].exact, model.mechanism.symbols[s].value)}$"
        for s in used
    ]
    where = ["Values: " + ", ".join(values) + "."] if values else []
    return "\n".join([*comments, *blocks, *where]) + "\n"


def aligned_latex(model: BaseModel) -> str:
    """All equations in one ``aligned`` block, for notebooks."""
    return "\\begin{aligned}" + " \\\\ ".join(_latex_rows(model)) + "\\end{aligned}"


def _latex_rows(model: BaseModel) -> list[str]:
    return [f"\\bar\\zeta_{{{i + 1}}} &= {render(e, LatexStyle())}" for i, e in enumerate(model.expressions)]


def to_html(model: BaseModel) -> str:
    """A small HTML table for notebooks."""
    rows = "".join(
        f"<tr><td>{i + 1}</td><td style='text-align:left'>{escape(str(e))}</td><td>{escape(e.unit)}</td></tr>"
        for i, e in enumerate(model.expressions)
    )
    items = [*classification_lines(model), *(f"{label}: {text}" for label, text in facts(model))]
    notes = "".join(f"<li>{escape(line)}</li>" for line in items)
    head = "<tr><th>#</th><th>base parameter</th><th>unit</th></tr>"
    return f"<p><b>{escape(headline(model))}</b></p><table>{head}{rows}</table><ul>{notes}</ul>"
