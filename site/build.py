"""Build the site: pages whose code is run, the reference, the zoo, and the explorer.

    python site/build.py [--only-pages] [--zoo 'ur*'] [--jobs 2]

Pages in ``site/pages`` are Markdown.  Their ``python``, ``console`` and ``hidden`` blocks are run, in one namespace and
one folder per page, and what they print follows them.  ``{{ expression }}`` stands for a value of the page's namespace,
so that no number is typed by hand.  A block that fails ends the build.  Formulas become MathML, which needs no script.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
BUILD = ROOT / "build"
DOCS, SITE, ZOO = BUILD / "docs", BUILD / "site", BUILD / "zoo"
SECTIONS = BUILD / "sections.json"  # pages of the navigation that are several
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "site")]
os.environ["PYTHONPATH"] = str(ROOT / "src")

import build_explorer  # noqa: E402  needs the path above
import pictures  # noqa: E402
from robot_zoo.build import build_zoo  # noqa: E402

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
VALUE = re.compile(r"\{\{ (.+?) \}\}")
FORMULA = re.compile(r"(\$\$.+?\$\$|(?<![\\$\w])\$[^$\n]+?\$)", re.DOTALL)
ELSEWHERE = re.compile(
    r'<a [^>]*href="(?:\.\./)*(?:zoo|explorer)/[^>]*>(.*?)</a>', re.DOTALL
)
"""Links to the parts that ``--only-pages`` leaves out."""
WITHOUT_ZOO = "# Robots\n\nThis copy of the site has no zoo: `make site` builds it.\n"
WHOLE, PART = 11_000, 8_500
"""Characters of Markdown: a page that is longer than the first is cut into parts of at most the second.  On a telephone
11,000 characters of prose, or 8,500 of lists of options, fill about 8,000 px."""
REFERENCE = {
    "base-model": ("BaseModel", r"BaseModel$"),
    "sets": ("Base parameters", r"base\.(derive|expression|match|matrix)"),
    "structure": ("Structure and rank", r"base\.(structure|special|motion_ranks)"),
    "audit": ("Audits and numeric ranks", r"base\.(claims|numeric_comparison)"),
    "sensors": ("Sensors", r"base\.sensors"),
    "rows": ("Row spaces", r"base\.row_space"),
    "linear": ("Base parameters of linear models", r"base\.(linear_base|symbolic)"),
    "files": ("Saved sets and source code", r"(base|codegen)\."),
    "observations": ("Observations", r"compute\."),
    "mechanism": ("Mechanism", r"Mechanism$"),
    "load": ("Loading robots and linear models", r"(formats|dynamics)\."),
    "robots": ("Experiments, drives and inertias", r"robot\."),
    "setups": ("Set-ups and estimates", r"identification\.(setup|estimators)"),
    "loads": ("Payloads, gains and servos", r"identification\.(gains|payload|servos)"),
    "online": ("Estimation while the robot moves", r"identification\.online"),
    "models": ("Identified models", r"identification\.(saved|predict|result)"),
    "identify": ("Identification", r"identification\."),
    "trajectories": ("Trajectories and their files", r"excite\.(files|problem)"),
    "excite": ("Exciting trajectories", r"excite\."),
    "poses": ("What calibration can see", r"calibration\.poses|calibration_base$"),
    "calibrate": ("Calibration", r"calibration\."),
    "compare": ("Two robots compared", r"comparison\."),
    "reports": ("Reports", r"report\."),
    "errors": ("Errors", r"shared\.errors"),
}
"""Pages of the reference: title, and which public names stand there; a name goes to the first page that matches."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Build the site into build/site.")
    parser.add_argument(
        "--only-pages", action="store_true", help="neither zoo nor explorer"
    )
    parser.add_argument("--zoo", default="*", help="which robots")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument(
        "--wheels", type=Path, help="a folder with NumPy for the explorer"
    )
    given = parser.parse_args()
    if not given.only_pages:
        rows = build_zoo(
            ZOO, only=given.zoo, jobs=given.jobs, progress=told, site="../"
        )
        failed = [str(row["failed"]) for row in rows if "failed" in row]
        print(
            f"zoo: {len(rows) - len(failed)} of {len(rows)} readings of robots have an answer"
        )
        if lacking := next(
            (reason for reason in failed if "pip install" in reason), ""
        ):
            sys.exit(f"the environment of the site is not whole: {lacking}")
    write_docs(whole=not given.only_pages)
    configuration = str(ROOT / "site" / "mkdocs.yml")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "-f",
        configuration,
    ]
    subprocess.run(command, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    if not given.only_pages:
        shutil.copytree(ZOO, SITE / "zoo", ignore=shutil.ignore_patterns("row.json"))
        missing = build_explorer.build(
            SITE / "explorer", [ROOT / "examples"], BUILD / "cache", given.wheels
        )
        if missing and os.environ.get("CI"):
            sys.exit(f"the explorer lacks {', '.join(missing)}")
        print(
            f"the explorer lacks {', '.join(missing)} and cannot answer: --wheels DIR"
            if missing
            else "explorer: whole"
        )
    print(f"built {SITE}")


def told(done: int, total: int, row: dict[str, Any] | None) -> None:
    """Say which robot of the zoo is done."""
    print(
        f"zoo: {done} of {total}{'' if row is None else ', ' + row['slug'] + ' failed' * ('failed' in row)}",
        flush=True,
    )


# -- sources of pages --------------------------------------------------------------------------------------------------


def write_docs(*, whole: bool) -> None:
    """All Markdown that MkDocs reads; what is not whole has neither zoo nor explorer, nor links to them."""
    shutil.rmtree(DOCS, ignore_errors=True)
    shutil.copytree(ROOT / "docs", DOCS, ignore=shutil.ignore_patterns("examples"))
    for name in ("CONTRIBUTING", "CHANGELOG"):
        shutil.copy(ROOT / f"{name}.md", DOCS / f"{name.lower()}.md")
    for page in DOCS.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(_inside(text, page), encoding="utf-8")
    shutil.copy(ROOT / "site" / "extra.css", DOCS)
    sections = _write_reference()
    for page in sorted((ROOT / "site" / "pages").rglob("*.md")):
        target = DOCS / page.relative_to(ROOT / "site" / "pages")
        target.parent.mkdir(parents=True, exist_ok=True)
        print(f"running {page.relative_to(ROOT)}", flush=True)
        if whole:
            text = executed(page)
        elif page.name == "robots.md":
            text = WITHOUT_ZOO
        else:
            text = ELSEWHERE.sub(r"\1", executed(page))
        target.write_text(text, encoding="utf-8")
    sections |= split_pages(DOCS)
    SECTIONS.write_text(json.dumps(sections), encoding="utf-8")


def _inside(text: str, page: Path) -> str:
    """Links to files that are no pages become links to copies of these files, and those to folders plain text."""
    of_docs = (ROOT / "docs" / page.relative_to(DOCS)).exists()
    source = (ROOT / "docs" / page.relative_to(DOCS)).parent if of_docs else ROOT

    def link(found: re.Match[str]) -> str:
        words, target, anchor = found["words"], found["target"], found["anchor"] or ""
        file = (source / target).resolve()
        if not file.is_relative_to(ROOT) or not file.exists():
            return found[0]
        if file.is_dir():
            return words
        place = os.path.relpath(_copied(file), page.parent)
        return f"[{words}]{found['opening']}{place}{anchor}{found['closing']}"

    target = r"(?P<target>[^)#:\s]+)(?P<anchor>#[^)\s]*)?"
    inline = rf"\[(?P<words>[^\]]+)\](?P<opening>\(){target}(?P<closing>\))"
    listed = rf"^\[(?P<words>[^\]]+)\](?P<opening>: ){target}(?P<closing>)$"
    return re.sub(listed, link, re.sub(inline, link, text), flags=re.MULTILINE)


def _copied(file: Path) -> Path:
    """The page that a file of the repository becomes, or its copy beside the pages."""
    pages = {
        "README.md": "index.md",
        "CONTRIBUTING.md": "contributing.md",
        "CHANGELOG.md": "changelog.md",
    }
    inside = file.relative_to(ROOT).as_posix()
    of_docs = DOCS / inside.removeprefix("docs/")
    if inside in pages:
        return DOCS / pages[inside]
    if inside.startswith("docs/") and of_docs.exists():
        return of_docs
    copy = DOCS / "files" / inside.replace("/", "-")
    copy = copy.with_suffix(".txt") if file.suffix == ".md" else copy
    copy.parent.mkdir(exist_ok=True)
    shutil.copy(file, copy)
    return copy


# -- pages that are not too long ---------------------------------------------------------------------------------------


def _write_reference() -> dict[str, Any]:
    """Pages of the reference, from the list of public names that the package itself reads."""
    stub = (ROOT / "src/echelon/__init__.pyi").read_text(encoding="utf-8")
    imports = [
        node for node in ast.parse(stub).body if isinstance(node, ast.ImportFrom)
    ]
    pages: dict[str, list[str]] = {key: [] for key in REFERENCE}
    for place, name in [(node.module, node.names[0].name) for node in imports]:
        if name == "__version__":
            continue
        full = f"{place}.{name}"
        chosen = page_of(full)
        if chosen is None:
            sys.exit(f"REFERENCE in site/build.py has no page for {full}")
        pages[chosen].append(f"::: {full}\n")
    (DOCS / "api").mkdir()
    for key, names in pages.items():
        head = f"# {REFERENCE[key][0]}\n\nNames of `echelon`: `import echelon as ec`, then `ec.…`.\n\n"
        (DOCS / "api" / f"{key}.md").write_text(
            head + "\n".join(names), encoding="utf-8"
        )
    return {"api": [f"api/{key}.md" for key in pages]}


def page_of(name: str) -> str | None:
    """The page of the reference for a public name with its module; None if there is none."""
    places = REFERENCE.items()
    return next(
        (key for key, (_, what) in places if re.search(rf"\.(?:{what})", name)), None
    )


def split_pages(folder: Path) -> dict[str, Any]:
    """Cut long pages at their sections; links follow what they lead to.  Returns the parts of each page."""
    moved: dict[tuple[Path, str], Path] = {}
    parts = {}
    for page in sorted(folder.rglob("*.md")):
        pieces = _pieces(page.read_text(encoding="utf-8"))
        if len(pieces) == 1:
            continue
        names = [page]
        for number, piece in enumerate(pieces[1:], 2):
            names.append(page.with_name(f"{page.stem}-{number}.md"))
            headings = _headings(piece)
            moved |= {(page, _anchor(heading)): names[-1] for heading in headings}
        for name, piece in zip(names, pieces, strict=True):
            name.write_text(piece, encoding="utf-8")
        parts[page.relative_to(folder).as_posix()] = [
            name.relative_to(folder).as_posix() for name in names
        ]
    of_part = {
        folder / part: folder / page for page, some in parts.items() for part in some
    }
    for page in folder.rglob("*.md"):
        text = page.read_text(encoding="utf-8")
        page.write_text(_followed(text, page, of_part, moved), encoding="utf-8")
    return parts


def _pieces(text: str) -> list[str]:
    """A page, or its parts where it is too long; all parts but the first get a title."""
    if len(re.sub(r"<[^>]+>", "", text)) <= WHOLE:
        return [text]
    cuts = [
        0,
        *(found.start() for found in re.finditer(r"^## ", _plain(text), re.MULTILINE)),
    ]
    sections = [text[a:b] for a, b in itertools.pairwise([*cuts, len(text)])]
    pieces = [""]
    for section in sections:
        if pieces[-1] and len(pieces[-1]) + len(section) > PART:
            pieces.append("")
        pieces[-1] += section
    return [pieces[0], *map(_titled, pieces[1:])]


def _plain(text: str) -> str:
    """The text with its blocks of code blanked, where lines with # are no headings."""
    return re.sub(
        r"^```.*?^```$", lambda b: re.sub(r"[^\n]", " ", b[0]), text, flags=re.M | re.S
    )


def _headings(text: str) -> list[str]:
    return re.findall(r"^#+ (.*)$", _plain(text), re.MULTILINE)


def _titled(piece: str) -> str:
    """A part with the heading of its only section as its title, or with the first and the last of them."""
    sections = re.findall(r"^## (.*)$", _plain(piece), re.MULTILINE)
    if len(sections) == 1:
        return piece.removeprefix("#")
    first, last = (re.sub(r"`(\w+ \w+)[^`]*`", r"\1", sections[k]) for k in (0, -1))
    return f"# {first} … {last}\n\n{piece}"


def _anchor(heading: str) -> str:
    from pymdownx import slugs

    slug: str = slugs.slugify(case="lower")(heading.replace("`", ""), "-")
    return slug


def _followed(
    text: str,
    page: Path,
    of_part: dict[Path, Path],
    moved: dict[tuple[Path, str], Path],
) -> str:
    """The text of a page with links to headings where these are now."""

    def link(found: re.Match[str]) -> str:
        target = (
            (page.parent / found[1]).resolve() if found[1] else of_part.get(page, page)
        )
        now = moved.get((target, found[2]), target)
        if target not in of_part.values():
            return found[0]
        place = "" if now == page else os.path.relpath(now, page.parent)
        return f"]({place}#{found[2]})"

    return re.sub(r"\]\(([^)#:\s]*)#([^)\s]+)\)", link, text)


# -- pages whose code is run -------------------------------------------------------------------------------------------


def executed(page: Path) -> str:
    """The text of a page with what its blocks print, its values, and its formulas."""
    names: dict[str, Any] = {"ROOT": ROOT, "pictures": pictures, "zoo_rows": zoo_rows}
    with tempfile.TemporaryDirectory() as place, chdir(place):
        (Path(place) / "examples").symlink_to(ROOT / "examples")
        parts, end = [], 0
        text = page.read_text(encoding="utf-8")
        for fence in FENCE.finditer(text):
            parts.append(_prose(text[end : fence.start()], names))
            parts.append(_block(fence[1], fence[2], names, page))
            end = fence.end()
        return "".join([*parts, _prose(text[end:], names)])


def _prose(text: str, names: dict[str, Any]) -> str:
    from latex2mathml.converter import convert

    def formula(found: re.Match[str]) -> str:
        display = "block" if found[0].startswith("$$") else "inline"
        text = str(convert(found[0].strip("$"), display=display))
        return (
            text if display == "block" else f"<span>{text}</span>"
        )  # Markdown takes <math> for a block

    text = FORMULA.sub(formula, text)
    return VALUE.sub(lambda found: str(eval(found[1], names)), text)


def _block(language: str, body: str, names: dict[str, Any], page: Path) -> str:
    if language == "hidden":
        return _shown(_python(body, names, page), page)
    block = f"```{language}\n{body}```\n"
    if language == "python":
        return block + _shown(_python(body, names, page), page)
    return _console(body) if language == "console" else block


def _python(body: str, names: dict[str, Any], page: Path) -> tuple[str, Any]:
    """What a block prints, and the value of its last expression."""
    tree, value = ast.parse(body), None
    last = (
        tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    )
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, str(page), "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), str(page), "eval"), names)
    return printed.getvalue(), value


def _figure(picture: pictures.Picture, page: Path) -> str:
    """The picture as a file beside the pages; HTML, because its path is not one of Markdown."""
    folder = DOCS / "pictures"
    folder.mkdir(exist_ok=True)
    file = folder / f"{hashlib.sha256(picture.svg.encode()).hexdigest()[:16]}.svg"
    file.write_text(picture.svg, encoding="utf-8")
    up = "../" * (len(page.relative_to(ROOT / "site" / "pages").parts) - 1)
    place = f"{up}pictures/{file.name}"
    image = f'<img class="picture" src="{place}" alt="{picture.alt}">'
    return f'\n<figure><a href="{place}">{image}</a></figure>\n\n'


def _shown(result: tuple[str, Any], page: Path) -> str:
    printed, value = result
    if isinstance(value, pictures.Picture):
        return _figure(value, page)
    if isinstance(value, pictures.Text):
        return f"{value}\n"
    text = printed + ("" if value is None else f"{value!r}\n")
    return (
        f"\n``` {{ .text .output }}\n{text.rstrip()}\n```\n\n" if text.strip() else "\n"
    )


def _console(body: str) -> str:
    """Commands, each with what it prints; lines after a command say how much of that is shown: ``... 20``."""
    shown = []
    own = f'{sys.executable} -c "from echelon.cli import main; main()" '
    for command, rest in re.findall(
        r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", body, re.MULTILINE
    ):
        runs = re.sub(r"\bechelon (?=[a-z])", own.replace("\\", "/"), command)
        done = subprocess.run(runs, shell=True, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{command}\n{done.stderr}")
        lines, most = (
            done.stdout.splitlines(),
            int(rest.strip().removeprefix("...") or 0),
        )
        lines = [*lines[:most], "..."] if most and len(lines) > most else lines
        shown.append("\n".join([f"$ {command}", *lines]))
    return "```console\n" + "\n".join(shown) + "\n```\n"


def zoo_rows() -> list[dict[str, Any]]:
    """Rows of the zoo that were built; none before it was."""
    file = ZOO / "zoo.json"
    found = (
        json.loads(file.read_text(encoding="utf-8"))["robots"] if file.exists() else []
    )
    return [row for row in found if "failed" not in row]


if __name__ == "__main__":
    main()
