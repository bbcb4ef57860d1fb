"""Solids and sheets that rays are cast at.

Every shape is a unit shape under an affine map, so a ray is carried into the frame of the shape
and its parameter t means the same in both frames. Rays have direction (x, y, 1): t is depth.
Vectors have their three coordinates first, so that each coordinate is one piece of memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.reliefs import meet_cutout, meet_relief

__all__ = ["ANALYTIC", "KINDS", "MAPPED", "NEAREST_M", "Shapes", "dot"]

NEAREST_M = 1e-3


@dataclass(frozen=True, eq=False)
class Shapes:
    """K shapes as arrays.

    Attributes:
        kind: (K,) int64, an index of `KINDS`.
        centre: (K, 3) metres, in the frame of the left camera.
        world_from_shape: (K, 3, 3) rotations.
        half_size: (K, 3) metres, positive; half the extent along each own axis.
        map_of: (K,) int64, which of `maps` a relief or a cutout has.
        maps: (M, S, S), see `recon.training.reliefs`.
    """

    kind: Tensor
    centre: Tensor
    world_from_shape: Tensor
    half_size: Tensor
    map_of: Tensor
    maps: Tensor

    def __len__(self) -> int:
        return len(self.kind)

    def chosen(self, index: Tensor) -> Shapes:
        """Return the shapes of `index`, with all maps."""
        return Shapes(
            self.kind[index],
            self.centre[index],
            self.world_from_shape[index],
            self.half_size[index],
            self.map_of[index],
            self.maps,
        )

    def corners(self) -> Tensor:
        """Return the corners of the boxes around them, (K, 8, 3) metres."""
        signs = torch.tensor([-1.0, 1.0], device=self.centre.device)
        unit = torch.cartesian_prod(signs, signs, signs)  # (8, 3)
        reach = (unit * self.half_size[:, None])[:, :, None]  # (K, 8, 1, 3)
        return self.centre[:, None] + (reach * self.world_from_shape[:, None]).sum(-1)


def _largest(of: Tensor) -> Tensor:
    """Return the largest of three coordinates; faster than a reduction over so short an axis."""
    return torch.maximum(torch.maximum(of[0], of[1]), of[2])


def _box(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the cube [-1, 1]^3, from outside or from inside."""
    first = (-1 - origin) / direction
    second = (1 - origin) / direction
    enter = _largest(torch.minimum(first, second))
    leave = -_largest(-torch.maximum(first, second))
    depth = torch.where(enter > NEAREST_M, enter, leave)
    return torch.where((enter <= leave) & (depth > NEAREST_M), depth, torch.inf)


def dot(first: Tensor, second: Tensor) -> Tensor:
    """Return the sums of products (N,) of two or three coordinates, (2 or 3, N) each."""
    total = first[0] * second[0]
    for one, other in zip(first[1:], second[1:], strict=True):
        total = total + one * other
    return total


def _unit_round(origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Meet |p| = 1 in two or three coordinates: where rays enter and leave, NaN if they pass by.

    The half chord is taken about the place that is nearest to the middle. The textbook's
    b^2 - a c would lose the square of (distance / radius) in digits, which thin rods need.
    """
    a = dot(direction, direction).clamp_min(1e-12)
    middle = -dot(origin, direction) / a
    passing = origin + middle * direction
    half_chord = ((1 - dot(passing, passing)) / a).sqrt()
    return middle - half_chord, middle + half_chord


def _ellipsoid(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the unit sphere from outside."""
    near, _ = _unit_round(origin, direction)
    return torch.where(near > NEAREST_M, near, torch.inf)  # NaN compares false


def _round_side(origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Meet the endless cylinder x^2 + y^2 = 1: where rays enter and where they leave."""
    return _unit_round(origin[:2], direction[:2])


def _cylinder(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the cylinder x^2 + y^2 <= 1, |z| <= 1 from outside."""
    enter, leave = _round_side(origin, direction)
    bottom = (-1 - origin[2]) / direction[2]
    top = (1 - origin[2]) / direction[2]
    enter = torch.maximum(enter, torch.minimum(bottom, top))
    leave = torch.minimum(leave, torch.maximum(bottom, top))
    return torch.where((enter <= leave) & (enter > NEAREST_M), enter, torch.inf)


def _tube(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the side x^2 + y^2 = 1, |z| <= 1, which has no lids: its inside shows too."""
    found = torch.full_like(direction[0], torch.inf)
    for depth in reversed(_round_side(origin, direction)):
        on_side = ((origin[2] + depth * direction[2]).abs() <= 1) & (depth > NEAREST_M)
        found = torch.where(on_side, depth, found)
    return found


def _sheet(origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Meet the plane z = 0; return depth and the place met."""
    depth = -origin[2] / direction[2]
    x, y = origin[0] + depth * direction[0], origin[1] + depth * direction[1]
    return depth.masked_fill(~(depth > NEAREST_M), torch.inf), x, y


def _rectangle(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the square |x|, |y| <= 1 of the plane z = 0."""
    depth, x, y = _sheet(origin, direction)
    return depth.masked_fill(~(torch.maximum(x.abs(), y.abs()) <= 1), torch.inf)


def _disc(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the unit disc of the plane z = 0."""
    depth, x, y = _sheet(origin, direction)
    return depth.masked_fill(~(x**2 + y**2 <= 1), torch.inf)


ANALYTIC: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "box": _box,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "rectangle": _rectangle,
    "disc": _disc,
    "tube": _tube,
}
"""Kinds of shape that a formula describes: origin and direction (3, N) to depth (N,)."""

MAPPED: dict[str, Callable[[Tensor, Tensor, Tensor], Tensor]] = {
    "relief": meet_relief,
    "cutout": meet_cutout,
}
"""Kinds that have a map besides."""

KINDS = (*ANALYTIC, *MAPPED)
