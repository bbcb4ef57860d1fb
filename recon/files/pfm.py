"""Portable float maps: one header, then float32 rows from the bottom up."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np

from recon.files.writing import atomic
from recon.types import Array

__all__ = ["read_pfm", "write_pfm"]

HEADER = re.compile(rb"(P[fF])\s+(\d+)\s+(\d+)\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)[ \t\r]*\n")


def read_pfm(path: str | os.PathLike[str]) -> Array:
    """Read a map of one channel, such as a disparity map of Middlebury or ETH3D.

    The sign of the scale in the header gives the byte order; its size is not applied, as is usual
    for disparities.

    Args:
        path: of the file.

    Returns:
        (H, W) float32, top row first; NaN where the file has an infinite value (unknown).

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not a PFM, has three channels, or ends too early.
    """
    contents = Path(path).read_bytes()
    header = HEADER.match(contents)
    if header is None:
        raise ValueError(f"{path} is not a PFM: it begins with {contents[:8]!r}, expected b'Pf'")
    kind, width, height, scale = header.groups()
    if kind == b"PF":
        raise ValueError(
            f"{path} is a colour PFM; expected one channel ('Pf'), such as a disparity"
        )
    if int(width) < 1 or int(height) < 1 or float(scale) == 0:
        raise ValueError(
            f"{path} is {int(width)} x {int(height)} pixels with scale {float(scale):g}; "
            "all must differ from 0"
        )
    size = 4 * int(width) * int(height)
    body = contents[header.end() :]
    if len(body) < size:
        raise ValueError(
            f"{path} ends too early: {int(width)} x {int(height)} pixels need {size} bytes, it "
            f"has {len(body)}; was the copy interrupted?"
        )
    order = "<f4" if float(scale) < 0 else ">f4"
    rows = np.frombuffer(body[:size], order).reshape(int(height), int(width))[::-1]
    values = rows.astype(np.float32)
    values[np.isinf(values)] = np.nan
    return values


def write_pfm(path: str | os.PathLike[str], values: Array, *, big_endian: bool = False) -> None:
    """Write a map of one channel; NaN (missing) becomes +inf, as Middlebury has it.

    Args:
        path: of the file to write.
        values: (H, W), top row first.
        big_endian: the byte order of the file, for old readers.

    Raises:
        ValueError: if `values` is not (H, W).
    """
    if values.ndim != 2:
        raise ValueError(f"a PFM of one channel is (H, W), got {values.shape}")
    height, width = values.shape
    rows = np.where(np.isnan(values), np.inf, values)[::-1]
    header = f"Pf\n{width} {height}\n{'1.0' if big_endian else '-1.0'}\n".encode("ascii")
    with atomic(path) as partial:
        partial.write_bytes(header + rows.astype(">f4" if big_endian else "<f4").tobytes())
