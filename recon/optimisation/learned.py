"""The disparity that a network finds, which looks around among the costs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import torch
from torch import Tensor

from recon.networks import Regulariser, load_regulariser
from recon.optimisation.semi_global import SemiGlobal
from recon.precision import Precision, check_precision, in_precision
from recon.types import CostVolume, DisparityMap, PixelStatus

__all__ = ["LearnedOptimisation", "hints"]

CONTEXT_PX = 64
RIGHT_PX = 1.0


PATHS = SemiGlobal(
    small_step=0.5, large_step=3.75, across_edge=0.2, directions=4, shared_slope=-0.4
)
"""Those of preset `best`, but for the larger step, which the weights know from their training."""


@lru_cache(maxsize=4)
def _network(weights: str, device: torch.device) -> Regulariser:
    """Load a network once for every device."""
    return load_regulariser(weights, device)


def hints(cost: Tensor, guide: Tensor) -> tuple[Tensor, Tensor]:
    """Return what semi-global paths say of a view.

    Args:
        cost: (H, W, D), +inf where there is no candidate.
        guide: (H, W, 3) in [0, 1].

    Returns:
        The mean cost of the paths to each cell (H, W, D), +inf likewise; and the candidate of the
        least one (H, W), between candidates, 0 where there is none.
    """
    volume = CostVolume(cost, range(cost.shape[-1]))
    sums = PATHS.sums(volume, guide)
    winner = PATHS.winner(CostVolume(sums, volume.disparities), guide)
    return sums.div_(PATHS.directions), torch.nan_to_num(winner.values)


@dataclass(frozen=True)
class LearnedOptimisation:
    """What `recon.networks.Regulariser` makes of the costs.

    It looks around as the network of Kendall et al., End-to-End Learning of Geometry and Context
    for Deep Stereo Regression, ICCV 2017, but sees the costs of our matching cost and of
    semi-global paths through them instead of features of its own. It finds a disparity for every
    pixel, seen by the other view or not.

    Attributes:
        weights: the path of a file, or the name of weights that ship. They belong to the matching
            cost and the aggregation on which they were trained.
        averaged_px: where the network and the semi-global paths differ by at most this, the mean of
            both is taken: their errors below a pixel have little to do with each other.
        doubted_px: where they differ by more and the network states that it is off by more than
            this, the scale of its Laplace law, the paths decide, unless the network takes the pixel
            for hidden: a doubtful guess of the network is less often right than theirs. None
            leaves it to the network.
        precision: of the network, see `in_precision`; it was trained in bfloat16.
    """

    weights: str = "regulariser"
    averaged_px: float = 2.0
    doubted_px: float | None = None
    precision: Precision = "auto"

    def __post_init__(self) -> None:
        check_precision(self.precision)
        for name in ("averaged_px", "doubted_px"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise ValueError(f"{name} must not be negative, got {value}")

    @property
    def margin_px(self) -> int:
        """Rows beyond which the network sees little that matters to a pixel."""
        return CONTEXT_PX

    @torch.inference_mode()
    def __call__(self, volume: CostVolume, *, guide: Tensor) -> DisparityMap[Tensor]:
        """Find the disparities of a view; those of the right view in the mirrored pair.

        Confidence is the chance of an error of at most 1 px under the Laplace law that the network
        states, 1 - exp(-1 / b).
        """
        network = _network(self.weights, guide.device)
        cost = volume.cost.flip(1) if volume.of_right else volume.cost
        view = guide.flip(1) if volume.of_right else guide
        paths, winner = hints(cost, view)
        with in_precision(self.precision, guide.device):
            estimate = network(cost[None], paths[None], winner[None], view.permute(2, 0, 1)[None])
        alone, last = estimate.disparity[0], len(volume.disparities) - 1
        agreed = (alone - winner).abs() <= self.averaged_px
        scale = estimate.log_scale[0].exp()
        chosen = torch.where(agreed, (alone + winner) / 2, alone)
        if self.doubted_px is not None:
            doubted = ~agreed & (scale > self.doubted_px) & (estimate.occlusion[0] < 0)
            chosen = torch.where(doubted, winner, chosen)
        values = chosen.clamp(0, last) + volume.disparities[0]
        confidence = 1 - torch.exp(-RIGHT_PX / scale)
        found = cost.isfinite().any(-1)
        if volume.of_right:
            values, confidence, found = (each.flip(1) for each in (values, confidence, found))
        return DisparityMap(
            torch.where(found, values, float("nan")),
            torch.where(found, int(PixelStatus.MATCHED), int(PixelStatus.OUTSIDE)).to(torch.uint8),
            torch.where(found, confidence, 0.0),
        )
