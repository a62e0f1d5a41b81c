"""The robots of the zoo: files that look like one by ending and root element; what is derived and written of each."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sysconfig
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np

import echelon
from echelon.base.derive import base_parameters
from echelon.base.display import classification_rows, facts, headline, to_latex
from echelon.base.expression import LatexStyle, render
from echelon.base.model import BaseModel
from echelon.base.saved.saved import to_json
from echelon.base.sensors import sensor_report
from echelon.codegen.source import generate
from echelon.formats.literal import LiteralPlacement
from echelon.formats.robot_file import load
from echelon.report.drawing import CLASSES, seen_links
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import ClosedForms, Context
from echelon.report.page import render as render_page
from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism
from echelon.shared.conventions import PARAMETERS
from echelon.shared.errors import EchelonError, InputError, one_line
from echelon.shared.files import write_atomically, written_into
from echelon.shared.version import __version__
from robot_zoo.faults import Fault, faults, read_from

_ROOTS = {
    ".urdf": rb"",
    ".sdf": rb"<sdf\b",
    ".xml": rb"<(robot|mujoco)\b[\s\S]*<(joint|freejoint)\b",
    ".mjcf": rb"<mujoco\b",
    ".yaml": rb"(?m)^echelon:",
    ".yml": rb"(?m)^echelon:",
}
"""What must stand in a file with each ending; a URDF that is damaged is an entry, too."""
_LARGEST = 20_000_000  # bytes; what is larger is no robot
_BEYOND_MEANING = 1e9  # of a coefficient, in powers of metres; in SI units those of robots are below a thousand


@dataclass(frozen=True)
class Found:
    """A robot file."""

    path: Path
    place: str  # its path below the folder that was searched
    slug: str  # a name for folders and addresses, unlike all others


def usual_folders() -> list[Path]:
    """The folders of the packages ``example-robot-data`` and ``robot_descriptions`` that are there."""
    installed = (
        Path(sysconfig.get_path("purelib"))
        / "cmeel.prefix"
        / "share"
        / "example-robot-data"
        / "robots"
    )
    cached = Path(
        os.environ.get("ROBOT_DESCRIPTIONS_CACHE", "~/.cache/robot_descriptions")
    ).expanduser()
    return [folder for folder in (installed, cached) if folder.is_dir()]


def robot_files(folders: Sequence[Path]) -> list[Found]:
    """All robot files below folders, in the order of their paths."""
    found = []
    for folder in folders:
        if not folder.is_dir():
            raise InputError("is not a directory", source=str(folder))
        paths = sorted(
            path
            for path in folder.rglob("*")
            if path.suffix.lower() in _ROOTS and path.is_file()
        )
        found += [(path, path.relative_to(folder)) for path in paths if _is_robot(path)]
    stems = Counter(_slug(place.stem) for _, place in found)
    return [
        Found(path, place.as_posix(), slug)
        for (path, place), slug in zip(found, _slugs(found, stems), strict=True)
    ]


def _slugs(found: list[tuple[Path, Path]], stems: Counter[str]) -> list[str]:
    """The name of the file; with that of its package where others have the same, and then a number."""
    taken: Counter[str] = Counter()
    slugs = []
    for _, place in found:
        slug = _slug(place.stem)
        if stems[slug] > 1 and len(place.parts) > 1:
            slug = f"{_slug(place.parts[0].removesuffix('_description'))}-{slug}"
        taken[slug] += 1
        slugs.append(slug if taken[slug] == 1 else f"{slug}-{taken[slug]}")
    return slugs


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "robot"


def stands_alone(path: Path) -> bool:
    """Whether a robot file needs no other file and no MuJoCo, so that the explorer can read it in a browser."""
    if path.suffix not in (".urdf", ".yaml"):
        return False
    return not re.search(
        r"^(robot|model):",
        path.read_text(encoding="utf-8", errors="replace"),
        re.MULTILINE,
    )


def _is_robot(path: Path) -> bool:
    pattern = _ROOTS[path.suffix.lower()]
    if not pattern:
        return True
    try:
        return (
            path.stat().st_size < _LARGEST
            and re.search(pattern, path.read_bytes()) is not None
        )
    except OSError:
        return False


TEMPLATES = Path(__file__).with_name("templates")
ROW = "row.json"
_FUNCTIONS = ("regressor", "inverse_dynamics")
_SNAPS = 200  # that are listed
_MOST_SENSED, _MOST_DRAWN = (
    450,
    300,
)  # standard parameters of robots with sets of sensors, and with a picture of B
Row = dict[str, Any]  # what the index knows of a robot; plain data


@dataclass(frozen=True)
class ZooTask:
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
        return hashlib.sha256(
            _program() + self.site.encode() + self.found.path.read_bytes()
        ).hexdigest()

    @property
    def start(self) -> Row:
        """Fields of the row that are known before the derivation."""
        return {
            "slug": self.slug,
            "place": self.found.place,
            "floating": self.floating,
            "version": __version__,
        }

    def finished(self) -> Row | None:
        """Its row, if it was built of the same file by the same program."""
        try:
            row: Row = json.loads(
                (self.folder / self.slug / ROW).read_text(encoding="utf-8")
            )
            return row if row["key"] == self.key else None
        except (OSError, ValueError, KeyError, TypeError):
            return None


@cache
def _program() -> bytes:
    digest = hashlib.sha256()
    for package in (Path(echelon.__file__).parent, Path(__file__).parent):
        for path in sorted(package.rglob("*")):
            if path.suffix in (".py", ".j2", ".css", ".js"):
                digest.update(path.read_bytes())
    return digest.digest()


def build_exhibit(task: ZooTask) -> Row | None:
    """Derive one robot and write its folder; None for a floating base where the base moves by itself."""
    robot, wrong = _read(task.found.path)
    if task.floating:
        if _moves(robot):
            return None
        robot, wrong = _read(task.found.path, floating=True)
    base = base_parameters(robot)
    sources, missing = _sources(base)
    sensors, wrong = (
        _sensors(base),
        [*wrong, *(asdict(fault) for fault in faults(base))],
    )
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
        "doubts": _doubts(base),
        "faults": wrong,
    }
    shown = {**_page(base, row, sensors, sources, missing), "site": task.site}
    files = {
        "set.json": to_json(base),
        "base.tex": to_latex(base, full=True),
        **sources,
    }
    files["index.html"] = render_page("robot.html.j2", shown, TEMPLATES) + "\n"
    written_into(task.folder / task.slug, files)
    write_atomically(
        task.folder / task.slug / ROW,
        json.dumps(row, indent=1, ensure_ascii=False) + "\n",
    )
    return row


def _doubts(base: BaseModel) -> list[str]:
    """Why the file may have more base parameters than the robot that was meant."""
    found = [base.reading.doubt] if base.reading.doubt else []
    if any(
        symbol.value is None
        for name, symbol in base.mechanism.symbols.items()
        if name in base.matrix.symbols
    ):
        return found
    largest = float(np.max(np.abs(base.B_float()), initial=0.0))
    if largest < _BEYOND_MEANING:
        return found
    problem = f"Coefficients are as large as {largest:.0e}: the rounded numbers of the file keep parameters apart"
    return [
        *found,
        f"{problem} by almost nothing. The robot that was meant probably has fewer base parameters.",
    ]


def _in_explorer(task: ZooTask) -> str:
    """The address of the robot in the explorer, seen from the zoo's folder; empty if it is not there."""
    if not task.site or not stands_alone(task.found.path):
        return ""
    chosen = {"robot": task.found.slug + task.found.path.suffix} | (
        {"floating": "yes"} if task.floating else {}
    )
    return f"{task.site}explorer/index.html#{urlencode(chosen)}"


