"""Solids and sheets that rays are cast at.

Every shape is a unit shape under an affine map, so a ray is carried into the frame of the shape
and its parameter t means the same in both frames. Rays have direction (x, y, 1): t is depth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import torch
from torch import Tensor

__all__ = ["KINDS", "Hits", "Shapes", "Surface", "first_hits", "surface_at"]

NEAREST_M = 1e-3
RAYS_TIMES_SHAPES = 8_000_000


@dataclass(frozen=True, eq=False)
class Shapes:
    """K shapes as arrays.

    Attributes:
        kind: (K,) int64, an index of `KINDS`.
        centre: (K, 3) metres, in the frame of the left camera.
        world_from_shape: (K, 3, 3) rotations.
        half_size: (K, 3) metres, positive; half the extent along each own axis.
    """

    kind: Tensor
    centre: Tensor
    world_from_shape: Tensor
    half_size: Tensor

    def __len__(self) -> int:
        return len(self.kind)

    def __getitem__(self, index: Tensor) -> Shapes:
        return Shapes(*(getattr(self, field.name)[index] for field in fields(self)))


@dataclass(frozen=True, eq=False)
class Hits:
    """What N rays meet first.

    Attributes:
        depth: (N,) metres, +inf where a ray meets nothing.
        shape: (N,) int64 index of the shape met; 0 where there is none.
    """

    depth: Tensor
    shape: Tensor


def _box(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the cube [-1, 1]^3, from outside or from inside."""
    first = (-1 - origin) / direction
    second = (1 - origin) / direction
    enter = torch.minimum(first, second).amax(-1)
    leave = torch.maximum(first, second).amin(-1)
    depth = torch.where(enter > NEAREST_M, enter, leave)
    return torch.where((enter <= leave) & (depth > NEAREST_M), depth, torch.inf)


def _quadratic(a: Tensor, half_b: Tensor, c: Tensor) -> tuple[Tensor, Tensor]:
    """Return both roots of a t^2 + 2 half_b t + c, NaN where there is none."""
    root = torch.sqrt(half_b**2 - a * c)
    return (-half_b - root) / a, (-half_b + root) / a


