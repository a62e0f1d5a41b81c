"""Pages of a built site in a browser: whether they can be read, reached and used, page by page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from support.explorer import Explorer

_AUDIT = Path(__file__).with_name("site_audit.html")


def audited(
    folder: Path,
    profile: Path,
    pages: list[str],
    window: str = "1400,900",
    act: str = "async () => ({})",
    limit: int = 240,
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """What is wrong with each page, with what a function of the test adds, and all paths that were asked for."""
    site = Explorer(folder, pyodide=True)
    page = _AUDIT.read_text(encoding="utf-8").replace("PAGES", json.dumps(pages)).replace("ACT", act)
    found: dict[str, dict[str, Any]] = site.told(page, profile, window, limit)
    assert "failed" not in found, found
    return found, site.asked


def complaints(found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The pages with something that a reader would stumble over."""
    wrong = {}
    for path, page in found.items():
        bad = {key: page[key] for key in ("unlabelled", "nameless", "pictures", "faint", "unreachable") if page[key]}
        bad |= {} if page["title"] and page["lang"] == "en" and page["headings"] == 1 else {"head": page["title"]}
        bad |= {} if page["wide"] <= page["room"] else {"wide": page["wide"]}
        if bad:
            wrong[path] = bad
    return wrong
