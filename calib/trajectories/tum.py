"""TUM RGB-D: `timestamp tx ty tz qx qy qz qw`, eight numbers a line.

The pose carries the camera to the world; seconds and metres; the quaternion has its real part
last. Seven numbers are the same without the time.

Source: TUM RGB-D benchmark, File Formats ("Ground-truth trajectories").
"""

from __future__ import annotations

from calib.formats.colmap_values import quaternion_of, rotation_from
from calib.formats.protocol import Array, as_numbers
from calib.pose import Pose
from calib.trajectories.protocol import Trajectory, TrajectoryReader, numbered_rows, posed

__all__ = ["TUM_POSES", "tum_text"]

COLUMNS, WITHOUT_TIME = 8, 7
REAL_FIRST = [3, 0, 1, 2]
REAL_LAST = [1, 2, 3, 0]


def _recognises(text: str) -> bool:
    rows = numbered_rows(text)
    return bool(rows) and len(rows[0][1]) in (COLUMNS, WITHOUT_TIME)


def _read(text: str) -> Trajectory:
    rows = numbered_rows(text)
    columns = len(rows[0][1]) if rows else COLUMNS
    columns = columns if columns == WITHOUT_TIME else COLUMNS
    poses, times = [], []
    for number, words in rows:
        where = f"line {number}"
        values = as_numbers(" ".join(words), columns, where)
        times.append(float(values[0]))
        poses.append(_pose(values[-WITHOUT_TIME:], where))
    if columns == WITHOUT_TIME:
        note = "the lines hold no time (7 numbers): poses go with the frames in order"
        return Trajectory(tuple(poses), format="tum", notes=(note,))
    late = next((i for i in range(1, len(times)) if times[i] <= times[i - 1]), None)
    if late is not None:
        raise ValueError(
            f"line {rows[late][0]}: the time {times[late]:g} s does not come after "
            f"{times[late - 1]:g} s; are lines mixed up, or is the first number no time?"
        )
    return Trajectory(tuple(poses), times_s=tuple(times), format="tum")


def _pose(values: Array, where: str) -> Pose:
    try:
        rotation = rotation_from(values[3:][REAL_FIRST])
    except ValueError as error:
        raise ValueError(f"{where}: {error} (qx qy qz qw in the file)") from error
    return posed(rotation, values[:3], where)


def tum_text(trajectory: Trajectory) -> str:
    """Return the text of a poses file; without times the frames are numbered in seconds."""
    times = trajectory.times_s or tuple(float(number) for number in range(len(trajectory)))
    lines = ["# timestamp tx ty tz qx qy qz qw\n"]
    for time_s, pose in zip(times, trajectory.world_from_camera, strict=True):
        values = [*pose.t, *quaternion_of(pose.R)[REAL_LAST]]
        lines.append(f"{time_s:.6f} " + " ".join(f"{value:.9f}" for value in values) + "\n")
    return "".join(lines)


TUM_POSES = TrajectoryReader(
    looks_like="TUM: timestamp tx ty tz qx qy qz qw a line (8 numbers; 7 without the timestamp)",
    recognises=_recognises,
    read=_read,
)
