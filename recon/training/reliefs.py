"""Rectangles with a map: reliefs, which the map lifts, and cutouts, which it gives holes.

A map holds (S, S) values in [-1, 1] at the nodes of a grid over the square |x|, |y| <= 1, rows
along y, and is bilinear between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

__all__ = ["height_and_slope", "meet_cutout", "meet_relief"]

NEAREST = 1e-3
OVERLAP = 1e-4  # cells by which patches reach into each other; single precision has 1e-5
STEEP = 1e-9  # stands for a direction of zero, which nothing can be divided by


def _patches(of: Tensor) -> Tensor:
    """Return h, a, b, c of h + a x + b y + c x y in every cell, (..., 4, (S - 1)^2)."""
    corner, right = of[..., :-1, :-1], of[..., :-1, 1:]
    below, across = of[..., 1:, :-1], of[..., 1:, 1:]
    terms = (corner, right - corner, below - corner, across - right - below + corner)
    return torch.stack(terms, -3).flatten(-2)


def height_and_slope(maps: Tensor, which: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Read maps between their nodes.

    Args:
        maps: (M, S, S).
        which: (N,) int64, the map of each place.
        x: (N,) in [-1, 1], along a row of the map.
        y: (N,) in [-1, 1].

    Returns:
        (3, N): the value and its derivatives by x and by y.
    """
    cells = maps.shape[-1] - 1
    u, v = (x + 1) * (cells / 2), (y + 1) * (cells / 2)
    column, row = (place.long().clamp(0, cells - 1) for place in (u, v))
    u, v = u - column, v - row
    patches = _patches(maps).transpose(0, 1).reshape(4, -1)
    h, a, b, c = patches[:, (which * cells + row) * cells + column]
    height = h + a * u + b * v + c * u * v
    return torch.stack((height, (a + c * v) * (cells / 2), (b + c * u) * (cells / 2)))


def meet_cutout(origin: Tensor, direction: Tensor, heights: Tensor) -> Tensor:
    """Meet the part of the square |x|, |y| <= 1 of the plane z = 0 whose map is positive.

    Args:
        origin: (3, N) or (3, 1).
        direction: (3, N).
        heights: (S, S), the map.

    Returns:
        (N,) depth, +inf where a ray meets nothing.
    """
    depth = -origin[2] / direction[2]
    x, y = origin[0] + depth * direction[0], origin[1] + depth * direction[1]
    near = (torch.maximum(x.abs(), y.abs()) <= 1) & (depth > NEAREST)
    candidates = torch.nonzero(near)[:, 0]
    met = height_and_slope(
        heights[None], torch.zeros_like(candidates), x[candidates], y[candidates]
    )
    found = torch.full_like(depth, torch.inf)
    kept = candidates[met[0] > 0]
    found[kept] = depth[kept]
    return found


@dataclass(frozen=True, eq=False)
class _Walkers:
    """N rays on their way over the cells of a map, in units of cells.

    Attributes:
        ray: (N,) int64, which ray of those that were asked about.
        start: (3, N) where they come upon the cube that holds the relief.
        step: (3, N) how far they go while t grows by 1.
        t: (N,) how far they are, from `start` on.
        last: (N,) t where they leave the cube.
        cell: (2, N) int64, column and row of the cell they are in.
    """

    ray: Tensor
    start: Tensor
    step: Tensor
    t: Tensor
    last: Tensor
    cell: Tensor

    def chosen(self, index: Tensor) -> _Walkers:
        return _Walkers(
            self.ray[index],
            self.start.index_select(1, index),
            self.step.index_select(1, index),
            self.t[index],
            self.last[index],
            self.cell.index_select(1, index),
        )

    def next_lines(self) -> Tensor:
        """Return t where they cross into the next column and into the next row, (2, N)."""
        ahead = self.cell + (self.step[:2] > 0)
        return (ahead - self.start[:2]) / self.step[:2]


def _set_out(origin: Tensor, direction: Tensor, cells: int) -> tuple[_Walkers, Tensor]:
    """Return the rays that pass the cube [-1, 1]^3, and where all of them (N,) enter it."""
    direction = torch.where(direction.abs() < STEEP, STEEP, direction)
    first, second = (-1 - origin) / direction, (1 - origin) / direction
    enter = torch.minimum(first, second).amax(0).clamp_min(NEAREST)
    leave = torch.maximum(first, second).amin(0)
    ray = torch.nonzero(enter < leave)[:, 0]
    half = torch.tensor([cells / 2, cells / 2, 1.0], device=origin.device)[:, None]
    middle = torch.tensor([cells / 2, cells / 2, 0.0], device=origin.device)[:, None]
    at = (origin + enter * direction)[:, ray]
    start, step = at * half + middle, direction[:, ray] * half
    cell = start[:2].long().clamp(0, cells - 1)
    last = (leave - enter)[ray]
    return _Walkers(ray, start, step, torch.zeros_like(last), last, cell), enter


def _root_within(walkers: _Walkers, patches: Tensor, cells: int, until: Tensor) -> Tensor:
    """Return the smallest t up to `until` where each ray meets the patch of its cell, or +inf.

    Along a ray the height above a bilinear patch is a quadratic of t, so this is exact.
    """
    column, row = walkers.cell
    h, a, b, c = patches.index_select(1, row * cells + column)
    x, y, z = walkers.start + walkers.t * walkers.step
    x, y = x - column, y - row
    along_x, along_y, along_z = walkers.step
    constant = z - (h + a * x + b * y + c * x * y)
    linear = along_z - (a * along_x + b * along_y + c * (x * along_y + y * along_x))
    square = -c * along_x * along_y
    root = torch.sqrt(linear**2 - 4 * square * constant)
    q = -0.5 * (linear + torch.copysign(root, linear))
    slack = OVERLAP / walkers.step.abs().amax(0)  # a gap between cells would be a hole
    found = torch.full_like(until, torch.inf)
    for delta in (q / square, constant / q):
        near = (delta >= -slack) & (walkers.t + delta <= until + slack)  # NaN compares false
        found = torch.where(near, torch.minimum(found, walkers.t + delta), found)
    return found


def meet_relief(origin: Tensor, direction: Tensor, heights: Tensor) -> Tensor:
    """Meet the surface z = map(x, y) over |x|, |y| <= 1, from either side.

    Every ray walks from cell to cell and meets the bilinear patch of each exactly.

    Source: Amanatides & Woo, A fast voxel traversal algorithm for ray tracing, Eurographics 1987,
    for the walk.

    Args:
        origin: (3, N) or (3, 1).
        direction: (3, N).
        heights: (S, S), the map.

    Returns:
        (N,) depth, +inf where a ray meets nothing.
    """
    cells = heights.shape[0] - 1
    patches = _patches(heights)
    walkers, enter = _set_out(origin, direction, cells)
    found = torch.full_like(direction[0], torch.inf)
    for _ in range(2 * cells + 2):
        if not len(walkers.ray):
            break
        lines = walkers.next_lines()
        until = torch.minimum(lines.amin(0), walkers.last)
        met = _root_within(walkers, patches, cells, until)
        found[walkers.ray] = met
        down = (lines[1] < lines[0]).long()
        turn = torch.where(walkers.step[:2] > 0, 1, -1)
        cell = walkers.cell + turn * torch.stack((1 - down, down))
        going = met.isinf() & (until < walkers.last)
        going &= ((cell >= 0) & (cell < cells)).all(0)
        moved = _Walkers(walkers.ray, walkers.start, walkers.step, until, walkers.last, cell)
        walkers = moved.chosen(torch.nonzero(going)[:, 0])
    return enter + found
