"""Clouds and meshes that other programs wrote, as far as positions and colours go."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from recon.types import Array

__all__ = ["FOREIGN_ENDINGS", "read_foreign"]

FOREIGN_ENDINGS = (".ply", ".glb", ".gltf", ".obj", ".stl", ".off")
Y_UP_ENDINGS = (".glb", ".gltf")


def read_foreign(path: str | os.PathLike[str]) -> tuple[Array, Array, Array | None]:
    """Read positions, faces and colours of any file that trimesh reads.

    Files of glTF have y up and are turned back into the axes of the camera: (x, -y, -z). Those of
    other formats are taken as they are.

    Args:
        path: ends in one of `FOREIGN_ENDINGS`.

    Returns:
        points: (N, 3) float32.
        faces: (F, 3) int32; F is 0 for a cloud.
        colours: (N, 3) uint8 RGB, or None if the file has none at its points.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if trimesh cannot read it, or finds no points in it.
    """
    import trimesh

    if not Path(path).exists():
        raise FileNotFoundError(f"there is no file {path}")
    try:
        scene = trimesh.load_scene(Path(path), process=False)
        parts: list[Any] = scene.dump() if len(scene.geometry) else []
    except Exception as error:  # its readers raise whatever comes
        raise ValueError(f"{path} cannot be read as a cloud or mesh: {error}") from error
    parts = [part for part in parts if len(getattr(part, "vertices", ()))]
    if not parts:
        raise ValueError(f"{path} holds no points; expected a cloud or a mesh")
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    points = np.concatenate([np.asarray(part.vertices) for part in parts]).astype(np.float32)
    if not np.isfinite(points).all():
        raise ValueError(f"{path} holds points that are not finite")
    faces = [
        np.asarray(part.faces) + start
        for part, start in zip(parts, starts, strict=False)
        if hasattr(part, "faces")
    ]
    if Path(path).suffix.lower() in Y_UP_ENDINGS:
        points *= np.array((1, -1, -1), np.float32)
    empty = np.zeros((0, 3), np.int32)
    return points, np.concatenate([empty, *faces]).astype(np.int32), _colours(parts)


def _colours(parts: list[Any]) -> Array | None:
    """Return the colours at the points, if every part has its own."""
    found = []
    for part in parts:
        colours = getattr(part, "colors", None)
        if colours is None and part.visual.kind == "vertex":
            colours = part.visual.vertex_colors
        if colours is None or len(colours) != len(part.vertices):
            return None
        found.append(np.asarray(colours)[:, :3].astype(np.uint8))
    return np.concatenate(found)
