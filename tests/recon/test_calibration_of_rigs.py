"""Rigs that others calibrated: photographs of boards with published results."""

import numpy as np
import pytest

from recon.calibration import calibrate

pytestmark = pytest.mark.slow


def estimated(datasets, folder, board, model):
    place = datasets / "calibration" / folder
    return calibrate(str(place / "left"), str(place / "right"), board, model=model).estimate


def test_a_wide_rig_before_a_charuco_board(datasets):
    board = "charuco:31x16:49.33mm:38.46mm:DICT_4X4_1000"

    estimate = estimated(datasets, "charuco-wideangle", board, "rational")

    published_m = np.linalg.norm([-75.0, 1.24, -0.55]) / 1000
    assert estimate.calibration.baseline_m == pytest.approx(published_m, rel=0.005)
    assert estimate.adjusted.rms_px <= 0.34


def test_the_chessboards_of_opencvs_samples(datasets):
    estimate = estimated(datasets, "opencv-chessboard", "chessboard:9x6:25mm", "pinhole")

    assert estimate.adjusted.rms_px <= 0.23
    assert len(estimate.names) >= 13
    squares = estimate.calibration.baseline_m / 0.025
    assert squares == pytest.approx(3.33, rel=0.01)
    assert estimate.calibration.left.K[0, 0] == pytest.approx(534, rel=0.01)


def test_a_small_rig_with_blurred_pictures(datasets):
    estimate = estimated(datasets, "stereopi-chessboard", "chessboard:9x6:25mm", "pinhole")

    assert estimate.adjusted.rms_px <= 0.42
    assert estimate.calibration.baseline_m == pytest.approx(0.0574, rel=0.01)
