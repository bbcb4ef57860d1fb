"""From photographs of a board on disk to a rig and a report on it."""

from recon.calibration.calibrate import Calibrated, calibrate, write_calibrated

__all__ = ["Calibrated", "calibrate", "write_calibrated"]
