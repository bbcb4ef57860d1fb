"""Aggregation with adaptive weights."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.bilateral import bilateral_mean
from recon.types import CostVolume

__all__ = ["BilateralAggregation"]


@dataclass(frozen=True)
class BilateralAggregation:
    """The mean of the costs around a pixel, weighted by nearness and likeness of colour.

    C'(p, d) = sum_q w(p, q) C(q, d) / sum_q w(p, q) over the q with a cost, with
    w(p, q) = exp(-|p - q|^2 / 2 sigma_space_px^2) exp(-|I_p - I_q|^2 / 2 sigma_colour^2).

    Source: Yoon & Kweon, Adaptive Support-Weight Approach for Correspondence Search, PAMI 28(4)
    2006, section 3; weights of Tomasi & Manduchi, ICCV 1998.

    Attributes:
        radius_px: neighbours up to this far in x and in y; larger is slower, with its square.
        sigma_space_px: larger smooths farther; radius_px should be about twice as much.
        sigma_colour: Euclidean distance of RGB in [0, 1]; larger smooths across stronger edges.
    """

    radius_px: int = 9
    sigma_space_px: float = 5.0
    sigma_colour: float = 0.05

    def __post_init__(self) -> None:
        if self.radius_px < 0:
            raise ValueError(f"radius_px must not be negative, got {self.radius_px}")
        for name in ("sigma_space_px", "sigma_colour"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")

    @property
    def margin_px(self) -> int:
        """Rows that the window reaches up and down."""
        return self.radius_px

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> CostVolume:
        """Smooth within surfaces of one colour."""
        cost = bilateral_mean(
            volume.cost,
            guide,
            radius=self.radius_px,
            sigma_space=self.sigma_space_px,
            sigma_colour=self.sigma_colour,
        )
        return CostVolume(cost, volume.disparities)
