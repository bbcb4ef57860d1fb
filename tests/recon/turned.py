"""The sample pair at half its size, and what it would be if a camera had been turned."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np

from calib import (
    Camera,
    Pose,
    RectifiedPair,
    StereoCalibration,
    StereoPair,
    read_calibration,
)

SAMPLES = Path(__file__).parents[2] / "data"


def rotation(*turn):
    """Return the rotation about the vector `turn` by its length in radians."""
    return cv2.Rodrigues(np.array(turn, dtype=float))[0]


@cache
def workshop() -> RectifiedPair:
    """Return the sample pair, 360 x 270."""
    folder = SAMPLES / "workshop"
    left, right = (
        cv2.cvtColor(cv2.imread(str(folder / f"{side}.png")), cv2.COLOR_BGR2RGB)
        for side in ("left", "right")
    )
    geometry = read_calibration(folder / "rig.json").rectified
    return RectifiedPair(left, right, geometry).resized((360, 270))


def camera_matrix(geometry, side="left"):
    cx, cy = getattr(geometry, f"centre_{side}")
    return np.array([[geometry.focal_px, 0, cx], [0, geometry.focal_px, cy], [0, 0, 1]])


def warped(image, H):
    return cv2.warpPerspective(
        image, H, image.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def with_right_turned(pair, *turn) -> RectifiedPair:
    """Return what the pair would be if the right camera were turned, which nobody knows."""
    K = camera_matrix(pair.geometry, "right")
    right = warped(pair.right, K @ rotation(*turn) @ np.linalg.inv(K))
    return RectifiedPair(pair.left, right, pair.geometry)


def as_raw(pair, *, turn=(0, 0, 0), common=(0, 0, 0), believed=(0, 0, 0)) -> StereoPair:
    """Return photographs of turned cameras.

    The left camera is turned by `common`, the right by `common` and then `turn`; the calibration
    says `common` and then `believed`.
    """
    K = camera_matrix(pair.geometry)
    both = rotation(*common)
    left = warped(pair.left, K @ both @ np.linalg.inv(K))
    right = warped(pair.right, K @ rotation(*turn) @ both @ np.linalg.inv(K))
    camera = Camera(pair.geometry.size, K, np.zeros(0))
    stated = rotation(*believed)
    t = stated @ both @ [-pair.geometry.baseline_m, 0, 0]
    return StereoPair(left, right, StereoCalibration(camera, camera, Pose(stated, t)))
