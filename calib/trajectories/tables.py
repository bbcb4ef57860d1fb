"""The formats of poses that are known, and how to read or write a file of any of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from calib.trajectories.colmap import COLMAP_POSES, colmap_text
from calib.trajectories.kitti import KITTI_POSES, kitti_text
from calib.trajectories.own_json import JSON_POSES, json_text
from calib.trajectories.protocol import Trajectory, TrajectoryReader
from calib.trajectories.tum import TUM_POSES, tum_text

__all__ = ["TRAJECTORY_READERS", "TRAJECTORY_WRITERS", "read_trajectory", "write_trajectory"]

# The first that recognises a text reads it.
TRAJECTORY_READERS: dict[str, TrajectoryReader] = {
    "json": JSON_POSES,
    "colmap": COLMAP_POSES,
    "kitti": KITTI_POSES,
    "tum": TUM_POSES,
}
TRAJECTORY_WRITERS: dict[str, Callable[[Trajectory], str]] = {
    "json": json_text,
    "colmap": colmap_text,
    "kitti": kitti_text,
    "tum": tum_text,
}


def read_trajectory(path: str | Path, *, format: str | None = None) -> Trajectory:
    """Read the poses of a camera that moved.

    Args:
        path: the file.
        format: a key of `TRAJECTORY_READERS`; told from the contents if not given.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the format is unknown or another than was said, or the file is damaged.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file of poses {path}")
    if format is not None and format not in TRAJECTORY_READERS:
        raise ValueError(f"format must be one of {', '.join(TRAJECTORY_READERS)}; got {format!r}")
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    looks = next((name for name, one in TRAJECTORY_READERS.items() if one.recognises(text)), None)
    chosen = format or looks
    if chosen is None:
        forms = "\n".join(f"  {reader.looks_like}" for reader in TRAJECTORY_READERS.values())
        raise ValueError(f"{path}: {_first_line(text)} is in no known format of poses:\n{forms}")
    reader = TRAJECTORY_READERS[chosen]
    if not reader.recognises(text):
        seen = "" if looks is None else f"; it looks like {TRAJECTORY_READERS[looks].looks_like}"
        raise ValueError(
            f"{path}: expected {reader.looks_like}; {_first_line(text)}{seen or ' is not that'}"
        )
    try:
        return reader.read(text)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_trajectory(path: str | Path, trajectory: Trajectory, *, format: str = "json") -> None:
    """Write poses; the file appears whole or not at all.

    Args:
        path: of the file.
        trajectory: what to write.
        format: a key of `TRAJECTORY_WRITERS`; json is exact and keeps names, times and notes.

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: if the format is unknown.
    """
    if format not in TRAJECTORY_WRITERS:
        raise ValueError(f"format must be one of {', '.join(TRAJECTORY_WRITERS)}; got {format!r}")
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent} to write {path.name} in")
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_text(TRAJECTORY_WRITERS[format](trajectory), encoding="utf-8")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _first_line(text: str) -> str:
    """Return the first line that is no comment, and how many words it has."""
    lines = [line.strip() for line in text.splitlines()]
    first = next((line for line in lines if line and not line.startswith("#")), "")
    if not first:
        return "the file, which holds no pose,"
    shown = first if len(first) <= 50 else f"{first[:50]}..."
    return f"its first line has {len(first.split())} words ({shown!r})"
