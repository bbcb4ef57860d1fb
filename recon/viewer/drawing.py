"""What each type of result looks like. To show a new type, register one function here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch

import cv2
import numpy as np
import rerun as rr
from torch import Tensor

from calib.pair import RectifiedPair, StereoPair
from recon.colours import STATUS_COLOURS, colour_mapped, colour_range
from recon.types import Array, CostVolume, DisparityMap, Mesh, PointCloud
from recon.viewer.thinning import as_numpy, thinned_image, thinned_mesh, thinned_points

__all__ = ["LOG", "STATUS_CONTEXT", "WORLD", "Drawing", "Limits", "archetypes"]

Drawing = list[tuple[str, rr.AsComponents]]
"""Pairs of a path and what to draw there. Paths are below the stage; one that begins with a slash
stands on its own."""

WORLD = "/world"
LOG = "/log"
ROWS_SHOWN = (0.25, 0.5, 0.75)

STATUS_CONTEXT = rr.AnnotationContext(
    [(int(state), state.name.lower(), colour) for state, colour in STATUS_COLOURS.items()]
)


@dataclass(frozen=True)
class Limits:
    """How much of a result is drawn; raising a limit shows more and makes recordings larger.

    Attributes:
        max_points: of a point cloud.
        max_faces: of a mesh.
        max_pixels: of an image; the two photographs are drawn whole.
        jpeg_quality: of images, from 1 to 100.
    """

    max_points: int = 300_000
    max_faces: int = 200_000
    max_pixels: int = 1_000_000
    jpeg_quality: int = 85


@singledispatch
def archetypes(result: object, limits: Limits) -> Drawing:  # noqa: ARG001  types without limits
    """Return what to draw of a result; of an unknown type, its text.

    Args:
        result: what a stage made.
        limits: how much of it to draw.
    """
    return [("", rr.TextDocument(f"```\n{result}\n```", media_type=rr.MediaType.MARKDOWN))]


@archetypes.register
def _of_text(result: str, limits: Limits) -> Drawing:  # noqa: ARG001
    """Draw text as Markdown."""
    return [("", rr.TextDocument(result, media_type=rr.MediaType.MARKDOWN))]


@archetypes.register
def _of_mapping(result: Mapping, limits: Limits) -> Drawing:  # type: ignore[type-arg]  # noqa: ARG001  dispatch takes no subscript
    """Draw settings, timings or measurements as a table."""
    rows = [f"| {name} | {value} |" for name, value in _flattened(result)]
    table = "\n".join(["| | |", "| --- | --- |", *rows])
    return [("", rr.TextDocument(table, media_type=rr.MediaType.MARKDOWN))]


@archetypes.register
def _of_raw_pair(result: StereoPair, limits: Limits) -> Drawing:
    """Draw both photographs as they were taken."""
    return [
        (side, _photograph(thinned_image(image, limits.max_pixels), limits))
        for side, image in (("left", result.left), ("right", result.right))
    ]


@archetypes.register
def _of_pair(result: RectifiedPair, limits: Limits) -> Drawing:
    """Draw both photographs on their cameras, in one scene in metres."""
    geometry = result.geometry
    width, height = geometry.size
    drawing: Drawing = [
        (f"{WORLD}/right", rr.Transform3D(translation=(geometry.baseline_m, 0, 0))),
        ("", _text_of_geometry(result)),
    ]
    for side, image, (cx, cy) in (
        ("left", result.left, geometry.centre_left),
        ("right", result.right, geometry.centre_right),
    ):
        camera = rr.Pinhole(
            focal_length=geometry.focal_px,
            principal_point=(cx + 0.5, cy + 0.5),  # Rerun counts from the corner of the image
            width=width,
            height=height,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=geometry.baseline_m,
        )
        drawing += [(f"{WORLD}/{side}", camera), (f"{WORLD}/{side}", _photograph(image, limits))]
    return drawing


@archetypes.register
def _of_volume(result: CostVolume, limits: Limits) -> Drawing:
    """Draw a few rows as (disparity, column) pictures, and the costs of the pixel in the middle."""
    height, width, _ = result.cost.shape
    rows = sorted({int(share * height) for share in ROWS_SHOWN})
    drawing: Drawing = []
    for row in rows:
        costs = as_numpy(result.cost[row]).T[::-1]  # (D, W), largest disparity on top
        drawing.append((f"row_{row}", _in_colours(costs, limits)))

    curve = as_numpy(result.cost[height // 2, width // 2])
    finite = np.isfinite(curve)
    if finite.any():
        candidates = np.array(result.disparities)
        chart = rr.BarChart(curve[finite].astype(np.float64), abscissa=candidates[finite])
        drawing.append((f"pixel_{width // 2}_{height // 2}", chart))
    return drawing


@archetypes.register
def _of_disparity(result: DisparityMap, limits: Limits) -> Drawing:  # type: ignore[type-arg]
    """Draw the disparities in colours, the states and the confidence."""
    values, status, confidence = (
        thinned_image(as_numpy(field), limits.max_pixels)
        for field in (result.values, result.status, result.confidence)
    )
    grey = np.rint(np.clip(np.nan_to_num(confidence), 0, 1) * 255).astype(np.uint8)
    return [
        ("", _in_colours(values, limits)),
        ("status", rr.SegmentationImage(np.ascontiguousarray(status, np.uint8))),
        ("confidence", rr.Image(grey).compress(jpeg_quality=limits.jpeg_quality)),
    ]


@archetypes.register
def _of_cloud(result: PointCloud, limits: Limits) -> Drawing:
    """Draw coloured points."""
    shown = thinned_points(result, limits.max_points)
    return [
        ("", rr.Points3D(shown.points, colors=shown.colours, radii=rr.Radius.ui_points(1.5))),
        *_note("points", len(shown), len(result)),
    ]


@archetypes.register
def _of_mesh(result: Mesh, limits: Limits) -> Drawing:
    """Draw a textured mesh."""
    shown = thinned_mesh(result, limits.max_faces)
    drawn = rr.Mesh3D(
        vertex_positions=shown.vertices,
        triangle_indices=shown.faces,
        vertex_texcoords=shown.uv,
        albedo_texture=np.ascontiguousarray(thinned_image(shown.texture, limits.max_pixels)),
    )
    return [("", drawn), *_note("faces", len(shown.faces), len(result.faces))]


@archetypes.register(np.ndarray)
@archetypes.register(Tensor)
def _of_array(result: Tensor | Array, limits: Limits) -> Drawing:
    """Draw (H, W) floats as depths in metres, and 8-bit images as they are."""
    values = as_numpy(result)
    if values.ndim == 3 and values.shape[2] == 3 and values.dtype == np.uint8:
        return [("", _photograph(thinned_image(values, limits.max_pixels), limits))]
    if values.ndim == 2 and values.dtype.kind == "f":
        millimetres = np.nan_to_num(thinned_image(values, limits.max_pixels) * 1000.0, posinf=0)
        millimetres[(millimetres < 1) | (millimetres > 65535)] = 0
        _, png = cv2.imencode(".png", np.rint(millimetres).astype(np.uint16))
        return [("", rr.EncodedDepthImage(png.tobytes(), media_type="image/png", meter=1000.0))]
    return [("", rr.TextDocument(f"array {values.shape} {values.dtype}"))]


def _photograph(image: Array, limits: Limits) -> rr.AsComponents:
    """Return an (H, W, 3) uint8 RGB image as JPEG."""
    drawn: rr.AsComponents = rr.Image(image).compress(jpeg_quality=limits.jpeg_quality)
    return drawn


def _in_colours(values: Array, limits: Limits) -> rr.AsComponents:
    """Return (H, W) values in colours; those that are not finite are dark grey."""
    small = thinned_image(values, limits.max_pixels)
    return _photograph(colour_mapped(small, *colour_range(small)), limits)


def _note(things: str, shown: int, count: int) -> Drawing:
    """Say that not all is shown, if so."""
    if shown == count:
        return []
    text = f"{shown:,} of {count:,} {things} are shown here; the files have all of them"
    return [(LOG, rr.TextLog(text, level=rr.TextLogLevel.INFO))]


def _text_of_geometry(pair: RectifiedPair) -> rr.TextDocument:
    """Return the numbers that decide the scale of everything."""
    geometry = pair.geometry
    width, height = geometry.size
    return rr.TextDocument(
        f"| | |\n| --- | --- |\n| size | {width} x {height} px |\n"
        f"| focal length | {geometry.focal_px:.2f} px |\n"
        f"| baseline | {geometry.baseline_m:.4f} m |\n"
        f"| disparity at infinity | {geometry.disparity_at_infinity:.2f} px |\n",
        media_type=rr.MediaType.MARKDOWN,
    )


def _flattened(value: object, name: str = "") -> list[tuple[str, str]]:
    """Return nested mappings as rows of a dotted name and a readable value."""
    if isinstance(value, Mapping):
        below = (_flattened(item, f"{name}.{key}".lstrip(".")) for key, item in value.items())
        return [row for rows in below for row in rows]
    if isinstance(value, float) and math.isfinite(value):
        return [(name, f"{value:.4g}")]
    return [(name, str(value).replace("|", "\\|").replace("\n", " "))]
