"""Where a moving camera was: one module a file format, and the tables that list them."""

from calib.trajectories.protocol import Trajectory, TrajectoryReader
from calib.trajectories.tables import (
    TRAJECTORY_READERS,
    TRAJECTORY_WRITERS,
    read_trajectory,
    write_trajectory,
)

__all__ = [
    "TRAJECTORY_READERS",
    "TRAJECTORY_WRITERS",
    "Trajectory",
    "TrajectoryReader",
    "read_trajectory",
    "write_trajectory",
]
