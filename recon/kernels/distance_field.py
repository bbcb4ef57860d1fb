"""A signed distance field in blocks of voxels, averaged over images of depths."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled, prange

__all__ = ["average_in"]

NEAREST_M = 1e-3
CERTAIN = 3.0  # standard deviations


def average_in(
    field: tuple[Array, Array, Array, Array],
    blocks: tuple[Array, Array],
    picture: tuple[Array, Array, Array, Array, Array],
    pinhole: Array,
    error: Array,
    lengths: Array,
) -> None:
    """Average one image of depths into blocks of a truncated signed distance field, in place.

    A voxel at depth z whose pixel has depth d lies s = d - z in front of the surface. Where
    |s| <= tau, with the weight w = trust / (g sigma(z))^2, g of the pixel, the field T = s / tau,
    and the colour, become (T W + w s / tau) / (W + w), and W becomes W + w. Farther in front,
    beyond tau and three standard deviations of d, the voxel is seen to be empty: it is averaged
    with T = 1. Farther behind nothing is known. Depths too uncertain to be a surface still prove
    what is empty.

    The four pixels around the projection are interpolated in 1 / d, which is linear on a plane,
    if they are within tau of each other; otherwise the nearest pixel counts.

    Source: Curless & Levoy, SIGGRAPH 1996, sections 3 and 5 (emptiness), with
    sigma(z) = a + b (z - c)^2.

    Args:
        field: T (N, B, B, B, 1), W the same, colour (N, B, B, B, 3) and how many images saw the
            surface at a voxel and the sum of their trust (N, B, B, B, 2), all float32; axes after
            the first are z, y, x.
        blocks: (M,) int64 which of the N blocks, and (M, 3) int32 their places, in blocks.
        picture: depth (H, W) float32 metres, NaN where unknown; trust (H, W) float32; g (H, W)
            float32, how many times sigma a pixel errs; whether it is a surface (H, W) bool;
            colours (H, W, 3) float32.
        pinhole: (16,) float64: the rotation row by row and the translation that carry the field
            to the frame of the picture, then fx, fy, cx, cy.
        error: (3,) float64, a, b and c of sigma(z).
        lengths: (3,) float64, side of a voxel, tau and the largest depth of a surface, metres.
    """
    _average_in(*field, *blocks, *picture, pinhole, error, lengths)


@compiled()
def _depth_at(depth: Array, u: float, v: float, most_apart: float) -> float:
    """Return the depth that a place between pixels has, NaN if its nearest pixel has none."""
    height, width = depth.shape
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    if column < 0 or row < 0 or column >= width or row >= height:
        return np.nan
    nearest = depth[row, column]
    left, top = int(np.floor(u)), int(np.floor(v))
    if not nearest > 0 or left < 0 or top < 0 or left + 1 >= width or top + 1 >= height:
        return float(nearest)
    a, b = depth[top, left], depth[top, left + 1]
    c, d = depth[top + 1, left], depth[top + 1, left + 1]
    if not (a > 0 and b > 0 and c > 0 and d > 0):
        return float(nearest)
    if max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) > most_apart:
        return float(nearest)
    p, q = u - left, v - top
    found = 1 / ((1 - q) * ((1 - p) / a + p / b) + q * ((1 - p) / c + p / d))
    return float(found)


@compiled()
def _distance_of(d: float, z: float, sigma: float, solid: bool, tau: float) -> float:
    """Return s / tau up to 1 for emptiness, NaN where a depth d says nothing of a voxel at z.

    sigma is that of d, and `solid` whether d is a surface.
    """
    s = d - z
    if not s >= -tau:
        return np.nan
    if s <= tau:
        return s / tau if solid else np.nan
    return 1.0 if s >= CERTAIN * sigma else np.nan


@compiled()
def _sigma(z: float, error: Array) -> float:
    """Return sigma(z)."""
    sigma: float = error[0] + error[1] * (z - error[2]) ** 2
    return sigma


@compiled(parallel=True)
def _average_in(  # noqa: C901, PLR0913  compiled: one loop
    values: Array,
    weights: Array,
    colours: Array,
    counts: Array,
    indices: Array,
    places: Array,
    depth: Array,
    trust: Array,
    times: Array,
    solid: Array,
    image: Array,
    pinhole: Array,
    error: Array,
    lengths: Array,
) -> None:
    side = values.shape[1]
    R, t = pinhole[:9].reshape(3, 3), pinhole[9:12]
    fx, fy, cx, cy = pinhole[12], pinhole[13], pinhole[14], pinhole[15]
    voxel, tau, farthest = lengths[0], lengths[1], lengths[2]
    for block in prange(len(indices)):
        for number in range(side**3):
            k, j, i = number // side**2, number // side % side, number % side
            px = (places[block, 0] * side + i) * voxel
            py = (places[block, 1] * side + j) * voxel
            pz = (places[block, 2] * side + k) * voxel
            z = R[2, 0] * px + R[2, 1] * py + R[2, 2] * pz + t[2]
            if z < NEAREST_M or z > farthest + tau:
                continue
            u = fx * (R[0, 0] * px + R[0, 1] * py + R[0, 2] * pz + t[0]) / z + cx
            v = fy * (R[1, 0] * px + R[1, 1] * py + R[1, 2] * pz + t[1]) / z + cy
            d = _depth_at(depth, u, v, tau)
            if np.isnan(d):
                continue
            row, column = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
            g = times[row, column]
            new = _distance_of(d, z, g * _sigma(d, error), solid[row, column], tau)
            if np.isnan(new):
                continue
            sigma = g * _sigma(z, error)
            weight = trust[row, column] / (sigma * sigma)
            at = indices[block]
            total = weights[at, k, j, i, 0] + weight
            if not total > 0:
                continue
            share = weight / total
            values[at, k, j, i, 0] += share * (new - values[at, k, j, i, 0])
            weights[at, k, j, i, 0] = total
            if new < 1:
                counts[at, k, j, i, 0] += 1
                counts[at, k, j, i, 1] += trust[row, column]
                for channel in range(3):
                    old = colours[at, k, j, i, channel]
                    colours[at, k, j, i, channel] += share * (image[row, column, channel] - old)