def _ellipsoid(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the unit sphere from outside."""
    a = (direction**2).sum(-1)
    near, _ = _quadratic(a, (origin * direction).sum(-1), (origin**2).sum(-1) - 1)
    return torch.where(near > NEAREST_M, near, torch.inf)  # NaN compares false


def _cylinder(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the cylinder x^2 + y^2 <= 1, |z| <= 1 from outside."""
    flat_o, flat_d = origin[..., :2], direction[..., :2]
    a = (flat_d**2).sum(-1).clamp_min(1e-12)
    enter, leave = _quadratic(a, (flat_o * flat_d).sum(-1), (flat_o**2).sum(-1) - 1)
    bottom = (-1 - origin[..., 2]) / direction[..., 2]
    top = (1 - origin[..., 2]) / direction[..., 2]
    enter = torch.maximum(enter, torch.minimum(bottom, top))
    leave = torch.minimum(leave, torch.maximum(bottom, top))
    return torch.where((enter <= leave) & (enter > NEAREST_M), enter, torch.inf)


def _sheet(origin: Tensor, direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Meet the plane z = 0; return depth and the place met."""
    depth = -origin[..., 2] / direction[..., 2]
    place = origin[..., :2] + depth[..., None] * direction[..., :2]
    return torch.where(depth > NEAREST_M, depth, torch.inf), place[..., 0], place[..., 1]


def _rectangle(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the square |x|, |y| <= 1 of the plane z = 0."""
    depth, x, y = _sheet(origin, direction)
    return torch.where((x.abs() <= 1) & (y.abs() <= 1), depth, torch.inf)


def _disc(origin: Tensor, direction: Tensor) -> Tensor:
    """Meet the unit disc of the plane z = 0."""
    depth, x, y = _sheet(origin, direction)
    return torch.where(x**2 + y**2 <= 1, depth, torch.inf)


KINDS: dict[str, Callable[[Tensor, Tensor], Tensor]] = {
    "box": _box,
    "ellipsoid": _ellipsoid,
    "cylinder": _cylinder,
    "rectangle": _rectangle,
    "disc": _disc,
}


def _into_frame(shapes: Shapes, vectors: Tensor) -> Tensor:
    """Carry (N, 3) vectors into the frames of K shapes, in half sizes: (K, N, 3)."""
    turned = torch.einsum("nj,kji->kni", vectors, shapes.world_from_shape)
    return turned / shapes.half_size[:, None, :]


def first_hits(shapes: Shapes, origin: Tensor, directions: Tensor) -> Hits:
    """Return what each of N rays from one origin meets first.

    Args:
        shapes: K shapes.
        origin: (3,) metres.
        directions: (N, 3), with z = 1 where t shall be a depth.
    """
    best = torch.full_like(directions[:, 0], torch.inf)
    index = torch.zeros(len(directions), dtype=torch.int64, device=directions.device)
    at_once = max(1, RAYS_TIMES_SHAPES // max(1, len(directions)))
    for number, intersect in enumerate(KINDS.values()):
        members = torch.nonzero(shapes.kind == number)[:, 0]
        for part in torch.split(members, at_once) if len(members) else ():
            group = shapes[part]
            offset = torch.einsum("kj,kji->ki", origin - group.centre, group.world_from_shape)
            local_origin = (offset / group.half_size)[:, None, :]  # (K, 1, 3)
            depth, which = intersect(local_origin, _into_frame(group, directions)).min(0)
            closer = depth < best
            best = torch.where(closer, depth, best)
            index = torch.where(closer, part[which], index)
    return Hits(best, index)


@dataclass(frozen=True, eq=False)
class Surface:
    """Where rays met a surface.

    Attributes:
        place: (N, 3) metres, world frame.
        normal: (N, 3) unit, world frame, towards the side the ray came from.
        uv: (N, 2) metres along the surface, continuous on each face.
    """

    place: Tensor
    normal: Tensor
    uv: Tensor


def _local_normals(kind: Tensor, local: Tensor) -> Tensor:
    """Return outward normals (N, 3) at local places of unit shapes, not normalised."""
    axis = torch.nn.functional.one_hot(local.abs().argmax(-1), 3) * local.sign()
    along = torch.tensor([0.0, 0.0, 1.0], device=local.device)
    round_side = local * torch.tensor([1.0, 1.0, 0.0], device=local.device)
    cap = along * local[:, 2:].sign()
    side = torch.where(local[:, 2:].abs() > 1 - 1e-4, cap, round_side)
    choices = torch.stack((axis, local, side, along.expand_as(local), along.expand_as(local)))
    return choices[kind, torch.arange(len(kind), device=kind.device)]


def surface_at(shapes: Shapes, hits: Hits, origin: Tensor, directions: Tensor) -> Surface:
    """Return the surface at the places that N rays meet.

    Args:
        shapes: K shapes.
        hits: of these rays, all of them finite.
        origin: (3,) metres.
        directions: (N, 3).
    """
    met = shapes[hits.shape]
    place = origin + hits.depth[:, None] * directions
    metric = torch.einsum("nj,nji->ni", place - met.centre, met.world_from_shape)
    local_normal = _local_normals(met.kind, metric / met.half_size) / met.half_size
    normal = torch.einsum("ni,nji->nj", local_normal, met.world_from_shape)
    normal = torch.nn.functional.normalize(normal, dim=-1)
    facing = -(normal * directions).sum(-1, keepdim=True).sign()
    across = local_normal.abs().argmax(-1)
    others = torch.tensor([[1, 2], [0, 2], [0, 1]], device=place.device)[across]
    return Surface(place, normal * facing, metric.gather(1, others))
