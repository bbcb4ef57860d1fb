"""Volumes in which every pixel has layers of its own: a band of neighbouring ones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from recon.kernels.bilateral import SMALLEST_WEIGHT, weight_tables
from recon.kernels.compiled import Array, compiled, prange
from recon.kernels.minimum import Minimum
from recon.kernels.scanlines import BAND, FAR, PathCosts, step_of_path

__all__ = [
    "Bands",
    "add_doubt",
    "distances_in_bands",
    "lowest_in_bands",
    "means_in_bands",
    "paths_in_bands",
    "valleys_in_bands",
]


class Bands(NamedTuple):
    """Which layers each pixel has; the values of all are one row, (K,), pixel after pixel.

    Attributes:
        first: (H, W) int32, the lowest layer.
        size: (H, W) int32, how many there are; 0 for none.
        start: (H, W) int64, where in the row the first one is.
    """

    first: Array
    size: Array
    start: Array

    @classmethod
    def holding(cls, first: Array, size: Array) -> Bands:
        """Return bands from the lowest layers and how many there are, each (H, W)."""
        ends = np.cumsum(size, dtype=np.int64).reshape(size.shape)
        return cls(first.astype(np.int32), size.astype(np.int32), ends - size.astype(np.int64))

    @property
    def total(self) -> int:
        """K."""
        return int(self.size.sum(dtype=np.int64))

    @property
    def extent(self) -> tuple[int, int]:
        """The lowest layer of all, and how many layers there are from it to the highest."""
        there = self.size > 0
        if not there.any():
            return 0, 0
        lowest = int(self.first[there].min())
        return lowest, int((self.first + self.size)[there].max()) - lowest

    def rows(self, part: slice) -> Bands:
        """Return the bands of some rows, which still say where they are in the row of all."""
        return Bands(self.first[part], self.size[part], self.start[part])


def distances_in_bands(reference: Array, other: Array, bands: Bands, result: Array) -> None:
    """Write one minus the scalar product of vectors, at the shifts of each pixel's band.

    It compares reference[y, x] with other[y, x - shift]; every such column must exist.

    Args:
        reference: (H, W, C) float32, of length 1 at most along C.
        other: (H, W, C), likewise.
        bands: of the H rows.
        result: (K,) float32, of at least these rows, written in place.
    """
    _distances(reference, other, *bands, result)


def means_in_bands(
    values: Array,
    guide: Array,
    bands: Bands,
    *,
    radius: int,
    sigma_space: float,
    sigma_colour: float,
) -> Array:
    """Return bilateral means layer by layer, over the neighbours that have the layer.

    See `recon.kernels.bilateral.bilateral_mean`.

    Args:
        values: (K,) float32.
        guide: (H, W, 3) uint8.
        bands: of the pixels.
        radius: neighbours up to this far in x and in y, pixels.
        sigma_space: pixels.
        sigma_colour: distance of colours in [0, 1].

    Returns:
        (K,).
    """
    near, alike = weight_tables(radius, sigma_space, sigma_colour)
    space = (near[:, None] * near).numpy()
    result = np.zeros_like(values)
    planes = np.ascontiguousarray(np.moveaxis(guide, 2, 0))
    _means(values, planes, space, alike.numpy(), *bands, result)
    return result


def add_doubt(values: Array, expected: Array, bands: Bands, *, most: float, reach: float) -> None:
    """Add most * min(((k - e) / reach)^2, 1) to the value of every layer k, in place.

    Args:
        values: (K,) float32.
        expected: (H, W) float32, e of each pixel; nothing is added where it is NaN.
        bands: of the pixels.
        most: what is added far away.
        reach: layers.
    """
    _add_doubt(values, expected, *bands, np.float32(most), np.float32(reach))


def paths_in_bands(values: Array, guide: Array, bands: Bands, costs: PathCosts) -> Array:
    """Sum the costs of the best paths to every cell along rows and columns.

    A path steps between layers as in `recon.kernels.scanlines.path_sums`, from those that the pixel
    before has; where it has none, the path begins.

    Args:
        values: (K,) float32, finite.
        guide: (H, W) float32.
        bands: of the pixels.
        costs: see `PathCosts`.

    Returns:
        (K,).
    """
    total = np.zeros_like(values)
    lowest, layers = bands.extent
    if layers == 0:
        return total
    small, large, edge, across = (np.float32(cost) for cost in costs)
    pays = small, large, edge, across
    _along_rows(values, guide, *bands, lowest, layers, *pays, total)
    _down(values, guide, *bands, lowest, layers, *pays, total)
    upside_down = bands.rows(slice(None, None, -1))
    _down(values, guide[::-1], *upside_down, lowest, layers, *pays, total)
    return total


def lowest_in_bands(values: Array, bands: Bands) -> Array:
    """Return the layer of the lowest value of every pixel, (H, W) int64.

    Args:
        values: (K,) float32.
        bands: of the pixels.

    Returns:
        The first of equals; 0 where a pixel has no layer.
    """
    result = np.zeros(bands.first.shape, np.int64)
    _lowest(values, *bands, result)
    return result


def valleys_in_bands(values: Array, layers: Array, bands: Bands) -> Minimum:
    """Return the values around a layer of every pixel, as if it were that of the lowest.

    Args:
        values: (K,) float32.
        layers: (H, W) int64.
        bands: of the pixels.

    Returns:
        What is beside a layer is no less than its value; +inf where there is none. No rivals.
    """
    found = np.full((4, *layers.shape), np.inf, np.float32)
    _valleys(values, layers, *bands, found)
    return Minimum(torch.from_numpy(layers), *torch.from_numpy(found))


@compiled(parallel=True)
def _distances(
    reference: Array, other: Array, first: Array, count: Array, start: Array, result: Array
) -> None:
    """Fill `result`."""
    height, width, channels = reference.shape
    for y in prange(height):
        for x in range(width):
            own, line = reference[y, x], _part(result, start[y, x], count[y, x])
            partner = x - first[y, x]
            for k in range(len(line)):
                theirs = other[y, partner - k]
                product = np.float32(0.0)
                for c in range(channels):
                    product += own[c] * theirs[c]
                line[k] = max(np.float32(0.0), np.float32(1.0) - product)


@compiled(parallel=True)
def _means(  # noqa: PLR0913  compiled
    values: Array, planes: Array, space: Array, alike: Array,
    first: Array, count: Array, start: Array, result: Array,
) -> None:  # fmt: skip
    """Fill `result`."""
    height, width = first.shape
    radius, most = space.shape[0] // 2, count.max()
    for y in prange(height):
        total, norm = np.zeros(most, np.float32), np.zeros(most, np.float32)
        for x in range(width):
            low, high = first[y, x], first[y, x] + count[y, x]
            red, green, blue = planes[0, y, x], planes[1, y, x], planes[2, y, x]
            for k in range(high - low):
                total[k], norm[k] = np.float32(0.0), np.float32(0.0)
            for row in range(max(0, y - radius), min(height, y + radius + 1)):
                for column in range(max(0, x - radius), min(width, x + radius + 1)):
                    weight = (
                        space[row - y + radius, column - x + radius]
                        * alike[abs(np.int64(planes[0, row, column]) - np.int64(red))]
                        * alike[abs(np.int64(planes[1, row, column]) - np.int64(green))]
                        * alike[abs(np.int64(planes[2, row, column]) - np.int64(blue))]
                    )
                    theirs = first[row, column]
                    begin, end = max(low, theirs), min(high, theirs + count[row, column])
                    if weight < SMALLEST_WEIGHT or end <= begin:
                        continue
                    there = _part(values, start[row, column] + begin - theirs, end - begin)
                    _add(there, weight, _part(total, begin - low, end - begin),
                         _part(norm, begin - low, end - begin))  # fmt: skip
            line = _part(result, start[y, x], high - low)
            for k in range(len(line)):
                line[k] = total[k] / norm[k]


@compiled()
def _part(values: Array, start: int, count: int) -> Array:
    """Return `count` values from `start` on."""
    return values[start : start + count]


@compiled()
def _clear(line: Array, layer: int, count: int) -> None:
    """Forget what was written into a line of path costs."""
    line[layer + 1 : layer + 1 + count] = FAR


@compiled()
def _add(values: Array, weight: float, total: Array, norm: Array) -> None:
    """Add a neighbour's layers."""
    for k in range(len(values)):
        total[k] += weight * values[k]
        norm[k] += weight


