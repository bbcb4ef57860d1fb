"""Procedural paint: colour as a function of a place on a surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from torch import Tensor

__all__ = ["STYLES", "Paint", "noise_table", "paint"]

TABLE_SIZE = 512
OCTAVES = 6


@dataclass(frozen=True, eq=False)
class Paint:
    """The paint of K shapes.

    Attributes:
        style: (K,) int64, an index of `STYLES`.
        colours: (K, 2, 3) linear RGB in [0, 1], what the pattern varies between.
        frequency: (K,) patterns a metre.
        turn: (K,) radians, direction of the pattern.
        slope: (K,) how fast the octaves of noise fade; 0 is white, 1 is 1/f.
        grain: (K,) amplitude of fine noise over any pattern.
        gloss: (K,) strength of the highlight.
        offset: (K, 2) where in the table of noise the pattern begins.
    """

    style: Tensor
    colours: Tensor
    frequency: Tensor
    turn: Tensor
    slope: Tensor
    grain: Tensor
    gloss: Tensor
    offset: Tensor

    def __getitem__(self, index: Tensor) -> Paint:
        return Paint(*(getattr(self, field.name)[index] for field in fields(self)))


def noise_table(generator: torch.Generator) -> Tensor:
    """Return the (S, S) lattice of uniform numbers in [0, 1] that all noise is read from."""
    return torch.rand(TABLE_SIZE, TABLE_SIZE, generator=generator, device=generator.device)


def _lattice(table: Tensor, column: Tensor, row: Tensor) -> Tensor:
    """Read the table at whole-number places, repeating."""
    return table[row.long() % TABLE_SIZE, column.long() % TABLE_SIZE]


def _value_noise(table: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """Interpolate the table smoothly at (N,) places, in [0, 1]."""
    column, row = u.floor(), v.floor()
    right, down = u - column, v - row
    right, down = right**2 * (3 - 2 * right), down**2 * (3 - 2 * down)
    above = torch.lerp(_lattice(table, column, row), _lattice(table, column + 1, row), right)
    below = torch.lerp(
        _lattice(table, column, row + 1), _lattice(table, column + 1, row + 1), right
    )
    return torch.lerp(above, below, down)


def _fractal(table: Tensor, u: Tensor, v: Tensor, slope: Tensor, finest: Tensor) -> Tensor:
    """Sum octaves of noise, each weighing 2^-slope of the last, to about [0, 1].

    An octave whose period is below the footprint of a pixel fades out: it would only alias.

    Args:
        table: the lattice.
        u: (N,) pattern coordinate.
        v: (N,) pattern coordinate.
        slope: (N,) see `Paint`.
        finest: (N,) highest frequency that a pixel can show, in periods a pattern unit.
    """
    total = torch.zeros_like(u)
    weight = torch.full_like(u, 1e-6)
    for octave in range(OCTAVES):
        scale = 2.0**octave
        amplitude = 2.0 ** (-slope * octave)
        seen = amplitude * (2 - 2 * scale / finest).clamp(0, 1)
        total = total + seen * (_value_noise(table, u * scale + 17 * octave, v * scale) - 0.5)
        weight = weight + amplitude
    return 0.5 + 2.2 * total / weight.sqrt().clamp_min(1.0)


def _wave(u: Tensor, sharpness: float = 6.0) -> Tensor:
    """Return a soft square wave of period 1 in [0, 1]."""
    return torch.sigmoid(sharpness * torch.sin(2 * torch.pi * u))


def _noise(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    return fractal


def _stripes(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    return _wave(u)


def _checks(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    return (_wave(u) - 0.5) * (_wave(v) - 0.5) * 2 + 0.5


def _brick(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:
    row = (2 * v).floor()
    along = u + 0.5 * (row % 2)
    tone = 0.35 + 0.65 * _lattice(table, along.floor(), row)
    mortar = ((along % 1) < 0.06) | ((2 * v % 1) < 0.12)
    return torch.where(mortar, torch.zeros_like(u), 0.7 * tone + 0.3 * fractal)


def _wood(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:
    bend = _value_noise(table, 0.3 * u, 2 * v)
    return 0.6 * _wave(2 * v + 1.5 * bend, 2.0) + 0.4 * fractal


def _cells(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    tone, nearest = torch.zeros_like(u), torch.full_like(u, 9.0)
    for step in range(9):
        column, row = u.floor() + step % 3 - 1, v.floor() + step // 3 - 1
        du = column + _lattice(table, column + 31, row) - u
        dv = row + _lattice(table, column, row + 57) - v
        distance = du**2 + dv**2
        tone = torch.where(distance < nearest, _lattice(table, column, row), tone)
        nearest = torch.minimum(nearest, distance)
    return tone


def _glyphs(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    ink = _lattice(table, (6 * u).floor(), (6 * v).floor()) > 0.5
    between = ((6 * u % 6) >= 5) | ((6 * v % 9) >= 6)
    return torch.where(ink & ~between, torch.zeros_like(u), torch.ones_like(u))


def _spots(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    column, row = u.floor(), v.floor()
    radius = 0.15 + 0.3 * _lattice(table, column, row)
    distance = ((u - column - 0.5) ** 2 + (v - row - 0.5) ** 2).sqrt()
    return torch.sigmoid(40 * (distance - radius))


def _flat(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:  # noqa: ARG001
    return 0.5 + 0.08 * (fractal - 0.5)


def _gradient(table: Tensor, u: Tensor, v: Tensor, fractal: Tensor) -> Tensor:
    return _value_noise(table, 0.25 * u, 0.25 * v) + 0.1 * (fractal - 0.5)


STYLES: dict[str, Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]] = {
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
}


def paint(of: Paint, uv: Tensor, footprint_m: Tensor, table: Tensor) -> Tensor:
    """Return the colour of N places.

    Args:
        of: the paint at each place, N entries.
        uv: (N, 2) metres along the surface.
        footprint_m: (N,) width of a pixel on the surface, metres.
        table: from `noise_table`.

    Returns:
        (N, 3) linear RGB in [0, 1].
    """
    cos, sin = torch.cos(of.turn), torch.sin(of.turn)
    scaled = uv * of.frequency[:, None]
    u = cos * scaled[:, 0] + sin * scaled[:, 1] + of.offset[:, 0]
    v = cos * scaled[:, 1] - sin * scaled[:, 0] + of.offset[:, 1]
    finest = 1 / (2 * footprint_m * of.frequency).clamp_min(1e-6)
    fractal = _fractal(table, u, v, of.slope, finest)
    tone = torch.zeros_like(u)
    for number, style in enumerate(STYLES.values()):
        chosen = torch.nonzero(of.style == number)[:, 0]
        tone[chosen] = style(table, u[chosen], v[chosen], fractal[chosen])
    # A pattern finer than the pixels melts into its mean.
    sharp = (finest - 0.5).clamp(0, 1)
    tone = 0.5 + (tone - 0.5) * torch.where(of.style == 0, torch.ones_like(sharp), sharp)
    tone = tone + of.grain * (_fractal(table, 9 * v, 9 * u, 0.3 * of.slope, finest / 9) - 0.5)
    return torch.lerp(of.colours[:, 0], of.colours[:, 1], tone[:, None]).clamp(0, 1)
