"""A second search at twice the size, around what the first one found."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from recon.aggregation import BilateralAggregation
from recon.kernels.bands import (
    Bands,
    add_doubt,
    distances_in_bands,
    lowest_in_bands,
    means_in_bands,
    paths_in_bands,
    valleys_in_bands,
)
from recon.kernels.bilateral import LEVELS
from recon.kernels.colour import luminance
from recon.kernels.compiled import Array, array_of
from recon.matching_cost import MatchingCost, SoftCensus, VectorCost
from recon.optimisation import SemiGlobal
from recon.optimisation.winner_takes_all import valley_offset
from recon.strips import GRID_PX, Reach, Strip
from recon.types import DisparityMap

__all__ = ["Enlargement"]

FACTOR = 2
COSTS = ("same", "soft_census")
QUICK = SoftCensus(sigma_px=2.0)
"""Nearer neighbours count more: in an enlarged view they are what is sharp."""
BYTES_AT_ONCE = 128e6
"""Of what describes the pixels of both views, as far as that is known before."""
BYTES_OF_VECTORS = 2 * 64 * 4
SHARED_SLOPE = -0.4
"""Of the valleys in which fractions are read, see `valley_offset`: steeper than parabolas."""
SAME_PX = 1.0
"""Fine pixels of one coarse pixel that differ by more belong to different surfaces."""

Maps = tuple[DisparityMap[Tensor], DisparityMap[Tensor]]


@dataclass(frozen=True)
class Enlargement:
    """Enlarge both views twofold and choose anew, between few candidates half a pixel apart.

    A cost that looks at some pixels around a pixel sees half as far in an enlarged view: edges
    become sharper and steps finer, but flat surfaces harder to tell. So the first search, at the
    size of the photographs, still decides where a surface is. Every pixel of an enlarged view is
    searched only from the lowest to the highest disparity that the first search has around it;
    and there a disparity d costs trust * min(((d - d_0) / trust_px)^2, 1) more, d_0 that of the
    first search, which is what decides where the views say nothing. Semi-global paths along rows
    and columns choose; but fractions come from the valley of the bilateral means around the
    choice, for sums of paths pull towards whole candidates. Of four results the mean is kept.

    It pays for photographs that are sharp to the pixel, as those that were made smaller are.

    Source: bands around a coarser result from Rothermel, Wenzel, Fritsch & Haala, SURE:
    Photogrammetric Surface Reconstruction from Imagery, LC3D Workshop 2012; candidates half a
    pixel apart from Szeliski & Scharstein, Sampling the Disparity Space Image, PAMI 26(3) 2004.

    Attributes:
        most_pixels: a view of more stays as it is: it is seldom as sharp, and it takes longer.
        around_px: how far around a pixel the first search is looked at; larger finds edges that it
            misplaced farther.
        margin_px: disparities searched beyond that; larger is slower.
        trust: in the first search, in the unit of the costs.
        trust_px: difference from it at which the whole of that is paid.
        cost: "same" compares the enlarged pixels as the first search did, which takes as long as
            that or longer with a network; "soft_census" is quick, nearly as accurate, and
            works with every first cost.
        radius_px: of the bilateral mean, pixels of the enlarged view; see `BilateralAggregation`.
        sigma_space_px: likewise.
        sigma_colour: likewise.
        small_step: of the paths, for half a pixel; see `SemiGlobal`.
        large_step: likewise, for more.
        edge: likewise.
        across_edge: likewise.
    """

    most_pixels: int = 1_000_000
    around_px: int = 2
    margin_px: float = 1.0
    trust: float = 0.4
    trust_px: float = 4.0
    cost: Literal["same", "soft_census"] = "soft_census"
    radius_px: int = 2
    sigma_space_px: float = 2.0
    sigma_colour: float = 0.05
    small_step: float = 0.5
    large_step: float = 2.5
    edge: float = 0.06
    across_edge: float = 0.2

    def __post_init__(self) -> None:
        for name in ("most_pixels", "around_px", "margin_px", "trust", "radius_px"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        if self.cost not in COSTS:
            raise ValueError(f"cost must be {' or '.join(COSTS)}, got {self.cost!r}")
        if not self.trust_px > 0:
            raise ValueError(f"trust_px must be positive, got {self.trust_px}")
        _ = self._aggregation, self._paths  # they check their own settings

    @property
    def _aggregation(self) -> BilateralAggregation:
        return BilateralAggregation(self.radius_px, self.sigma_space_px, self.sigma_colour)

    @property
    def _paths(self) -> SemiGlobal:
        return SemiGlobal(
            self.small_step, self.large_step, self.edge, self.across_edge,
            directions=4,
        )  # fmt: skip

    def compared_by(self, first: MatchingCost) -> VectorCost:
        """Return what compares enlarged pixels.

        Args:
            first: what compared them in the first search.

        Raises:
            ValueError: if it should do so again, and compares no vectors.
        """
        if self.cost == "soft_census":
            return QUICK
        if isinstance(first, VectorCost):
            return first
        raise ValueError(
            "enlargement cost 'same' needs a matching cost that compares vectors, such as cnn, "
            f"got {type(first).__name__}; enlargement.cost='soft_census' works with every one"
        )

    def fits(self, view: Tensor) -> bool:
        """Return whether a view (H, W, 3) is small enough."""
        return view.shape[0] * view.shape[1] <= self.most_pixels

    def __call__(
        self,
        first_cost: MatchingCost,
        views: tuple[Tensor, Tensor],
        found: Maps,
        disparities: range,
    ) -> Maps:
        """Choose the disparities of both views anew.

        Bands are searched on the CPU, whatever the device.

        Args:
            first_cost: what compared pixels in the first search.
            views: left and right, (H, W, 3) float32 in [0, 1].
            found: of the left and of the right view, (H, W), before any check.
            disparities: the candidates that were searched.

        Returns:
            Both maps with other values; the rest stays.
        """
        left, right = (_enlarged(view) for view in views)
        of_left, of_right = found[0].values, found[1].values.flip(1)  # mirrored: a left view
        in_left, in_right = self._bands(of_left, disparities), self._bands(of_right, disparities)
        cost = self.compared_by(first_cost)
        costs = _compared(cost, left, right, in_left, in_right)
        finer_left = self._chosen(costs[0], left, of_left, in_left)
        finer_right = self._chosen(costs[1], right.flip(1), of_right, in_right)
        return _improved(found[0], finer_left), _improved(found[1], finer_right.flip(1))

    def _bands(self, values: Tensor, disparities: range) -> Bands:
        """Return what is searched for each pixel of an enlarged left view.

        Args:
            values: (H, W), of the first search.
            disparities: the candidates of that.
        """
        high = _highest_around(values, self.around_px)
        low = -_highest_around(-values, self.around_px)
        beyond = FACTOR * self.margin_px
        columns = torch.arange(FACTOR * values.shape[1], device=values.device)
        end = columns[-1]
        first = (FACTOR * _repeated(low) - beyond).floor().clamp(min=FACTOR * disparities[0])
        last = (FACTOR * _repeated(high) + beyond).ceil().clamp(max=FACTOR * disparities[-1])
        first, last = torch.maximum(first, columns - end), torch.minimum(last, columns)
        there = first <= last  # not where nothing was found
        size = torch.where(there, last - first + 1, 0)
        return Bands.holding(array_of(torch.where(there, first, 0)), array_of(size))

    def _chosen(self, costs: Array, guide: Tensor, first: Tensor, bands: Bands) -> Tensor:
        """Return the disparities (H, W) of a left view; NaN where there is none.

        Args:
            costs: (K,), see `Bands`.
            guide: (2 H, 2 W, 3), the view.
            first: (H, W), of the first search.
            bands: of the pixels.
        """
        levels = array_of((guide * LEVELS).round().to(torch.uint8))
        means = means_in_bands(
            costs, levels, bands,
            radius=self.radius_px, sigma_space=self.sigma_space_px, sigma_colour=self.sigma_colour,
        )  # fmt: skip
        expected = array_of(FACTOR * _repeated(first))
        doubted = means.copy()
        add_doubt(doubted, expected, bands, most=self.trust, reach=FACTOR * self.trust_px)
        sums = paths_in_bands(doubted, array_of(luminance(guide)), bands, self._paths.costs)
        valley = valleys_in_bands(means, lowest_in_bands(sums, bands), bands)
        values = valley.layer + valley_offset(valley, SHARED_SLOPE)
        chosen = torch.where(valley.value.isfinite(), values, torch.nan)
        return _halved(chosen.to(guide.device))


def _compared(
    cost: VectorCost, left: Tensor, right: Tensor, in_left: Bands, in_right: Bands
) -> tuple[Array, Array]:
    """Return the costs of an enlarged left view and of the mirrored right view, (K,) each."""
    of_left = np.zeros(in_left.total, np.float32)
    of_right = np.zeros(in_right.total, np.float32)
    for strip, rows in _strips(left, cost.margin_px):
        ours, theirs = (
            array_of(cost.vectors(view[strip.seen], rows=strip.costs)) for view in (left, right)
        )
        distances_in_bands(ours, theirs, in_left.rows(rows), of_left)
        ours, theirs = (np.ascontiguousarray(each[:, ::-1]) for each in (ours, theirs))
        distances_in_bands(theirs, ours, in_right.rows(rows), of_right)
    return of_left, of_right


def _strips(view: Tensor, margin: int) -> Iterator[tuple[Strip, slice]]:
    """Cut the rows of a view (H, W, 3) into strips; also return which rows each stands for."""
    height, width, _ = view.shape
    rows = max(GRID_PX, int(BYTES_AT_ONCE / (width * BYTES_OF_VECTORS)))
    for top in range(0, height, rows):
        part = slice(top, min(top + rows, height))
        yield Strip.around(part, height, Reach(margin, 0, 0)), part


def _improved(found: DisparityMap[Tensor], finer: Tensor) -> DisparityMap[Tensor]:
    """Return a map with finer disparities (H, W), where there are both."""
    both = found.valid & ~finer.isnan()
    return replace(found, values=torch.where(both, finer, found.values))


def _enlarged(view: Tensor) -> Tensor:
    """Return (2 H, 2 W, 3) in [0, 1] by cubic interpolation."""
    channels = view.permute(2, 0, 1)[None]
    larger = F.interpolate(channels, scale_factor=FACTOR, mode="bicubic", align_corners=False)
    return larger[0].permute(1, 2, 0).clamp(0, 1).contiguous()


def _repeated(values: Tensor) -> Tensor:
    """Return (2 H, 2 W): every pixel as a block."""
    return values.repeat_interleave(FACTOR, 0).repeat_interleave(FACTOR, 1)


def _highest_around(values: Tensor, radius: int) -> Tensor:
    """Return the highest of the values (H, W) around each pixel; -inf where all are NaN."""
    there = torch.where(values.isnan(), -torch.inf, values)[None, None]
    return F.max_pool2d(there, 2 * radius + 1, stride=1, padding=radius)[0, 0]


def _halved(values: Tensor) -> Tensor:
    """Return disparities at half the size, in pixels of that: of each block the mean of a surface.

    That is of what lies within `SAME_PX` of the median; NaN where all four are.

    Args:
        values: (2 H, 2 W), NaN where there is none.
    """
    height, width = (size // FACTOR for size in values.shape)
    blocks = values.reshape(height, FACTOR, width, FACTOR).transpose(1, 2).flatten(2)
    middle = blocks.nanmedian(-1, keepdim=True).values
    same = (blocks - middle).abs() <= FACTOR * SAME_PX
    return torch.where(same, blocks, torch.nan).nanmean(-1) / FACTOR
