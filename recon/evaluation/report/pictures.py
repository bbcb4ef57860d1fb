"""Thumbnails of scenes and results, with one scale of colours for the errors of all of them."""

from __future__ import annotations

import io

import cv2
import numpy as np
from PIL import Image as Pictures

from recon.colours import colour_mapped, colour_range
from recon.evaluation.protocols import enlarged, protocol_for, signed_errors
from recon.evaluation.scene import Scene
from recon.types import Array

__all__ = [
    "DISPARITY",
    "ERROR",
    "ERROR_COLOURS",
    "ERROR_EDGES_PX",
    "INVALID_COLOUR",
    "LEFT",
    "OCCLUDED",
    "OCCLUDED_BRIGHTNESS",
    "TRUTH",
    "UNKNOWN",
    "UNKNOWN_COLOUR",
    "WIDEST_PX",
    "error_classes",
    "error_colours",
    "result_pictures",
    "scene_pictures",
]

Colour = tuple[int, int, int]

LEFT, TRUTH = "left.jpg", "truth.jpg"
DISPARITY, ERROR = "disparity.jpg", "error.png"
WIDEST_PX = 280

ERROR_EDGES_PX = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Errors of one colour lie above one of these and not above the next."""

ERROR_COLOURS: tuple[Colour, ...] = (
    (49, 96, 168),
    (104, 160, 205),
    (176, 211, 228),
    (254, 226, 144),
    (252, 174, 92),
    (240, 116, 62),
    (206, 44, 40),
    (138, 0, 74),
)
"""Blue up to 2 px, yellow to red beyond, so that bad2.0 is the share of the warm colours."""

INVALID_COLOUR: Colour = (0, 0, 0)
UNKNOWN_COLOUR: Colour = (240, 240, 240)
OCCLUDED_BRIGHTNESS = 0.6
"""Colours of occluded pixels are darkened by this factor."""

INVALID = len(ERROR_COLOURS)
UNKNOWN = INVALID + 1
OCCLUDED = 16
"""Added to the class of an occluded pixel."""

PHOTO_QUALITY = 72
MAP_QUALITY = 75
OTHER_SAMPLES = tuple((down, across) for down in (1 / 6, 1 / 2, 5 / 6) for across in (1 / 6, 5 / 6))
"""Where in a block a pixel is looked for after the middle, as shares of its extent."""


def scene_pictures(scene: Scene) -> dict[str, bytes]:
    """Draw the left photograph and the true disparities of a scene.

    Args:
        scene: whose truth gives the range of the colours.

    Returns:
        Name -> contents of an image file, at most `WIDEST_PX` wide.
    """
    photo, truth = scene.pair.left, scene.truth.disparity
    photo_shown = cv2.resize(photo, _thumbnail_size(photo.shape), interpolation=cv2.INTER_AREA)
    truth_shown = _averaged(truth, _thumbnail_size(truth.shape), least_share=0)
    return {
        LEFT: _jpeg(np.asarray(photo_shown), PHOTO_QUALITY),
        TRUTH: _jpeg(colour_mapped(truth_shown, *colour_range(truth)), MAP_QUALITY),
    }


def result_pictures(values: Array, scene: Scene) -> dict[str, bytes]:
    """Draw what a method found, in the colours of the truth, and where it is wrong.

    Errors follow the official protocol of the scene. Of every block of pixels one is drawn, so
    that the share of a colour stays the share of its errors.

    Args:
        values: (H, W) disparities in pixels of this size, which is that of the truth or 2 or 4
            times smaller; NaN or infinite where the method has none.
        scene: with the truth.

    Returns:
        Name -> contents of an image file, at most `WIDEST_PX` wide.

    Raises:
        ValueError: if `values` cannot be brought to the size of the truth.
    """
    truth = scene.truth
    size = _thumbnail_size(truth.disparity.shape)
    found = _averaged(enlarged(values, truth.disparity.shape), size, least_share=0.5)
    error = np.abs(signed_errors(values, scene, protocol_for("official", scene)))
    shown = _sampled(truth.disparity, size)
    classes = error_classes(
        error[shown],
        known=np.isfinite(truth.disparity[shown]),
        visible=None if truth.visible is None else truth.visible[shown],
    )
    return {
        DISPARITY: _jpeg(colour_mapped(found, *colour_range(truth.disparity)), MAP_QUALITY),
        ERROR: _png(classes),
    }


def error_classes(error: Array, *, known: Array, visible: Array | None) -> Array:
    """Say for every pixel how wrong it is, as an index into the palette of error maps.

    Args:
        error: (H, W), not negative, pixels; NaN where there is no result.
        known: (H, W) bool, where there is a truth.
        visible: (H, W) bool, where both cameras see the point; None if nobody says.

    Returns:
        (H, W) uint8: 0 to 7 for the intervals between `ERROR_EDGES_PX`, 8 where the method has no
        disparity, 9 where the truth is unknown; plus 16 where the right camera sees nothing.
    """
    # side="left": an error equal to an edge is not above it, so not bad
    classes = np.searchsorted(ERROR_EDGES_PX, error, side="left").astype(np.uint8)
    classes[np.isnan(error)] = INVALID
    if visible is not None:
        classes[~visible] += OCCLUDED
    classes[~known] = UNKNOWN
    return classes


def error_colours(classes: Array) -> Array:
    """Give every class of error its colour.

    Args:
        classes: (H, W) uint8 of `error_classes`.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    return _palette()[classes]


