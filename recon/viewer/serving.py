"""Recordings in a window of Rerun's viewer, and in a browser."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
import uuid
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

import rerun as rr

__all__ = ["APPLICATION", "Page", "open_page", "open_recording", "serve_recording"]

APPLICATION = "stereo-recon"
HERE = "127.0.0.1"
PAGE_PORT = 9090


@dataclass(frozen=True, eq=False)
class Page:
    """A page for a browser on this machine, and the data that it shows.

    The data are served to this machine only, until the program ends or the stream is dropped. The
    page is Rerun's viewer, without any data; other machines that reach this one may load it.

    Attributes:
        url: of the page.
        ports: of the page and of the data.
        data: address to which a recording is sent to be shown.
        stream: what is logged to it is shown.
    """

    url: str
    ports: tuple[int, int]
    data: str
    stream: rr.RecordingStream

    @property
    def from_elsewhere(self) -> str:
        """What to type on another machine, to open the same address there."""
        tunnels = " ".join(f"-L {port}:localhost:{port}" for port in self.ports)
        return f"ssh {tunnels} THIS_MACHINE"

    def wait(self) -> None:
        """Return when the person at the keyboard interrupts (Ctrl-C)."""
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


def open_page(*, port: int | None = None, open_browser: bool = True) -> Page:
    """Serve the viewer and a recording that is still empty.

    Args:
        port: of the page; its data take the next one. If none is given, 9090 or any free one.
        open_browser: open the page at once, if this machine has a screen.

    Raises:
        ValueError: if the port, or the next, is in use.
    """
    page, data = _free_ports(port)
    # A stream of its own, as ending a stream ends its server.
    stream = rr.RecordingStream(APPLICATION, recording_id=uuid.uuid4(), send_properties=False)
    sink = rr.GrpcServerSink(HERE, data)
    stream.set_sinks(sink)
    address = str(sink.uri)
    rr.serve_web_viewer(
        web_port=page, open_browser=open_browser and _has_a_screen(), connect_to=address
    )
    url = f"http://{HERE}:{page}/?url={quote(address, safe='')}"
    return Page(url, (page, data), address, stream)


def serve_recording(
    path: str | os.PathLike[str], *, port: int | None = None, open_browser: bool = True
) -> Page:
    """Serve a recording to a browser on this machine.

    Args:
        path: of an .rrd file.
        port: see `open_page`.
        open_browser: see `open_page`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the port is in use, or the file is no recording.
    """
    _check_recording(path)
    page = open_page(port=port, open_browser=open_browser)
    page.stream.log_file_from_path(Path(path))
    page.stream.flush()
    return page


def open_recording(path: str | os.PathLike[str]) -> None:
    """Open a recording in Rerun's viewer, and return when it is closed.

    Args:
        path: of an .rrd file.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no recording, or the viewer cannot run here.
    """
    _check_recording(path)
    status = subprocess.run(
        [sys.executable, "-m", "rerun", os.fspath(path)], check=False
    ).returncode
    if status:
        raise ValueError(
            f"Rerun's viewer ended with status {status}; without a display, "
            f"`reconstruct view --web {path}` shows the recording in a browser"
        )


def _check_recording(path: str | os.PathLike[str]) -> None:
    """Raise if there is no recording; a file that is none would be an empty page."""
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no recording {path}")
    with Path(path).open("rb") as file:
        start = file.read(4)
    if not start.startswith(b"RR"):
        raise ValueError(f"{path} is no recording of Rerun: it begins with {start!r}, not RRF")


def _free_ports(wanted: int | None) -> tuple[int, int]:
    """Return two ports of this machine that nothing listens on."""
    if wanted is not None:
        taken = [port for port in (wanted, wanted + 1) if not _is_free(port)]
        if taken:
            raise ValueError(
                f"port {taken[0]} of this machine is in use or not allowed; a page on port "
                f"{wanted} needs {wanted} and {wanted + 1}; choose another --port"
            )
        return wanted, wanted + 1
    if _is_free(PAGE_PORT) and _is_free(PAGE_PORT + 1):
        return PAGE_PORT, PAGE_PORT + 1
    with socket.socket() as first, socket.socket() as second:
        first.bind(("", 0))
        second.bind(("", 0))
        return int(first.getsockname()[1]), int(second.getsockname()[1])


def _is_free(port: int) -> bool:
    """Return whether a server could listen on a port."""
    with socket.socket() as candidate, contextlib.suppress(OSError, OverflowError):
        candidate.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        candidate.bind(("", port))
        return True
    return False


def _has_a_screen() -> bool:
    """Return whether a browser could show anything; elsewhere one in the terminal may start."""
    return not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
