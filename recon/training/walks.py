"""A generated scene seen from several places, and how far points are from its surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from calib.pose import Pose
from recon.training.casting import Rays, first_hits, surface_at
from recon.training.composition import Scene
from recon.types import Array

__all__ = ["off_surface", "seen_from"]


def seen_from(scene: Scene, world_from_camera: Pose) -> Scene:
    """Return a scene as a camera sees it that was moved: the things are moved the other way.

    The paint stays on its things, so pictures from several places show one world.

    Args:
        scene: in the world frame.
        world_from_camera: where the left camera is to stand.
    """
    pose = world_from_camera.inverse()
    turn = torch.as_tensor(pose.R, dtype=torch.float32, device=scene.table.device)
    shift = torch.as_tensor(pose.t, dtype=torch.float32, device=scene.table.device)
    shapes, light = scene.shapes, scene.light
    lamp = (pose.R @ np.array(light.lamp) + pose.t).tolist()
    return replace(
        scene,
        shapes=replace(
            shapes,
            centre=shapes.centre @ turn.T + shift,
            world_from_shape=turn @ shapes.world_from_shape,
        ),
        light=replace(light, towards=turn @ light.towards, lamp=tuple(lamp)),
    )


def off_surface(scene: Scene, points: Array) -> Array:
    """Return how far points lie from the surface that the left camera sees behind or before them.

    The ray through a point p = z r meets the surface at Z r, where it has the unit normal n; the
    distance of p from the tangent plane there is |(z - Z) n . r|.

    Args:
        scene: in the frame of the left camera.
        points: (N, 3) metres in the same frame, z > 0.

    Returns:
        (N,) float64 metres; inf where the ray meets nothing.
    """
    places = torch.as_tensor(points, dtype=torch.float32, device=scene.table.device)
    direction = (places / places[:, 2:]).T  # (3, N), z = 1
    rays = Rays(torch.zeros(3, 1, 1, 1), direction[:, None, None, :])
    hits = first_hits(scene.shapes, rays)
    depth, met = hits.depth[0, 0], hits.shape[0, 0]
    known = depth.clamp_max(1e6)
    normal = surface_at(scene.shapes, met, direction * known, direction).normal
    off = ((places[:, 2] - depth) * (normal * direction).sum(0)).abs()
    return off.double().cpu().numpy()
