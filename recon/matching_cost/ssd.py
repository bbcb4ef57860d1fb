"""The sum of squared differences in a window."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.shifts import pixel_differences
from recon.kernels.windows import box_mean
from recon.matching_cost.protocol import ALL_ROWS
from recon.types import CostVolume

__all__ = ["SumOfSquaredDifferences"]


@dataclass(frozen=True)
class SumOfSquaredDifferences:
    """C(x, d) = mean over RGB and over the q around x of (L(q) - R(q - d))^2, in [0, 1].

    A mean, not a sum, so that windows cut by the border compare with whole ones.

    Source: Scharstein & Szeliski, A Taxonomy and Evaluation of Dense Two-Frame Stereo
    Correspondence Algorithms, IJCV 47 2002, sections 3.1 and 3.2.

    Attributes:
        radius_px: the window has (2 radius + 1)^2 pixels; larger is smoother and rounds corners.
    """

    radius_px: int = 4

    def __post_init__(self) -> None:
        if self.radius_px < 0:
            raise ValueError(f"radius_px must not be negative, got {self.radius_px}")

    @property
    def margin_px(self) -> int:
        """Rows that the window reaches up and down."""
        return self.radius_px

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the windows around pixels."""
        of_left, of_right = (image.permute(2, 0, 1) for image in (left, right))
        differences = pixel_differences(of_left, of_right, disparities, squared=True)
        return CostVolume(box_mean(differences, self.radius_px)[rows], disparities)
