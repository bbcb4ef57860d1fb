"""Depths kept on disk while a sequence is fused, so that a run that was ended goes on from them."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from recon.files import atomic
from recon.sequence.sources import SeenFrame

__all__ = ["KeptFrames"]

HELD = tuple(entry.name for entry in fields(SeenFrame))


@dataclass(frozen=True)
class KeptFrames:
    """A folder with one file a frame, named by what the frame was made from.

    Attributes:
        folder: made when the first frame is kept.
    """

    folder: Path

    def get(self, fingerprint: str) -> SeenFrame | None:
        """Return a frame that was kept, None if there is none or its file is damaged."""
        path = self._path(fingerprint)
        if not path.is_file():
            return None
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return SeenFrame(**{name: arrays[name] for name in HELD})
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            return None

    def put(self, fingerprint: str, frame: SeenFrame) -> None:
        """Keep a frame; its file appears whole or not at all."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with atomic(self._path(fingerprint)) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **{name: getattr(frame, name) for name in HELD})

    def forget_others(self, fingerprints: set[str]) -> None:
        """Remove frames of other files or settings, and what a run that was ended left half."""
        if not self.folder.is_dir():
            return
        wanted = {self._path(fingerprint) for fingerprint in fingerprints}
        for path in self.folder.iterdir():
            if path not in wanted and (path.suffix == ".npz" or path.name.startswith(".")):
                path.unlink(missing_ok=True)

    def _path(self, fingerprint: str) -> Path:
        return self.folder / f"{fingerprint}.npz"
