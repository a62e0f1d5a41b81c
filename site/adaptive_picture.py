"""How an adaptive controller learns: errors of the joints over time, with and without adaptation, as SVG."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

WIDTH, HEIGHT = 760, 330
LEFT, RIGHT, TOP, BOTTOM = 70, 20, 24, 46  # margins, px
DECADES = (-1, 3)  # of mrad: the range of the axis
CURVES = {"without adaptation": "#b5532a", "with adaptation": "#1b6ca8"}


def picture(example: Path) -> str:
    """Largest error of the joints in each tenth of a second, on a logarithmic scale."""
    simulation = runpy.run_path(str(example), run_name="picture")
    seconds = simulation["SECONDS"]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" font-family="sans-serif" font-size="13" '
        'role="img" aria-label="Tracking errors of an adaptive controller and of one that does not adapt">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for decade in range(DECADES[0], DECADES[1] + 1):
        y = height(10.0**decade)
        parts.append(
            f'<path d="M{LEFT} {y}H{WIDTH - RIGHT}" stroke="#ddd"/>'
            f'<text x="{LEFT - 8}" y="{y + 4}" text-anchor="end">{10.0**decade:g}</text>'
        )
    for mark in range(0, int(seconds) + 1, 4):
        x = place(mark, seconds)
        parts.append(
            f'<text x="{x}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{mark}</text>'
        )
    parts.append(
        f'<text x="{WIDTH - RIGHT}" y="{HEIGHT - 10}" text-anchor="end">time, s</text>'
        f'<text x="{LEFT - 60}" y="{TOP - 8}">largest error of a joint, mrad</text>'
    )
    for k, ((name, colour), adaptation) in enumerate(
        zip(CURVES.items(), (0.0, simulation["ADAPTATION"]), strict=True)
    ):
        times, errors, _ = simulation["simulated"](seconds, adaptation)
        points = curve(times, 1e3 * np.abs(errors).max(axis=1), seconds)
        y = TOP + 18 + 18 * k
        parts.append(
            f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>'
            f'<text x="{WIDTH - RIGHT - 8}" y="{y}" text-anchor="end" fill="{colour}">{name}</text>'
        )
    return "\n".join([*parts, "</svg>", ""])


def curve(times: np.ndarray, errors: np.ndarray, seconds: float) -> str:
    """The largest error of each tenth of a second, as points."""
    tenths = np.round(10 * times).astype(int)
    found = [(k, errors[tenths == k].max()) for k in range(tenths[-1] + 1)]
    return " ".join(f"{place(k / 10, seconds)},{height(error)}" for k, error in found)


def place(time: float, seconds: float) -> int:
    """Where a time is, px."""
    return round(LEFT + (WIDTH - LEFT - RIGHT) * time / seconds)


def height(error: float) -> int:
    """Where an error is, px."""
    share = (np.log10(error) - DECADES[0]) / (DECADES[1] - DECADES[0])
    return round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * float(share))
