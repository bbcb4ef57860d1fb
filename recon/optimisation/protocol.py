"""What an optimisation is."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from recon.types import CostVolume, DisparityMap

__all__ = ["Optimisation"]


class Optimisation(Protocol):
    """How a disparity is chosen from its costs."""

    def __call__(self, volume: CostVolume) -> DisparityMap[Tensor]:
        """Choose one candidate for every pixel, row by row.

        Args:
            volume: of either view.

        Returns:
            (H, W); MATCHED, or OUTSIDE where a pixel has no candidate at all.
        """
        ...
