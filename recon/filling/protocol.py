"""What a filling is."""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from recon.types import DisparityMap, PixelStatus

__all__ = ["Filling", "filled"]


class Filling(Protocol):
    """How rejected pixels get a disparity."""

    @property
    def confidence(self) -> float:
        """Of filled pixels, as a share of the median of the matched ones."""
        ...

    def __call__(
        self, disparity: DisparityMap[Tensor], *, of_right: DisparityMap[Tensor], guide: Tensor
    ) -> DisparityMap[Tensor]:
        """Fill all holes.

        Args:
            disparity: (H, W) of the left view, checked.
            of_right: (H, W) of the right view before any check, indexed by its pixels.
            guide: (H, W, 3) float32 in [0, 1], the left view.

        Returns:
            (H, W) with a disparity everywhere; `disparity` itself if no pixel is matched.
        """
        ...


def filled(
    disparity: DisparityMap[Tensor], values: Tensor, between: Tensor, *, confidence: float
) -> DisparityMap[Tensor]:
    """Return a map with values in its holes.

    Args:
        disparity: (H, W), with at least one matched pixel.
        values: (H, W), what the holes get.
        between: (H, W) bool, holes that became FILLED_MISMATCH; the others are FILLED_OCCLUSION.
        confidence: of filled pixels, as a share of the median of the matched ones.
    """
    matched = disparity.status == int(PixelStatus.MATCHED)
    status = torch.where(
        between, int(PixelStatus.FILLED_MISMATCH), int(PixelStatus.FILLED_OCCLUSION)
    ).to(disparity.status.dtype)
    low = confidence * disparity.confidence[matched].median()
    return DisparityMap(
        torch.where(matched, disparity.values, values),
        torch.where(matched, disparity.status, status),
        torch.where(matched, disparity.confidence, low),
    )
