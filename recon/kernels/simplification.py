"""Fewer triangles for a surface over a grid, with a bound on what is lost."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled
from recon.kernels.outline import COVERED, Cell, outline_stays

__all__ = ["simplified"]

Limits = tuple[float, float, float]

FINEST = np.finfo(np.float32).tiny
"""Stands for a tolerance of 0, by which nothing can be divided."""

MOST_NEIGHBOURS = 48
"""A vertex with more stays for this round; what surrounds it goes first."""

STAGES = (0.25, 0.5, 1.0)
"""Shares of the tolerance, in turn: what is nearly flat goes before what is barely so."""

LEAST_GAIN = 0.003
"""A round that removes less than this share of the vertices is the last one of its stage."""


def simplified(
    heights: Array, faces: Array, *, tolerance: float | Array, border: float, shift: float
) -> Array:
    """Remove vertices as long as every one that was there stays near the surface.

    A vertex is removed together with its faces, and the polygon that they leave is filled with a
    fan from the corner of it that gives the least error. The error is that of every cell of the
    grid under the new triangles, |height - plane| / tolerance, not only that of the vertex, so it
    does not add up. Vertices round a removed one wait for the next round, which spreads what is
    left.

    The outline only ever shrinks: corners that stick out are cut, notches are not filled, so no
    gap is ever bridged. Every cell cut off stays within `border` cells of the outline, and its
    height within `tolerance` of that of the nearest place on it. Neighbouring triangles share
    whole edges before and after, so there are no cracks.

    A picture that is laid on the surface by its corners is interpolated evenly in space, but was
    taken evenly in cells, at a distance of 1 / height. Along an edge of L cells from height g to h
    it is therefore off by as much as L |sqrt(g) - sqrt(h)| / (sqrt(g) + sqrt(h)) cells; edges for
    which that is more than `shift` are not made.

    Source: vertex removal, Schroeder, Zarge & Lorensen, Decimation of triangle meshes, SIGGRAPH
    1992; the error over a height field, Garland & Heckbert, CMU-CS-95-181, 1995.

    Args:
        heights: (H, W) float32; finite and positive at every vertex.
        faces: (F, 3) int32 indices of cells in row order, counter-clockwise as images are
            looked at, not overlapping.
        tolerance: largest error of a height, one for all or (H, W), finite at every vertex;
            raising it removes more. 0 removes what is exactly flat.
        border: largest distance of a vertex that was there from the outline, in cells.
        shift: farthest that a picture on the surface may be off, in cells.

    Returns:
        (G, 3) int32 like `faces`, of the vertices that are left.
    """
    cells = heights.size
    heights = np.ascontiguousarray(heights, np.float32)
    spread = np.maximum(np.broadcast_to(tolerance, heights.shape).astype(np.float32), FINEST)
    state = np.zeros(heights.shape, np.uint8)
    state.ravel()[faces.ravel()] = COVERED
    faces = faces.copy()
    for share in STAGES:
        settled = np.zeros(cells, np.uint8)
        while len(faces):
            limits = share, min(border, 1.0), shift
            left, removed = _round(heights, spread, faces, state, settled, limits)
            vertices = len(faces) // 2
            faces = left
            if removed <= LEAST_GAIN * vertices:
                break
    return faces


@compiled()
def _incidence(faces: Array, cells: int) -> tuple[Array, Array]:
    """Return where the faces of each cell begin, (cells + 1,), in a list of faces, (3 F,)."""
    begin = np.zeros(cells + 1, np.int32)
    for face in range(faces.shape[0]):
        for corner in range(3):
            begin[faces[face, corner] + 1] += 1
    for cell in range(cells):
        begin[cell + 1] += begin[cell]
    place = begin[:-1].copy()
    of_cell = np.zeros(3 * faces.shape[0], np.int32)
    for face in range(faces.shape[0]):
        for corner in range(3):
            cell = faces[face, corner]
            of_cell[place[cell]] = face
            place[cell] += 1
    return begin, of_cell


@compiled()
def _round(  # noqa: C901  compiled: one loop
    heights: Array, spread: Array, faces: Array, state: Array, settled: Array, limits: Limits
) -> tuple[Array, int]:
    """Try to remove every vertex once, none beside another.

    Args:
        heights: (H, W).
        spread: (H, W), what errors of heights are divided by.
        faces: (F, 3); changed.
        state: (H, W) whether a cell is covered, or lost at the outline; changed.
        settled: (H W,) not to be tried again, as nothing changed round it; changed.
        limits: of these errors, of the outline and of shifts.

    Returns:
        The faces that are left, and how many vertices were removed.
    """
    most, border, shift = limits
    width = heights.shape[1]
    begin, of_cell = _incidence(faces, heights.size)
    waits = np.zeros(heights.size, np.uint8)
    gone = np.zeros(faces.shape[0], np.uint8)
    ring = np.zeros(MOST_NEIGHBOURS + 1, np.int32)
    removed = 0
    for cell in range(heights.size):
        count = begin[cell + 1] - begin[cell]
        if count == 0 or waits[cell] or settled[cell]:
            continue
        mine = of_cell[begin[cell] : begin[cell + 1]]
        corners, closed = _ring(faces, mine, cell, ring)
        if corners == 0:
            continue
        if corners == 2 and (waits[ring[0]] or waits[ring[1]]):
            continue
        apex = _best_fan(heights, spread, ring[:corners], most, shift) if corners > 2 else 0
        fits = apex >= 0
        if fits and corners == 2:
            fits = _shared(faces, of_cell, begin, ring[0], ring[1], mine[0])
        if fits and not closed:
            ends = _at(ring[0], width), _at(cell, width), _at(ring[corners - 1], width)
            fits = _shift(heights, ring[0], ring[corners - 1]) <= shift and outline_stays(
                heights, spread, state, ends, most, border
            )
        if not fits:
            settled[cell] = 1
            continue
        for step in range(corners - 2):
            faces[mine[step], 0] = ring[apex]
            faces[mine[step], 1] = ring[(apex + step + 1) % corners]
            faces[mine[step], 2] = ring[(apex + step + 2) % corners]
        for step in range(max(corners - 2, 0), count):
            gone[mine[step]] = 1
        for step in range(corners):
            waits[ring[step]] = 1
            settled[ring[step]] = 0
        removed += 1
    left = faces[gone == 0]
    return left, removed


@compiled()
def _ring(  # noqa: C901  compiled: one nest of loops
    faces: Array, mine: Array, cell: int, ring: Array
) -> tuple[int, bool]:
    """Put the neighbours of a vertex into `ring`, in the order of its faces.

    Returns:
        How many there are, 0 if they are too many or the faces meet here only with their tips;
        and whether they go all the way round.
    """
    count = mine.shape[0]
    if count > MOST_NEIGHBOURS:
        return 0, False
    first = -1
    for i in range(count):  # the face that no other one leads to begins; any one if all are led to
        after, led_to = _next(faces[mine[i]], cell), False
        for j in range(count):
            led_to |= _previous(faces[mine[j]], cell) == after
        if not led_to:
            if first >= 0:
                return 0, False
            first = i
    closed = first < 0
    ring[0] = _next(faces[mine[max(first, 0)]], cell)
    for step in range(count):
        found = -1
        for i in range(count):
            if _next(faces[mine[i]], cell) == ring[step]:
                found = _previous(faces[mine[i]], cell)
        if found < 0 or (found == ring[0] and step < count - 1):
            return 0, False
        ring[step + 1] = found
    return (count if closed else count + 1), closed


@compiled()
def _next(face: Array, cell: int) -> int:
    """Return the corner after `cell`."""
    place = 1 if face[0] == cell else 2 if face[1] == cell else 0
    corner: int = face[place]
    return corner


@compiled()
def _previous(face: Array, cell: int) -> int:
    """Return the corner before `cell`."""
    place = 2 if face[0] == cell else 0 if face[1] == cell else 1
    corner: int = face[place]
    return corner


@compiled()
def _at(cell: int, width: int) -> Cell:
    """Return the (column, row) of a cell."""
    return cell % width, cell // width


@compiled()
def _shared(
    faces: Array, of_cell: Array, begin: Array, one: int, other: int, except_for: int
) -> bool:
    """Return whether another face has the edge between two vertices."""
    for place in range(begin[one], begin[one + 1]):
        face = of_cell[place]
        if face != except_for:
            for corner in range(3):
                if faces[face, corner] == other:
                    return True
    return False


@compiled()
def _best_fan(heights: Array, spread: Array, ring: Array, most: float, shift: float) -> int:
    """Return from which corner a fan fills a polygon with the least error; -1 if from none."""
    best, least, corners = -1, most, len(ring)
    for apex in range(corners):
        worst = 0.0
        for step in range(2, corners - 1):
            if _shift(heights, ring[apex], ring[(apex + step) % corners]) > shift:
                worst = np.inf
        for step in range(1, corners - 1):
            if worst > least:
                break
            error = _worst_under(
                heights,
                spread,
                ring[apex],
                ring[(apex + step) % corners],
                ring[(apex + step + 1) % corners],
                least,
            )
            worst = max(worst, error)
        if worst <= least and (best < 0 or worst < least):
            best, least = apex, worst
    return best


@compiled()
def _shift(heights: Array, a: int, b: int) -> float:
    """Return how far a picture is off along the edge between two cells; see `simplified`."""
    width = heights.shape[1]
    x, y = a % width - b % width, a // width - b // width
    one = np.sqrt(np.float64(heights[a // width, a % width]))
    other = np.sqrt(np.float64(heights[b // width, b % width]))
    far: float = np.sqrt(x * x + y * y) * abs(one - other) / (one + other)
    return far


@compiled()
def _worst_under(heights: Array, spread: Array, a: int, b: int, c: int, limit: float) -> float:
    """Return the largest |height - plane| / spread under a triangle; past `limit` it stops.

    A triangle that has no area, or lies the wrong way round, has an infinite error.
    """
    width = heights.shape[1]
    ax, ay, bx, by, cx, cy = a % width, a // width, b % width, b // width, c % width, c // width
    ux, uy, vx, vy = bx - ax, by - ay, cx - ax, cy - ay
    area = uy * vx - ux * vy  # twice; positive if counter-clockwise on the screen
    if area <= 0:
        return np.inf
    height = np.float64(heights[ay, ax])
    hu, hv = heights[by, bx] - height, heights[cy, cx] - height
    along_x, along_y = (uy * hv - vy * hu) / area, (vx * hu - ux * hv) / area
    worst = 0.0
    for y in range(min(ay, by, cy), max(ay, by, cy) + 1):
        low, high = min(ax, bx, cx), max(ax, bx, cx)
        low, high = _clipped(low, high, (ax, ay), (bx, by), y)
        low, high = _clipped(low, high, (bx, by), (cx, cy), y)
        low, high = _clipped(low, high, (cx, cy), (ax, ay), y)
        plane = height + along_y * (y - ay)
        for x in range(low, high + 1):
            error = abs(heights[y, x] - plane - along_x * (x - ax))
            worst = max(worst, error / spread[y, x])
        if worst > limit:
            break
    return worst


@compiled()
def _clipped(low: int, high: int, p: Cell, q: Cell, y: int) -> tuple[int, int]:
    """Narrow columns low..high of row y to the inner side of the edge from p to q.

    Inside is (q - p) x (r - p) <= 0, that is (qx - px) (y - py) <= (qy - py) (x - px).
    """
    across, down = (q[0] - p[0]) * (y - p[1]), q[1] - p[1]
    if down > 0:
        low = max(low, p[0] - (-across // down))  # x >= px + across / down, rounded up
    elif down < 0:
        high = min(high, p[0] + (-across) // (-down))  # x <= px + across / down, rounded down
    elif across > 0:
        high = low - 1
    return low, high
