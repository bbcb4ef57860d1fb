"""Planes: noise below a pixel goes, slopes and edges stay."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from recon.kernels.local_planes import Belonging, local_planes
from recon.types import DisparityMap

__all__ = ["LocalPlanes"]


@dataclass(frozen=True)
class LocalPlanes:
    """The plane through the disparities around a pixel that belong to its surface.

    What a disparity is off by below a pixel changes from place to place, while surfaces bend
    slowly: the plane is nearer to the truth than the disparity itself. Only what looks
    alike and lies near the plane counts, by the square of its confidence. Jumps of less than
    about 2 px that the picture does not show are rounded. See `recon.kernels.local_planes`.

    Attributes:
        radius_px: of the window; larger rounds what is curved.
        step_px: only every so many pixels of the window are looked at, for speed.
        colour: sum of the differences of R, G and B, each in [0, 1], beyond which a pixel belongs
            to something else.
        tolerance_px: distance from the plane beyond which it does.
        rounds: how often it is fitted; the first finds the slope.
    """

    radius_px: int = 12
    step_px: int = 3
    colour: float = 0.15
    tolerance_px: float = 0.7
    rounds: int = 2

    def __post_init__(self) -> None:
        for name in ("radius_px", "step_px", "colour", "tolerance_px", "rounds"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    def __call__(self, disparity: DisparityMap[Tensor], *, guide: Tensor) -> DisparityMap[Tensor]:
        """Put every disparity on the plane around it."""
        belonging = Belonging(self.radius_px, self.step_px, self.colour, self.tolerance_px)
        values = local_planes(
            disparity.values,
            disparity.confidence.square(),
            guide,
            belonging,
            rounds=self.rounds,
        )
        return replace(disparity, values=values)
