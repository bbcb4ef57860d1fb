"""Depths of depth cameras: 16-bit images."""

from __future__ import annotations

import os

import cv2
import numpy as np

from recon.files.images import contents_of
from recon.types import Array

__all__ = ["read_depth"]


def read_depth(path: str | os.PathLike[str], *, per_metre: float = 1000.0) -> Array:
    """Read an image of depths.

    Args:
        path: PNG or TIFF with one channel of 16 bits; 0 is missing.
        per_metre: value of a depth of one metre; 1000 for millimetres, 5000 for TUM RGB-D.

    Returns:
        (H, W) float32 metres, NaN where there is no depth.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is not a 16-bit image of one channel; the message names the file.
    """
    if not per_metre > 0:
        raise ValueError(f"per_metre must be positive, got {per_metre}")
    values = cv2.imdecode(np.frombuffer(contents_of(path), np.uint8), cv2.IMREAD_UNCHANGED)
    if values is None:
        raise ValueError(f"{path} is not an image; expected depths, 16 bits and one channel")
    if values.dtype != np.uint16 or values.ndim != 2:
        channels = 1 if values.ndim == 2 else values.shape[2]
        raise ValueError(
            f"{path} has {channels} channels of {values.dtype}; expected depths, one channel of 16 "
            "bits; is it a picture of depths in colours, or the photograph?"
        )
    depth: Array = np.where(values > 0, values / np.float32(per_metre), np.nan)
    return depth.astype(np.float32)
