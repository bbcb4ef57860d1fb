"""The candidate of least cost."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.confidence import peak_margin
from recon.kernels.minimum import Minimum, lowest
from recon.types import CostVolume, DisparityMap, PixelStatus

__all__ = ["WinnerTakesAll"]


@dataclass(frozen=True)
class WinnerTakesAll:
    """d(p) = argmin over d of C(p, d); the smallest of equals.

    Source: Scharstein & Szeliski, A Taxonomy and Evaluation of Dense Two-Frame Stereo
    Correspondence Algorithms, IJCV 47 2002, sections 3.3 and 3.4.

    Attributes:
        subpixel: move to the lowest point of the parabola through the costs of d - 1, d, d + 1.
    """

    subpixel: bool = True

    @property
    def margin_px(self) -> int:
        """No row but its own."""
        return 0

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> DisparityMap[Tensor]:  # noqa: ARG002
        """Choose for every pixel alone."""
        minimum = lowest(volume.cost)
        found = minimum.layer >= 0
        values = minimum.layer.float() + volume.disparities[0]
        if self.subpixel:
            values = values + parabola_offset(minimum)
        return DisparityMap(
            torch.where(found, values, float("nan")),
            torch.where(found, int(PixelStatus.MATCHED), int(PixelStatus.OUTSIDE)).to(torch.uint8),
            peak_margin(minimum),
        )


def parabola_offset(minimum: Minimum) -> Tensor:
    """Return where the parabola through three costs is lowest.

    With a, b, c the costs before, at and after the winner, it is (a - c) / 2 (a - 2 b + c).

    Args:
        minimum: the winners and their neighbours.

    Returns:
        (H, W) float32 in [-0.5, 0.5]; 0 at the ends of the range, beside missing candidates, and
        where three costs are equal.
    """
    before, here, after = minimum.before, minimum.value, minimum.after
    curvature = before - 2 * here + after
    usable = before.isfinite() & after.isfinite() & (curvature > 0)
    offset = (before - after) / torch.where(usable, 2 * curvature, 1.0)
    return torch.where(usable, offset, 0.0).clamp(-0.5, 0.5)
