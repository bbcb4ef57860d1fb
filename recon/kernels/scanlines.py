"""Sums of the cheapest paths that reach every cell of a volume along straight lines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["BAND", "FAR", "PathCosts", "path_sums", "step_of_path"]

BAND = 16
"""Neighbouring lines that one thread follows together: they share pieces of memory."""

FAR = np.float32(1e30)
"""Beyond the first and the last layer; far above every cost, and still finite."""


class PathCosts(NamedTuple):
    """What a path pays on its way.

    Attributes:
        small: for a step of one layer.
        large: for any longer step.
        edge: difference of the guide from which an edge begins.
        across: share of `large` that is paid across an edge.
    """

    small: float
    large: float
    edge: float
    across: float


def path_sums(volume: Tensor, guide: Tensor, costs: PathCosts, *, directions: int) -> Tensor:
    """Sum the costs of the best paths to every cell from several directions.

    The path along r that ends in layer k of pixel p costs

    L_r(p, k) = V(p, k) + min(L_r(p - r, k), L_r(p - r, k - 1) + P1, L_r(p - r, k + 1) + P1,
    min_i L_r(p - r, i) + P2) - min_i L_r(p - r, i)

    with P1 = `small`, and P2 = `large`, or less across an edge of the guide. The result is the sum
    over r.

    Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI
    30(2) 2008, section 2.3, equations (13) and (14).

    Args:
        volume: (H, W, D) float32; +inf is missing, and counts as the highest of the others.
        guide: (H, W) float32.
        costs: see `PathCosts`.
        directions: 8, or 4 without the diagonals.

    Returns:
        (H, W, D) float32 on the device of `volume`; +inf where that is.
    """
    if on_cpu(volume):
        return _sums_by_threads(volume, guide, costs, directions)
    missing = volume.isinf()
    if missing.all():
        return volume.clone()
    highest = float(torch.where(missing, -torch.inf, volume).max())
    result = _sums_by_lines(volume.clamp(max=highest), guide, costs, directions)
    return result.masked_fill_(missing, float("inf"))


def _sums_by_threads(volume: Tensor, guide: Tensor, costs: PathCosts, directions: int) -> Tensor:
    """Return the sums, path by path on the threads of the CPU."""
    given, lightness = array_of(volume), array_of(guide)
    highest = np.full(len(given), -np.inf, np.float32)
    _find_highest(given, highest)
    if highest.max(initial=-np.inf) == -np.inf:
        return volume.clone()
    values = np.zeros(given.shape, np.float32)
    _complete(given, highest.max(), values)
    result = torch.zeros(volume.shape)
    total = array_of(result)
    small, large, edge, across = (np.float32(cost) for cost in costs)
    pays = small, large, edge, across
    _along_rows(values, lightness, *pays, total)
    for slope in (0,) if directions == 4 else (0, 1, -1):
        _down(values, lightness, slope, *pays, total)
        _down(values[::-1], lightness[::-1], slope, *pays, total[::-1])
    _leave_missing(given, total)
    return result


@compiled(parallel=True)
def _find_highest(volume: Array, highest: Array) -> None:
    """Fill `highest` (H,) with the greatest value of each row that is not missing."""
    for y in prange(len(volume)):
        for column in volume[y]:
            for value in column:
                if highest[y] < value < np.inf:
                    highest[y] = value


@compiled(parallel=True)
def _complete(volume: Array, highest: float, complete: Array) -> None:
    """Fill `complete` with the volume, and `highest` where that is missing."""
    for y in prange(len(volume)):
        for x in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                complete[y, x, k] = min(volume[y, x, k], highest)


@compiled(parallel=True)
def _leave_missing(volume: Array, total: Array) -> None:
    """Write +inf into `total` where the volume is missing."""
    for y in prange(len(volume)):
        for x in range(volume.shape[1]):
            for k in range(volume.shape[2]):
                if volume[y, x, k] == np.inf:
                    total[y, x, k] = np.inf


def _sums_by_lines(volume: Tensor, guide: Tensor, costs: PathCosts, directions: int) -> Tensor:
    """Return the same, all paths of a direction at once, for devices with many threads."""
    result = torch.zeros_like(volume)
    across = volume.transpose(0, 1), guide.transpose(0, 1), result.transpose(0, 1)
    for slope in (0,) if directions == 4 else (0, 1, -1):
        _add_downward(volume, guide, result, slope, costs)
        _add_downward(volume.flip(0), guide.flip(0), result, slope, costs, upward=True)
    _add_downward(*across, 0, costs)
    _add_downward(across[0].flip(0), across[1].flip(0), across[2], 0, costs, upward=True)
    return result


def _add_downward(
    volume: Tensor, guide: Tensor, total: Tensor, slope: int, costs: PathCosts,
    *, upward: bool = False,
) -> None:  # fmt: skip
    """Add the paths from the first line to the last that move `slope` columns a line.

    `total` is in the order of the image: with `upward` its last line is the first of `volume`.
    """
    height, width, _ = volume.shape
    here = slice(max(0, slope), width + min(0, slope))  # columns with one before them
    there = slice(max(0, -slope), width - max(0, slope))
    before = volume[0]
    for y in range(height):
        paths = volume[y].clone()
        if y and paths[here].numel():
            edgy = (guide[y, here] - guide[y - 1, there]).abs() >= costs.edge
            large = torch.where(edgy, costs.large * costs.across, costs.large)[:, None]
            came = before[there]
            least = came.amin(1, keepdim=True)
            cheapest = torch.minimum(came, least + large)
            cheapest[:, 1:] = torch.minimum(cheapest[:, 1:], came[:, :-1] + costs.small)
            cheapest[:, :-1] = torch.minimum(cheapest[:, :-1], came[:, 1:] + costs.small)
            paths[here] += cheapest - least
        total[height - 1 - y if upward else y] += paths
        before = paths


@compiled(finite=True)
def step_of_path(  # noqa: PLR0913  compiled: called for every pixel
    costs: Array, before: Array, least: float, small: float, large: float, here: Array, total: Array
) -> float:
    """Write the path costs of one pixel into `here`, add them to `total`, return the least.

    `before` and `here` are (D + 2,): layers 0 to D - 1 with `FAR` on either side.
    """
    longest = least + large
    lowest: float = FAR
    for k in range(len(costs)):
        cheapest = before[k + 1]
        up, down = before[k] + small, before[k + 2] + small
        cheapest = up if up < cheapest else cheapest
        cheapest = down if down < cheapest else cheapest
        cheapest = longest if longest < cheapest else cheapest
        cost = costs[k] + cheapest - least
        here[k + 1] = cost
        total[k] += cost
        lowest = cost if cost < lowest else lowest
    return lowest


@compiled(parallel=True, finite=True)
def _along_rows(  # noqa: PLR0913  compiled
    volume: Array, guide: Array, small: float, large: float, edge: float, across: float,
    total: Array,
) -> None:  # fmt: skip
    """Add the paths from the left and from the right."""
    height, width, count = volume.shape
    nothing = np.zeros(count + 2, np.float32)
    for y in prange(height):
        before = np.full(count + 2, FAR, np.float32)
        here = np.full(count + 2, FAR, np.float32)
        for first, last, way in ((0, width, 1), (width - 1, -1, -1)):
            least = step_of_path(
                volume[y, first], nothing, np.float32(0), small, large, before, total[y, first]
            )
            for x in range(first + way, last, way):
                edgy = abs(guide[y, x] - guide[y, x - way]) >= edge
                pays = large * across if edgy else large
                least = step_of_path(volume[y, x], before, least, small, pays, here, total[y, x])
                before, here = here, before


@compiled(parallel=True, finite=True)
def _down(  # noqa: PLR0913  compiled
    volume: Array, guide: Array, slope: int, small: float, large: float, edge: float,
    across: float, total: Array,
) -> None:  # fmt: skip
    """Add the paths from above that move `slope` columns a row.

    A band of lines is followed from top to bottom by one thread: nobody waits for anybody.
    """
    height, width, count = volume.shape
    first = -height if slope > 0 else 0
    lines = width + (height if slope != 0 else 0)
    nothing = np.zeros(count + 2, np.float32)
    for band in prange((lines + BAND - 1) // BAND):
        before = np.full((BAND, count + 2), FAR, np.float32)
        here = np.full((BAND, count + 2), FAR, np.float32)
        least = np.zeros(BAND, np.float32)
        for y in range(height):
            for i in range(BAND):
                x = first + band * BAND + i + slope * y
                if x < 0 or x >= width:
                    continue
                source = x - slope
                if y == 0 or source < 0 or source >= width:
                    least[i] = step_of_path(
                        volume[y, x], nothing, np.float32(0), small, large, here[i], total[y, x]
                    )
                    continue
                edgy = abs(guide[y, x] - guide[y - 1, source]) >= edge
                pays = large * across if edgy else large
                least[i] = step_of_path(
                    volume[y, x], before[i], least[i], small, pays, here[i], total[y, x]
                )
            before, here = here, before
