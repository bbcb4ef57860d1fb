"""Weighted medians in a window, without the missing."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, prange

__all__ = ["median_of", "weighted_median"]


def weighted_median(
    values: Tensor, guide: Tensor, *, radius: int, sigma_colour: float = float("inf")
) -> Tensor:
    """Return the median around every pixel, each neighbour weighing as much as it looks alike.

    The median is the smallest value below or at which lies half of the weight;
    a neighbour q of p weighs exp(-|I_p - I_q|^2 / 2 sigma_colour^2), with I the guide.

    Source: Ma et al., Constant Time Weighted Median Filtering for Stereo Matching and Beyond,
    ICCV 2013, section 3.

    Args:
        values: (H, W) float32; NaN is missing.
        guide: (H, W, 3) float32.
        radius: the window has (2 radius + 1)^2 pixels.
        sigma_colour: distance of colours; infinite makes all weights equal.

    Returns:
        (H, W) float32 on the device of `values`; NaN where `values` has it.
    """
    result = torch.full(values.shape, float("nan"))
    sharpness = 0.5 / sigma_colour**2
    _weighted_median(array_of(values), array_of(guide), radius, sharpness, array_of(result))
    return result.to(values.device)


@compiled(parallel=True)
def _weighted_median(
    values: Array, guide: Array, radius: int, sharpness: float, result: Array
) -> None:
    """Fill `result` where `values` is present."""
    height, width = values.shape
    for y in prange(height):
        members = np.zeros((2 * radius + 1) ** 2, np.float32)
        weights = np.zeros(len(members), np.float32)
        for x in range(width):
            if np.isnan(values[y, x]):
                continue
            count = 0
            for row in range(max(0, y - radius), min(height, y + radius + 1)):
                for column in range(max(0, x - radius), min(width, x + radius + 1)):
                    if np.isnan(values[row, column]):
                        continue
                    distance = 0.0
                    for c in range(guide.shape[2]):
                        distance += (guide[row, column, c] - guide[y, x, c]) ** 2
                    weight = np.exp(-sharpness * distance)
                    _insert(members, weights, count, values[row, column], weight)
                    count += 1
            result[y, x] = _middle(members, weights, count)


@compiled()
def _insert(members: Array, weights: Array, count: int, member: float, weight: float) -> None:
    """Put `member` into its place among the first `count`, which are in order."""
    place = count
    while place > 0 and members[place - 1] > member:
        members[place], weights[place] = members[place - 1], weights[place - 1]
        place -= 1
    members[place], weights[place] = member, weight


@compiled()
def _middle(members: Array, weights: Array, count: int) -> float:
    """Return the smallest member at which half of the weight is reached."""
    total = np.float32(0.0)
    for i in range(count):
        total += weights[i]
    half = np.float32(0.5) * total
    passed = np.float32(0.0)
    for i in range(count):
        passed += weights[i]
        if passed >= half:
            return float(members[i])
    return float(members[count - 1])


@compiled()
def median_of(members: Array, count: int) -> float:
    """Return the median of the first `count` members, at least one; they are put in order."""
    for i in range(1, count):
        member = members[i]
        place = i
        while place > 0 and members[place - 1] > member:
            members[place] = members[place - 1]
            place -= 1
        members[place] = member
    return float(members[(count - 1) // 2] + members[count // 2]) / 2
