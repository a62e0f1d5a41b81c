"""What MkDocs does not know of this project: pages in parts, Sphinx's roles in docstrings, scrolling by keyboard."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

_ROLE = re.compile(
    r":(?:attr|class|func|meth|mod|data|exc):<code>~?(.*?)</code>", re.DOTALL
)


def on_page_content(html: str, **_: Any) -> str:
    """Roles become plain code, and what may be wider than the page can be reached by the keyboard."""
    html = _ROLE.sub(r"<code>\1</code>", html)
    return html.replace("<pre>", '<pre tabindex="0">')


def on_config(config: Any) -> Any:
    """Where the navigation names a page that was cut into parts, it gets all of them."""
    file = Path(config["docs_dir"]).parent / "sections.json"
    config["nav"] = _whole(config["nav"], json.loads(file.read_text(encoding="utf-8")))
    return config


def _whole(nav: Any, parts: dict[str, list[str]]) -> Any:
    if isinstance(nav, dict):
        return {title: _whole(below, parts) for title, below in nav.items()}
    if isinstance(nav, str):
        return parts.get(nav, nav)
    found = []
    for item in nav:
        below = _whole(item, parts)
        found += below if isinstance(below, list) else [below]
    return found
