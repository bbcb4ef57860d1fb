"""How far a mesh is from the true surface, in standard deviations of the depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.rig import RectifiedGeometry
from recon.meshing import grid_faces
from recon.open3d_library import loaded_open3d
from recon.triangulation import depth_map, depth_sigma, positions
from recon.types import Array, DisparityMap, Mesh, PixelStatus

__all__ = [
    "SurfaceDistances",
    "SurfaceMeasures",
    "TrueSurface",
    "first_hits",
    "surface_distances",
    "surface_measures",
]

COMPLETE_SIGMA = 3.0
TRUE_EDGE_PX = 1.0
BESIDE_PX = (0.2, 0.3)


@dataclass(frozen=True, eq=False)
class TrueSurface:
    """What the left camera of a generated pair looks at.

    Attributes:
        disparity: (H, W) float32 px, exact.
        visible: (H, W) bool, pixels that the right camera sees too.
        geometry: of the pair.
    """

    disparity: Array
    visible: Array
    geometry: RectifiedGeometry


@dataclass(frozen=True)
class SurfaceMeasures:
    """A mesh beside the truth; distances in sigma_z at the depth where they are measured.

    Attributes:
        median_sigma: of the distances from the mesh to the true surface.
        p95_sigma: 95th percentile of the same.
        median_m: of the same, in metres.
        complete: share of the true surface that both cameras see from which the mesh is at most
            3 sigma_z away.
        hit: share of the pixels whose ray meets the mesh.
    """

    median_sigma: float
    p95_sigma: float
    median_m: float
    complete: float
    hit: float


@dataclass(frozen=True, eq=False)
class SurfaceDistances:
    """How far a mesh and the true surface are from each other, by pixel.

    Attributes:
        off_m: (H, W), from where the ray of a pixel meets the mesh to the truth; NaN where it does
            not.
        hit_m: (H, W), depth of that place.
        missed_m: (H, W), from the truth to the mesh; NaN unless both cameras see it.
        depth_m: (H, W), of the truth.
        geometry: of the pair.
    """

    off_m: Array
    hit_m: Array
    missed_m: Array
    depth_m: Array
    geometry: RectifiedGeometry

    def in_sigmas(self, sigma_px: float | Array) -> SurfaceMeasures:
        """Return the measures, in the sigma_z that a standard deviation of disparities means.

        Args:
            sigma_px: one for all, or (H, W) as pixels state it, where those that state none, NaN,
                count as the median one.
        """
        one = np.nan_to_num(sigma_px, nan=float(np.nanmedian(sigma_px)))
        stated = np.broadcast_to(one, self.depth_m.shape)
        met, seen = np.isfinite(self.off_m), np.isfinite(self.missed_m)
        sigmas = self.off_m[met] / depth_sigma(self.hit_m[met], self.geometry, stated[met])
        allowed = COMPLETE_SIGMA * depth_sigma(self.depth_m[seen], self.geometry, stated[seen])
        return SurfaceMeasures(
            median_sigma=float(np.median(sigmas)),
            p95_sigma=float(np.percentile(sigmas, 95)),
            median_m=float(np.median(self.off_m[met])),
            complete=float((self.missed_m[seen] <= allowed).mean()),
            hit=float(met.mean()),
        )


def surface_measures(mesh: Mesh, truth: TrueSurface, sigma_px: float | Array) -> SurfaceMeasures:
    """Compare a mesh with the true surface, both ways.

    From the mesh: every ray through a pixel that meets it asks, at the first
    meeting, how near the nearest point of the true surface is. From the truth: every pixel that
    both cameras see asks for the nearest point of the mesh. Rays ask in place of even areas, so
    that near and far things count by what is seen of them.

    Source: accuracy and completeness of Seitz et al., CVPR 2006, with point to surface distances.

    Args:
        mesh: in the frame of the left rectified camera, not without faces.
        truth: of the same pair.
        sigma_px: standard deviation of the disparities, which sets sigma_z; one for all, or (H, W)
            as pixels state it, where those that state none, NaN, count as the median one.

    Raises:
        ImportError: if open3d lacks a system library.
    """
    return surface_distances(mesh, truth).in_sigmas(sigma_px)


def surface_distances(mesh: Mesh, truth: TrueSurface) -> SurfaceDistances:
    """Return the distances between a mesh and the truth that `surface_measures` compares.

    Args:
        mesh: in the frame of the left rectified camera, not without faces.
        truth: of the same pair.

    Raises:
        ImportError: if open3d lacks a system library.
    """
    depth = _depth(truth)
    used = np.isfinite(depth)
    faces = grid_faces(truth.disparity, used, depth_edge_px=TRUE_EDGE_PX)
    numbers = np.cumsum(used.ravel(), dtype=np.int32) - 1
    whole = positions(depth, used, truth.geometry), numbers[faces]

    hits = first_hits(mesh, truth.geometry)
    met, seen = np.isfinite(hits[..., 2]), truth.visible & used
    off, missed = np.full(depth.shape, np.nan), np.full(depth.shape, np.nan)
    off[met] = _distances(hits[met], *whole)
    missed[seen] = _distances(positions(depth, seen, truth.geometry), mesh.vertices, mesh.faces)
    return SurfaceDistances(off, hits[..., 2], missed, depth, truth.geometry)


def first_hits(mesh: Mesh, geometry: RectifiedGeometry) -> Array:
    """Return where the ray of each pixel first meets a mesh.

    The rays go `BESIDE_PX` (down, right) beside the middles: those are vertices of our meshes, and
    whether a ray meets a vertex, or an edge, is decided by rounding.

    Returns:
        (H, W, 3) float32 metres; NaN where it does not.
    """
    (width, height), (cx, cy) = geometry.size, geometry.centre_left
    y, x = np.mgrid[:height, :width].astype(np.float32)
    y, x = y + np.float32(BESIDE_PX[0]), x + np.float32(BESIDE_PX[1])
    towards = [(x - cx) / geometry.focal_px, (y - cy) / geometry.focal_px, np.ones_like(x)]
    rays = np.stack([np.zeros_like(x)] * 3 + towards, axis=-1).astype(np.float32)
    core, scene = _scene(mesh.vertices, mesh.faces)
    along: Array = scene.cast_rays(core.Tensor(rays))["t_hit"].numpy()
    along = np.where(np.isfinite(along), along, np.float32(np.nan))
    hits: Array = along[..., None] * rays[..., 3:]
    return hits


def _distances(points: Array, vertices: Array, faces: Array) -> Array:
    """Return how far each of (N, 3) points is from the nearest point of a mesh."""
    core, scene = _scene(vertices, faces)
    distances: Array = scene.compute_distance(core.Tensor(points)).numpy()
    return distances


def _scene(vertices: Array, faces: Array) -> tuple[Any, Any]:
    """Return open3d's tensors, and a scene in which rays and distances are found fast."""
    open3d = loaded_open3d()
    core: Any = open3d.core
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        core.Tensor(np.ascontiguousarray(vertices, np.float32)),
        core.Tensor(np.ascontiguousarray(faces, np.uint32)),
    )
    return core, scene


def _depth(truth: TrueSurface) -> Array:
    """Return the true depths (H, W); NaN at infinity."""
    return depth_map(
        DisparityMap(
            truth.disparity,
            np.full(truth.disparity.shape, PixelStatus.MATCHED, np.uint8),
            np.ones(truth.disparity.shape, np.float32),
        ),
        truth.geometry,
    )
