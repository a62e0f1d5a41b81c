"""Pages of a built site in a browser: whether they can be read, reached and used, page by page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from support.devtools import DevTools
from support.explorer import serving

_AUDIT = Path(__file__).with_name("site_audit.js").read_text(encoding="utf-8")
NOTHING_MORE = "async () => ({})"
LIGHT, DARK, PHONE = (1400, 900, False), (1400, 900, True), (400, 800, False)
"""Screens: width and height, px, and whether their colours are dark."""


def audited(
    folder: Path,
    profile: Path,
    pages: list[str],
    screen: tuple[int, int, bool] = LIGHT,
    act: str = NOTHING_MORE,
) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """What is wrong with each page, with what a function of the test adds, and all paths that were asked for."""
    found = {}
    with serving(folder) as port, DevTools(profile, *screen) as browser:
        for page in pages:
            browser.open(f"http://127.0.0.1:{port}{page}")
            found[page] = audit(browser, act)
        assert browser.said == []
        own = f"http://127.0.0.1:{port}"
        return found, [
            url.removeprefix(own)
            for url in browser.urls
            if not url.startswith(("about:", "data:"))
        ]


def audit(browser: DevTools, act: str = NOTHING_MORE) -> dict[str, Any]:
    """What a reader of the page that is open would stumble over, and more of a test."""
    found: dict[str, Any] = browser.evaluate(_AUDIT.replace("ACT", act))
    return found


def complaints(found: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The pages with something that a reader would stumble over."""
    wrong = {}
    for path, page in found.items():
        bad = {
            key: page[key]
            for key in ("unlabelled", "nameless", "pictures", "faint", "unreachable")
            if page[key]
        }
        bad |= (
            {}
            if page["title"] and page["lang"] == "en" and page["headings"] == 1
            else {"head": page["title"]}
        )
        bad |= {} if page["wide"] <= page["room"] else {"wide": page["wide"]}
        if bad:
            wrong[path] = bad
    return wrong
