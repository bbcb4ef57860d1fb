"""Which of two files is of the left camera, told by their names."""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["other_side"]

OTHER = {"left": "right", "l": "r", "0": "1", "right": "left", "r": "l", "1": "0"}
LEFT = ("left", "l", "0")
# A word of its own, also in camelCase: `left` in left_cam and stereoLeft, not in `cleft`.
SIDE = re.compile(
    r"(?<![a-z])(?:left|right)(?![a-z])|(?:Left|Right)(?![a-z])|LEFT|RIGHT"
    r"|(?<=[_-])[lrLR](?![A-Za-z0-9])"
    r"|(?<=cam|era|am_|ra_)[01](?!\d)"
)


def other_side(path: Path) -> dict[Path, bool]:
    """Return where the file of the other camera may be, and whether that is the right one.

    left and right, _l and _r, cam0 and cam1 are looked for in the name of the file and of its
    folder: stereo/left.yaml stands beside stereo/right.yaml, left/info.yaml beside
    right/info.yaml.

    Args:
        path: of the one file.

    Returns:
        For each candidate, the most likely first, whether it is of the right camera; nothing if
        the name says no side.
    """
    text = f"{path.parent.name}/{path.name}"
    marks = list(SIDE.finditer(text))
    in_file = [mark for mark in marks if mark.start() > text.index("/")]
    choices = [*([mark] for mark in reversed(marks)), *filter(None, (in_file, marks))]
    return {
        _renamed(path, _swapped(text, chosen)): chosen[-1][0].lower() in LEFT for chosen in choices
    }


def _swapped(text: str, marks: list[re.Match[str]]) -> str:
    for mark in reversed(marks):
        word = OTHER[mark[0].lower()]
        if mark[0].isupper():
            word = word.upper()
        elif mark[0].istitle():
            word = word.title()
        text = text[: mark.start()] + word + text[mark.end() :]
    return text


def _renamed(path: Path, name: str) -> Path:
    """Return the path with its last two parts changed to `name`."""
    folder, _, file = name.rpartition("/")
    parent = path.parent if folder == path.parent.name else path.parent.with_name(folder)
    return parent / file
