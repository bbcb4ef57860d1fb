"""What the matching cost network is to do: tell each pixel's partner from the rest of its row."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["best_disparity", "matching_loss", "near_edges", "within_one_pixel"]

FALSE_LABELS = 0.03
WIDEST = 0.32  # of the width: scenes reach a quarter, and the augmentation zooms in
EDGE_REACH_PX = 7


def _candidates(left: Tensor, right: Tensor, most: int) -> Tensor:
    """Return similarities (N, H, W, W) of columns of both views, -inf unless 0 <= d <= most."""
    similarity = torch.einsum("nchx,nchy->nhxy", left, right)
    width = left.shape[-1]
    column = torch.arange(width, device=left.device)
    disparity = column[:, None] - column[None, :]
    return similarity.masked_fill((disparity < 0) | (disparity > most), -torch.inf)


def near_edges(disparity: Tensor) -> Tensor:
    """Return where disparities jump by more than a pixel, and `EDGE_REACH_PX` around.

    Args:
        disparity: (N, H, W) px.

    Returns:
        (N, H, W) bool.
    """
    across = (disparity.diff(dim=2, prepend=disparity[:, :, :1]).abs() > 1).float()
    down = (disparity.diff(dim=1, prepend=disparity[:, :1]).abs() > 1).float()
    window = 2 * EDGE_REACH_PX + 1
    return F.max_pool2d(across + down, window, stride=1, padding=EDGE_REACH_PX) > 0


def matching_loss(
    left: Tensor, right: Tensor, disparity: Tensor, weight: Tensor, sharpness: Tensor
) -> Tensor:
    """Return how surprised a softmax over each row is by the truth.

    -(1 - w) log q(d0) - w log q(d0 + 1), where d0 = floor(d), w = d - d0 and
    q = (1 - e) p + e allows for pixels that cannot be told apart.

    Args:
        left: (N, C, H, W) unit features.
        right: (N, C, H, W), the same.
        disparity: (N, H, W) px.
        weight: (N, H, W) float32, how much each pixel counts; 0 where the right view is blind.
        sharpness: what similarities are multiplied by.
    """
    width = left.shape[-1]
    chance = torch.softmax(_candidates(sharpness * left, right, int(WIDEST * width)), -1)
    column = torch.arange(width, device=left.device)
    whole = disparity.floor()
    weight = weight * (column - whole - 1 >= 0)
    losses = []
    for step in (0, 1):
        place = (column - whole - step).long().clamp(0, width - 1)
        found = chance.gather(-1, place[..., None])[..., 0]
        losses.append(-torch.log((1 - FALSE_LABELS) * found + FALSE_LABELS))
    share = disparity - whole
    loss = (1 - share) * losses[0] + share * losses[1]
    return (loss * weight).sum() / weight.sum().clamp_min(1)


def best_disparity(left: Tensor, right: Tensor) -> Tensor:
    """Return the candidate (N, H, W) px of each left pixel that is most like it."""
    width = left.shape[-1]
    best = _candidates(left, right, int(WIDEST * width)).argmax(-1)
    return torch.arange(width, device=left.device) - best


def within_one_pixel(left: Tensor, right: Tensor, disparity: Tensor, visible: Tensor) -> float:
    """Return the share of visible pixels whose best candidate is within 1 px of the truth."""
    close = (best_disparity(left, right) - disparity).abs() <= 1
    return float((close & visible).sum() / visible.sum().clamp_min(1))
