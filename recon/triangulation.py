"""From disparities to points in space, leaving out points that no surface explains."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib.pair import RectifiedPair
from calib.rig import RectifiedGeometry
from recon.disparity_noise import DisparityNoise
from recon.normals import surface_normals
from recon.types import Array, DisparityMap, PixelStatus, PointCloud, Removal

__all__ = [
    "Triangulation",
    "depth_map",
    "depth_sigma",
    "flying_pixels",
    "positions",
    "triangulate",
]

NEAREST_TO_INFINITY_PX = 1e-3
"""Disparities less than this in front of infinity count as infinite: their depth is all noise."""

SURFACE_TOLERANCE_PX = 0.5
"""How far a disparity may lie from a surface and still belong to it: noise of a good match."""

SIGMA_PX = 0.5
"""Standard deviation of a disparity where nothing says how likely it is to be right."""

FLAT_SHARE = 0.25
"""A pixel joins a neighbour of its own if the step to it is below this share of the mean slope."""


def depth_map(disparity: DisparityMap[Array], geometry: RectifiedGeometry) -> Array:
    """Turn every disparity into a depth, Z = f B / (d - d_inf).

    Args:
        disparity: (H, W), of the left view, in pixels.
        geometry: of the pair that it was computed from.

    Returns:
        (H, W) float32 metres; NaN where there is no disparity and at or beyond infinity.

    Raises:
        ValueError: if `disparity` and `geometry` differ in size.
    """
    _check_size(disparity, geometry)
    in_front = disparity.values.astype(np.float64) - geometry.disparity_at_infinity
    in_front[~(in_front > NEAREST_TO_INFINITY_PX)] = np.nan
    return (geometry.focal_px * geometry.baseline_m / in_front).astype(np.float32)


def depth_sigma(
    depth: Array, geometry: RectifiedGeometry, disparity_sigma_px: float | Array
) -> Array:
    """Return the standard deviation of a depth, sigma_Z = Z^2 / (f B) sigma_d.

    It is the derivative of Z = f B / (d - d_inf) by d: twice as far is four times less certain.

    Args:
        depth: any shape, metres.
        geometry: of the pair.
        disparity_sigma_px: standard deviation of the disparities, pixels: one for all, or one
            each in the shape of `depth`.

    Returns:
        float32 metres, of the shape of `depth`; NaN where `depth` is NaN.
    """
    scale = disparity_sigma_px / (geometry.focal_px * geometry.baseline_m)
    return (np.square(depth, dtype=np.float64) * scale).astype(np.float32)


def positions(depth: Array, pixels: Array, geometry: RectifiedGeometry) -> Array:
    """Place pixels of the left view in space, X = (x - cx) Z / f and Y = (y - cy) Z / f.

    Source: Hartley & Zisserman, Multiple View Geometry, 2nd ed. 2004, section 6.1.

    Args:
        depth: (H, W) metres.
        pixels: (H, W) bool, which to place; their depth must be finite.
        geometry: of the pair.

    Returns:
        (N, 3) float32 metres in the left rectified frame, in row order.
    """
    y, x = np.nonzero(pixels)
    z = depth[y, x].astype(np.float64)
    cx, cy = geometry.centre_left
    points = np.stack(
        [(x - cx) * z / geometry.focal_px, (y - cy) * z / geometry.focal_px, z], axis=1
    )
    return points.astype(np.float32)


def triangulate(
    disparity: DisparityMap[Array],
    pair: RectifiedPair,
    *,
    kept: Array | None = None,
    disparity_sigma_px: float | Array = SIGMA_PX,
    depth_edge_px: float = 1.0,
) -> PointCloud:
    """Place every pixel with a disparity in space.

    With f the focal length and B the baseline, Z = f B / (d - d_inf), X = (x - cx) Z / f and
    Y = (y - cy) Z / f, where d_inf is the disparity at infinity.

    Source: Szeliski, Computer Vision, 2nd ed. 2022, section 12.1.

    Args:
        disparity: (H, W), of the left view, in pixels.
        pair: the images and geometry it was computed from.
        kept: (H, W) bool, the pixels to place; all of them if not given.
        disparity_sigma_px: standard deviation of the disparities, pixels, one for all or (H, W);
            it scales `depth_sigma_m` of the points and nothing else.
        depth_edge_px: smallest step of disparity that no normal is fitted over.

    Returns:
        N points in metres, in row order; pixels at or beyond infinity are left out.

    Raises:
        ValueError: if `disparity` and `pair` differ in size.
    """
    depth = depth_map(disparity, pair.geometry)
    placed = np.isfinite(depth)
    if kept is not None:
        placed &= kept
    on_surfaces = np.where(placed, disparity.values, np.nan)
    normals = surface_normals(on_surfaces, pair.geometry, depth_edge_px=depth_edge_px)
    return PointCloud(
        points=positions(depth, placed, pair.geometry),
        colours=pair.left[placed],
        normals=normals[placed],
        confidence=disparity.confidence[placed],
        depth_sigma_m=depth_sigma(depth, pair.geometry, disparity_sigma_px)[placed],
        status=disparity.status[placed],
    )


def flying_pixels(values: Array, *, depth_edge_px: float = 1.0, radius_px: int = 3) -> Array:
    """Find pixels that hang in the air between the surfaces on both sides of a depth edge.

    A row (then a column) is cut at x and at distances r up to the radius; with a2, a1, d, b1, b2
    the disparities at x - 2r, x - r, x, x + r and x + 2r, a pixel flies if for some r

    * there is an edge: |b1 - a1| exceeds what the slopes beside it, |a1 - a2| + |b2 - b1|,
      account for by more than twice the threshold (a slanted plane has no excess; twice, because
      the noise of four disparities enters the difference);
    * it is between: d differs from both a1 and b1 by more than the tolerance, with opposite
      signs (a pole is in front of both sides, so it never is);
    * no side explains it: d is not on the straight line through a1 and a2, nor through b1 and b2;
    * it has no surface of its own: the smaller step to a direct neighbour is not small against
      the slope (b1 - a1) / 2r, as it would be on a narrow strip of a third depth.

    Args:
        values: (H, W) disparities in pixels, NaN where there is none.
        depth_edge_px: smallest jump that is an edge; raising it keeps more mixed pixels.
        radius_px: half the widest smear of an edge that is recognised; raising it finds softer
            edges and costs time in proportion.

    Returns:
        (H, W) bool; never true where `values` is NaN or beside missing pixels.
    """
    values = values.astype(np.float32, copy=False)
    along_rows = _flying_along_rows(values, depth_edge_px, radius_px)
    along_columns = _flying_along_rows(values.T, depth_edge_px, radius_px).T
    flying: Array = along_rows | along_columns
    return flying


def _flying_along_rows(values: Array, depth_edge_px: float, radius_px: int) -> Array:
    """Apply the rule of `flying_pixels` to every row."""
    width = values.shape[1]
    border = 2 * radius_px
    beside = ((0, 0), (border, border))
    padded = np.pad(values, beside, mode="reflect", reflect_type="odd")  # continues a slant

    def shifted(columns: int) -> Array:
        return padded[:, border + columns : border + columns + width]

    own_step = np.fmin(np.abs(values - shifted(-1)), np.abs(shifted(1) - values))
    flying: Array = np.zeros(values.shape, dtype=bool)
    for r in range(1, radius_px + 1):
        a2, a1, b1, b2 = shifted(-2 * r), shifted(-r), shifted(r), shifted(2 * r)
        before, after, across = a1 - a2, b2 - b1, np.abs(b1 - a1)
        nearer_side = np.minimum(np.abs(values - a1), np.abs(b1 - values))
        unexplained = np.minimum(np.abs(values - a1 - before), np.abs(b1 - after - values))
        flying |= (
            (across - np.abs(before) - np.abs(after) > 2 * depth_edge_px)
            & ((values - a1) * (b1 - values) > 0)
            & (nearer_side > SURFACE_TOLERANCE_PX)
            & (unexplained > SURFACE_TOLERANCE_PX)
            & (own_step > FLAT_SHARE / (2 * r) * across)
        )
    return flying


@dataclass(frozen=True)
class Triangulation:
    """Place the trustworthy pixels of a disparity map in space.

    Attributes:
        include: names of the `PixelStatus` to place, in lower case. Extrapolated disparities
            (filled_occlusion) are left out by default: no second camera saw those points.
        remove_flying_pixels: leave out pixels between the surfaces at a depth edge.
        depth_edge_px: smallest jump of disparity that is a depth edge. The disparity of a surface
            that both cameras see changes by less than one pixel a pixel; raising it keeps more
            mixed pixels.
        min_depth_m: leave out points nearer than this; None keeps all.
        max_depth_m: leave out points farther away; None keeps all.
        min_confidence: leave out pixels below this confidence, in [0, 1].
        disparity_sigma_px: standard deviation of every disparity, for the error of the depth, such
            as the report of a calibration states; None lets each pixel have its own by `noise`.
        noise: what the confidence of a disparity says of its error; without one and without a
            `disparity_sigma_px` it is half a pixel.

    Raises:
        ValueError: if a setting is out of range or a status has no such name.
    """

    include: tuple[str, ...] = ("matched", "filled_mismatch")
    remove_flying_pixels: bool = True
    depth_edge_px: float = 1.0
    min_depth_m: float | None = None
    max_depth_m: float | None = None
    min_confidence: float = 0.0
    disparity_sigma_px: float | None = None
    noise: DisparityNoise | None = None

    def __post_init__(self) -> None:
        names = [state.name.lower() for state in PixelStatus.with_disparity()]
        unknown = [name for name in self.include if name not in names]
        if unknown:
            raise ValueError(f"include has {unknown}; states with a disparity are {names}")
        if not self.depth_edge_px > 0:
            raise ValueError(f"depth_edge_px must be positive, got {self.depth_edge_px} px")
        _check_depths(self.min_depth_m, self.max_depth_m)
        if not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence must be in [0, 1], got {self.min_confidence}")
        if self.disparity_sigma_px is not None and not self.disparity_sigma_px > 0:
            raise ValueError(
                f"disparity_sigma_px must be positive, got {self.disparity_sigma_px} px"
            )

    def kept_pixels(self, disparity: DisparityMap[Array], geometry: RectifiedGeometry) -> Array:
        """Return which pixels become points; the mesh is made of the same ones.

        Args:
            disparity: (H, W), of the left view, in pixels.
            geometry: of the pair that it was computed from.

        Returns:
            (H, W) bool.

        Raises:
            ValueError: if `disparity` and `geometry` differ in size.
        """
        return self.selection(disparity, geometry)[0]

    def disparity_sigma(self, disparity: DisparityMap[Array]) -> Array:
        """Return the standard deviation of every disparity.

        Args:
            disparity: (H, W), with the confidence that `noise` was fitted to.

        Returns:
            (H, W) float32 pixels; NaN where there is no disparity.
        """
        if self.disparity_sigma_px is None and self.noise is not None:
            return self.noise(disparity.confidence, disparity.status)
        one = np.float32(self.disparity_sigma_px or SIGMA_PX)
        sigma: Array = np.where(disparity.valid, one, np.float32(np.nan))
        return sigma

    def selection(
        self, disparity: DisparityMap[Array], geometry: RectifiedGeometry
    ) -> tuple[Array, tuple[Removal, ...]]:
        """Return `kept_pixels`, and what each filter took away from the pixels with a disparity.

        A pixel that several filters would remove counts for the first.

        Args:
            disparity: (H, W), of the left view, in pixels.
            geometry: of the pair that it was computed from.

        Returns:
            kept: (H, W) bool.
            removals: in the order in which the filters ran.

        Raises:
            ValueError: if `disparity` and `geometry` differ in size.
        """
        _check_size(disparity, geometry)
        kept = disparity.valid
        removals = []
        for name, passes in self._filters(disparity, geometry):
            before = int(kept.sum())
            kept = kept & passes
            removals.append(Removal(name, before - int(kept.sum()), before))
        return kept, tuple(removals)

    def _filters(
        self, disparity: DisparityMap[Array], geometry: RectifiedGeometry
    ) -> Iterator[tuple[str, Array]]:
        """Yield the filters in use by name, with the pixels (H, W) that pass each."""
        depth = depth_map(disparity, geometry)
        included = [int(PixelStatus[name.upper()]) for name in self.include]
        yield "status", np.isin(disparity.status, included)
        yield "at infinity", np.isfinite(depth)
        if self.min_depth_m is not None:
            yield "nearer than min_depth_m", depth >= self.min_depth_m
        if self.max_depth_m is not None:
            yield "farther than max_depth_m", depth <= self.max_depth_m
        if self.min_confidence > 0:
            yield "confidence", disparity.confidence >= self.min_confidence
        if self.remove_flying_pixels:
            flying = flying_pixels(disparity.values, depth_edge_px=self.depth_edge_px)
            yield "flying pixels", ~flying

    def __call__(
        self, disparity: DisparityMap[Array], pair: RectifiedPair, *, kept: Array | None = None
    ) -> PointCloud:
        """Return the kept pixels as points, in row order.

        Args:
            disparity: (H, W), of the left view, in pixels.
            pair: the images and geometry it was computed from.
            kept: (H, W) bool, of `kept_pixels`; computed if not given.

        Raises:
            ValueError: if `disparity` and `pair` differ in size.
        """
        if kept is None:
            kept = self.kept_pixels(disparity, pair.geometry)
        return triangulate(
            disparity,
            pair,
            kept=kept,
            disparity_sigma_px=self.disparity_sigma(disparity),
            depth_edge_px=self.depth_edge_px,
        )


def _check_depths(nearest: float | None, farthest: float | None) -> None:
    """Raise ValueError unless a range of depths in metres holds any."""
    for name, value in (("min_depth_m", nearest), ("max_depth_m", farthest)):
        if value is not None and not value > 0:
            raise ValueError(f"{name} must be positive, got {value} m")
    if nearest is not None and farthest is not None and not nearest < farthest:
        raise ValueError(f"min_depth_m {nearest} m must be below max_depth_m {farthest} m")


def _check_size(disparity: DisparityMap[Array], geometry: RectifiedGeometry) -> None:
    """Raise ValueError unless a disparity map has the size of the images."""
    width, height = geometry.size
    if disparity.values.shape != (height, width):
        raise ValueError(
            f"disparity is {disparity.values.shape} but the left image is {(height, width)} "
            "(rows, columns); was the pair resized after matching?"
        )
