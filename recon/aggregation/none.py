"""No aggregation."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.types import CostVolume

__all__ = ["NoAggregation"]


@dataclass(frozen=True)
class NoAggregation:
    """Leave every cost as it is, for costs that already look at a window."""

    @property
    def margin_px(self) -> int:
        """None: pixels stand alone."""
        return 0

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> CostVolume:  # noqa: ARG002  blind to it
        """Return `volume`."""
        return volume
