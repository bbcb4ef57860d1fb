"""Point clouds as binary PLY, with the confidence and error of every point."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from recon.files.writing import atomic
from recon.types import Array, PointCloud

__all__ = ["read_ply", "write_ply", "write_ply_vertices"]

PROPERTIES = (
    ("x", "float"),
    ("y", "float"),
    ("z", "float"),
    ("nx", "float"),
    ("ny", "float"),
    ("nz", "float"),
    ("red", "uchar"),
    ("green", "uchar"),
    ("blue", "uchar"),
    ("confidence", "float"),
    ("depth_sigma_m", "float"),
    ("status", "uchar"),
)
NUMPY_TYPES = {
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
    "uchar": "u1",
    "uint8": "u1",
    "char": "i1",
    "int8": "i1",
    "short": "<i2",
    "int16": "<i2",
    "ushort": "<u2",
    "uint16": "<u2",
    "int": "<i4",
    "int32": "<i4",
    "uint": "<u4",
    "uint32": "<u4",
}
LONGEST_HEADER = 65536


COMMENTS = (
    "metres; left rectified camera: x right, y down, z forward",
    "confidence: probability that the disparity is within 1 px",
    "status: 1 matched, 4 filled_occlusion, 5 filled_mismatch",
)
KINDS = {"f4": "float", "u1": "uchar", "i4": "int"}


def write_ply(path: str | os.PathLike[str], cloud: PointCloud) -> None:
    """Write a point cloud, binary little endian, in the names that viewers read.

    Args:
        path: of the file to write.
        cloud: in metres, in the frame of the left rectified camera (x right, y down, z forward).
    """
    axes = [(prefix + axis, number) for prefix in ("", "n") for number, axis in enumerate("xyz")]
    properties = {
        **{n: (cloud.normals if n[0] == "n" else cloud.points)[:, axis] for n, axis in axes},
        **dict(zip(("red", "green", "blue"), cloud.colours.T, strict=True)),
        **{name: getattr(cloud, name) for name in ("confidence", "depth_sigma_m", "status")},
    }
    write_ply_vertices(path, properties, comments=COMMENTS)


def write_ply_vertices(
    path: str | os.PathLike[str], properties: Mapping[str, Array], *, comments: Sequence[str] = ()
) -> None:
    """Write points with any properties, binary little endian.

    Args:
        path: of the file to write.
        properties: (N,) float32, int32 or uint8 by name, in the order of the file.
        comments: lines of ASCII that the file begins with.
    """
    kinds = {name: np.asarray(values).dtype.str[1:] for name, values in properties.items()}
    count = len(next(iter(properties.values())))
    vertices = np.zeros(count, [(name, f"<{kind}") for name, kind in kinds.items()])
    for name, values in properties.items():
        vertices[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comments),
        f"element vertex {count}",
        *(f"property {KINDS[kind]} {name}" for name, kind in kinds.items()),
        "end_header",
    ]
    with atomic(path) as partial:
        partial.write_bytes(("\n".join(header) + "\n").encode("ascii") + vertices.tobytes())


def read_ply(path: str | os.PathLike[str]) -> PointCloud:
    """Read a point cloud written by `write_ply`.

    Args:
        path: of the file; it may have more properties, in any order.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not a binary PLY with the properties of `write_ply`.
    """
    contents = Path(path).read_bytes()
    end = contents.find(b"end_header\n", 0, LONGEST_HEADER)
    if not contents.startswith(b"ply\n") or end < 0:
        raise ValueError(f"{path} is not a PLY: it begins with {contents[:8]!r}")
    header = contents[:end].decode("ascii", errors="replace").splitlines()
    if "format binary_little_endian 1.0" not in header:
        raise ValueError(f"{path} is '{header[1]}'; expected binary_little_endian 1.0")
    count, kind = _vertex_layout(header, path)

    body = contents[end + len(b"end_header\n") :]
    if len(body) < count * kind.itemsize:
        raise ValueError(
            f"{path} ends too early: {count} points need {count * kind.itemsize} bytes, it has "
            f"{len(body)}; was the copy interrupted?"
        )
    vertices = np.frombuffer(body, kind, count)

    def columns(*names: str) -> Array:
        return np.stack([vertices[name] for name in names], axis=1)

    return PointCloud(
        points=columns("x", "y", "z").astype(np.float32),
        colours=columns("red", "green", "blue").astype(np.uint8),
        normals=columns("nx", "ny", "nz").astype(np.float32),
        confidence=vertices["confidence"].astype(np.float32),
        depth_sigma_m=vertices["depth_sigma_m"].astype(np.float32),
        status=vertices["status"].astype(np.uint8),
    )


def _vertex_layout(
    header: list[str], path: str | os.PathLike[str]
) -> tuple[int, np.dtype[np.void]]:
    """Return the number of vertices, which come first, and the layout of one."""
    elements = [number for number, line in enumerate(header) if line.startswith("element ")]
    if not elements or not header[elements[0]].startswith("element vertex "):
        raise ValueError(f"{path} does not begin with vertices; expected a point cloud")
    last = elements[1] if len(elements) > 1 else len(header)
    properties = [line.split() for line in header[elements[0] + 1 : last]]
    fields = [(words[-1], words[1]) for words in properties if words[0] == "property"]
    missing = {name for name, _ in PROPERTIES} - {name for name, _ in fields}
    unreadable = [kind for _, kind in fields if kind not in NUMPY_TYPES]
    if missing or unreadable:
        raise ValueError(
            f"{path} lacks {sorted(missing)} or has properties of type {unreadable}; "
            "expected a cloud written by write_ply"
        )
    count = int(header[elements[0]].split()[2])
    return count, np.dtype([(name, NUMPY_TYPES[kind]) for name, kind in fields])
