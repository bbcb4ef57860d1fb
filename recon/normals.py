"""The direction of the surface at every pixel, from the slope of its disparity."""

from __future__ import annotations

import numpy as np

from calib.rig import RectifiedGeometry
from recon.kernels.planes import plane_slopes
from recon.types import Array

__all__ = ["surface_normals"]

RADII_PX = (3, 7, 15)
"""Of the windows. On generated pairs the widest halves the error of the normals against 5 px."""

NOISE_PX = 0.3
"""Residuals of a plane that is seen as well as matching allows; with less, waves of a matched wall
are taken for its shape."""


def surface_normals(
    values: Array, geometry: RectifiedGeometry, *, depth_edge_px: float = 1.0
) -> Array:
    """Return the normal of the surface at every pixel, facing the camera.

    A plane n . P = c of points P = Z r on the rays r = ((x - cx) / f, (y - cy) / f, 1) has, with
    Z = f B / (d - d_inf), the disparities d - d_inf = (f B / c) n . r, again a plane. From its
    slopes sx and sy at a pixel, n is parallel to (sx, sy, (d - d_inf - sx (x - cx) - sy (y - cy)) /
    f), which has n . r = (d - d_inf) / f > 0 and is therefore turned round.

    Source: the plane of least squares over a window of disparities is that of slanted support
    windows, Bleyer, Rhemann & Rother, PatchMatch Stereo, BMVC 2011, section 3.

    Args:
        values: (H, W) disparities in pixels; NaN where a pixel is to have, and give, no part.
        geometry: of the pair.
        depth_edge_px: smallest step of disparity that is a depth edge; no normal is fitted
            over one.

    Returns:
        (H, W, 3) float32, unit length, in the frame of the left rectified camera; NaN where
        `values` is, and at or beyond infinity. A pixel without neighbours faces back along the
        optical axis.
    """
    slopes = plane_slopes(values, radii=RADII_PX, edge=depth_edge_px, noise=NOISE_PX)
    height, width = values.shape
    cx, cy = geometry.centre_left
    x, y = np.arange(width) - np.float32(cx), (np.arange(height) - np.float32(cy))[:, None]
    in_front = values - np.float32(geometry.disparity_at_infinity)
    along = (in_front - slopes[..., 0] * x - slopes[..., 1] * y) / np.float32(geometry.focal_px)
    towards = -np.concatenate([slopes, along[..., None]], axis=2)
    towards[~(in_front > 0)] = np.nan
    normals: Array = towards / np.linalg.norm(towards, axis=2, keepdims=True)
    return normals.astype(np.float32, copy=False)
