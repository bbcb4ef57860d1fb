"""What a refinement is."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from recon.types import DisparityMap

__all__ = ["Refinement"]


class Refinement(Protocol):
    """How a disparity map is made smooth within surfaces."""

    def __call__(self, disparity: DisparityMap[Tensor], *, guide: Tensor) -> DisparityMap[Tensor]:
        """Return smoother values of the same status and confidence.

        Args:
            disparity: (H, W) of the left view.
            guide: (H, W, 3) float32 in [0, 1], the left view.

        Returns:
            (H, W); NaN where `disparity` has it.
        """
        ...
