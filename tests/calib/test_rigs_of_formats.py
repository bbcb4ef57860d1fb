from dataclasses import replace

import numpy as np
import pytest
from lenses import rotation

from calib import Camera, Pose, RectifiedGeometry, StereoCalibration
from calib.formats.rigs import left_first, rectified_already

K = np.array([[90.0, 0, 70], [0, 90, 55], [0, 0, 1]])
IDEAL = Camera((160, 120), K, np.zeros(5))
POSE = Pose(np.eye(3), np.array([-0.1, 0, 0]))


def with_matrix(fx=90.0, fy=90.0, cy=55.0):
    return replace(IDEAL, K=np.array([[fx, 0, 72], [0, fy, cy], [0, 0, 1]]))


def test_ideal_cameras_in_line_are_rectified_already():
    rig = StereoCalibration(IDEAL, with_matrix(), POSE)

    assert rectified_already(rig) == RectifiedGeometry((160, 120), 90, (70, 55), (72, 55), 0.1)


RAW = {
    "turned": StereoCalibration(IDEAL, IDEAL, Pose(rotation(0, 1e-6, 0), POSE.t)),
    "higher": StereoCalibration(IDEAL, IDEAL, Pose(np.eye(3), np.array([-0.1, 1e-6, 0]))),
    "further": StereoCalibration(IDEAL, IDEAL, Pose(np.eye(3), np.array([-0.1, 0, 1e-6]))),
    "swapped": StereoCalibration(IDEAL, IDEAL, POSE.inverse()),
    "bent": StereoCalibration(replace(IDEAL, distortion=[0, 0, 0, 0, 1e-6]), IDEAL, POSE),
    "bent_right": StereoCalibration(IDEAL, replace(IDEAL, distortion=[1e-6, 0, 0, 0]), POSE),
    "fisheye": StereoCalibration(*[Camera((160, 120), K, np.zeros(4), "fisheye")] * 2, POSE),
    "other_width": StereoCalibration(IDEAL, with_matrix(fx=91), POSE),
    "other_height": StereoCalibration(IDEAL, with_matrix(fy=91), POSE),
    "other_row": StereoCalibration(IDEAL, with_matrix(cy=54), POSE),
}


@pytest.mark.parametrize("rig", RAW.values(), ids=RAW)
def test_any_other_rig_is_raw(rig):
    assert rectified_already(rig) is None


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_the_left_camera_is_the_one_whose_centre_lies_at_the_left(turn):
    """However the cameras are turned: centres are compared in the frame of the first."""
    other, R = with_matrix(), rotation(0, 0, turn)
    at_the_right, at_the_left = (Pose(R, -R @ [x, 0.01, 0]) for x in (0.1, -0.1))

    rig, notes = left_first(IDEAL, other, at_the_right, ("a", "b"))
    swapped, swapped_notes = left_first(IDEAL, other, at_the_left, ("a", "b"))

    assert (rig.left, rig.right, notes) == (IDEAL, other, ())
    assert (swapped.left, swapped.right) == (other, IDEAL)
    assert "b stands to the left of a" in swapped_notes[0]
    np.testing.assert_allclose(swapped.right_from_left.t, [-0.1, 0.01, 0], atol=1e-12)
