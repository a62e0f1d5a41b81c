"""Chromium driven through its own protocol: real clicks, keys, drops and downloads, at the size of any screen.

The protocol goes through a pipe, so that no port and no further package is needed:
https://chromedevtools.github.io/devtools-protocol.
"""

from __future__ import annotations

import base64
import json
import os
import select
import signal
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from support.system_tools import CHROMIUM, tool

FLAGS = (
    "--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--hide-scrollbars", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--remote-debugging-pipe",
)  # fmt: skip
PHONE = 700
"""Screens that are narrower, px, are those of phones."""
PATIENCE = 500.0
"""Seconds without any message after which a test ends: a busy machine needs minutes to start Python in a browser."""
KEYS = {"Tab": 9, "Enter": 13, "Escape": 27, " ": 32, "ArrowRight": 39}
_CTRL = 2
_PLACE = """(() => {
  const element = document.querySelector(SELECTOR);
  element.scrollIntoView({ block: "center", inline: "center" });
  const box = element.getBoundingClientRect(), at = [box.x + box.width / 2, box.y + box.height / 2];
  const hit = document.elementFromPoint(...at);
  if (!element.contains(hit) && !hit?.contains(element)) throw Error(`${SELECTOR} is behind ${hit?.outerHTML}`);
  return at;
})()"""

_CHOOSE = """{
  const list = document.querySelector(SELECTOR);
  list.value = VALUE;
  list.dispatchEvent(new Event("change", { bubbles: true }));
}"""


