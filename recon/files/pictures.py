"""Pictures of disparities, depths and states, with what is needed to read them."""

from __future__ import annotations

import math
import os

import numpy as np
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from recon.colours import STATUS_COLOURS, colour_mapped, colour_range, status_colours
from recon.files.images import encoded
from recon.files.writing import atomic
from recon.types import Array

__all__ = ["write_depth_png", "write_disparity_png", "write_status_png"]

PAPER = (250, 250, 248)
INK = (40, 40, 44)
FURTHEST_DEPTH_MM = 65535


def write_disparity_png(
    path: str | os.PathLike[str],
    values: Array,
    *,
    lowest: float | None = None,
    highest: float | None = None,
) -> None:
    """Draw disparities in colours, with a bar that says how many pixels a colour means.

    Args:
        path: of the file to write.
        values: (H, W) disparities in pixels; NaN (missing) is dark grey.
        lowest: disparity of the first colour; the 1st percentile if not given.
        highest: disparity of the last colour; the 99th percentile if not given.
    """
    usual = colour_range(values)
    lowest = usual[0] if lowest is None else lowest
    highest = usual[1] if highest is None else highest
    bar = _colour_bar(values.shape[0], lowest, highest)
    picture = np.concatenate([colour_mapped(values, lowest, highest), bar], axis=1)
    _write_png(path, picture)


def write_depth_png(path: str | os.PathLike[str], depth: Array) -> int:
    """Write depths as 16-bit millimetres, the form that depth cameras and Open3D use.

    Args:
        path: of the file to write.
        depth: (H, W) metres, NaN where there is none.

    Returns:
        How many depths were out of range (below 0.5 mm or beyond 65.535 m); like missing ones,
        they are 0 in the file.
    """
    present = np.isfinite(depth)
    millimetres = np.rint(np.where(present, depth, 0).astype(np.float64) * 1000)
    in_range = (millimetres >= 1) & (millimetres <= FURTHEST_DEPTH_MM)
    _write_png(path, np.where(in_range, millimetres, 0).astype(np.uint16))
    return int((present & ~in_range).sum())


def write_status_png(path: str | os.PathLike[str], status: Array) -> None:
    """Draw the state of every pixel, with a legend of names and shares below.

    Args:
        path: of the file to write.
        status: (H, W) uint8, a `PixelStatus`.
    """
    height, width = status.shape
    legend = _legend(status)
    picture = np.full((height + legend.shape[0], legend.shape[1], 3), PAPER, np.uint8)
    picture[:height, :width] = status_colours(status)
    picture[height:] = legend
    _write_png(path, picture)


def _write_png(path: str | os.PathLike[str], picture: Array) -> None:
    contents = encoded(picture, ".png")
    with atomic(path) as partial:
        partial.write_bytes(contents)


def _text_size(extent: int) -> int:
    """Return a height of letters that can be read beside an image of this extent, in pixels."""
    return max(11, round(extent / 40))


def _colour_bar(height: int, lowest: float, highest: float) -> Array:
    """Draw a vertical bar with tick labels in pixels, (height, W, 3)."""
    size = _text_size(height)
    font = ImageFont.load_default(size)
    values = _ticks(lowest, highest, at_most=max(2, height // (3 * size)))
    decimals = max(0, -math.floor(math.log10(values[1] - values[0]))) if len(values) > 1 else 1
    labels = [f"{value:.{decimals}f} px" for value in values]
    thickness, gap = 2 * size, size // 2
    width = 3 * gap + thickness + math.ceil(max(font.getlength(label) for label in labels))

    paper = np.full((height, width + gap, 3), PAPER, np.uint8)
    margin = min(size, height // 4)
    steps = np.linspace(highest, lowest, max(1, height - 2 * margin))
    column = colour_mapped(steps[:, None], lowest, highest)
    paper[margin : margin + len(steps), gap : gap + thickness] = column
    picture = Pictures.fromarray(paper)
    draw = ImageDraw.Draw(picture)
    for value, label in zip(values, labels, strict=True):
        y = margin + (highest - value) / (highest - lowest) * (len(steps) - 1)
        draw.line((gap + thickness, y, gap + thickness + gap // 2, y), fill=INK)
        draw.text((2 * gap + thickness, y), label, fill=INK, font=font, anchor="lm")
    return np.asarray(picture)


def _ticks(lowest: float, highest: float, *, at_most: int) -> list[float]:
    """Return round numbers between two limits, 1, 2 or 5 times a power of ten apart."""
    power = 10 ** math.floor(math.log10((highest - lowest) / at_most))
    steps = (power * factor for factor in (1, 2, 5, 10, 20))
    step = next(step for step in steps if (highest - lowest) / step < at_most)
    first = math.ceil(lowest / step)
    ticks = [number * step for number in range(first, math.floor(highest / step) + 1)]
    return ticks or [(lowest + highest) / 2]


def _legend(status: Array) -> Array:
    """Draw the names, colours and shares of the states that occur, (H, W, 3).

    W is that of `status`, or what the longest name needs.
    """
    size = _text_size(status.shape[1] * 2 // 3)
    font = ImageFont.load_default(size)
    counts = np.bincount(status.ravel(), minlength=256)
    labels = {
        state: f"{state.name.lower().replace('_', ' ')} {counts[state] / status.size:.1%}"
        for state in STATUS_COLOURS
        if counts[state]
    }
    extents = {
        state: math.ceil(font.getlength(label)) + 3 * size for state, label in labels.items()
    }
    width = max(status.shape[1], max(extents.values()))

    corners, x, row = {}, size, 0
    for state, extent in extents.items():
        if x > size and x + extent - size > width:
            x, row = size, row + 1
        corners[state] = (x, 2 * size * row + size // 2)
        x += extent

    picture = Pictures.new("RGB", (width, 2 * size * (row + 1)), PAPER)
    draw = ImageDraw.Draw(picture)
    for state, (left, top) in corners.items():
        draw.rectangle((left, top, left + size, top + size), fill=STATUS_COLOURS[state])
        middle = (left + 3 * size // 2, top + size // 2)
        draw.text(middle, labels[state], fill=INK, font=font, anchor="lm")
    return np.asarray(picture)
