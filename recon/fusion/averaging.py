"""Averaging depth maps in a truncated signed distance field of voxel blocks.

open3d keeps the blocks (a hash table that grows with the surface) and finds the surface among
them. Its own averaging gives every depth the same weight and never empties a block that a later
view looks through, so the averaging is `recon.kernels.distance_field`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from recon.fusion.surface import EMPTY, FusedSurface, in_canonical_order, without_fragments
from recon.fusion.views import DepthView
from recon.kernels.distance_field import average_in
from recon.open3d_library import loaded_open3d
from recon.types import Array

__all__ = ["CORRELATION", "Fusion", "Volume", "stated_sigma_m"]

BLOCK = 8  # voxels along a side
FIRST_BLOCKS = 1024
GROWTH = 1.5
FARTHEST = 1.0
LEAST_WEIGHT = 1e-30
CORRELATION = 0.45
"""The same matcher errs alike at a place of the world from wherever it looks, but not quite."""
UP = np.array([0, -1, 0], np.float32)


@dataclass(frozen=True)
class Fusion:
    """How depth maps are averaged.

    Attributes:
        voxel_m: side of a voxel; smaller is finer, and costs memory by the square and time by the
            cube.
        truncation_voxels: how far in front of and behind a measured surface it counts; raising it
            bears more noise and loses thin things.
        min_trust: depths less likely to be right are left out.
        min_views: fewest views that a surface must be seen by; raising it removes more wrong
            matches and what only few views show.
        smallest_piece_m2: connected pieces of less area are left out; None means those smaller than
            a square of 20 voxels if `min_views` see them, and n^2 times smaller if n times as many
            do.
        max_depth_m: farther depths make no surface; None means those whose standard deviation
            exceeds the truncation, which would cut their errors off.
        correlation: of the errors of two views at a place, in [0, 1]; it changes what is stated
            of the surface and not the surface. Fitted by `benchmarks/fused_errors.py`.

    Raises:
        ValueError: if a setting is out of range.
    """

    voxel_m: float
    truncation_voxels: float = 6.0
    min_trust: float = 0.3
    min_views: int = 2
    smallest_piece_m2: float | None = None
    max_depth_m: float | None = None
    correlation: float = CORRELATION

    def __post_init__(self) -> None:
        if not (math.isfinite(self.voxel_m) and self.voxel_m > 0):
            raise ValueError(f"voxel_m must be positive, got {self.voxel_m} m")
        if not self.truncation_voxels >= 1:
            raise ValueError(f"truncation_voxels must be at least 1, got {self.truncation_voxels}")
        if not 0 <= self.min_trust <= 1:
            raise ValueError(f"min_trust must be in [0, 1], got {self.min_trust}")
        if not 0 <= self.correlation <= 1:
            raise ValueError(f"correlation must be in [0, 1], got {self.correlation}")
        if self.min_views < 1:
            raise ValueError(f"min_views must be at least 1, got {self.min_views}")
        if self.smallest_piece_m2 is not None and self.smallest_piece_m2 < 0:
            raise ValueError(f"smallest_piece_m2 must not be negative: {self.smallest_piece_m2}")
        if self.max_depth_m is not None and not self.max_depth_m > 0:
            raise ValueError(f"max_depth_m must be positive, got {self.max_depth_m} m")

    @property
    def truncation_m(self) -> float:
        """How far around a surface it counts, metres."""
        return self.truncation_voxels * self.voxel_m

    @property
    def smallest_m2(self) -> float:
        """Area of the smallest piece that is kept."""
        if self.smallest_piece_m2 is not None:
            return self.smallest_piece_m2
        return (20 * self.voxel_m) ** 2

    def solid(self, view: DepthView) -> Array:
        """Return which depths (H, W) of a view make a surface."""
        trusted: Array = view.trust >= self.min_trust
        if self.max_depth_m is not None:
            return trusted & (view.depth <= self.max_depth_m)
        return trusted & (view.sigma_m <= FARTHEST * self.truncation_m)

    def farthest_m(self, view: DepthView) -> float:
        """Return the greatest depth of a view that makes a surface, 0 if none does."""
        return float(np.max(view.depth, where=self.solid(view), initial=0.0))

    def for_views(self, count: int) -> Fusion:
        """Return settings that `count` views can meet."""
        return replace(self, min_views=max(1, min(self.min_views, count)))


class Volume:
    """The field itself: the one thing in fusion that changes, because it is too large to copy.

    Attributes:
        settings: how it averages.
    """

    def __init__(self, settings: Fusion) -> None:
        """Start an empty field.

        Raises:
            ImportError: if open3d cannot be loaded.
        """
        self.settings = settings
        o3d = loaded_open3d()
        self._tensor = o3d.core.Tensor
        self._grid: Any = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color", "views"),
            (o3d.core.float32,) * 4,
            ((1,), (1,), (3,), (2,)),
            voxel_size=settings.voxel_m,
            block_resolution=BLOCK,
            block_count=FIRST_BLOCKS,
        )

    @property
    def blocks(self) -> int:
        """How many blocks of voxels there are; memory grows with it."""
        return int(self._grid.hashmap().size())

    def add(self, view: DepthView) -> None:
        """Average a view in.

        Args:
            view: pixels without depth, or of less trust than `min_trust`, say nothing.
        """
        trusted = view.trust >= self.settings.min_trust
        depth = np.where(trusted, view.depth, np.nan).astype(np.float32)
        solid = self.settings.solid(view)
        self._make_room(view, solid)
        table = self._grid.hashmap()
        active = np.sort(table.active_buf_indices().numpy().astype(np.int64))
        places = table.key_tensor().numpy()[active]
        seen = _in_view(places, view, BLOCK * self.settings.voxel_m)
        if not seen.any():
            return
        pose = view.world_from_camera.inverse()
        fx, fy, cx, cy = view.K[0, 0], view.K[1, 1], view.K[0, 2], view.K[1, 2]
        noise = view.noise
        average_in(
            self._field(),
            (active[seen], places[seen]),
            (
                depth,
                view.trust.astype(np.float32),
                view.times,
                solid,
                view.image.astype(np.float32),
            ),
            np.array([*pose.R.ravel(), *pose.t, fx, fy, cx, cy], np.float64),
            np.array([noise.base_m, noise.growth_per_m, noise.nearest_m], np.float64),
            np.array(
                [
                    self.settings.voxel_m,
                    self.settings.truncation_m,
                    self.settings.farthest_m(view),
                ],
                np.float64,
            ),
        )

    def surface(self) -> FusedSurface:
        """Return the surface so far, without fragments, in an order that depends on it alone."""
        found = self._extracted()
        settings = self.settings
        few = settings.min_views if settings.smallest_piece_m2 is None else math.inf
        pieces = without_fragments(found, settings.smallest_m2, few_views=few)
        return in_canonical_order(pieces)

    def points(self) -> tuple[Array, Array]:
        """Return where the surface is so far, (N, 3) metres, and its colours (N, 3) uint8."""
        found = self._extracted()
        return found.vertices, found.colours

    def _extracted(self) -> FusedSurface:
        """Return the surface where enough views saw it."""
        if not self.blocks:
            return EMPTY
        _, weight, _, views = self._field()
        whole = weight.copy()
        weight[:] = views[..., :1] >= self.settings.min_views  # only compared with a threshold
        mesh = self._grid.extract_triangle_mesh(weight_threshold=0.5)
        weight[:] = whole
        if "positions" not in mesh.vertex or not len(mesh.vertex.positions):
            return EMPTY
        vertices = mesh.vertex.positions.numpy()
        total, views_and_trust = self._at(vertices)
        count, trust = views_and_trust.T
        return FusedSurface(
            vertices,
            mesh.triangle.indices.numpy().astype(np.int32),
            _unit(mesh.vertex.normals.numpy()),
            np.rint(mesh.vertex.colors.numpy() * 255).clip(0, 255).astype(np.uint8),
            stated_sigma_m(total, count, self.settings.correlation).astype(np.float32),
            count,
            (trust / np.maximum(count, 1)).astype(np.float32),
        )

    def _at(self, places: Array) -> tuple[Array, Array]:
        """Return the weight (N,), and the views and their trust (N, 2), of the nearest voxels."""
        voxel = np.floor(places / self.settings.voxel_m + 0.5).astype(np.int64)
        block = voxel // BLOCK
        x, y, z = (voxel - block * BLOCK).T
        index, found = self._grid.hashmap().find(self._tensor(block.astype(np.int32)))
        known, index = found.numpy().ravel(), index.numpy().astype(np.int64).ravel()
        _, weight, _, views = self._field()
        index = np.where(known, index, 0)
        total = np.where(known, weight[index, z, y, x, 0], 0)
        return total, np.where(known[:, None], views[index, z, y, x], 0)

    def _field(self) -> tuple[Array, Array, Array, Array]:
        """Return the arrays of all blocks, which share memory with the grid."""
        names = ("tsdf", "weight", "color", "views")
        distance, weight, colour, views = (self._grid.attribute(name).numpy() for name in names)
        return distance, weight, colour, views

    def _make_room(self, view: DepthView, solid: Array) -> None:
        """Make the blocks around every depth that makes a surface, (H, W) bool."""
        reach, block_m = self.settings.truncation_m, BLOCK * self.settings.voxel_m
        steps = math.ceil(2 * reach / (block_m / 2)) + 1
        keys = []
        for offset in np.linspace(-reach, reach, steps):
            there = replace(view, depth=view.depth + np.float32(offset))
            keys.append(_packed(there.positions(solid & (there.depth > 0)), block_m))
        wanted = _unpacked(np.unique(np.concatenate(keys)))
        if not len(wanted):
            return
        table = self._grid.hashmap()
        _, known = table.find(self._tensor(wanted))
        missing = wanted[~known.numpy().ravel()]
        if len(missing):
            needed = table.size() + len(missing)
            if needed > table.capacity():
                table.reserve(int(needed * GROWTH))
            table.activate(self._tensor(missing))


def stated_sigma_m(weight: Array, views: Array, correlation: float) -> Array:
    """Return the standard deviation of a weighted mean of errors that are alike in part.

    n errors of the variance s^2, any two with the correlation r, have a mean of the variance
    s^2 / n (1 + (n - 1) r), and n / s^2 is the weight W.

    Args:
        weight: (N,), W in 1 / m^2.
        views: (N,), n.
        correlation: r.
    """
    alike = 1 + np.maximum(views - 1, 0) * correlation
    sigma: Array = np.sqrt(alike / np.maximum(weight, LEAST_WEIGHT))
    return sigma


def _in_view(places: Array, view: DepthView, block_m: float) -> Array:
    """Return which blocks (N,) may show in a view: a ball around each against its four sides."""
    height, width = view.depth.shape
    middles = view.world_from_camera.inverse().apply((places + 0.5) * block_m)
    x, y, z = middles.T
    radius = math.sqrt(3) / 2 * block_m
    (fx, _, cx), (_, fy, cy), _ = view.K
    inside: Array = z > -radius
    for focal, along, behind in (
        (fx, x, cx + 1),
        (fx, -x, width - cx),
        (fy, y, cy + 1),
        (fy, -y, height - cy),
    ):
        inside &= focal * along + behind * z > -radius * math.hypot(focal, behind)
    return inside


def _packed(places: Array, block_m: float) -> Array:
    """Return one number for the block of every place, (N,) int64."""
    x, y, z = np.floor(places / block_m).astype(np.int64).T + (1 << 20)
    packed: Array = (x << 42) | (y << 21) | z
    return packed


def _unpacked(keys: Array) -> Array:
    """Return the blocks (N, 3) int32 of packed numbers."""
    mask = (1 << 21) - 1
    blocks = np.stack([keys >> 42, (keys >> 21) & mask, keys & mask], axis=1) - (1 << 20)
    return np.ascontiguousarray(blocks.astype(np.int32))


def _unit(normals: Array) -> Array:
    """Return normals (V, 3) of length 1; where the field is flat and tells none, straight up."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    told = np.isfinite(length) & (length > 0)
    unit: Array = np.divide(normals, length, where=told, out=np.tile(UP, (len(normals), 1)))
    return unit.astype(np.float32)
