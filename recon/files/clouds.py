"""Point clouds in every format that they are written in, by the ending of the file."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from recon.files.las import read_las, write_las
from recon.files.npz import read_npz, write_npz
from recon.files.ply import read_ply, write_ply
from recon.types import PointCloud

__all__ = ["CLOUD_FORMATS", "read_cloud", "write_cloud"]

File = str | os.PathLike[str]

CLOUD_FORMATS: dict[
    str, tuple[Callable[[File], PointCloud], Callable[[File, PointCloud], None]]
] = {
    ".ply": (read_ply, write_ply),
    ".npz": (read_npz, write_npz),
    ".las": (read_las, write_las),
    ".laz": (read_las, write_las),
}
"""What reads and what writes the files of an ending."""


def read_cloud(path: File) -> PointCloud:
    """Read a point cloud that this program wrote.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if its ending or its contents are not those of a cloud of ours.
    """
    return CLOUD_FORMATS[_ending(path)][0](path)


def write_cloud(path: File, cloud: PointCloud) -> None:
    """Write a point cloud in the format that the ending of the file names.

    Args:
        path: ends in one of `CLOUD_FORMATS`.
        cloud: in metres, in the frame of the left rectified camera.

    Raises:
        ValueError: if no format has this ending.
    """
    CLOUD_FORMATS[_ending(path)][1](path, cloud)


def _ending(path: File) -> str:
    ending = Path(path).suffix.lower()
    if ending not in CLOUD_FORMATS:
        raise ValueError(f"{path} does not end as a cloud does: {', '.join(CLOUD_FORMATS)}")
    return ending
