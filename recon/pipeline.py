"""The whole path: rectify, match, triangulate, mesh."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from calib.pair import RectifiedPair, StereoPair
from calib.rectify import Rectifier
from recon.disparity_range import check_range, estimate_range
from recon.observer import Observer, ignore
from recon.settings import Preset
from recon.triangulation import depth_map
from recon.types import Array, DisparityMap, Mesh, PointCloud, Removal

__all__ = ["Reconstruction", "reconstruct"]


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What a pair turned into.

    Attributes:
        pair: the rectified images and their geometry; everything below refers to them.
        disparities: the candidates that were searched, pixels.
        disparity: (H, W) of the left view.
        depth: (H, W) float32 metres, NaN where there is none.
        cloud: the trustworthy pixels in space.
        mesh: the same pixels joined to surfaces.
        dense_mesh: the same with a vertex for every pixel, for colours at the vertices; `mesh`
            itself if that was not decimated.
        removals: what each filter took away, in order, between the pixels with a disparity and
            the cloud.
    """

    pair: RectifiedPair
    disparities: range
    disparity: DisparityMap[Array]
    depth: Array
    cloud: PointCloud
    mesh: Mesh
    dense_mesh: Mesh
    removals: tuple[Removal, ...] = ()


def reconstruct(
    pair: StereoPair | RectifiedPair,
    preset: Preset,
    *,
    disparities: range | None = None,
    device: str | torch.device = "cpu",
    observe: Observer = ignore,
) -> Reconstruction:
    """Turn a pair of photographs into surfaces.

    Args:
        pair: raw with the calibration of its rig, or rectified already.
        preset: see `recon.load_preset`.
        disparities: candidates d = x_left - x_right in pixels; estimated if not given.
        device: where the matcher computes.
        observe: told every intermediate result.

    Raises:
        ValueError: if the range of disparities is empty or does not fit the images.
    """
    if isinstance(pair, StereoPair):
        observe("input/raw", pair)
        pair = Rectifier(pair.calibration)(pair)
    observe("input/rectified", pair)
    if disparities is None:
        disparities = estimate_range(pair)
        observe("disparity_range", disparities)
    check_range(disparities, pair.left.shape[1])

    disparity = preset.matcher(pair, disparities, device=device, observe=observe)
    depth = depth_map(disparity, pair.geometry)
    observe("depth", depth)

    kept, of_pixels = preset.triangulation.selection(disparity, pair.geometry)
    cloud = preset.triangulation(disparity, pair, kept=kept)
    cloud, of_points = preset.cloud(cloud, focal_px=pair.geometry.focal_px)
    observe("cloud", cloud)
    mesh, dense_mesh = preset.meshing.with_dense(disparity, pair, kept=kept)
    observe("mesh", mesh)
    removals = of_pixels + of_points
    return Reconstruction(pair, disparities, disparity, depth, cloud, mesh, dense_mesh, removals)
