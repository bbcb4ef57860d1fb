"""Planes through the neighbourhood of every pixel that end where the values jump."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled, prange

__all__ = ["plane_slopes"]

RIDGE = 0.1
"""Added to the moments of a fit, square pixels: neighbours in one line leave the slope across it 0.
A whole window of 3 x 3 has moments of 6, so it costs a small window 2 % of its slope, a large none.
"""


def plane_slopes(values: Array, *, radii: tuple[int, ...], edge: float, tolerance: float) -> Array:
    """Fit a plane, v = v0 + sx dx + sy dy, to the neighbours of every pixel on its own surface.

    Neighbours are reached from the pixel without a step above `edge`: down or up its column, then
    along each row (the cross-based region of Zhang, Lu & Lafruit, IEEE TCSVT 19(7), 2009). The fit
    is least squares. It is made again in a larger window with those neighbours that are
    within `tolerance` of the plane before, so that a bend or a stray value does not tilt it.

    Args:
        values: (H, W) float32; NaN is missing.
        radii: of the windows, (2 radius + 1)^2 pixels, from the first to the last fit.
        edge: largest step between direct neighbours of one surface, in the unit of the values.
        tolerance: largest distance of a member from the plane before; the first fit, which has
            none before it, takes what it reaches.

    Returns:
        (H, W, 2) float32, (sx, sy) in the unit of the values a pixel; 0 for a pixel without
        neighbours, NaN where `values` is.
    """
    border = max(radii)
    padded = np.pad(values.astype(np.float32), border, constant_values=np.nan)
    slopes = np.zeros((*values.shape, 2), np.float32)
    _fill_slopes(padded, np.array(radii), np.float32(edge), np.float32(tolerance), slopes)
    slopes[np.isnan(values)] = np.nan
    return slopes


@compiled(parallel=True)
def _fill_slopes(padded: Array, radii: Array, edge: float, tolerance: float, slopes: Array) -> None:
    """Fill `slopes` (H, W, 2), row by row; `padded` has a border of NaN on every side."""
    height, width = slopes.shape[:2]
    border = (padded.shape[0] - height) // 2
    for y in prange(height):
        slope = np.zeros((2, width), np.float32)
        for number in range(len(radii)):
            allowed = tolerance if number > 0 else np.float32(np.inf)
            sums = _window_sums(padded, y + border, radii[number], edge, allowed, slope)
            _solve(sums, slope)
        slopes[y, :, 0], slopes[y, :, 1] = slope[0], slope[1]


@compiled()
def _window_sums(
    padded: Array, y: int, radius: int, edge: float, allowed: float, slope: Array
) -> Array:
    """Sum over the members of the window of every pixel of a row.

    Returns:
        (9, W): n, and the sums of dx, dy, v, dx dx, dx dy, dy dy, dx v, dy v, where dx, dy and v
        count from the pixel.
    """
    width = slope.shape[1]
    border = (padded.shape[1] - width) // 2
    centre = padded[y, border : border + width]
    sums = np.zeros((9, width), np.float32)
    row = np.zeros((5, width), np.float32)
    reached = np.zeros(width, np.bool_)
    predicted = np.zeros(width, np.float32)
    for step in (-1, 1):
        reached[:] = True
        for away in range(0 if step > 0 else 1, radius + 1):
            dy = np.float32(step * away)
            line = padded[y + step * away]
            before = padded[y + step * (away - 1 if away else 0), border : border + width]
            for x in range(width):
                reached[x] &= abs(line[border + x] - before[x]) <= edge
                predicted[x] = centre[x] + slope[1, x] * dy
            _sum_line(line, radius, edge, allowed, reached, predicted, slope[0], row)
            for x in range(width):
                n, of_x, of_v = row[0, x], row[1, x], row[2, x] + row[0, x] * slope[1, x] * dy
                sums[0, x] += n
                sums[1, x] += of_x
                sums[2, x] += n * dy
                sums[3, x] += of_v
                sums[4, x] += row[3, x]
                sums[5, x] += of_x * dy
                sums[6, x] += n * dy * dy
                sums[7, x] += row[4, x] + of_x * slope[1, x] * dy
                sums[8, x] += of_v * dy
    return sums


@compiled()
def _sum_line(  # noqa: PLR0913  compiled: everything is an argument
    line: Array,
    radius: int,
    edge: float,
    allowed: float,
    start: Array,
    predicted: Array,
    slope: Array,
    row: Array,
) -> None:
    """Fill `row` (5, W): n, and the sums of dx, v, dx dx, dx v over the members in one line.

    Args:
        line: (W + 2 border,) values.
        radius: how far to go to both sides.
        edge: largest step.
        allowed: largest distance from the plane.
        start: (W,) whether the middle of the line was reached.
        predicted: (W,) value of the plane in the middle of the line; v counts from it.
        slope: (W,) of the plane along the line.
        row: what is filled.
    """
    width = len(start)
    border = (len(line) - width) // 2
    reached = np.zeros(width, np.bool_)
    zero, one = np.float32(0.0), np.float32(1.0)
    for x in range(width):
        v = line[border + x] - predicted[x]
        member = start[x] & (abs(v) <= allowed)
        row[0, x] = one if member else zero
        row[2, x] = v if member else zero
        row[1, x] = row[3, x] = row[4, x] = zero
    for step in (-1, 1):
        reached[:] = start
        for away in range(1, radius + 1):
            dx = np.float32(step * away)
            here = line[border + step * away :][:width]
            before = line[border + step * (away - 1) :][:width]
            for x in range(width):
                reached[x] &= abs(here[x] - before[x]) <= edge
                v = here[x] - predicted[x]
                member = reached[x] & (abs(v - slope[x] * dx) <= allowed)
                rise = v if member else zero
                row[0, x] += one if member else zero
                row[1, x] += dx if member else zero
                row[2, x] += rise
                row[3, x] += dx * dx if member else zero
                row[4, x] += dx * rise


@compiled()
def _solve(sums: Array, slope: Array) -> None:
    """Set `slope` (2, W) to that of the plane of least squares; the offset v0 is free."""
    for x in range(slope.shape[1]):
        n = max(sums[0, x], np.float32(1.0))
        xx = sums[4, x] - sums[1, x] * sums[1, x] / n + np.float32(RIDGE)
        xy = sums[5, x] - sums[1, x] * sums[2, x] / n
        yy = sums[6, x] - sums[2, x] * sums[2, x] / n + np.float32(RIDGE)
        xv = sums[7, x] - sums[1, x] * sums[3, x] / n
        yv = sums[8, x] - sums[2, x] * sums[3, x] / n
        determinant = xx * yy - xy * xy
        slope[0, x] = (yy * xv - xy * yv) / determinant
        slope[1, x] = (xx * yv - xy * xv) / determinant
