"""KITTI's `calib_cam_to_cam.txt`, the `P0: ...` files and rows of twelve bare numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.camera import Camera
from calib.formats.protocol import Array, CalibrationFile, Reader, Writer, as_numbers
from calib.formats.record import CalibrationRecord
from calib.formats.rigs import projections, rectification
from calib.pose import Pose, nearest_rotation
from calib.rig import RectifiedGeometry, StereoCalibration

__all__ = ["KITTI_READER", "KITTI_WRITER"]

NAME = "kitti"
NAMED_ROW = re.compile(r"^\s*(P(?:_rect_0)?[0-3])\s*:", re.MULTILINE)
PAIRS = (("2", "3"), ("0", "1"))  # colour cameras first, then the grey ones
PROJECTION_NAMES = ("P_rect_0", "P")
PROJECTION_LENGTH = 12
COEFFICIENTS = 5


def _recognises(file: CalibrationFile) -> bool:
    return NAMED_ROW.search(file.text) is not None or _is_bare(file.text)


def _is_bare(text: str) -> bool:
    """Return whether every line is twelve numbers."""
    rows = [line.split() for line in text.splitlines() if line.strip()]
    numeric = re.fullmatch(r"[-+0-9.eE\s]+", text) is not None
    return numeric and all(len(row) == PROJECTION_LENGTH for row in rows)


def _read(file: CalibrationFile) -> CalibrationRecord:
    entries = _entries(file.text)
    left, right, name = _pair(entries)
    P_left, P_right = (_numbers(entries, name + camera, (3, 4)) for camera in (left, right))
    size = file.size_or_given(_size(entries, f"S_rect_0{left}"))
    geometry = RectifiedGeometry.from_projections(P_left, P_right, size)
    others = [f"{a} and {b}" for a, b in PAIRS if a != left and name + b in entries]
    notes = tuple(
        f"cameras {left} and {right} (colour) were taken, not {other} (grey)" for other in others
    )
    raw = _raw(entries, left, right)
    return CalibrationRecord(raw, geometry, file.path, NAME, notes=notes)


def _entries(text: str) -> dict[str, str]:
    lines = [line for line in text.splitlines() if line.strip()]
    if _is_bare(text):
        return {f"P{camera}": line for camera, line in enumerate(lines)}
    return {key.strip(): value for key, _, value in (line.partition(":") for line in lines)}


def _pair(entries: dict[str, str]) -> tuple[str, str, str]:
    """Return the left camera, the right camera and how the names of projections begin."""
    for name in PROJECTION_NAMES:
        for left, right in PAIRS:
            if name + left in entries and name + right in entries:
                return left, right, name
    raise ValueError(
        "there are no projections of two cameras; expected P_rect_02 and P_rect_03, P2 and P3 or "
        f"P0 and P1, got {', '.join(entries)}; is the file cut off?"
    )


def _numbers(entries: dict[str, str], key: str, shape: tuple[int, ...]) -> Array:
    return as_numbers(entries[key], int(np.prod(shape)), key).reshape(shape)


def _size(entries: dict[str, str], key: str) -> tuple[int, int] | None:
    if key not in entries:
        return None
    width, height = _numbers(entries, key, (2,))
    return int(width), int(height)


def _raw(entries: dict[str, str], left: str, right: str) -> StereoCalibration | None:
    """Return the cameras before rectification; None if the file does not hold all of them."""
    needed = [f"{key}_0{camera}" for key in "SKDRT" for camera in (left, right)]
    if any(key not in entries for key in needed):
        return None
    right_from_first = _pose(entries, right)
    return StereoCalibration(
        left=_camera(entries, left),
        right=_camera(entries, right),
        right_from_left=right_from_first @ _pose(entries, left).inverse(),
    )


def _camera(entries: dict[str, str], camera: str) -> Camera:
    size = _size(entries, f"S_0{camera}")
    assert size is not None  # `_raw` looked
    K = _numbers(entries, f"K_0{camera}", (3, 3))
    return Camera(size, K, _numbers(entries, f"D_0{camera}", (5,)))


def _pose(entries: dict[str, str], camera: str) -> Pose:
    """Return the pose of a camera from camera 0."""
    R = nearest_rotation(_numbers(entries, f"R_0{camera}", (3, 3)))
    return Pose(R, _numbers(entries, f"T_0{camera}", (3,)))


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    """Return the file with the left camera as number 0 and the right one as number 1."""
    rows: list[tuple[str, Array]] = []
    rig = record.raw
    if rig is not None:
        rows += _raw_rows("0", rig.left, Pose.identity())
        rows += _raw_rows("1", rig.right, rig.right_from_left)
    *rotations, geometry = rectification(record)
    for number, R, P in zip("01", rotations, projections(geometry), strict=True):
        rows += [
            (f"S_rect_0{number}", np.array(geometry.size, dtype=np.float64)),
            (f"R_rect_0{number}", R),
            (f"P_rect_0{number}", P),
        ]
    return {path: "".join(f"{key}: {_words(numbers)}\n" for key, numbers in rows)}


def _raw_rows(number: str, camera: Camera, pose: Pose) -> list[tuple[str, Array]]:
    lens = camera.distortion
    if camera.model == "fisheye" or lens[COEFFICIENTS:].any():
        raise ValueError(
            f"KITTI's lens has {COEFFICIENTS} coefficients of a pinhole camera, got a "
            f"{camera.model} with {lens.size}; write .json or OpenCV's .yml instead"
        )
    lens = np.pad(lens[:COEFFICIENTS], (0, max(0, COEFFICIENTS - lens.size)))
    return [
        (f"S_0{number}", np.array(camera.size, dtype=np.float64)),
        (f"K_0{number}", camera.K),
        (f"D_0{number}", lens),
        (f"R_0{number}", pose.R),
        (f"T_0{number}", pose.t),
    ]


def _words(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers.ravel())


KITTI_READER = Reader(
    looks_like="KITTI: lines P_rect_02: or P2: (or P0:) with 12 numbers, or 12 bare numbers a line",
    recognises=_recognises,
    read=_read,
)
KITTI_WRITER = Writer(suffixes=(".txt",), render=_render)
