"""Views of points from three sides, as pictures."""

from __future__ import annotations

import base64
import io

import numpy as np
from PIL import Image as Pictures

from recon.types import Array

__all__ = ["VIEWS", "data_address", "drawn"]

VIEWS = {
    "from the camera": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "from above": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "from the right": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}
"""What lies to the right, down and away in each view, as directions in the frame of the camera; the
first view has perspective."""

SIZE = (460, 340)
MARGIN = 8
PAPER = 246
BOX_PERCENT = (1, 99)


def drawn(points: Array, colours: Array, view: str, box: Array) -> Array:
    """Draw points as squares of 2 x 2 pixels, nearer ones over farther ones.

    Args:
        points: (N, 3) metres; x right, y down, z forward.
        colours: (N, 3) uint8.
        view: a key of `VIEWS`.
        box: (M, 3) points whose middle 98 % fill the picture, so that two shapes can be drawn
            alike.

    Returns:
        (H, W, 3) uint8.
    """
    across, away = _placed(points, view)
    about, _ = _placed(box, view)
    low, high = np.percentile(about, BOX_PERCENT, axis=0)
    inner = np.array(SIZE) - 2 * MARGIN
    scale = (inner / np.maximum(high - low, 1e-9)).min()
    pixels = (across - (low + high) / 2) * scale + np.array(SIZE) / 2
    order = np.argsort(-away, kind="stable")
    canvas = np.full((SIZE[1], SIZE[0], 3), PAPER, np.uint8)
    corner = np.floor(pixels[order]).astype(np.int64)
    for offset in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = (corner + offset).T
        inside = (x >= 0) & (x < SIZE[0]) & (y >= 0) & (y < SIZE[1])
        canvas[y[inside], x[inside]] = colours[order][inside]
    return canvas


def _placed(points: Array, view: str) -> tuple[Array, Array]:
    """Return where points lie in a view, (N, 2) across and down, and how far away (N,)."""
    axes = np.array(VIEWS[view], np.float64)
    across, away = points @ axes[:2].T, points @ axes[2]
    if view == "from the camera" and (points[:, 2] > 0).all():
        across = across / away[:, None]
    return across, away


def data_address(image: Array) -> str:
    """Return a picture as an address that a page can hold."""
    contents = io.BytesIO()
    Pictures.fromarray(image).save(contents, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(contents.getvalue()).decode("ascii")
