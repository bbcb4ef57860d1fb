"""Smooth normals of a triangle mesh."""

from __future__ import annotations

import numpy as np

from recon.kernels.compiled import Array, compiled

__all__ = ["vertex_normals"]

SHORTEST = 1e-30
"""Below this a sum of normals says nothing: its faces cancel each other or have no area."""


def vertex_normals(vertices: Array, faces: Array) -> Array:
    """Return at every vertex the mean of the normals of its faces, weighted by their area.

    The cross product of two sides is the normal times twice the area, so it is summed as it is.
    Faces that share no vertex do not mix: where a mesh is torn, so are its normals.

    Source: Gouraud, IEEE Trans. Computers C-20(6), 1971, for the mean.

    Args:
        vertices: (V, 3) float32.
        faces: (F, 3) int32; a normal points to where its corners are counter-clockwise.

    Returns:
        (V, 3) float32 of unit length; (0, 0, -1) where there is no area.
    """
    normals = np.zeros((len(vertices), 3), np.float64)
    _sum_and_scale(vertices.astype(np.float64), faces, normals)
    return normals.astype(np.float32)


@compiled()
def _sum_and_scale(vertices: Array, faces: Array, normals: Array) -> None:
    """Fill `normals`, zero so far."""
    for face in range(faces.shape[0]):
        a, b, c = faces[face]
        ux, uy, uz = vertices[b] - vertices[a]
        vx, vy, vz = vertices[c] - vertices[a]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in range(3):
            vertex = faces[face, corner]
            normals[vertex, 0] += x
            normals[vertex, 1] += y
            normals[vertex, 2] += z
    for vertex in range(normals.shape[0]):
        x, y, z = normals[vertex]
        length = np.sqrt(x * x + y * y + z * z)
        if length > SHORTEST:
            normals[vertex] /= length
        else:
            normals[vertex, 2] = -1.0
