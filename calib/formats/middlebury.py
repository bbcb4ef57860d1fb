"""Middlebury's `calib.txt` (2014 and 2021 sets, evaluation version 3)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from calib.formats.protocol import Array, CalibrationFile, Reader, Writer, as_numbers
from calib.formats.record import CalibrationRecord
from calib.rig import RectifiedGeometry

__all__ = ["MIDDLEBURY_READER", "MIDDLEBURY_WRITER"]

NAME = "middlebury"
ENTRY = re.compile(r"(\w+)\s*=\s*(\[[^\]]*\]?|\S*)")  # key = [matrix] or key = word
MILLIMETRES = 1000.0
DOFFS_TOLERANCE_PX = 0.01  # three digits, times four where sizes were derived


def _recognises(file: CalibrationFile) -> bool:
    return re.search(r"^\s*cam[01]\s*=", file.text, re.MULTILINE) is not None


def _read(file: CalibrationFile) -> CalibrationRecord:
    entries = dict(ENTRY.findall(file.text))
    left, right = _matrix(entries, "cam0"), _matrix(entries, "cam1")
    _check_doffs(entries, float(right[0, 2] - left[0, 2]))
    right[0, 3] = -_number(entries, "baseline") / MILLIMETRES * right[0, 0]
    stated = None
    if "width" in entries or "height" in entries:
        stated = int(_number(entries, "width")), int(_number(entries, "height"))
    geometry = RectifiedGeometry.from_projections(left, right, file.size_or_given(stated))
    disparities = range(int(_number(entries, "ndisp"))) if "ndisp" in entries else None
    return CalibrationRecord(None, geometry, file.path, NAME, disparities=disparities)


def _value(entries: dict[str, str], key: str) -> str:
    if key not in entries:
        raise ValueError(
            f"there is no {key}=; expected cam0=, cam1=, doffs=, baseline=, width=, height=, "
            f"got {', '.join(entries)}"
        )
    return entries[key]


def _number(entries: dict[str, str], key: str) -> float:
    return float(as_numbers(_value(entries, key), 1, key)[0])


def _matrix(entries: dict[str, str], key: str) -> Array:
    """Return (3, 4), with a last column of zeros."""
    text = _value(entries, key)
    if not text.endswith("]"):
        raise ValueError(f"{key} must be [fx 0 cx; 0 fy cy; 0 0 1], got {text!r}; is it cut off?")
    K = as_numbers(text.strip("[]"), 9, key).reshape(3, 3)
    return np.column_stack([K, np.zeros(3)])


def _check_doffs(entries: dict[str, str], shift: float) -> None:
    """Raise ValueError unless doffs, where it is given, is cx1 - cx0."""
    if "doffs" not in entries:
        return
    doffs = _number(entries, "doffs")
    if abs(doffs - shift) > DOFFS_TOLERANCE_PX:
        raise ValueError(
            f"doffs is {doffs:g} px but cx1 - cx0 is {shift:g} px; they must agree: "
            "was only one of them changed when the images were resized or cropped?"
        )


def _render(record: CalibrationRecord, path: Path) -> dict[Path, str]:
    geometry = record.rectified
    if geometry is None:
        raise ValueError(
            "Middlebury's calib.txt holds a rectified geometry only; write .json or .yml instead"
        )

    def matrix(centre: tuple[float, float]) -> str:
        f, (cx, cy) = geometry.focal_px, centre
        return f"[{f!r} 0 {cx!r}; 0 {f!r} {cy!r}; 0 0 1]"

    lines = [
        f"cam0={matrix(geometry.centre_left)}",
        f"cam1={matrix(geometry.centre_right)}",
        f"doffs={-geometry.disparity_at_infinity!r}",
        f"baseline={geometry.baseline_m * MILLIMETRES!r}",
        f"width={geometry.size[0]}",
        f"height={geometry.size[1]}",
    ]
    if record.disparities is not None:
        lines.append(f"ndisp={record.disparities.stop}")
    return {path: "\n".join(lines) + "\n"}


MIDDLEBURY_READER = Reader(
    looks_like="Middlebury calib.txt: lines cam0=[fx 0 cx; 0 fy cy; 0 0 1], baseline=... and so on",
    recognises=_recognises,
    read=_read,
)
MIDDLEBURY_WRITER = Writer(suffixes=(".txt",), render=_render)
