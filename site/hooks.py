"""What MkDocs does not know of this project: roles of Sphinx in docstrings, and scrolling blocks by keyboard."""

from __future__ import annotations

import re
from typing import Any

_ROLE = re.compile(
    r":(?:attr|class|func|meth|mod|data|exc):<code>~?(.*?)</code>", re.DOTALL
)


def on_page_content(html: str, **_: Any) -> str:
    """Roles become plain code, and what may be wider than the page can be reached by the keyboard."""
    html = _ROLE.sub(r"<code>\1</code>", html)
    return html.replace("<pre>", '<pre tabindex="0">')
