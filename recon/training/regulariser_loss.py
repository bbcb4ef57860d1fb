"""What the regulariser is to do: find disparities, and say how far to trust them."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from recon.networks.regulariser import BLOCK, Estimate
from recon.training.misalignment import Pairs

__all__ = ["regulariser_loss"]

HIDDEN_WEIGHT = 0.3
"""How much a pixel counts that the other view does not see: it can only be guessed."""
FALSE_LABELS = 0.03
LABEL = (0.1, 0.8, 0.1)
GENTLE_PX = 4.0
LARGEST_ERROR_PX = 20.0
LEAST_SHARE = 1e-6
ENLARGED, SCALE, OCCLUSION = 0.5, 0.1, 0.2


def regulariser_loss(estimate: Estimate, pairs: Pairs) -> Tensor:
    """Return how wrong an estimate is.

    The sum of: how surprised the logits of blocks are by the disparities in them; the error of the
    disparities before and after the correction at full size, in a form that grows more slowly
    beyond 4 px; how unlikely the error is under a Laplace law of the scale that was stated; and
    the cross-entropy of the occlusion.

    Args:
        estimate: of the left views, searched from disparity 0.
        pairs: N pairs.
    """
    weight = torch.where(pairs.visible, 1.0, HIDDEN_WEIGHT)
    before, after = (
        (found - pairs.disparity).abs() for found in (estimate.enlarged, estimate.disparity)
    )
    error = after.detach().clamp_max(LARGEST_ERROR_PX)
    unlikely = error * torch.exp(-estimate.log_scale) + estimate.log_scale
    occluded = F.binary_cross_entropy_with_logits(estimate.occlusion, (~pairs.visible).float())
    return (
        _surprise(estimate.logits, pairs.disparity, weight)
        + ENLARGED * _mean(_gentle(before), weight)
        + _mean(_gentle(after), weight)
        + SCALE * _mean(unlikely, weight)
        + OCCLUSION * occluded
    )


def _mean(values: Tensor, weight: Tensor) -> Tensor:
    return (values * weight).sum() / weight.sum()


def _gentle(error: Tensor) -> Tensor:
    """Return the error (px) where it is small, and its logarithm where it is large."""
    return GENTLE_PX * torch.log1p(error / GENTLE_PX)


def _by_blocks(values: Tensor, rows: int, columns: int) -> Tensor:
    """Return (N, rows, columns, 16): the pixels (N, H, W) of each block, 0 beyond the image."""
    height, width = values.shape[1:]
    values = F.pad(values, (0, BLOCK * columns - width, 0, BLOCK * rows - height))
    parts = values.reshape(len(values), rows, BLOCK, columns, BLOCK)
    return parts.permute(0, 1, 3, 2, 4).flatten(3)


def _surprise(logits: Tensor, disparity: Tensor, weight: Tensor) -> Tensor:
    """Return -log((1 - e) exp(-k) + e), k the divergence of the logits from what blocks show.

    A block shows a mixture of the disparities of its pixels, each shared between the two nearest
    candidates and spread a little to theirs.

    Args:
        logits: (N, h, w, D).
        disparity: (N, H, W) px.
        weight: (N, H, W), how much each pixel counts.
    """
    _, rows, columns, count = logits.shape
    place = _by_blocks(disparity, rows, columns)
    low = place.floor()
    shown = _by_blocks(weight, rows, columns) * ((low >= 0) & (low + 1 < count))
    share = place - low
    labels = torch.zeros_like(logits)
    index = low.clamp(0, count - 2).long()
    labels.scatter_add_(-1, index, shown * (1 - share))
    labels.scatter_add_(-1, index + 1, shown * share)
    spread = F.conv1d(labels.reshape(-1, 1, count), labels.new_tensor(LABEL)[None, None], padding=1)
    labels = spread.reshape(labels.shape)
    labels = labels / labels.sum(-1, keepdim=True).clamp_min(LEAST_SHARE)
    logarithm = labels.clamp_min(LEAST_SHARE).log() - torch.log_softmax(logits, -1)
    divergence = (labels * logarithm).sum(-1)
    surprise = -torch.log((1 - FALSE_LABELS) * torch.exp(-divergence) + FALSE_LABELS)
    return _mean(surprise, shown.sum(-1))
