"""What an optimisation is."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from recon.types import CostVolume, DisparityMap

__all__ = ["Optimisation"]


class Optimisation(Protocol):
    """How a disparity is chosen from its costs."""

    @property
    def margin_px(self) -> int:
        """Rows up and down that the choice for a pixel depends on, or nearly so."""
        ...

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> DisparityMap[Tensor]:
        """Choose one candidate for every pixel.

        Args:
            volume: of either view.
            guide: (H, W, 3) in [0, 1], that view.

        Returns:
            (H, W); MATCHED, or OUTSIDE where a pixel has no candidate at all.
        """
        ...
