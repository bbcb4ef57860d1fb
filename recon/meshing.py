"""From a disparity map to a textured triangle mesh that never bridges a depth edge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from calib.pair import RectifiedPair
from recon.triangulation import Triangulation, depth_map, positions
from recon.types import Array, DisparityMap, Mesh

__all__ = ["Meshing", "components", "grid_faces"]


def grid_faces(values: Array, kept: Array, *, depth_edge_px: float) -> Array:
    """Join neighbouring pixels of one surface into triangles.

    Four pixels in a square make two triangles, cut along the diagonal with the smaller step of
    disparity. A triangle exists only if its pixels are kept and no two of them differ by more
    than the threshold. On a plane of gradient (gx, gy) the smaller diagonal steps by
    ||gx| - |gy||, no more than the sides, so one threshold suits all three edges at any slant.

    Args:
        values: (H, W) disparities in pixels; NaN only where not kept.
        kept: (H, W) bool, the pixels that may be joined.
        depth_edge_px: largest step inside a surface; raising it bridges more.

    Returns:
        (F, 3) int32 indices of pixels in row order, counter-clockwise seen from the camera.
    """
    height, width = values.shape
    near_enough = np.where(kept, values, np.nan).astype(np.float32)
    top_left, top_right = near_enough[:-1, :-1], near_enough[:-1, 1:]
    bottom_left, bottom_right = near_enough[1:, :-1], near_enough[1:, 1:]

    falling = np.abs(top_left - bottom_right)
    rising = np.abs(top_right - bottom_left)
    joined_falling = falling <= depth_edge_px
    joined_rising = rising <= depth_edge_px
    cut_falling = joined_falling & ~(rising < falling)
    cut_rising = joined_rising & ~cut_falling
    top = np.abs(top_left - top_right) <= depth_edge_px
    bottom = np.abs(bottom_left - bottom_right) <= depth_edge_px
    left = np.abs(top_left - bottom_left) <= depth_edge_px
    right = np.abs(top_right - bottom_right) <= depth_edge_px

    corner = np.arange(height * width, dtype=np.int32).reshape(height, width)[:-1, :-1]
    a, b, c, d = 0, 1, width, width + 1  # top left, top right, bottom left, bottom right
    triangles = (
        (cut_falling & left & bottom, (a, c, d)),
        (cut_falling & top & right, (a, d, b)),
        (cut_rising & top & left, (a, c, b)),
        (cut_rising & bottom & right, (b, c, d)),
    )
    return np.concatenate(
        [corner[present][:, None] + np.array(shape, np.int32) for present, shape in triangles]
    )


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


def _without_fragments(faces: Array, vertex_count: int, min_faces: int) -> Array:
    """Return the faces of components, joined by shared vertices, of at least `min_faces`."""
    if min_faces <= 1 or not len(faces):
        return faces
    component = components(faces, vertex_count)
    sizes = np.bincount(component, minlength=vertex_count)
    return faces[sizes[component] >= min_faces]


@dataclass(frozen=True)
class Meshing:
    """Join the pixels of a disparity map into a textured mesh.

    Attributes:
        points: which pixels become vertices, and the jump of disparity that no triangle bridges.
        min_component_faces: smallest piece that stays; raising it removes larger fragments, and
            1 keeps all.

    Raises:
        ValueError: if a setting is out of range.
    """

    points: Triangulation = field(default_factory=Triangulation)
    min_component_faces: int = 50

    def __post_init__(self) -> None:
        if self.min_component_faces < 1:
            raise ValueError(
                f"min_component_faces must be at least 1, got {self.min_component_faces}"
            )

    def __call__(
        self, disparity: DisparityMap[Array], pair: RectifiedPair, *, kept: Array | None = None
    ) -> Mesh:
        """Return the surfaces seen by the left camera; the left image is the texture.

        Args:
            disparity: (H, W), of the left view, in pixels.
            pair: the images and geometry it was computed from.
            kept: (H, W) bool, the pixels that may be vertices; `points.kept_pixels` if not given.

        Returns:
            Triangles whose normals point to the camera; only vertices that a face uses.

        Raises:
            ValueError: if `disparity` and `pair` differ in size.
        """
        depth = depth_map(disparity, pair.geometry)
        if kept is None:
            kept = self.points.kept_pixels(disparity, pair.geometry)
        kept = kept & np.isfinite(depth)

        faces = grid_faces(disparity.values, kept, depth_edge_px=self.points.depth_edge_px)
        faces = _without_fragments(faces, kept.size, self.min_component_faces)
        used = np.zeros(kept.size, dtype=bool)
        used[faces.ravel()] = True
        numbers = np.cumsum(used, dtype=np.int32) - 1

        pixels = used.reshape(kept.shape)
        return Mesh(
            vertices=positions(depth, pixels, pair.geometry),
            faces=numbers[faces],
            uv=_texture_coordinates(pixels),
            texture=pair.left,
            colours=pair.left[pixels],
        )


def _texture_coordinates(pixels: Array) -> Array:
    """Return where chosen pixels lie in the image, ((x + 0.5) / W, (y + 0.5) / H).

    Args:
        pixels: (H, W) bool.

    Returns:
        (N, 2) float32 in [0, 1], from the left and from the top, in row order.
    """
    height, width = pixels.shape
    y, x = np.nonzero(pixels)
    return np.stack([(x + 0.5) / width, (y + 0.5) / height], axis=1).astype(np.float32)
