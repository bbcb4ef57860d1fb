"""What two photographs alone tell of the cameras that took them: all but the unit of length."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from calib.camera import Camera
from calib.epipolar import Matches, match_views
from calib.pair import Image
from calib.pose import Pose, nearest_rotation
from calib.rectify import Rectifier
from calib.rig import StereoCalibration
from calib.row_correction import corrected_rig, estimate_row_correction

__all__ = ["EstimatedRig", "estimate_uncalibrated_rig", "focal_px_of"]

Array = npt.NDArray[np.float64]
FocalSource = Literal["given", "matches", "guess"]

LEAST_MATCHES = 40
DIAGONAL_35MM = float(np.hypot(36, 24))
GUESS_35MM = 35.0  # between the wide and the normal lenses
TOLERANCE_SHARE = 5e-4  # of the diagonal, that a match may be off; 1 px at 2000
MOST_OF_ONE_PLANE = 0.95  # of the matches
FARTHEST = 1e4  # baselines; beyond it noise decides whether a point is in front
LEAST_IN_FRONT = 0.6  # likewise
CONFIDENCE = 0.9999
FOCAL_FACTORS = np.geomspace(0.4, 2.5, 11)
FINE_STEPS = 9  # between the neighbours of the best one
ASIDE = 2  # steps of FOCAL_FACTORS: 1.44 times longer or shorter
CLEARLY_WORSE = 1.5  # of the best residual, that those aside must have


@dataclass(frozen=True, eq=False)
class EstimatedRig:
    """Cameras that were estimated from matches.

    Attributes:
        calibration: two equal cameras without distortion, at a distance of 1: it is the unit of
            all lengths, whatever the names of the fields say.
        count: of the matches it was estimated from.
        residual_px: median distance of these to their epipolar lines (Sampson).
        focal_from: "given", "matches", or "guess" where the matches do not tell.
    """

    calibration: StereoCalibration
    count: int
    residual_px: float
    focal_from: FocalSource


def focal_px_of(focal_35mm: float, size: tuple[int, int]) -> float:
    """Return the focal length in pixels of a lens, from its equivalent in 35 mm photography.

    By the diagonals, as cameras reckon: f = f_35 sqrt(w^2 + h^2) / 43.27.

    Args:
        focal_35mm: millimetres.
        size: (width, height) of the whole photograph in pixels.
    """
    return focal_35mm * float(np.hypot(*size)) / DIAGONAL_35MM


def estimate_uncalibrated_rig(
    left: Image, right: Image, *, focal_px: float | None = None
) -> EstimatedRig:
    """Estimate where two equal cameras stand from what their photographs show.

    The essential matrix of the matches (MAGSAC), the pose of it that puts most points in front of
    both cameras, and turns that make the rows of the rectified views agree.

    A focal length that is not given is taken from the matches only where they tell it clearly:
    views in nearly the same direction, as stereo needs them, do not. Then it is a guess, and
    distances along and across the line of sight are not to scale.

    Source: Nister, IEEE TPAMI 2004; Barath et al., CVPR 2020.

    Args:
        left: (H, W, 3) uint8 RGB.
        right: (H, W, 3) uint8 RGB, of the same size.
        focal_px: of both cameras.

    Raises:
        ValueError: if the views do not tell the geometry: hardly a match, a scene on one plane or
            cameras in one place, a step forwards, or cameras one above the other or swapped.
    """
    size = left.shape[1], left.shape[0]
    matches = match_views(left, right)
    if len(matches) < LEAST_MATCHES:
        raise ValueError(
            f"cannot estimate the cameras: only {len(matches)} points of both views match, "
            f"{LEAST_MATCHES} are needed; use pictures that share more, with texture, or calibrate"
        )
    tolerance = TOLERANCE_SHARE * float(np.hypot(*size))
    _check_depth(matches, tolerance)
    guess = focal_px_of(GUESS_35MM, size)
    told = None if focal_px else _focal_told(matches, size, guess, tolerance)
    K = _camera_matrix(size, focal_px or told or guess)
    calibration = _straightened(_rig(matches, size, K, tolerance), matches)
    return EstimatedRig(
        calibration=calibration,
        count=len(matches),
        residual_px=float(np.median(_sampson(matches, _essential_of(calibration), K))),
        focal_from="given" if focal_px else "matches" if told else "guess",
    )


def _check_depth(matches: Matches, tolerance: float) -> None:
    """Raise ValueError if one homography explains nearly all matches."""
    _, on_plane = cv2.findHomography(matches.left, matches.right, cv2.USAC_MAGSAC, tolerance)
    share = 0.0 if on_plane is None else float(on_plane.mean())
    if share > MOST_OF_ONE_PLANE:
        raise ValueError(
            f"cannot estimate the cameras: one plane explains {share:.0%} of {len(matches)} "
            "matches. Either the camera was only turned and not moved, or the scene is flat; move "
            "the camera sideways, show things at several distances, or calibrate"
        )


def _focal_told(
    matches: Matches, size: tuple[int, int], guess: float, tolerance: float
) -> float | None:
    """Return the focal length in pixels at which the matches agree best; None if many do as well.

    Views in the same direction agree at any.
    """
    residuals = _residuals(matches, size, guess * FOCAL_FACTORS, tolerance)
    best = int(np.argmin(residuals))
    low, high = best - ASIDE, best + ASIDE
    if low < 0 or high >= len(residuals):
        return None
    if min(residuals[low], residuals[high]) < CLEARLY_WORSE * residuals[best]:
        return None
    near = guess * np.geomspace(FOCAL_FACTORS[best - 1], FOCAL_FACTORS[best + 1], FINE_STEPS)
    return float(near[np.argmin(_residuals(matches, size, near, tolerance))])


def _residuals(
    matches: Matches, size: tuple[int, int], focals: Array, tolerance: float
) -> list[float]:
    """Return the median Sampson distance in pixels at each focal length."""
    residuals = []
    for focal in focals.tolist():
        K = _camera_matrix(size, focal)
        E, _ = _essential(matches, K, tolerance)
        residuals.append(np.inf if E is None else float(np.median(_sampson(matches, E, K))))
    return residuals


def _rig(matches: Matches, size: tuple[int, int], K: Array, tolerance: float) -> StereoCalibration:
    """Return the cameras that the essential matrix of the matches stands for."""
    E, agrees = _essential(matches, K, tolerance)
    if E is None:
        raise ValueError(
            "cannot estimate the cameras: the matches agree with no position of the cameras; "
            "were both pictures taken with the same camera and zoom, and not cropped?"
        )
    left, right = matches.left[agrees], matches.right[agrees]
    in_front, R, t, *_ = cv2.recoverPose(E, left, right, K, distanceThresh=FARTHEST)
    if in_front < LEAST_IN_FRONT * len(matches):
        raise ValueError(
            f"cannot estimate the cameras: only {in_front} of {len(matches)} matches lie in front "
            "of both; was the camera hardly moved, or is the scene far away?"
        )
    pose = Pose(nearest_rotation(np.asarray(R, dtype=np.float64)), np.ravel(t))
    _check_direction(-pose.R.T @ pose.t, size, K)
    camera = Camera(size, K, np.zeros(0))
    return StereoCalibration(camera, camera, pose)


def _check_direction(baseline: Array, size: tuple[int, int], K: Array) -> None:
    """Raise ValueError unless the baseline (3,), in the left camera's frame, points to the right.

    The epipole, where the left view would show the right camera, must lie outside of it.
    """
    x, y, z = baseline
    epipole = (K @ baseline)[:2] / z if z else np.full(2, np.inf)
    if (np.abs(epipole - K[:2, 2]) < np.array(size) / 2).all():
        raise ValueError(
            "cannot rectify the pair: the camera moved forwards or backwards, towards what the "
            "picture shows; move it sideways between the pictures"
        )
    if abs(y) > abs(x):
        raise ValueError(
            "the cameras stand one above the other; only pairs side by side can be matched: turn "
            "both pictures by 90 degrees"
        )
    if x < 0:
        raise ValueError(
            "the second picture was taken from the left of the first one; exchange them"
        )


def _straightened(calibration: StereoCalibration, matches: Matches) -> StereoCalibration:
    """Return the cameras turned so that the rows of their rectified views agree best."""
    rectifier = Rectifier(calibration, alpha=None)  # whatever the views have in common
    rectified = Matches(
        rectifier.points(matches.left, "left"), rectifier.points(matches.right, "right")
    )
    return corrected_rig(rectifier, estimate_row_correction(rectified, rectifier.geometry))


def _essential(
    matches: Matches, K: Array, tolerance: float
) -> tuple[Array | None, npt.NDArray[np.bool_]]:
    """Return the (3, 3) essential matrix, None if there is none, and which matches agree."""
    E, agrees = cv2.findEssentialMat(
        matches.left, matches.right, K, cv2.USAC_MAGSAC, CONFIDENCE, tolerance
    )
    if E is None or E.shape != (3, 3) or agrees is None:
        return None, np.zeros(len(matches), bool)
    return np.asarray(E, dtype=np.float64), np.ravel(agrees) > 0


def _essential_of(calibration: StereoCalibration) -> Array:
    """Return [t]x R of a pose."""
    x, y, z = calibration.right_from_left.t
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    essential: Array = cross @ calibration.right_from_left.R
    return essential


def _sampson(matches: Matches, E: Array, K: Array) -> Array:
    """Return (N,), the distance of matches to their epipolar lines to first order, in pixels."""
    inverse = np.linalg.inv(K)
    F = inverse.T @ E @ inverse
    left, right = (np.column_stack([p, np.ones(len(p))]) for p in (matches.left, matches.right))
    in_right, in_left = left @ F.T, right @ F  # lines
    slope = np.sqrt((in_right[:, :2] ** 2).sum(axis=1) + (in_left[:, :2] ** 2).sum(axis=1))
    distance: Array = np.abs((right * in_right).sum(axis=1)) / slope
    return distance


def _camera_matrix(size: tuple[int, int], focal_px: float) -> Array:
    cx, cy = (size[0] - 1) / 2, (size[1] - 1) / 2
    return np.array([[focal_px, 0, cx], [0, focal_px, cy], [0, 0, 1]])
