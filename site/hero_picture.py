"""The moving picture of README: a file goes in, formulas and what can be seen come out."""

from __future__ import annotations

from html import escape
from pathlib import Path

import echelon as ec
from echelon.base.display import classification_rows
from echelon.shared.conventions import PARAMETERS

WIDTH, HEIGHT, LINE = 920, 380, 19  # px
LEFT, RIGHT, TOP = 20, 372, 56  # px: the file, the answer, their first lines
SHOWN = (0, 1, 9, 12, 14, 42)  # formulas that fit
PERIOD, STEP = 14.0, 0.45  # s: one round, and from line to line
COLOURS = {"●": "#2f6f4f", "◐": "#5b9bd5", "·": "#9aa0a6"}


def picture(file: Path) -> str:
    """The derivation of a file as an SVG that needs no script; without motion where the reader wants none."""
    text = file.read_text(encoding="utf-8").splitlines()
    stated = [line for line in text if not line.startswith("#")]
    base = ec.base_parameters(ec.load(file))
    forms = [f"{k + 1:>2}  {base.expressions[k]}" for k in SHOWN]
    answer = [
        f"{base.rank} combinations of {len(base.parameters)} parameters can be identified:"
    ]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'role="img" aria-label="A robot file goes in; formulas of its base parameters come out">',
        "<style>",
        "text { font: 13px ui-monospace, Menlo, Consolas, monospace; fill: #24292f; white-space: pre }",
        ".title { font: bold 14px sans-serif }",
        f".late {{ opacity: 0; animation: come {PERIOD}s infinite }}",
        "@keyframes come { 0% { opacity: 0 } 3% { opacity: 1 } 92% { opacity: 1 } 98% { opacity: 0 } }",
        "@media (prefers-reduced-motion: reduce) { .late { opacity: 1; animation: none } }",
        "</style>",
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="10" fill="#f6f8fa"/>',
        f'<text class="title" x="{LEFT}" y="30">{escape(file.name)}</text>',
        f'<text class="title" x="{RIGHT}" y="30">$ echelon derive {escape(file.name)}</text>',
        f'<line x1="{RIGHT - 20}" y1="20" x2="{RIGHT - 20}" y2="{HEIGHT - 20}" stroke="#d0d7de"/>',
    ]
    parts += [
        f'<text x="{LEFT}" y="{TOP + LINE * k}" xml:space="preserve">{escape(_cut(line, 40))}</text>'
        for k, line in enumerate(stated)
    ]
    lines = [*answer, *(_cut(form, 66) for form in forms)]
    parts += [
        _late(k, RIGHT, TOP + LINE * k, escape(line)) for k, line in enumerate(lines)
    ]
    heads = "".join(f"{kind:<4}" for kind in PARAMETERS)
    first = TOP + LINE * (len(lines) + 2)
    parts.append(_late(len(lines), RIGHT, first - LINE, f"         {heads}"))
    for row, (title, cells) in enumerate(classification_rows(base)):
        marks = "".join(
            f'<tspan fill="{COLOURS.get(mark, "#24292f")}">{mark}   </tspan>'
            for mark, _ in cells
        )
        shown = f"link {escape(title.split()[0])}   {marks}"
        parts.append(_late(len(lines) + row, RIGHT, first + LINE * row, shown))
    meaning = "● alone   ◐ in combination   · not at all"
    parts.append(f'<text x="{LEFT}" y="{HEIGHT - 24}">{meaning}</text>')
    return "\n".join([*parts, "</svg>", ""])


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _late(number: int, x: int, y: int, text: str) -> str:
    delay = f"animation-delay: {1 + STEP * number:.2f}s"
    return f'<text class="late" style="{delay}" x="{x}" y="{y}" xml:space="preserve">{text}</text>'