def _read(path: Path, **reading: Any) -> tuple[Mechanism, list[Any]]:
    """The robot, and the fault of couplings that cannot be read, without which it is read then."""
    try:
        return load(path, **reading), []
    except InputError as error:
        try:
            robot = load(path, **reading, independent_mimics=True)
        except EchelonError:
            raise error from None
        problem = error.problem.partition(" (--mimic")[0]
        reason = "all joints are taken as independent here, and couplings would leave fewer base parameters"
        return robot, [
            asdict(
                Fault(
                    one_line(error.element or "couplings"),
                    one_line(problem),
                    None,
                    reason,
                )
            )
        ]


def _moves(robot: Mechanism) -> bool:
    """Whether the base moves already: a body on the ground floats, or the file has it on a joint to the world."""
    if any(
        motion.kind is MotionKind.BALL
        for body in robot.bodies
        if body.parent < 0
        for motion in body.joint.motions
    ):
        return True
    _, tree = read_from(robot)
    hanging = (
        [link for link in tree.links if link.parent == 0]
        if tree is not None and tree.root_is_world
        else []
    )
    return len(hanging) == 1 and any(
        not isinstance(step, LiteralPlacement) for step in hanging[0].steps
    )


def _sources(base: BaseModel) -> tuple[dict[str, str], str]:
    """Source in C and Python, by file name; and why there is none."""
    try:
        return {
            name: text
            for target in ("c", "python")
            for name, text in generate(base, target, _FUNCTIONS).items()
        }, ""
    except EchelonError as error:
        return {}, one_line(str(error))


