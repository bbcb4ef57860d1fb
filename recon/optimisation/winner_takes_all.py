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
        subpixel: move to the lowest point between d - 1 and d + 1, see `valley_offset`.
        shared_slope: form of the valley there: -1 a parabola, 0 two lines, more for steeper sides.
    """

    subpixel: bool = True
    shared_slope: float = -1.0

    def __post_init__(self) -> None:
        if not -1 <= self.shared_slope < 1:
            raise ValueError(f"shared_slope must be in [-1, 1), got {self.shared_slope}")

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
            values = values + valley_offset(minimum, self.shared_slope)
        return DisparityMap(
            torch.where(found, values, float("nan")),
            torch.where(found, int(PixelStatus.MATCHED), int(PixelStatus.OUTSIDE)).to(torch.uint8),
            peak_margin(minimum),
        )


def valley_offset(minimum: Minimum, shared_slope: float = -1.0) -> Tensor:
    """Return where a valley through three costs is lowest.

    With u and v the costs one candidate before and after the winner, less its own, it is
    (u - v) / 2 (max(u, v) - s min(u, v)), s the `shared_slope`. For s = -1 that is the vertex of a
    parabola, for s = 0 the crossing of two lines of one steepness (equiangular). Either pulls
    towards integers where both sides are steeper than the data make them, as the steps of
    semi-global paths do: s > 0 takes that share of the lesser slope from both.

    Source: Shimizu & Okutomi, Precise Sub-pixel Estimation on Area-based Matching, ICCV 2001, for
    the pull and the two forms; Haller & Nedevschi, Design of Interpolation Functions for Subpixel-
    Accuracy Stereo-Vision Systems, IEEE TIP 21(2) 2012, for forms that follow the costs.

    Args:
        minimum: the winners and their neighbours.
        shared_slope: s, in [-1, 1).

    Returns:
        (H, W) float32 in [-0.5, 0.5]; 0 at the ends of the range, beside missing candidates, and
        where three costs are equal.
    """
    before, after = minimum.before - minimum.value, minimum.after - minimum.value
    depth = torch.maximum(before, after) - shared_slope * torch.minimum(before, after)
    usable = before.isfinite() & after.isfinite() & (depth > 0)
    offset = (before - after) / torch.where(usable, 2 * depth, 1.0)
    return torch.where(usable, offset, 0.0).clamp(-0.5, 0.5)
