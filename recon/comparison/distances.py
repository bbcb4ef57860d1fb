"""The distance of every point of one shape from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recon.comparison.shapes import Shape
from recon.open3d_library import loaded_open3d
from recon.types import Array

__all__ = ["Direction", "distances_to"]


@dataclass(frozen=True, eq=False)
class Direction:
    """Every point of one shape, and how far the other is.

    Attributes:
        distances: (N,) float32 metres.
        ranges: (N,) float32 metres, how far each point is from the origin, where the camera is.
        sigma_m: (N,) float32, that of the point, or else that of the nearest one; None if neither
            side knows.
        asked: (N,) bool, the points that count.
    """

    distances: Array
    ranges: Array
    sigma_m: Array | None
    asked: Array


def distances_to(other: Shape, shape: Shape) -> Direction:
    """Ask every point of a shape how far another is: its surface if it is a mesh, else its points.

    Args:
        other: that answers.
        shape: that asks.
    """
    sigma = shape.sigma_m
    if other.vertices is not None and other.faces is not None:
        distances = _to_surface(other.vertices, other.faces, shape)
    else:
        distances, nearest = _to_points(other, shape)
        if sigma is None and other.sigma_m is not None:
            sigma = other.sigma_m[nearest]
    ranges = np.linalg.norm(shape.points, axis=1)
    return Direction(distances, ranges, sigma, shape.asked)


def _to_points(other: Shape, shape: Shape) -> tuple[Array, Array]:
    """Return distances (N,) from the nearest point, and which it is."""
    core = loaded_open3d().core
    search = core.nns.NearestNeighborSearch(core.Tensor(other.points.astype(np.float64)))
    search.knn_index()
    nearest, squares = search.knn_search(core.Tensor(shape.points.astype(np.float64)), 1)
    distances = np.sqrt(squares.numpy().ravel()).astype(np.float32)
    return distances, nearest.numpy().ravel().astype(np.intp)


def _to_surface(vertices: Array, faces: Array, shape: Shape) -> Array:
    """Return distances (N,) from the nearest place on the faces of a mesh."""
    scene = loaded_open3d().t.geometry.RaycastingScene()
    scene.add_triangles(vertices, faces.astype(np.uint32))
    points = np.ascontiguousarray(shape.points, np.float32)
    return np.asarray(scene.compute_distance(points).numpy(), np.float32)
