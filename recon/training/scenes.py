"""Stereo pairs with exact truth, drawn by casting rays at procedural scenes.

What matters for matching is variety, not realism: the spread of baselines, texture on every
background, slanted and thin things, repetition (findings of Raistrick et al., WMGStereo, 2025).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.casting import Camera, Hits, Rays, first_hits, surface_at, windows
from recon.training.composition import Scene, View
from recon.training.lighting import light_directions, lit, shadows
from recon.training.recipe import FULL, Recipe
from recon.training.scenery import compose
from recon.training.shapes import dot
from recon.training.textures import paint

__all__ = ["StereoSample", "draw", "render"]

VISIBLE_TOLERANCE = 2e-3
EDGE_JUMP_PX = 1.0
INFINITY_M = 1e6


@dataclass(frozen=True, eq=False)
class StereoSample:
    """A rectified pair with its truth.

    Attributes:
        left: (H, W, 3) float32 in [0, 1], display RGB.
        right: (H, W, 3) float32, the same.
        disparity_left: (H, W) float32 px, of the left view, exact.
        disparity_right: (H, W) float32 px, of the right view, exact.
        visible: (H, W) bool, left pixels whose point the right camera sees inside its image.
        visible_right: (H, W) bool, right pixels whose point the left camera sees inside its image.
        normals: (H, W, 3) float32 unit, of the left view, towards the camera, in its frame.
        edges: (H, W) bool, left pixels that have a neighbour on another surface, more than
            `EDGE_JUMP_PX` nearer or further.
    """

    left: Tensor
    right: Tensor
    disparity_left: Tensor
    disparity_right: Tensor
    visible: Tensor
    visible_right: Tensor
    normals: Tensor
    edges: Tensor


@dataclass(frozen=True, eq=False)
class _Seen:
    """What one camera sees.

    Attributes:
        image: (H, W, 3).
        rays: through the pixel centres, S = 1.
        hits: of these rays.
    """

    image: Tensor
    rays: Rays
    hits: Hits


def _offsets(samples: int) -> list[tuple[float, float]]:
    """Return the places in a pixel that are looked through; the last one is its centre."""
    steps = [(step + 0.5) / samples - 0.5 for step in range(samples)]
    places = [(right, down) for down in steps for right in steps]
    return [place for place in places if place != (0.0, 0.0)] + [(0.0, 0.0)]


def _colours(scene: Scene, camera: Camera, rays: Rays, hits: Hits, towards: Tensor) -> Tensor:
    """Return the display colours (3, S, H, W) that S images of rays see.

    Args:
        scene: what they look at.
        camera: whose rays they are.
        rays: S images.
        hits: of the rays.
        towards: (S, 3) to the light, for each image.
    """
    met, depth = hits.shape.flatten(), hits.depth.clamp_max(INFINITY_M)
    direction = rays.direction.flatten(1)
    surface = surface_at(scene.shapes, met, rays.at(depth).flatten(1), direction)
    of = scene.paints[met]
    to_eye = -direction / dot(direction, direction).sqrt()
    slant = dot(surface.normal, to_eye).abs().clamp_min(0.15)
    footprint = depth.flatten() / (camera.focal_px * slant)
    albedo = paint(of, surface.uv, footprint, scene.table)
    shadowed = torch.zeros_like(met, dtype=torch.bool)
    if scene.light.casts_shadows:
        found = shadows(scene.shapes, camera, Hits(depth, hits.shape), surface, towards)
        shadowed = found.flatten()
    bright, highlight = lit(scene.light, surface, shadowed, to_eye, of.gloss)
    linear = albedo * bright + highlight
    return (linear.clamp(0, 1) ** (1 / 2.2)).reshape(3, *hits.depth.shape)


def _look(scene: Scene, camera: Camera, samples: int) -> _Seen:
    """Draw one view, `samples` x `samples` rays a pixel."""
    offsets = _offsets(samples)
    rays = camera.rays(offsets, scene.table.device)
    hits = first_hits(scene.shapes, rays, windows(scene.shapes.corners(), camera))
    towards = light_directions(scene.light, samples**2)
    total = torch.zeros_like(rays.direction[:, 0])
    for number in range(samples**2):
        one = slice(number, number + 1)
        through = Rays(rays.origin, rays.direction[:, one])
        seen = Hits(hits.depth[one], hits.shape[one])
        total += _colours(scene, camera, through, seen, towards[one])[:, 0]
    centre = Rays(rays.origin, rays.direction[:, -1:])
    image = (total / samples**2).permute(1, 2, 0).contiguous()
    return _Seen(image, centre, Hits(hits.depth[-1:], hits.shape[-1:]))


def _visible(scene: Scene, view: View, seen: _Seen, other: Camera) -> Tensor:
    """Return which pixels (H, W) another camera sees, by looking back at their points."""
    depth = seen.hits.depth
    there = other.place(depth.device)[:, None, None, None]
    back = Rays(there, seen.rays.direction + (seen.rays.origin - there) / depth)
    # The point of column x is at x - shift in the other image.
    shift = view.focal_px * (other.x_m - seen.rays.origin[0]) / depth
    slack = float(shift.amin()), float(shift.amax())
    reached = first_hits(scene.shapes, back, windows(scene.shapes.corners(), other, slack)).depth
    agrees = (reached - depth).abs() < VISIBLE_TOLERANCE * depth
    column = torch.arange(view.width, device=depth.device) - shift
    return (agrees & (column >= 0) & (column <= view.width - 1))[0]


def _edges(disparity: Tensor, shape: Tensor) -> Tensor:
    """Return pixels (H, W) beside a jump of disparity between two surfaces.

    Args:
        disparity: (H, W) px.
        shape: (H, W) int64, the surface that each pixel lies on.
    """
    edges = torch.zeros_like(shape, dtype=torch.bool)
    for axis in (0, 1):
        jump = (disparity.diff(dim=axis).abs() > EDGE_JUMP_PX) & (shape.diff(dim=axis) != 0)
        size = jump.shape[axis]
        edges.narrow(axis, 0, size).logical_or_(jump)
        edges.narrow(axis, 1, size).logical_or_(jump)
    return edges


def _normals(scene: Scene, seen: _Seen) -> Tensor:
    """Return the unit normals (H, W, 3) of what the pixel centres see, towards the camera."""
    depth = seen.hits.depth.clamp_max(INFINITY_M)
    direction = seen.rays.direction.flatten(1)
    place = seen.rays.at(depth).flatten(1)
    normal = surface_at(scene.shapes, seen.hits.shape.flatten(), place, direction).normal
    return normal.T.reshape(*depth.shape[1:], 3).contiguous()


def render(scene: Scene, view: View, *, samples: int = 2) -> StereoSample:
    """Draw a scene for both cameras.

    Args:
        scene: what stands where.
        view: size, focal length and baseline.
        samples: rays a pixel along each axis; more is smoother.
    """
    size = (view.width, view.height, view.focal_px)
    cameras = Camera(*size), Camera(*size, view.baseline_m)
    left, right = (_look(scene, camera, samples) for camera in cameras)
    # d = f B / Z
    of_left, of_right = (
        view.focal_px * view.baseline_m / seen.hits.depth[0] for seen in (left, right)
    )
    return StereoSample(
        left=left.image,
        right=right.image,
        disparity_left=of_left,
        disparity_right=of_right,
        visible=_visible(scene, view, left, cameras[1]),
        visible_right=_visible(scene, view, right, cameras[0]),
        normals=_normals(scene, left),
        edges=_edges(of_left, left.hits.shape[0]),
    )


def draw(
    generator: torch.Generator,
    size: tuple[int, int],
    *,
    samples: int = 2,
    recipe: Recipe = FULL,
) -> StereoSample:
    """Compose a random scene and draw it.

    Args:
        generator: source of all randomness; its device is where the pair is drawn.
        size: (width, height) in pixels.
        samples: see `render`.
        recipe: what scenes may be made of; everything by default.
    """
    scene, view = compose(generator, size, recipe)
    return render(scene, view, samples=samples)
