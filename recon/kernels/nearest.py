"""How far points on one grid of rays are from the nearest point on another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from recon.kernels.compiled import Array, compiled, prange

__all__ = ["PointGrid", "nearest_distances"]

TILE = 8
"""Rows and columns of a tile, a power of 2; tiles that are too far are left out as a whole."""


@dataclass(frozen=True, eq=False)
class PointGrid:
    """Points on rays from one place, at most one a ray.

    The ray of cell (x, y) holds the point z ((x - cx) / f, (y - cy) / f, 1).

    Attributes:
        depths: (H, W) float32, z > 0; NaN where a ray holds no point.
        focal: f, in cells.
        centre: (cx, cy) in cells; (0, 0) is the middle of the first.
    """

    depths: Array
    focal: float
    centre: tuple[float, float]


class _Tiles(NamedTuple):
    """A grid cut into squares.

    Attributes:
        points: (rows, columns, 3, TILE * TILE) float32 coordinates; +inf from the last point on.
        boxes: (rows, columns, 2, 3) float32, least and greatest coordinates of the points of a
            tile; +inf and -inf, which is infinitely far from everything, if it holds none.
        focal: f, in cells.
        cx: in cells.
        cy: in cells.
    """

    points: Array
    boxes: Array
    focal: float
    cx: float
    cy: float


def nearest_distances(asked: PointGrid, points: PointGrid, *, limit: float, step: int) -> Array:
    """Return how far every asked point is from the nearest of `points`, exactly up to a limit.

    Let q = z (u, v, 1) be asked for. Every point on a ray (u', v', 1) is at least as far from q
    as the plane of all rays with that u', which is z |u' - u| / sqrt(1 + u'^2), and likewise for
    v'. A ray at least s away in u or in v, with a the larger of |u| and |v|, is therefore no
    nearer than z s / sqrt(1 + (a + s)^2), which grows with s. Tiles of cells are visited in
    square rings round q, until this bound for the next ring reaches the least distance so far (at
    first, the limit). Of a ring only tiles whose bounding box is nearer than that are opened.

    Args:
        asked: the points to answer for.
        points: those that may be the nearest, all of them; seen from the same place in the same
            direction, on a grid of any fineness.
        limit: how far to look, as a share of the depth of an asked point; time grows with its
            square where nothing is near.
        step: asks for every `step`-th row and column only; time falls with its square.

    Returns:
        (ceil(H / step), ceil(W / step)) float32, in the unit of the depths; NaN where nothing is
        asked, +inf where no point is nearer than the limit.
    """
    tiles = _cut(points)
    depths = np.ascontiguousarray(asked.depths[::step, ::step])
    across, down = (
        ((np.arange(0, count, step) - centre) / asked.focal).astype(np.float32)
        for count, centre in zip(asked.depths.shape[::-1], asked.centre, strict=True)
    )
    result = np.full(depths.shape, np.nan, np.float32)
    _search(depths, across, down, tiles, limit, result)
    return result


def _cut(grid: PointGrid) -> _Tiles:
    """Gather the points of every tile."""
    rows, columns = (-(-count // TILE) for count in grid.depths.shape)
    tiles = _Tiles(
        np.full((rows, columns, 3, TILE * TILE), np.inf, np.float32),
        np.full((rows, columns, 2, 3), np.inf, np.float32),
        float(grid.focal),
        float(grid.centre[0]),
        float(grid.centre[1]),
    )
    height, width = grid.depths.shape
    across = ((np.arange(width) - tiles.cx) / tiles.focal).astype(np.float32)
    down = ((np.arange(height) - tiles.cy) / tiles.focal).astype(np.float32)
    _gather(grid.depths, across, down, tiles)
    return tiles


@compiled(parallel=True)
def _gather(depths: Array, across: Array, down: Array, tiles: _Tiles) -> None:
    """Fill the points and boxes of `tiles`.

    Args:
        depths: (H, W).
        across: (W,), u of every column.
        down: (H,), v of every row.
        tiles: without points yet.
    """
    height, width = depths.shape
    for row in prange(tiles.points.shape[0]):
        for column in range(tiles.points.shape[1]):
            points, box = tiles.points[row, column], tiles.boxes[row, column]
            n = 0
            for y in range(row * TILE, min((row + 1) * TILE, height)):
                for x in range(column * TILE, min((column + 1) * TILE, width)):
                    z = depths[y, x]
                    if not np.isnan(z):
                        points[0, n], points[1, n], points[2, n] = across[x] * z, down[y] * z, z
                        n += 1
            for axis in range(3):
                least, most = np.float32(np.inf), np.float32(-np.inf)
                for m in range(n):
                    least, most = min(least, points[axis, m]), max(most, points[axis, m])
                box[0, axis], box[1, axis] = least, most


@compiled(parallel=True)
def _search(  # noqa: C901  compiled: one nest of loops
    depths: Array, across: Array, down: Array, tiles: _Tiles, limit: float, result: Array
) -> None:
    """Fill `result`, of the shape of `depths`; `across` and `down` are u and v of its cells."""
    rows, columns = tiles.points.shape[:2]
    for i in prange(depths.shape[0]):
        v = down[i]
        y_cell = tiles.cy + tiles.focal * v
        row = min(max(int(y_cell) // TILE, 0), rows - 1)
        squares = np.zeros(TILE * TILE, np.float32)
        for j in range(depths.shape[1]):
            z = depths[i, j]
            if np.isnan(z):
                continue
            u = across[j]
            x_cell = tiles.cx + tiles.focal * u
            column = min(max(int(x_cell) // TILE, 0), columns - 1)
            x, y, slope = u * z, v * z, max(abs(u), abs(v))
            farthest = np.float32((limit * z) ** 2)
            best = farthest
            for ring in range(max(rows, columns)):
                if ring > 0:
                    cells = min(
                        x_cell - ((column - ring + 1) * TILE - 1),
                        (column + ring) * TILE - x_cell,
                        y_cell - ((row - ring + 1) * TILE - 1),
                        (row + ring) * TILE - y_cell,
                    )
                    s = max(cells, 0.0) / tiles.focal
                    if (z * s) ** 2 >= best * (1 + (slope + s) ** 2):
                        break
                for r in range(max(row - ring, 0), min(row + ring + 1, rows)):
                    stride = 1 if abs(r - row) == ring else 2 * ring
                    for c in range(column - ring, column + ring + 1, max(stride, 1)):
                        if 0 <= c < columns and _to_box(tiles.boxes[r, c], x, y, z) < best:
                            best = min(best, _to_points(tiles.points[r, c], x, y, z, squares))
            result[i, j] = np.sqrt(best) if best < farthest else np.inf


@compiled()
def _to_box(box: Array, x: float, y: float, z: float) -> float:
    """Return the squared distance of a point from a box; 0 inside."""
    zero = np.float32(0.0)
    dx = max(box[0, 0] - x, x - box[1, 0], zero)
    dy = max(box[0, 1] - y, y - box[1, 1], zero)
    dz = max(box[0, 2] - z, z - box[1, 2], zero)
    square: float = dx * dx + dy * dy + dz * dz
    return square


@compiled()
def _to_points(points: Array, x: float, y: float, z: float, squares: Array) -> float:
    """Return the least squared distance of a point from (3, N) others; fill `squares` (N,).

    The minimum is taken half against half: a running one cannot be computed eight at a time.
    """
    for n in range(TILE * TILE):
        dx, dy, dz = points[0, n] - x, points[1, n] - y, points[2, n] - z
        squares[n] = dx * dx + dy * dy + dz * dz
    half = TILE * TILE // 2
    while half:
        for n in range(half):
            squares[n] = min(squares[n], squares[n + half])
        half //= 2
    least: float = squares[0]
    return least
