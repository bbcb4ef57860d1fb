"""What two calibrations have in common, asked of the pixels that they see."""

import cv2
import numpy as np
from lenses import rotation

from calib import Pose, StereoCalibration

POINTS = np.random.default_rng(3).uniform((-0.5, -0.4, 1.5), (0.5, 0.4, 4), (40, 3))
"""(40, 3), metres in the frame of a left camera, in front of it."""


def assert_see_alike(one, other, *, tolerance_px=1e-9):
    """Check that both rigs see `POINTS` in the same pixels, and have the same pose in metres."""
    for came, expected in ((one.left, other.left), (one.right, other.right)):
        assert (came.size, came.model) == (expected.size, expected.model)
        pixels = expected.project(POINTS)
        assert np.isfinite(pixels).all()
        np.testing.assert_allclose(came.project(POINTS), pixels, rtol=0, atol=tolerance_px)
    np.testing.assert_allclose(one.right_from_left.R, other.right_from_left.R, atol=1e-12)
    np.testing.assert_allclose(one.right_from_left.t, other.right_from_left.t, atol=1e-12)


def seen_by(model, K, distortion, points):
    """Return the pixels (N, 2) of points in the frame of a camera, as OpenCV projects them."""
    still = np.zeros(3)
    distortion = np.array(distortion, dtype=float)
    if model == "fisheye":
        pixels = cv2.fisheye.projectPoints(points[:, None], still, still, K, distortion)[0]
    else:
        pixels = cv2.projectPoints(points, still, still, K, distortion)[0]
    return pixels.reshape(-1, 2)


def rectified_pixels(model, K, distortion, R, P, pixels):
    """Return where raw pixels (N, 2) lie after rectification by R and P, as OpenCV has it."""
    undistort = cv2.fisheye.undistortPoints if model == "fisheye" else cv2.undistortPoints
    distortion = np.array(distortion, dtype=float)
    return undistort(pixels[:, None], K, distortion, R=R, P=P[:, :3]).reshape(-1, 2)


def turned(rig, rng, *, spread):
    """Return the rig with a random rotation, the right camera still at the right of the left."""
    R = rotation(*rng.normal(scale=spread, size=3))
    centre = np.array([0.12, *rng.normal(scale=0.01, size=2)])
    return StereoCalibration(rig.left, rig.right, Pose(R, -R @ centre))
