"""Kalibr's `camchain.yaml`: every camera with its lens and its pose from the one before.

Source: ethz-asl/kalibr, wiki pages "Yaml formats" and "Supported models".
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.camera import Camera, CameraModel
from calib.formats.protocol import Array, CalibrationFile, Reader, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import ALREADY_RECTIFIED, as_rig, left_first, rectified_already
from calib.formats.section import Section
from calib.formats.yaml_text import load_yaml
from calib.pose import Pose, nearest_rotation

__all__ = ["KALIBR_READER", "KALIBR_WRITER"]

NAME = "kalibr"
MARKS = re.compile(r"^(cam\d+\s*:|\s*(T_cn_cnm1|distortion_coeffs)\s*:)", re.MULTILINE)
CAMERA = re.compile(r"cam\d+")
# The lens model and how many coefficients Kalibr gives it.
LENSES: dict[str, tuple[CameraModel, int]] = {
    "radtan": ("pinhole", 4),
    "equidistant": ("fisheye", 4),
    "equi": ("fisheye", 4),
    "none": ("pinhole", 0),
}
RADTAN_COEFFICIENTS = 4
LAST_ROW = np.array([0.0, 0, 0, 1])


def _recognises(file: CalibrationFile) -> bool:
    return MARKS.search(file.text) is not None


def _read(file: CalibrationFile) -> CalibrationRecord:
    content = load_yaml(file.text)
    if not isinstance(content, dict):
        raise ValueError(f"expected cam0: and cam1:, got {content!r}")  # noqa: TRY004  a user's mistake
    chain = Section(content)
    first, second = chain.section("cam0"), chain.section("cam1")
    pose = _second_from_first(first, second)
    metres = file.metres_as_defined(float(np.linalg.norm(pose.t)), "Kalibr")
    cameras = _camera(first, file), _camera(second, file)
    rig, notes = left_first(*cameras, Pose(pose.R, pose.t * metres), ("cam0", "cam1"))
    others = [name for name in content if CAMERA.fullmatch(name) and name not in ("cam0", "cam1")]
    if others:
        notes += (f"cam0 and cam1 were taken, not {', '.join(others)}",)
    geometry = rectified_already(rig)
    if geometry is not None:
        notes += (ALREADY_RECTIFIED,)
    raw = rig if geometry is None else None
    return CalibrationRecord(raw, geometry, file.path, NAME, notes=notes)


def _second_from_first(first: Section, second: Section) -> Pose:
    """Return the pose of cam1 from cam0, given itself or through the inertial unit."""
    if "T_cn_cnm1" not in second and "T_cam_imu" in first and "T_cam_imu" in second:
        return _pose(second, "T_cam_imu") @ _pose(first, "T_cam_imu").inverse()
    return _pose(second, "T_cn_cnm1")


def _pose(section: Section, key: str) -> Pose:
    matrix = section.array(key, (4, 4))
    if not np.array_equal(matrix[3], LAST_ROW):
        raise ValueError(
            f"{section.place}{key} must end with 0 0 0 1, got {matrix[3].tolist()}; "
            "is it transposed?"
        )
    try:
        return Pose(nearest_rotation(matrix[:3, :3]), matrix[:3, 3])
    except ValueError as error:
        raise ValueError(f"{section.place}{key}: {error}") from error


def _camera(section: Section, file: CalibrationFile) -> Camera:
    kind = section.text("camera_model")
    if kind != "pinhole":
        raise ValueError(
            f"{section.place}camera_model must be pinhole, got {kind!r}; calibrate again with "
            "--models pinhole-radtan or, for a fisheye, pinhole-equi"
        )
    model, count = _lens_model(section)
    fx, fy, cx, cy = section.array("intrinsics", (4,))
    size = file.size_or_given(section.size("resolution") if "resolution" in section else None)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    lens = section.array("distortion_coeffs", (count,)) if count else np.zeros(0)
    return Camera(size, K, lens, model)


def _lens_model(section: Section) -> tuple[CameraModel, int]:
    # `none` without quotes is a word; an empty value means the same.
    name = section.text("distortion_model") if "distortion_model" in section else "none"
    if name not in LENSES:
        raise ValueError(
            f"{section.place}distortion_model must be radtan, equidistant or none, got {name!r}; "
            "calibrate again with --models pinhole-radtan or pinhole-equi"
        )
    return LENSES[name]


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    rig = as_rig(record)
    pose = np.vstack([np.column_stack([rig.right_from_left.R, rig.right_from_left.t]), LAST_ROW])
    rows = "".join(f"  - {row.tolist()}\n" for row in pose)
    return {
        path: f"cam0:\n{_text(rig.left, 0, 1)}cam1:\n  T_cn_cnm1:\n{rows}{_text(rig.right, 1, 0)}"
    }


def _text(camera: Camera, number: int, other: int) -> str:
    K = camera.K
    name, lens = _lens(camera)
    return (
        f"  cam_overlaps: [{other}]\n  camera_model: pinhole\n"
        f"  distortion_coeffs: {lens.tolist()}\n  distortion_model: {name}\n"
        f"  intrinsics: {[float(x) for x in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]}\n"
        f"  resolution: {list(camera.size)}\n  rostopic: /cam{number}/image_raw\n"
    )


def _lens(camera: Camera) -> tuple[str, Array]:
    if camera.model == "fisheye":
        return "equidistant", camera.distortion
    if camera.distortion[RADTAN_COEFFICIENTS:].any():
        raise ValueError(
            "Kalibr's radtan lens has k1, k2, p1 and p2 only, but the camera has more: "
            f"{camera.distortion.tolist()}; write .json, ROS or OpenCV's .yml instead"
        )
    if camera.distortion.size == 0:
        return "none", camera.distortion
    return "radtan", camera.distortion[:RADTAN_COEFFICIENTS]


KALIBR_READER = Reader(
    looks_like="Kalibr camchain: YAML with cam0: and cam1:, intrinsics:, T_cn_cnm1: and so on",
    recognises=_recognises,
    read=_read,
)
KALIBR_WRITER = Writer(suffixes=(".yaml", ".yml"), render=_render)
