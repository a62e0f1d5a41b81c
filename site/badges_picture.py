"""Badges of README: version, Python, licence and types, from the files that decide them."""

from __future__ import annotations

import tomllib
from html import escape
from pathlib import Path

import echelon

HEIGHT, LETTER, MARGIN, GAP = 20, 6.6, 8, 6  # px
DARK, LIGHT = "#424a53", "#0b5cad"


def picture(root: Path) -> str:
    """A row of badges as an SVG."""
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    facts = [
        ("version", echelon.__version__),
        ("Python", project["requires-python"].replace(">=", "≥ ")),
        ("licence", project["license"]),
    ]
    if (root / "src/echelon/py.typed").exists():
        facts.append(("types", "strict"))
    left, parts = 0.0, []
    for name, value in facts:
        for text, colour in ((name, DARK), (value, LIGHT)):
            width = LETTER * len(text) + 2 * MARGIN
            middle = left + width / 2
            parts += [
                f'<rect x="{left:.1f}" width="{width:.1f}" height="{HEIGHT}" fill="{colour}"/>',
                f'<text x="{middle:.1f}" y="14" text-anchor="middle">{escape(text)}</text>',
            ]
            left += width
        left += GAP
    said = ", ".join(f"{name} {value}" for name, value in facts)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left - GAP:.1f}" height="{HEIGHT}" role="img" '
        f'aria-label="{escape(said)}">',
        "<style>text { font: 11px Verdana, sans-serif; fill: #ffffff }</style>",
    )
    return "\n".join([*head, *parts, "</svg>"]) + "\n"
