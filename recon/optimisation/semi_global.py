"""The candidate that costs least together with smooth paths to it."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from recon.kernels.colour import luminance
from recon.kernels.scanlines import PathCosts, path_sums
from recon.optimisation.winner_takes_all import WinnerTakesAll
from recon.types import CostVolume, DisparityMap

__all__ = ["SemiGlobal"]

DIRECTIONS = (4, 8)
FORGOTTEN_PX = 64


@dataclass(frozen=True)
class SemiGlobal:
    """d(p) = argmin over d of the sum of L_r(p, d) over directions r.

    L_r is the cost of the best path along r that ends in p at d: its matching costs, P1 for every
    step of one candidate, P2 for every longer one, less across edges of the image.

    Source: Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI
    30(2) 2008, section 2.3.

    Attributes:
        small_step: P1, in the unit of the costs; larger makes slanted surfaces stair-like.
        large_step: P2, not below P1; larger removes more outliers and more thin things.
        edge: difference of luminance in [0, 1] between neighbours that counts as an edge.
        across_edge: share of P2 that is paid across an edge, not below P1 / P2.
        directions: 8, or 4 for half the time.
        subpixel: see `WinnerTakesAll`.
        shared_slope: see `WinnerTakesAll`. What spreads fractions of disparity evenly depends on
            the costs and the steps: -0.4 to 0.2 in the presets, by generated slanted walls.
    """

    small_step: float = 0.05
    large_step: float = 0.4
    edge: float = 0.06
    across_edge: float = 0.4
    directions: int = 8
    subpixel: bool = True
    shared_slope: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.small_step <= self.large_step:
            raise ValueError(
                "steps must be 0 <= small_step <= large_step, got "
                f"{self.small_step} and {self.large_step}"
            )
        if not 0 <= self.across_edge <= 1:
            raise ValueError(f"across_edge must be in [0, 1], got {self.across_edge}")
        WinnerTakesAll(shared_slope=self.shared_slope)
        if self.directions not in DIRECTIONS:
            raise ValueError(f"directions must be 4 or 8, got {self.directions}")

    @property
    def margin_px(self) -> int:
        """Rows from which a path has forgotten where it began, nearly always."""
        return FORGOTTEN_PX

    @property
    def costs(self) -> PathCosts:
        """What a path pays; a longer step across an edge no less than one of one candidate."""
        share = max(self.across_edge, self.small_step / max(self.large_step, 1e-9))
        return PathCosts(self.small_step, self.large_step, self.edge, share)

    def __call__(self, volume: CostVolume, *, guide: Tensor) -> DisparityMap[Tensor]:
        """Choose along paths in all directions."""
        return self.winner(CostVolume(self.sums(volume, guide), volume.disparities), guide)

    def sums(self, volume: CostVolume, guide: Tensor) -> Tensor:
        """Return the sums over all directions, (H, W, D); +inf where the volume is."""
        light = luminance(guide)
        return path_sums(volume.cost, light, self.costs, directions=self.directions)

    def winner(self, sums: CostVolume, guide: Tensor) -> DisparityMap[Tensor]:
        """Return the candidates of the least sums."""
        return WinnerTakesAll(self.subpixel, self.shared_slope)(sums, guide=guide)
