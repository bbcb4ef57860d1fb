"""What an aggregation is."""

from __future__ import annotations

from typing import Protocol

from torch import Tensor

from recon.types import CostVolume

__all__ = ["Aggregation"]


class Aggregation(Protocol):
    """How the costs around a pixel speak for it."""

    @property
    def margin_px(self) -> int:
        """How many rows above and below a pixel its result depends on."""
        ...

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> CostVolume:
        """Support every cost by those of its neighbours, candidate by candidate.

        Args:
            volume: of the left view.
            guide: (H, W, 3) float32 in [0, 1], the left view.

        Returns:
            A volume of the same candidates; +inf where `volume` has it.
        """
        ...
