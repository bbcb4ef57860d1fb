"""Where pairs come from while a network trains, and what of them it sees."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor

from recon.training.misalignment import Pairs
from recon.training.pool import Pair, draw_pair, drawing, read_pair
from recon.training.settings import Training

__all__ = ["FreshPairs", "Source", "StoredPairs", "pairs_for", "random_crops", "whole"]

VIEWS = ("left", "right")


class Source(Protocol):
    """Pairs to train on; which are offered follows from the step alone."""

    def seeds(self, step: int) -> range:
        """Return the pairs to choose from at a step; steps are asked for in order."""
        ...

    def pair(self, seed: int) -> Pair:
        """Return one of them."""
        ...


class StoredPairs:
    """All pairs of a pool but those for validation, at every step."""

    def __init__(self, folder: Path, seeds: range) -> None:
        self._folder = folder
        self._seeds = seeds

    def seeds(self, step: int) -> range:  # noqa: ARG002  the same at every step
        """See `Source`."""
        return self._seeds

    def pair(self, seed: int) -> Pair:
        """See `Source`."""
        return read_pair(self._folder, seed)


class FreshPairs:
    """A window over an endless row of pairs, which are drawn ahead by other processes.

    Args:
        settings: `uses` and `batch` say how fast the window moves.
        device: that trains.
    """

    def __init__(self, settings: Training, device: str) -> None:
        self._settings = settings
        self._executor = drawing(settings.workers)
        workers = os.cpu_count() if settings.workers is None else settings.workers
        self._ahead = 2 * max(1, workers or 1)
        where = device if settings.draw_on == "device" else "cpu"
        self._draw = partial(draw_pair, size=settings.size, recipe=settings.recipe, device=where)
        self._begun: dict[int, Future[Pair]] = {}

    def seeds(self, step: int) -> range:
        """See `Source`; begins to draw what later steps need."""
        settings = self._settings
        first = settings.pairs + step * settings.batch // settings.uses
        for old in [seed for seed in self._begun if seed < first]:
            self._begun.pop(old).cancel()
        for seed in range(first, first + settings.window + self._ahead):
            if seed not in self._begun:
                self._begun[seed] = self._executor.submit(self._draw, seed)
        return range(first, first + settings.window)

    def pair(self, seed: int) -> Pair:
        """See `Source`; waits until it is drawn."""
        return self._begun[seed].result()

    def close(self) -> None:
        """Draw no more."""
        self._executor.shutdown(cancel_futures=True)


@contextmanager
def pairs_for(settings: Training, device: str) -> Iterator[Source]:
    """Give the source of pairs that the settings ask for."""
    if settings.source == "pool":
        yield StoredPairs(settings.pool, settings.training_seeds)
        return
    fresh = FreshPairs(settings, device)
    try:
        yield fresh
    finally:
        fresh.close()


def whole(pair: Pair, device: torch.device) -> Pairs:
    """Return a pair as a batch of one."""
    parts = {name: torch.from_numpy(part)[None].to(device) for name, part in pair.items()}
    left, right = (parts[name].permute(0, 3, 1, 2).float() / 255 for name in VIEWS)
    return Pairs(left, right, parts["disparity"], parts["visible"])


def random_crops(
    source: Source,
    step: int,
    settings: Training,
    *,
    generator: torch.Generator,
    device: torch.device,
) -> Pairs:
    """Return random rows of random pairs, some upside down, their colours in any order."""
    seeds, rows = source.seeds(step), settings.crop_rows
    columns: dict[str, list[Tensor]] = {}
    upside_down, orders = [], []
    for index in torch.randint(len(seeds), (settings.batch,), generator=generator):
        top = int(torch.randint(settings.size[1] - rows + 1, (), generator=generator))
        upside_down.append(bool(torch.rand((), generator=generator) < 0.5))
        orders.append(torch.randperm(3, generator=generator))
        for name, array in source.pair(seeds[int(index)]).items():
            columns.setdefault(name, []).append(torch.from_numpy(array[top : top + rows]))
    turns, order = torch.tensor(upside_down).to(device), torch.stack(orders).to(device)
    parts = {name: _turned(torch.stack(crops).to(device), turns) for name, crops in columns.items()}
    left, right = (_reordered(parts[name].permute(0, 3, 1, 2), order) for name in VIEWS)
    return Pairs(left.float() / 255, right.float() / 255, parts["disparity"], parts["visible"])


def _turned(crops: Tensor, upside_down: Tensor) -> Tensor:
    """Return crops (N, h, ...), those turned upside down where (N,) says so."""
    chosen = upside_down.reshape(-1, *(1,) * (crops.ndim - 1))
    return torch.where(chosen, crops.flip(1), crops)


def _reordered(views: Tensor, order: Tensor) -> Tensor:
    """Return views (N, 3, h, W) with the channels of each in its order (N, 3)."""
    return views.gather(1, order[:, :, None, None].expand_as(views))
