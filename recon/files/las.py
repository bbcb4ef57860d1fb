"""Point clouds as LAS and LAZ, the formats of surveyors."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np

from recon.files.writing import atomic
from recon.types import Array, PointCloud

__all__ = ["read_las", "write_las"]

SOFTWARE = "stereo-recon"
POINT_FORMAT = 7
"""Of LAS 1.4: with colours and without the times and waves of a laser."""

FINEST_SCALE_M = 1e-6
MOST_STEPS = 2**31 - 1
EXTRA = {
    "nx": ("f4", "normal, x right"),
    "ny": ("f4", "normal, y forward"),
    "nz": ("f4", "normal, z up"),
    "confidence": ("f4", "probability of <= 1 px off"),
    "depth_sigma_m": ("f4", "standard deviation of depth"),
    "status": ("u1", "1 matched, 4 and 5 filled"),
}
"""Extra dimensions, with their type and a description of at most 32 characters."""

Z_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], np.float64)
"""From the camera's frame to that of the file: x right, y forward, z up."""


def write_las(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a point cloud as LAS 1.4, compressed (LAZ) if the name ends in .laz.

    Programs that read LAS take z for up, so the axes are x right, y forward, z up: (x, z, -y) of
    the camera frame, a rotation about x. Coordinates are whole multiples of a micrometre, or
    of the least power of ten that holds the farthest point. Colours have 16 bits, 257 times ours;
    normals, confidence, depth_sigma_m and status are extra dimensions.

    Args:
        path: of the file to write.
        cloud: in metres, in the frame of the left rectified camera (x right, y down, z forward).
    """
    import laspy

    points = cloud.points.astype(np.float64) @ Z_UP.T
    header = laspy.LasHeader(point_format=POINT_FORMAT, version="1.4")
    header.generating_software = SOFTWARE
    header.system_identifier = "stereo"
    header.scales = np.full(3, _scale_for(points))
    header.offsets = np.zeros(3)
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, kind, told) for name, (kind, told) in EXTRA.items()]
    )
    las = laspy.LasData(header)
    las.xyz = points
    las.red, las.green, las.blue = cloud.colours.T.astype(np.uint16) * 257
    normals = cloud.normals @ Z_UP.T.astype(np.float32)
    for axis, name in enumerate(("nx", "ny", "nz")):
        las[name] = normals[:, axis]
    for name in ("confidence", "depth_sigma_m", "status"):
        las[name] = getattr(cloud, name)
    compressed = Path(path).suffix.lower() == ".laz"
    with atomic(path) as partial, partial.open("wb") as file:
        las.write(file, do_compress=compressed)


def _scale_for(points: Array) -> float:
    """Return the length of one step of a coordinate, metres, a power of ten."""
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest <= FINEST_SCALE_M * MOST_STEPS:
        return FINEST_SCALE_M
    return float(10.0 ** math.ceil(math.log10(farthest / MOST_STEPS)))


def read_las(path: str | os.PathLike[str]) -> PointCloud:
    """Read a point cloud written by `write_las`, back into the frame of the camera.

    Args:
        path: of the .las or .laz file.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no such file, or lacks what `write_las` writes.
    """
    import laspy

    if not Path(path).exists():
        raise FileNotFoundError(f"there is no cloud {path}")
    try:
        las = laspy.read(path)
    except (laspy.LaspyException, ValueError, OSError, RuntimeError) as error:
        raise ValueError(f"{path} is not a LAS or LAZ file: {error}") from error
    missing = {*EXTRA, "red"} - set(las.point_format.dimension_names)
    if las.header.generating_software != SOFTWARE or missing:
        raise ValueError(
            f"{path} was written by {las.header.generating_software!r} and lacks "
            f"{sorted(missing)}; expected a cloud written by write_las"
        )
    return PointCloud(
        points=(np.asarray(las.xyz) @ Z_UP).astype(np.float32),
        colours=(np.stack([las.red, las.green, las.blue], axis=1) // 257).astype(np.uint8),
        normals=np.stack([las["nx"], las["ny"], las["nz"]], axis=1) @ Z_UP.astype(np.float32),
        confidence=np.asarray(las["confidence"]),
        depth_sigma_m=np.asarray(las["depth_sigma_m"]),
        status=np.asarray(las["status"]),
    )
