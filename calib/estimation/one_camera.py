"""One camera fitted to what it saw of a board, by itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from calib.boards import Board, Corners
from calib.camera import LENSES, Camera, CameraModel, LensName
from calib.estimation.adjustment import Array, Bundle, Sighting, adjust, pose_of_board, rms

__all__ = ["FEWEST_VIEWS", "CameraFit", "fit_camera", "lens_of", "not_worse"]

FEWEST_VIEWS = 3
FIRST_FOCALS: dict[CameraModel, tuple[float, ...]] = {
    "pinhole": (0.4, 0.6, 0.9, 1.3, 2.0, 3.0),
    "fisheye": (0.2, 0.27, 0.35, 0.5, 0.7, 1.0),
}
"""Focal lengths to begin with, as shares of the width."""
VIEWS_TO_BEGIN_WITH = 8
WORSE_THAN_MEDIAN = 3.0
TOLERATED_RMS_PX = 0.3
"""A view is left out if it is this much worse than the median one, and worse than this."""
PASSES = 4
POSE = 6
HOPELESS = 0.01  # RMS over the diagonal of the image


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A camera fitted alone.

    Attributes:
        camera: the best one.
        poses: (V, 6) of the board before it, zeros where it did not see enough.
        errors: (V,) RMS in pixels, inf where it did not see enough or what it saw does not fit.
        rms_px: of all views together.
    """

    camera: Camera
    poses: Array
    errors: Array
    rms_px: float


def fit_camera(
    board: Board,
    seen: Sequence[Corners | None],
    size: tuple[int, int],
    lens: LensName,
    side: str,
) -> CameraFit:
    """Fit one camera to what it saw; views that do not fit count as not seen."""
    there = [index for index, corners in enumerate(seen) if corners is not None]
    if len(there) < FEWEST_VIEWS:
        raise ValueError(
            f"the {side} camera saw the board in {len(there)} photographs; at least "
            f"{FEWEST_VIEWS} are needed"
        )
    camera = _first_camera(board, [seen[index] for index in there], size, lens)
    poses, errors = np.zeros((len(seen), POSE)), np.full(len(seen), np.inf)
    for _ in range(PASSES):
        found = {index: _placed(camera, board, seen[index]) for index in there}
        found = {index: (pose, error) for index, (pose, error) in found.items() if error < np.inf}
        there = list(found)
        if len(there) < FEWEST_VIEWS:
            break
        sightings = [_sighting(board, seen[index], place) for place, index in enumerate(there)]
        start = Bundle((camera,), np.zeros(POSE), np.array([pose for pose, _ in found.values()]))
        adjusted = adjust(start, sightings)
        camera = adjusted.bundle.cameras[0]
        poses[there] = adjusted.bundle.boards
        each = np.array([rms([residual]) for residual in adjusted.residuals])
        fine = not_worse(each)
        errors[:] = np.inf
        errors[np.array(there)[fine]] = each[fine]
        there = [index for index, ok in zip(there, fine, strict=True) if ok]
        if fine.all():
            break
    fitting = errors[np.isfinite(errors)]
    if len(fitting) < FEWEST_VIEWS or np.median(fitting) > HOPELESS * np.hypot(*size):
        raise ValueError(
            f"no {lens} camera explains what the {side} camera saw of a {board.name}; are the "
            "counts right, is the board flat, and is the lens another (--model)?"
        )
    return CameraFit(camera, poses, errors, float(np.sqrt((fitting**2).mean())))


def lens_of(camera: Camera) -> LensName:
    """Return the name in `LENSES` of a camera's lens."""
    shape = camera.model, len(camera.distortion)
    return next(name for name, lens in LENSES.items() if lens == shape)


def not_worse(errors: Array) -> npt.NDArray[np.bool_]:
    """Return which views are about as good as the others."""
    limit = max(TOLERATED_RMS_PX, WORSE_THAN_MEDIAN * float(np.median(errors)))
    fine: npt.NDArray[np.bool_] = errors <= limit
    return fine


def _first_camera(
    board: Board, seen: Sequence[Corners | None], size: tuple[int, int], lens: LensName
) -> Camera:
    """Return the camera without distortion that explains the fullest views best."""
    model, coefficients = LENSES[lens]
    fullest = sorted((corners for corners in seen if corners is not None), key=len, reverse=True)
    width, height = size
    best, least = None, float("inf")
    for share in FIRST_FOCALS[model]:
        f = share * width
        K = np.array([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]])
        camera = Camera(size, K, np.zeros(coefficients), model)
        errors = [_placed(camera, board, corners)[1] for corners in fullest[:VIEWS_TO_BEGIN_WITH]]
        error = float(np.median(errors))
        if error < least:
            best, least = camera, error
    if best is None:
        raise ValueError("the corners do not look like a flat board; is the board's form right?")
    return best


def _placed(camera: Camera, board: Board, corners: Corners | None) -> tuple[Array, float]:
    if corners is None:
        return np.zeros(6), float("inf")
    return pose_of_board(camera, board.points[corners.ids], corners.pixels)


def _sighting(board: Board, corners: Corners | None, place: int) -> Sighting:
    assert corners is not None  # only views that were seen get here
    return Sighting(place, 0, board.points[corners.ids], corners.pixels)
