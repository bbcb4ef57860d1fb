"""A headless Chromium that opens a page and takes pictures of it, for tests."""

import base64
import contextlib
import fcntl
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
SWITCHES = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
)
"""Draw without a screen or a graphics card, and connect to nothing that is not asked for."""

WITH_PIPES = """
import os, sys
there, here = map(int, sys.argv[1:3])
os.dup2(there, 3)
os.dup2(here, 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Become the browser, which hears on descriptor 3 and answers on 4."""


def chromium() -> str | None:
    """Return the browser of this machine, None if it has none."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Tab:
    """One page, spoken to in the DevTools protocol over two pipes."""

    def __init__(self, send: int, receive: int) -> None:
        self._send, self._receive, self._sent, self._rest = send, receive, 0, b""
        self._session: dict[str, str] = {}

    def _ask(self, method: str, **parameters) -> dict:
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": parameters, **self._session}
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                read = os.read(self._receive, 1 << 20)
                assert read, "the browser ended"
                self._rest += read
            text, _, self._rest = self._rest.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == self._sent:
                assert "error" not in answer, answer
                return answer["result"]

    def open(self, url: str) -> None:
        target = self._ask("Target.createTarget", url=url)["targetId"]
        attached = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def click(self, x: float, y: float) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            button = {} if kind == "mouseMoved" else {"button": "left", "clickCount": 1}
            self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)
            time.sleep(0.3)

    def hover(self, x: float, y: float) -> None:
        for step in (0, 1):
            self._ask("Input.dispatchMouseEvent", type="mouseMoved", x=x + step, y=y)

    def picture(self) -> np.ndarray:
        """Return what is on the page, (H, W, 3) RGB."""
        png = base64.b64decode(self._ask("Page.captureScreenshot")["data"])
        return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]

    def picture_when(
        self, ready: Callable[[np.ndarray], bool], *, within_s: float, every_s: float = 2.0
    ) -> np.ndarray:
        """Return the first picture that is ready, or the last before the time is over."""
        end = time.monotonic() + within_s
        while not ready(shown := self.picture()) and time.monotonic() < end:
            time.sleep(every_s)
        return shown


def _pipe() -> list[int]:
    """Return the ends of a pipe, out of the way of 3 and 4, which the browser listens to."""
    ends = os.pipe()
    moved = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends]
    for end in ends:
        os.close(end)
    return moved


@contextlib.contextmanager
def page(url: str, *, size: tuple[int, int] = (1000, 700)) -> Iterator[Tab]:
    """Open a page in a browser of its own."""
    (there, send), (receive, here) = _pipe(), _pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [
            *(
                chromium(),
                *SWITCHES,
                "--remote-debugging-pipe",
                f"--window-size={size[0]},{size[1]}",
            ),
            f"--user-data-dir={profile}",
        ]
        browser = subprocess.Popen(
            [sys.executable, "-c", WITH_PIPES, str(there), str(here), *command],
            pass_fds=(there, here),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(there)
        os.close(here)
        try:
            tab = Tab(send, receive)
            tab.open(url)
            yield tab
        finally:
            browser.terminate()
            browser.wait(timeout=20)
            os.close(send)
            os.close(receive)