@compiled(parallel=True)
def _add_doubt(  # noqa: PLR0913  compiled
    values: Array, expected: Array, first: Array, count: Array, start: Array,
    most: float, reach: float,
) -> None:  # fmt: skip
    """Add to `values`."""
    height, width = first.shape
    for y in prange(height):
        for x in range(width):
            if np.isnan(expected[y, x]):
                continue
            line = _part(values, start[y, x], count[y, x])
            above = np.float32(first[y, x]) - expected[y, x]
            for k in range(len(line)):
                off = (above + np.float32(k)) / reach
                line[k] += most * min(off * off, np.float32(1.0))


@compiled(parallel=True, finite=True)
def _along_rows(  # noqa: PLR0913  compiled
    values: Array, guide: Array, first: Array, count: Array, start: Array, lowest: int, layers: int,
    small: float, large: float, edge: float, across: float, total: Array,
) -> None:  # fmt: skip
    """Add the paths from the left and from the right.

    The costs of a path lie in lines of all layers, `FAR` where the pixel has none.
    """
    height, width = first.shape
    nothing = np.zeros(layers + 2, np.float32)
    for y in prange(height):
        before = np.full(layers + 2, FAR, np.float32)
        here = np.full(layers + 2, FAR, np.float32)
        for begin, end, way in ((0, width, 1), (width - 1, -1, -1)):
            least = np.float32(0.0)
            for x in range(begin, end, way):
                came = count[y, x - way] if x != begin else 0
                pays = large
                if came and abs(guide[y, x] - guide[y, x - way]) >= edge:
                    pays = large * across
                low, high = first[y, x] - lowest, first[y, x] - lowest + count[y, x]
                if high > low:
                    least = step_of_path(
                        _part(values, start[y, x], high - low),
                        _part(before if came else nothing, low, high - low + 2),
                        least if came else np.float32(0.0), small, pays,
                        _part(here, low, high - low + 2),
                        _part(total, start[y, x], high - low),
                    )  # fmt: skip
                if came:
                    _clear(before, first[y, x - way] - lowest, came)
                before, here = here, before
            _clear(before, first[y, end - way] - lowest, count[y, end - way])


