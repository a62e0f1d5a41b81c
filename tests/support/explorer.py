"""The explorer in a browser: its built page from a local server, and visits that act as a visitor does.

Unless a test asks for Pyodide, the page's worker is replaced by one that sends its messages to this process, where the
same Python answers.  A visit runs in a frame, so that the page keeps its own content security policy.
"""

from __future__ import annotations

import importlib.util
import json
import queue
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from types import ModuleType
from typing import Any

from support.system_tools import CHROMIUM, tool

SITE = Path(__file__).parents[2] / "site"
FLAGS = (
    "--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--hide-scrollbars", "--enable-logging=stderr", "--v=0", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)  # fmt: skip
_DOUBLE = """
self.postMessage({ ready: 1 });
self.onmessage = async ({ data: { id, request } }) => {
  const answer = await fetch("/answer", { method: "POST", body: JSON.stringify(request) });
  self.postMessage({ id, reply: await answer.json() });
};
"""
_VISIT = """<!doctype html><title>visit</title><iframe style="border:0;width:100vw;height:100vh"></iframe><script>
const steps = STEPS, frame = document.querySelector("iframe"), found = [];
const page = () => frame.contentDocument;
const at = (selector) => page().querySelector(selector);
const rest = () => new Promise((resolve) => setTimeout(resolve, 30));
const answered = () => Number(at("#answer")?.dataset.answered ?? 0);
async function until(condition) {
  for (let k = 0; k < 4000 && !condition(); k++) await rest();
}
const acts = {
  click: (element) => element.click(),
  check: (element) => element.click(),
  choose: (element, value) => { element.value = value; element.dispatchEvent(new Event("change", { bubbles: true })); },
  type: (element, value) => {
    element.focus();
    element.value = value;
    element.dispatchEvent(new InputEvent("input", { bubbles: true }));
  },
  press: (element, value) => {
    element.focus();
    element.dispatchEvent(new KeyboardEvent("keydown", { ...value, bubbles: true, cancelable: true }));
  },
};
const state = () => ({
  headline: at("#headline").textContent, error: at("#error").hidden ? "" : at("#error").textContent,
  forms: [...page().querySelectorAll("#forms li")].sort((a, b) => a.value - b.value).map((item) => item.dataset.text),
  differences: [...page().querySelectorAll("#differences li")].map((item) => item.textContent),
  facts: [...page().querySelectorAll("#facts dd")].map((item) => item.textContent),
  classes: [...page().querySelectorAll("#table td button")].map((b) => b.getAttribute("aria-label").split(";")[0]),
  status: at("#status").textContent, hash: frame.contentWindow.location.hash,
  words: [...page().querySelectorAll("#words:not([hidden]) li")].map((item) => item.firstChild.textContent),
  editor: at("#editor").value, wide: page().documentElement.scrollWidth, room: frame.contentWindow.innerWidth,
  strange: page().querySelectorAll("img, iframe, script:not([src])").length,
  unlabelled: [...page().querySelectorAll("input, select, textarea")].filter((e) => !e.labels.length).length,
  nameless: [...page().querySelectorAll("button")].filter((b) => !b.textContent.trim()).length,
  picture: at("#canvas").hidden ? "none" : at("#canvas").width > 0 ? "drawn" : "empty",
});
async function visit() {
  frame.src = "/explorer/index.html" + HASH;
  await until(() => page()?.readyState === "complete" && at("#answer") && answered() > 0);
  found.push(state());
  for (const [act, selector, value, silent] of steps) {
    const before = answered();
    acts[act](at(selector), value);
    if (silent) await rest();
    else await until(() => answered() > before && !at("#answer").hasAttribute("aria-busy"));
    await rest();
    found.push(state());
  }
}
visit().catch((error) => found.push({ failed: String(error) })).finally(async () => {
  await fetch("/found", { method: "POST", body: JSON.stringify(found) });
});
</script>"""


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
    """What answers the page."""
    return module("explorer", "explorer/explorer.py")


Step = tuple[Any, ...]
"""What a visitor does: an act, a selector, a value, and whether no answer follows."""


@dataclass
class Explorer:
    """The built page behind a server."""

    folder: Path  # with the folder ``explorer``
    pyodide: bool = False  # whether the page's own worker answers
    asked: list[str] = field(default_factory=list)  # paths that were asked for
    page: str = ""
    found: queue.Queue[Any] = field(default_factory=queue.Queue)

    def visit(self, profile: Path, *steps: Step, address: str = "", window: str = "1400,900", limit: int = 90) -> Any:
        """What the page says at first and after every step; the console must stay silent."""
        said = json.dumps(steps).replace("<", "\\u003c")  # the page has it in a script
        return self.told(_VISIT.replace("STEPS", said).replace("HASH", json.dumps(address)), profile, window, limit)

    def told(self, page: str, profile: Path, window: str = "1400,900", limit: int = 90) -> Any:
        """What a page of a test sends to ``/found``; the console must stay silent."""
        self.page = page
        with self._serving() as port:
            command = [tool(*CHROMIUM), *FLAGS, f"--user-data-dir={profile}", f"--window-size={window}"]
            command += ["--remote-debugging-port=0", f"http://127.0.0.1:{port}/visit.html"]
            browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            lines: list[str] = []
            assert browser.stderr
            reader = Thread(target=lines.extend, args=(browser.stderr,), daemon=True)
            reader.start()
            try:
                found = self.found.get(timeout=limit)
            finally:
                browser.terminate()
                browser.wait()
                reader.join(5)
                browser.stderr.close()
        assert [line for line in lines if "CONSOLE" in line and "GL Driver Message" not in line] == []
        assert not [state for state in found if "failed" in state], found
        return found

    @contextmanager
    def _serving(self) -> Iterator[int]:
        server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, self, directory=str(self.folder)))
        Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            server.server_close()


class _Handler(SimpleHTTPRequestHandler):
    extensions_map = SimpleHTTPRequestHandler.extensions_map | {".mjs": "text/javascript", ".wasm": "application/wasm"}

    def __init__(self, explorer: Explorer, *given: Any, **options: Any) -> None:
        self.explorer = explorer
        super().__init__(*given, **options)

    def do_GET(self) -> None:
        self.explorer.asked.append(self.path)
        if self.path == "/visit.html":
            self._send(self.explorer.page, "text/html")
        elif self.path == "/explorer/worker.mjs" and not self.explorer.pyodide:
            self._send(_DOUBLE, "text/javascript")
        else:
            super().do_GET()

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        if self.path == "/answer":
            self._send(answers().answer(body), "application/json")
        else:
            self._send("{}", "application/json")
            self.explorer.found.put(json.loads(body))

    def _send(self, text: str, kind: str) -> None:
        data = text.encode()
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: Any) -> None:
        pass
