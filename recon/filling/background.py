"""What lies behind an occlusion, by rows; what lies around a mismatch, by directions."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.filling.protocol import filled
from recon.kernels.holes import from_directions, from_row
from recon.types import DisparityMap, PixelStatus

__all__ = ["BackgroundFilling"]


@dataclass(frozen=True)
class BackgroundFilling:
    """Give every rejected pixel the disparity of a surface beside it.

    What one view cannot see lies behind what hides it: occluded pixels, and those outside, take
    the smaller of the disparities to their left and right, with the slope that this surface has
    there. Mismatched pixels lie on a surface that both views see: they take the median of the
    nearest matched pixels in 16 directions.

    Source: Zbontar & LeCun, Stereo Matching by Training a Convolutional Neural Network to Compare
    Image Patches, JMLR 17 2016, section 4.2; the smaller of two sides from Hirschmueller, PAMI
    30(2) 2008, section 2.6.

    Attributes:
        confidence: of filled pixels, as a share of the median of the matched ones.
        most_rise_px: how far the disparity behind an occlusion may differ from that beside it where
            the surface there is slanted; 0 continues all surfaces as if they faced the camera.
    """

    confidence: float = 0.1
    most_rise_px: float = 3.0

    def __post_init__(self) -> None:
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence must be in [0, 1], got {self.confidence}")
        if self.most_rise_px < 0:
            raise ValueError(f"most_rise_px must not be negative, got {self.most_rise_px}")

    def __call__(
        self,
        disparity: DisparityMap[Tensor],
        *,
        of_right: DisparityMap[Tensor],  # noqa: ARG002  all fillings are called alike
        guide: Tensor,  # noqa: ARG002
    ) -> DisparityMap[Tensor]:
        """Fill all holes; see `Filling`."""
        matched = disparity.status == int(PixelStatus.MATCHED)
        if not matched.any():
            return disparity
        known = torch.where(matched, disparity.values, float("nan"))
        mismatched = disparity.status == int(PixelStatus.MISMATCHED)
        around = from_directions(known, mismatched)
        values = torch.where(around.isnan(), from_row(known, most_rise=self.most_rise_px), around)
        return filled(disparity, values, ~around.isnan(), confidence=self.confidence)
