"""The stages of stereo matching, in order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from calib.pair import Image, RectifiedPair
from calib.row_alignment import RowAlignment
from recon.aggregation import Aggregation
from recon.coarse_to_fine import CoarseToFine, both_views_checked
from recon.confidence import Confidence
from recon.consistency import left_right_check, reject_small_segments
from recon.enlargement import Enlargement
from recon.filling import Filling, SurfaceFilling
from recon.matching_cost import MatchingCost
from recon.observer import Observer, ignore
from recon.optimisation import Optimisation, WinnerTakesAll
from recon.refinement import Refinement
from recon.strips import GRID_PX, Reach, Strip
from recon.tiles import of_left_view, of_right_view
from recon.types import Array, CostVolume, DisparityMap

__all__ = ["Matcher"]

BYTES_OF_A_COST = 4


@dataclass(frozen=True)
class Matcher:
    """From a rectified pair to the disparity of the left view.

    Source: Scharstein & Szeliski, A Taxonomy and Evaluation of Dense Two-Frame Stereo
    Correspondence Algorithms, IJCV 47 2002, section 3.

    Attributes:
        matching_cost: how badly two pixels fit.
        aggregation: how the costs around a pixel speak for it.
        optimisation: which candidate a pixel gets.
        left_right_tolerance_px: larger keeps more of what the right view does not confirm.
        min_segment_px: matched islands with fewer pixels are rejected; 0 keeps all.
        filling: for rejected pixels; without one they stay without disparity.
        confidence: makes probabilities of the peak margins that are the confidence without it.
        refinements: one after the other.
        volume_limit_mb: a volume that would take more MB is made strip by strip, from the top and
            at least 16 rows at a time; about four such volumes are in memory at once. The result
            is the same, but for semi-global paths: they begin 64 rows outside the strip.
        coarse_to_fine: matches a smaller pair first and searches only around what that shows;
            without one every pixel has every candidate.
        row_alignment: shifts the rows of the right view to those of the left first, by what a
            rectification leaves; without one they are matched as they are.
        enlargement: searches anew at twice the size, around what was found.
    """

    matching_cost: MatchingCost
    aggregation: Aggregation
    optimisation: Optimisation = field(default_factory=WinnerTakesAll)
    left_right_tolerance_px: float = 1.0
    min_segment_px: int = 100
    filling: Filling | None = field(default_factory=SurfaceFilling)
    confidence: Confidence | None = None
    refinements: tuple[Refinement, ...] = ()
    volume_limit_mb: float = 768.0
    coarse_to_fine: CoarseToFine | None = None
    row_alignment: RowAlignment | None = None
    enlargement: Enlargement | None = None

    def __post_init__(self) -> None:
        for name in ("left_right_tolerance_px", "min_segment_px"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if not self.volume_limit_mb > 0:
            raise ValueError(f"volume_limit_mb must be positive, got {self.volume_limit_mb}")
        if self.enlargement is not None:
            self.enlargement.compared_by(self.matching_cost)

    @torch.inference_mode()
    def __call__(
        self,
        pair: RectifiedPair,
        disparities: range,
        *,
        device: str | torch.device = "cpu",
        observe: Observer = ignore,
    ) -> DisparityMap[Array]:
        """Match a pair.

        Args:
            pair: rectified images.
            disparities: candidates d = x_left - x_right in pixels, consecutive.
            device: where to compute.
            observe: told every intermediate result, in order; tensors, on `device`. If the whole
                volume would pass `volume_limit_mb`, volumes come strip by strip, those of the
                matching cost with the rows that overlap; coarse to fine, they come tile by tile.

        Returns:
            (H, W) of the left view.

        Raises:
            ValueError: if `disparities` is empty or leaves candidates out.
        """
        if len(disparities) == 0 or disparities.step != 1:
            raise ValueError(f"disparities must be consecutive, at least one, got {disparities}")
        if self.row_alignment is not None:
            pair = self.row_alignment(pair)
            observe("row_alignment", pair)
        left, right = (_as_tensor(image, device) for image in (pair.left, pair.right))

        of_left, of_right = self._disparities_of_both_views(left, right, disparities, observe)
        if self.enlargement is not None and self.enlargement.fits(left):
            observe("small/left", of_left)
            observe("small/right", of_right)
            found = of_left, of_right
            of_left, of_right = self.enlargement(
                self.matching_cost, (left, right), found, disparities
            )
        observe("disparity/left", of_left)
        observe("disparity/right", of_right)

        disparity = left_right_check(
            of_left, of_right, tolerance_px=self.left_right_tolerance_px, disparities=disparities
        )
        observe("left_right_check", disparity)
        disparity = reject_small_segments(disparity, min_segment_px=self.min_segment_px)
        observe("small_segments", disparity)
        if self.filling is not None:
            disparity = self.filling(disparity, of_right=of_right, guide=left)
            observe("filling", disparity)
        if self.confidence is not None:
            disparity = self.confidence(disparity, of_left, of_right, guide=left)
            observe("confidence", disparity)

        for refinement in self.refinements:
            disparity = refinement(disparity, guide=left)
            observe(f"refinement/{type(refinement).__name__}", disparity)
        return DisparityMap(
            *(a.cpu().numpy() for a in (disparity.values, disparity.status, disparity.confidence))
        )

    def _disparities_of_both_views(
        self, left: Tensor, right: Tensor, disparities: range, observe: Observer
    ) -> tuple[DisparityMap[Tensor], DisparityMap[Tensor]]:
        """Return what the costs say of either view, before any check."""
        if self.coarse_to_fine is None or not self.coarse_to_fine.fits(left):
            return self._strip_by_strip(left, right, disparities, observe)
        return self._tile_by_tile(self.coarse_to_fine, (left, right), disparities, observe)

    def _tile_by_tile(
        self,
        coarse_to_fine: CoarseToFine,
        views: tuple[Tensor, Tensor],
        disparities: range,
        observe: Observer,
    ) -> tuple[DisparityMap[Tensor], DisparityMap[Tensor]]:
        """Return the same, every tile searched only around what a smaller pair shows there."""
        left, right = (coarse_to_fine.shrunk(view) for view in views)
        searched = coarse_to_fine.shrunk_range(disparities)
        coarse_left, coarse_right = both_views_checked(
            *self._strip_by_strip(left, right, searched, ignore),
            searched,
            min_segment_px=self.min_segment_px // coarse_to_fine.shrink**2,
        )
        observe("coarse/left", coarse_left)
        observe("coarse/right", coarse_right)

        overlap = min(self._reach.optimisation, coarse_to_fine.overlap_px)
        reach = self._reach._replace(optimisation=overlap)
        height, width, _ = views[0].shape
        cut = partial(
            coarse_to_fine.tiles,
            searched=disparities,
            size=(height, width),
            reach=reach,
            limit_mb=self.volume_limit_mb,
        )
        return (
            of_left_view(self, views, cut(coarse_left, "left"), reach=reach, observe=observe),
            of_right_view(self, views, cut(coarse_right, "right"), reach=reach, observe=observe),
        )

    def _strip_by_strip(
        self, left: Tensor, right: Tensor, disparities: range, observe: Observer
    ) -> tuple[DisparityMap[Tensor], DisparityMap[Tensor]]:
        """Return the same, every pixel searched for all disparities."""
        of_left, of_right = [], []
        height, width, _ = left.shape
        for strip in self._strips(height, width * len(disparities) * BYTES_OF_A_COST):
            views = left[strip.seen], right[strip.seen]
            volume = self.matching_cost(*views, disparities, rows=strip.costs)
            observe("matching_cost", replace(volume, origin=(strip.first_cost, 0)))
            volume = self.aggregation(volume, guide=views[0][strip.costs])
            volume = CostVolume(volume.cost[strip.chosen], disparities)
            origin = strip.first_result, 0
            observe(
                "aggregation",
                CostVolume(volume.cost[strip.result], disparities, origin=origin),
            )

            of_left.append(self._choice(volume, views[0], strip))
            of_right.append(self._choice(volume.seen_from_right(), views[1], strip))
            del volume  # before the next strip takes as much again
        return _stacked(of_left), _stacked(of_right)

    def _choice(self, volume: CostVolume, view: Tensor, strip: Strip) -> DisparityMap[Tensor]:
        """Return the disparities of the rows of a strip in one view."""
        found = self.optimisation(volume, guide=view[strip.costs][strip.chosen])
        rows = strip.result
        return DisparityMap(found.values[rows], found.status[rows], found.confidence[rows])

    @property
    def _reach(self) -> Reach:
        """How far the stages look beyond a pixel."""
        return Reach(
            self.matching_cost.margin_px, self.aggregation.margin_px, self.optimisation.margin_px
        )

    def _strips(self, height: int, row_bytes: int) -> Iterator[Strip]:
        """Cut an image into strips whose volumes keep the limit."""
        rows = int(self.volume_limit_mb * 1e6 / row_bytes)
        reach = self._reach
        margin = reach.aggregation + reach.optimisation
        step = height if rows >= height else max(GRID_PX, rows - 2 * margin)
        for top in range(0, height, step):
            yield Strip.around(slice(top, min(top + step, height)), height, reach)


def _as_tensor(image: Image, device: str | torch.device) -> Tensor:
    """Return (H, W, 3) float32 in [0, 1] on `device`."""
    return torch.from_numpy(np.divide(image, np.float32(255))).to(device)


def _stacked(strips: list[DisparityMap[Tensor]]) -> DisparityMap[Tensor]:
    """Put maps of strips below each other."""
    return DisparityMap(
        torch.cat([strip.values for strip in strips]),
        torch.cat([strip.status for strip in strips]),
        torch.cat([strip.confidence for strip in strips]),
    )
