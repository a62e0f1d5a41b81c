"""What a second experiment wins: the ten parameters of every body, and how each experiment sees them, as SVG."""

from __future__ import annotations

from collections.abc import Sequence

import echelon as ec
from echelon.base.matrix import Identifiability

CELL, LEFT, TOP = 26, 46, 44  # px
KINDS = ["XX", "XY", "XZ", "YY", "YZ", "ZZ", "MX", "MY", "MZ", "M"]
FILLS = {
    Identifiability.ALONE: "#2f6f4f",
    Identifiability.COMBINATION: "#9fc5b0",
    Identifiability.UNIDENTIFIABLE: "#eceeed",
}
WON = "#d9822b"


def picture(experiments: Sequence[ec.Experiment]) -> str:
    """Parameters as the first experiment sees them, with a frame around those that all together see better."""
    one = ec.base_parameters(experiments[0]).classification
    base = ec.base_parameters(experiments)
    every = base.classification
    bodies = [base.mechanism.bodies[k] for k in base.mechanism.carriers]
    height = TOP + CELL * len(bodies) + 40
    width = LEFT + CELL * len(KINDS) + 10
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="sans-serif" font-size="12" role="img" aria-label="Parameters that a second experiment wins">',
        "<style>text { fill: currentColor; color: #444 } @media (prefers-color-scheme: dark) { text { color: #ccc } }"
        "</style>",
    ]
    for column, kind in enumerate(KINDS):
        x = LEFT + CELL * (column + 0.5)
        parts.append(f'<text x="{x}" y="{TOP - 8}" text-anchor="middle">{kind}</text>')
    for row, body in enumerate(bodies):
        y = TOP + CELL * row
        parts.append(
            f'<text x="{LEFT - 8}" y="{y + 17}" text-anchor="end">link {body.label}</text>'
        )
        for column, kind in enumerate(KINDS):
            name = f"{kind}{body.label}"
            better = one[name] != every[name]
            frame = f' stroke="{WON}" stroke-width="3"' if better else ""
            x = LEFT + CELL * column
            parts.append(
                f'<rect x="{x + 3}" y="{y + 3}" width="{CELL - 6}" height="{CELL - 6}" rx="3" '
                f'fill="{FILLS[every[name]]}"{frame}><title>{name}: {one[name].value} before, {every[name].value} now'
                "</title></rect>"
            )
    legend = [
        (FILLS[Identifiability.ALONE], "alone"),
        (FILLS[Identifiability.COMBINATION], "combined"),
        (FILLS[Identifiability.UNIDENTIFIABLE], "unseen"),
    ]
    x, y = LEFT, height - 24
    for fill, text in legend:
        parts.append(
            f'<rect x="{x}" y="{y}" width="12" height="12" rx="2" fill="{fill}"/><text x="{x + 17}" y="{y + 10}">{text}</text>'
        )
        x += 92
    parts.append(
        f'<rect x="{x + 1}" y="{y + 1}" width="10" height="10" rx="2" fill="none" stroke="{WON}" stroke-width="3"/><text x="{x + 17}" y="{y + 10}">won</text>'
    )
    return "\n".join([*parts, "</svg>", ""])
