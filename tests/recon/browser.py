"""A headless browser that draws a GLB with three.js, and hands back the picture."""

import shutil
import subprocess
import tempfile
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlencode

import cv2
import numpy as np
import pytest
from browsing import SWITCHES, chromium

HERE = Path(__file__).parent.parent / "browser"
PATIENCE_S = 150


def with_packages(name="three"):
    """Return the folder of the page with its packages; the test is skipped without them."""
    if not (HERE / "node_modules" / name).is_dir():
        pytest.skip(f"{name} is missing: npm ci --prefix tests/browser")
    return HERE


def a_browser():
    """Return the path of Chromium; the test is skipped without one."""
    return chromium() or pytest.skip("no Chromium on this machine")


class _Page(SimpleHTTPRequestHandler):
    """Serves the page, its packages and the file to look at; takes the picture."""

    def __init__(self, *arguments, file, answer, **more):
        self.file, self.answer = file, answer
        super().__init__(*arguments, **more)

    def translate_path(self, path):
        return str(self.file) if path == "/file.glb" else super().translate_path(path)

    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.answer[self.path] = body
        self.send_response(204)
        self.end_headers()
        self.answer["done"].set()

    def log_message(self, *_):
        pass


def drawn_in_a_browser(file, geometry, **view):
    """Return (H, W, 3) uint8 RGB: what three.js draws of a GLB, blue where it draws nothing.

    Args:
        file: the GLB.
        geometry: of the left camera, from which it is looked at.
        view: `turn` and `down` in radians about the point `middle` metres ahead; `lit` to show
            shapes without their colours.
    """
    program, folder = a_browser(), with_packages()
    answer = {"done": threading.Event()}
    page = partial(_Page, directory=str(folder), file=file, answer=answer)
    server = ThreadingHTTPServer(("127.0.0.1", 0), page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    (width, height), (cx, cy) = geometry.size, geometry.centre_left
    asked = {"file": "file.glb", "width": width, "height": height, "focal": geometry.focal_px}
    query = urlencode({**asked, "cx": cx, "cy": cy, **view})
    profile = tempfile.mkdtemp(prefix="browser-")
    browser = subprocess.Popen(
        [
            *(program, *SWITCHES, f"--user-data-dir={profile}"),
            f"http://127.0.0.1:{server.server_port}/view.html?{query}",
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert answer["done"].wait(PATIENCE_S), "the browser sent no picture"
    finally:
        browser.terminate()
        browser.wait(20)
        server.shutdown()
        server.server_close()
        shutil.rmtree(profile, ignore_errors=True)
    assert "/error" not in answer, answer.get("/error", b"").decode()
    contents = np.frombuffer(answer["/picture"], np.uint8)
    return cv2.imdecode(contents, cv2.IMREAD_COLOR)[..., ::-1]
