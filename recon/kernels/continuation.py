"""Values for holes, from the planes beside them: along colours, or seen in 16 directions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, prange
from recon.kernels.holes import STEPS

__all__ = ["Continuation", "along_colours", "from_directions_alike"]

ROUNDS = 3
"""Sweeps down and up again; two reach every pixel, the third shortens ways round corners."""
STEP = 0.001
"""What a pixel of the way costs beside its change of colour: the nearer of two that look alike."""
DOUBT = 0.2
"""What it costs to begin where the confidence is 0."""
CONTRADICTED = 20.0
"""What it costs if the other grid has a smaller value where this one would be."""
BLUR = 0.02
"""Changes of colour far below this are noise, and tell no direction from another."""


class Continuation(NamedTuple):
    """What may go on into the holes of a view, and what speaks against it.

    Attributes:
        planes: (H, W, 3) float32, value and slopes along row and column; NaN in holes.
        confidence: (H, W) float32 in [0, 1].
        guide: (H, W, 3) float32.
        other: (H, W) float32, a second grid, whose column x - v shows what column x of the first
            shows if its value is v.
        most_rise: how far a value may differ from that beside the hole by the slopes.
        tolerance: how far above `other` a value may lie.
    """

    planes: Tensor
    confidence: Tensor
    guide: Tensor
    other: Tensor
    most_rise: float
    tolerance: float

    def arrays(self) -> tuple[Array, Array, Array, Array, float, float]:
        """Return the same for compiled loops."""
        return (
            array_of(self.planes),
            array_of(self.confidence),
            array_of(self.guide),
            array_of(self.other),
            self.most_rise,
            self.tolerance,
        )


def along_colours(offered: Continuation, holes: Tensor) -> Tensor:
    """Return for every hole the value of the plane that is reached over the least change of colour.

    The cost of a way is the sum of |I_p - I_q| over its steps, and a little for their length; it
    begins with the doubt about the pixel from which it comes, and grows where the value that it
    brings is contradicted by the other grid. Least ways are found by sweeping over the image.

    Source: Toivanen, New Geodesic Distance Transforms for Gray-Scale Images, Pattern Recognition
    Letters 17(5) 1996 (sweeps).

    Args:
        offered: planes and what speaks against them.
        holes: (H, W) bool.

    Returns:
        (H, W) float32 on the device of the planes; outside the holes the values of the planes.
    """
    planes, confidence, guide, other, most_rise, tolerance = offered.arrays()
    hole = array_of(holes)
    cost = np.where(hole, np.float32(np.inf), DOUBT * (1 - confidence)).astype(np.float32)
    rows, columns = np.mgrid[: hole.shape[0], : hole.shape[1]]
    for _ in range(ROUNDS):
        for down in (True, False):
            _sweep(planes, guide, other, most_rise, tolerance, hole, down, cost, rows, columns)
    result = planes[..., 0].copy()
    _take(planes, hole, rows, columns, most_rise, result)
    return torch.from_numpy(result).to(offered.planes.device)


def from_directions_alike(offered: Continuation, holes: Tensor) -> Tensor:
    """Return the weighted median of the planes that are seen in 16 directions.

    The weight is 1 / cost^2, of the way straight to the first pixel with a plane; see
    `along_colours`. A median, for among the pixels around a mismatch some are mismatches too.

    Args:
        offered: planes and what speaks against them.
        holes: (H, W) bool, the pixels to answer for.

    Returns:
        (H, W) float32 on the device of the planes; NaN outside the holes, and in holes that see
        no plane.
    """
    result = np.full(holes.shape, np.float32(np.nan))
    _look_around(*offered.arrays(), array_of(holes), STEPS, result)
    return torch.from_numpy(result).to(offered.planes.device)


@compiled()
def _at(plane: Array, across: int, down: int, most_rise: float) -> float:
    """Return the value of a plane some pixels away."""
    rise = plane[1] * across + plane[2] * down
    return float(plane[0] + max(-most_rise, min(most_rise, rise)))


@compiled()
def _change(one: Array, other: Array) -> float:
    """Return the sum of the differences of three channels."""
    return float(abs(one[0] - other[0]) + abs(one[1] - other[1]) + abs(one[2] - other[2]))


@compiled()
def _contradicted(value: float, x: int, other: Array, tolerance: float) -> bool:
    """Return whether the other grid has a smaller value where column `x` would lie.

    Args:
        value: of a pixel.
        x: its column.
        other: (W,), that row of the other grid.
        tolerance: how far above them is allowed.
    """
    partner = round(x - value)
    return 0 <= partner < len(other) and other[partner] < value - tolerance


@compiled()
def _sweep(  # noqa: C901, PLR0913  compiled: one nest of loops
    planes: Array, guide: Array, other: Array, most_rise: float, tolerance: float,
    holes: Array, down: bool, cost: Array, rows: Array, columns: Array,
) -> None:  # fmt: skip
    """Shorten the ways to all holes by those of the row before and the pixel before.

    Args:
        planes: see `Continuation`, and so for the next four.
        guide: (H, W, 3).
        other: (H, W).
        most_rise: of a plane.
        tolerance: of a contradiction.
        holes: (H, W) bool.
        down: begin at the top left, else at the bottom right.
        cost: (H, W), of the way to each pixel; changed.
        rows: (H, W), where its plane comes from; changed.
        columns: (H, W), likewise.
    """
    height, width = holes.shape
    back = -1 if down else 1
    for step_y in range(height):
        y = step_y if down else height - 1 - step_y
        for step_x in range(width):
            x = step_x if down else width - 1 - step_x
            if not holes[y, x]:
                continue
            for move in range(4):  # the pixel before, then three of the row before
                from_y = y if move == 0 else y + back
                from_x = x + back if move == 0 else x + move - 2
                if not (0 <= from_y < height and 0 <= from_x < width):
                    continue
                way = cost[from_y, from_x]
                if not way < cost[y, x]:
                    continue
                length = 1.0 if move in (0, 2) else 1.4142
                way += STEP * length + _change(guide[y, x], guide[from_y, from_x])
                row, column = rows[from_y, from_x], columns[from_y, from_x]
                value = _at(planes[row, column], x - column, y - row, most_rise)
                if _contradicted(value, x, other[y], tolerance):
                    way += CONTRADICTED
                if way < cost[y, x]:
                    cost[y, x], rows[y, x], columns[y, x] = way, row, column


@compiled(parallel=True)
def _take(
    planes: Array, holes: Array, rows: Array, columns: Array, most_rise: float, result: Array
) -> None:
    """Fill the holes of `result` with the planes from where their ways come."""
    height, width = holes.shape
    for y in prange(height):
        for x in range(width):
            if holes[y, x]:
                row, column = rows[y, x], columns[y, x]
                result[y, x] = _at(planes[row, column], x - column, y - row, most_rise)


@compiled(parallel=True)
def _look_around(  # noqa: PLR0913  compiled
    planes: Array, confidence: Array, guide: Array, other: Array, most_rise: float,
    tolerance: float, holes: Array, steps: Array, result: Array,
) -> None:  # fmt: skip
    """Fill `result` in the holes."""
    height, width = holes.shape
    for y in prange(height):
        values, weights = np.zeros(len(steps), np.float32), np.zeros(len(steps), np.float32)
        for x in range(width):
            if not holes[y, x]:
                continue
            count = 0
            for i in range(len(steps)):
                row, column, way = _first_plane(planes, guide, (np.int64(y), np.int64(x)), steps[i])
                if row < 0:
                    continue
                value = _at(planes[row, column], x - column, y - row, most_rise)
                way += DOUBT * (1 - confidence[row, column])
                if _contradicted(value, x, other[y], tolerance):
                    way += CONTRADICTED
                values[count], weights[count] = value, 1 / (BLUR + way) ** 2
                count += 1
            if count:
                result[y, x] = _weighted_median(values[:count], weights[:count])


@compiled()
def _first_plane(
    planes: Array, guide: Array, start: tuple[int, int], step: Array
) -> tuple[int, int, float]:
    """Return row and column of the first plane in a direction, and the cost of the way there.

    The row is -1 if there is none.
    """
    height, width = planes.shape[:2]
    before_y, before_x = start
    way = 0.0
    for n in range(1, height + width):
        y, x = start[0] + round(n * step[0]), start[1] + round(n * step[1])
        if not (0 <= y < height and 0 <= x < width):
            break
        way += STEP + _change(guide[y, x], guide[before_y, before_x])
        if not np.isnan(planes[y, x, 0]):
            return y, x, way
        before_y, before_x = y, x
    return -1, -1, way


@compiled()
def _weighted_median(values: Array, weights: Array) -> float:
    """Return the value at which half of the weight is reached."""
    half, below = weights.sum() / 2, 0.0
    order = np.argsort(values)
    for i in order:
        below += weights[i]
        if below >= half:
            return float(values[i])
    return float(values[order[-1]])
