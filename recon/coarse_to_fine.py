"""Where to search which disparities, from a map of the pair at a smaller size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch.nn.functional as F
from torch import Tensor

from recon.consistency import left_right_check, reject_small_segments
from recon.kernels.holes import from_row
from recon.strips import Reach, grown
from recon.types import DisparityMap, PixelStatus

__all__ = ["CoarseToFine", "Tile", "both_views_checked"]

View = Literal["left", "right"]

SMALLEST_COARSE_PX = 32
"""An image whose shorter side shrinks to less is too small to say anything about its parts."""

WORK_OF_FEATURES = 32
"""What describing a pixel takes, in candidates of a pixel; an estimate, it only moves the cuts."""

BYTES_OF_A_COST = 4


@dataclass(frozen=True)
class Tile:
    """A part of one view, and the candidates that it is searched for.

    Attributes:
        rows: of the image.
        columns: of the image.
        candidates: d = x_left - x_right in pixels, consecutive.
    """

    rows: slice
    columns: slice
    candidates: range


class Bounds(NamedTuple):
    """Between which disparities the surface at a pixel may lie; (h, w), of a coarse view.

    Attributes:
        low: in pixels of the whole view.
        high: likewise.
        matched: whether the pixel was measured.
    """

    low: Tensor
    high: Tensor
    matched: Tensor


@dataclass(frozen=True)
class CoarseToFine:
    """Match a smaller pair first, then search only around what was found there, tile by tile.

    A tile of either view is searched from the lowest to the highest disparity that its own coarse
    map has in it and `overlap_px` around it. What is not matched there may lie anywhere between
    the matched pixels on its left and on its right, so the background of an occlusion is searched.
    The view is halved, and the halves again, wherever that saves work: large tiles on smooth
    surfaces, small ones at edges of depth.

    What the coarse map does not show is not found: an object narrower than about two coarse pixels
    in front of a matched surface, by more than `margin_px`, may get the disparity of that surface.
    The margin of a peak is that within the band.

    Source: the idea of narrowing the search by a coarser level from Rothermel, Wenzel, Fritsch &
    Haala, SURE: Photogrammetric Surface Reconstruction from Imagery, LC3D Workshop 2012, there
    with a range of its own for every pixel; with tiles all stages stay as they are.

    Attributes:
        shrink: how many pixels become one, along either axis; larger is faster and sees less.
        margin_px: candidates searched beyond what the coarse map has, on either side; larger
            is slower and finds thinner things.
        tile_px: no side is halved into less; larger searches more beside edges of depth, smaller
            leaves more work to what overlaps.
        overlap_px: how far beyond its tile the choice looks, where its method looks farther;
            larger is slower and shows less of the borders.
        least_matched: share of coarse pixels that must be matched, else a tile is searched whole.
    """

    shrink: int = 4
    margin_px: int = 8
    tile_px: int = 32
    overlap_px: int = 16
    least_matched: float = 0.1

    def __post_init__(self) -> None:
        if self.shrink < 2:
            raise ValueError(
                f"shrink must be at least 2, got {self.shrink}; to match directly, leave "
                "coarse_to_fine out"
            )
        for name in ("margin_px", "overlap_px"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)} px")
        if self.tile_px < 1:
            raise ValueError(f"tile_px must be positive, got {self.tile_px} px")
        if not 0 <= self.least_matched <= 1:
            raise ValueError(f"least_matched must be in [0, 1], got {self.least_matched}")

    def fits(self, view: Tensor) -> bool:
        """Return whether a view (H, W, 3) is large enough for its small copy to mean something."""
        return min(view.shape[:2]) >= self.shrink * SMALLEST_COARSE_PX

    def shrunk(self, view: Tensor) -> Tensor:
        """Return the mean of every `shrink` x `shrink` pixels; fewer at the right and the bottom.

        Args:
            view: (H, W, 3).

        Returns:
            (ceil(H / shrink), ceil(W / shrink), 3).
        """
        channels = view.permute(2, 0, 1)[None]
        means = F.avg_pool2d(channels, self.shrink, ceil_mode=True, count_include_pad=False)
        return means[0].permute(1, 2, 0).contiguous()

    def shrunk_range(self, searched: range) -> range:
        """Return the candidates of the small pair that cover those of the whole one."""
        return range(
            math.floor(searched[0] / self.shrink), math.ceil(searched[-1] / self.shrink) + 1
        )

    def bounds(self, coarse: DisparityMap[Tensor]) -> Bounds | None:
        """Return where surfaces may lie; None if nothing is matched.

        Args:
            coarse: (h, w), of either view, checked.
        """
        matched = coarse.status.cpu() == int(PixelStatus.MATCHED)
        if not matched.any():
            return None
        known = self.shrink * coarse.values.cpu().masked_fill(~matched, float("nan"))
        return Bounds(from_row(known), -from_row(-known), matched)

    def candidates(self, part: tuple[slice, slice], bounds: Bounds | None, all_: range) -> range:
        """Return the disparities that are plausible in a part of a view.

        Args:
            part: rows and columns, with what surrounds them.
            bounds: of that view.
            all_: the disparities to choose from.
        """
        if bounds is None:
            return all_
        s = self.shrink
        place = tuple(slice(edge.start // s, math.ceil(edge.stop / s)) for edge in part)
        if bounds.matched[place].float().mean() < self.least_matched:
            return all_
        low = math.floor(float(bounds.low[place].min())) - self.margin_px
        high = math.ceil(float(bounds.high[place].max())) + self.margin_px
        low, high = (min(max(end, all_[0]), all_[-1]) for end in (low, high))
        return range(low, high + 1)

    def tiles(
        self,
        coarse: DisparityMap[Tensor],
        view: View,
        searched: range,
        *,
        size: tuple[int, int],
        reach: Reach,
        limit_mb: float,
    ) -> list[Tile]:
        """Cut a view into tiles with the candidates of each.

        Args:
            coarse: (h, w) of that view, checked.
            view: which.
            searched: all candidates.
            size: H and W of the whole view.
            reach: of the stages, on the whole views.
            limit_mb: a tile whose costs take more is halved, down to `tile_px`.
        """
        layout = _Layout(self, self.bounds(coarse), view, searched, size, reach, limit_mb)
        _, tiles = layout.cheapest(slice(0, size[0]), slice(0, size[1]))
        return tiles


def both_views_checked(
    of_left: DisparityMap[Tensor],
    of_right: DisparityMap[Tensor],
    searched: range,
    *,
    min_segment_px: int,
) -> tuple[DisparityMap[Tensor], DisparityMap[Tensor]]:
    """Return what each view has of a surface that the other one confirms within 1 px.

    Seen in a mirror the right view is a left one.

    Args:
        of_left: (h, w), before any check.
        of_right: (h, w), likewise.
        searched: the candidates.
        min_segment_px: islands with fewer pixels are chance matches.
    """

    def checked(one: DisparityMap[Tensor], other: DisparityMap[Tensor]) -> DisparityMap[Tensor]:
        agreed = left_right_check(one, other, tolerance_px=1.0, disparities=searched)
        return reject_small_segments(agreed, min_segment_px=min_segment_px)

    return checked(of_left, of_right), _mirrored(checked(_mirrored(of_right), _mirrored(of_left)))


def _mirrored(disparity: DisparityMap[Tensor]) -> DisparityMap[Tensor]:
    """Return a map with its columns in the other order."""
    return DisparityMap(
        *(field.flip(1) for field in (disparity.values, disparity.status, disparity.confidence))
    )


class _Layout(NamedTuple):
    """What decides how a view is cut; see `CoarseToFine.tiles`."""

    settings: CoarseToFine
    bounds: Bounds | None
    view: View
    searched: range
    size: tuple[int, int]
    reach: Reach
    limit_mb: float

    def cheapest(self, rows: slice, columns: slice) -> tuple[float, list[Tile]]:
        """Return the least work for a part of the view, and the tiles that take it."""
        around = self.reach.optimisation
        part = grown(rows, around, self.size[0]), grown(columns, around, self.size[1])
        reachable = self._reachable(part[1])
        tile = Tile(rows, columns, self.settings.candidates(part, self.bounds, reachable))
        work, size_mb = self._work(tile)
        halves = _halves(rows, columns, self.settings.tile_px)
        if not halves:
            return work, [tile]
        smaller = [self.cheapest(*half) for half in halves]
        together = sum(each for each, _ in smaller)
        if together < work or size_mb > self.limit_mb:
            return together, [each for _, tiles in smaller for each in tiles]
        return work, [tile]

    def _reachable(self, columns: slice) -> range:
        """Return the candidates that lead some column into the other view, at least one."""
        first, last = columns.start, columns.stop - 1
        end = self.size[1] - 1
        low, high = (first - end, last) if self.view == "left" else (-last, end - first)
        low, high = max(low, self.searched[0]), min(high, self.searched[-1])
        return range(low, high + 1) if low <= high else self.searched[:1]

    def _work(self, tile: Tile) -> tuple[float, float]:
        """Return the work for a tile, in candidates of a pixel, and the size of its volume, MB."""
        count = len(tile.candidates)
        around = self.reach.aggregation + self.reach.optimisation
        rows, columns = (
            part.stop - part.start
            for part in (grown(tile.rows, around, self.size[0]),
                         grown(tile.columns, around + count // 2, self.size[1]))
        )  # fmt: skip
        return (
            float(rows * columns * (count + WORK_OF_FEATURES)),
            rows * columns * count * BYTES_OF_A_COST / 1e6,
        )


def _halves(rows: slice, columns: slice, least: int) -> list[tuple[slice, slice]]:
    """Return the halves across the longer side, none if they were shorter than `least`."""
    sides = [rows, columns]
    longer = max((0, 1), key=lambda axis: sides[axis].stop - sides[axis].start)
    first, last = sides[longer].start, sides[longer].stop
    middle = (first + last) // 2
    if middle - first < least:
        return []
    parts = slice(first, middle), slice(middle, last)
    return [(part, columns) if longer == 0 else (rows, part) for part in parts]
