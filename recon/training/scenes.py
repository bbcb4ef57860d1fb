"""Stereo pairs with exact truth, drawn by casting rays at procedural scenes.

What matters for matching is variety, not realism: the spread of baselines, texture on every
background, slanted and thin things, repetition (findings of Raistrick et al., WMGStereo, 2025).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from recon.training.composition import Scene, View
from recon.training.furnishing import compose
from recon.training.shapes import Hits, first_hits, surface_at
from recon.training.textures import paint

__all__ = ["StereoSample", "draw", "render"]

AMBIENT = 0.35
HIGHLIGHT_POWER = 24
VISIBLE_TOLERANCE = 2e-3
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
    """

    left: Tensor
    right: Tensor
    disparity_left: Tensor
    disparity_right: Tensor
    visible: Tensor


def _directions(view: View, offset: tuple[float, float], device: torch.device) -> Tensor:
    """Return (H W, 3) ray directions with z = 1 through the pixel centres plus `offset` px."""
    rows = torch.arange(view.height, device=device, dtype=torch.float32) + offset[1]
    columns = torch.arange(view.width, device=device, dtype=torch.float32) + offset[0]
    y, x = torch.meshgrid(rows - view.centre[1], columns - view.centre[0], indexing="ij")
    flat = torch.stack((x, y, torch.full_like(x, view.focal_px)), -1).reshape(-1, 3)
    return flat / view.focal_px


def _lit(scene: Scene, shadowed: Tensor, normal: Tensor, to_eye: Tensor, gloss: Tensor) -> Tensor:
    """Return diffuse factor and highlight of N places, (N, 2)."""
    towards = (normal * scene.to_light).sum(-1).clamp_min(0) * ~shadowed
    mirrored = 2 * (normal * scene.to_light).sum(-1, keepdim=True) * normal - scene.to_light
    highlight = (mirrored * to_eye).sum(-1).clamp_min(0) ** HIGHLIGHT_POWER * gloss * ~shadowed
    return torch.stack((AMBIENT + (1 - AMBIENT) * towards, highlight), -1)


def _colours(scene: Scene, view: View, origin: Tensor, directions: Tensor) -> Tensor:
    """Return the display colour (N, 3) that each ray sees."""
    hits = first_hits(scene.shapes, origin, directions)
    depth = hits.depth.clamp_max(INFINITY_M)
    surface = surface_at(scene.shapes, Hits(depth, hits.shape), origin, directions)
    of = scene.paints[hits.shape]
    to_eye = -torch.nn.functional.normalize(directions, dim=-1)
    slant = (surface.normal * to_eye).sum(-1).abs().clamp_min(0.15)
    albedo = paint(of, surface.uv, depth / (view.focal_px * slant), scene.table)
    lifted = surface.place + surface.normal * (1e-3 * depth[:, None])
    shadowed = scene.in_shadow(lifted)
    factors = _lit(scene, shadowed, surface.normal, to_eye, of.gloss)
    linear = albedo * factors[:, :1] + factors[:, 1:]
    return linear.clamp(0, 1) ** (1 / 2.2)


def _image(scene: Scene, view: View, origin: Tensor, samples: int) -> Tensor:
    """Draw one view, `samples` x `samples` rays a pixel: (H, W, 3)."""
    places = [(step + 0.5) / samples - 0.5 for step in range(samples)]
    total = torch.zeros(view.height * view.width, 3, device=origin.device)
    for down in places:
        for right in places:
            total += _colours(scene, view, origin, _directions(view, (right, down), origin.device))
    return (total / samples**2).reshape(view.height, view.width, 3)


def _disparity(scene: Scene, view: View, origin: Tensor) -> Tensor:
    """Return the exact disparity (H, W) of one view, d = f B / Z."""
    hits = first_hits(scene.shapes, origin, _directions(view, (0, 0), origin.device))
    return (view.focal_px * view.baseline_m / hits.depth).reshape(view.height, view.width)


def _visible(scene: Scene, view: View, disparity: Tensor, right: Tensor) -> Tensor:
    """Return which left pixels the right camera sees, by looking back at their points."""
    directions = _directions(view, (0, 0), right.device)
    depth = view.focal_px * view.baseline_m / disparity.reshape(-1, 1)
    back = directions - right / depth
    reached = first_hits(scene.shapes, right, back).depth
    seen = (reached - depth[:, 0]).abs() < VISIBLE_TOLERANCE * depth[:, 0]
    column = torch.arange(view.width, device=right.device) - disparity
    return seen.reshape(disparity.shape) & (column >= 0)


def render(scene: Scene, view: View, *, samples: int = 2) -> StereoSample:
    """Draw a scene for both cameras.

    Args:
        scene: what stands where.
        view: size, focal length and baseline.
        samples: rays a pixel along each axis; more is smoother.
    """
    device = scene.table.device
    left = torch.zeros(3, device=device)
    right = torch.tensor([view.baseline_m, 0.0, 0.0], device=device)
    disparity = _disparity(scene, view, left)
    return StereoSample(
        _image(scene, view, left, samples),
        _image(scene, view, right, samples),
        disparity,
        _disparity(scene, view, right),
        _visible(scene, view, disparity, right),
    )


def draw(generator: torch.Generator, size: tuple[int, int], *, samples: int = 2) -> StereoSample:
    """Compose a random scene and draw it.

    Args:
        generator: source of all randomness; its device is where the pair is drawn.
        size: (width, height) in pixels.
        samples: see `render`.
    """
    scene, view = compose(generator, size)
    return render(scene, view, samples=samples)
