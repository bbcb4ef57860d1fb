"""What the matching cost network is to do: tell each pixel's partner from the rest of its row."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = [
    "best_disparity",
    "close_share",
    "matching_loss",
    "near_edges",
    "similarities",
    "within_one_pixel",
]

FALSE_LABELS = 0.03
WIDEST = 0.32  # of the width: scenes reach a quarter, and the augmentation zooms in
EDGE_REACH_PX = 7
LABEL_SPREAD_PX = 0.5
LABEL_REACH = 2
LEAST_LABELS = 0.5  # of about 1.25: less, and most of the label lies outside


def similarities(left: Tensor, right: Tensor) -> Tensor:
    """Compare every pixel with its candidates.

    Args:
        left: (N, C, H, W) features, of length 1 at most.
        right: (N, C, H, W), the same.

    Returns:
        (N, H, W, D) of the disparities 0 to D - 1; 0, as of vectors at right angles, where the
        candidate lies outside.
    """
    count, _, height, width = left.shape
    most = int(WIDEST * width)
    products = torch.einsum("nchx,nchy->nhxy", left, right)
    # Column y of row x moves to y - x + most, so that a column is one disparity.
    rows = F.pad(F.pad(products, (most, 0)).flatten(2), (0, width))
    return rows.reshape(count, height, width, -1)[..., : most + 1].flip(-1)


def _inside(similarity: Tensor) -> Tensor:
    """Return similarities (N, H, W, D) with -inf for candidates outside the right view."""
    width, count = similarity.shape[2:]
    column = torch.arange(width, device=similarity.device)
    outside = torch.arange(count, device=similarity.device) > column[:, None]
    return similarity.masked_fill(outside, -torch.inf)


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
    similarity: Tensor, disparity: Tensor, weight: Tensor, sharpness: Tensor
) -> Tensor:
    """Return how surprised a softmax over the candidates is by the truth.

    -log((1 - e) exp(-h) + e), where h = -sum_k g(k - d) log p(k) is the cross-entropy with a
    Gaussian g and e allows for pixels that cannot be told apart. With such labels the best -log p
    is a parabola with its vertex at d, which is what the sub-pixel step fits.

    Args:
        similarity: (N, H, W, D) of the disparities 0 to D - 1.
        disparity: (N, H, W) px.
        weight: (N, H, W) float32, how much each pixel counts; 0 where the right view is blind.
        sharpness: what similarities are multiplied by.
    """
    width, count = similarity.shape[2:]
    column = torch.arange(width, device=similarity.device)
    chance = _inside(sharpness * similarity).log_softmax(-1)
    surprise, labels = torch.zeros_like(disparity), torch.zeros_like(disparity)
    for step in range(-LABEL_REACH, LABEL_REACH + 1):
        candidate = disparity.round() + step
        label = torch.exp(-(candidate - disparity).square() / (2 * LABEL_SPREAD_PX**2))
        inside = (candidate >= 0) & (candidate < count) & (candidate <= column)
        place = torch.where(inside, candidate, 0).long()
        found = chance.gather(-1, place[..., None])[..., 0]
        surprise = surprise - torch.where(inside, label * found, 0.0)
        labels = labels + torch.where(inside, label, 0.0)
    weight = weight * (labels > LEAST_LABELS)
    fit = torch.exp(-surprise / labels.clamp_min(LEAST_LABELS))
    loss = -torch.log((1 - FALSE_LABELS) * fit + FALSE_LABELS)
    return (loss * weight).sum() / weight.sum().clamp_min(1)


def best_disparity(similarity: Tensor) -> Tensor:
    """Return the candidate (N, H, W) px that is most like each pixel, of those inside."""
    return _inside(similarity).argmax(-1)


def within_one_pixel(similarity: Tensor, disparity: Tensor, visible: Tensor) -> float:
    """Return the share of visible pixels whose best candidate is within 1 px of the truth."""
    return close_share(best_disparity(similarity), disparity, visible)


def close_share(found: Tensor, disparity: Tensor, visible: Tensor) -> float:
    """Return the share of visible pixels whose disparity is within 1 px of the truth."""
    close = (found - disparity).abs() <= 1
    return float((close & visible).sum() / visible.sum().clamp_min(1))
