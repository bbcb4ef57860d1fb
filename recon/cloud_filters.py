"""Leaving out points that have too few neighbours, and thinning to a grid of cubes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.open3d_library import loaded_open3d
from recon.types import Array, PixelStatus, PointCloud, Removal

__all__ = [
    "CloudFilters",
    "radius_inliers",
    "statistical_inliers",
    "uniform_positions",
    "voxel_means",
]

SHORTEST_NORMAL = 1e-3
"""A mean of normals shorter than this has no direction: they point everywhere."""


def uniform_positions(cloud: PointCloud, focal_px: float) -> Array:
    """Return points where they lie equally dense at any depth: (f X / Z, f Y / Z, Z / sigma_Z).

    The first two are pixels of the image; the third is (d - d_inf) / sigma_d, the disparity in
    standard deviations, because sigma_Z = Z^2 / (f B) sigma_d. In metres the points of a pair are
    apart by Z / f across and by sigma_Z along the ray, so no radius in metres suits near and far.

    Args:
        cloud: N points.
        focal_px: f.

    Returns:
        (N, 3) float64.
    """
    x, y, z = cloud.points.astype(np.float64).T
    sigma = np.maximum(cloud.depth_sigma_m.astype(np.float64), np.finfo(np.float32).tiny)
    return np.stack([focal_px * x / z, focal_px * y / z, z / sigma], axis=1)


def _open3d_cloud(positions: Array) -> Any:  # noqa: ANN401  open3d has no types
    """Return positions as open3d takes them."""
    open3d = loaded_open3d()
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(positions))


def statistical_inliers(positions: Array, neighbours: int, deviations: float) -> Array:
    """Return which points are not much farther from their neighbours than is usual in the cloud.

    A point stays if the mean distance to its nearest neighbours is at most the mean over the
    cloud plus some standard deviations of it.

    Source: Rusu et al., Towards 3D Point Cloud Based Object Maps for Household Environments,
    Robotics and Autonomous Systems 56(11), 2008, section 4.1.

    Args:
        positions: (N, 3).
        neighbours: how many are asked.
        deviations: raising it keeps more.

    Returns:
        Indices (M,), in order.
    """
    _, stay = _open3d_cloud(positions).remove_statistical_outlier(neighbours, deviations)
    return np.sort(np.asarray(stay, dtype=np.intp))


def radius_inliers(positions: Array, radius: float, neighbours: int) -> Array:
    """Return which points have more than so many others within a radius.

    Args:
        positions: (N, 3).
        radius: in their unit.
        neighbours: raising it keeps less.

    Returns:
        Indices (M,), in order.
    """
    _, stay = _open3d_cloud(positions).remove_radius_outlier(neighbours, radius)
    return np.sort(np.asarray(stay, dtype=np.intp))


def voxel_means(cloud: PointCloud, edge_m: float) -> PointCloud:
    """Return one point for each cube of a grid that holds any: the mean of those in it.

    Positions, colours, normals (made of unit length again), confidence and sigma are averaged:
    errors of neighbouring pixels go together, so that the mean of many is not surer than one. The
    status is the commonest. The grid begins at the origin, and the mean of a cube lies in it, so
    thinning again changes nothing.

    Args:
        cloud: N points.
        edge_m: of a cube.

    Returns:
        M points, ordered by their cubes.
    """
    if not len(cloud):
        return cloud
    cubes, first, cube = np.unique(
        _cubes(cloud.points, edge_m), axis=0, return_index=True, return_inverse=True
    )
    cube = cube.ravel()  # NumPy 2.0 gives it another shape

    points = _means(cloud.points, cube).astype(np.float32)
    outside = (_cubes(points, edge_m) != cubes).any(axis=1)  # rounded across a border
    points[outside] = cloud.points[first[outside]]
    normals = _means(cloud.normals, cube)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    opposed = lengths[:, 0] < SHORTEST_NORMAL
    normals[opposed] = cloud.normals[first[opposed]]
    lengths[opposed] = 1
    votes = [np.bincount(cube, cloud.status == int(state)) for state in PixelStatus]
    return PointCloud(
        points=points,
        colours=np.rint(_means(cloud.colours, cube)).astype(np.uint8),
        normals=(normals / lengths).astype(np.float32),
        confidence=_means(cloud.confidence, cube).astype(np.float32),
        depth_sigma_m=_means(cloud.depth_sigma_m, cube).astype(np.float32),
        status=np.array([int(state) for state in PixelStatus], np.uint8)[np.argmax(votes, axis=0)],
    )


def _cubes(points: Array, edge_m: float) -> Array:
    """Return the cubes (N, 3) int64 that points lie in."""
    return np.floor(points.astype(np.float64) / edge_m).astype(np.int64)


def _means(values: Array, group: Array) -> Array:
    """Return the means over groups of rows, (M,) or (M, C) float64; group (N,) counts from 0."""
    count = np.bincount(group)
    columns = values.reshape(len(values), -1).T
    means = np.stack([np.bincount(group, column) / count for column in columns], axis=1)
    return means.reshape(-1, *values.shape[1:])


@dataclass(frozen=True)
class CloudFilters:
    """Leave out points by their neighbours, then thin; all of it is off by default.

    Distances to neighbours are those of `uniform_positions`, so that one setting suits near and
    far. On pairs with truth (`benchmarks/cloud_filters.py`) the statistical filter takes more right
    points than wrong ones. Of what the radius filter takes about two thirds are wrong, but that is
    1 to 3 % of what is wrong: what matching gets wrong are patches, not single points.

    Attributes:
        remove_statistical_outliers: leave out points unusually far from their neighbours.
        statistical_neighbours: how many each point is compared with.
        statistical_deviations: how unusual, in standard deviations; raising it keeps more.
        remove_radius_outliers: leave out points with few others near.
        radius_px: how far to look, in pixels and standard deviations of disparity.
        radius_neighbours: how many others there must be at least; raising it keeps less.
        voxel_m: edge of the cubes that hold one point each, metres; None keeps all points.

    Raises:
        ValueError: if a setting is out of range.
    """

    remove_statistical_outliers: bool = False
    statistical_neighbours: int = 20
    statistical_deviations: float = 2.0
    remove_radius_outliers: bool = False
    radius_px: float = 4.0
    radius_neighbours: int = 12
    voxel_m: float | None = None

    def __post_init__(self) -> None:
        for name in ("statistical_neighbours", "radius_neighbours"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
        for name, unit in (("statistical_deviations", ""), ("radius_px", " px"), ("voxel_m", " m")):
            value = getattr(self, name)
            if value is not None and not 0 < value < np.inf:
                raise ValueError(f"{name} must be positive, got {value}{unit}")

    def __call__(
        self, cloud: PointCloud, *, focal_px: float
    ) -> tuple[PointCloud, tuple[Removal, ...]]:
        """Return what is left of a cloud, and what each filter in use took away, in order.

        Args:
            cloud: of one pair.
            focal_px: of that pair.

        Raises:
            ImportError: if a filter of neighbours is on and open3d does not load.
        """
        removals = []
        for name, apply in self._in_use(focal_px):
            left = apply(cloud) if len(cloud) else cloud
            removals.append(Removal(name, len(cloud) - len(left), len(cloud)))
            cloud = left
        return cloud, tuple(removals)

    def _in_use(self, focal_px: float) -> list[tuple[str, Callable[[PointCloud], PointCloud]]]:
        """Return the filters that are on, by name."""
        steps: list[tuple[str, Callable[[PointCloud], PointCloud]]] = []
        if self.remove_statistical_outliers:
            asked, deviations = self.statistical_neighbours, self.statistical_deviations
            steps.append(
                (
                    "statistical outliers",
                    lambda cloud: cloud.chosen(
                        statistical_inliers(uniform_positions(cloud, focal_px), asked, deviations)
                    ),
                )
            )
        if self.remove_radius_outliers:
            radius, others = self.radius_px, self.radius_neighbours
            steps.append(
                (
                    "radius outliers",
                    lambda cloud: cloud.chosen(
                        radius_inliers(uniform_positions(cloud, focal_px), radius, others)
                    ),
                )
            )
        if (edge_m := self.voxel_m) is not None:
            steps.append(("merged in voxels", lambda cloud: voxel_means(cloud, edge_m)))
        return steps
