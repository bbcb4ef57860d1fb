"""How far the outline of a surface over a grid may be cut back."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled

__all__ = ["COVERED", "LOST", "Cell", "outline_stays"]

Cell = tuple[int, int]
"""(column, row)."""

COVERED, LOST = 1, 2


@compiled()
def outline_stays(  # noqa: C901  compiled: one nest of loops
    heights: Array,
    spread: Array,
    state: Array,
    corners: tuple[Cell, Cell, Cell],
    most: float,
    border: float,
) -> bool:
    """Return whether a corner of the outline may be cut off, and mark the cells that this loses.

    The corner must stick out: to remove one that does not would fill a gap. Cells that were lost
    beside the two edges of the corner, and those that are lost now, have to stay within `border`
    of the new edge, and within `most` times their spread of its height there.

    Args:
        heights: (H, W).
        spread: (H, W), what errors of heights are divided by.
        state: (H, W) uint8, COVERED or LOST, 0 if it was never on the surface; changed.
        corners: the corner, in the middle, and its neighbours on the outline, the surface to the
            left on the screen when going from the first to the last.
        most: of these errors.
        border: in cells, at most 1.
    """
    p, u, q = corners
    if _side(p, q, u) > 0:
        return False
    rows = range(
        max(min(p[1], q[1], u[1]) - 1, 0), min(max(p[1], q[1], u[1]) + 2, heights.shape[0])
    )
    columns = range(
        max(min(p[0], q[0], u[0]) - 1, 0), min(max(p[0], q[0], u[0]) + 2, heights.shape[1])
    )
    for y in rows:
        for x in columns:
            if _cut_off(state[y, x], (x, y), corners, border):
                distance, share = _from_edge((x, y), p, q)
                height = (1 - share) * heights[p[1], p[0]] + share * heights[q[1], q[0]]
                if distance > border or abs(heights[y, x] - height) > most * spread[y, x]:
                    return False
    for y in rows:
        for x in columns:
            if _cut_off(state[y, x], (x, y), corners, border):
                state[y, x] = LOST
    return True


@compiled()
def _cut_off(known: int, cell: Cell, corners: tuple[Cell, Cell, Cell], border: float) -> bool:
    """Return whether a cell is lost beside the edges of a corner, or by cutting it off."""
    p, u, q = corners
    if known == LOST:
        return _from_edge(cell, p, u)[0] <= border or _from_edge(cell, u, q)[0] <= border
    return (
        known == COVERED
        and _side(p, q, cell) < 0
        and _side(p, u, cell) >= 0
        and _side(u, q, cell) >= 0
    )


@compiled()
def _side(p: Cell, q: Cell, r: Cell) -> int:
    """Return twice the area of p q r: positive if it turns clockwise on the screen."""
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


@compiled()
def _from_edge(cell: Cell, p: Cell, q: Cell) -> tuple[float, float]:
    """Return the distance of a cell from the edge p q, and at what share of it the foot lies."""
    dx, dy = q[0] - p[0], q[1] - p[1]
    share = ((cell[0] - p[0]) * dx + (cell[1] - p[1]) * dy) / (dx * dx + dy * dy)
    share = min(max(share, 0.0), 1.0)
    ex, ey = cell[0] - p[0] - share * dx, cell[1] - p[1] - share * dy
    return np.sqrt(ex * ex + ey * ey), share
