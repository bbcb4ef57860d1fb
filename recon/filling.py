"""Disparities for the pixels that have none."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.kernels.holes import from_directions, from_row
from recon.types import DisparityMap, PixelStatus

__all__ = ["Filling"]


@dataclass(frozen=True)
class Filling:
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

    def __call__(self, disparity: DisparityMap[Tensor]) -> DisparityMap[Tensor]:
        """Fill all holes.

        Args:
            disparity: (H, W).

        Returns:
            (H, W) with a disparity everywhere; `disparity` itself if no pixel is matched.
        """
        matched = disparity.status == int(PixelStatus.MATCHED)
        if not matched.any():
            return disparity
        known = torch.where(matched, disparity.values, float("nan"))
        mismatched = disparity.status == int(PixelStatus.MISMATCHED)
        around = from_directions(known, mismatched)
        interpolated = ~around.isnan()
        values = torch.where(interpolated, around, from_row(known, most_rise=self.most_rise_px))
        status = torch.where(
            interpolated, int(PixelStatus.FILLED_MISMATCH), int(PixelStatus.FILLED_OCCLUSION)
        ).to(disparity.status.dtype)
        low = self.confidence * disparity.confidence[matched].median()
        return DisparityMap(
            torch.where(matched, disparity.values, values),
            torch.where(matched, disparity.status, status),
            torch.where(matched, disparity.confidence, low),
        )
