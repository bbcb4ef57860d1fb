"""Medians: they take off what stands out alone and keep edges."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from recon.kernels.median import weighted_median
from recon.types import DisparityMap

__all__ = ["Median", "WeightedMedian"]


@dataclass(frozen=True)
class Median:
    """The median of the disparities in a window.

    Attributes:
        radius_px: the window has (2 radius + 1)^2 pixels; larger rounds corners.
    """

    radius_px: int = 2

    def __post_init__(self) -> None:
        if self.radius_px < 0:
            raise ValueError(f"radius_px must not be negative, got {self.radius_px}")

    def __call__(self, disparity: DisparityMap[Tensor], *, guide: Tensor) -> DisparityMap[Tensor]:
        """Take the median of what is there."""
        values = weighted_median(disparity.values, guide, radius=self.radius_px)
        return replace(disparity, values=values)


@dataclass(frozen=True)
class WeightedMedian:
    """The median of the disparities in a window, weighted by likeness of colour.

    Source: Ma et al., Constant Time Weighted Median Filtering for Stereo Matching and Beyond,
    ICCV 2013, section 3.

    Attributes:
        radius_px: the window has (2 radius + 1)^2 pixels; larger is slower, with its fourth power.
        sigma_colour: Euclidean distance of RGB in [0, 1]; larger takes other colours in.
    """

    radius_px: int = 5
    sigma_colour: float = 0.1

    def __post_init__(self) -> None:
        if self.radius_px < 0:
            raise ValueError(f"radius_px must not be negative, got {self.radius_px}")
        if not self.sigma_colour > 0:
            raise ValueError(f"sigma_colour must be positive, got {self.sigma_colour}")

    def __call__(self, disparity: DisparityMap[Tensor], *, guide: Tensor) -> DisparityMap[Tensor]:
        """Take the weighted median of what is there."""
        values = weighted_median(
            disparity.values, guide, radius=self.radius_px, sigma_colour=self.sigma_colour
        )
        return replace(disparity, values=values)
