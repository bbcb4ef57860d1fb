"""Patterns in the plane, as tones about [0, 1] between the two colours of a paint."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["PERIODIC", "SELF_FILTERED", "STYLES", "TABLE_SIZE", "Canvas"]

TABLE_SIZE = 512  # a power of two, so that a mask repeats it
OCTAVES = 6
BAND_OCTAVES = 5
BAND_BIAS = 1.0  # octaves; a slanted pixel is long in one direction only


def _lattice(table: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Read the table at whole-number places, repeating."""
    index = (row.long() & (TABLE_SIZE - 1)) * TABLE_SIZE + (column.long() & (TABLE_SIZE - 1))
    return table.flatten().index_select(0, index)


def _value_noise(table: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """Interpolate the table smoothly at (N,) places, in [0, 1]."""
    column, row = u.floor(), v.floor()
    right, down = u - column, v - row
    right, down = right**2 * (3 - 2 * right), down**2 * (3 - 2 * down)
    wrap, flat = TABLE_SIZE - 1, table.flatten()
    left_of = column.int() & wrap
    right_of = (left_of + 1) & wrap
    above = (row.int() & wrap) * TABLE_SIZE
    below = (above + TABLE_SIZE) & (wrap * TABLE_SIZE)
    corners = [flat.index_select(0, r + c) for r in (above, below) for c in (left_of, right_of)]
    return torch.lerp(
        torch.lerp(corners[0], corners[1], right), torch.lerp(corners[2], corners[3], right), down
    )


@dataclass(frozen=True, eq=False)
class Canvas:
    """N places that are to be painted.

    Attributes:
        table: lattice of uniform numbers, (`TABLE_SIZE`, `TABLE_SIZE`).
        u: (N,) coordinate of the pattern, one pattern a unit.
        v: (N,) the other coordinate.
        slope: (N,) see `Paint`.
        finest: (N,) highest frequency that a pixel can show, in periods a pattern.
    """

    table: Tensor
    u: Tensor
    v: Tensor
    slope: Tensor
    finest: Tensor

    def at(self, index: Tensor) -> Canvas:
        """Return some of the places."""
        parts = (self.u, self.v, self.slope, self.finest)
        return Canvas(self.table, *(part.index_select(0, index) for part in parts))

    def tone(self, column: Tensor, row: Tensor) -> Tensor:
        """Return a random number in [0, 1] for each whole-number place."""
        return _lattice(self.table, column, row)

    def smooth(self, u: Tensor, v: Tensor) -> Tensor:
        """Return noise of period 1 at other places, in [0, 1]."""
        return _value_noise(self.table, u, v)

    def fractal(self) -> Tensor:
        """Sum octaves of noise, each weighing 2^-slope of the last, to about [0, 1].

        An octave whose period is below the footprint of a pixel fades out: it would only alias.
        """
        total = torch.zeros_like(self.u)
        weight = torch.full_like(self.u, 1e-6)
        for octave in range(OCTAVES):
            scale = 2.0**octave
            amplitude = 2.0 ** (-self.slope * octave)
            seen = amplitude * (2 - 2 * scale / self.finest).clamp(0, 1)
            here = torch.nonzero(seen)[:, 0]  # far from all where octaves are fine
            u, v = self.u[here] * scale + 17 * octave, self.v[here] * scale
            total[here] += seen[here] * (_value_noise(self.table, u, v) - 0.5)
            weight += amplitude
        return 0.5 + 2.2 * total / weight.sqrt().clamp_min(1.0)

    def band(self) -> Tensor:
        """Sum the octaves of noise that a pixel can just show, wherever it lies, to about [0, 1].

        So a ground that runs from before the feet to the horizon has detail everywhere. Octaves
        fade in and out while the footprint of a pixel grows, and each place has one value.
        """
        level = torch.log2(self.finest.clamp_min(1e-6)) + BAND_BIAS
        top = level.floor()
        share = level - top
        total = torch.zeros_like(self.u)
        for step in range(BAND_OCTAVES):
            octave = top - step
            scale = torch.exp2(octave)
            weight = share if step == 0 else 1 - share if step == BAND_OCTAVES - 1 else 1.0
            weight = weight * 2.0 ** (0.5 * self.slope * (step - BAND_OCTAVES / 2))
            noise = _value_noise(self.table, self.u * scale + 17 * octave, self.v * scale)
            total = total + weight * (noise - 0.5)
        return 0.5 + 1.2 * total


def _wave(u: Tensor, sharpness: float = 6.0) -> Tensor:
    """Return a soft square wave of period 1 in [0, 1]."""
    return torch.sigmoid(sharpness * torch.sin(2 * torch.pi * u))


def _noise(at: Canvas) -> Tensor:
    return at.fractal()


def _stripes(at: Canvas) -> Tensor:
    return _wave(at.u)


def _checks(at: Canvas) -> Tensor:
    return (_wave(at.u) - 0.5) * (_wave(at.v) - 0.5) * 2 + 0.5


def _brick(at: Canvas) -> Tensor:
    row = (2 * at.v).floor()
    along = at.u + 0.5 * (row % 2)
    tone = 0.35 + 0.65 * at.tone(along.floor(), row)
    mortar = ((along % 1) < 0.06) | ((2 * at.v % 1) < 0.12)
    return torch.where(mortar, 0.0, 0.7 * tone + 0.3 * at.fractal())


def _wood(at: Canvas) -> Tensor:
    bend = at.smooth(0.3 * at.u, 2 * at.v)
    return 0.6 * _wave(2 * at.v + 1.5 * bend, 2.0) + 0.4 * at.fractal()


def _cells(at: Canvas) -> Tensor:
    tone, nearest = torch.zeros_like(at.u), torch.full_like(at.u, 9.0)
    for step in range(9):
        column, row = at.u.floor() + step % 3 - 1, at.v.floor() + step // 3 - 1
        du = column + at.tone(column + 31, row) - at.u
        dv = row + at.tone(column, row + 57) - at.v
        distance = du**2 + dv**2
        tone = torch.where(distance < nearest, at.tone(column, row), tone)
        nearest = torch.minimum(nearest, distance)
    return tone


def _glyphs(at: Canvas) -> Tensor:
    ink = at.tone((6 * at.u).floor(), (6 * at.v).floor()) > 0.5
    between = ((6 * at.u % 6) >= 5) | ((6 * at.v % 9) >= 6)
    return torch.where(ink & ~between, 0.0, 1.0)


def _spots(at: Canvas) -> Tensor:
    column, row = at.u.floor(), at.v.floor()
    radius = 0.15 + 0.3 * at.tone(column, row)
    distance = ((at.u - column - 0.5) ** 2 + (at.v - row - 0.5) ** 2).sqrt()
    return torch.sigmoid(40 * (distance - radius))


def _flat(at: Canvas) -> Tensor:
    return 0.5 + 0.08 * (at.fractal() - 0.5)


def _gradient(at: Canvas) -> Tensor:
    return at.smooth(0.25 * at.u, 0.25 * at.v) + 0.1 * (at.fractal() - 0.5)


def _marble(at: Canvas) -> Tensor:
    """Bend stripes by noise: veins."""
    bend = at.fractal() - 0.5
    return torch.sin(2 * math.pi * (at.u + 2.5 * bend)).abs().sqrt()


def _patches(at: Canvas) -> Tensor:
    """Cut noise into four tones with sharp borders: camouflage, rust, lichen."""
    tone = at.fractal()
    return (4 * tone).floor().clamp(0, 3) / 3


def _weave(at: Canvas) -> Tensor:
    """Cross threads that pass over and under each other."""
    column, row = at.u.floor(), at.v.floor()
    over = ((column + row) % 2).bool()
    across = torch.where(over, at.u - column, at.v - row)
    thread = 0.6 + 0.4 * at.tone(torch.where(over, column, row), over)
    return thread * (1 - (2 * across - 1) ** 2)


def _tiles(at: Canvas) -> Tensor:
    """Lay equal square tiles with thin joints."""
    joint = ((at.u % 1) < 0.05) | ((at.v % 1) < 0.05)
    tone = 0.75 + 0.25 * at.tone(at.u.floor(), at.v.floor())
    return torch.where(joint, 0.0, tone)


def _earth(at: Canvas) -> Tensor:
    return at.band()


STYLES: dict[str, Callable[[Canvas], Tensor]] = {
    "noise": _noise,
    "stripes": _stripes,
    "checks": _checks,
    "brick": _brick,
    "wood": _wood,
    "cells": _cells,
    "glyphs": _glyphs,
    "spots": _spots,
    "flat": _flat,
    "gradient": _gradient,
    "marble": _marble,
    "patches": _patches,
    "weave": _weave,
    "tiles": _tiles,
    "earth": _earth,
}

SELF_FILTERED = ("noise", "earth")
"""What fades by itself where a pixel cannot show it."""

PERIODIC = ("stripes", "checks", "brick", "weave", "tiles")
"""What repeats, so that a matcher may take one place for another."""
