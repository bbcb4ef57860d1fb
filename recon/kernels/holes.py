"""Values for the holes of an image, from what lies around them."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, prange
from recon.kernels.median import median_of

__all__ = ["from_directions", "from_row"]

SOURCES = 5
"""Known pixels asked on either side of a hole, so that a wrong one does not make a streak."""

FIT_COLUMNS, FIT_ROWS = 25, 10
"""How far a surface beside a hole is looked at: away from the hole, and up and down."""
SAME_SURFACE = 2.0
"""Values that differ more from the one beside the hole belong to something else."""
LEAST_MEMBERS = 20
FLATNESS = 4.0
"""Squared pixels added to the spread of the members: few or narrow ones tell no slope."""

STEPS = np.array(
    [
        (
            np.sin(angle) / max(abs(np.sin(angle)), abs(np.cos(angle))),
            np.cos(angle) / max(abs(np.sin(angle)), abs(np.cos(angle))),
        )
        for angle in np.arange(16) * np.pi / 8
    ],
    dtype=np.float32,
)  # (16, 2): rows, columns per step; every step enters a new pixel


def from_row(values: Tensor, *, most_rise: float = 0.0) -> Tensor:
    """Fill every hole with the smaller of what its row has on the left and on the right.

    Either side is the median of its five known pixels nearest to the hole, and a side without
    any does not count. A row without any takes the filled row nearest to it. The surface of that
    side may go on into the hole with its slope: that of the plane that fits the known pixels of
    the same surface best, 25 columns away from the hole and 10 rows up and down.

    Args:
        values: (H, W) float32; NaN is a hole.
        most_rise: how far a value in a hole may differ from that beside it by such a slope; 0
            continues all surfaces flat.

    Returns:
        (H, W) float32 on the device of `values`, without NaN unless all of `values` is.
    """
    result = array_of(values).copy()
    _fill_rows(array_of(values), result, np.float32(most_rise))
    known = np.flatnonzero(~np.isnan(result[:, 0]))
    if len(known):
        rows = np.arange(len(result))
        after = np.searchsorted(known, rows).clip(0, len(known) - 1)
        before = (after - 1).clip(0)
        nearer = np.abs(known[before] - rows) <= np.abs(known[after] - rows)
        result = result[np.where(nearer, known[before], known[after])]
    return torch.from_numpy(result).to(values.device)


@compiled(parallel=True)
def _fill_rows(values: Array, result: Array, most_rise: float) -> None:
    """Fill the rows of `result` that have at least one known value."""
    height, width = values.shape
    for y in prange(height):
        members = np.zeros(SOURCES, np.float32)
        start = 0
        while start < width:
            if not np.isnan(values[y, start]):
                start += 1
                continue
            stop = start
            while stop < width and np.isnan(values[y, stop]):
                stop += 1
            left = _first_known(values[y, :start][::-1], members)
            right = _first_known(values[y, stop:], members)
            # A side without any is NaN, and such comparisons are false.
            from_left = left <= right or np.isnan(right)
            beside = start - 1 if from_left else stop
            level = left if from_left else right
            slope = 0.0
            if most_rise > 0 and 0 <= beside < width:
                slope, step = _slope_beside(values, y, beside, -1 if from_left else 1, level)
                level += step
            for x in range(start, stop):
                rise = slope * (x - beside)
                result[y, x] = level + max(-most_rise, min(most_rise, rise))
            start = stop


@compiled()
def _slope_beside(  # noqa: C901  compiled: one nest of loops
    values: Array, y: int, beside: int, away: int, level: float
) -> tuple[float, float]:
    """Fit a plane to the surface beside a hole.

    Args:
        values: (H, W).
        y: row of the hole.
        beside: column next to the hole.
        away: -1 or 1, the direction that leads away from the hole.
        level: value of the surface there.

    Returns:
        The slope along the row, and how far the plane is above `level` beside the hole.
    """
    height, width = values.shape
    count = 0
    sums = np.zeros(3)
    squares = np.zeros((3, 3))
    member = np.zeros(3)
    for row in range(max(0, y - FIT_ROWS), min(height, y + FIT_ROWS + 1)):
        for step in range(FIT_COLUMNS):
            column = beside + away * step
            if not 0 <= column < width:
                break
            value = values[row, column] - level
            if not abs(value) <= SAME_SURFACE:
                continue
            member[0], member[1], member[2] = column - beside, row - y, value
            count += 1
            for i in range(3):
                sums[i] += member[i]
                for j in range(3):
                    squares[i, j] += member[i] * member[j]
    if count < LEAST_MEMBERS:
        return 0.0, 0.0
    means, spread = sums / count, squares / count
    for i in range(3):
        for j in range(3):
            spread[i, j] -= means[i] * means[j]
    across, down, both = spread[0, 0] + FLATNESS, spread[1, 1] + FLATNESS, spread[0, 1]
    area = across * down - both * both
    slope = (spread[0, 2] * down - both * spread[1, 2]) / area
    tilt = (across * spread[1, 2] - both * spread[0, 2]) / area
    return slope, means[2] - slope * means[0] - tilt * means[1]


@compiled()
def _first_known(line: Array, members: Array) -> float:
    """Return the median of the first known values of `line`, as many as `members` holds."""
    count = 0
    for value in line:
        if not np.isnan(value):
            members[count] = value
            count += 1
            if count == len(members):
                break
    return median_of(members, count) if count else np.nan


def from_directions(values: Tensor, holes: Tensor) -> Tensor:
    """Return the median of the first known pixels in 16 directions.

    Source: Zbontar & LeCun, Stereo Matching by Training a Convolutional Neural Network, JMLR 17
    2016, section 4.2.

    Args:
        values: (H, W) float32; NaN is unknown.
        holes: (H, W) bool, the pixels to answer for.

    Returns:
        (H, W) float32 on the device of `values`; NaN outside the holes, and in holes that see
        no known pixel.
    """
    result = torch.full(values.shape, float("nan"))
    _look_around(array_of(values), array_of(holes), STEPS, array_of(result))
    return result.to(values.device)


@compiled(parallel=True)
def _look_around(  # noqa: C901  compiled: one nest of loops
    values: Array, holes: Array, steps: Array, result: Array
) -> None:
    """Fill `result` in the holes."""
    height, width = values.shape
    for y in prange(height):
        seen = np.zeros(len(steps), np.float32)
        for x in range(width):
            if not holes[y, x]:
                continue
            count = 0
            for i in range(len(steps)):
                for n in range(1, height + width):
                    row = y + round(n * steps[i, 0])
                    column = x + round(n * steps[i, 1])
                    if not (0 <= row < height and 0 <= column < width):
                        break
                    if not np.isnan(values[row, column]):
                        seen[count] = values[row, column]
                        count += 1
                        break
            if count:
                result[y, x] = median_of(seen, count)
