"""The settings of the mesh, and the steps from a disparity map to it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib.pair import RectifiedPair
from recon.kernels.simplification import simplified
from recon.meshing.grid import grid_faces
from recon.meshing.pieces import without_fragments
from recon.meshing.watertight import Watertight
from recon.normals import surface_normals
from recon.triangulation import Triangulation, depth_map, positions
from recon.types import Array, DisparityMap, Mesh

__all__ = ["Meshing"]

BORDER_PX = 0.5
"""How much of a border may be cut off: its steps from pixel to pixel become straighter lines."""

SIGMAS_PX = (0.1, 0.5)
"""What decimation takes for less or more. Finer ones would keep the noise of what is sure, and
coarser ones would flatten what is doubted and often right."""

SHIFT_PX = 0.5
"""How far the texture may slide on a slanted triangle, which shows it in the wrong perspective."""


@dataclass(frozen=True)
class Meshing:
    """Join the pixels of a disparity map into a textured mesh.

    Attributes:
        points: which pixels become vertices, and the jump of disparity that no triangle bridges.
        min_component_faces: smallest piece that stays, counted before anything is removed;
            raising it removes larger fragments, and 1 keeps all.
        decimation_sigma: how far the surface may pass from a pixel whose vertex was removed, in
            standard deviations of its depth, as the disparity states them, taken as 0.1 px at least
            and 0.5 px at most; raising it leaves fewer triangles, and 0 keeps every vertex.
        watertight: close the holes by a surface that goes through all points, which invents what
            no camera saw; it has colours at its vertices instead of a texture.
        watertight_depth: of the octree in which that surface is found: its finest cells are
            1 / 2^depth of the extent of the scene; one more takes about four times as long.
        watertight_reach_px: farthest that surface may go from any point, in pixels at its depth;
            0 keeps all of it, which is closed, and mostly invented.

    Raises:
        ValueError: if a setting is out of range.
    """

    points: Triangulation = field(default_factory=Triangulation)
    min_component_faces: int = 50
    decimation_sigma: float = 1.0
    watertight: bool = False
    watertight_depth: int = 8
    watertight_reach_px: float = 12.0

    def __post_init__(self) -> None:
        if self.min_component_faces < 1:
            raise ValueError(
                f"min_component_faces must be at least 1, got {self.min_component_faces}"
            )
        if not 0 <= self.decimation_sigma < np.inf:
            raise ValueError(
                f"decimation_sigma must be 0 or more, got {self.decimation_sigma}; 0 keeps all"
            )
        Watertight(self.watertight_depth, self.watertight_reach_px)

    def __call__(
        self,
        disparity: DisparityMap[Array],
        pair: RectifiedPair,
        *,
        kept: Array | None = None,
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
            ImportError: if the surface is to be watertight and open3d lacks a system library.
        """
        return self.with_dense(disparity, pair, kept=kept)[0]

    def with_dense(
        self,
        disparity: DisparityMap[Array],
        pair: RectifiedPair,
        *,
        kept: Array | None = None,
    ) -> tuple[Mesh, Mesh]:
        """Return the mesh, and the same before vertices were removed; see `__call__`.

        Where nothing is removed, as from a watertight surface, both are one.
        """
        depth = depth_map(disparity, pair.geometry)
        if kept is None:
            kept = self.points.kept_pixels(disparity, pair.geometry)
        kept = kept & np.isfinite(depth)

        faces = grid_faces(disparity.values, kept, depth_edge_px=self.points.depth_edge_px)
        faces = without_fragments(faces, kept.size, self.min_component_faces)
        on_surfaces = np.where(kept, disparity.values, np.float32(np.nan))
        normals = surface_normals(
            on_surfaces, pair.geometry, depth_edge_px=self.points.depth_edge_px
        )
        dense = _mesh_of(faces, depth, normals, pair)
        if self.watertight:
            close = Watertight(self.watertight_depth, self.watertight_reach_px)
            closed = close(dense, pair.geometry.focal_px)
            return closed, closed
        if not self.decimation_sigma:
            return dense, dense
        few = simplified(
            disparity.values - np.float32(pair.geometry.disparity_at_infinity),
            faces,
            tolerance=self.decimation_sigma * self._bounded_sigma(disparity),
            border=BORDER_PX,
            shift=SHIFT_PX,
        )
        return _mesh_of(few, depth, normals, pair), dense

    def _bounded_sigma(self, disparity: DisparityMap[Array]) -> Array:
        """Return the standard deviations of the disparities (H, W) as decimation takes them."""
        least, most = SIGMAS_PX
        bounded: Array = np.clip(self.points.disparity_sigma(disparity), least, most)
        return bounded


def _mesh_of(faces: Array, depth: Array, normals: Array, pair: RectifiedPair) -> Mesh:
    """Place the pixels that faces use, (F, 3) indices in row order, in space.

    The normals (H, W, 3) are those of the cloud: planes through windows that end at depth edges.
    The triangles themselves are no larger than their noise.
    """
    used = np.zeros(depth.size, dtype=bool)
    used[faces.ravel()] = True
    numbers = np.cumsum(used, dtype=np.int32) - 1
    pixels = used.reshape(depth.shape)
    return Mesh(
        vertices=positions(depth, pixels, pair.geometry),
        faces=numbers[faces],
        uv=_texture_coordinates(pixels),
        texture=pair.left,
        colours=pair.left[pixels],
        normals=normals[pixels],
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
