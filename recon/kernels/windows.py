"""Square windows around every pixel; the part of a window that lies outside counts nothing."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["box_mean", "census_words", "normalised_patches"]

SMALLEST_NORM = 1e-4
"""Patches with less contrast than this have no direction: their vector is zero."""


def box_mean(volume: Tensor, radius: int) -> Tensor:
    """Return the mean of the finite values in the window around every pixel, layer by layer.

    Args:
        volume: (H, W, D) float32; +inf is missing.
        radius: the window has (2 radius + 1)^2 pixels.

    Returns:
        (H, W, D); +inf where `volume` has it.
    """
    if on_cpu(volume):
        result = torch.full_like(volume, float("inf"), memory_format=torch.contiguous_format)
        _box_mean(array_of(volume), radius, array_of(result))
        return result
    present = volume.isfinite()
    layers = torch.where(present, volume, 0.0).permute(2, 0, 1)[None]
    counts = present.float().permute(2, 0, 1)[None]
    total, count = (
        torch.nn.functional.avg_pool2d(
            image, 2 * radius + 1, stride=1, padding=radius, divisor_override=1
        )[0].permute(1, 2, 0)
        for image in (layers, counts)
    )
    return torch.where(present, total / count.clamp(min=1), volume).contiguous()


@compiled(parallel=True)
def _box_mean(  # noqa: C901  compiled: one nest of loops
    volume: Array, radius: int, result: Array
) -> None:
    """Fill `result`, of the shape of `volume`: first down the columns, then along the row."""
    height, width, count = volume.shape
    for y in prange(height):
        total = np.zeros((width, count), np.float32)
        number = np.zeros((width, count), np.float32)
        for row in range(max(0, y - radius), min(height, y + radius + 1)):
            for x in range(width):
                source, sums, numbers = volume[row, x], total[x], number[x]
                for k in range(count):
                    present = source[k] < np.inf
                    sums[k] += source[k] if present else np.float32(0.0)
                    numbers[k] += np.float32(1.0) if present else np.float32(0.0)
        line = np.zeros(count, np.float32)
        members = np.zeros(count, np.float32)
        for x in range(width):
            line[:] = np.float32(0.0)
            members[:] = np.float32(0.0)
            for column in range(max(0, x - radius), min(width, x + radius + 1)):
                sums, numbers = total[column], number[column]
                for k in range(count):
                    line[k] += sums[k]
                    members[k] += numbers[k]
            centre, target = volume[y, x], result[y, x]
            for k in range(count):
                target[k] = line[k] / members[k] if centre[k] < np.inf else centre[k]


def _shifted(image: Tensor, rows: int, columns: int, *, fill: float) -> Tensor:
    """Return `result[..., y, x] = image[..., y + rows, x + columns]`, `fill` from outside."""
    height, width = image.shape[-2:]
    reach_y, reach_x = abs(rows), abs(columns)
    padded = torch.nn.functional.pad(image, (reach_x, reach_x, reach_y, reach_y), value=fill)
    top, left = reach_y + rows, reach_x + columns
    return padded[..., top : top + height, left : left + width]


def census_words(image: Tensor, rows: int, columns: int) -> tuple[Tensor, Tensor]:
    """Return one bit per neighbour: is it darker than the pixel in the middle?

    Source: Zabih & Woodfill, Non-parametric Local Transforms, ECCV 1994, section 3.2.

    Args:
        image: (H, W).
        rows: height of the window, odd.
        columns: width of the window, odd; rows * columns - 1 bits at most 63.

    Returns:
        words: (H, W) int64.
        cells: (H, W) int64, a bit for every neighbour that lies inside the image.
    """
    words = torch.zeros_like(image, dtype=torch.int64)
    cells = torch.zeros_like(words)
    offsets = [
        (y, x)
        for y in range(-(rows // 2), rows // 2 + 1)
        for x in range(-(columns // 2), columns // 2 + 1)
        if (y, x) != (0, 0)
    ]
    if on_cpu(image):
        _census_words(array_of(image), np.array(offsets), array_of(words), array_of(cells))
        return words, cells
    for bit, offset in enumerate(offsets):
        neighbour = _shifted(image, *offset, fill=float("nan"))
        words |= (neighbour < image).to(torch.int64) << bit
        cells |= (~neighbour.isnan()).to(torch.int64) << bit
    return words, cells


@compiled(parallel=True)
def _census_words(image: Array, offsets: Array, words: Array, cells: Array) -> None:
    """Fill `words` and `cells`, a bit for every one of `offsets` (N, 2)."""
    height, width = image.shape
    for y in prange(height):
        for bit in range(len(offsets)):
            row, step = y + offsets[bit, 0], offsets[bit, 1]
            if not 0 <= row < height:
                continue
            for x in range(max(0, -step), min(width, width - step)):
                darker = image[row, x + step] < image[y, x]
                words[y, x] |= np.int64(darker) << bit
                cells[y, x] |= np.int64(1) << bit


def normalised_patches(image: Tensor, radius: int, *, centred: bool) -> Tensor:
    """Return the window around every pixel as a vector of unit length.

    The scalar product of two such vectors is their normalised cross-correlation; with the mean
    taken off before, the zero-mean one.

    Args:
        image: (H, W) float32.
        radius: the window has (2 radius + 1)^2 pixels.
        centred: take the mean off first.

    Returns:
        ((2 radius + 1)^2, H, W) float32; zero for what lies outside the image, and in patches
        without contrast.
    """
    reach = range(-radius, radius + 1)
    patches = torch.stack(
        [_shifted(image, y, x, fill=float("nan")) for y in reach for x in reach]
    )  # (N, H, W)
    inside = ~patches.isnan()
    patches = torch.where(inside, patches, 0.0)
    if centred:
        mean = patches.sum(0) / inside.sum(0)
        patches = torch.where(inside, patches - mean, 0.0)
    norm = patches.norm(dim=0)
    return patches * torch.where(norm > SMALLEST_NORM, 1.0 / norm, 0.0)
