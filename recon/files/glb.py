"""Meshes as binary glTF, for web viewers, Blender and the like."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import trimesh as typed_in_part
from PIL import Image as Pictures

from recon.files.writing import atomic
from recon.types import Array, Mesh

trimesh: Any = typed_in_part

__all__ = ["GLTF_FROM_CAMERA", "linear_from_srgb", "write_glb"]

GLTF_FROM_CAMERA = (1.0, -1.0, -1.0)
"""x right, y down, z forward becomes x right, y up, z towards the viewer: half a turn about x."""

UNLIT = "KHR_materials_unlit"
LINEAR_COLOUR = "_linear_colour"
VERTICES, INDICES = 34962, 34963
"""ARRAY_BUFFER and ELEMENT_ARRAY_BUFFER, as glTF calls them."""


def write_glb(path: str | os.PathLike[str], mesh: Mesh, *, vertex_colours: bool = False) -> None:
    """Write a textured mesh in metres, y up and z towards the viewer (GLTF_FROM_CAMERA).

    The flip of two axes is a rotation, so triangles keep their sense. The material is unlit where
    a viewer knows how (photographs bring their light along), dull and double-sided elsewhere.

    Args:
        path: of the file to write.
        mesh: in the frame of the left rectified camera.
        vertex_colours: write the colours of the vertices in place of the texture, for programs
            that show no textures; so it is with a mesh that has none. glTF wants them linear, so
            they are converted from sRGB, and with 16 bits a channel, as 8 would show steps in
            dark parts.

    Raises:
        ValueError: if the mesh has no faces.
    """
    if not len(mesh.faces):
        raise ValueError("mesh has no faces, so there is nothing to write; is everything filtered?")
    in_gltf = trimesh.Trimesh(
        vertices=mesh.vertices * np.array(GLTF_FROM_CAMERA, np.float32),
        faces=mesh.faces,
        vertex_normals=mesh.normals * np.array(GLTF_FROM_CAMERA, np.float32),
        visual=_textured(None if vertex_colours else mesh.texture, mesh.uv),
        process=False,
    )
    if vertex_colours or mesh.texture is None:
        in_gltf.vertex_attributes[LINEAR_COLOUR] = _linear_sixteen_bits(mesh.colours)
    contents = trimesh.exchange.gltf.export_glb(
        in_gltf, include_normals=True, tree_postprocessor=_finish
    )
    with atomic(path) as partial:
        partial.write_bytes(contents)


def _textured(texture: Array | None, uv: Array | None) -> Any:  # noqa: ANN401  not typed
    """Return a dull double-sided material, with a texture (H, W, 3) if there is one."""
    material = trimesh.visual.material.PBRMaterial(
        name="left_image" if texture is not None else "vertex_colours",
        baseColorTexture=None if texture is None else Pictures.fromarray(texture),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )
    if texture is None or uv is None:
        return trimesh.visual.TextureVisuals(uv=None, material=material)
    from_bottom = np.array([0, 1], np.float32) + uv * np.array([1, -1], np.float32)
    return trimesh.visual.TextureVisuals(uv=from_bottom, material=material)


def linear_from_srgb(colours: Array) -> Array:
    """Undo the transfer curve of sRGB.

    Source: IEC 61966-2-1, 1999.

    Args:
        colours: any shape, uint8.

    Returns:
        The same shape, float64, proportional to light, in [0, 1].
    """
    encoded = np.asarray(colours) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def _linear_sixteen_bits(colours: Array) -> Array:
    """Return (V, 4) uint16 linear RGBA of (V, 3) uint8 sRGB."""
    table = np.rint(linear_from_srgb(np.arange(256, dtype=np.uint8)) * 65535).astype(np.uint16)
    opaque = np.full((len(colours), 1), 65535, np.uint16)
    return np.concatenate([table[colours], opaque], axis=1)


def _finish(tree: dict[str, Any]) -> None:
    """Say what trimesh does not: an unlit material, 16-bit colours, what the buffers are for."""
    for material in tree["materials"]:
        material["extensions"] = {UNLIT: {}}
    tree["extensionsUsed"] = sorted({*tree.get("extensionsUsed", []), UNLIT})
    for mesh in tree["meshes"]:
        attributes = mesh["primitives"][0]["attributes"]
        if LINEAR_COLOUR in attributes:
            colour = attributes["COLOR_0"] = attributes.pop(LINEAR_COLOUR)
            tree["accessors"][colour]["normalized"] = True
        of_indices = mesh["primitives"][0]["indices"]
        for accessor in (*attributes.values(), of_indices):
            view = tree["bufferViews"][tree["accessors"][accessor]["bufferView"]]
            view["target"] = INDICES if accessor == of_indices else VERTICES