def _palette() -> Array:
    """Return the colours of all classes, (26, 3) uint8."""
    visible = np.array([*ERROR_COLOURS, INVALID_COLOUR, UNKNOWN_COLOUR])
    palette = np.zeros((OCCLUDED + len(visible), 3), np.uint8)
    palette[: len(visible)] = visible
    palette[OCCLUDED:] = np.rint(visible * OCCLUDED_BRIGHTNESS)
    return palette


def _thumbnail_size(shape: tuple[int, ...]) -> tuple[int, int]:
    """Return (width, height) of the thumbnail of an image of this shape."""
    rows, columns = shape[:2]
    width = min(columns, WIDEST_PX)
    return width, max(1, round(rows * width / columns))


def _averaged(values: Array, size: tuple[int, int], *, least_share: float) -> Array:
    """Shrink disparities; every pixel becomes the mean of those that it covers and that exist.

    Args:
        values: (H, W); NaN or infinite where there is none.
        size: (width, height) of the result.
        least_share: of the pixels covered, how many must exist at least.

    Returns:
        (height, width) float32; NaN where fewer exist, or none.
    """
    present = np.isfinite(values)
    filled = np.where(present, values, 0).astype(np.float32)
    total = cv2.resize(filled, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(present.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    enough = (share > 0) & (share >= least_share)
    return np.where(enough, total / np.where(enough, share, 1), np.float32(np.nan))


def _sampled(truth: Array, size: tuple[int, int]) -> tuple[Array, Array]:
    """Choose one pixel of every block of an image.

    It is the one in the middle, or where its truth is unknown another of the block, since a laser
    scanner measures few of the pixels.

    Args:
        truth: (H, W), NaN where it is unknown.
        size: (width, height) in blocks.

    Returns:
        Row and column of every choice, each (height, width).
    """
    width, height = size
    y, x = np.mgrid[:height, :width]
    tall, wide = truth.shape[0] / height, truth.shape[1] / width
    row, column = _within(y, tall, 0.5), _within(x, wide, 0.5)
    for down, across in OTHER_SAMPLES:
        unknown = np.isnan(truth[row, column])
        row[unknown] = _within(y[unknown], tall, down)
        column[unknown] = _within(x[unknown], wide, across)
    return row, column


def _within(block: Array, extent: float, share: float) -> Array:
    """Return the index of the pixel that lies at a share of the way through each block."""
    index: Array = ((block + share) * extent).astype(np.intp)
    return index


def _jpeg(picture: Array, quality: int) -> bytes:
    """Return the contents of a JPEG file of an (H, W, 3) uint8 RGB picture."""
    file = io.BytesIO()
    Pictures.fromarray(picture).save(file, "JPEG", quality=quality, optimize=True)
    return file.getvalue()


def _png(classes: Array) -> bytes:
    """Return the contents of a PNG file of error classes, one byte a pixel and a palette."""
    picture = Pictures.fromarray(classes)
    picture.putpalette(_palette().tobytes())
    file = io.BytesIO()
    picture.save(file, "PNG")
    return file.getvalue()
