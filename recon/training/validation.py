"""How good a network is on pairs that it never trained on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from recon.networks import FeatureNetwork
from recon.training.augmentation import Augmentation
from recon.training.batches import whole
from recon.training.loss import similarities, within_one_pixel
from recon.training.pool import read_pair
from recon.training.progress import Scores

__all__ = ["validate"]


@torch.inference_mode()
def validate(
    network: FeatureNetwork, pool: Path, seeds: range, *, step: int, device: torch.device
) -> Scores:
    """Return the mean over pairs of `within_one_pixel`, as they are and as two cameras see them.

    The augmentation is the same each time and on every device: it is drawn on the CPU, from the
    seed of the pair.

    Args:
        network: fused, on `device`.
        pool: folder of pairs.
        seeds: of the pairs.
        step: after which this is.
        device: where to compute.
    """
    plain: list[float] = []
    augmented: list[float] = []
    for seed in seeds:
        batch = whole(read_pair(pool, seed), torch.device("cpu"))
        views = batch.left, batch.right
        changed = Augmentation()(*views, torch.Generator().manual_seed(seed))
        for (left, right), shares in ((views, plain), (changed, augmented)):
            of_left, of_right = (network(view.to(device)) for view in (left, right))
            truth = batch.disparity.to(device), batch.visible.to(device)
            shares.append(within_one_pixel(similarities(of_left, of_right), *truth))
    return Scores(step, float(np.mean(plain)), float(np.mean(augmented)))
