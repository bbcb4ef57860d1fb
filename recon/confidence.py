"""How far to trust a disparity, from its costs."""

from __future__ import annotations

import torch
from torch import Tensor

from recon.kernels.minimum import Minimum

__all__ = ["peak_margin"]

SMALLEST_COST = 1e-6
"""Costs below this are equal to zero but for rounding."""


def peak_margin(minimum: Minimum) -> Tensor:
    """Return how clearly the winner beats its rival: (c_2 - c_1) / c_2.

    c_1 is the lowest cost and c_2 the lowest at least two candidates away. It is 1 - 1 / PKR, with
    PKR the peak ratio c_2 / c_1; unlike that it stays within [0, 1].

    Source: Hu & Mordohai, A Quantitative Evaluation of Confidence Measures for Stereo Vision,
    PAMI 34(11) 2012, section 3.3.

    Args:
        minimum: the winners, of costs that are not negative, and their rivals.

    Returns:
        (H, W) float32 in [0, 1]; 0 without a rival, and without a winner.
    """
    margin = (minimum.rival - minimum.value) / minimum.rival.clamp(min=SMALLEST_COST)
    return torch.where(minimum.rival.isfinite(), margin, 0.0).clamp(0.0, 1.0)
