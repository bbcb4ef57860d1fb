"""The geometry of a pair, read or nominal, and the disparities to search."""

from __future__ import annotations

import math
from pathlib import Path

from calib.formats import CalibrationRecord, read_calibration
from calib.rig import RectifiedGeometry

__all__ = ["disparities_by_width", "nominal_geometry", "read_geometry", "rectified"]

NOMINAL_BASELINE_M = 0.1


def read_geometry(path: Path, size: tuple[int, int]) -> tuple[RectifiedGeometry, range | None]:
    """Read the calibration of rectified images, and the disparities it suggests.

    Args:
        path: of a file in any format of `calib.formats`.
        size: (width, height) of the images.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is damaged, of other images, or of raw images only.
    """
    record = read_calibration(path, image_size=size)
    return rectified(record), record.disparities


def rectified(record: CalibrationRecord) -> RectifiedGeometry:
    """Return the geometry of the rectified images, or raise ValueError if there is none."""
    if record.rectified is None:
        raise ValueError(
            f"{record.source} describes raw images, but data sets hold rectified ones; "
            "is it the calibration of another step?"
        )
    return record.rectified


def nominal_geometry(size: tuple[int, int]) -> RectifiedGeometry:
    """Return a geometry for images without calibration: depths in it mean nothing.

    Args:
        size: (width, height) of the images in pixels.
    """
    middle = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    return RectifiedGeometry(size, float(size[0]), middle, middle, NOMINAL_BASELINE_M)


def disparities_by_width(width: int, *, share: float = 0.25) -> range:
    """Return disparities from 0 to a share of the width, for pairs of which nothing is known.

    Args:
        width: of the images in pixels.
        share: of the width; more finds nearer things, and costs time and false matches.
    """
    return range(math.ceil(share * width))
