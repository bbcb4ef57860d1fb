"""`K.txt`: nine numbers of the camera matrix, then the baseline in metres."""

from __future__ import annotations

import re

import numpy as np

from calib.formats.protocol import CalibrationFile, Reader, as_numbers
from calib.formats.record import CalibrationRecord
from calib.rig import RectifiedGeometry

__all__ = ["K_TXT_READER"]

NAME = "k_txt"
NUMBERS = 10


def _recognises(file: CalibrationFile) -> bool:
    return re.fullmatch(r"[-+0-9.,eE\s]*[0-9][-+0-9.,eE\s]*", file.text) is not None


def _read(file: CalibrationFile) -> CalibrationRecord:
    numbers = as_numbers(file.text, NUMBERS, "camera matrix (9) and baseline in metres (1)")
    left = np.column_stack([numbers[:9].reshape(3, 3), np.zeros(3)])
    if abs(left[2, 2] - 1) > 0 or np.abs(left[2, :2]).max() > 0:
        raise ValueError(
            f"camera matrix must end with 0 0 1, got {left[2, :3].tolist()}; is it transposed?"
        )
    right = left.copy()
    right[0, 3] = -numbers[9] * left[0, 0]
    geometry = RectifiedGeometry.from_projections(left, right, file.size_or_given(None))
    return CalibrationRecord(None, geometry, file.path, NAME)


K_TXT_READER = Reader(
    looks_like="K.txt: fx 0 cx 0 fy cy 0 0 1 on one line, the baseline in metres on the next",
    recognises=_recognises,
    read=_read,
)
