"""Point clouds as NumPy archives, to be read with NumPy alone."""

from __future__ import annotations

import os
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from recon.files.writing import atomic
from recon.types import PointCloud

__all__ = ["read_npz", "write_npz"]

FRAME = "metres; left rectified camera: x right, y down, z forward"
KEYS = tuple(field.name for field in fields(PointCloud))


def write_npz(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a point cloud as arrays by name: `np.load(path)["points"]`.

    The keys are those of `PointCloud`, each with its shape and type there, and `frame`, a text
    that says what the coordinates are.

    Args:
        path: of the file to write.
        cloud: in metres, in the frame of the left rectified camera (x right, y down, z forward).
    """
    arrays = {name: getattr(cloud, name) for name in KEYS}
    with atomic(path) as partial, partial.open("wb") as file:
        np.savez(file, **arrays, frame=np.array(FRAME))


def read_npz(path: str | os.PathLike[str]) -> PointCloud:
    """Read a point cloud written by `write_npz`.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not an archive with those keys, or they do not fit each other.
    """
    try:
        with Path(path).open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, EOFError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path} is not a NumPy archive (.npz) of arrays: {error}; was the copy interrupted?"
        ) from error
    missing = set(KEYS) - arrays.keys()
    if missing:
        raise ValueError(
            f"{path} lacks {sorted(missing)}, it has {sorted(arrays)}; "
            "expected a cloud written by write_npz"
        )
    return PointCloud(**{name: arrays[name] for name in KEYS})
