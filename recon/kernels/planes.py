"""Planes through the neighbourhood of every pixel that end where the values jump."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled, prange

__all__ = ["plane_slopes"]

RIDGE = 0.1
"""Added to the moments of a fit, square pixels: neighbours in one line leave the slope across it 0.
A whole window of 3 x 3 has moments of 6, so it costs a small window 2 % of its slope, a large none.
"""


def plane_slopes(values: Array, *, radii: tuple[int, ...], edge: float, noise: float) -> Array:
    """Fit a plane, v = v0 + sx dx + sy dy, to the neighbours of every pixel on its own surface.

    Neighbours are those that are reached from the pixel without a step above `edge`: up or down
    its column, then along each row. The fit is least squares, in the largest window that a plane
    still explains: it grows from one radius to the next while the root mean square of the residuals
    is at most `noise`, so that it is wide on a plane and ends at a bend.

    Source: the neighbours are the cross-based region of Zhang, Lu & Lafruit, IEEE TCSVT 19(7),
    2009, and their sums along rows are differences of running sums, as there.

    Args:
        values: (H, W) float32; NaN is missing.
        radii: of the windows, (2 radius + 1)^2 pixels, in rising order; time grows with their sum.
        edge: largest step between direct neighbours of one surface, in the unit of the values.
        noise: residuals that say nothing of the shape of a surface; raising it smooths more.

    Returns:
        (H, W, 2) float32, (sx, sy) in the unit of the values a pixel; 0 for a pixel without
        neighbours, NaN where `values` is.
    """
    values = values.astype(np.float32)
    slopes = np.zeros((*values.shape, 2), np.float32)
    growing = np.ones(values.shape, np.bool_)
    for number, radius in enumerate(radii):
        border = ((radius, radius), (0, 0))
        lines = np.zeros((6, values.shape[0] + 2 * radius, values.shape[1]), np.float32)
        _sum_lines(values, radius, np.float32(edge), lines[:, radius:-radius])
        padded = np.pad(values, border, constant_values=np.nan)
        most = np.float32(noise if number else np.inf)
        _grow(padded, lines, np.float32(edge), most, (growing, slopes))
    slopes[np.isnan(values)] = np.nan
    return slopes


@compiled(parallel=True)
def _sum_lines(values: Array, radius: int, edge: float, lines: Array) -> None:
    """Sum over the neighbours of every pixel that are reached along its row.

    Args:
        values: (H, W).
        radius: how far to go to both sides.
        edge: largest step.
        lines: filled with (6, H, W) n, and the sums of dx, v, dx dx, dx v, v v, where dx and v
            count from the pixel.
    """
    height, width = values.shape
    for y in prange(height):
        line = values[y]
        running = np.zeros((3, width + 1), np.float64)  # of v, x v and v v
        for x in range(width):
            v = float(line[x]) if not np.isnan(line[x]) else 0.0
            running[0, x + 1] = running[0, x] + v
            running[1, x + 1] = running[1, x] + x * v
            running[2, x + 1] = running[2, x] + v * v
        begin = 0  # of the run of small steps that holds x
        end = 0
        for x in range(width):
            v = float(line[x])
            if np.isnan(v):
                continue
            if x == 0 or not abs(line[x] - line[x - 1]) <= edge:
                begin = x
            if end <= x:
                end = x + 1
                while end < width and abs(line[end] - line[end - 1]) <= edge:
                    end += 1
            low, high = max(begin, x - radius), min(end, x + radius + 1)
            a, b = x - low, high - 1 - x
            n = a + b + 1
            of_x = (b * (b + 1) - a * (a + 1)) / 2
            of_v = running[0, high] - running[0, low]
            of_xv = running[1, high] - running[1, low] - x * of_v
            of_vv = running[2, high] - running[2, low]
            lines[0, y, x] = n
            lines[1, y, x] = of_x
            lines[2, y, x] = of_v - n * v
            lines[3, y, x] = (b * (b + 1) * (2 * b + 1) + a * (a + 1) * (2 * a + 1)) / 6
            lines[4, y, x] = of_xv - of_x * v
            lines[5, y, x] = of_vv - 2 * v * of_v + n * v * v


@compiled(parallel=True)
def _grow(
    padded: Array,
    lines: Array,
    edge: float,
    most: float,
    found: tuple[Array, Array],
) -> None:
    """Fit planes in windows of one size and keep those that a plane explains.

    Args:
        padded: (H + 2 radius, W) values, NaN above and below.
        lines: (6, H + 2 radius, W) of `_sum_lines`.
        edge: largest step.
        most: largest root mean square of the residuals.
        found: (H, W) whether a window has grown so far, and (H, W, 2) slopes; both are changed.
    """
    growing, slopes = found
    height, width = growing.shape
    radius = (padded.shape[0] - height) // 2
    for y in prange(height):
        sums = _window_sums(padded, lines, y + radius, radius, edge)
        for x in range(width):
            n = max(sums[0, x], np.float32(1.0))
            xx = sums[4, x] - sums[1, x] * sums[1, x] / n + np.float32(RIDGE)
            xy = sums[5, x] - sums[1, x] * sums[2, x] / n
            yy = sums[6, x] - sums[2, x] * sums[2, x] / n + np.float32(RIDGE)
            xv = sums[7, x] - sums[1, x] * sums[3, x] / n
            yv = sums[8, x] - sums[2, x] * sums[3, x] / n
            vv = sums[9, x] - sums[3, x] * sums[3, x] / n
            determinant = xx * yy - xy * xy
            sx = (yy * xv - xy * yv) / determinant
            sy = (xx * yv - xy * xv) / determinant
            residual = np.sqrt(max(vv - sx * xv - sy * yv, np.float32(0.0)) / n)
            growing[y, x] &= residual <= most
            if growing[y, x]:
                slopes[y, x, 0], slopes[y, x, 1] = sx, sy


@compiled()
def _window_sums(padded: Array, lines: Array, y: int, radius: int, edge: float) -> Array:
    """Sum over the members of the window of every pixel of a row.

    Returns:
        (10, W): n, and the sums of dx, dy, v, dx dx, dx dy, dy dy, dx v, dy v, v v, where dx, dy
        and v count from the pixel.
    """
    width = padded.shape[1]
    sums = np.zeros((10, width), np.float32)
    reached = np.zeros(width, np.bool_)
    centre = padded[y]
    for step in (-1, 1):
        reached[:] = True
        for away in range(0 if step > 0 else 1, radius + 1):
            dy = np.float32(step * away)
            row = y + step * away
            here, before = padded[row], padded[row - step] if away else padded[row]
            for x in range(width):
                reached[x] &= abs(here[x] - before[x]) <= edge
                n = lines[0, row, x] if reached[x] else np.float32(0.0)
                of_x = lines[1, row, x] if reached[x] else np.float32(0.0)
                rise = here[x] - centre[x] if reached[x] else np.float32(0.0)
                of_own_v = lines[2, row, x] if reached[x] else np.float32(0.0)
                of_v = of_own_v + n * rise
                sums[0, x] += n
                sums[1, x] += of_x
                sums[2, x] += n * dy
                sums[3, x] += of_v
                sums[4, x] += lines[3, row, x] if reached[x] else np.float32(0.0)
                sums[5, x] += of_x * dy
                sums[6, x] += n * dy * dy
                sums[7, x] += (lines[4, row, x] if reached[x] else np.float32(0.0)) + of_x * rise
                sums[8, x] += of_v * dy
                sums[9, x] += (lines[5, row, x] if reached[x] else np.float32(0.0)) + rise * (
                    of_own_v + of_v
                )
    return sums
