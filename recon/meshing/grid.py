"""Which neighbouring pixels are joined to triangles."""

from __future__ import annotations

import numpy as np

from recon.types import Array

__all__ = ["grid_faces"]


def grid_faces(values: Array, kept: Array, *, depth_edge_px: float) -> Array:
    """Join neighbouring pixels of one surface into triangles.

    Four pixels in a square make two triangles, cut along the diagonal with the smaller step of
    disparity. A triangle exists only if its pixels are kept and no two of them differ by more
    than the threshold. On a plane of gradient (gx, gy) the smaller diagonal steps by
    ||gx| - |gy||, no more than the sides, so one threshold suits all three edges at any slant.

    Args:
        values: (H, W) disparities in pixels; NaN only where not kept.
        kept: (H, W) bool, the pixels that may be joined.
        depth_edge_px: largest step inside a surface; raising it bridges more.

    Returns:
        (F, 3) int32 indices of pixels in row order, counter-clockwise seen from the camera.
    """
    height, width = values.shape
    near_enough = np.where(kept, values, np.nan).astype(np.float32)
    top_left, top_right = near_enough[:-1, :-1], near_enough[:-1, 1:]
    bottom_left, bottom_right = near_enough[1:, :-1], near_enough[1:, 1:]

    falling = np.abs(top_left - bottom_right)
    rising = np.abs(top_right - bottom_left)
    joined_falling = falling <= depth_edge_px
    joined_rising = rising <= depth_edge_px
    cut_falling = joined_falling & ~(rising < falling)
    cut_rising = joined_rising & ~cut_falling
    top = np.abs(top_left - top_right) <= depth_edge_px
    bottom = np.abs(bottom_left - bottom_right) <= depth_edge_px
    left = np.abs(top_left - bottom_left) <= depth_edge_px
    right = np.abs(top_right - bottom_right) <= depth_edge_px

    corner = np.arange(height * width, dtype=np.int32).reshape(height, width)[:-1, :-1]
    a, b, c, d = 0, 1, width, width + 1  # top left, top right, bottom left, bottom right
    triangles = (
        (cut_falling & left & bottom, (a, c, d)),
        (cut_falling & top & right, (a, d, b)),
        (cut_rising & top & left, (a, c, b)),
        (cut_rising & bottom & right, (b, c, d)),
    )
    return np.concatenate(
        [corner[present][:, None] + np.array(shape, np.int32) for present, shape in triangles]
    )
