"""`reconstruct presets` and `view`: look at what there is."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table
from tyro.conf import Positional

from recon.cli.terminal import console

__all__ = ["presets", "view"]


def presets() -> None:
    """List the presets and what each does."""
    from recon.settings import load_preset, preset_names

    table = Table("preset", "what it does", "cost", box=None, pad_edge=False)
    for name in preset_names():
        one = load_preset(name)
        table.add_row(name, one.description, type(one.matcher.matching_cost).__name__)
    console.print(table)


def view(folder: Positional[Path]) -> None:
    """Open the recording of a reconstruction in Rerun's viewer.

    Args:
        folder: the -o of an earlier reconstruction, or an .rrd file.
    """
    from recon.viewer import open_recording

    recording = folder / "recording.rrd" if folder.is_dir() else folder
    if not recording.is_file():
        raise ValueError(f"there is no recording {recording}; was it made with --recording none?")
    open_recording(recording)
