"""The connected pieces of a mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit

from recon.types import Array

__all__ = ["components", "without_fragments"]


def _join(parents: Array, faces: Array) -> None:
    """Union the vertices of every face; afterwards `parents` names one root a component.

    Source: Tarjan, JACM 1975; path halving after Tarjan & van Leeuwen, JACM 1984.
    """
    for face in range(faces.shape[0]):
        first = faces[face, 0]
        while parents[first] != first:
            parents[first] = parents[parents[first]]
            first = parents[first]
        for corner in range(1, 3):
            other = faces[face, corner]
            while parents[other] != other:
                parents[other] = parents[parents[other]]
                other = parents[other]
            low, high = min(first, other), max(first, other)
            parents[high] = low
            first = low
    for vertex in range(parents.shape[0]):
        parents[vertex] = parents[parents[vertex]]


_join_compiled: Callable[[Array, Array], None] = njit(cache=True, nogil=True)(_join)


def components(faces: Array, vertex_count: int) -> Array:
    """Find the connected pieces of a mesh; faces that share a vertex are connected.

    Args:
        faces: (F, 3) int32 indices of vertices.
        vertex_count: how many vertices there are.

    Returns:
        (F,) int32, the least vertex of the piece that a face belongs to.
    """
    roots = np.arange(vertex_count, dtype=np.int32)
    _join_compiled(roots, faces)
    least: Array = roots[faces[:, 0]]
    return least


def without_fragments(faces: Array, vertex_count: int, min_faces: int) -> Array:
    """Return the faces of components, joined by shared vertices, of at least `min_faces`."""
    if min_faces <= 1 or not len(faces):
        return faces
    component = components(faces, vertex_count)
    sizes = np.bincount(component, minlength=vertex_count)
    return faces[sizes[component] >= min_faces]
