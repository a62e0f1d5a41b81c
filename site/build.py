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
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "site")]
os.environ["PYTHONPATH"] = str(ROOT / "src")

import build_explorer  # noqa: E402  needs the path above
import pictures  # noqa: E402

from echelon.zoo.build import build_zoo  # noqa: E402

FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
VALUE = re.compile(r"\{\{ (.+?) \}\}")
FORMULA = re.compile(r"(\$\$.+?\$\$|(?<![\\$\w])\$[^$\n]+?\$)", re.DOTALL)
GROUPS = {
    "sets": (
        "Base parameters",
        r"\.(base|claims|models|codegen|observe|results\.(saved|verify))\.",
    ),
    "robots": ("Robots and inertias", r"\.(formats|mechanism|inertia)\."),
    "identification": (
        "Identification",
        r"\.(identification|setup|report\.report|results\.(identified|servo))",
    ),
    "motions": ("Exciting trajectories", r"\.(excite|report\.preview)"),
    "errors": ("Errors", r"\.errors "),
}
"""Pages of the reference: title, and which lines of the list of public names belong there."""


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
    write_docs()
    configuration = str(ROOT / "site" / "mkdocs.yml")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "-f",
        configuration,
    ]
    subprocess.run(command, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})
    if ZOO.exists():
        shutil.copytree(ZOO, SITE / "zoo", ignore=shutil.ignore_patterns("row.json"))
    if not given.only_pages:
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


def write_docs() -> None:
    """All Markdown that MkDocs reads."""
    shutil.rmtree(DOCS, ignore_errors=True)
    shutil.copytree(ROOT / "docs", DOCS, ignore=shutil.ignore_patterns("examples"))
    for name in ("CONTRIBUTING", "CHANGELOG"):
        (DOCS / f"{name.lower()}.md").write_text(
            (ROOT / f"{name}.md").read_text(encoding="utf-8"), encoding="utf-8"
        )
    for page in DOCS.rglob("*.md"):
        page.write_text(
            _inside(page.read_text(encoding="utf-8"), page), encoding="utf-8"
        )
    shutil.copy(ROOT / "site" / "extra.css", DOCS)
    _write_reference()
    for page in sorted((ROOT / "site" / "pages").rglob("*.md")):
        target = DOCS / page.relative_to(ROOT / "site" / "pages")
        target.parent.mkdir(parents=True, exist_ok=True)
        print(f"running {page.relative_to(ROOT)}", flush=True)
        target.write_text(executed(page), encoding="utf-8")


def _inside(text: str, page: Path) -> str:
    """Links to files that are no pages become links to copies of these files, and those to folders plain text."""
    place = page.relative_to(DOCS).parent

    def link(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        source = (
            ROOT / "docs" / place
            if (ROOT / "docs" / page.relative_to(DOCS)).exists()
            else ROOT
        )
        file = (source / target).resolve()
        if not file.is_relative_to(ROOT) or not file.exists():
            return found[0]
        if file.is_dir():
            return words
        named = {
            "README.md": "index.md",
            "CONTRIBUTING.md": "contributing.md",
            "CHANGELOG.md": "changelog.md",
        }
        if file.is_relative_to(ROOT / "docs"):
            inside = DOCS / file.relative_to(ROOT / "docs")
        elif file.name in named and file.parent == ROOT:
            inside = DOCS / named[file.name]
        else:
            inside = (
                DOCS
                / "files"
                / f"{file.relative_to(ROOT).as_posix().replace('/', '-')}"
            )
            inside = inside.with_suffix(".txt") if file.suffix == ".md" else inside
            inside.parent.mkdir(exist_ok=True)
            shutil.copy(file, inside)
        return f"[{words}]({os.path.relpath(inside, page.parent)}{anchor})"

    return re.sub(r"\[([^\]]+)\]\(([^)#:\s]+)(#[^)]*)?\)", link, text)


def _write_reference() -> None:
    """A page for each group of public names, from the list that the package itself reads."""
    lines = (ROOT / "src/echelon/__init__.pyi").read_text(encoding="utf-8").splitlines()
    names = [
        line.split()[1::2][:2]
        for line in lines
        if line.startswith("from ") and "__version__" not in line
    ]
    (DOCS / "api").mkdir()
    for key, (title, pattern) in GROUPS.items():
        chosen = [
            f"::: {module}.{name}"
            for module, name in names
            if re.search(pattern, f"{module}. {module} ")
        ]
        head = f"# {title}\n\nAll names are those of `echelon`: `import echelon as ec`, then `ec.…`.\n\n"
        (DOCS / "api" / f"{key}.md").write_text(
            head + "\n\n".join(chosen) + "\n", encoding="utf-8"
        )


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
    return f'\n<figure tabindex="0"><img class="picture" src="{up}pictures/{file.name}" alt="{picture.alt}"></figure>\n\n'


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
