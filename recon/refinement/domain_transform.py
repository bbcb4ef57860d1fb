"""Smoothing that follows the edges of an image, in linear time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from recon.kernels.recursive import smooth_along_rows_and_columns
from recon.types import DisparityMap

__all__ = ["DomainTransform"]

LEAST_CONFIDENCE = 1e-3
"""Of a disparity that has none at all, so that every pixel keeps a value."""
LEAST_DOUBT = 0.01
"""That a confidence of 1 leaves, so that a weight is finite."""


@dataclass(frozen=True)
class DomainTransform:
    """Stretch rows and columns at the edges of the guide, then smooth along them.

    Neighbours n - 1 and n are 1 + sigma_space_px / sigma_range * sum over RGB of
    |I[n] - I[n - 1]| apart, and along that line a recursive filter has standard deviation
    sigma_space_px.

    Source: Gastal & Oliveira, Domain Transform for Edge-Aware Image and Video Processing, ACM
    Transactions on Graphics 30(4) 2011, sections 4 and 5.3 (recursive filter).

    Attributes:
        sigma_space_px: larger smooths farther.
        sigma_range: of the guide, sum of channels in [0, 1]; larger smooths across stronger edges.
        iterations: passes over both axes; more leave fewer stripes.
        confidence_weighted: let a disparity weigh as much as it is trusted: p / (1 - p), the odds
            that it is right.
        below_confidence: change only disparities that are trusted less than this, for what is well
            matched is finer than its smooth version; all if not given.
    """

    sigma_space_px: float = 5.0
    sigma_range: float = 0.03
    iterations: int = 3
    confidence_weighted: bool = False
    below_confidence: float | None = None

    def __post_init__(self) -> None:
        for name in ("sigma_space_px", "sigma_range", "iterations"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if self.below_confidence is not None and not 0 < self.below_confidence <= 1:
            raise ValueError(f"below_confidence must be in (0, 1], got {self.below_confidence}")

    def __call__(self, disparity: DisparityMap[Tensor], *, guide: Tensor) -> DisparityMap[Tensor]:
        """Smooth within surfaces of one colour."""
        valid = disparity.valid
        weights = valid.float()
        if self.confidence_weighted:
            sure = disparity.confidence.clamp(min=LEAST_CONFIDENCE)
            weights = weights * sure / (1 - sure + LEAST_DOUBT)
        values = smooth_along_rows_and_columns(
            torch.where(valid, disparity.values, 0.0),
            weights,
            (self._steps(guide, 1), self._steps(guide, 0)),
            sigma=self.sigma_space_px,
            iterations=self.iterations,
        )
        if self.below_confidence is not None:
            doubted = disparity.confidence < self.below_confidence
            values = torch.where(doubted, values, disparity.values)
        return replace(disparity, values=torch.where(valid, values, float("nan")))

    def _steps(self, guide: Tensor, axis: int) -> Tensor:
        """Return (H, W) how far every pixel is from the one before it along `axis`."""
        first = guide.narrow(axis, 0, 1)
        change = guide.diff(dim=axis, prepend=first).abs().sum(2)
        return 1 + self.sigma_space_px / self.sigma_range * change
