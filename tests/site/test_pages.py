"""The built site in a browser: every page can be read and reached, and nothing comes from elsewhere."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

from support.paths import ROOT
from support.site_audit import DARK, LIGHT, PHONE, audited, complaints

pytestmark = pytest.mark.slow
TALLEST = 8000  # px of a page: a telephone shows ten screens of it
CUT = """async () => ({
  tall: document.documentElement.scrollHeight,
  cut: [...document.querySelectorAll("article img")].filter((e) => e.getBoundingClientRect().right > innerWidth).length,
})"""
"""The height of a page, and how many of its pictures are wider than the screen."""


@pytest.fixture(scope="module")
def site() -> Path:
    """The site that ``make site`` left, or at least its pages."""
    folder = ROOT / "build" / "site"
    if not (folder / "index.html").exists():
        if importlib.util.find_spec("mkdocs") is None:
            (pytest.fail if os.environ.get("CI") else pytest.skip)(
                "the site is not built: make site"
            )
        subprocess.run(
            [sys.executable, ROOT / "site" / "build.py", "--only-pages"], check=True
        )
    return folder


def pages_of(site: Path) -> list[str]:
    parts = ("zoo", "explorer", "assets", "files", "404.html")
    return [
        f"/{page.relative_to(site).as_posix()}"
        for page in sorted(site.rglob("*.html"))
        if not _in(page, site, parts)
    ]


def _in(page: Path, site: Path, parts: tuple[str, ...]) -> bool:
    return page.relative_to(site).parts[0] in parts


@pytest.mark.parametrize("screen", [LIGHT, DARK, PHONE])
def test_pages_can_be_read(
    site: Path, tmp_path: Path, screen: tuple[int, int, bool]
) -> None:
    pages = pages_of(site)
    found, asked = audited(site, tmp_path / "profile", pages, screen, CUT)
    assert complaints(found) == {}
    assert len(pages) > 40
    tall = {path: page["tall"] for path, page in found.items()}
    assert {path: px for path, px in tall.items() if px > TALLEST} == {}
    assert [path for path, page in found.items() if page["cut"]] == []
    inside = {
        link.lstrip("/").partition("#")[0]
        for page in found.values()
        for link in page["links"]
    }
    assert [link for link in sorted(inside) if not (site / link).exists()] == []
    assert not [path for path in asked if "//" in path]


def test_nothing_comes_from_elsewhere(site: Path) -> None:
    """No page names a script, a style, a font or a picture of another host."""
    foreign = re.compile(
        r"""(?:src|srcset|poster)=["']?(?:https?:)?//|<link[^>]+href=["']?(?:https?:)?//|url\(["']?https?:"""
    )
    found = [
        page
        for page in site.rglob("*")
        if page.suffix in (".html", ".css") and "explorer" not in page.parts
    ]
    assert [
        page for page in found if foreign.search(page.read_text(encoding="utf-8"))
    ] == []


def test_the_zoo_leads_to_files_and_to_robots_of_the_explorer(site: Path) -> None:
    if not (site / "zoo").exists():
        pytest.skip("the site was built without the zoo")
    robots = json.loads(
        (site / "explorer/robots/robots.json").read_text(encoding="utf-8")
    )
    links = 0
    for page in (site / "zoo").rglob("*.html"):
        for found in re.findall(
            r'<a [^>]*?href="([^"#]+)(?:#robot=([^"&]+))?',
            page.read_text(encoding="utf-8"),
        ):
            assert (page.parent / unquote(found[0])).exists(), (page, found)
            assert not found[1] or unquote(found[1]) in robots, (page, found)
            links += bool(found[1])
    assert links
    assert [
        page
        for pages in robots.values()
        for page in pages
        if not (site / "zoo" / page / "index.html").exists()
    ] == []


def test_numbers_are_those_of_this_run(site: Path) -> None:
    """Values in braces are filled in, and known counts appear."""
    home = (site / "index.html").read_text(encoding="utf-8")
    assert "43 combinations of the 70 parameters" in " ".join(home.split())
    assert not [
        page
        for page in (site / "tutorials").glob("*.html")
        if "{{" in page.read_text(encoding="utf-8")
    ]
    table = (site / "theory.html").read_text(encoding="utf-8")
    known = re.findall(
        r"<td>(\w+)</td>\s*<td[^>]*>(\d+)</td>\s*<td[^>]*>(\d+)</td>", table
    )
    assert len(known) == 7
    assert [row for row in known if row[1] != row[2]] == []
