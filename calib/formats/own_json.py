"""This project's own file: JSON with the units in the names, read back exactly as written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from calib.camera import Camera
from calib.formats.protocol import CalibrationFile, Reader, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.section import Section
from calib.pose import Pose, nearest_rotation
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["OWN_JSON_READER", "OWN_JSON_WRITER"]

NAME = "json"
MARK = "stereo-recon calibration"
VERSION = 1

Plain = dict[str, Any]


def _recognises(file: CalibrationFile) -> bool:
    return file.text.lstrip().startswith("{") and MARK in file.text


def _read(file: CalibrationFile) -> CalibrationRecord:
    try:
        content = Section(json.loads(file.text))
    except json.JSONDecodeError as error:
        raise ValueError(f"not valid JSON ({error}); is the file cut off?") from error
    version = content.value("version")
    if version != VERSION:
        raise ValueError(f"version is {version!r} but this program reads {VERSION}; update it?")
    raw = _rig(content.section("raw")) if "raw" in content else None
    rectified = _geometry(content.section("rectified")) if "rectified" in content else None
    disparities = None
    if "disparities_px" in content:
        first, end = content.size("disparities_px")
        disparities = range(first, end)
    return CalibrationRecord(raw, rectified, file.path, NAME, disparities=disparities)


def _rig(section: Section) -> StereoCalibration:
    pose = section.section("right_from_left")
    R = nearest_rotation(pose.array("R", (3, 3)))
    return StereoCalibration(
        left=_camera(section.section("left")),
        right=_camera(section.section("right")),
        right_from_left=Pose(R, pose.array("t_m", (3,))),
    )


def _camera(section: Section) -> Camera:
    return Camera(
        size=section.size("size_px"),
        K=section.array("K_px", (3, 3)),
        distortion=section.array("distortion", (-1,)),
        model=section.value("model"),
    )


def _geometry(section: Section) -> RectifiedGeometry:
    return RectifiedGeometry(
        size=section.size("size_px"),
        focal_px=section.number("focal_px"),
        centre_left=section.pair("centre_left_px"),
        centre_right=section.pair("centre_right_px"),
        baseline_m=section.number("baseline_m"),
    )


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    content: Plain = {"format": MARK, "version": VERSION}
    if record.raw is not None:
        content["raw"] = _plain_rig(record.raw)
    if record.rectified is not None:
        content["rectified"] = _plain_geometry(record.rectified)
    if record.disparities is not None:
        content["disparities_px"] = [record.disparities.start, record.disparities.stop]
    return {path: json.dumps(content, indent=2) + "\n"}


def _plain_rig(rig: StereoCalibration) -> Plain:
    pose = rig.right_from_left
    return {
        "left": _plain_camera(rig.left),
        "right": _plain_camera(rig.right),
        "right_from_left": {"R": pose.R.tolist(), "t_m": pose.t.tolist()},
    }


def _plain_camera(camera: Camera) -> Plain:
    return {
        "model": camera.model,
        "size_px": list(camera.size),
        "K_px": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
    }


def _plain_geometry(geometry: RectifiedGeometry) -> Plain:
    return {
        "size_px": list(geometry.size),
        "focal_px": geometry.focal_px,
        "centre_left_px": list(geometry.centre_left),
        "centre_right_px": list(geometry.centre_right),
        "baseline_m": geometry.baseline_m,
    }


OWN_JSON_READER = Reader(
    looks_like=f'stereo-recon JSON: {{"format": "{MARK}", "version": {VERSION}, ...}}',
    recognises=_recognises,
    read=_read,
)
OWN_JSON_WRITER = Writer(suffixes=(".json",), render=_render)
