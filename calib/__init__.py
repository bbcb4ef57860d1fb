"""Where the cameras are: poses, lenses, rectification and calibration files."""

from calib.camera import Camera, CameraModel
from calib.formats import CalibrationRecord, LengthUnit, read_calibration, write_calibration
from calib.pair import Image, RectifiedPair, StereoPair
from calib.pose import Pose
from calib.rectify import Rectifier
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = [
    "CalibrationRecord",
    "Camera",
    "CameraModel",
    "Image",
    "LengthUnit",
    "Pose",
    "RectifiedGeometry",
    "RectifiedPair",
    "Rectifier",
    "StereoCalibration",
    "StereoPair",
    "read_calibration",
    "write_calibration",
]
