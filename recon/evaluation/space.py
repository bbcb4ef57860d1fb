"""How far a disparity map is from the truth in space: as depths, and as a cloud of points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calib.rig import RectifiedGeometry
from recon.evaluation.protocols import enlarged
from recon.evaluation.regions import times_smaller
from recon.evaluation.scene import Scene
from recon.kernels.nearest import PointGrid, nearest_distances
from recon.triangulation import Triangulation, depth_map
from recon.types import Array, DisparityMap, PixelStatus

__all__ = ["Measures", "cloud_measures", "depth_measures"]

Measures = dict[str, float | None]
"""What was found, by name."""

DEPTH_REGIONS = ("nonocc", "all")
SHARES = (0.01, 0.05)
"""Of the true depth, or of the depth of a point: errors below these are counted."""

FARTHEST = 0.05
"""Share of its depth up to which a point is searched round; beyond, all distances are alike."""

STEP_PX = 2
"""Every second pixel of every second row speaks for its cloud; it is compared with all others."""

AS_DELIVERED = Triangulation()


def depth_measures(
    values: Array, scene: Scene, masks: Mapping[str, Array]
) -> dict[str, Measures] | None:
    """Compare depths, Z = f B / (d - d_inf), with the true ones, Z*.

    Args:
        values: (H, W) disparities of the left view, of the size of the truth or 2 or 4 times
            smaller; NaN where there is none. A smaller map is enlarged by its nearest neighbours.
        scene: that they were computed from.
        masks: (H, W) bool of the size of the truth: "all", and "nonocc" if it is known.

    Returns:
        Of "nonocc" and "all": "median_relative", the median of |Z - Z*| / Z* over pixels that
        have a depth, None if there are none; "within_1%" and "within_5%", the percentage of all
        pixels with an error strictly below, None if the region is empty. Pixels without
        disparity, and those at or beyond infinity, have no depth and are not within; pixels whose
        true depth is infinite are not counted. None as a whole if the scene is not calibrated.

    Raises:
        ValueError: if the map cannot be brought to the size of the truth.
    """
    if not scene.calibrated:
        return None
    true_disparity = scene.truth.disparity
    true_depth = _depths(true_disparity, scene)
    depth = _depths(enlarged(values, true_disparity.shape), scene)
    error = np.abs(depth - true_depth) / true_depth
    finite = ~np.isnan(true_depth)
    return {
        region: _summary_of_depths(error[masks[region] & finite])
        for region in DEPTH_REGIONS
        if region in masks
    }


def _summary_of_depths(error: Array) -> Measures:
    """Summarise relative errors (N,), NaN where there is no depth."""
    found = error[~np.isnan(error)]
    return {
        "median_relative": float(np.median(found)) if found.size else None,
        **{
            f"within_{share:.0%}": 100 * float((error < share).mean()) if error.size else None
            for share in SHARES
        },
    }


def cloud_measures(
    disparity: DisparityMap[Array],
    scene: Scene,
    masks: Mapping[str, Array],
    triangulation: Triangulation = AS_DELIVERED,
) -> Measures | None:
    """Compare the cloud that a disparity map gives with that of the truth.

    Accuracy asks every point of the map how far the truth is: is there a surface? Completeness
    asks every point of the truth that both cameras see how far the map is: was the surface found?
    A distance counts as a share of the depth of the point that is asked, so that the scale of a
    scene does not matter; all shares above 5 % are alike. Asked are every second pixel of every
    second row of the map, and the pixels of the truth as far apart; all points of the other side
    can answer. The map is not asked where the truth is unknown: nobody knows what is there.

    Source: accuracy and completeness of Seitz et al., CVPR 2006; as shares below a threshold, the
    precision and recall of Knapitsch et al. (Tanks and Temples), ACM TOG 36(4), 2017.

    Args:
        disparity: (H, W) of the left view, of the size of the truth or 2 or 4 times smaller.
        scene: that it was computed from.
        masks: (H, W) bool of the size of the truth: "all", and "nonocc" if it is known, else "all"
            is what completeness asks.
        triangulation: chooses the pixels that become points of the map's cloud.

    Returns:
        "accuracy_1%", "accuracy_5%", "completeness_1%" and "completeness_5%": percentage of the
        points asked with a distance strictly below, 0 if there are none; "accuracy_median_m" and
        "completeness_median_m": metres, None if the median is above 5 % of the depth or no point
        was asked; "chamfer_%": mean of the mean distances of both, in percent of the depth, 5 for
        a side without points. None as a whole if the scene is not calibrated.

    Raises:
        ValueError: if the map cannot be brought to the size of the truth.
    """
    if not scene.calibrated:
        return None
    height, width = disparity.values.shape
    factor = times_smaller((height, width), scene.truth.disparity.shape, what="disparity map")
    truth = _point_grid(_depths(scene.truth.disparity, scene), scene)
    geometry = _geometry(scene, (height, width))
    kept = triangulation.kept_pixels(disparity, geometry)
    found = _point_grid(np.where(kept, depth_map(disparity, geometry), np.nan), scene)
    unknown = np.isnan(truth.depths).reshape(height, factor, width, factor).all(axis=(1, 3))
    judged = np.where(unknown, np.nan, found.depths)
    seen = np.where(masks.get("nonocc", masks["all"]), truth.depths, np.nan)
    accuracy, accuracy_mean = _summary_of_distances(replace(found, depths=judged), truth, STEP_PX)
    completeness, completeness_mean = _summary_of_distances(
        replace(truth, depths=seen), found, STEP_PX * factor
    )
    return {
        **{f"accuracy_{name}": value for name, value in accuracy.items()},
        **{f"completeness_{name}": value for name, value in completeness.items()},
        "chamfer_%": 100 * (accuracy_mean + completeness_mean) / 2,
    }


def _summary_of_distances(asked: PointGrid, others: PointGrid, step: int) -> tuple[Measures, float]:
    """Measure from points to others.

    Returns:
        "median_m" and the percentages below the shares; and the mean share of the depth.
    """
    distances = nearest_distances(asked, others, limit=FARTHEST, step=step)
    present = ~np.isnan(distances)
    if not present.any():
        return {"median_m": None, **{f"{share:.0%}": 0.0 for share in SHARES}}, FARTHEST
    metres = distances[present]
    relative = metres / asked.depths[::step, ::step][present]
    median = float(np.median(metres))
    shares = {f"{share:.0%}": 100 * float((relative < share).mean()) for share in SHARES}
    mean = float(np.minimum(relative, FARTHEST).mean(dtype=np.float64))
    return {"median_m": median if np.isfinite(median) else None, **shares}, mean


def _geometry(scene: Scene, shape: tuple[int, ...]) -> RectifiedGeometry:
    """Return the geometry of a scene at the size of a map of (H, W) `shape`."""
    return scene.pair.geometry.resized((shape[1], shape[0]))


def _depths(values: Array, scene: Scene) -> Array:
    """Return the depths of (H, W) disparities at their size; NaN where there is none."""
    present = ~np.isnan(values)
    disparity: DisparityMap[Array] = DisparityMap(
        values,
        np.where(present, np.uint8(PixelStatus.MATCHED), np.uint8(PixelStatus.OUTSIDE)),
        present.astype(np.float32),
    )
    return depth_map(disparity, _geometry(scene, values.shape))


def _point_grid(depths: Array, scene: Scene) -> PointGrid:
    """Return (H, W) depths as points on the rays of the left camera."""
    geometry = _geometry(scene, depths.shape)
    return PointGrid(depths, geometry.focal_px, geometry.centre_left)
