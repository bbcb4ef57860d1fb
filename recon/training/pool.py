"""A folder of generated pairs, each drawn from its own seed, so that any part can be redone."""

from __future__ import annotations

import json
import os
from collections.abc import Generator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
import torch

from recon.training.recipe import FULL, Recipe, recipe_hash
from recon.training.scenes import draw

__all__ = ["Pair", "draw_pair", "drawing", "fill_pool", "missing_pairs", "read_pair"]

Pair = dict[str, npt.NDArray[Any]]
PARTS = ("left", "right", "disparity", "visible")
RECORD = "pool.json"
ELSE = "give another --pool"
UNREADABLE = (OSError, ValueError, KeyError, EOFError, BadZipFile)


def draw_pair(
    seed: int,
    size: tuple[int, int],
    *,
    samples: int = 2,
    recipe: Recipe = FULL,
    device: str = "cpu",
) -> Pair:
    """Draw the pair of one seed as NumPy arrays.

    Args:
        seed: of all that is random.
        size: (width, height) in pixels.
        samples: rays a pixel along each axis.
        recipe: what the scene may be made of.
        device: where to draw; each draws pairs of its own.

    Returns:
        left and right (H, W, 3) uint8, disparity (H, W) float32 px, visible (H, W) bool.
    """
    generator = torch.Generator(device).manual_seed(seed)
    sample = draw(generator, size, samples=samples, recipe=recipe)
    return {
        "left": (sample.left * 255).round().byte().cpu().numpy(),
        "right": (sample.right * 255).round().byte().cpu().numpy(),
        "disparity": sample.disparity_left.cpu().numpy(),
        "visible": sample.visible.cpu().numpy(),
    }


def drawing(workers: int | None) -> Executor:
    """Return what draws pairs beside this thread.

    Args:
        workers: processes; None takes one a core, 0 a thread of this process.
    """
    if workers == 0:
        return ThreadPoolExecutor(1)
    return ProcessPoolExecutor(
        workers or os.cpu_count(),
        mp_context=get_context("spawn"),
        initializer=torch.set_num_threads,
        initargs=(1,),
    )


def _path(folder: Path, seed: int) -> Path:
    return folder / f"pair_{seed:06d}.npz"


def _draw_into(folder: Path, size: tuple[int, int], recipe: Recipe, seed: int) -> Path:
    """Draw one pair into the folder, whole or not at all."""
    path = _path(folder, seed)
    unfinished = path.with_suffix(f".{os.getpid()}.part.npz")
    np.savez(unfinished, allow_pickle=False, **draw_pair(seed, size, recipe=recipe))
    unfinished.replace(path)
    return path


def _claim(folder: Path, record: dict[str, object]) -> None:
    """Write what the pairs of a folder are, or refuse a folder of others."""
    path = folder / RECORD
    if not path.exists():
        if any(folder.glob("pair_*.npz")):
            raise ValueError(f"{folder} holds pairs but no {RECORD} that says which; {ELSE}")
        path.write_text(json.dumps(record, indent=2) + "\n")
        return
    try:
        found = dict(json.loads(path.read_text()))
    except (ValueError, TypeError) as bad:
        raise ValueError(f"{path} is damaged ({bad}); {ELSE}") from bad
    for name, value in record.items():
        if found.get(name) != value:
            raise ValueError(
                f"{folder} holds pairs of {name} {found.get(name)}, not {value}; {ELSE}"
            )


def missing_pairs(folder: Path, seeds: range) -> list[int]:
    """Return the seeds whose pairs a folder lacks."""
    return [seed for seed in seeds if not _path(folder, seed).exists()]


def fill_pool(
    folder: Path,
    seeds: range,
    size: tuple[int, int],
    *,
    recipe: Recipe = FULL,
    workers: int | None = None,
) -> Generator[Path]:
    """Draw the pairs of `seeds` that the folder lacks, and yield each as it is done.

    Args:
        folder: where the pairs lie; made if missing.
        seeds: one pair each.
        size: (width, height) in pixels.
        recipe: what the scenes may be made of.
        workers: see `drawing`.

    Raises:
        ValueError: if the folder holds pairs of another size or recipe.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _claim(folder, {"size": "{} x {}".format(*size), "recipe": recipe_hash(recipe)})
    if missing := missing_pairs(folder, seeds):
        with drawing(workers) as executor:
            yield from executor.map(partial(_draw_into, folder, size, recipe), missing)


def read_pair(folder: Path, seed: int) -> Pair:
    """Read a pair that `fill_pool` has drawn; see `draw_pair`.

    Raises:
        ValueError: if the file is damaged.
    """
    path = _path(folder, seed)
    try:
        with path.open("rb") as file, np.load(file) as arrays:  # np.load leaves a bad file open
            return {name: arrays[name] for name in PARTS}
    except UNREADABLE as bad:
        raise ValueError(
            f"{path} is not a generated pair ({bad}); was it cut off? Remove it to draw it anew"
        ) from bad
