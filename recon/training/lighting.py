"""How bright a surface is: diffuse light, soft shadows and highlights that follow the eye."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from recon.training.casting import Camera, Hits, Rays, Surface, first_hits, windows
from recon.training.composition import Light
from recon.training.shapes import KINDS, Shapes, dot

__all__ = ["light_directions", "lit", "shadows"]

CASTING = ("box", "ellipsoid", "cylinder", "disc", "tube", "cutout")
FURTHEST_M = 30.0
LIFT = 1e-3  # of the depth: a place must not shade itself


def light_directions(light: Light, count: int) -> Tensor:
    """Return unit vectors (count, 3) to places spread over the light, on a spiral."""
    towards = light.towards
    aside = torch.linalg.cross(towards, torch.tensor([0.6, 0.0, 0.8], device=towards.device))
    aside = torch.nn.functional.normalize(aside, dim=0)
    up = torch.linalg.cross(towards, aside)
    places = []
    for number in range(count):
        radius = math.tan(light.spread) * math.sqrt(number / count)
        turn = 2.4 * number  # the golden angle: places far from each other
        offset = radius * (math.cos(turn) * aside + math.sin(turn) * up)
        places.append(torch.nn.functional.normalize(towards + offset, dim=0))
    return torch.stack(places)


def _swept(casters: Shapes, places: Tensor, towards: Tensor) -> Tensor:
    """Return the corners (K, 16 S.., 3) of what the shadows of K shapes fill, down to the places.

    Args:
        casters: K shapes.
        places: (3, ...) metres, where shadows may fall.
        towards: (S, 3) to the light.
    """
    corners = casters.corners()  # (K, 8, 3)
    low, high = places.flatten(1).amin(1), places.flatten(1).amax(1)
    along = (corners[:, :, None] * towards).sum(-1)  # (K, 8, S)
    lowest = torch.minimum(low * towards, high * towards).sum(1)  # (S,)
    reach = (along.amax(1) - lowest).clamp(0, FURTHEST_M)  # (K, S)
    moved = corners[:, None] - (reach[..., None] * towards)[:, :, None]  # (K, S, 8, 3)
    return torch.cat((corners, moved.flatten(1, 2)), 1)


def shadows(
    shapes: Shapes, camera: Camera, hits: Hits, surface: Surface, towards: Tensor
) -> Tensor:
    """Return which places the light does not reach, (S, H, W).

    Args:
        shapes: all that there are.
        camera: whose pixels the places are seen in.
        hits: of S images of rays.
        surface: at the hits.
        towards: (S, 3) unit vectors, where the light is for each image.
    """
    casting = torch.tensor([name in CASTING for name in KINDS], device=shapes.kind.device)
    casters = shapes.chosen(torch.nonzero(casting[shapes.kind])[:, 0])
    lifted = surface.place + surface.normal * (LIFT * hits.depth.flatten())
    lifted = lifted.reshape(3, *hits.depth.shape)
    rays = Rays(lifted, towards.T[:, :, None, None].expand_as(lifted))
    within = windows(_swept(casters, lifted, towards), camera)
    return first_hits(casters, rays, within).depth < FURTHEST_M


def lit(
    light: Light, surface: Surface, shadowed: Tensor, to_eye: Tensor, gloss: Tensor
) -> tuple[Tensor, Tensor]:
    """Return by how much the colour of N places is multiplied, and the highlight to add.

    Args:
        light: what shines.
        surface: at the places.
        shadowed: (N,) bool.
        to_eye: (3, N) unit vectors.
        gloss: (N,) strength of the highlight.
    """
    towards = light.towards[:, None]
    cosine = dot(surface.normal, towards)
    direct = cosine.clamp_min(0) * ~shadowed
    mirrored = 2 * cosine * surface.normal - towards
    highlight = dot(mirrored, to_eye).clamp_min(0) ** light.sharpness * gloss * ~shadowed
    bright = light.ambient + (1 - light.ambient) * direct
    return bright + _lamp(light, surface), highlight


def _lamp(light: Light, surface: Surface) -> Tensor:
    """Return what the lamp adds to N places: less with distance, and where they face away."""
    if not light.lamp_strength:
        return torch.zeros_like(surface.place[0])
    ray = torch.tensor(light.lamp, device=surface.place.device)[:, None] - surface.place
    distance = dot(ray, ray).sqrt().clamp_min(1e-3)
    facing = (dot(surface.normal, ray) / distance).clamp_min(0)
    return light.lamp_strength * facing / (1 + (distance / light.lamp_reach_m) ** 2)