class DevTools:
    """A browser with one page; what its console says, workers included, and what it asks of whom are kept."""

    def __init__(
        self, profile: Path, width: int = 1400, height: int = 900, dark: bool = False
    ) -> None:
        command = [tool(*CHROMIUM), *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        there, self._to = os.pipe()
        self._from, back = os.pipe()
        silent = [
            (os.POSIX_SPAWN_OPEN, fd, os.devnull, os.O_RDWR, 0) for fd in (0, 1, 2)
        ]
        ends = [
            (os.POSIX_SPAWN_DUP2, there, 3),
            (os.POSIX_SPAWN_DUP2, back, 4),
        ]  # where Chromium expects them
        self._process = os.posix_spawn(
            command[0], command, os.environ, file_actions=[*silent, *ends], setpgroup=0
        )
        os.close(there)
        os.close(back)
        self._rest, self._asked = b"", 0
        self.said: list[str] = []
        self.urls: list[str] = []
        self.events: list[tuple[str, Any]] = []
        self._session = ""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call(
            "Target.attachToTarget", targetId=target, flatten=True
        )["sessionId"]
        self._listen(self._session)
        self.call("Page.enable")
        self.call("Page.bringToFront")
        self.size(width, height)
        self.colours(dark=dark)

    def _listen(self, session: str) -> None:
        for method in ("Runtime.enable", "Log.enable", "Network.enable"):
            self._send(method, {}, session)
        self._send(
            "Target.setAutoAttach",
            {"autoAttach": True, "waitForDebuggerOnStart": False, "flatten": True},
            session,
        )

    def __enter__(self) -> DevTools:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        os.killpg(self._process, signal.SIGKILL)
        os.waitpid(self._process, 0)
        os.close(self._to)
        os.close(self._from)

    # -- messages ------------------------------------------------------------------------------------------------------

    def call(self, method: str, **given: Any) -> Any:
        """The result of a method of the protocol."""
        session = (
            ""
            if method.startswith(("Target.create", "Target.attach", "Browser."))
            else self._session
        )
        number = self._send(method, given, session)
        while True:
            answer = self._next(PATIENCE)
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer["error"])
                return answer["result"]

    def _send(self, method: str, given: dict[str, Any], session: str) -> int:
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": given} | (
            {"sessionId": session} if session else {}
        )
        os.write(self._to, json.dumps(message).encode() + b"\0")
        return self._asked

    def _next(self, seconds: float) -> dict[str, Any]:
        until = time.monotonic() + seconds
        while b"\0" not in self._rest:
            ready, _, _ = select.select(
                [self._from], [], [], max(until - time.monotonic(), 0)
            )
            if not ready:
                raise TimeoutError("the browser does not answer")
            self._rest += os.read(self._from, 1 << 20)
        first, self._rest = self._rest.split(b"\0", 1)
        message: dict[str, Any] = json.loads(first)
        self._note(message.get("method", ""), message.get("params", {}))
        return message

    def _note(self, event: str, told: Any) -> None:
        if event == "Runtime.exceptionThrown":
            details = told["exceptionDetails"]
            self.said.append(
                details.get("exception", {}).get("description", details["text"])
            )
        elif event == "Runtime.consoleAPICalled":
            self.said.append(
                " ".join(str(argument.get("value")) for argument in told["args"])
            )
        elif (
            event == "Log.entryAdded"
            and "GL Driver Message" not in told["entry"]["text"]
        ):
            self.said.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
        elif event == "Network.requestWillBeSent":
            self.urls.append(told["request"]["url"])
        elif event == "Target.attachedToTarget":
            self._listen(told["sessionId"])
        else:
            self.events.append((event, told))

    # -- what a visitor does -------------------------------------------------------------------------------------------

    def size(self, width: int, height: int) -> None:
        """The size of the screen, px."""
        metrics = {
            "width": width,
            "height": height,
            "deviceScaleFactor": 1,
            "mobile": width < PHONE,
        }
        self.call("Emulation.setDeviceMetricsOverride", **metrics)

    def colours(self, *, dark: bool) -> None:
        """Which colours the visitor prefers."""
        chosen = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[chosen])

    def open(self, url: str) -> None:
        """Go to a page that is not there yet, and wait until it has loaded."""
        for address in ("about:blank", url):
            self._loaded(partial(self.call, "Page.navigate", url=address))

    def follow(self, selector: str) -> None:
        """Click on a link to another page, and wait until that has loaded."""
        self._loaded(lambda: self.click(selector))

    def _loaded(self, act: Callable[[], object]) -> None:
        self.events.clear()
        act()
        self.wait(
            lambda: any(event == "Page.loadEventFired" for event, _ in self.events)
        )

    def wait(self, condition: Callable[[], bool], seconds: float = PATIENCE) -> None:
        """Take events until a condition holds."""
        while not condition():
            self._next(seconds)

    def evaluate(self, expression: str, **names: Any) -> Any:
        """The value of an expression or of its promise; names in it stand for values."""
        for name, value in names.items():
            expression = expression.replace(name, json.dumps(value))
        told = self.call(
            "Runtime.evaluate",
            expression=expression,
            awaitPromise=True,
            returnByValue=True,
        )
        assert "exceptionDetails" not in told, told["exceptionDetails"]
        return told["result"].get("value")

    def click(self, selector: str) -> None:
        """A click in the middle of an element; it fails where something else is in front."""
        x, y = self.evaluate(_PLACE, SELECTOR=selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.call(
                "Input.dispatchMouseEvent",
                type=kind,
                x=x,
                y=y,
                button="left",
                clickCount=1,
            )

    def press(self, key: str, held: str = "") -> None:
        """A key where the focus is, perhaps with Ctrl held."""
        ctrl = held == "ctrl"
        text = {"Enter": "\r", " ": " "}.get(key, key if len(key) == 1 else "")
        given = {
            "key": key,
            "code": key,
            "modifiers": _CTRL * ctrl,
            "windowsVirtualKeyCode": KEYS.get(key, ord(key[0])),
        }
        self.call(
            "Input.dispatchKeyEvent",
            type="keyDown",
            **given,
            **({"text": text} if text and not ctrl else {}),
        )
        self.call("Input.dispatchKeyEvent", type="keyUp", **given)

    def type(self, selector: str, text: str) -> None:
        """Replace what an element holds, as typing or pasting does."""
        self.click(selector)
        self.evaluate("document.querySelector(SELECTOR).select()", SELECTOR=selector)
        self.call("Input.insertText", text=text)

    def choose(self, selector: str, value: str) -> None:
        """Another option of a list; lists that open are no part of the page."""
        self.evaluate(_CHOOSE, SELECTOR=selector, VALUE=value)

    def drop(self, selector: str, file: Path) -> None:
        """Drag a file from elsewhere onto an element."""
        x, y = self.evaluate(_PLACE, SELECTOR=selector)
        data = {"items": [], "files": [str(file)], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def downloads(
        self, folder: Path, count: int, act: Callable[[], None]
    ) -> dict[str, str]:
        """The files that an act brings into an empty folder, by name."""
        self.call(
            "Browser.setDownloadBehavior",
            behavior="allow",
            downloadPath=str(folder),
            eventsEnabled=True,
        )
        act()
        self.wait(
            lambda: (
                [
                    t.get("state")
                    for e, t in self.events
                    if e == "Browser.downloadProgress"
                ].count("completed")
                >= count
            )
        )
        return {
            file.name: file.read_text(encoding="utf-8") for file in folder.iterdir()
        }

    def picture(self, *, whole: bool = False) -> bytes:
        """What is seen, or the whole page, as a PNG."""
        told = self.call(
            "Page.captureScreenshot", format="png", captureBeyondViewport=whole
        )
        return base64.b64decode(told["data"])
