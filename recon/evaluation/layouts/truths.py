"""True disparities and masks from files, and which pixels both cameras see."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image as Pictures

from recon.types import Array

__all__ = [
    "TRUTH_FACTORS",
    "check_size",
    "disparity_from_levels",
    "read_levels",
    "read_mask",
    "seen_by_both",
    "size_of",
]

TRUTH_FACTORS = (1, 2, 4)
"""How many times larger than the images a truth from another folder may be."""

DEEP = 16
"""Bits a pixel of pictures with more than 8."""

ROUNDING_PX = 1e-5
"""Of float32 differences between disparities that were stored in thirds of a pixel."""


def size_of(values: Array) -> tuple[int, int]:
    """Return (width, height) of an image or a map (H, W, ...)."""
    return values.shape[1], values.shape[0]


def check_size(
    path: Path, values: Array, size: tuple[int, int], *, factors: tuple[int, ...] = (1,)
) -> None:
    """Raise ValueError unless a map has the size it should have.

    Args:
        path: of the file it was read from.
        values: (H, W).
        size: (width, height) that is expected.
        factors: it may also be this many times as large, exactly.
    """
    sizes = [(factor * size[0], factor * size[1]) for factor in factors]
    if size_of(values) not in sizes:
        came, expected = (
            " or ".join(f"{width} x {height}" for width, height in some)
            for some in ([size_of(values)], sizes)
        )
        raise ValueError(
            f"{path} is {came} pixels, expected {expected} (width x height); "
            "is it of the same scene and resolution?"
        )


def read_levels(path: Path, *, bits: int) -> Array:
    """Read the numbers that a grey picture stores.

    Args:
        path: PNG, PGM or PPM, also of three equal channels.
        bits: of a pixel, 8 or 16.

    Returns:
        (H, W) uint8 or uint16, not scaled.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is damaged, shows colours or has pixels of other bits.
    """
    try:
        with Pictures.open(path) as found:
            deep = found.mode.startswith("I")
            channels = np.asarray(found if deep else found.convert("RGB"))
    except FileNotFoundError:
        raise
    except (OSError, SyntaxError) as error:  # as Pillow says that a file is damaged
        raise ValueError(f"{path} cannot be read: {error}; was the copy interrupted?") from error
    if deep != (bits == DEEP):
        came = DEEP if deep else 8
        raise ValueError(f"{path} has {came} bits a pixel, expected {bits}; was it converted?")
    if deep:
        return channels.astype(np.uint16)
    if (channels != channels[..., :1]).any():
        raise ValueError(
            f"{path} shows colours, expected grey levels; is it a picture for people to look at?"
        )
    return np.asarray(channels[..., 0])


def disparity_from_levels(levels: Array, *, levels_per_px: float) -> Array:
    """Return disparities that were stored as multiples of a fraction of a pixel, 0 if unknown.

    Args:
        levels: (H, W), whole numbers.
        levels_per_px: how many levels one pixel of disparity is.

    Returns:
        (H, W) float32 pixels, NaN where unknown.
    """
    known = levels > 0
    return np.where(known, levels / levels_per_px, np.nan).astype(np.float32)


def read_mask(path: Path, size: tuple[int, int]) -> Array:
    """Read a mask.

    Args:
        path: of a picture of 8 bits.
        size: (width, height) that is expected.

    Returns:
        (H, W) uint8 levels.

    Raises:
        ValueError: if it is damaged or of another size.
    """
    levels = read_levels(path, bits=8)
    check_size(path, levels, size)
    return levels


def seen_by_both(left: Array, right: Array, *, tolerance_px: float = 1.0) -> Array:
    """Return where both cameras see the point, by comparing the true disparities of both views.

    With x' the pixel nearest to x - d_L(x), pixel x counts if |d_L(x) - d_R(x')| <= tolerance.
    With a tolerance of 1 px this gives the mask that Middlebury publishes of Motorcycle (version
    3, quarter size), pixel for pixel. Where x' lies beyond the border, or the right truth is
    unknown there, the pixel does not count.

    Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI
    30(2) 2008, section 2.6.

    Args:
        left: (H, W) true disparities of the left view in pixels, NaN where unknown.
        right: (H, W), likewise, indexed by the pixels of the right view.
        tolerance_px: larger takes more pixels as seen by both.

    Returns:
        (H, W) bool; False where the left truth is unknown.
    """
    rows, columns = np.indices(left.shape)
    known = np.isfinite(left)
    partner = np.rint(columns - np.where(known, left, 0)).astype(np.intp)
    inside = known & (partner >= 0) & (partner < left.shape[1])
    difference = np.abs(left - right[rows, np.where(inside, partner, 0)])
    seen: Array = inside & (difference <= tolerance_px + ROUNDING_PX)
    return seen
