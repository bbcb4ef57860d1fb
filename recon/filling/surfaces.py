"""The surface to which the picture leads, and which the right view does not contradict."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from recon.filling.protocol import filled
from recon.kernels.continuation import Continuation, along_colours, from_directions_alike
from recon.kernels.local_planes import Belonging, planes_at
from recon.types import DisparityMap, PixelStatus

__all__ = ["SurfaceFilling"]

STEP_PX = 2
LEAST_WEIGHT = 5.0


@dataclass(frozen=True)
class SurfaceFilling:
    """Continue the surfaces around a hole into it, each as a plane.

    Every matched pixel beside a hole offers the plane that fits the disparities of its surface. Of
    these an occluded pixel, and one outside, takes that which is reached over the least change of
    colour; a mismatched one the median of those seen in 16 directions, by weights that fall with
    the change of colour on the way. A disparity d that would lie in front of what the right view
    shows at x - d is contradicted: the right view would see it. That is how the surface in front
    of an occlusion, which is next to it and may look like it, is kept out.

    Source: the shortest way over colours as in Bai & Sapiro, A Geodesic Framework for Fast
    Interactive Image and Video Segmentation and Matting, ICCV 2007; planes behind occlusions as in
    Bleyer & Gelautz, A Layered Stereo Matching Algorithm Using Image Segmentation and Global
    Visibility Constraints, ISPRS Journal 59(3) 2005; directions from Zbontar & LeCun, JMLR 17 2016,
    section 4.2.

    Attributes:
        confidence: of filled pixels, as a share of the median of the matched ones.
        most_rise_px: how far a disparity may differ from that beside the hole by the slope of the
            surface; 0 continues all surfaces as if they faced the camera.
        radius_px: of the window through which a surface beside a hole is seen.
        colour: sum of the differences of R, G and B, each in [0, 1], beyond which a pixel belongs
            to another surface.
        same_px: difference of disparities beyond which it does.
        tolerance_px: how far in front of the right view's surface a disparity may lie.
    """

    confidence: float = 0.1
    most_rise_px: float = 3.0
    radius_px: int = 24
    colour: float = 0.6
    same_px: float = 2.0
    tolerance_px: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.confidence <= 1:
            raise ValueError(f"confidence must be in [0, 1], got {self.confidence}")
        for name in ("most_rise_px", "tolerance_px"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")
        for name in ("radius_px", "colour", "same_px"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    def __call__(
        self, disparity: DisparityMap[Tensor], *, of_right: DisparityMap[Tensor], guide: Tensor
    ) -> DisparityMap[Tensor]:
        """Fill all holes; see `Filling`."""
        matched = disparity.status == int(PixelStatus.MATCHED)
        if not matched.any():
            return disparity
        known = torch.where(matched, disparity.values, float("nan"))
        belonging = Belonging(self.radius_px, STEP_PX, self.colour, self.same_px)
        planes = planes_at(
            _beside(~matched), known, matched.float(), guide, belonging, least=LEAST_WEIGHT
        )
        offered = Continuation(
            planes, disparity.confidence, guide, of_right.values,
            most_rise=self.most_rise_px, tolerance=self.tolerance_px,
        )  # fmt: skip
        mismatched = disparity.status == int(PixelStatus.MISMATCHED)
        around = from_directions_alike(offered, mismatched)
        between = ~around.isnan()
        values = torch.where(between, around, along_colours(offered, ~matched))
        return filled(disparity, values, between, confidence=self.confidence)


def _beside(holes: Tensor) -> Tensor:
    """Mark the pixels that touch a hole, at a corner at least."""
    return ~holes & (F.max_pool2d(holes[None, None].float(), 3, stride=1, padding=1)[0, 0] > 0)
