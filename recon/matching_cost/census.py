"""The census transform and its Hamming distance."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.colour import luminance
from recon.kernels.shifts import hamming_distances
from recon.kernels.windows import census_words
from recon.matching_cost.protocol import ALL_ROWS
from recon.types import CostVolume

__all__ = ["Census"]

LARGEST_WINDOW = 64
"""Cells of a window: 63 neighbours have a bit each in a word, and its sign stays free."""


@dataclass(frozen=True)
class Census:
    """C(x, d) = share of neighbours that are darker than the middle in one view only, in [0, 1].

    It does not see any change of brightness that keeps the order. A neighbour counts where it
    lies inside both views.

    Source: Zabih & Woodfill, Non-parametric Local Transforms for Computing Visual Correspondence,
    ECCV 1994, section 3.2.

    Attributes:
        rows_px: height of the window, odd; rows_px * columns_px is at most 64.
        columns_px: width of the window, odd; larger windows are smoother and round corners.
    """

    rows_px: int = 7
    columns_px: int = 9

    def __post_init__(self) -> None:
        odd = self.rows_px % 2 == 1 and self.columns_px % 2 == 1
        if not (odd and 1 < self.rows_px * self.columns_px <= LARGEST_WINDOW):
            raise ValueError(
                f"census window must be odd by odd with at most {LARGEST_WINDOW} pixels, "
                f"got {self.rows_px} x {self.columns_px}"
            )

    @property
    def margin_px(self) -> int:
        """Rows that the window reaches up and down."""
        return self.rows_px // 2

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the words of pixels."""
        of_left, cells = census_words(luminance(left), self.rows_px, self.columns_px)
        of_right, _ = census_words(luminance(right), self.rows_px, self.columns_px)
        cost = hamming_distances(of_left[rows], of_right[rows], cells[rows], disparities)
        return CostVolume(cost, disparities)
