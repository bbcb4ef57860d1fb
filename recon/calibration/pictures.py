"""The pictures of a calibration's report: drawings as SVG, photographs as JPEG."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import numpy.typing as npt
from markupsafe import Markup

from calib.estimation import RigEstimate
from calib.pair import Image, StereoPair
from calib.rectify import Rectifier
from recon.calibration.detection import Detected, Thumbnail
from recon.files.images import encoded
from recon.types import Array

__all__ = ["coverage_drawing", "residual_drawing", "rows_picture", "thumbnails_of"]

WIDTH = 420
CELLS = (12, 9)
ROW_STEP = 40
LINE = (60, 200, 60)
DOT, HALO = (255, 190, 0), (40, 40, 40)
ARROW_SHARE = 0.7
"""Of the width of a cell, that the longest arrow takes."""


def coverage_drawing(estimate: RigEstimate, camera: int) -> Markup:
    """Return where the corners of all views lie in the image of a camera."""
    width, height = estimate.calibration.left.size
    factor = WIDTH / width
    dots = []
    for sighting in estimate.sightings:
        if sighting.camera == camera:
            dots += [f"M{x * factor:.1f} {y * factor:.1f}h0" for x, y in sighting.pixels]
    return _svg(width, height, f'<path class="dots" d="{"".join(dots)}"/>')


def residual_drawing(estimate: RigEstimate, camera: int) -> tuple[Markup, float]:
    """Return the mean residual of each part of the image as arrows, and how much they are enlarged.

    What is left there is not noise: the lens model, or the board, differs from the real one.
    """
    width, height = estimate.calibration.left.size
    pixels = np.concatenate([s.pixels for s in estimate.sightings if s.camera == camera])
    residuals = np.concatenate(estimate.errors(camera=camera))
    columns, rows = CELLS
    cell_x = (pixels[:, 0] / width * columns).astype(int).clip(0, columns - 1)
    cell_y = (pixels[:, 1] / height * rows).astype(int).clip(0, rows - 1)
    arrows = []
    for y in range(rows):
        for x in range(columns):
            inside = (cell_x == x) & (cell_y == y)
            if inside.any():
                arrows.append((*pixels[inside].mean(0), *residuals[inside].mean(0)))
    field = np.array(arrows)
    longest = float(np.hypot(field[:, 2], field[:, 3]).max())
    enlarged = ARROW_SHARE * width / columns / max(longest, 1e-9)
    factor = WIDTH / width
    lines = [
        f'<line x1="{x * factor:.1f}" y1="{y * factor:.1f}" '
        f'x2="{(x + dx * enlarged) * factor:.1f}" y2="{(y + dy * enlarged) * factor:.1f}" '
        'marker-end="url(#tip)"/>'
        for x, y, dx, dy in field
    ]
    return _svg(width, height, f'<g class="arrows">{"".join(lines)}</g>'), enlarged


def corners_drawn(small: Thumbnail, pixels: Array | None) -> str:
    """Return a thumbnail with the corners (n, 2) of the photograph, as a data URL."""
    drawn = small.image.copy()
    for x, y in () if pixels is None else pixels * small.scale:
        place = (round(float(x) * 8), round(float(y) * 8))
        cv2.circle(drawn, place, 18, HALO, -1, cv2.LINE_AA, 3)
        cv2.circle(drawn, place, 12, DOT, -1, cv2.LINE_AA, 3)
    return _jpeg(drawn)


def rows_picture(pair: StereoPair, most_width: int = 1200) -> str | None:
    """Return both rectified views side by side with lines along rows, as a data URL.

    None if they cannot be rectified, as when the lens turns back before the border of the image.
    """
    try:
        rectified = Rectifier(pair.calibration, alpha=1.0)(pair)
    except ValueError:
        return None
    both = np.concatenate([rectified.left, rectified.right], axis=1)
    factor = min(1.0, most_width / both.shape[1])
    both = np.asarray(cv2.resize(both, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))
    for row in range(ROW_STEP // 2, both.shape[0], ROW_STEP):
        cv2.line(both, (0, row), (both.shape[1] - 1, row), LINE, 1)
    return _jpeg(both.astype(np.uint8))


def thumbnails_of(detected: Detected, name: str) -> tuple[str, str]:
    """Return both photographs of a view with what was found in them, as data URLs."""
    place = [view.name for view in detected.views].index(name)
    view, small = detected.views[place], detected.thumbnails[place]
    left, right = (
        corners_drawn(thumbnail, None if corners is None else corners.pixels)
        for thumbnail, corners in zip(small, (view.left, view.right), strict=True)
    )
    return left, right


def _svg(width: int, height: int, content: str) -> Markup:
    tall = round(WIDTH * height / width)
    return Markup(
        f'<svg viewBox="0 0 {WIDTH} {tall}" role="img"><defs><marker id="tip" markerWidth="5" '
        'markerHeight="5" refX="3" refY="2.5" orient="auto"><path d="M0 0L4 2.5L0 5z"/></marker>'
        f'</defs><rect width="{WIDTH}" height="{tall}"/>{content}</svg>'
    )


def _jpeg(image: Image | npt.NDArray[np.uint8]) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(encoded(image, ".jpg")).decode()
