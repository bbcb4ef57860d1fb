"""What rays meet first, and what the surface is like there.

Rays come as images, and a shape is only cast at in the window of the image that it can fill.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.reliefs import height_and_slope
from recon.training.shapes import ANALYTIC, KINDS, MAPPED, Shapes, dot

__all__ = ["Camera", "Hits", "Rays", "Surface", "Window", "first_hits", "surface_at", "windows"]

Window = tuple[slice, slice]

NEAR_PLANE_M = 0.02
EVERYWHERE = (slice(None), slice(None))


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks along z from (x_m, 0, 0).

    Attributes:
        width: pixels.
        height: pixels.
        focal_px: focal length; the principal point is the middle of the image.
        x_m: how far it stands to the right.
    """

    width: int
    height: int
    focal_px: float
    x_m: float = 0.0

    def place(self, device: torch.device) -> Tensor:
        """Return where it stands, (3,)."""
        return torch.tensor([self.x_m, 0.0, 0.0], device=device)

    def rays(self, offsets: list[tuple[float, float]], device: torch.device) -> Rays:
        """Return the rays with z = 1 through all pixels, once for each offset.

        Args:
            offsets: S places in a pixel, (right, down) of its centre.
            device: where to put them.
        """
        shift = torch.tensor(offsets, device=device)[:, :, None, None]  # (S, 2, 1, 1)
        row = torch.arange(self.height, device=device, dtype=torch.float32)[:, None]
        column = torch.arange(self.width, device=device, dtype=torch.float32)
        x = (column - (self.width - 1) / 2 + shift[:, 0]) / self.focal_px
        y = (row - (self.height - 1) / 2 + shift[:, 1]) / self.focal_px
        size = (len(offsets), self.height, self.width)
        direction = torch.stack([part.expand(size) for part in (x, y, torch.ones_like(x))])
        return Rays(self.place(device)[:, None, None, None], direction)


@dataclass(frozen=True, eq=False)
class Rays:
    """S images of rays.

    Attributes:
        origin: (3, S, H, W) metres, or of size 1 along each of the last three axes.
        direction: (3, S, H, W), with z = 1 where t shall be a depth.
    """

    origin: Tensor
    direction: Tensor

    def within(self, window: Window) -> tuple[Tensor, Tensor]:
        """Return origin (3, 1 or N) and direction (3, N) of the N rays in a window."""
        cut = (slice(None), slice(None), *window)
        origin = self.origin if self.origin.shape[2] == 1 else self.origin[cut]
        return origin.flatten(1), self.direction[cut].flatten(1)

    def at(self, depth: Tensor) -> Tensor:
        """Return the places (3, S, H, W) that they reach at `depth` (S, H, W)."""
        return self.origin + depth * self.direction


@dataclass(frozen=True, eq=False)
class Hits:
    """What rays meet first.

    Attributes:
        depth: (S, H, W) metres, +inf where a ray meets nothing.
        shape: (S, H, W) int64 index of the shape met; 0 where there is none.
    """

    depth: Tensor
    shape: Tensor


def windows(
    corners: Tensor, camera: Camera, slack: tuple[float, float] = (0.0, 0.0)
) -> list[Window]:
    """Return the part of the image that holds each shape.

    Args:
        corners: (K, C, 3) metres, of something convex around each of K shapes.
        camera: which looks.
        slack: columns by which rays may be shifted, at least and at most: a ray that belongs to
            column x passes through the column x - shift of this camera.
    """
    x, y, z = (corners - camera.place(corners.device)).unbind(-1)
    depth = z.clamp_min(NEAR_PLANE_M)
    column = camera.focal_px * x / depth + (camera.width - 1) / 2
    row = camera.focal_px * y / depth + (camera.height - 1) / 2
    sides = torch.stack(
        (
            row.amin(1).floor() - 1,
            row.amax(1).ceil() + 2,
            (column.amin(1) + slack[0]).floor() - 1,
            (column.amax(1) + slack[1]).ceil() + 2,
        )
    )
    most = torch.tensor([camera.height] * 2 + [camera.width] * 2, device=corners.device)
    sides = sides.clamp_min(0).minimum(most[:, None])
    cut = z.amin(1) < NEAR_PLANE_M  # by the plane of the camera: it may be anywhere
    whole = torch.stack((torch.zeros_like(most[0]), most[0], torch.zeros_like(most[0]), most[2]))
    sides = torch.where(cut, whole[:, None], sides)
    sides = torch.where(z.amax(1) <= 0, 0, sides)
    return [
        (slice(top, bottom), slice(left, right))
        for top, bottom, left, right in sides.T.int().tolist()
    ]


