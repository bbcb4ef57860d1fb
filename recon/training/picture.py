"""What the network sees in training, as a picture for people."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from recon.colours import MISSING_COLOUR, colour_mapped
from recon.networks import FeatureNetwork
from recon.training.loss import best_disparity, similarities
from recon.training.misalignment import Pairs
from recon.types import Array

__all__ = ["maps_below_views", "picture", "write_picture"]

GAP_PX = 4


@torch.inference_mode()
def picture(network: FeatureNetwork, pairs: Pairs) -> Array:
    """Draw the first crop: left, right, truth where visible, winner of the raw cost.

    Args:
        network: fused.
        pairs: as the network sees it, after the augmentation.

    Returns:
        (4 h + 3 gaps, W, 3) uint8, one below the other.
    """
    left, right = pairs.left[:1], pairs.right[:1]
    found = best_disparity(similarities(network(left), network(right)))[0].float()
    return maps_below_views(pairs, found)


def maps_below_views(pairs: Pairs, found: Tensor) -> Array:
    """Draw the first of some pairs: left, right, truth where visible, what was found.

    Args:
        pairs: as the network sees it.
        found: (h, W) px, its disparities.

    Returns:
        (4 h + 3 gaps, W, 3) uint8, one below the other.
    """
    truth, visible = pairs.disparity[0], pairs.visible[0]
    low, high = float(truth.min()), max(float(truth.max()), float(truth.min()) + 1)

    def coloured(values: Tensor) -> Array:
        return colour_mapped(values.cpu().numpy(), low, high)

    views = [_as_colours(view) for view in (pairs.left[0], pairs.right[0])]
    hidden = torch.where(visible, truth, torch.nan)
    rows = [*views, coloured(hidden), coloured(found)]
    gap = np.full((GAP_PX, rows[0].shape[1], 3), MISSING_COLOUR, np.uint8)
    return np.concatenate([part for row in rows for part in (row, gap)][:-1])


def _as_colours(view: Tensor) -> Array:
    """Return a view (3, H, W) in [0, 1] as (H, W, 3) uint8."""
    colours: Array = (view * 255).round().byte().permute(1, 2, 0).cpu().numpy()
    return colours


def write_picture(path: Path, colours: Array) -> bool:
    """Write a PNG; return whether that was possible: without pillow there are no pictures."""
    try:
        from PIL import Image
    except ImportError:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(colours).save(path)
    return True
