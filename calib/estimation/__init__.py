"""From photographs of a board to a rig, and how far to trust it."""

from calib.camera import LENSES, LensName
from calib.estimation.agreement import BoardView
from calib.estimation.estimate import LeftOut, RigEstimate, estimate_rig
from calib.estimation.quality import Finding, Quality, Uncertainty, judge

__all__ = [
    "LENSES",
    "BoardView",
    "Finding",
    "LeftOut",
    "LensName",
    "Quality",
    "RigEstimate",
    "Uncertainty",
    "estimate_rig",
    "judge",
]
