"""The training of the matching cost network."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from recon.networks import FeatureNetwork, load_features, save_features
from recon.networks.architecture import Architecture, architecture_named
from recon.precision import in_precision
from recon.training.loss import (
    best_disparity,
    matching_loss,
    near_edges,
    similarities,
    within_one_pixel,
)
from recon.training.misalignment import Pairs
from recon.training.picture import picture
from recon.training.progress import Scores
from recon.training.run import Run, Update
from recon.training.settings import FeatureTraining
from recon.training.support import Support
from recon.training.validation import validate
from recon.types import Array

__all__ = ["FeatureRun", "winners"]

FIRST_SHARPNESS = 20.0


def winners(network: FeatureNetwork) -> Callable[[Pairs], Tensor]:
    """Return what finds the candidates whose vectors are most alike."""
    return lambda pairs: best_disparity(similarities(network(pairs.left), network(pairs.right)))


class _Trained(nn.Module):
    """The network, and what similarities are multiplied by to become logits."""

    def __init__(self, architecture: Architecture) -> None:
        super().__init__()
        self.network = FeatureNetwork(architecture, normalised=True)
        self.sharpness = nn.Parameter(torch.tensor(FIRST_SHARPNESS).log())


class FeatureRun(Run[FeatureTraining]):
    """A training of the matching cost network, see `Run`."""

    trained: _Trained
    purpose = "matching cost network"
    judged = "winner of the raw cost"

    def begin(self) -> nn.Module:
        """See `Run`."""
        trained = _Trained(self.architecture)
        if self.settings.begin_from is not None:
            trained.network.begin_from(load_features(self.settings.begin_from))
            trained.requires_grad_(requires_grad=True)
        trained.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        return trained

    @property
    def architecture(self) -> Architecture:
        """The shape of the network."""
        return architecture_named(self.settings.variant)

    @property
    def network(self) -> FeatureNetwork:
        """The network in training."""
        return self.trained.network

    def look(self, pairs: Pairs) -> Update:
        """See `Run`."""
        settings = self.settings
        weight = pairs.visible.float()
        if self.step >= settings.edges_from:
            weight = weight * (1 + settings.edge_weight * near_edges(pairs.disparity))
        both = torch.cat((pairs.left, pairs.right)).contiguous(memory_format=torch.channels_last)
        with in_precision("auto", self.device):
            features = self.network(both)
        similarity = similarities(*features.chunk(2))
        if settings.support_px:
            similarity = Support(settings.support_px)(similarity, pairs.left)
        sharpness = self.trained.sharpness.exp()
        loss = matching_loss(similarity, pairs.disparity, weight, sharpness)
        share = partial(within_one_pixel, similarity.detach(), pairs.disparity, pairs.visible)
        return Update(pairs, loss, share)

    def ready(self) -> FeatureNetwork:
        """See `Run`."""
        return self.network.fused()

    def scores(self) -> Scores:
        """See `Run`."""
        settings, seeds = self.settings, self.settings.validation_seeds
        find = winners(self.ready())
        return validate(find, settings.pool, seeds, step=self.step, device=self.device)

    def picture(self, pairs: Pairs) -> Array:
        """See `Run`."""
        return picture(self.ready(), pairs)

    def write(self, path: Path, *, about: dict[str, str]) -> None:
        """See `Run`."""
        save_features(path, self.ready().cpu(), about=about)

    def shape(self) -> str:
        """See `Run`."""
        return str(self.architecture)

    def shape_in_words(self) -> str:
        """See `Run`."""
        shape, seen = self.architecture, 2 * self.architecture.margin_px + 1
        weights = sum(value.numel() for value in self.ready().parameters())
        return (
            f"`{shape}`: {weights:,} weights, {shape.gflop_per_megapixel_pair:,.0f} GFLOP a pair "
            f"of 1 MP, sees {seen} x {seen} pixels"
        )
