"""ROS `camera_info`, written as one YAML for each camera.

Source: ros-perception/image_common, camera_calibration_parsers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.camera import Camera
from calib.formats.protocol import Array, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import as_rig, projections, rectification
from calib.formats.sides import other_side
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["ROS_WRITER"]

PLUMB_BOB_COEFFICIENTS, RATIONAL_COEFFICIENTS = 5, 8
BASELINE_TOLERANCE = 1e-3  # relative


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    candidates = other_side(path)
    if not candidates:
        raise ValueError(
            "ROS has one file a camera, and the name must say which: left.yaml for instance, then "
            f"right.yaml is written beside it; got {path.name}"
        )
    other, other_is_right = next(iter(candidates.items()))
    left, right = (path, other) if other_is_right else (other, path)
    rig = as_rig(record)
    R_left, R_right, geometry = rectification(record)
    _check_agreement(rig, geometry)
    P_left, P_right = projections(geometry)
    return {
        left: _text("left", rig.left, R_left, P_left),
        right: _text("right", rig.right, R_right, P_right),
    }


def _check_agreement(rig: StereoCalibration, geometry: RectifiedGeometry) -> None:
    """Raise ValueError unless raw and rectified images have one size and one baseline."""
    if rig.left.size != geometry.size:
        raise ValueError(
            f"ROS files hold one image size, but the raw images have {rig.left.size} pixels and "
            f"the rectified ones {geometry.size} (width, height); write .json instead"
        )
    if abs(rig.baseline_m - geometry.baseline_m) > BASELINE_TOLERANCE * rig.baseline_m:
        raise ValueError(
            f"the raw cameras stand {rig.baseline_m:g} m apart but the rectified ones "
            f"{geometry.baseline_m:g} m; are they of one rig?"
        )


def _text(name: str, camera: Camera, R: Array, P: Array) -> str:
    model, lens = _lens(camera)
    width, height = camera.size
    matrices = {
        "camera_matrix": camera.K,
        "distortion_coefficients": lens[None],
        "rectification_matrix": R,
        "projection_matrix": P,
    }
    blocks = {
        key: f"{key}:\n  rows: {matrix.shape[0]}\n  cols: {matrix.shape[1]}\n"
        f"  data: {matrix.ravel().tolist()}\n"
        for key, matrix in matrices.items()
    }
    return (
        f"image_width: {width}\nimage_height: {height}\ncamera_name: {name}\n"
        f"{blocks['camera_matrix']}distortion_model: {model}\n"
        f"{blocks['distortion_coefficients']}{blocks['rectification_matrix']}"
        f"{blocks['projection_matrix']}"
    )


def _lens(camera: Camera) -> tuple[str, Array]:
    """Return ROS's name of a lens model, and the coefficients as many as it has."""
    if camera.model == "fisheye":
        return "equidistant", camera.distortion
    count = camera.distortion.size
    if count > RATIONAL_COEFFICIENTS:
        raise ValueError(
            f"ROS's lens models have up to {RATIONAL_COEFFICIENTS} coefficients, the camera has "
            f"{count}; write .json or OpenCV's .yml instead"
        )
    if count > PLUMB_BOB_COEFFICIENTS:
        return "rational_polynomial", camera.distortion
    return "plumb_bob", np.pad(camera.distortion, (0, PLUMB_BOB_COEFFICIENTS - count))


ROS_WRITER = Writer(suffixes=(".yaml", ".yml"), render=_render)
