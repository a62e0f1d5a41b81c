"""One robot of the zoo: what is derived, the files that are written, and its row in the index."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import echelon
from echelon.base.derive import base_parameters
from echelon.base.display import classification_rows, facts, headline, to_latex
from echelon.base.expression import LatexStyle, render
from echelon.base.model import BaseModel
from echelon.base.sensors import sensor_report
from echelon.codegen.source import generate
from echelon.conventions import PARAMETERS
from echelon.errors import EchelonError, one_line
from echelon.files import write_atomically, written_into
from echelon.formats.robot_file import load
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.report.closed_forms import ClosedForms
from echelon.report.drawing import CLASSES, seen_links
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import Context
from echelon.report.page import render as render_page
from echelon.results.saved import to_json
from echelon.version import __version__
from echelon.zoo.faults import faults
from echelon.zoo.find import Found, stands_alone

TEMPLATES = Path(__file__).with_name("templates")
ROW = "row.json"
_FUNCTIONS = ("regressor", "inverse_dynamics")
_SNAPS = 200  # that are listed
_MOST_SENSED, _MOST_DRAWN = 450, 300  # standard parameters of robots with sets of sensors, and with a picture of B
Row = dict[str, Any]
"""What the index knows of a robot; plain data."""


@dataclass(frozen=True)
class Task:
    """A robot file, with its base fixed or floating."""

    found: Found
    floating: bool
    folder: Path  # of the zoo
    site: str = ""  # where documentation and explorer are, seen from that folder; nothing if there is only the zoo

    @property
    def slug(self) -> str:
        """Name of its folder."""
        return self.found.slug + ("-floating" if self.floating else "")

    @property
    def key(self) -> str:
        """Digest of the file's content and of the program: what is there for the same key is not built again."""
        return hashlib.sha256(_program() + self.site.encode() + self.found.path.read_bytes()).hexdigest()

    @property
    def start(self) -> Row:
        """What is known before anything is derived."""
        return {"slug": self.slug, "place": self.found.place, "floating": self.floating, "version": __version__}

    def finished(self) -> Row | None:
        """Its row, if it was built of the same file by the same program."""
        try:
            row: Row = json.loads((self.folder / self.slug / ROW).read_text(encoding="utf-8"))
            return row if row["key"] == self.key else None
        except (OSError, ValueError, KeyError, TypeError):
            return None


