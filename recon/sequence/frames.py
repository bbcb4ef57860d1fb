"""Which files of a folder are the frames of a sequence, in order."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from recon.calibration.photographs import ENDINGS, pair_by_name, photographs
from recon.files import image_size

__all__ = ["FrameOnDisk", "find_depth_frames", "find_pairs"]

SIDES = (
    ("image_2", "image_3"),  # KITTI, colour
    ("image_02/data", "image_03/data"),
    ("image_0", "image_1"),  # KITTI, grey
    ("image_00/data", "image_01/data"),
    ("left", "right"),
    ("cam0/data", "cam1/data"),  # EuRoC
    ("cam0", "cam1"),
)
COLOUR_AND_DEPTH = (("color", "depth"), ("colour", "depth"), ("rgb", "depth"))
BESIDE = (("*_left.*", "*_right.*"), ("*_l.*", "*_r.*"), ("left_*.*", "right_*.*"))


@dataclass(frozen=True)
class FrameOnDisk:
    """The two files of one moment.

    Attributes:
        name: of the first file, without its ending.
        first: left picture, or colours.
        second: right picture, or depths.
    """

    name: str
    first: Path
    second: Path


def find_pairs(
    folder: Path, left: str | None = None, right: str | None = None
) -> tuple[FrameOnDisk, ...]:
    """Return the left and right pictures of a sequence, in natural order.

    Args:
        folder: with image_0 and image_1 (KITTI; image_2 and image_3 for colour), left and right,
            cam0 and cam1 (EuRoC), or files that end in _left and _right.
        left: pattern of the left pictures, absolute or below `folder`, for other layouts.
        right: of the right ones.

    Raises:
        FileNotFoundError: if there are no pictures.
        ValueError: if the layout is unknown, a picture has no partner, or sizes change.
    """
    if (left is None) != (right is None):
        raise ValueError("give both --left and --right, or neither")
    if left is not None and right is not None:
        return _checked(folder, _matching(folder, left), _matching(folder, right))
    for patterns in (*SIDES, *BESIDE):
        found = [_present(folder, pattern) for pattern in patterns]
        if all(found):
            return _checked(folder, *found)
    raise ValueError(
        f"{folder} holds no sequence of pairs: expected image_0 and image_1, image_2 and image_3, "
        f"left and right, cam0 and cam1, or files named *_left.* and *_right.*{_holds(folder)}; "
        "for other names say --left 'PATTERN' --right 'PATTERN'"
    )


def find_depth_frames(folder: Path) -> tuple[FrameOnDisk, ...]:
    """Return the colours and depths of a sequence, in natural order.

    Args:
        folder: with `color`, `colour` or `rgb` beside `depth`, files named alike.

    Raises:
        ValueError: if the layout is unknown, a picture has no partner, or sizes change.
    """
    for patterns in COLOUR_AND_DEPTH:
        found = [_present(folder, pattern) for pattern in patterns]
        if all(found):
            return _checked(folder, *found)
    raise ValueError(
        f"{folder} holds no colours and depths: expected the folders color (or colour, rgb) and "
        f"depth{_holds(folder)}"
    )


def _present(folder: Path, pattern: str) -> list[Path]:
    """Return the pictures in a sub-folder, or those that a pattern matches."""
    if "*" not in pattern:
        place = folder / pattern
        return sorted(_pictures(place.iterdir())) if place.is_dir() else []
    return sorted(_pictures(folder.glob(pattern)))


def _pictures(paths: Iterable[Path]) -> list[Path]:
    return [path for path in paths if path.suffix.lower() in ENDINGS and path.is_file()]


def _matching(folder: Path, pattern: str) -> list[Path]:
    return photographs(pattern if Path(pattern).is_absolute() else str(folder / pattern))


def _checked(folder: Path, first: list[Path], second: list[Path]) -> tuple[FrameOnDisk, ...]:
    """Return the frames if every file has its partner and all are of one size."""
    paired = pair_by_name(first, second)
    if paired.alone:
        lone = min(paired.alone, key=_natural)
        missing = "right (or depth)" if lone in first else "left (or colour)"
        raise ValueError(
            f"{lone} has no {missing} picture of the same name ({len(first)} and {len(second)} "
            f"files in {folder}, {len(paired.pairs)} of them in pairs); was a frame lost? Remove "
            "its partner, and its pose, or put it back"
        )
    frames = [
        FrameOnDisk(pair.left.stem, pair.left, pair.right)
        for pair in sorted(paired.pairs, key=lambda pair: _natural(pair.left))
        if pair.right is not None
    ]
    _check_sizes(frames)
    return tuple(frames)


def _check_sizes(frames: Sequence[FrameOnDisk]) -> None:
    """Raise ValueError unless all files have one size; only their heads are read."""
    wanted = image_size(frames[0].first)
    for frame in frames:
        for path in (frame.first, frame.second):
            size = image_size(path)
            if size != wanted:
                raise ValueError(
                    f"{path} is {size[0]} x {size[1]} but {frames[0].first} is {wanted[0]} x "
                    f"{wanted[1]} (width x height); all frames of a sequence have one size"
                )


def _natural(path: Path) -> tuple[tuple[bool, int, str], ...]:
    """Return a key that puts 2 before 10."""
    parts = re.split(r"(\d+)", path.stem)
    return tuple((part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts)


def _holds(folder: Path) -> str:
    if not folder.is_dir():
        return "; the folder does not exist"
    names = sorted(path.name for path in folder.iterdir())
    return f"; it holds {', '.join(names[:8]) or 'nothing'}{', ...' if len(names) > 8 else ''}"
