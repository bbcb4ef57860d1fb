"""What a scene is made of: things with paint, a light, and the cameras that look."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.shapes import KINDS, Shapes
from recon.training.textures import STYLES, Paint

__all__ = ["Coat", "Place", "Scene", "Thing", "View", "assemble", "rotation_about", "turned"]

Place = tuple[float, float, float]

WALL = 60.0


@dataclass(frozen=True)
class View:
    """The camera pair: both views share focal length and principal point.

    Attributes:
        width: pixels.
        height: pixels.
        focal_px: focal length.
        baseline_m: distance between the cameras.
    """

    width: int
    height: int
    focal_px: float
    baseline_m: float

    @property
    def centre(self) -> tuple[float, float]:
        """Principal point, in the middle of the image."""
        return (self.width - 1) / 2, (self.height - 1) / 2


@dataclass(frozen=True, eq=False)
class Coat:
    """The paint of one thing, as plain numbers; see `Paint` for each."""

    style: str
    colours: Tensor
    frequency: float
    turn: float = 0.0
    slope: float = 0.7
    grain: float = 0.2
    gloss: float = 0.0
    offset: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Thing:
    """One shape and its paint; see `Shapes`."""

    kind: str
    centre: Place
    half_size: Place
    rotation: Tensor
    coat: Coat


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes, paint and light.

    Attributes:
        shapes: K shapes in the frame of the left camera.
        paints: of the same K.
        to_light: (3,) unit vector towards the light.
        casts_shadows: whether light is blocked.
        table: noise, see `noise_table`.
    """

    shapes: Shapes
    paints: Paint
    to_light: Tensor
    casts_shadows: bool
    table: Tensor

    def in_shadow(self, places: Tensor) -> Tensor:
        """Return which of (N, 3) places the light does not reach."""
        if not self.casts_shadows:
            return torch.zeros(len(places), dtype=torch.bool, device=places.device)
        reach = first_hits_from(self.shapes, places, self.to_light)
        return reach < WALL / 2


def first_hits_from(shapes: Shapes, origins: Tensor, direction: Tensor) -> Tensor:
    """Return how far (N,) parallel rays from many origins go; see `first_hits`."""
    nearest = torch.full_like(origins[:, 0], torch.inf)
    solid = {list(KINDS).index(name) for name in ("box", "ellipsoid", "cylinder", "disc")}
    for index in range(len(shapes)):
        if int(shapes.kind[index]) not in solid:
            continue
        one = shapes[torch.tensor([index], device=origins.device)]
        turn = one.world_from_shape[0]
        local_o = ((origins - one.centre[0]) @ turn) / one.half_size[0]
        local_d = ((direction @ turn) / one.half_size[0]).expand_as(local_o)
        depth = list(KINDS.values())[int(one.kind)](local_o, local_d)
        nearest = torch.minimum(nearest, depth)
    return nearest


def rotation_about(axis: Tensor, angle: float) -> Tensor:
    """Return the (3, 3) rotation by `angle` radians about a unit axis (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], device=axis.device)
    identity = torch.eye(3, device=axis.device)
    return identity + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def turned(rotation: Tensor, place: Place) -> Place:
    """Return the place that a rotation carries `place` to."""
    x, y, z = (rotation @ torch.tensor(place)).tolist()
    return x, y, z


def assemble(things: list[Thing], table: Tensor, to_light: Tensor, *, shadows: bool) -> Scene:
    """Return the scene made of `things`, as arrays on the device of `table`."""
    device = table.device
    coats = [thing.coat for thing in things]

    def numbers(of: Sequence[object], name: str) -> Tensor:
        return torch.tensor([getattr(one, name) for one in of], device=device)

    shapes = Shapes(
        torch.tensor([list(KINDS).index(thing.kind) for thing in things], device=device),
        numbers(things, "centre"),
        torch.stack([thing.rotation.to(device) for thing in things]),
        numbers(things, "half_size"),
    )
    paints = Paint(
        torch.tensor([list(STYLES).index(coat.style) for coat in coats], device=device),
        torch.stack([coat.colours.to(device) for coat in coats]),
        *(
            numbers(coats, name)
            for name in ("frequency", "turn", "slope", "grain", "gloss", "offset")
        ),
    )
    return Scene(shapes, paints, to_light.to(device), shadows, table)
