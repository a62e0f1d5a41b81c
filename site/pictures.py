"""Pictures of the site, as SVG: drawings of robots, the structure of B, plots, all without fixed colours of text."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from echelon.base.model import BaseModel
from echelon.comparison.result import Comparison
from echelon.report.drawing import seen_links
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import TEMPLATES, render

ROOT = Path(__file__).parent.parent
CSS = (TEMPLATES / "report.css").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Picture:
    """An SVG that stands alone, with a text for those who do not see it."""

    svg: str
    alt: str


class Text(str):
    """Markdown that a page gets as it is."""


def section(file: Path, title: str, only: str = "") -> str:
    """A section of a page of results, or what stands before the first; of tables only rows that match a pattern."""
    parts = re.split(r"^## (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    text = parts[0].split("\n", 1)[1] if not title else parts[parts.index(title) + 1]
    table = [
        line
        for line in text.strip().splitlines()
        if not only or line.startswith("|--") or re.search(only, line)
    ]
    head = next((line for line in text.splitlines() if line.startswith("|")), "")
    return "\n".join([head, *table] if only else table)


def robot(base: BaseModel) -> Picture:
    """The kinematics, with what the outputs see of each link."""
    return _alone(str(render("links.html.j2", seen_links(base))), "robot")


def structure(base: BaseModel) -> Picture:
    """Which standard parameter belongs to which base parameter."""
    shown = {"picture": matrix_picture(base), "mergings": mergings(base)}
    return _alone(str(render("structure.html.j2", shown)), "matrix")


def _alone(html: str, kind: str) -> Picture:
    """One SVG of a report's section with its own style: as an image it cannot disturb the page around it."""
    marks = re.search(r'<svg width="0".*?<defs>(.*?)</defs></svg>', html, re.DOTALL)
    svg = re.search(rf'<svg class="{kind}.*?</svg>', html, re.DOTALL)
    assert svg is not None
    rules = re.findall(
        r"[^{}\n]+\{[^{}]*\}", CSS[: CSS.index("@media")] + CSS[CSS.index("* {") :]
    )
    style = "".join(
        f"{rule.strip()}\n"
        for rule in rules
        if re.search("fill:|stroke|font-weight|--ink:", rule)
    )
    text = svg[0].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    text = text.replace(
        ">",
        f">\n<style>\n{style}</style>\n{f'<defs>{marks[1]}</defs>' if marks else ''}",
        1,
    )
    alt = re.search('aria-label="([^"]*)"', text)
    return Picture(text + "\n", alt[1] if alt else "")


def plot(figure: Any, alt: str) -> Picture:
    """A figure of matplotlib."""
    buffer = io.StringIO()
    figure.savefig(
        buffer,
        format="svg",
        bbox_inches="tight",
        metadata={"Date": None, "Creator": None},
    )
    text = buffer.getvalue()
    return Picture(text[text.index("<svg") :], alt)


def axes(width: float = 7.0, height: float = 3.0, count: int = 1) -> Any:
    """A figure of matplotlib with axes, one below the other, that look alike everywhere."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "echelon", "font.size": 9}
    matplotlib.rcParams |= {"axes.spines.top": False, "axes.spines.right": False}
    from matplotlib import pyplot

    return pyplot.subplots(
        count, figsize=(width, height * count), sharex=True, layout="constrained"
    )


ROW, LEFT, WIDTH = 26, 110, 440
"""Height of a bar with its gap, where bars begin, and the length of the longest, in pixels."""


def comparison(found: Comparison) -> Picture:
    """Bars of the largest differences of outputs: what was attained in front of what none exceeds."""
    totals = [output.total for output in found.outputs]
    scale = WIDTH / max(total.bound or total.attained for total in totals)
    height = ROW * len(totals) + 30
    alt = f"Largest differences of the torques of {found.first}: attained, in front of bounds"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 130} {height}" role="img" '
        f'aria-label="{alt}" font-family="sans-serif" font-size="12" fill="currentColor">',
        "<style>svg{color:#1f2328}@media(prefers-color-scheme:dark){svg{color:#e6edf3}}</style>",
    ]
    for k, (output, total) in enumerate(zip(found.outputs, totals, strict=True)):
        top, bound = k * ROW + 6, total.bound or total.attained
        lines += [
            f'<text x="{LEFT - 8}" y="{top + 13}" text-anchor="end">{output.name}</text>',
            f'<rect x="{LEFT}" y="{top}" width="{bound * scale:.0f}" height="18" fill="#9bb7d4"/>',
            f'<rect x="{LEFT}" y="{top + 4}" width="{total.attained * scale:.0f}" height="10" fill="#1f5a96"/>',
            f'<text x="{LEFT + bound * scale + 8:.0f}" y="{top + 13}">'
            f"{total.attained:.2g} ≤ {bound:.2g} {output.unit}</text>",
        ]
    legend = "dark: the largest difference that was met; light: no state within the limits exceeds it"
    lines.append(f'<text x="{LEFT}" y="{height - 8}">{legend}</text>')
    return Picture("\n".join([*lines, "</svg>"]) + "\n", alt)


def residuals() -> str:
    """Residuals of the example of a calibration, before and after."""
    import echelon
    from echelon.report import calibration_html

    folder = ROOT / "examples" / "calibration"
    html = calibration_html(
        echelon.calibrate(folder / "arm.yaml", folder / "tracker.csv")
    )
    svg = re.search(r"<svg viewBox=.*?</svg>", html, re.DOTALL)
    assert svg is not None
    return svg[0].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def write(folder: Path) -> None:
    """The pictures of README and of the documentation."""
    import adaptive_picture
    import badges_picture
    import echelon
    import elastic_picture
    import experiments_picture
    import hero_picture
    from rooms_picture import picture

    base = echelon.base_parameters(echelon.load(ROOT / "examples/panda.yaml"))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "panda.svg").write_text(robot(base).svg, encoding="utf-8")
    (folder / "panda-structure.svg").write_text(structure(base).svg, encoding="utf-8")
    moving = hero_picture.picture(ROOT / "examples/panda.yaml")
    (folder / "hero.svg").write_text(moving, encoding="utf-8")
    arms = (ROOT / "examples/so101.urdf", ROOT / "docs/examples/so101_cad.urdf")
    found = echelon.compare(*arms, limits={"velocity": 3, "acceleration": 20})
    (folder / "compare.svg").write_text(comparison(found).svg, encoding="utf-8")
    (folder / "calibration.svg").write_text(residuals(), encoding="utf-8")
    (folder / "rooms.svg").write_text(picture(), encoding="utf-8")
    table = echelon.Experiment(base.mechanism, "table")
    wall = echelon.Experiment(base.mechanism, "wall", gravity=(9.81, 0, 0))
    won = experiments_picture.picture([table, wall])
    (folder / "experiments.svg").write_text(won, encoding="utf-8")
    drive = elastic_picture.picture()
    (folder / "elastic-drive.svg").write_text(drive, encoding="utf-8")
    badges = badges_picture.picture(ROOT)
    (folder / "badges.svg").write_text(badges, encoding="utf-8")
    learning = adaptive_picture.picture(ROOT / "examples/14_adaptive_control.py")
    (folder / "adaptive-control.svg").write_text(learning, encoding="utf-8")


if __name__ == "__main__":
    write(ROOT / "docs" / "pictures")
