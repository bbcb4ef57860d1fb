"""Aggregation with equal weights."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.windows import box_mean
from recon.types import CostVolume

__all__ = ["BoxAggregation"]


@dataclass(frozen=True)
class BoxAggregation:
    """The mean of the costs in a square window.

    Source: Scharstein & Szeliski, A Taxonomy and Evaluation of Dense Two-Frame Stereo
    Correspondence Algorithms, IJCV 47 2002, section 3.2.

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

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> CostVolume:  # noqa: ARG002  blind to it
        """Smooth everywhere alike."""
        return CostVolume(box_mean(volume.cost, self.radius_px), volume.disparities)