@compiled(parallel=True, finite=True)
def _down(  # noqa: PLR0913  compiled
    values: Array, guide: Array, first: Array, count: Array, start: Array, lowest: int, layers: int,
    small: float, large: float, edge: float, across: float, total: Array,
) -> None:  # fmt: skip
    """Add the paths from above; a band of columns is followed by one thread."""
    height, width = first.shape
    nothing = np.zeros(layers + 2, np.float32)
    for band in prange((width + BAND - 1) // BAND):
        before = np.full((BAND, layers + 2), FAR, np.float32)
        here = np.full((BAND, layers + 2), FAR, np.float32)
        least = np.zeros(BAND, np.float32)
        for y in range(height):
            for i in range(min(BAND, width - band * BAND)):
                x = band * BAND + i
                came = count[y - 1, x] if y else 0
                pays = large
                if came and abs(guide[y, x] - guide[y - 1, x]) >= edge:
                    pays = large * across
                low, high = first[y, x] - lowest, first[y, x] - lowest + count[y, x]
                if high > low:
                    least[i] = step_of_path(
                        _part(values, start[y, x], high - low),
                        _part(before[i] if came else nothing, low, high - low + 2),
                        least[i] if came else np.float32(0.0), small, pays,
                        _part(here[i], low, high - low + 2),
                        _part(total, start[y, x], high - low),
                    )  # fmt: skip
                if came:
                    _clear(before[i], first[y - 1, x] - lowest, came)
            before, here = here, before


@compiled(parallel=True)
def _lowest(values: Array, first: Array, count: Array, start: Array, result: Array) -> None:
    """Fill `result`."""
    height, width = first.shape
    for y in prange(height):
        for x in range(width):
            if count[y, x]:
                line = _part(values, start[y, x], count[y, x])
                result[y, x] = first[y, x] + np.argmin(line)


@compiled(parallel=True)
def _valleys(
    values: Array, layers: Array, first: Array, count: Array, start: Array, found: Array
) -> None:
    """Fill `found` (4, H, W): value, before, after; the last stays."""
    height, width = first.shape
    for y in prange(height):
        for x in range(width):
            line = _part(values, start[y, x], count[y, x])
            here = layers[y, x] - first[y, x]
            if not 0 <= here < len(line):
                continue
            found[0, y, x] = line[here]
            if here > 0:
                found[1, y, x] = max(line[here - 1], line[here])
            if here + 1 < len(line):
                found[2, y, x] = max(line[here + 1], line[here])
