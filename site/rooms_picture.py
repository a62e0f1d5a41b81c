"""The picture of the rooms of the package, and of how three jobs go through them.

Floors are those of the import contract in ``pyproject.toml``; what a room is for is the first line of its docstring.
"""

from __future__ import annotations

import ast
import tomllib
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
JOBS = {
    "derive": ("cli", "base", "formats", "dynamics", "loops", "robot", "algebra"),
    "identify": (
        "cli", "report", "identification", "base", "formats", "dynamics", "compute",
        "robot", "algebra",
    ),
    "excite": (
        "cli", "report", "excite", "base", "formats", "dynamics", "compute", "robot",
        "algebra",
    ),
}  # fmt: skip
"""Rooms that do the work of a job."""
COLOURS = {"derive": "#1b6ca8", "identify": "#b5532a", "excite": "#3c7d3c"}
LEFT, WIDTH, FLOOR, GAP = 20, 900, 40, 8
"""Left edge, width, height and distance of the floors, px."""
FIRST_LANE, LANE = 740, 60
"""Place of the first job's line, and the distance of lines, px."""


def floors() -> list[list[str]]:
    """Rooms from the command line down, those that do not know each other side by side."""
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    layers = contract["tool"]["importlinter"]["contracts"][0]["layers"]
    return [layer.split(" | ") for layer in layers if layer != "__main__"]


def purpose(room: str) -> str:
    """First sentence of a room's docstring."""
    source = ROOT / "src" / "echelon" / room / "__init__.py"
    text = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    return text.split("\n")[0]


def line(top: int, room: str) -> list[str]:
    """A floor: its box, name and purpose, and a dot for each job that works there."""
    middle = top + FLOOR // 2
    drawn = [
        f'<rect x="{LEFT}" y="{top}" width="{WIDTH}" height="{FLOOR}" rx="6" fill="#f4f4f1"/>',
        f'<text x="{LEFT + 12}" y="{middle + 5}" font-weight="bold">{room}</text>',
        f'<text x="{LEFT + 130}" y="{middle + 4}" font-size="11">{escape(shortened(purpose(room)))}</text>',
    ]
    for k, (job, rooms) in enumerate(JOBS.items()):
        if room in rooms:
            place = FIRST_LANE + k * LANE
            drawn.append(
                f'<circle cx="{place}" cy="{middle}" r="7" fill="{COLOURS[job]}"/>'
            )
    return drawn


def shortened(text: str, most: int = 92) -> str:
    """A text of at most so many letters, cut between words."""
    if len(text) <= most:
        return text
    return text[: text.rindex(" ", 0, most)] + " …"


def picture() -> str:
    """The picture as SVG."""
    rooms = [room for floor in floors() for room in floor]
    height = 40 + len(rooms) * (FLOOR + GAP)
    drawn: list[str] = []
    for k, room in enumerate(rooms):
        drawn += line(40 + k * (FLOOR + GAP), room)
    for k, job in enumerate(JOBS):
        place = FIRST_LANE + k * LANE
        places = [
            40 + n * (FLOOR + GAP) + FLOOR // 2
            for n, room in enumerate(rooms)
            if room in JOBS[job]
        ]
        drawn.append(
            f'<path d="M{place} {places[0]}V{places[-1]}" stroke="{COLOURS[job]}" stroke-width="2"/>'
        )
        drawn.append(
            f'<text x="{place}" y="26" text-anchor="middle" font-size="12" fill="{COLOURS[job]}">{job}</text>'
        )
    body = "\n".join(drawn)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH + 2 * LEFT} {height}" '
        f'font-family="sans-serif" font-size="14">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n'
    )
