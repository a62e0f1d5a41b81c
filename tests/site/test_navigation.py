"""The pages of the site before they are built: the navigation and the reference have all of them."""

from __future__ import annotations

import os
from pathlib import Path
from types import ModuleType

import pytest

import echelon as ec
from support.explorer import module
from support.paths import ROOT


def test_every_page_is_in_the_navigation() -> None:
    navigation = (ROOT / "site" / "mkdocs.yml").read_text(encoding="utf-8")
    sources = (ROOT / "docs", ROOT / "site" / "pages")
    pages = [
        page.relative_to(source).as_posix()
        for source in sources
        for page in source.rglob("*.md")
    ]
    assert [page for page in pages if page not in navigation] == []


@pytest.fixture
def build(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module that builds the site; it names its own source for the commands of its pages."""
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    return module("site_build", "build.py")


def test_every_public_name_is_in_the_reference(build: ModuleType) -> None:
    names = {name: getattr(ec, name) for name in ec.__all__ if name != "__version__"}
    lacking = [
        name
        for name, value in names.items()
        if not build.page_of(f"{value.__module__}.{name}")
    ]
    assert lacking == []


def test_long_pages_become_parts_and_links_follow(
    build: ModuleType, tmp_path: Path
) -> None:
    pytest.importorskip("pymdownx")
    prose = "Words of a long section.\n" * (build.PART // 40)
    code = "```sh\n## no heading\n```\n"
    sections = [f"## Part `{letter}`\n{code}{prose}" for letter in "abc"]
    (tmp_path / "long.md").write_text(
        "# Long\n\nSee [c](#part-c).\n\n" + "".join(sections)
    )
    (tmp_path / "short.md").write_text(
        "# Short\n\n[b](long.md#part-b), [c](long.md#part-c)\n"
    )
    parts = build.split_pages(tmp_path)
    assert parts == {"long.md": ["long.md", "long-2.md", "long-3.md"]}
    first, second, third = ((tmp_path / name).read_text() for name in parts["long.md"])
    assert (first + second + third).count("Words") == 3 * (build.PART // 40)
    assert third.startswith("# Part `c`\n```sh\n## no heading")
    assert "[c](long-3.md#part-c)" in first
    linked = "[b](long-2.md#part-b), [c](long-3.md#part-c)"
    assert linked in (tmp_path / "short.md").read_text()
