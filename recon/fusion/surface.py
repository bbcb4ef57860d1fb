"""What fusion leaves: triangles with colours, and how sure each corner is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from recon.meshing import components
from recon.types import Array

__all__ = ["EMPTY", "FusedSurface", "in_canonical_order", "without_fragments"]


@dataclass(frozen=True, eq=False)
class FusedSurface:
    """A surface in the world frame of the poses, in metres.

    Attributes:
        vertices: (V, 3) float32.
        faces: (F, 3) int32, counter-clockwise seen from where the cameras stood.
        normals: (V, 3) float32 unit, towards the cameras.
        colours: (V, 3) uint8 RGB.
        sigma_m: (V,) float32, the standard deviation of the surface, see `stated_sigma_m`.
        views: (V,) float32, how many views saw the surface there.
        trust: (V,) float32 in [0, 1], the mean of what these views trusted their depths.
    """

    vertices: Array
    faces: Array
    normals: Array
    colours: Array
    sigma_m: Array
    views: Array
    trust: Array

    def moved(self, vertices: Array, normals: Array) -> FusedSurface:
        """Return the same surface in another frame.

        Args:
            vertices: (V, 3) metres.
            normals: (V, 3) unit.
        """
        return replace(self, vertices=vertices, normals=normals)

    def chosen(self, faces: Array) -> FusedSurface:
        """Return the surface of some faces, (F,) bool, and the vertices they use."""
        used, numbers = np.unique(self.faces[faces], return_inverse=True)
        return FusedSurface(
            self.vertices[used],
            numbers.reshape(-1, 3).astype(np.int32),
            self.normals[used],
            self.colours[used],
            self.sigma_m[used],
            self.views[used],
            self.trust[used],
        )


EMPTY = FusedSurface(
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.int32),
    np.zeros((0, 3), np.float32),
    np.zeros((0, 3), np.uint8),
    *(np.zeros(0, np.float32) for _ in range(3)),
)


def without_fragments(
    surface: FusedSurface, smallest_m2: float, *, few_views: float = 1.0
) -> FusedSurface:
    """Return the connected pieces that are large, or smaller and seen by many views.

    Wrong matches agree by chance, in small pieces and in few views: what n times as many see may
    be n^2 times smaller.

    Args:
        surface: F faces.
        smallest_m2: least area of a piece seen by `few_views`; 0 keeps all.
        few_views: how many views see what is seen by few.
    """
    if not len(surface.faces):
        return surface
    piece, areas = components(surface.faces, len(surface.vertices)), _areas(surface)
    seen = surface.views[surface.faces].mean(axis=1)
    area, area_views = (
        np.bincount(piece, each, minlength=len(surface.vertices)) for each in (areas, areas * seen)
    )
    views = area_views / np.maximum(area, np.finfo(np.float64).tiny)
    worth = area * np.maximum(1.0, views / few_views) ** 2
    return surface.chosen(worth[piece] >= smallest_m2)


def _areas(surface: FusedSurface) -> Array:
    """Return the area of every face, square metres."""
    a, b, c = (surface.vertices[surface.faces[:, corner]] for corner in range(3))
    areas: Array = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return areas


def in_canonical_order(surface: FusedSurface) -> FusedSurface:
    """Return the same surface with vertices and faces in an order that depends on it alone.

    Threads number the vertices as they come, so that two runs differ in order and nothing else.
    """
    if not len(surface.faces):
        return surface
    x, y, z = surface.vertices.T
    order = np.lexsort((*surface.normals.T, x, y, z))
    numbers = np.zeros(len(order), np.int32)
    numbers[order] = np.arange(len(order), dtype=np.int32)
    faces = numbers[surface.faces]
    first = faces.argmin(axis=1)
    faces = faces[np.arange(len(faces))[:, None], (first[:, None] + np.arange(3)) % 3]
    faces = faces[np.lexsort(faces.T[::-1])]
    return FusedSurface(
        surface.vertices[order],
        faces,
        surface.normals[order],
        surface.colours[order],
        surface.sigma_m[order],
        surface.views[order],
        surface.trust[order],
    )
