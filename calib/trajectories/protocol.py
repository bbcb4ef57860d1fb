"""The poses of a camera that moved, and what a format of them offers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib.formats.protocol import Array
from calib.pose import Pose, nearest_rotation

__all__ = ["Trajectory", "TrajectoryReader", "numbered_rows", "posed"]


@dataclass(frozen=True)
class Trajectory:
    """Where the left camera stood at every frame.

    Attributes:
        world_from_camera: N poses, of the camera that took the left pictures as they are on disk.
        names: of the N pictures, None where the format has none.
        times_s: N seconds, None where the format has none.
        format: a key of `TRAJECTORY_READERS`.
        notes: what a person should know, in sentences.

    Raises:
        ValueError: if there is no pose, or the lengths do not agree.
    """

    world_from_camera: tuple[Pose, ...]
    names: tuple[str, ...] | None = None
    times_s: tuple[float, ...] | None = None
    format: str = "json"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.world_from_camera:
            raise ValueError("there is no pose; is the file empty or cut off?")
        for what, values in (("names", self.names), ("times", self.times_s)):
            if values is not None and len(values) != len(self.world_from_camera):
                raise ValueError(
                    f"there are {len(self.world_from_camera)} poses but {len(values)} {what}"
                )

    def __len__(self) -> int:
        return len(self.world_from_camera)


@dataclass(frozen=True)
class TrajectoryReader:
    """One format of poses.

    Attributes:
        looks_like: how a person recognises it, for messages.
        recognises: whether a text is of this format.
        read: the poses of a text; raises ValueError without naming the file.
    """

    looks_like: str
    recognises: Callable[[str], bool]
    read: Callable[[str], Trajectory]


def numbered_rows(text: str) -> list[tuple[int, list[str]]]:
    """Return the words of every line that is neither empty nor a comment, with its number."""
    lines = ((number, line.strip()) for number, line in enumerate(text.splitlines(), start=1))
    return [
        (number, line.replace(",", " ").split())
        for number, line in lines
        if line and not line.startswith("#")
    ]


def posed(rotation: Array, translation: Array, where: str) -> Pose:
    """Return a pose, or say where the file holds something that is none.

    Args:
        rotation: (3, 3), rounded as files round.
        translation: (3,) metres.
        where: such as "line 7", for the message.

    Raises:
        ValueError: if the matrix is no rotation, or a number is not finite.
    """
    try:
        return Pose(nearest_rotation(rotation), np.asarray(translation, np.float64))
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error
