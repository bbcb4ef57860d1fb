"""Makers of maps: the heights of reliefs and the holes of cutouts; see `recon.training.reliefs`."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from recon.training.staging import Dice

__all__ = ["CUTOUTS", "RELIEFS", "hills"]

NODES = 81


def _grid() -> tuple[Tensor, Tensor]:
    """Return x and y of all nodes, (S, S) each, in [-1, 1]."""
    along = torch.linspace(-1, 1, NODES)
    y, x = torch.meshgrid(along, along, indexing="ij")
    return x, y


def _spread(heights: Tensor) -> Tensor:
    """Stretch heights to [-1, 1]."""
    low, high = heights.min(), heights.max()
    return 2 * (heights - low) / (high - low).clamp_min(1e-6) - 1


def hills(dice: Dice, coarsest: int | None = None) -> Tensor:
    """Return fractal heights: bumps of all sizes, the smaller the lower."""
    fade = dice.uniform(1.0, 1.8)
    first = coarsest or dice.whole(2, 6)
    total = torch.zeros(NODES, NODES)
    for octave in range(4):
        nodes = first * 2**octave + 1
        rough = torch.rand(1, 1, nodes, nodes, generator=dice.generator)
        smooth = F.interpolate(rough, (NODES, NODES), mode="bicubic", align_corners=True)
        total += smooth[0, 0] * 2.0 ** (-fade * octave)
    return _spread(total)


def _folds(dice: Dice) -> Tensor:
    """Return waves that run across each other, as in cloth."""
    x, y = _grid()
    total = torch.zeros(NODES, NODES)
    for _ in range(dice.whole(1, 4)):
        turn, phase = dice.uniform(0, math.pi), dice.uniform(0, 7)
        across = math.cos(turn) * x + math.sin(turn) * y
        total += torch.sin(dice.log_uniform(2, 14) * across + phase) * dice.uniform(0.3, 1)
    return _spread(total)


def _ridges(dice: Dice) -> Tensor:
    """Return equal ridges side by side, as of corrugated iron."""
    x, _ = _grid()
    wave = torch.sin(math.pi * dice.whole(4, 12) * x)
    return _spread(torch.tanh(dice.log_uniform(0.3, 4) * wave))


def _bumps(dice: Dice) -> Tensor:
    """Return a grid of equal domes or, upside down, of hollows."""
    x, y = _grid()
    count = dice.whole(2, 7)
    column, row = (((along + 1) * count / 2) % 1 - 0.5 for along in (x, y))
    dome = (1 - 4.5 * (column**2 + row**2)).clamp_min(0).sqrt()
    return _spread(dome if dice.chance(0.6) else -dome)


def _terraces(dice: Dice) -> Tensor:
    """Return hills cut into levels, as of rock or of stacked card."""
    levels = dice.whole(2, 5) * (hills(dice) + 1)
    return _spread(levels.floor() + torch.sigmoid(12 * (levels % 1 - 0.5)))


def _craters(dice: Dice) -> Tensor:
    """Return dents and mounds of all sizes, strewn about."""
    x, y = _grid()
    total = torch.zeros(NODES, NODES)
    for _ in range(dice.whole(5, 25)):
        middle_x, middle_y, reach = (dice.uniform(-1, 1) for _ in range(3))
        reach = 0.08 + 0.3 * reach**2
        distance = ((x - middle_x) ** 2 + (y - middle_y) ** 2) / reach**2
        total += torch.exp(-distance) * reach * dice.uniform(-1, 1)
    return _spread(total)


RELIEFS: dict[str, Callable[[Dice], Tensor]] = {
    "hills": hills,
    "folds": _folds,
    "ridges": _ridges,
    "bumps": _bumps,
    "terraces": _terraces,
    "craters": _craters,
}
"""Heights in [-1, 1], (S, S)."""


def _bars(dice: Dice) -> Tensor:
    """Return parallel bars, crossing ones, or a wall of windows."""
    x, y = _grid()
    count, width = dice.whole(3, 9), dice.uniform(-0.8, 0.6)
    across = torch.cos(math.pi * count * x) + width
    down = torch.cos(math.pi * dice.whole(2, 9) * y) + width
    one_way = dice.chance(0.4)
    return across if one_way else torch.maximum(across, down)


def _holes(dice: Dice) -> Tensor:
    """Return a sheet with a grid of round holes."""
    x, y = _grid()
    count, radius = dice.whole(2, 6), dice.uniform(0.2, 0.42)
    column, row = (((along + 1) * count / 2) % 1 - 0.5 for along in (x, y))
    return column**2 + row**2 - radius**2


def _torn(dice: Dice) -> Tensor:
    """Return scraps with ragged outlines."""
    return hills(dice) + dice.uniform(-0.2, 0.5)


def _blot(dice: Dice) -> Tensor:
    """Return one piece with lobes all around: a leaf, a star, a splash."""
    x, y = _grid()
    angle, radius = torch.atan2(y, x), (x**2 + y**2).sqrt()
    outline = torch.full_like(x, 0.65)
    for lobes in range(1, 8):
        swing = dice.uniform(0, 0.25) / math.sqrt(lobes)
        outline += swing * torch.sin(lobes * angle + dice.uniform(0, 7))
    return outline - radius


CUTOUTS: dict[str, Callable[[Dice], Tensor]] = {
    "bars": _bars,
    "holes": _holes,
    "torn": _torn,
    "blot": _blot,
}
"""Positive where there is something, (S, S)."""
