"""ROS `camera_info`: one YAML for each camera, read as camera_calibration writes it.

Also one file with both under `left:` and `right:`, and the CameraInfo message as `rostopic echo`
and `ros2 topic echo` print it.

Source: ros-perception/image_common, camera_calibration_parsers (the files), and the comments of
sensor_msgs/CameraInfo (what K, D, R and P mean).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.camera import Camera, CameraModel
from calib.formats.protocol import Array, CalibrationFile, Reader
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import ALREADY_RECTIFIED, rectified_already
from calib.formats.section import Section
from calib.formats.sides import other_side
from calib.formats.yaml_text import load_yaml
from calib.pose import Pose, nearest_rotation
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["ROS_READER"]

NAME = "ros"
FILE_MARKS = re.compile(
    r"^\s*(image_width|camera_matrix|rectification_matrix|projection_matrix)\s*:", re.MULTILINE
)
MESSAGE_MARKS = re.compile(r"^\s*distortion_model\s*:.*^\s*[DKRP]\s*:", re.I | re.M | re.S)
OPENCV_MARKS = ("opencv-matrix", "%YAML:")
WHOLE = ("left", "right")
SHAPES = {"K": (3, 3), "R": (3, 3), "P": (3, 4)}
NAMES_IN_FILES = {
    "width": "image_width",
    "height": "image_height",
    "K": "camera_matrix",
    "D": "distortion_coefficients",
    "R": "rectification_matrix",
    "P": "projection_matrix",
}
MODELS: dict[str, CameraModel] = {
    "plumb_bob": "pinhole",
    "rational_polynomial": "pinhole",
    "equidistant": "fisheye",
    "fisheye": "fisheye",  # the same in ROS 2
}


@dataclass(frozen=True, eq=False)
class _View:
    """What ROS says of one camera.

    Attributes:
        camera: with its lens.
        R: (3, 3), turns points of the raw camera frame into the rectified one.
        P: (3, 4), projects points of the rectified frame of the left camera; metres.
    """

    camera: Camera
    R: Array
    P: Array

    @property
    def from_left(self) -> Array:
        """Return (3,), what carries points from the left rectified frame into this one."""
        return np.asarray(np.linalg.solve(self.P[:, :3], self.P[:, 3]), dtype=np.float64)


def _recognises(file: CalibrationFile) -> bool:
    return _is_ros(file.text)


def _is_ros(text: str) -> bool:
    if any(mark in text for mark in OPENCV_MARKS):
        return False
    return FILE_MARKS.search(text) is not None or MESSAGE_MARKS.search(text) is not None


def _read(file: CalibrationFile) -> CalibrationRecord:
    left, right = _pair(file)
    shift = right.from_left - left.from_left
    baseline = float(np.linalg.norm(shift))
    if baseline == 0:
        raise ValueError(
            "P of the right camera has no -f B in its last column; were the cameras calibrated "
            "one by one? Calibrate them together, as a stereo pair"
        )
    metres = file.metres_as_defined(baseline, "ROS")
    rectified, notes = _rectified(left, right, shift, metres)
    # x_right = R_r^T (R_l x_left + shift)
    pose = Pose(nearest_rotation(right.R.T @ left.R), right.R.T @ shift * metres)
    raw = StereoCalibration(left.camera, right.camera, pose)
    if rectified_already(raw) is not None and all(
        np.array_equal(view.camera.K, view.P[:, :3]) for view in (left, right)
    ):
        return CalibrationRecord(None, rectified, file.path, NAME, notes=(ALREADY_RECTIFIED,))
    return CalibrationRecord(raw, rectified, file.path, NAME, notes=notes)


def _rectified(
    left: _View, right: _View, shift: Array, metres: float
) -> tuple[RectifiedGeometry | None, tuple[str, ...]]:
    """Return the geometry that P describes; None, and why, if it is not that of a rectified pair.

    Some drivers put the raw camera matrices into P: the raw cameras are of use all the same.

    Raises:
        ValueError: if the cameras are swapped or stand one above the other.
    """
    scale = np.array([1, 1, 1, metres])
    try:
        return RectifiedGeometry.from_projections(
            left.P * scale, right.P * scale, left.camera.size
        ), ()
    except ValueError as error:
        if -shift[0] < abs(shift[1]):
            raise
        return None, (f"only the raw cameras were taken, projection_matrix has {error}",)


def _pair(file: CalibrationFile) -> tuple[_View, _View]:
    """Return the left and the right camera of a file, or of a file and its other half."""
    content = _content(file.text)
    if any(side in content for side in WHOLE):
        left, right = (_view(content.section(side)) for side in WHOLE)
        return left, right
    candidates = other_side(file.path)
    if not candidates:
        raise ValueError(
            "the file holds one camera and its name does not say which; call the two files "
            "left.yaml and right.yaml, or put both cameras in one under left: and right:"
        )
    for path, is_right in candidates.items():
        if path.is_file():
            this, other = _view(content), _other_view(path)
            return (this, other) if is_right else (other, this)
    expected = " or ".join(f"{path.parent.name}/{path.name}" for path in candidates)
    raise ValueError(
        f"the file holds one camera; expected the other one in {expected}, but there is no such "
        f"file; copy it beside {file.path.name}"
    )


def _content(text: str) -> Section:
    content = load_yaml(text)
    if not isinstance(content, dict):
        raise ValueError(f"expected 'key: value' lines of a camera_info, got {content!r}")  # noqa: TRY004  a user's mistake
    return Section(content)


def _other_view(path: Path) -> _View:
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    try:
        if not _is_ros(text):
            raise ValueError("it is no camera_info")  # noqa: TRY301  named below, like its other faults
        return _view(_content(text))
    except ValueError as error:
        raise ValueError(f"in the other camera's file {path.name}: {error}") from error


def _view(section: Section) -> _View:
    _check_whole_image(section)
    size = tuple(int(section.number(_name(section, key))) for key in ("width", "height"))
    K, R, P = (_matrix(section, _name(section, key), shape) for key, shape in SHAPES.items())
    for key, matrix in (("K", K), ("P", P)):
        if np.linalg.det(matrix[:, :3]) == 0:
            raise ValueError(
                f"{section.place}{_name(section, key)} has no inverse, got {matrix.tolist()}; is "
                "the camera not calibrated, or the file damaged?"
            )
    model = _model(section)
    lens = _matrix(section, _name(section, "D"), (-1,))
    try:
        return _View(Camera((size[0], size[1]), K, lens, model), nearest_rotation(R), P)
    except ValueError as error:
        raise ValueError(f"{section.place}{error}") from error


def _name(section: Section, key: str) -> str:
    """Return what a value is called: in a file, in a message of ROS 2, or in one of ROS 1."""
    for name in (NAMES_IN_FILES[key], key.lower(), key):
        if name in section.entries:
            return name
    return NAMES_IN_FILES[key]


def _matrix(section: Section, name: str, shape: tuple[int, ...]) -> Array:
    """Return a matrix given as rows, cols and data, or as its numbers in a row."""
    if not isinstance(section.value(name), dict):
        count = int(np.prod(shape)) if min(shape) > 0 else -1
        return section.array(name, (count,)).reshape(shape)
    inner = section.section(name)
    rows, columns = int(inner.number("rows")), int(inner.number("cols"))
    numbers = inner.array("data", (-1,))
    if numbers.size != rows * columns:
        raise ValueError(
            f"{inner.place}data must be {rows} x {columns} numbers, got {numbers.size}; "
            "is the file cut off?"
        )
    if min(shape) > 0 and (rows, columns) != shape:
        raise ValueError(
            f"{section.place}{name} must be {shape[0]} x {shape[1]}, got {rows} x {columns}"
        )
    return numbers.reshape(shape)


def _model(section: Section) -> CameraModel:
    if "distortion_model" not in section or section.value("distortion_model") == "":
        return "pinhole"  # as ROS itself does
    name = section.text("distortion_model")
    if name not in MODELS:
        raise ValueError(
            f"{section.place}distortion_model must be {', '.join(MODELS)}; got {name!r}; "
            "calibrate with one of these"
        )
    return MODELS[name]


def _check_whole_image(section: Section) -> None:
    """Raise ValueError if a message is of cropped or binned images: K and P are not for these."""
    binned = any(
        name in section and section.number(name) > 1 for name in ("binning_x", "binning_y")
    )
    region = section.section("roi") if "roi" in section else Section({})
    cropped = any(name in region and region.number(name) != 0 for name in ("x_offset", "y_offset"))
    if binned or cropped:
        raise ValueError(
            f"{section.place}the images were binned or cropped in the camera, while K and P are "
            "for the whole ones; take the camera_info of unbinned, whole images"
        )


ROS_READER = Reader(
    looks_like="ROS camera_info: YAML with camera_matrix:, ..., projection_matrix:, left and right",
    recognises=_recognises,
    read=_read,
)
