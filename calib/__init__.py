"""Where the cameras are: poses, lenses, rectification and calibration files."""

from calib.camera import Camera, CameraModel
from calib.epipolar import Matches, VerticalResidual, match_views, vertical_residual
from calib.formats import CalibrationRecord, LengthUnit, read_calibration, write_calibration
from calib.pair import Image, RectifiedPair, StereoPair
from calib.pose import Pose
from calib.rectify import Rectifier
from calib.rig import RectifiedGeometry, StereoCalibration
from calib.row_correction import (
    RowCorrection,
    corrected_pair,
    corrected_rig,
    estimate_row_correction,
)

__all__ = [
    "CalibrationRecord",
    "Camera",
    "CameraModel",
    "Image",
    "LengthUnit",
    "Matches",
    "Pose",
    "RectifiedGeometry",
    "RectifiedPair",
    "Rectifier",
    "RowCorrection",
    "StereoCalibration",
    "StereoPair",
    "VerticalResidual",
    "corrected_pair",
    "corrected_rig",
    "estimate_row_correction",
    "match_views",
    "read_calibration",
    "vertical_residual",
    "write_calibration",
]
