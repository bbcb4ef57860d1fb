"""XML with one element a number, `distorted_left_intrinsic` and `stereo_extrinsic`."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from calib.camera import Camera
from calib.formats.protocol import Array, CalibrationFile, Reader, as_numbers
from calib.formats.record import CalibrationRecord
from calib.pose import Pose, nearest_rotation
from calib.rig import StereoCalibration

__all__ = ["TAGGED_XML_READER"]

NAME = "tagged_xml"


def _recognises(file: CalibrationFile) -> bool:
    return "<distorted_left_intrinsic" in file.text


def _read(file: CalibrationFile) -> CalibrationRecord:
    try:
        root = ElementTree.fromstring(file.text)
    except ElementTree.ParseError as error:
        raise ValueError(f"not valid XML ({error}); is the file cut off?") from error
    t = _numbers(root, "stereo_extrinsic/translation", 3)
    R = nearest_rotation(_numbers(root, "stereo_extrinsic/rotation", 9).reshape(3, 3))
    metres, notes = file.metres_per_unit(float(np.linalg.norm(t)))
    size = file.size_or_given(None)
    left, right = (_camera(root, f"distorted_{side}_intrinsic", size) for side in ("left", "right"))
    raw = StereoCalibration(left, right, Pose(R, t * metres))
    return CalibrationRecord(raw, None, file.path, NAME, notes=notes)


def _camera(root: ElementTree.Element, element: str, size: tuple[int, int]) -> Camera:
    fx, fy, cx, cy = (_numbers(root, f"{element}/{key}", 1)[0] for key in ("fx", "fy", "cx", "cy"))
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return Camera(size, K, _numbers(root, f"{element}/dist", 5))


def _numbers(root: ElementTree.Element, element: str, count: int) -> Array:
    text = root.findtext(element)
    if text is None:
        raise ValueError(f"there is no element <{element.replace('/', '> <')}>")
    return as_numbers(text, count, element)


TAGGED_XML_READER = Reader(
    looks_like="tagged XML: elements <distorted_left_intrinsic>, <stereo_extrinsic> and so on",
    recognises=_recognises,
    read=_read,
)
