"""`reconstruct presets` and `view`: look at what there is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table
from tyro.conf import Positional

from recon.cli.terminal import console

if TYPE_CHECKING:
    from recon.viewer import Page

__all__ = ["keep_serving", "presets", "say_where", "view"]


def presets() -> None:
    """List the presets and what each does."""
    from recon.settings import load_preset, preset_names

    table = Table("preset", "what it does", "cost", box=None, pad_edge=False)
    for name in preset_names():
        one = load_preset(name)
        table.add_row(name, one.description, type(one.matcher.matching_cost).__name__)
    console.print(table)


def view(
    folder: Positional[Path],
    *,
    web: bool = False,
    port: int | None = None,
) -> None:
    """Open the recording of a reconstruction in Rerun's viewer.

    Args:
        folder: the -o of an earlier reconstruction, or an .rrd file.
        web: show it in a browser, until Ctrl-C; the way on a machine without a screen.
        port: of the page for the browser; its data take the next one.
    """
    from recon.viewer import open_recording, serve_recording

    recording = folder / "recording.rrd" if folder.is_dir() else folder
    if not recording.is_file():
        raise ValueError(f"there is no recording {recording}; was it made with --recording none?")
    if port is not None and not web:
        raise ValueError("--port is of the page that --web serves; say --web too")
    if web:
        page = serve_recording(recording, port=port)
        say_where(page)
        keep_serving(page)
    else:
        open_recording(recording)


def say_where(page: Page) -> None:
    """Say where a recording is shown; the addresses end their lines, so that they can be copied."""
    console.print(f"showing at {page.url}", soft_wrap=True)
    console.print(f"from another machine: {page.from_elsewhere}", soft_wrap=True)


def keep_serving(page: Page) -> None:
    """Show a recording until Ctrl-C."""
    console.print("press Ctrl-C to end the page")
    page.wait()
