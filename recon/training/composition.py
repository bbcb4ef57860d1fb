"""What a scene is made of: things with paint, a light, and the cameras that look."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.shapes import KINDS, Shapes
from recon.training.textures import STYLES, Paint

__all__ = [
    "Coat",
    "Light",
    "Place",
    "Scene",
    "Thing",
    "View",
    "assemble",
    "rotation_about",
    "turned",
]

Place = tuple[float, float, float]

NO_MAP = torch.zeros(2, 2)


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
    """One shape and its paint; see `Shapes`. `map` (S, S) is that of a relief or a cutout."""

    kind: str
    centre: Place
    half_size: Place
    rotation: Tensor
    coat: Coat
    map: Tensor | None = None


@dataclass(frozen=True, eq=False)
class Light:
    """A distant light, the glow of everything around, and perhaps a lamp.

    Attributes:
        towards: (3,) unit vector to the distant light.
        casts_shadows: whether things block it.
        spread: half the angle that it covers, radians; more is softer shadows.
        ambient: share of the light that comes from all around, in [0, 1].
        sharpness: power of the highlight; more is smaller.
        lamp: (3,) metres, where the lamp hangs.
        lamp_strength: how bright it is at `lamp_reach_m`; 0 is off.
        lamp_reach_m: distance where its light has fallen to half of what it is close by.
    """

    towards: Tensor
    casts_shadows: bool = False
    spread: float = 0.0
    ambient: float = 0.35
    sharpness: float = 24.0
    lamp: Place = (0.0, 0.0, 0.0)
    lamp_strength: float = 0.0
    lamp_reach_m: float = 1.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes, paint and light.

    Attributes:
        shapes: K shapes in the frame of the left camera.
        paints: of the same K.
        light: what shines on them.
        table: noise, see `noise_table`.
    """

    shapes: Shapes
    paints: Paint
    light: Light
    table: Tensor


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


def _stacked(maps: list[Tensor | None]) -> tuple[list[int], Tensor]:
    """Return which map each thing has, and the maps (M, S, S), each of them once."""
    given = [found for found in maps if found is not None]
    distinct = list({id(found): found for found in given}.values()) or [NO_MAP]
    order = {id(found): number for number, found in enumerate(distinct)}
    return [order.get(id(found), 0) for found in maps], torch.stack(distinct)


def assemble(things: list[Thing], table: Tensor, to_light: Tensor, *, shadows: bool) -> Scene:
    """Return the scene made of `things`, as arrays on the device of `table`."""
    device = table.device
    coats = [thing.coat for thing in things]

    def numbers(of: Sequence[object], name: str) -> Tensor:
        return torch.tensor([getattr(one, name) for one in of], device=device)

    map_of, maps = _stacked([thing.map for thing in things])
    shapes = Shapes(
        torch.tensor([KINDS.index(thing.kind) for thing in things], device=device),
        numbers(things, "centre"),
        torch.stack([thing.rotation for thing in things]).to(device),
        numbers(things, "half_size"),
        torch.tensor(map_of, device=device),
        maps.to(device),
    )
    paints = Paint(
        torch.tensor([list(STYLES).index(coat.style) for coat in coats], device=device),
        torch.stack([coat.colours for coat in coats]).to(device),
        *(
            numbers(coats, name)
            for name in ("frequency", "turn", "slope", "grain", "gloss", "offset")
        ),
    )
    return Scene(shapes, paints, Light(to_light.to(device), shadows), table)
