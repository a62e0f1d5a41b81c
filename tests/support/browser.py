"""Pages in a browser: what they become after their scripts have run, and what the console says."""

from __future__ import annotations

import json
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from support.report_data import Page
from support.system_tools import CHROMIUM, tool

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--hide-scrollbars", "--enable-logging=stderr", "--v=0",
    "--virtual-time-budget=15000",
)  # fmt: skip
GUARD = "window.alert = () => console.error('an alert');"


@dataclass(frozen=True)
class Browser:
    """Chromium without a window; every page first runs the guard and, if there is one, a script of the test."""

    script: str = ""

    def browse(self, folder: Path, html: str, *flags: str) -> tuple[str, list[str]]:
        """The document after its scripts have run, and what the console says."""
        file = folder / "page.html"
        file.write_text(
            html.replace("<head>", f"<head><script>{GUARD}{self.script}</script>", 1),
            encoding="utf-8",
        )
        command = [
            tool(*CHROMIUM),
            *FLAGS,
            f"--user-data-dir={folder / 'profile'}",
            *flags,
            file.as_uri(),
        ]
        done = subprocess.run(command, capture_output=True, timeout=120, check=True)
        said = [
            line
            for line in done.stderr.decode(errors="replace").splitlines()
            if "CONSOLE" in line
        ]
        return done.stdout.decode(), said

    def drawn(self, folder: Path, html: str, window: str) -> int:
        """How many plots a page has that says nothing; a busy browser may dump it before it has drawn."""
        count = 0
        for _ in range(3):
            dom, said = self.browse(
                folder, html, f"--window-size={window}", "--dump-dom"
            )
            assert said == []
            if count := plots(dom):
                break
        return count

    def drive(
        self, folder: Path, html: str, driver: str, window: str
    ) -> dict[str, Any]:
        """What a driver at the page's end found out and left there as JSON, in ``<output id="result">``.

        A busy browser may dump the page before it is driven.
        """
        html = html.replace("</body>", driver + "</body>")
        found = None
        for _ in range(3):
            dom, said = self.browse(
                folder, html, f"--window-size={window}", "--dump-dom"
            )
            assert said == []
            if found := re.search(
                r'<output id="result">(.*?)</output>', dom, re.DOTALL
            ):
                break
        assert found
        return json.loads(
            found[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
        )

    def picture(self, folder: Path, html: str, window: str) -> npt.NDArray[np.float64]:
        """The page in grey, shape (height, width)."""
        from PIL import Image

        shot = folder / "shot.png"
        self.browse(folder, html, f"--window-size={window}", f"--screenshot={shot}")
        return np.asarray(Image.open(shot).convert("L"), dtype=float)

    def printed(self, folder: Path, html: str) -> bytes:
        """The page as a PDF."""
        paper = folder / "page.pdf"
        _, said = self.browse(
            folder, html, f"--print-to-pdf={paper}", "--window-size=1280,800"
        )
        assert said == []
        return paper.read_bytes()


def plots(dom: str) -> int:
    """How many plots are there, after checking that nothing from a file became an element."""
    page = Page(dom)
    assert not [tag for tag, _ in page.elements if tag in ("img", "iframe")]
    assert not [
        name
        for _, attributes in page.elements
        for name in attributes
        if name.startswith("on")
    ]
    assert len(page.scripts) == 4  # with the guard
    for _, attributes in page.elements:
        assert not re.match(
            "https?:", attributes.get("href") or attributes.get("src") or ""
        )
    return sum(
        "js-plotly-plot" in (attributes.get("class") or "")
        for _, attributes in page.elements
    )


def check_buttons(titles: list[str | None]) -> None:
    """There are buttons, and none of them talks to a server."""
    assert titles
    assert not [
        title
        for title in titles
        if re.search("share|cloud|edit", title or "", re.IGNORECASE)
    ]
