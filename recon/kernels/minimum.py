"""The lowest value of every column of a volume, and what surrounds it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled, on_cpu, prange

__all__ = ["Minimum", "lowest"]

RIVAL_DISTANCE = 2
"""A rival this many layers away is another valley, not the slope of the same one."""


class Minimum(NamedTuple):
    """The lowest of D values, each field (H, W); +inf stands for a layer that is missing.

    Attributes:
        layer: int64, its layer; -1 where all are missing. The first of equals.
        value: float32, the value itself.
        before: float32, the value one layer below it.
        after: float32, the value one layer above it.
        rival: float32, the lowest value at least two layers away.
    """

    layer: Tensor
    value: Tensor
    before: Tensor
    after: Tensor
    rival: Tensor


def lowest(volume: Tensor) -> Minimum:
    """Find the lowest value along the last axis.

    Args:
        volume: (H, W, D) float32; +inf is missing.
    """
    if on_cpu(volume):
        index = torch.full(volume.shape[:2], -1, dtype=torch.int64)
        values = torch.full((4, *volume.shape[:2]), float("inf"))
        _lowest(array_of(volume), array_of(index), array_of(values))
        return Minimum(index, *values)
    count = volume.shape[2]
    value, index = volume.min(dim=2)
    layers = torch.arange(count, device=volume.device)
    far = (layers - index[:, :, None]).abs() >= RIVAL_DISTANCE
    rival = torch.where(far, volume, float("inf")).amin(2)
    padded = torch.nn.functional.pad(volume, (1, 1), value=float("inf"))
    before = padded.gather(2, index[:, :, None])[:, :, 0]
    after = padded.gather(2, index[:, :, None] + 2)[:, :, 0]
    return Minimum(torch.where(value.isfinite(), index, -1), value, before, after, rival)


@compiled(parallel=True)
def _lowest(  # noqa: C901  compiled: one nest of loops
    volume: Array, index: Array, values: Array
) -> None:
    """Fill `index` (H, W) and `values` (4, H, W): value, before, after, rival."""
    height, width, count = volume.shape
    for y in prange(height):
        for x in range(width):
            line = volume[y, x]
            best, lowest_value = -1, np.float32(np.inf)
            for k in range(count):
                if line[k] < lowest_value:
                    best, lowest_value = k, line[k]
            if best < 0:
                continue
            rival = np.float32(np.inf)
            for k in range(max(0, best - RIVAL_DISTANCE + 1)):
                rival = min(rival, line[k])
            for k in range(best + RIVAL_DISTANCE, count):
                rival = min(rival, line[k])
            index[y, x] = best
            values[0, y, x] = lowest_value
            if best > 0:
                values[1, y, x] = line[best - 1]
            if best + 1 < count:
                values[2, y, x] = line[best + 1]
            values[3, y, x] = rival
