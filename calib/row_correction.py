"""Small turns of the cameras that make the rows of a rectified pair agree."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.epipolar import LEAST_MATCHES, Matches
from calib.pair import Image, RectifiedPair
from calib.pose import Pose
from calib.rectify import Rectifier
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["RowCorrection", "corrected_pair", "corrected_rig", "estimate_row_correction"]

Array = npt.NDArray[np.float64]

HUBER_PX = 0.5
STEPS = 20
STEP_SIZE = 1e-6  # radians, of the numerical derivative
CONVERGED = 1e-9  # radians
LEAST_GAIN_PX = 0.05  # on matches that were not used
LEAST_GAIN = 0.15  # likewise, of the residual before
LARGEST_TURN = np.radians(5)
MODELS = (2, 3)  # how many of pitch, roll and baseline roll are free


@dataclass(frozen=True)
class RowCorrection:
    """How the cameras of a rectified pair have to be turned, and what that gains.

    The relative yaw is left out: it moves all disparities by nearly the same, so that rows hardly
    tell it, and a wrong one would spoil the depths.

    Attributes:
        pitch: of the right camera about the x axis (right), radians.
        roll: of the right camera about the z axis (forward), radians.
        baseline_roll: of both cameras about the z axis, radians: the right camera stands higher or
            lower than was thought. 0 unless the matches ask for it.
        before_px: mean absolute vertical residual without the correction.
        after_px: with it; never more than `before_px`.
    """

    pitch: float = 0.0
    roll: float = 0.0
    baseline_roll: float = 0.0
    before_px: float = 0.0
    after_px: float = 0.0

    @property
    def changes(self) -> bool:
        """Whether anything is to be turned."""
        return any((self.pitch, self.roll, self.baseline_roll))

    @property
    def rotations(self) -> tuple[Array, Array]:
        """Two (3, 3): to the corrected rectified frame of left and right from the old one."""
        return _rotations(np.array([self.pitch, self.roll, self.baseline_roll]))


def estimate_row_correction(matches: Matches, geometry: RectifiedGeometry) -> RowCorrection:
    """Estimate the turns that make the rows of a rectified pair agree best.

    Minimises the sum of Huber's function of y_right - y_left by Gauss-Newton with weights. The
    turn of the baseline is added only if that helps, too. What helps is decided on matches that
    were not used: each half is judged by the turns that the other half gives. So a pair that is
    good already stays as it is.

    Source: Huber, Annals of Mathematical Statistics 1964.

    Args:
        matches: of the rectified views.
        geometry: of the same views.

    Returns:
        A correction; it changes nothing if the matches are too few or the gain is not significant.

    Raises:
        ValueError: if the rows ask for a turn of more than 5 degrees.
    """
    rays = _rays(matches, geometry)
    before = _mean_absolute(_residual(np.zeros(3), *rays, geometry.focal_px))
    best = RowCorrection(before_px=before, after_px=before)
    if len(matches) < 2 * LEAST_MATCHES:
        return best
    reached = before
    for free in MODELS:
        unseen = _unseen(rays, geometry.focal_px, free)
        if reached - unseen < max(LEAST_GAIN_PX, LEAST_GAIN * reached):
            continue
        turns = _fitted(rays, geometry.focal_px, free)
        after = _mean_absolute(_residual(turns, *rays, geometry.focal_px))
        pitch, roll, baseline_roll = turns.tolist()
        best = RowCorrection(pitch, roll, baseline_roll, before, after)
        reached = unseen
    largest = max(abs(turn) for turn in (best.pitch, best.roll, best.baseline_roll))
    if largest > LARGEST_TURN:
        raise ValueError(
            f"the rows ask for a turn of {np.degrees(largest):.1f} degrees, which is no drift of a "
            "calibration; is it that of another rig, or is a picture rotated? Calibrate again"
        )
    return best


def corrected_rig(rectifier: Rectifier, correction: RowCorrection) -> StereoCalibration:
    """Return the calibration of the raw pairs whose rectified rows agree better.

    With R_l and R_r the rotations of the rectifier and C_l and C_r those of the correction, a
    point x of the left camera is R_r^T C_r^T C_l R_l x + R_r^T C_r^T R_r t in the right one.

    Args:
        rectifier: of the views that the correction was estimated on.
        correction: of their rows.
    """
    (left, right), (of_left, of_right) = rectifier.rotations, correction.rotations
    new_left, new_right = of_left @ left, of_right @ right
    rig = rectifier.calibration
    pose = Pose(new_right.T @ new_left, new_right.T @ right @ rig.right_from_left.t)
    return StereoCalibration(rig.left, rig.right, pose)


def corrected_pair(pair: RectifiedPair, correction: RowCorrection) -> RectifiedPair:
    """Return the pair with both views turned, each by the homography K C K^-1.

    Args:
        pair: rectified.
        correction: of its rows.

    Returns:
        Views of the same geometry; black where nothing was seen.
    """
    geometry = pair.geometry
    centres = geometry.centre_left, geometry.centre_right
    left, right = (
        _turned(image, rotation, geometry.focal_px, centre)
        for image, rotation, centre in zip(
            (pair.left, pair.right), correction.rotations, centres, strict=True
        )
    )
    return RectifiedPair(left, right, geometry)


def _rotations(turns: Array) -> tuple[Array, Array]:
    """Return the (3, 3) rotations of left and right for (pitch, roll, baseline roll)."""
    pitch, roll, baseline_roll = turns.tolist()
    both = _rotation(0.0, 0.0, baseline_roll)
    return both, both @ _rotation(pitch, 0.0, roll)


def _rotation(*turn: float) -> Array:
    return np.asarray(cv2.Rodrigues(np.array(turn))[0], dtype=np.float64)


def _rays(matches: Matches, geometry: RectifiedGeometry) -> tuple[Array, Array]:
    """Return two (N, 3), the rays of the matches in the frames of left and right, at z = 1."""
    ones = np.ones((len(matches), 1))
    left = (matches.left - geometry.centre_left) / geometry.focal_px
    right = (matches.right - geometry.centre_right) / geometry.focal_px
    return np.hstack([left, ones]), np.hstack([right, ones])


def _residual(turns: Array, left: Array, right: Array, focal_px: float) -> Array:
    """Return (N,), y_right - y_left in pixels after the turns."""
    of_left, of_right = _rotations(turns)
    left, right = left @ of_left.T, right @ of_right.T
    difference: Array = right[:, 1] / right[:, 2] - left[:, 1] / left[:, 2]
    return focal_px * difference


def _fitted(rays: tuple[Array, Array], focal_px: float, free: int) -> Array:
    """Return (3,), the turns of which the first `free` were estimated."""
    turns = np.zeros(3)
    for _ in range(STEPS):
        residual = _residual(turns, *rays, focal_px)
        steps = STEP_SIZE * np.eye(3)[:free]
        ahead = [_residual(turns + step, *rays, focal_px) for step in steps]
        J = (np.stack(ahead, axis=1) - residual[:, None]) / STEP_SIZE  # (N, free)
        weight = np.sqrt(HUBER_PX / np.maximum(np.abs(residual), HUBER_PX))
        step, *_ = np.linalg.lstsq(J * weight[:, None], -residual * weight, rcond=None)
        turns[:free] += step
        if np.abs(step).max() < CONVERGED:
            break
    return turns


def _unseen(rays: tuple[Array, Array], focal_px: float, free: int) -> float:
    """Return the mean absolute residual of each half after the turns that the other half gives."""
    halves = [(rays[0][start::2], rays[1][start::2]) for start in (0, 1)]
    residuals = [
        _residual(_fitted(used, focal_px, free), *judged, focal_px)
        for used, judged in (halves, halves[::-1])
    ]
    return _mean_absolute(np.concatenate(residuals))


def _mean_absolute(values: Array) -> float:
    return float(np.abs(values).mean()) if len(values) else 0.0


def _turned(image: Image, C: Array, focal_px: float, centre: tuple[float, float]) -> Image:
    K = np.array([[focal_px, 0, centre[0]], [0, focal_px, centre[1]], [0, 0, 1]])
    if np.array_equal(C, np.eye(3)):
        return image
    height, width = image.shape[:2]
    warped = cv2.warpPerspective(image, K @ C @ np.linalg.inv(K), (width, height))
    return np.asarray(warped, dtype=np.uint8)
