"""Colours and their order together."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.matching_cost.absolute_difference import AbsoluteDifference
from recon.matching_cost.census import Census
from recon.matching_cost.protocol import ALL_ROWS
from recon.types import CostVolume

__all__ = ["AdCensus"]


@dataclass(frozen=True)
class AdCensus:
    """C = r(census, census_scale) + r(difference, difference_scale), r(c, s) = 1 - exp(-c / s).

    The census bears changes of light, the colours tell apart structures that repeat. With the
    scales of the source: 30 of 62 cells of a window of 9 x 7, 10 of 255 levels.

    Source: Mei, Sun, Zhou, Jiao, Wang & Zhang, On Building an Accurate Stereo Matching System on
    Graphics Hardware, ICCV Workshops 2011, section 2.1.

    Attributes:
        rows_px: height of the census window, see `Census`.
        columns_px: its width.
        census_scale: share of cells that differ at which the census is 63 % sure; larger trusts
            it less.
        difference_scale: the same of the mean difference of RGB in [0, 1].
    """

    rows_px: int = 7
    columns_px: int = 9
    census_scale: float = 30 / 62
    difference_scale: float = 10 / 255

    def __post_init__(self) -> None:
        for name in ("census_scale", "difference_scale"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        Census(self.rows_px, self.columns_px)

    @property
    def margin_px(self) -> int:
        """Rows that the census window reaches up and down."""
        return Census(self.rows_px, self.columns_px).margin_px

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare words and colours."""
        cost = Census(self.rows_px, self.columns_px)(left, right, disparities, rows=rows).cost
        outside = cost.isinf()
        difference = AbsoluteDifference()(left, right, disparities, rows=rows).cost
        sure = torch.exp(-cost / self.census_scale) + torch.exp(-difference / self.difference_scale)
        return CostVolume((2 - sure).masked_fill(outside, float("inf")), disparities)
