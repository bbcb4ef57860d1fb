"""A folder of generated pairs, each drawn from its own seed, so that any part can be redone."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch

from recon.training.scenes import draw

__all__ = ["draw_pair", "fill_pool", "read_pair"]


def draw_pair(seed: int, size: tuple[int, int], samples: int = 2) -> dict[str, np.ndarray]:
    """Draw the pair of one seed as NumPy arrays.

    Returns:
        left and right (H, W, 3) uint8, disparity (H, W) float32 px, visible (H, W) bool.
    """
    sample = draw(torch.Generator().manual_seed(seed), size, samples=samples)
    return {
        "left": (sample.left * 255).round().byte().numpy(),
        "right": (sample.right * 255).round().byte().numpy(),
        "disparity": sample.disparity_left.numpy(),
        "visible": sample.visible.numpy(),
    }


def _path(folder: Path, seed: int) -> Path:
    return folder / f"pair_{seed:06d}.npz"


def _draw_into(folder: Path, size: tuple[int, int], seed: int) -> Path:
    """Draw one pair into the folder, whole or not at all."""
    torch.set_num_threads(1)
    path = _path(folder, seed)
    unfinished = path.with_suffix(".part.npz")
    np.savez(unfinished, allow_pickle=False, **draw_pair(seed, size))
    unfinished.replace(path)
    return path


def fill_pool(
    folder: Path, seeds: range, size: tuple[int, int], *, workers: int | None = None
) -> Iterator[Path]:
    """Draw the pairs of `seeds` that the folder lacks, and yield each as it is done.

    Args:
        folder: where the pairs lie; made if missing.
        seeds: one pair each.
        size: (width, height) in pixels.
        workers: processes; None takes one a core.
    """
    folder.mkdir(parents=True, exist_ok=True)
    missing = [seed for seed in seeds if not _path(folder, seed).exists()]
    with ProcessPoolExecutor(
        workers or os.cpu_count(), mp_context=get_context("spawn")
    ) as executor:
        yield from executor.map(partial(_draw_into, folder, size), missing)


def read_pair(folder: Path, seed: int) -> dict[str, np.ndarray]:
    """Read a pair that `fill_pool` has drawn; see `draw_pair`."""
    with np.load(_path(folder, seed)) as arrays:
        return dict(arrays)
