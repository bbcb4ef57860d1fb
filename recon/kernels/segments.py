"""Connected pieces of an image."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from recon.kernels.compiled import Array, array_of, compiled

__all__ = ["segment_sizes"]


def segment_sizes(values: Tensor, *, largest_step: float) -> Tensor:
    """Return for every pixel how many pixels its piece has.

    Two neighbours (of four) are in one piece if their values differ by `largest_step` or less.

    Args:
        values: (H, W) float32; NaN is in no piece.
        largest_step: in the unit of the values; larger joins more.

    Returns:
        (H, W) int64 on the device of `values`; 0 where `values` is NaN.
    """
    sizes = torch.zeros(values.shape, dtype=torch.int64)
    _segment_sizes(array_of(values), largest_step, array_of(sizes))
    return sizes.to(values.device)


@compiled()
def _root(parents: Array, node: int) -> int:
    """Return the root of a tree, and halve the way to it."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@compiled()
def _join(parents: Array, one: int, other: int) -> None:
    """Make one tree of two; the lower number becomes the root."""
    a, b = _root(parents, one), _root(parents, other)
    if a < b:
        parents[b] = a
    elif b < a:
        parents[a] = b


@compiled()
def _segment_sizes(  # noqa: C901  compiled: one nest of loops
    values: Array, largest_step: float, sizes: Array
) -> None:
    """Fill `sizes` (H, W) by joining neighbours into trees.

    Source: Sedgewick & Wayne, Algorithms, 4th ed. 2011, section 1.5.
    """
    height, width = values.shape
    parents = np.arange(height * width)
    for y in range(height):
        for x in range(width):
            node = y * width + x
            if x > 0 and abs(values[y, x] - values[y, x - 1]) <= largest_step:
                _join(parents, node - 1, node)
            if y > 0 and abs(values[y, x] - values[y - 1, x]) <= largest_step:
                _join(parents, node - width, node)
    counts = np.zeros(height * width, np.int64)
    for node in range(height * width):
        counts[_root(parents, node)] += 1
    for y in range(height):
        for x in range(width):
            if not np.isnan(values[y, x]):
                sizes[y, x] = counts[_root(parents, y * width + x)]
