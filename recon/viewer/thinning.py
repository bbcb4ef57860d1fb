"""Making results small enough to look at: fewer pixels, points and faces, regularly chosen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from torch import Tensor

from calib.pair import RectifiedPair
from recon.fusion import FusedSurface
from recon.types import Array, Mesh, PointCloud

__all__ = [
    "Limits",
    "as_numpy",
    "clustered_surface",
    "left_out",
    "thinned_image",
    "thinned_mesh",
    "thinned_photograph",
    "thinned_points",
    "thinning_step",
]

CLUSTER_GROWTH = 1.1


@dataclass(frozen=True)
class Limits:
    """How much of a result is drawn; raising a limit shows more and makes recordings larger.

    Attributes:
        max_points: of a point cloud.
        max_faces: of a mesh.
        max_pixels: of an image.
        jpeg_quality: of images, from 1 to 100.
        disparity_span: the disparities of the first and the last colour, in pixels; those of the
            map itself if not given.
    """

    max_points: int = 300_000
    max_faces: int = 200_000
    max_pixels: int = 2_000_000
    jpeg_quality: int = 85
    disparity_span: tuple[float, float] | None = None


def as_numpy(values: Tensor | Array) -> Array:
    """Return values in host memory, wherever they are."""
    return values.detach().cpu().numpy() if isinstance(values, Tensor) else np.asarray(values)


def thinned_image(image: Array, max_pixels: int) -> Array:
    """Return every n-th pixel of every n-th row, with the least n that leaves few enough.

    Args:
        image: (H, W) or (H, W, C).
        max_pixels: how many may remain.
    """
    step = thinning_step(image.shape[1], image.shape[0], max_pixels)
    return image[::step, ::step]


def thinned_photograph(image: Array, max_pixels: int) -> Array:
    """Return the pixels of `thinned_image`, each the mean of those around it.

    Args:
        image: (H, W, 3) uint8.
        max_pixels: how many may remain.
    """
    step = thinning_step(image.shape[1], image.shape[0], max_pixels)
    return thinned_image(cv2.blur(image, (step, step)), max_pixels) if step > 1 else image


def thinning_step(width: int, height: int, max_pixels: int) -> int:
    """Return the n of "every n-th pixel of every n-th row" that leaves few enough.

    Args:
        width: of an image, pixels.
        height: of an image, pixels.
        max_pixels: how many may remain.
    """
    return math.ceil(math.sqrt(max(1.0, width * height / max_pixels)))


def thinned_points(cloud: PointCloud, max_points: int) -> PointCloud:
    """Return points at regular places in the order of the cloud, or the cloud if it is small.

    Args:
        cloud: N points.
        max_points: how many may remain.
    """
    if len(cloud) <= max_points:
        return cloud
    chosen = np.linspace(0, len(cloud) - 1, max_points).astype(np.intp)
    return cloud.chosen(chosen)


def thinned_mesh(mesh: Mesh, max_faces: int) -> Mesh:
    """Return a coarser mesh of the same surfaces, or the mesh if it is small.

    The vertices of a mesh made from one view lie on its grid of pixels. Squares of n x n pixels
    that are whole become one square; the others vanish, so that no edge is bridged, and holes
    grow by less than n pixels. A mesh without such a grid is returned as it is.

    Args:
        mesh: F faces.
        max_faces: how many may remain.
    """
    step = math.ceil(math.sqrt(len(mesh.faces) / max_faces))
    if step <= 1 or mesh.uv is None or mesh.texture is None:
        return mesh
    height, width = mesh.texture.shape[:2]
    pixels = np.rint(mesh.uv * (width, height) - 0.5).astype(np.intp)  # (V, 2) as x, y
    vertex_of = np.full((height, width), -1, dtype=np.int32)
    vertex_of[pixels[:, 1].clip(0, height - 1), pixels[:, 0].clip(0, width - 1)] = np.arange(
        len(pixels)
    )
    decimated = np.ptp(pixels[mesh.faces], axis=1).max() > 1
    if decimated or (vertex_of >= 0).sum() < len(pixels):
        return mesh

    corner_x, corner_y = pixels[mesh.faces].min(axis=1).T
    halves = np.bincount(corner_y * width + corner_x, minlength=height * width)
    whole = (halves == 2).reshape(height, width)
    rows, columns = (height - 1) // step, (width - 1) // step
    blocks = whole[: rows * step, : columns * step].reshape(rows, step, columns, step)
    y, x = np.nonzero(blocks.all(axis=(1, 3)))
    a, b, c, d = (
        vertex_of[(y + down) * step, (x + right) * step]
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1))
    )
    corners = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    used, faces = np.unique(corners, return_inverse=True)
    return Mesh(
        vertices=mesh.vertices[used],
        faces=faces.reshape(-1, 3).astype(np.int32),
        uv=mesh.uv[used],
        texture=mesh.texture,
        colours=mesh.colours[used],
        normals=mesh.normals[used],
    )


def clustered_surface(surface: FusedSurface, max_faces: int) -> FusedSurface:
    """Return a coarser surface, or the surface if it is small.

    The vertices in a cube become one, their mean; what collapses vanishes. A surface of area A
    has about 2 A / c^2 faces in cubes of side c; they are widened until few enough remain.

    Source: Rossignac & Borrel, Modeling in Computer Graphics 1993 (vertex clustering).

    Args:
        surface: F faces.
        max_faces: how many may remain.
    """
    corners = surface.vertices[surface.faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = float(np.linalg.norm(normals, axis=1).sum()) / 2
    side_m, coarser = math.sqrt(2 * area / max_faces), surface
    while len(coarser.faces) > max_faces:
        coarser, side_m = _clustered(surface, side_m), CLUSTER_GROWTH * side_m
    return coarser


def _clustered(surface: FusedSurface, side_m: float) -> FusedSurface:
    """Return a surface with one vertex for every cube that holds some."""
    cubes = np.floor(surface.vertices / side_m).astype(np.int64)
    _, cluster, count = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
    cluster = cluster.reshape(-1)

    def mean(values: Array) -> Array:
        columns = values.reshape(len(values), -1).astype(np.float64).T
        sums = np.stack([np.bincount(cluster, column) for column in columns], axis=-1)
        means: Array = (sums / count[:, None]).reshape(-1, *values.shape[1:])
        return means.astype(values.dtype)

    faces = cluster[surface.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    normals = mean(surface.normals)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return FusedSurface(
        mean(surface.vertices),
        np.unique(faces[whole], axis=0).astype(np.int32),
        normals / np.maximum(length, 1e-9),
        mean(surface.colours),
        mean(surface.sigma_m),
        mean(surface.views),
        mean(surface.trust),
    )


def left_out(result: object, limits: Limits) -> list[str]:
    """Say what of a result is not drawn, if anything.

    Args:
        result: what a stage made.
        limits: how much of it is drawn.
    """
    files = "the files have all of them"
    if isinstance(result, PointCloud) and len(result) > limits.max_points:
        return [f"{limits.max_points:,} of {len(result):,} points are shown; {files}"]
    if isinstance(result, Mesh):
        shown, count = len(thinned_mesh(result, limits.max_faces).faces), len(result.faces)
        return [f"{shown:,} of {count:,} triangles are shown; {files}"] if shown < count else []
    if isinstance(result, RectifiedPair):
        step = thinning_step(*result.geometry.size, limits.max_pixels)
        less = [f"every {step}. pixel of every {step}. row is shown"] if step > 1 else []
        return [*less, f"pictures are JPEG of quality {limits.jpeg_quality}"]
    return []
