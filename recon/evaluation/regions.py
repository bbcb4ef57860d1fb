"""Which pixels to count: those in sight of both cameras, near depth edges, without texture."""

from __future__ import annotations

import cv2
import numpy as np

from recon.evaluation.scene import Scene
from recon.types import Array

__all__ = ["regions", "repeated", "times_smaller"]

EDGE_GAP_PX = 2.0
EDGE_WIDTH_PX = 9
TEXTURE_WIDTH_PX = 3
TEXTURELESS_BELOW = 4.0

FACTORS = (1, 2, 4)


def regions(scene: Scene) -> dict[str, Array]:
    """Mark the regions of a scene in which errors are counted apart.

    Source: Scharstein & Szeliski, IJCV 47, 2002, section 5.1.

    Args:
        scene: a pair with its truth.

    Returns:
        (H, W) bool masks of the size of the truth. "all": the truth is known; "nonocc": and both
        cameras see the point; "occluded": and the right camera does not; "edges" and
        "textureless": parts of "nonocc". Without a mask of visible pixels there is no "nonocc"
        and no "occluded", and the other two are parts of "all".

    Raises:
        ValueError: if the truth is not 1, 2 or 4 times larger than the images.
    """
    truth = scene.truth
    known = np.isfinite(truth.disparity)
    named = {"all": known}
    seen = known
    if truth.visible is not None:
        seen = known & truth.visible
        named |= {"nonocc": seen, "occluded": known & ~truth.visible}
    image = scene.pair.left
    flat = repeated(without_texture(image), truth.disparity.shape, what="left image")
    return {**named, "edges": seen & near_edges(truth.disparity), "textureless": seen & flat}


def near_edges(disparity: Array) -> Array:
    """Mark pixels near a jump in depth.

    A jump lies between two pixels, neighbours in a row or a column, whose disparities differ by
    more than 2 px; both are marked, and with them a square of 9 x 9 px around each.

    Args:
        disparity: (H, W) pixels, NaN where unknown; next to an unknown pixel there is no jump.

    Returns:
        (H, W) bool.
    """
    in_row = np.abs(np.diff(disparity, axis=1)) > EDGE_GAP_PX  # (H, W - 1)
    in_column = np.abs(np.diff(disparity, axis=0)) > EDGE_GAP_PX  # (H - 1, W)
    jumps = np.zeros(disparity.shape, dtype=np.uint8)
    jumps[:, :-1] |= in_row
    jumps[:, 1:] |= in_row
    jumps[:-1] |= in_column
    jumps[1:] |= in_column
    window = np.ones((EDGE_WIDTH_PX, EDGE_WIDTH_PX), dtype=np.uint8)
    return np.asarray(cv2.dilate(jumps, window), dtype=bool)


def without_texture(image: Array) -> Array:
    """Mark pixels around which a row of the image hardly changes.

    The squared gradient of a pixel is the larger of the squared differences to its left and its
    right neighbour, in grey levels of 0 .. 255; its mean over a square of 3 x 3 px is below 4.
    At the border the outermost pixels are repeated.

    Args:
        image: (H, W, 3) uint8 RGB; its grey values (BT.601, rounded to whole levels) are used.

    Returns:
        (H, W) bool.
    """
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.float32)
    step = np.square(np.diff(grey, axis=1))  # (H, W - 1)
    squared_gradient = np.zeros_like(grey)
    squared_gradient[:, :-1] = step
    squared_gradient[:, 1:] = np.maximum(squared_gradient[:, 1:], step)
    # sums of whole numbers are exact, means would not be
    window = (TEXTURE_WIDTH_PX, TEXTURE_WIDTH_PX)
    sums = cv2.boxFilter(
        squared_gradient, -1, window, normalize=False, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(sums < TEXTURELESS_BELOW * TEXTURE_WIDTH_PX**2)


def repeated(values: Array, shape: tuple[int, ...], *, what: str = "disparity map") -> Array:
    """Bring a map to the size of a truth by its nearest neighbours, the values as they are.

    With s the factor, result[y, x] = values[y div s, x div s].

    Args:
        values: (H, W).
        shape: (H s, W s) of the truth.
        what: its name, for the message.

    Raises:
        ValueError: if s is not 1, 2 or 4, or not the same in x and y.
    """
    factor = times_smaller(values.shape, shape, what=what)
    return values if factor == 1 else values.repeat(factor, axis=0).repeat(factor, axis=1)


def times_smaller(shape: tuple[int, ...], truth_shape: tuple[int, ...], *, what: str) -> int:
    """Return how many times smaller than the truth something is.

    Args:
        shape: (H, W) of the smaller one.
        truth_shape: (H, W) of the truth.
        what: its name, for the message.

    Returns:
        1, 2 or 4.

    Raises:
        ValueError: if it is not one of these, exactly and the same in x and y.
    """
    for factor in FACTORS:
        if tuple(factor * length for length in shape) == tuple(truth_shape):
            return factor
    raise ValueError(
        f"the {what} is {tuple(shape)} but the truth is {tuple(truth_shape)} (rows, columns); it "
        "must be 1, 2 or 4 times smaller than the truth, the same in x and y; does it belong to "
        "another pair, or was it cropped?"
    )
