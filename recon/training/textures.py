"""Procedural paint: colour as a function of a place on a surface."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from recon.training.patterns import SELF_FILTERED, STYLES, TABLE_SIZE, Canvas

__all__ = ["STYLES", "Paint", "noise_table", "paint"]

GRAIN_FREQUENCY = 9


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


def paint(of: Paint, uv: Tensor, footprint_m: Tensor, table: Tensor) -> Tensor:
    """Return the colour of N places.

    Args:
        of: the paint at each place, N entries.
        uv: (2, N) metres along the surface.
        footprint_m: (N,) width of a pixel on the surface, metres.
        table: from `noise_table`.

    Returns:
        (3, N) linear RGB in [0, 1].
    """
    cos, sin = torch.cos(of.turn), torch.sin(of.turn)
    across, down = uv * of.frequency
    u = cos * across + sin * down + of.offset[:, 0]
    v = cos * down - sin * across + of.offset[:, 1]
    finest = 1 / (2 * footprint_m * of.frequency).clamp_min(1e-6)
    whole = Canvas(table, u, v, of.slope, finest)
    sharp = (finest - 0.5).clamp(0, 1)  # a pattern finer than the pixels melts into its mean
    tone = torch.zeros_like(u)
    for number, (name, style) in enumerate(STYLES.items()):
        chosen = torch.nonzero(of.style == number)[:, 0]
        if len(chosen):
            drawn = style(whole.at(chosen)) - 0.5
            tone[chosen] = drawn if name in SELF_FILTERED else drawn * sharp[chosen]
    scale = GRAIN_FREQUENCY
    grain = Canvas(table, scale * v, scale * u, 0.3 * of.slope, finest / scale).fractal()
    tone = 0.5 + tone + of.grain * (grain - 0.5)
    first, second = of.colours.permute(1, 2, 0)
    return torch.lerp(first, second, tone).clamp(0, 1)
