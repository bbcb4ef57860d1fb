"""The normalised cross-correlation of two windows."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.colour import luminance
from recon.kernels.shifts import cosine_distances
from recon.kernels.windows import normalised_patches
from recon.matching_cost.protocol import ALL_ROWS
from recon.types import CostVolume

__all__ = ["NormalisedCrossCorrelation"]


@dataclass(frozen=True)
class NormalisedCrossCorrelation:
    """C(x, d) = 1 - cos of the angle between the windows, as vectors of brightness.

    It does not see a change of exposure, b -> a b.
    A window cut by the border is normalised by what is left of it in its own view; windows
    without contrast cost 1 against any other.

    Source: Hirschmueller & Scharstein, Evaluation of Stereo Matching Costs on Images with
    Radiometric Differences, PAMI 31(9) 2009, section 2.

    Attributes:
        radius_px: the window has (2 radius + 1)^2 pixels; larger is smoother and rounds corners.
    """

    radius_px: int = 4

    def __post_init__(self) -> None:
        if self.radius_px < 1:
            raise ValueError(f"radius_px must be at least 1, got {self.radius_px}")

    @property
    def margin_px(self) -> int:
        """Rows that the window reaches up and down."""
        return self.radius_px

    def __call__(
        self, left: Tensor, right: Tensor, disparities: range, *, rows: slice = ALL_ROWS
    ) -> CostVolume:
        """Compare the windows around pixels."""
        of_left, of_right = (
            normalised_patches(luminance(image), self.radius_px, centred=False)[:, rows]
            for image in (left, right)
        )
        return CostVolume(cosine_distances(of_left, of_right, disparities), disparities)
