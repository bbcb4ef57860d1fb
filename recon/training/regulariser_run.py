"""The training of the regulariser."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from recon.aggregation import BilateralAggregation
from recon.matching_cost import LearnedCost
from recon.networks import save_regulariser, stored_regulariser
from recon.networks.regulariser import Estimate, Regulariser, RegulariserShape
from recon.optimisation.learned import hints
from recon.precision import in_precision
from recon.training.loss import close_share
from recon.training.misalignment import Pairs
from recon.training.picture import maps_below_views
from recon.training.progress import Scores
from recon.training.regulariser_loss import regulariser_loss
from recon.training.run import Run, Update
from recon.training.settings import RegulariserTraining
from recon.training.validation import validate
from recon.types import Array

__all__ = ["RegulariserRun"]

AGGREGATION = BilateralAggregation(radius_px=4, sigma_space_px=3.0, sigma_colour=0.05)
"""That of preset `best`; the weights know it."""
STEP_CANDIDATES = 16
"""Ranges are multiples of this: the network would only pad them."""
BEYOND_PX = 3


class RegulariserRun(Run[RegulariserTraining]):
    """A training of the regulariser on the costs of a network that stays as it is, see `Run`."""

    trained: Regulariser
    purpose = "regulariser"
    judged = "before any check"
    longest_gradient = 1.0

    def __init__(self, settings: RegulariserTraining, device: torch.device) -> None:
        self.cost = LearnedCost(settings.cost_weights, settings.direct_share, settings.census_share)
        super().__init__(settings, device)

    def begin(self) -> nn.Module:
        """See `Run`."""
        if self.settings.begin_from is None:
            return Regulariser(RegulariserShape()).laid_out()
        network = stored_regulariser(self.settings.begin_from)
        return network.requires_grad_(requires_grad=True).laid_out()

    def look(self, pairs: Pairs) -> Update:
        """See `Run`."""
        count = self._candidates(pairs.disparity)
        seen = _seen(self.cost, pairs.left, pairs.right, count)
        with in_precision("auto", self.device):
            estimate = self.trained(*seen, pairs.left)
        loss = regulariser_loss(estimate, pairs)
        found = estimate.disparity.detach()
        return Update(pairs, loss, partial(close_share, found, pairs.disparity, pairs.visible))

    def _candidates(self, disparity: Tensor) -> int:
        """Return how many disparities are searched: at times many more than there are."""
        settings = self.settings
        spare = 1 + settings.spare_range * float(torch.rand((), generator=self.generator))
        needed = spare * float(disparity.max()) + BEYOND_PX
        most = min(settings.most_candidates, needed)
        return STEP_CANDIDATES * math.ceil(most / STEP_CANDIDATES)

    def ready(self) -> Regulariser:
        """See `Run`."""
        return self.trained.eval()

    def scores(self) -> Scores:
        """See `Run`."""
        settings, seeds = self.settings, self.settings.validation_seeds
        return validate(self._find, settings.pool, seeds, step=self.step, device=self.device)

    def _find(self, pairs: Pairs) -> Tensor:
        """Return the disparities of pairs whose range is known."""
        count = int(pairs.disparity.max()) + BEYOND_PX
        seen = _seen(self.cost, pairs.left, pairs.right, count)
        estimate: Estimate = self.ready()(*seen, pairs.left)
        return estimate.disparity

    @torch.inference_mode()
    def picture(self, pairs: Pairs) -> Array:
        """See `Run`."""
        first = Pairs(*(part[:1] for part in pairs))
        return maps_below_views(first, self._find(first)[0])

    def write(self, path: Path, *, about: dict[str, str]) -> None:
        """See `Run`."""
        save_regulariser(path, self.ready(), about=about)

    def shape(self) -> str:
        """See `Run`."""
        return str(self.trained.shape)

    def shape_in_words(self) -> str:
        """See `Run`."""
        weights = sum(value.numel() for value in self.trained.parameters())
        return f"`{self.shape()}`: {weights:,} weights"


def _seen(
    matching_cost: LearnedCost, left: Tensor, right: Tensor, count: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Return what the network sees of the disparities 0 to D - 1 beside the left views.

    Returns:
        Aggregated costs (N, H, W, D), the paths through them, and the winner of these (N, H, W).
    """
    parts = []
    for ours, theirs in zip(left.permute(0, 2, 3, 1), right.permute(0, 2, 3, 1), strict=True):
        with torch.inference_mode():
            guide = ours.contiguous()
            volume = matching_cost(guide, theirs.contiguous(), range(count))
            cost = AGGREGATION(volume, guide=guide).cost
            parts.append((cost, *hints(cost, guide)))
    # outside, where what is made may take part in gradients
    cost, paths, winner = (torch.stack(part) for part in zip(*parts, strict=True))
    return cost, paths, winner
