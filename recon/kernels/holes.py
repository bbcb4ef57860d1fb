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


def from_row(values: Tensor) -> Tensor:
    """Fill every hole with the smaller of what its row has on the left and on the right.

    Either side is the median of its five known pixels nearest to the hole, and a side without
    any does not count. A row without any takes the filled row nearest to it.

    Args:
        values: (H, W) float32; NaN is a hole.

    Returns:
        (H, W) float32 on the device of `values`, without NaN unless all of `values` is.
    """
    result = array_of(values).copy()
    _fill_rows(array_of(values), result)
    known = np.flatnonzero(~np.isnan(result[:, 0]))
    if len(known):
        rows = np.arange(len(result))
        after = np.searchsorted(known, rows).clip(0, len(known) - 1)
        before = (after - 1).clip(0)
        nearer = np.abs(known[before] - rows) <= np.abs(known[after] - rows)
        result = result[np.where(nearer, known[before], known[after])]
    return torch.from_numpy(result).to(values.device)


@compiled(parallel=True)
def _fill_rows(values: Array, result: Array) -> None:
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
            # A side without any is NaN, and fmin returns the other.
            result[y, start:stop] = np.fmin(left, right)
            start = stop


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
