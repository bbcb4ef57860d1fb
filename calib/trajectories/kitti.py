"""KITTI odometry: twelve numbers a line.

A line is the (3, 4) matrix [R | t], row by row, that carries points of the left rectified camera
of that frame to that of the first one; metres; x right, y down, z forward.

Source: KITTI odometry development kit, readme.txt ("Ground Truth Poses").
"""

from __future__ import annotations

import numpy as np

from calib.formats.protocol import as_numbers
from calib.trajectories.protocol import Trajectory, TrajectoryReader, numbered_rows, posed

__all__ = ["KITTI_POSES", "kitti_text"]

COLUMNS = 12


def _recognises(text: str) -> bool:
    rows = numbered_rows(text)
    return bool(rows) and len(rows[0][1]) == COLUMNS


def _read(text: str) -> Trajectory:
    poses = []
    for number, words in numbered_rows(text):
        where = f"line {number}"
        matrix = as_numbers(" ".join(words), COLUMNS, where).reshape(3, 4)
        poses.append(posed(matrix[:, :3], matrix[:, 3], where))
    return Trajectory(tuple(poses), format="kitti")


def kitti_text(trajectory: Trajectory) -> str:
    """Return the text of a poses file, from the world frame as it is."""
    lines = []
    for pose in trajectory.world_from_camera:
        matrix = np.column_stack([pose.R, pose.t])
        lines.append(" ".join(f"{number:.12e}" for number in matrix.ravel()) + "\n")
    return "".join(lines)


KITTI_POSES = TrajectoryReader(
    looks_like="KITTI: 12 numbers a line, the 3 x 4 matrix that carries the left camera to the "
    "first frame",
    recognises=_recognises,
    read=_read,
)
