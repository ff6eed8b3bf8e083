"""Debian's Chromium without a window: what a page asks for, what it complains of, what it looks like.

It is steered by its DevTools protocol.
"""

import base64
import json
import os
import signal
import subprocess
import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import cast

from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.servers.eventually import eventually
from tests.servers.tools import need_tool

_WATCHED = (
    *("Network.requestWillBeSent", "Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"),
    "Page.javascriptDialogOpening",
)
_OPTIONS = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-port=0"),
    *("--no-first-run", "--disable-background-networking", "--hide-scrollbars", "--force-color-profile=srgb"),
    *("--disable-extensions", "--disable-sync", "--disable-component-update", "--font-render-hinting=none"),
)
Answer = Mapping[str, object]


@dataclass
class Page:
    """A page that is open.

    Attributes:
        requests: URLs that it asked for, itself the first.
        complaints: What it wrote on the console, and what the browser had to say of it.
    """

    socket: Connection
    requests: list[str] = field(default_factory=list[str])
    complaints: list[str] = field(default_factory=list[str])
    _numbers: "count[int]" = field(default_factory=count)

    def call(self, method: str, **parameters: object) -> Answer:
        """Returns what the browser answers; what it tells meanwhile is noted."""
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = cast("dict[str, object]", json.loads(self.socket.recv()))
            if message.get("id") == number:
                assert "error" not in message, message
                return cast("Answer", message["result"])
            self._note(message)

    def run(self, expression: str) -> object:
        """Returns what an expression is on the page, as JSON."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return cast("Answer", answer["result"]).get("value")

    def holds(self, expression: str) -> bool:
        """Returns whether an expression is true on the page; of a page that is just being left it is not."""
        try:
            return self.run(expression) is True
        except AssertionError as exc:
            if "navigated or closed" not in str(exc):
                raise
            return False

    def look(self, *, width: int, height: int, dark: bool = False) -> None:
        """Sets the size of the window, in CSS pixels, and what the reader prefers."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 600
        )

    def picture(self, *, whole: bool = True) -> bytes:
        """Returns a screenshot as PNG: of the whole page, or of what the window shows."""
        answer = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        return base64.b64decode(cast("str", answer["data"]))

    def open(self, url: str) -> None:
        """Opens a URL and waits until it is there, with nothing left that it would still load."""
        self.run("globalThis.left = true")
        if "loaderId" in self.call("Page.navigate", url=url):  # else it is another place of the same page
            eventually(lambda: self.holds("!globalThis.left && document.readyState === 'complete'"))
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def _note(self, message: Mapping[str, object]) -> None:
        if message.get("method") not in _WATCHED:
            return
        told = cast("dict[str, dict[str, object]]", message["params"])
        if message["method"] == "Network.requestWillBeSent":
            self.requests.append(str(told["request"]["url"]))
        else:
            self.complaints.append(json.dumps(told))


@contextmanager
def browsing(folder: Path) -> Generator[Page, None, None]:
    """Yields an empty page of a browser of its own, which ends with the block; skips the test where there is none.

    Args:
        folder: For the browser's profile.
    """
    program = need_tool("chromium")
    with (folder / "chromium.log").open("wb") as log:
        process = subprocess.Popen(
            [program, *_OPTIONS, f"--user-data-dir={folder / 'profile'}", "about:blank"],
            stdout=log,
            stderr=log,
            start_new_session=True,
        )
    try:
        with connect(_page_url(process, folder), max_size=None) as socket:
            page = Page(socket)
            for domain in ("Page", "Network", "Runtime", "Log"):
                page.call(f"{domain}.enable")
            yield page
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _page_url(process: subprocess.Popen[bytes], folder: Path) -> str:
    """Returns the WebSocket of the first page, when the browser has written where it listens."""
    told = folder / "profile" / "DevToolsActivePort"
    while not told.is_file() or len(told.read_text().splitlines()) < 2:
        if process.poll() is not None:
            raise RuntimeError(f"Chromium did not start:\n{(folder / 'chromium.log').read_text()[-4000:]}")
        time.sleep(0.05)
    port, browser = told.read_text().split()
    with connect(f"ws://127.0.0.1:{port}{browser}") as socket:
        whole = Page(socket)
        targets = cast("list[dict[str, str]]", whole.call("Target.getTargets")["targetInfos"])
    page = next(target["targetId"] for target in targets if target["type"] == "page")
    return f"ws://127.0.0.1:{port}/devtools/page/{page}"
