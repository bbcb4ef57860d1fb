"""COLMAP's `images.txt`: two lines an image, the first with its pose.

`IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, then the points it saw, or an empty line. The pose
carries the world to the camera, so it is inverted here; the unit of length is arbitrary.

Source: COLMAP documentation, Output Format ("images.txt").
"""

from __future__ import annotations

from collections.abc import Sequence

from calib.formats.colmap_values import quaternion_of, rotation_from
from calib.formats.protocol import as_numbers
from calib.trajectories.protocol import Trajectory, TrajectoryReader, posed

__all__ = ["COLMAP_POSES", "colmap_text"]

HEAD = "# Image list with two lines of data per image"
NUMBERS = 9
SCALE = (
    "COLMAP's unit of length is arbitrary and was taken as metres: unless the model was scaled, "
    "depths and poses do not fit each other"
)


def _recognises(text: str) -> bool:
    if text.lstrip().startswith(HEAD):
        return True
    lines = _lines(text)
    words = lines[0][1].split() if lines else []
    return len(words) > NUMBERS and _is_number(words[8]) and not _is_number(words[9])


def _read(text: str) -> Trajectory:
    names, poses = [], []
    lines = _lines(text)
    _check_second_lines(lines[1::2])
    for number, line in lines[::2]:
        where = f"line {number}"
        words = line.split(maxsplit=NUMBERS)
        if len(words) <= NUMBERS:
            raise ValueError(
                f"{where} must be IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, got "
                f"{line[:60]!r}; is the file cut off?"
            )
        values = as_numbers(" ".join(words[1:8]), 7, where)
        try:
            rotation = rotation_from(values[:4])
        except ValueError as error:
            raise ValueError(f"{where}: {error}") from error
        poses.append(posed(rotation, values[4:], where).inverse())
        names.append(words[9].strip())
    return Trajectory(tuple(poses), names=tuple(names), format="colmap", notes=(SCALE,))


def _check_second_lines(lines: list[tuple[int, str]]) -> None:
    """Raise ValueError unless every other line holds points: X, Y and the number of each."""
    for number, line in lines:
        words = line.split()
        if len(words) % 3 or not all(_is_number(word) for word in words):
            raise ValueError(
                f"line {number} must hold the points of the image before it, three numbers each, "
                f"or be empty; got {line[:60]!r}: were empty lines lost?"
            )


def _lines(text: str) -> list[tuple[int, str]]:
    """Return the lines with their numbers, without comments; empty ones count."""
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), start=1)]
    kept = [(number, line) for number, line in lines if not line.startswith("#")]
    while kept and not kept[0][1]:
        kept = kept[1:]
    while kept and not kept[-1][1]:
        kept = kept[:-1]
    return kept


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def colmap_text(trajectory: Trajectory, names: Sequence[str] | None = None) -> str:
    """Return the text of an `images.txt` without points.

    Args:
        trajectory: N poses.
        names: of the pictures; those of the trajectory, or numbers, if not given.
    """
    named = names or trajectory.names or [f"{number:06d}.png" for number in range(len(trajectory))]
    lines = [f"{HEAD}:\n", "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"]
    for number, (name, pose) in enumerate(
        zip(named, trajectory.world_from_camera, strict=True), start=1
    ):
        camera_from_world = pose.inverse()
        values = [*quaternion_of(camera_from_world.R), *camera_from_world.t]
        lines.append(f"{number} {' '.join(repr(float(v)) for v in values)} 1 {name}\n\n")
    return "".join(lines)


COLMAP_POSES = TrajectoryReader(
    looks_like="COLMAP images.txt: IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, every other line",
    recognises=_recognises,
    read=_read,
)