@cache
def _program() -> bytes:
    package = Path(echelon.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(path for path in package.rglob("*") if path.suffix in (".py", ".j2", ".css", ".js")):
        digest.update(path.read_bytes())
    return digest.digest()


def build_exhibit(task: Task) -> Row | None:
    """Derive one robot and write its folder; None for a floating base where the base floats anyway."""
    robot = load(task.found.path)
    if task.floating:
        if _floats(robot):
            return None
        robot = load(task.found.path, floating=True)
    base = base_parameters(robot)
    sources, missing = _sources(base)
    sensors, wrong = _sensors(base), [asdict(fault) for fault in faults(base)]
    reading = base.reading
    row: Row = {
        **task.start,
        "key": task.key,
        "explorer": _in_explorer(task),
        "name": one_line(robot.name) or task.found.slug,
        "bodies": len(robot.bodies),
        "freedoms": robot.degrees_of_freedom,
        "loops": len(robot.closures),
        "mimics": None if reading.mimics is None else asdict(reading.mimics),
        "rank": base.rank,
        "standard": len(base.parameters),
        "literal": reading.literal_rank if reading.literal_rank != base.rank else None,
        "faults": wrong,
    }
    shown = {**_page(base, row, sensors, sources, missing), "site": task.site}
    files = {"set.json": to_json(base), "base.tex": to_latex(base), **sources}
    files["index.html"] = render_page("robot.html.j2", shown, TEMPLATES) + "\n"
    written_into(task.folder / task.slug, files)
    write_atomically(task.folder / task.slug / ROW, json.dumps(row, indent=1, ensure_ascii=False) + "\n")
    return row


def _in_explorer(task: Task) -> str:
    """The address of the robot in the explorer, seen from the zoo's folder; empty if it is not there."""
    if not task.site or not stands_alone(task.found.path):
        return ""
    chosen = {"robot": task.found.slug + task.found.path.suffix} | ({"floating": "yes"} if task.floating else {})
    return f"{task.site}explorer/index.html#{urlencode(chosen)}"


def _floats(robot: Mechanism) -> bool:
    """Whether the base floats already: a body on the ground has a ball in its joint."""
    return any(
        motion.kind is MotionKind.BALL for body in robot.bodies if body.parent < 0 for motion in body.joint.motions
    )


def _sources(base: BaseModel) -> tuple[dict[str, str], str]:
    """Source in C and Python, by file name; and why there is none."""
    try:
        return {
            name: text for target in ("c", "python") for name, text in generate(base, target, _FUNCTIONS).items()
        }, ""
    except EchelonError as error:
        return {}, one_line(str(error))


def _sensors(base: BaseModel) -> Context:
    """What single sensors see, and which suffice."""
    if len(base.parameters) > _MOST_SENSED:
        return {
            "problem": f"Sets of sensors were not tried for {len(base.parameters)} parameters: see echelon sensors."
        }
    try:
        report = sensor_report(base.mechanism)
    except EchelonError as error:
        return {"problem": one_line(str(error))}
    single = sorted(((one_line(names[0]), rank) for names, rank in report.ranks.items()), key=lambda pair: -pair[1])
    return {
        "problem": "",
        "rank": report.rank,
        "smallest": [one_line(name) for name in report.smallest],
        "proven": report.proven_smallest,
        "single": single,
    }


def _page(base: BaseModel, row: Row, sensors: Context, sources: dict[str, str], missing: str) -> Context:
    drawn = len(base.parameters) <= _MOST_DRAWN
    return {
        "row": row,
        "title": f"{row['name']}, {'floating' if row['floating'] else 'fixed'} base",
        "headline": headline(base),
        "version": __version__,
        "columns": PARAMETERS,
        "table": _table(base),
        "links": seen_links(base),
        "structure": {"picture": matrix_picture(base), "mergings": mergings(base)} if drawn else None,
        "groups": _groups(base),
        "snaps": base.reading.snaps[:_SNAPS],
        "more_snaps": max(len(base.reading.snaps) - _SNAPS, 0),
        "decisive": [str(snap) for snap in base.reading.decisive],
        "sensors": sensors,
        "facts": facts(base),
        "certificate": str(base.certificate),
        "sources": {name: len(text.encode()) for name, text in sources.items()},
        "missing": missing,
    }


def _table(base: BaseModel) -> list[Context]:
    """One row per body: its title, and for each of XX … M a mark, a class of the style sheet, and what it means."""
    return [
        {
            "title": title,
            "cells": [(mark, CLASSES[kind], kind.value) if kind else ("", "", "") for mark, kind in cells],
        }
        for title, cells in classification_rows(base)
    ]


def _groups(base: BaseModel) -> list[Context]:
    """Closed forms by the body of their representatives, with their LaTeX."""
    mechanism, style = base.mechanism, LatexStyle()
    forms = zip(range(base.rank), base.matrix.pivots, base.expressions, ClosedForms(base).all(), strict=True)
    found = []
    for body, some in groupby(forms, key=lambda form: mechanism.columns[form[1]].body):
        rows: list[Context] = [
            {"number": k + 1, "form": form, "latex": render(expression, style), "unit": expression.unit}
            for k, _, expression, form in some
        ]
        title = (
            "effects" if body is None else one_line(f"{mechanism.bodies[body].label} {mechanism.carrier_name(body)}")
        )
        found.append({"title": title, "rows": rows, "latex": _aligned([row["latex"] for row in rows])})
    return found


def _aligned(rows: Sequence[str]) -> str:
    return "\\begin{align*}\n" + " \\\\\n".join(f"& {row}" for row in rows) + "\n\\end{align*}"
