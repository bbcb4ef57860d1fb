"""From the cameras that a file holds to a rig, and back."""

from __future__ import annotations

import numpy as np

from calib.camera import Camera
from calib.formats.protocol import Array
from calib.formats.record import CalibrationRecord
from calib.pose import Pose
from calib.rectify import Rectifier
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = [
    "ALREADY_RECTIFIED",
    "as_rig",
    "left_first",
    "projections",
    "rectification",
    "rectified_already",
]

TOLERANCE = 1e-9  # of sines, of the baseline, and in pixels
ALREADY_RECTIFIED = (
    "the cameras have no lens distortion and look straight ahead side by side: "
    "the images were taken as rectified"
)


def left_first(
    first: Camera, second: Camera, second_from_first: Pose, names: tuple[str, str]
) -> tuple[StereoCalibration, tuple[str, ...]]:
    """Return the rig of two cameras in any order, and a note if they had to change places.

    The centre of the second camera in the frame of the first is -R^T t; the first is the left one
    if that has x > 0.

    Args:
        first: one camera.
        second: the other.
        second_from_first: the pose between them, metres.
        names: of both, for the note.
    """
    if second_from_first.inverse().t[0] >= 0:
        return StereoCalibration(first, second, second_from_first), ()
    return StereoCalibration(second, first, second_from_first.inverse()), (
        f"{names[1]} stands to the left of {names[0]}: it was taken as the left camera",
    )


def rectified_already(rig: StereoCalibration) -> RectifiedGeometry | None:
    """Return the geometry of a rig whose raw rows agree; None if they do not.

    They do where neither camera has a lens distortion nor is turned, the right one stands on the
    x axis of the left one, and the focal lengths and the rows of the principal points agree.
    """
    cameras, pose = (rig.left, rig.right), rig.right_from_left
    if any(camera.distortion.any() or camera.model == "fisheye" for camera in cameras):
        return None
    turned = np.abs(pose.R - np.eye(3)).max()
    off_axis = np.abs(pose.t[1:]).max() / rig.baseline_m
    apart = max(abs(rig.left.K[1, 1:] - rig.right.K[1, 1:]).max(), _focal_spread(rig))
    if max(turned, off_axis, apart) > TOLERANCE or pose.t[0] > 0:
        return None
    return RectifiedGeometry(
        size=rig.left.size,
        focal_px=float(rig.left.K[0, 0]),
        centre_left=(float(rig.left.K[0, 2]), float(rig.left.K[1, 2])),
        centre_right=(float(rig.right.K[0, 2]), float(rig.right.K[1, 2])),
        baseline_m=rig.baseline_m,
    )


def _focal_spread(rig: StereoCalibration) -> float:
    focals = [camera.K[axis, axis] for camera in (rig.left, rig.right) for axis in (0, 1)]
    return float(max(focals) - min(focals))


def as_rig(record: CalibrationRecord) -> StereoCalibration:
    """Return the raw cameras of a record, or the ideal ones that its rectified geometry means."""
    if record.raw is not None:
        return record.raw
    geometry = record.rectified
    assert geometry is not None  # a record holds one of them
    f = geometry.focal_px
    left, right = (
        Camera(geometry.size, np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]), np.zeros(0))
        for cx, cy in (geometry.centre_left, geometry.centre_right)
    )
    return StereoCalibration(left, right, Pose(np.eye(3), np.array([-geometry.baseline_m, 0, 0])))


def rectification(record: CalibrationRecord) -> tuple[Array, Array, RectifiedGeometry]:
    """Return the (3, 3) rotations that rectify both cameras of a record, and what they lead to.

    A record keeps no rotations, whatever its file said of them: they are those of `Rectifier`.
    The geometry is the record's own where it has one.
    """
    if record.raw is None:
        assert record.rectified is not None  # a record holds one of them
        return np.eye(3), np.eye(3), record.rectified
    rectifier = Rectifier(record.raw)
    left, right = rectifier.rotations
    return left, right, record.rectified or rectifier.geometry


def projections(geometry: RectifiedGeometry) -> tuple[Array, Array]:
    """Return the (3, 4) projections of both views, metres; the right one has -f B at its end."""
    f = geometry.focal_px
    left, right = (
        np.array([[f, 0, cx, shift], [0, f, cy, 0], [0, 0, 1, 0]])
        for (cx, cy), shift in (
            (geometry.centre_left, 0.0),
            (geometry.centre_right, -geometry.baseline_m * f),
        )
    )
    return left, right
