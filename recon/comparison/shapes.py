"""What can be compared: results, clouds, meshes and truths, brought to one form."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from recon.evaluation.layouts import find_scenes, read_scene
from recon.files import CLOUD_FORMATS, read_cloud
from recon.files.foreign import FOREIGN_ENDINGS, read_foreign
from recon.triangulation import depth_map, triangulate
from recon.types import Array, DisparityMap, PixelStatus, PointCloud

__all__ = ["Shape", "read_shape"]

IN_A_FOLDER = ("cloud.ply", "cloud.npz", "cloud.laz", "cloud.las", "mesh.glb")
"""What stands for the folder of a result: the first of these that is there."""

SAMPLES = 200_000
"""Points on the faces of a mesh that speak for it."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Points, and the surface between them if it is known.

    Attributes:
        name: for people.
        points: (N, 3) float32 metres, finite; in the frame of a camera, or in any frame.
        colours: (N, 3) uint8 RGB, or None.
        sigma_m: (N,) float32 standard deviation of the depth of each point, or None.
        asked: (N,) bool, which points ask for the other side: in a truth, those that both
            cameras see.
        vertices: (V, 3) float32 of a mesh, or None for a cloud.
        faces: (F, 3) int32 of a mesh, or None for a cloud.
    """

    name: str
    points: Array
    colours: Array | None
    sigma_m: Array | None
    asked: Array
    vertices: Array | None = None
    faces: Array | None = None

    def moved(self, pose: Array) -> Shape:
        """Return the shape in another frame.

        Args:
            pose: (4, 4), new from old.
        """

        def carried(points: Array) -> Array:
            return np.asarray(points @ pose[:3, :3].T + pose[:3, 3], np.float32)

        vertices = None if self.vertices is None else carried(self.vertices)
        return replace(self, points=carried(self.points), vertices=vertices)


def read_shape(path: Path) -> Shape:
    """Read whatever a path stands for.

    Args:
        path: a folder of results, a scene with true disparities, a cloud or a mesh.

    Raises:
        FileNotFoundError: if there is nothing of this name.
        ValueError: if it is none of these, or holds no point.
    """
    if not path.exists():
        raise FileNotFoundError(f"there is no file or folder {path}")
    if path.is_dir():
        present = [path / name for name in IN_A_FOLDER if (path / name).exists()]
        shape = _of_file(present[0]) if present else _of_truth(path)
    else:
        shape = _of_file(path)
    if not len(shape.points):
        raise ValueError(f"{path} holds no points; there is nothing to compare")
    return shape


def _of_file(path: Path) -> Shape:
    """Read a cloud or mesh."""
    ending = path.suffix.lower()
    if ending in CLOUD_FORMATS:
        try:
            return _of_cloud(read_cloud(path), str(path))
        except ValueError:
            if ending not in FOREIGN_ENDINGS:
                raise
    if ending not in FOREIGN_ENDINGS:
        known = sorted({*CLOUD_FORMATS, *FOREIGN_ENDINGS})
        raise ValueError(f"{path} is of no format that can be compared: {', '.join(known)}")
    points, faces, colours = read_foreign(path)
    if not len(faces):
        return Shape(str(path), points, colours, None, np.ones(len(points), bool))
    samples = _samples(points, faces)
    return Shape(str(path), samples, None, None, np.ones(len(samples), bool), points, faces)


def _of_cloud(cloud: PointCloud, name: str) -> Shape:
    everywhere = np.ones(len(cloud), bool)
    return Shape(name, cloud.points, cloud.colours, cloud.depth_sigma_m, everywhere)


def _of_truth(folder: Path) -> Shape:
    """Read the true disparities of one scene, and place them in space."""
    try:
        found = find_scenes(folder)
    except ValueError as error:
        raise ValueError(
            f"{folder} holds no result ({', '.join(IN_A_FOLDER)}) and no pair with truth: {error}"
        ) from error
    if len(found) > 1:
        names = ", ".join(files.name for files in found[:8])
        raise ValueError(f"{folder} holds {len(found)} scenes; give one of them: {names}")
    scene = read_scene(found[0])
    values = scene.truth.disparity
    if not scene.calibrated:
        raise ValueError(f"the truth in {folder} is of a pair without calibration: no metres")
    if values.shape != scene.pair.left.shape[:2]:
        raise ValueError(
            f"the truth in {folder} is {values.shape} but the pair {scene.pair.left.shape[:2]} "
            "(rows, columns); only a truth of the same size can be placed in space"
        )
    known = np.isfinite(values)
    status = np.where(known, PixelStatus.MATCHED, PixelStatus.OUTSIDE).astype(np.uint8)
    values = np.where(known, values, np.nan).astype(np.float32)
    disparity: DisparityMap[Array] = DisparityMap(values, status, known.astype(np.float32))
    cloud = triangulate(disparity, scene.pair)
    seen = np.ones(values.shape, bool) if scene.truth.visible is None else scene.truth.visible
    placed = np.isfinite(depth_map(disparity, scene.pair.geometry))
    return replace(_of_cloud(cloud, f"truth of {folder}"), sigma_m=None, asked=seen[placed])


def _samples(vertices: Array, faces: Array) -> Array:
    """Return points spread evenly over the faces, always the same ones.

    Source: Osada et al., Shape Distributions, ACM TOG 21(4), 2002, section 4.2.
    """
    random = np.random.default_rng(0)
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not areas.sum() > 0:
        return vertices
    chosen = random.choice(len(faces), SAMPLES, p=areas / areas.sum())
    r, s = np.sqrt(random.random((SAMPLES, 1))), random.random((SAMPLES, 1))
    points = (1 - r) * a[chosen] + r * (1 - s) * b[chosen] + r * s * c[chosen]
    return np.asarray(points, np.float32)
