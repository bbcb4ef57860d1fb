"""A surface without holes through the points of a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from recon.open3d_library import loaded_open3d
from recon.types import Array, Mesh

__all__ = ["Watertight"]

DEEPEST = 12


@dataclass(frozen=True)
class Watertight:
    """Close the holes of a mesh by screened Poisson reconstruction.

    The surface is where an indicator function, whose gradient fits the normals of all points,
    passes through them. Between and behind the points it is invented: it spans occlusions, joins
    an object to the wall behind it, and closes the back of the scene, which no camera saw. So
    what is far from every point is cut away. The densities that the method itself gives are no
    measure here: they fall with the square of the depth, and would cut the background first.

    Source: Kazhdan & Hoppe, Screened Poisson surface reconstruction, ACM TOG 32(3), 2013, as in
    open3d; on one thread, because the sums of several change from run to run.

    Attributes:
        depth: of the octree; its finest cells are 1 / 2^depth of the extent of the points.
        reach_px: farthest a vertex may be from any point, in pixels at its depth, Z / f;
            raising it closes wider gaps, 0 keeps all.

    Raises:
        ValueError: if a setting is out of range.
    """

    depth: int
    reach_px: float

    def __post_init__(self) -> None:
        if not 1 <= self.depth <= DEEPEST:
            raise ValueError(f"watertight_depth must be 1 to {DEEPEST}, got {self.depth}")
        if not 0 <= self.reach_px < np.inf:
            raise ValueError(
                f"watertight_reach_px must be 0 or more, got {self.reach_px}; 0 keeps all"
            )

    def __call__(self, mesh: Mesh, focal_px: float) -> Mesh:
        """Return the closed surface, with the colours of the nearest points and no texture.

        Args:
            mesh: of one view, in the frame of its camera, with a vertex for every point.
            focal_px: of the camera.

        Raises:
            ImportError: if open3d lacks a system library.
        """
        if not len(mesh.faces):
            return Mesh(mesh.vertices, mesh.faces, None, None, mesh.colours, mesh.normals)
        open3d = loaded_open3d()
        cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(mesh.vertices))
        cloud.normals = open3d.utility.Vector3dVector(mesh.normals)
        surface, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud, depth=self.depth, n_threads=1
        )
        surface.compute_vertex_normals()
        vertices = np.asarray(surface.vertices).astype(np.float32)
        faces = np.asarray(surface.triangles).astype(np.int32)
        nearest, distance = _nearest(open3d, mesh.vertices, vertices)
        if self.reach_px:
            near = distance <= self.reach_px * np.abs(vertices[:, 2]) / focal_px
            faces = faces[near[faces].all(axis=1)]
        used, numbered = np.unique(faces, return_inverse=True)
        faces = numbered.reshape(-1, 3).astype(np.int32)
        return Mesh(
            vertices=vertices[used],
            faces=faces,
            uv=None,
            texture=None,
            colours=mesh.colours[nearest[used]],
            normals=np.asarray(surface.vertex_normals)[used].astype(np.float32),
        )


def _nearest(open3d: Any, points: Array, asked: Array) -> tuple[Array, Array]:  # noqa: ANN401
    """Return which of `points` (N, 3) is nearest to each of `asked` (M, 3), and how far."""
    search = open3d.core.nns.NearestNeighborSearch(open3d.core.Tensor(points))
    search.knn_index()
    index, squared = search.knn_search(open3d.core.Tensor(np.ascontiguousarray(asked)), 1)
    return index.numpy().ravel(), np.sqrt(np.maximum(squared.numpy().ravel(), 0))
