"""Bilateral means of a volume, with weights from an image."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["LEVELS", "SMALLEST_WEIGHT", "bilateral_mean", "weight_tables"]

SMALLEST_WEIGHT = 1e-3
"""Lighter neighbours are left out: 361 of them together weigh less than half the centre."""

LEVELS = 255
TILE_ROWS, TILE_COLUMNS = 32, 64
"""A tile with its border stays in the cache of one core while its rows are visited."""


def bilateral_mean(
    volume: Tensor, guide: Tensor, *, radius: int, sigma_space: float, sigma_colour: float
) -> Tensor:
    """Return the weighted mean around every pixel, layer by layer, with weights from the guide.

    With p the pixel, q its neighbours and I the guide,
    result(p, k) = sum_q w(p, q) volume(q, k) / sum_q w(p, q) and
    w(p, q) = exp(-|p - q|^2 / 2 sigma_space^2) exp(-|I_p - I_q|^2 / 2 sigma_colour^2).
    A neighbour without a value has no weight in that layer; nor has one below 0.001.

    Source: Tomasi & Manduchi, Bilateral Filtering for Gray and Color Images, ICCV 1998.

    Args:
        volume: (H, W, D) float32; +inf is missing.
        guide: (H, W, 3) float32 in [0, 1], used in 256 levels.
        radius: neighbours up to this far in x and in y, pixels.
        sigma_space: pixels; larger smooths farther.
        sigma_colour: distance of colours; larger smooths across stronger edges.

    Returns:
        (H, W, D); +inf where `volume` has it.
    """
    levels = (guide * LEVELS).round().clamp(0, LEVELS)
    near, alike = weight_tables(radius, sigma_space, sigma_colour)
    if on_cpu(volume):
        result = torch.full_like(volume, float("inf"), memory_format=torch.contiguous_format)
        planes = array_of(levels.permute(2, 0, 1).to(torch.uint8))
        space = array_of(near[:, None] * near)
        _bilateral_mean(array_of(volume), planes, space, array_of(alike), array_of(result))
        return result
    return _bilateral_mean_by_offsets(volume, levels.long(), near, alike.to(volume.device))


def weight_tables(radius: int, sigma_space: float, sigma_colour: float) -> tuple[Tensor, Tensor]:
    """Return the factors of a weight: by the step along an axis, and by the step of a channel.

    Returns:
        (2 radius + 1,) for the steps from -radius to radius; (256,) for differences of 0 to 255.
    """
    offsets = torch.arange(-radius, radius + 1, dtype=torch.float32)
    near = torch.exp(-(offsets.square()) / (2 * sigma_space**2))
    alike = torch.exp(-((torch.arange(LEVELS + 1) / LEVELS) ** 2) / (2 * sigma_colour**2))
    return near, alike


def _bilateral_mean_by_offsets(
    volume: Tensor, levels: Tensor, near: Tensor, alike: Tensor
) -> Tensor:
    """Return the same, one neighbour of all pixels at a time, for devices with wide memory."""
    height, width, _ = volume.shape
    radius = len(near) // 2
    present = volume.isfinite()
    values = torch.where(present, volume, 0.0)
    total, weight = torch.zeros_like(volume), torch.zeros_like(volume)
    for y in range(-min(radius, height - 1), min(radius, height - 1) + 1):
        for x in range(-min(radius, width - 1), min(radius, width - 1) + 1):
            rows, columns = _overlap(height, y), _overlap(width, x)
            here, there = (rows[0], columns[0]), (rows[1], columns[1])
            weights = alike[(levels[here] - levels[there]).abs()].prod(2)
            weights = weights * (near[radius + y] * near[radius + x])
            weights = torch.where(weights < SMALLEST_WEIGHT, 0.0, weights)[:, :, None]
            total[here] += weights * values[there]
            weight[here] += weights * present[there]
    return torch.where(present, total / weight, volume)


def _overlap(length: int, offset: int) -> tuple[slice, slice]:
    """Return where i and where i + offset lie, for all i for which both are in [0, length)."""
    start, stop = max(0, -offset), min(length, length - offset)
    return slice(start, stop), slice(start + offset, stop + offset)


@compiled(parallel=True)
def _bilateral_mean(
    volume: Array, planes: Array, space: Array, alike: Array, result: Array
) -> None:
    """Fill `result`, tile by tile."""
    height, width, count = volume.shape
    complete = np.zeros((height, width), np.bool_)
    for y in prange(height):
        for x in range(width):
            complete[y, x] = _all_finite(volume[y, x])
    tiles_across = -(-width // TILE_COLUMNS)
    tiles_down = -(-height // TILE_ROWS)
    flat = volume.reshape(height * width, count)
    for tile in prange(tiles_across * tiles_down):
        top, left = tile // tiles_across * TILE_ROWS, tile % tiles_across * TILE_COLUMNS
        where = np.zeros(space.size, np.int64)
        weights = np.zeros(space.size, np.float32)
        total = np.zeros(count, np.float32)
        norm = np.zeros(count, np.float32)
        for y in range(top, min(top + TILE_ROWS, height)):
            for x in range(left, min(left + TILE_COLUMNS, width)):
                used, unused = _neighbours(planes, complete, y, x, space, alike, where, weights)
                total[:] = np.float32(0.0)
                norm[:] = _add_complete(flat, where, weights, used, total)
                _add_incomplete(flat, where, weights, unused, total, norm)
                centre, target = volume[y, x], result[y, x]
                for k in range(count):
                    target[k] = total[k] / norm[k] if centre[k] < np.inf else centre[k]


@compiled()
def _all_finite(values: Array) -> bool:
    """Return whether no value is missing."""
    for value in values:  # noqa: SIM110  compiled: a generator is not
        if not value < np.inf:
            return False
    return True


@compiled()
def _neighbours(  # noqa: PLR0913  compiled: arrays come one by one
    planes: Array,
    complete: Array,
    y: int,
    x: int,
    space: Array,
    alike: Array,
    where: Array,
    weights: Array,
) -> tuple[int, int]:
    """List the neighbours that count: complete ones from the front, the others from the back."""
    height, width = complete.shape
    radius = space.shape[0] // 2
    front, back = 0, len(where)
    red, green, blue = planes[0, y, x], planes[1, y, x], planes[2, y, x]
    for row in range(max(0, y - radius), min(height, y + radius + 1)):
        for column in range(max(0, x - radius), min(width, x + radius + 1)):
            weight = (
                space[row - y + radius, column - x + radius]
                * alike[abs(np.int64(planes[0, row, column]) - np.int64(red))]
                * alike[abs(np.int64(planes[1, row, column]) - np.int64(green))]
                * alike[abs(np.int64(planes[2, row, column]) - np.int64(blue))]
            )
            if weight < SMALLEST_WEIGHT:
                continue
            if complete[row, column]:
                where[front], weights[front] = row * width + column, weight
                front += 1
            else:
                back -= 1
                where[back], weights[back] = row * width + column, weight
    return front, back


@compiled()
def _add_complete(flat: Array, where: Array, weights: Array, used: int, total: Array) -> np.float32:
    """Add the first `used` neighbours to `total`; return the sum of their weights."""
    norm: np.float32 = np.float32(0.0)
    fours = used // 4 * 4
    for i in range(0, fours, 4):
        a, b, c, d = flat[where[i]], flat[where[i + 1]], flat[where[i + 2]], flat[where[i + 3]]
        u, v, w, z = weights[i], weights[i + 1], weights[i + 2], weights[i + 3]
        norm += u + v + w + z
        for k in range(len(total)):
            total[k] += u * a[k] + v * b[k] + w * c[k] + z * d[k]
    for i in range(fours, used):
        values, weight = flat[where[i]], weights[i]
        norm += weight
        for k in range(len(total)):
            total[k] += weight * values[k]
    return norm


@compiled()
def _add_incomplete(
    flat: Array, where: Array, weights: Array, unused: int, total: Array, norm: Array
) -> None:
    """Add the neighbours from `unused` on to `total` and `norm`, layer by layer."""
    for i in range(unused, len(where)):
        values, weight = flat[where[i]], weights[i]
        for k in range(len(total)):
            present = values[k] < np.inf
            total[k] += weight * values[k] if present else np.float32(0.0)
            norm[k] += weight if present else np.float32(0.0)