def _carried(turn: Tensor, vectors: Tensor) -> Tensor:
    """Multiply vectors (3, N) by a matrix (3, 3), in full precision.

    A product of matrices may be rounded to 10 bits on an accelerator, if somebody allowed that.
    """
    return torch.stack([dot(row, vectors) for row in turn])


def _meet(shapes: Shapes, index: int, kind: str, origin: Tensor, direction: Tensor) -> Tensor:
    """Return the depth (N,) where rays in the frame of one shape meet it."""
    if kind in ANALYTIC:
        return ANALYTIC[kind](origin, direction)
    return MAPPED[kind](origin, direction, shapes.maps[shapes.map_of[index]])


def first_hits(shapes: Shapes, rays: Rays, within: list[Window] | None = None) -> Hits:
    """Return what rays meet first.

    Args:
        shapes: K shapes.
        rays: S images of them.
        within: K windows outside of which a ray cannot meet the shape; None asks every ray.
    """
    best = torch.full_like(rays.direction[0], torch.inf)
    index = torch.zeros_like(best, dtype=torch.int64)
    shape_from_world = shapes.world_from_shape.transpose(1, 2) / shapes.half_size[:, :, None]
    for number, kind in enumerate(shapes.kind.tolist()):
        rows, columns = within[number] if within else EVERYWHERE
        origin, direction = rays.within((rows, columns))
        if not direction.numel():
            continue
        turn, centre = shape_from_world[number], shapes.centre[number, :, None]
        there = _carried(turn, origin - centre)
        depth = _meet(shapes, number, KINDS[kind], there, _carried(turn, direction))
        nearest, which = best[:, rows, columns], index[:, rows, columns]
        depth = depth.reshape(nearest.shape)
        which.masked_fill_(depth < nearest, number)
        nearest.copy_(torch.minimum(depth, nearest))
    return Hits(best, index)


@dataclass(frozen=True, eq=False)
class Surface:
    """Where N rays met a surface.

    Attributes:
        place: (3, N) metres, world frame.
        normal: (3, N) unit, world frame, towards the side the ray came from.
        uv: (2, N) metres along the surface, continuous on each face.
    """

    place: Tensor
    normal: Tensor
    uv: Tensor


def _unit_normals(shapes: Shapes, met: Tensor, local: Tensor) -> Tensor:
    """Return outward normals (3, N) at local places of unit shapes, not normalised.

    Args:
        shapes: K shapes.
        met: (N,) which of them each place is on.
        local: (3, N) in half sizes.
    """
    normal = torch.zeros_like(local)
    normal[2] = 1.0
    kind = shapes.kind[met]
    for name in {KINDS[number] for number in shapes.kind.tolist()} - {"rectangle", "disc"}:
        here = torch.nonzero(kind == KINDS.index(name))[:, 0]
        if name != "cutout":
            normal[:, here] = _normals_of(name, shapes, met[here], local[:, here])
    return normal


def _normals_of(kind: str, shapes: Shapes, met: Tensor, local: Tensor) -> Tensor:
    """Return outward normals (3, N) of shapes of one kind; see `_unit_normals`."""
    x, y, z = local
    if kind == "box":
        side = torch.nn.functional.one_hot(local.abs().argmax(0), 3).T
        return side * local.sign()
    if kind == "relief":
        _, across, down = height_and_slope(shapes.maps, shapes.map_of[met], x, y)
        return torch.stack((-across, -down, torch.ones_like(x)))
    if kind == "ellipsoid":
        return local
    level = torch.stack((x, y, torch.zeros_like(z)))
    if kind == "tube":
        return level
    lid = torch.stack((torch.zeros_like(x), torch.zeros_like(y), z.sign()))
    return torch.where(z.abs() > 1 - 1e-4, lid, level)


def surface_at(shapes: Shapes, met: Tensor, place: Tensor, direction: Tensor) -> Surface:
    """Return the surface at the places that N rays meet.

    Args:
        shapes: K shapes.
        met: (N,) which of them each ray meets.
        place: (3, N) metres, where.
        direction: (3, N) of the rays.
    """
    turn = shapes.world_from_shape.flatten(1).T.index_select(1, met).reshape(3, 3, -1)
    offset = place - shapes.centre.T.index_select(1, met)
    metric = torch.stack([dot(offset, turn[:, own]) for own in range(3)])
    half = shapes.half_size.T.index_select(1, met)
    own_normal = _unit_normals(shapes, met, metric / half) / half
    normal = torch.stack([dot(own_normal, turn[world]) for world in range(3)])
    normal = normal / dot(normal, normal).sqrt()
    across = own_normal.abs().argmax(0)
    across = across.masked_fill(shapes.kind[met] == KINDS.index("relief"), 2)
    others = torch.tensor([[1, 0, 0], [2, 2, 1]], device=place.device)[:, across]
    return Surface(place, normal * -dot(normal, direction).sign(), metric.gather(0, others))
