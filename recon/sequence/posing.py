"""Which pose belongs to which frame."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calib.pose import Pose
from calib.trajectories import Trajectory
from recon.sequence.frames import FrameOnDisk

__all__ = ["poses_of_frames"]

MOST_APART_S = 0.02
"""Between a picture and its pose, as in the tools of the TUM RGB-D benchmark."""


def poses_of_frames(
    trajectory: Trajectory, frames: Sequence[FrameOnDisk]
) -> tuple[tuple[Pose, ...], str]:
    """Return where the camera stood at every frame, and how the poses were matched.

    Poses with names go by the names of the first (left) pictures. Poses with times go by time if
    the names of all frames are times (a decimal fraction), to the nearest within 20 ms. Otherwise
    they go in order, and there must be as many as frames.

    Args:
        trajectory: the poses.
        frames: in order.

    Raises:
        ValueError: if a frame has no pose, or the counts differ.
    """
    if trajectory.names is not None:
        return _by_name(trajectory, trajectory.names, frames)
    if trajectory.times_s is not None and all(_is_time(frame.name) for frame in frames):
        return _by_time(trajectory, np.array(trajectory.times_s), frames)
    if len(trajectory) != len(frames):
        raise ValueError(
            f"there are {len(trajectory)} poses but {len(frames)} frames ({frames[0].name} to "
            f"{frames[-1].name}); {trajectory.format} poses go with the frames in order, so every "
            "frame needs one and no other may be there"
        )
    return trajectory.world_from_camera, "in order, one pose a frame"


def _by_name(
    trajectory: Trajectory, names: Sequence[str], frames: Sequence[FrameOnDisk]
) -> tuple[tuple[Pose, ...], str]:
    by_path = dict(zip(names, trajectory.world_from_camera, strict=True))
    by_stem = {_stem(name): pose for name, pose in by_path.items()}
    unique = len(by_stem) == len(by_path)
    poses = []
    for frame in frames:
        keys = ["/".join(frame.first.parts[-length:]) for length in (3, 2, 1)]
        pose = next((by_path[key] for key in (*keys, frame.name) if key in by_path), None)
        if pose is None and unique:
            pose = by_stem.get(frame.name)
        if pose is None:
            raise ValueError(
                f"frame {frame.first.name} has no pose: the {len(names)} poses are of "
                f"{', '.join(names[:3])}{', ...' if len(names) > 3 else ''}; was the picture not "
                "registered, or are these poses of another sequence?"
            )
        poses.append(pose)
    return tuple(poses), f"by the names of the pictures ({len(frames)} of {len(names)} poses)"


def _by_time(
    trajectory: Trajectory, times: np.ndarray, frames: Sequence[FrameOnDisk]
) -> tuple[tuple[Pose, ...], str]:
    poses, apart = [], 0.0
    for frame in frames:
        wanted = float(frame.name)
        nearest = int(np.abs(times - wanted).argmin())
        distance = abs(float(times[nearest]) - wanted)
        if distance > MOST_APART_S:
            raise ValueError(
                f"frame {frame.first.name} has no pose: the nearest in time is {distance:.3f} s "
                f"away (at {times[nearest]:.3f} s), more than {MOST_APART_S} s"
            )
        apart = max(apart, distance)
        poses.append(trajectory.world_from_camera[nearest])
    return tuple(poses), f"by time, at most {apart * 1000:.1f} ms apart"


def _is_time(name: str) -> bool:
    return re.fullmatch(r"\d+\.\d+", name) is not None


def _stem(name: str) -> str:
    last = name.replace("\\", "/").rsplit("/", 1)[-1]
    return last.rsplit(".", 1)[0]
