"""Where the sample pairs lie: inside the installed package, or in data/ of a checkout."""

from __future__ import annotations

from pathlib import Path

__all__ = ["sample_folder"]


def sample_folder() -> Path:
    """Return the folder that holds one folder a sample pair.

    Raises:
        FileNotFoundError: if the package came without them.
    """
    package = Path(__file__).parent
    for folder in (package / "sample", package.parent / "data"):
        if (folder / "workshop" / "left.png").exists():
            return folder
    raise FileNotFoundError("the sample pairs are not installed; reinstall stereo-recon")
