"""How good a network is on pairs that it never trained on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from recon.training.augmentation import Augmentation
from recon.training.batches import whole
from recon.training.loss import close_share
from recon.training.misalignment import Pairs
from recon.training.pool import read_pair
from recon.training.progress import Scores

__all__ = ["validate"]


@torch.inference_mode()
def validate(
    find: Callable[[Pairs], Tensor], pool: Path, seeds: range, *, step: int, device: torch.device
) -> Scores:
    """Return the mean over pairs of `close_share`, as they are and as two cameras see them.

    The augmentation is the same each time and on every device: it is drawn on the CPU, from the
    seed of the pair.

    Args:
        find: returns the disparities (N, H, W) px of pairs that are on `device`.
        pool: folder of pairs.
        seeds: of the pairs.
        step: after which this is.
        device: where to compute.
    """
    plain: list[float] = []
    augmented: list[float] = []
    for seed in seeds:
        pairs = whole(read_pair(pool, seed), torch.device("cpu"))
        generator = torch.Generator().manual_seed(seed)
        left, right = Augmentation()(pairs.left, pairs.right, generator)
        changed = pairs._replace(left=left, right=right)
        for seen, shares in ((pairs, plain), (changed, augmented)):
            there = Pairs(*(part.to(device) for part in seen))
            shares.append(close_share(find(there), there.disparity, there.visible))
    return Scores(step, float(np.mean(plain)), float(np.mean(augmented)))