def _sensors(base: BaseModel) -> Context:
    """Ranks that single sensors reach, and the smallest set of sensors that suffices."""
    if len(base.parameters) > _MOST_SENSED:
        return {
            "problem": f"Sets of sensors were not tried for {len(base.parameters)} parameters: see echelon sensors."
        }
    try:
        report = sensor_report(base.mechanism)
    except EchelonError as error:
        return {"problem": one_line(str(error))}
    single = sorted(
        ((one_line(names[0]), rank) for names, rank in report.ranks.items()),
        key=lambda pair: -pair[1],
    )
    return {
        "problem": "",
        "rank": report.rank,
        "smallest": [one_line(name) for name in report.smallest],
        "proven": report.proven_smallest,
        "single": single,
    }


def _page(
    base: BaseModel, row: Row, sensors: Context, sources: dict[str, str], missing: str
) -> Context:
    drawn = len(base.parameters) <= _MOST_DRAWN
    return {
        "row": row,
        "title": f"{row['name']}, {'floating' if row['floating'] else 'fixed'} base",
        "headline": headline(base),
        "version": __version__,
        "columns": PARAMETERS,
        "table": _table(base),
        "links": seen_links(base),
        "structure": {"picture": matrix_picture(base), "mergings": mergings(base)}
        if drawn
        else None,
        "groups": _groups(base),
        "snaps": base.reading.snaps[:_SNAPS],
        "more_snaps": max(len(base.reading.snaps) - _SNAPS, 0),
        "decisive": [str(snap) for snap in base.reading.decisive],
        "sensors": sensors,
        "notes": [one_line(note) for note in base.reading.notes],
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
            "cells": [
                (mark, CLASSES[kind], kind.value) if kind else ("", "", "")
                for mark, kind in cells
            ],
        }
        for title, cells in classification_rows(base)
    ]


def _groups(base: BaseModel) -> list[Context]:
    """Closed forms by the body of their representatives, with their LaTeX."""
    mechanism, style = base.mechanism, LatexStyle()
    forms = zip(
        range(base.rank),
        base.matrix.pivots,
        base.expressions,
        ClosedForms(base).all(),
        strict=True,
    )
    found = []
    for body, some in groupby(forms, key=lambda form: mechanism.columns[form[1]].body):
        rows: list[Context] = [
            {
                "number": k + 1,
                "form": form,
                "latex": render(expression, style),
                "unit": expression.unit,
            }
            for k, _, expression, form in some
        ]
        title = (
            "effects"
            if body is None
            else one_line(
                f"{mechanism.bodies[body].label} {mechanism.carrier_name(body)}"
            )
        )
        found.append(
            {
                "title": title,
                "rows": rows,
                "latex": _aligned([row["latex"] for row in rows]),
            }
        )
    return found


def _aligned(rows: Sequence[str]) -> str:
    return (
        "\\begin{align*}\n"
        + " \\\\\n".join(f"& {row}" for row in rows)
        + "\n\\end{align*}"
    )
