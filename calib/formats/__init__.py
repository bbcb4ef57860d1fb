"""Calibration files: one module a format, and the tables that list them."""

from calib.formats.protocol import CalibrationFile, LengthUnit, Reader, Writer
from calib.formats.record import CalibrationRecord
from calib.formats.tables import (
    READERS,
    WRITERS,
    check_writable,
    read_calibration,
    write_calibration,
)

__all__ = [
    "READERS",
    "WRITERS",
    "CalibrationFile",
    "CalibrationRecord",
    "LengthUnit",
    "Reader",
    "Writer",
    "check_writable",
    "read_calibration",
    "write_calibration",
]
