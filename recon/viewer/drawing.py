"""What each type of result looks like. To show a new type, register one function here."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch

import cv2
import numpy as np
import rerun as rr
from torch import Tensor

from calib.pair import RectifiedPair, StereoPair
from recon.colours import STATUS_COLOURS, colour_mapped, colour_range
from recon.types import Array, CostVolume, DisparityMap, Mesh, PointCloud
from recon.viewer.summary import as_markdown
from recon.viewer.thinning import (
    Limits,
    as_numpy,
    thinned_image,
    thinned_mesh,
    thinned_photograph,
    thinned_points,
    thinning_step,
)

__all__ = ["CLASSES", "WORLD", "Drawing", "archetypes", "rows_shown"]

Drawing = list[tuple[str, rr.AsComponents]]
"""Pairs of a path and what to draw there. Paths are below the stage; one that begins with a slash
stands on its own."""

WORLD = "/world"
SLICES_AT = (0.25, 0.5, 0.75)

OPAQUE = 1.0
"""Said, as the viewer would make what lies above another image transparent."""

SURENESS = ((84, 20, 92), (46, 96, 150), (60, 170, 120), (246, 226, 60))
"""Colours from what is surely wrong to what is surely right."""

FIRST_SURENESS, SURENESS_CLASSES = 100, 10


def _sureness_classes() -> list[rr.AnnotationInfo]:
    """Return one class for every tenth of the confidence."""
    tenths = np.linspace(0, 1, SURENESS_CLASSES)
    anchors = np.linspace(0, 1, len(SURENESS))
    channels = [np.interp(tenths, anchors, levels) for levels in zip(*SURENESS, strict=True)]
    return [
        rr.AnnotationInfo(
            id=FIRST_SURENESS + tenth,
            label=f"right within 1 px: {10 * tenth} to {10 * tenth + 10} %",
            color=tuple(int(channel[tenth]) for channel in channels),
        )
        for tenth in range(SURENESS_CLASSES)
    ]


CLASSES = rr.AnnotationContext(
    [
        *(
            rr.AnnotationInfo(id=int(state), label=state.name.lower(), color=colour)
            for state, colour in STATUS_COLOURS.items()
        ),
        *_sureness_classes(),
    ]
)
"""Names and colours of the states of pixels, and of tenths of their confidence."""


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
    return [("", rr.TextDocument(as_markdown(result), media_type=rr.MediaType.MARKDOWN))]


@archetypes.register
def _of_raw_pair(result: StereoPair, limits: Limits) -> Drawing:
    """Draw both photographs as they were taken."""
    return [
        (side, _photograph(thinned_photograph(image, limits.max_pixels), limits))
        for side, image in (("left", result.left), ("right", result.right))
    ]


@archetypes.register
def _of_pair(result: RectifiedPair, limits: Limits) -> Drawing:
    """Draw both photographs on their cameras, in one scene in metres."""
    geometry = result.geometry
    step = thinning_step(*geometry.size, limits.max_pixels)
    drawing: Drawing = [
        (f"{WORLD}/right", rr.Transform3D(translation=(geometry.baseline_m, 0, 0))),
        ("", _text_of_geometry(result)),
    ]
    for side, image, (cx, cy) in (
        ("left", result.left, geometry.centre_left),
        ("right", result.right, geometry.centre_right),
    ):
        small = thinned_photograph(image, limits.max_pixels)
        camera = rr.Pinhole(
            focal_length=geometry.focal_px / step,
            principal_point=(cx / step + 0.5, cy / step + 0.5),  # from the corner of the image
            width=small.shape[1],
            height=small.shape[0],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=geometry.baseline_m,
        )
        drawing += [
            (f"{WORLD}/{side}", camera),
            (f"{WORLD}/{side}/photograph", _photograph(small, limits)),
        ]
    return drawing


@archetypes.register
def _of_volume(result: CostVolume, limits: Limits) -> Drawing:
    """Draw a few rows as (disparity, column) pictures, the largest disparity on top."""
    return [
        (f"row_{result.origin[0] + row}", _in_colours(as_numpy(result.cost[row]).T[::-1], limits))
        for row in rows_shown(len(result.cost))
    ]


def rows_shown(height: int) -> list[int]:
    """Return the rows of a volume that are drawn as slices.

    Args:
        height: of the volume, rows.
    """
    return sorted({int(share * height) for share in SLICES_AT})


@archetypes.register
def _of_disparity(result: DisparityMap, limits: Limits) -> Drawing:  # type: ignore[type-arg]
    """Draw the disparities in colours, and the states and the confidence as classes."""
    values, status, confidence = (
        thinned_image(as_numpy(field), limits.max_pixels)
        for field in (result.values, result.status, result.confidence)
    )
    tenths = (np.nan_to_num(confidence) * SURENESS_CLASSES).clip(0, SURENESS_CLASSES - 1)
    sureness = FIRST_SURENESS + tenths.astype(np.uint8)
    return [
        ("values", _in_colours(values, limits, limits.disparity_span)),
        ("status", _classes(status)),
        ("confidence", _classes(sureness)),
    ]


@archetypes.register
def _of_cloud(result: PointCloud, limits: Limits) -> Drawing:
    """Draw coloured points."""
    shown = thinned_points(result, limits.max_points)
    return [
        ("", rr.Points3D(shown.points, colors=shown.colours, radii=rr.Radius.ui_points(1.5))),
    ]


@archetypes.register
def _of_mesh(result: Mesh, limits: Limits) -> Drawing:
    """Draw a textured mesh."""
    shown = thinned_mesh(result, limits.max_faces)
    drawn = rr.Mesh3D(
        vertex_positions=shown.vertices,
        triangle_indices=shown.faces,
        vertex_texcoords=shown.uv,
        vertex_colors=shown.colours if shown.texture is None else None,
        albedo_texture=None
        if shown.texture is None
        else np.ascontiguousarray(thinned_image(shown.texture, limits.max_pixels)),
    )
    return [("", drawn)]


@archetypes.register(np.ndarray)
@archetypes.register(Tensor)
def _of_array(result: Tensor | Array, limits: Limits) -> Drawing:
    """Draw (H, W) floats as depths in metres, and 8-bit images as they are."""
    values = as_numpy(result)
    if values.ndim == 3 and values.shape[2] == 3 and values.dtype == np.uint8:
        return [("", _photograph(thinned_photograph(values, limits.max_pixels), limits))]
    if values.ndim == 2 and values.dtype.kind == "f":
        millimetres = np.nan_to_num(thinned_image(values, limits.max_pixels) * 1000.0, posinf=0)
        millimetres[(millimetres < 1) | (millimetres > 65535)] = 0
        _, png = cv2.imencode(".png", np.rint(millimetres).astype(np.uint16))
        near, far = colour_range(millimetres[millimetres > 0])
        depth = rr.EncodedDepthImage(
            png.tobytes(), media_type="image/png", meter=1000.0, depth_range=(near, far)
        )
        return [("", depth)]
    return [("", rr.TextDocument(f"array {values.shape} {values.dtype}"))]


def _photograph(image: Array, limits: Limits) -> rr.AsComponents:
    """Return an (H, W, 3) uint8 RGB image as JPEG."""
    _, jpeg = cv2.imencode(
        ".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, limits.jpeg_quality]
    )
    drawn: rr.AsComponents = rr.EncodedImage(
        contents=jpeg.tobytes(), media_type="image/jpeg", opacity=OPAQUE
    )
    return drawn


def _classes(ids: Array) -> rr.SegmentationImage:
    """Return an (H, W) image of classes."""
    return rr.SegmentationImage(np.ascontiguousarray(ids, np.uint8), opacity=OPAQUE)


def _in_colours(
    values: Array, limits: Limits, span: tuple[float, float] | None = None
) -> rr.AsComponents:
    """Return (H, W) values in colours; those that are not finite are dark grey."""
    small = thinned_image(values, limits.max_pixels)
    return _photograph(colour_mapped(small, *(span or colour_range(small))), limits)


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
