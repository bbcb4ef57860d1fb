"""The observer that sends every stage to Rerun: to a file, a window or a browser."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import uuid
from pathlib import Path
from types import TracebackType
from typing import Literal
from urllib.parse import quote

import numpy as np
import rerun as rr

from recon.types import Mesh, PointCloud
from recon.viewer.arrangement import arranged
from recon.viewer.drawing import STATUS_CONTEXT, Limits, archetypes

__all__ = ["RerunObserver", "open_recording"]

APPLICATION = "stereo-recon"
TIMELINE = "stage"


class RerunObserver:
    """Draw every result; the name of the stage is its path in the recording.

    Used in a `with` block. A recording appears under its name when the block ends, whole; if the
    block raises, none appears. A browser is served until the program ends. Without `save` and
    `show` it draws nothing and costs nothing.

    Attributes:
        url: of the page for a browser on this machine; None unless shown in a browser.
    """

    def __init__(
        self,
        *,
        save: str | os.PathLike[str] | None = None,
        show: Literal["nothing", "window", "browser"] = "nothing",
        limits: Limits | None = None,
        port: int = 9876,
        open_browser: bool = True,
    ) -> None:
        """Start a recording.

        Args:
            save: the .rrd file to write.
            show: a window of Rerun's viewer, or a page for a browser on this machine.
            limits: how much of each result is drawn.
            port: by which results reach the window or page; a page takes another if this one is
                in use.
            open_browser: open the page at once.

        Raises:
            FileNotFoundError: if the folder of `save` does not exist.
        """
        self.url: str | None = None
        self._limits = limits or Limits()
        self._target = None if save is None else Path(save)
        self._partial: Path | None = None
        self._live = show != "nothing"
        self._open = self._live or save is not None
        self._stages = 0
        self._drawn: dict[str, type] = {}
        self._focus_m = 3.0
        if self._open:
            self._start(show, port, open_browser)

    def _start(self, show: str, port: int, open_browser: bool) -> None:
        """Connect the recording to its file and its viewer."""
        self._recording = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4())
        sinks: list[rr.FileSink | rr.GrpcSink | rr.GrpcServerSink] = []
        if self._target is not None:
            folder = self._target.parent
            if not folder.is_dir():
                raise FileNotFoundError(
                    f"cannot record to {self._target}: folder {folder} does not exist"
                )
            self._partial = self._target.with_name(f".{uuid.uuid4().hex}.part")
            sinks.append(rr.FileSink(self._partial))
        if show == "window":
            rr.spawn(port=port, connect=False)
            sinks.append(rr.GrpcSink(f"rerun+http://127.0.0.1:{port}/proxy"))
        if show == "browser":
            sinks.append(rr.GrpcSink(self._serve(port, open_browser)))
        self._recording.set_sinks(*sinks)
        self._recording.log("/", rr.ViewCoordinates.RDF, static=True)
        self._recording.log("/", STATUS_CONTEXT, static=True)
        if self._live:
            self._arrange()

    def _serve(self, port: int, open_browser: bool) -> str:
        """Serve a page and its data, and return the address of the data, on this machine only.

        The server hangs on a stream of its own, as ending a stream ends its server.
        """
        self._server = rr.RecordingStream(
            APPLICATION, recording_id=uuid.uuid4(), send_properties=False
        )
        server = rr.GrpcServerSink("127.0.0.1", _free_port(port))
        self._server.set_sinks(server)
        address = str(server.uri)
        page = _free_port(9090)
        rr.serve_web_viewer(web_port=page, open_browser=open_browser, connect_to=address)
        self.url = f"http://127.0.0.1:{page}/?url={quote(address, safe='')}"
        return address

    def __call__(self, stage: str, result: object) -> None:
        """Draw what a stage made.

        Args:
            stage: slash-separated name, such as "disparity/left".
            result: of any type; `archetypes` knows how to draw it.
        """
        if not self._open:
            return
        self._recording.set_time(TIMELINE, sequence=self._stages)
        self._stages += 1
        for path, archetype in archetypes(result, self._limits):
            place = path if path.startswith("/") else f"/{stage}/{path}".rstrip("/")
            self._recording.log(place, archetype)
            self._drawn[place] = type(archetype)
        self._focus_m = _median_distance(result) or self._focus_m
        if self._live:
            self._arrange()

    def _arrange(self) -> None:
        self._recording.send_blueprint(arranged(self._drawn, self._focus_m))

    def close(self, *, keep: bool = True) -> None:
        """End the recording and give it its name.

        Args:
            keep: whether the file should remain.
        """
        if not self._open:
            return
        self._open = False
        try:
            self._arrange()
            self._recording.flush()
            self._recording.disconnect()
            if keep and self._target is not None and self._partial is not None:
                self._partial.replace(self._target)
        finally:
            if self._partial is not None:
                self._partial.unlink(missing_ok=True)

    def wait(self) -> None:
        """Keep serving a browser until the person at the keyboard interrupts (Ctrl-C).

        The block may have ended by then.
        """
        if self.url is None:
            return
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return

    def __enter__(self) -> RerunObserver:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close(keep=kind is None)


def _free_port(wanted: int) -> int:
    """Return a port of this machine that nothing listens on: the wanted one, or any."""
    for port in (wanted, 0):
        with socket.socket() as candidate, contextlib.suppress(OSError):
            candidate.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            candidate.bind(("", port))
            return int(candidate.getsockname()[1])
    raise ValueError(f"neither port {wanted} nor any other is free to serve a browser")


def open_recording(path: str | os.PathLike[str]) -> None:
    """Open a recording in Rerun's viewer, and return when it is closed.

    Args:
        path: of an .rrd file.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the viewer cannot run here.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no recording {path}")
    status = subprocess.run(
        [sys.executable, "-m", "rerun", os.fspath(path)], check=False
    ).returncode
    if status:
        raise ValueError(
            f"Rerun's viewer ended with status {status}; without a display, "
            f"`python -m rerun --web-viewer {path}` shows the recording in a browser"
        )


def _median_distance(result: object) -> float | None:
    """Return the distance of a cloud or mesh in metres, None of anything else."""
    if isinstance(result, PointCloud) and len(result.points):
        return float(np.median(result.points[:, 2]))
    if isinstance(result, Mesh) and len(result.vertices):
        return float(np.median(result.vertices[:, 2]))
    return None
