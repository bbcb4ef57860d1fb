"""Recursive smoothing along both axes, with a step length for every pair of neighbours."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["smooth_along_rows_and_columns"]

LANES = 64
"""Neighbouring columns that one thread carries through all rows together."""


def smooth_along_rows_and_columns(
    values: Tensor,
    weights: Tensor,
    steps: tuple[Tensor, Tensor],
    *,
    sigma: float,
    iterations: int,
) -> Tensor:
    """Return weighted means with exponential weights in the distance, first rows then columns.

    One pass along an axis is J[n] = I[n] + a^d[n] (J[n - 1] - I[n]), forward and then backward,
    with d[n] the step from n - 1 to n and a = exp(-sqrt(2) / sigma_i). Iteration i of N has
    sigma_i = sigma sqrt(3) 2^(N - i) / sqrt(4^N - 1), so that together they smooth by sigma.
    Values times weights and weights are filtered alike and divided, so what weighs nothing is
    left out.

    Source: Gastal & Oliveira, Domain Transform for Edge-Aware Image and Video Processing, ACM
    Transactions on Graphics 30(4) 2011, equations 14 and 21.

    Args:
        values: (H, W) float32, finite.
        weights: (H, W) float32, not negative.
        steps: (H, W) each, step lengths from the left neighbour and from the upper neighbour;
            the first column, or row, is not used.
        sigma: in the unit of the steps; larger smooths farther.
        iterations: N; more leave fewer stripes.

    Returns:
        (H, W) float32; NaN where no weight arrives.
    """
    signal = torch.stack([values * weights, weights])  # (2, H, W)
    across, down = steps
    for i in range(1, iterations + 1):
        sigma_i = sigma * math.sqrt(3) * 2 ** (iterations - i) / math.sqrt(4**iterations - 1)
        decay = -math.sqrt(2) / sigma_i
        signal = _smooth_columns(signal.mT.contiguous(), torch.exp(decay * across.mT)).mT
        signal = _smooth_columns(signal.contiguous(), torch.exp(decay * down))
    total, weight = signal
    return torch.where(weight > 0, total / weight, float("nan"))


def _smooth_columns(signal: Tensor, feedback: Tensor) -> Tensor:
    """Smooth `signal` (2, H, W) down the columns and up again; it may be overwritten."""
    if on_cpu(signal):
        result = array_of(signal)
        _smooth_columns_of(result, array_of(feedback))
        return torch.from_numpy(result)
    return smooth_columns_by_rows(signal, feedback)


def smooth_columns_by_rows(signal: Tensor, feedback: Tensor) -> Tensor:
    """Return the same as the compiled loop, a whole row at a time, for any device."""
    rows = list(signal.unbind(1))
    for n in range(1, len(rows)):
        rows[n] = torch.lerp(rows[n], rows[n - 1], feedback[n])
    for n in range(len(rows) - 2, -1, -1):
        rows[n] = torch.lerp(rows[n], rows[n + 1], feedback[n + 1])
    return torch.stack(rows, dim=1)


@compiled(parallel=True)
def _smooth_columns_of(signal: Array, feedback: Array) -> None:
    """Smooth `signal` (2, H, W) in place, a strip of columns a task."""
    layers, height, width = signal.shape
    strips = -(-width // LANES)
    for strip in prange(strips):
        left, right = strip * LANES, min(width, strip * LANES + LANES)
        for layer in range(layers):
            for n in range(1, height):
                before = signal[layer, n - 1, left:right]
                row, share = signal[layer, n, left:right], feedback[n, left:right]
                for x in range(right - left):
                    row[x] += share[x] * (before[x] - row[x])
            for n in range(height - 2, -1, -1):
                before = signal[layer, n + 1, left:right]
                row, share = signal[layer, n, left:right], feedback[n + 1, left:right]
                for x in range(right - left):
                    row[x] += share[x] * (before[x] - row[x])
