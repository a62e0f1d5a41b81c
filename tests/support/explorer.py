"""The explorer in a browser: its built page from a local server, and visits that act as a visitor does.

Unless a test asks for Pyodide, the page's worker is replaced by one that sends its messages to this process, where the
same Python answers.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from types import ModuleType
from typing import Any

from support.devtools import DevTools

SITE = Path(__file__).parents[2] / "site"
_DOUBLE = """
self.postMessage({ ready: 1 });
self.onmessage = async ({ data: { id, request } }) => {
  const answer = await fetch("/answer", { method: "POST", body: JSON.stringify(request) });
  self.postMessage({ id, reply: await answer.json() });
};
"""
_ANSWERED = """(async () => {
  const at = (selector) => document.querySelector(selector);
  const busy = () => Number(at("#answer").dataset.answered ?? 0) <= BEFORE || at("#answer").hasAttribute("aria-busy");
  for (let k = 0; k < LIMIT * 40 && busy(); k++) await new Promise((done) => setTimeout(done, 25));
  await new Promise((done) => setTimeout(done, 30));
  return !busy();
})()"""
_COUNT = "Number(document.querySelector('#answer').dataset.answered ?? 0)"
_STATE = """(() => {
  const at = (selector) => document.querySelector(selector);
  const all = (selector) => [...document.querySelectorAll(selector)];
  return {
    headline: at("#headline").textContent, counts: at("#counts").hidden ? "" : at("#counts").textContent, error: at("#error").hidden ? "" : at("#error").textContent,
    forms: all("#forms li").sort((a, b) => a.value - b.value).map((item) => item.dataset.text),
    differences: all("#differences li").map((item) => item.textContent),
    facts: all("#facts dd").map((item) => item.textContent),
    classes: all("#table td button").map((b) => b.getAttribute("aria-label").split(";")[0]),
    status: at("#status").textContent, hash: location.hash,
    page: at("#page").hidden ? "" : at("#page a").getAttribute("href"),
    words: all("#words:not([hidden]) li").map((item) => item.firstChild.textContent),
    editor: at("#editor").value,
    strange: all("img, iframe, script:not([src])").length,
    picture: at("#canvas").hidden ? "none" : at("#canvas").width > 0 ? "drawn" : "empty",
  };
})()"""


def module(name: str, path: str) -> ModuleType:
    """A module of the site, which is no package."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, SITE / path)
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@cache
def answers() -> ModuleType:
    """The module that answers the page."""
    return module("explorer", "explorer/explorer.py")


Step = tuple[Any, ...]
"""What a visitor does: a method of :class:`DevTools` with its arguments; "silently" first where no answer follows."""


@dataclass
class Explorer:
    """The explorer's page in a browser."""

    browser: DevTools
    port: int
    limit: float = 90.0  # s, for an answer

    def visit(self, *steps: Step, address: str = "") -> list[Any]:
        """States of the page at first and after every step; the console stays silent, and no request goes elsewhere."""
        self.browser.open(f"http://127.0.0.1:{self.port}/explorer/index.html{address}")
        found = [self.answered(), *(self.act(*step) for step in steps)]
        self.check()
        return found

    def act(self, *step: Any) -> Any:
        """State of the page after a step."""
        silently, before = step[0] == "silently", self.browser.evaluate(_COUNT)
        act, *given = step[silently:]
        getattr(self.browser, act)(*given)
        return self.browser.evaluate(_STATE) if silently else self.answered(before)

    def answered(self, before: int = 0) -> Any:
        """State of the page when its answer has come."""
        assert self.browser.evaluate(_ANSWERED, BEFORE=before, LIMIT=self.limit), (
            "no answer"
        )
        return self.browser.evaluate(_STATE)

    def check(self) -> None:
        """Nothing was said, and nothing was asked of others."""
        assert self.browser.said == []
        own = (f"http://127.0.0.1:{self.port}/", "data:", "blob:", "about:")
        assert [url for url in self.browser.urls if not url.startswith(own)] == []


@contextmanager
def serving(folder: Path, *, pyodide: bool = True) -> Iterator[int]:
    """The port of a server of a folder; without Pyodide this process answers the explorer."""
    server = ThreadingHTTPServer(
        ("127.0.0.1", 0), partial(_Handler, pyodide, directory=str(folder))
    )
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        server.server_close()


class _Handler(SimpleHTTPRequestHandler):
    extensions_map = SimpleHTTPRequestHandler.extensions_map | {
        ".mjs": "text/javascript",
        ".wasm": "application/wasm",
    }

    def __init__(self, pyodide: bool, *given: Any, **options: Any) -> None:
        self.pyodide = pyodide
        super().__init__(*given, **options)

    def do_GET(self) -> None:
        if self.path == "/explorer/worker.mjs" and not self.pyodide:
            self._send(_DOUBLE, "text/javascript")
        elif self.path == "/favicon.ico":
            self.send_response(204)
            self.end_headers()
        else:
            super().do_GET()

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        self._send(answers().answer(body), "application/json")

    def _send(self, text: str, kind: str) -> None:
        data = text.encode()
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        pass
