"""The absolute difference of two colours."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.shifts import pixel_differences
from recon.matching_cost.protocol import ALL_ROWS
from recon.types import CostVolume

__all__ = ["AbsoluteDifference"]


@dataclass(frozen=True)
class AbsoluteDifference:
    """C(x, d) = mean over RGB of |L(x) - R(x - d)|, in [0, 1].

    Source: Scharstein & Szeliski, A Taxonomy and Evaluation of Dense Two-Frame Stereo
    Correspondence Algorithms, IJCV 47 2002, section 3.1.
    """

    @property
    def margin_px(self) -> int:
        """None: pixels are compared alone."""
        return 0

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the colours of single pixels."""
        of_left, of_right = (image[rows].permute(2, 0, 1) for image in (left, right))
        return CostVolume(pixel_differences(of_left, of_right, disparities), disparities)
