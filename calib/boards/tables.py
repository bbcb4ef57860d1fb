"""The boards that are known, and how a person says which one it is."""

from __future__ import annotations

import re
from collections.abc import Callable

from calib.boards.charuco import Charuco
from calib.boards.chessboard import Chessboard
from calib.boards.circles import CircleGrid
from calib.boards.protocol import Board

__all__ = ["BOARDS", "board_named"]

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}
SMALLEST_M, LARGEST_M = 0.0005, 1.0


def board_named(text: str) -> Board:
    """Return the board that a text such as `chessboard:9x6:25mm` describes.

    Args:
        text: KIND:COLUMNSxROWS:LENGTH, see `BOARDS`. Lengths have a unit: m, cm or mm.

    Raises:
        ValueError: if the text does not describe a board; the message shows one that does.
    """
    kind, *words = text.strip().split(":")
    if kind not in BOARDS:
        forms = "\n".join(f"  {form}" for form, _ in BOARDS.values())
        raise ValueError(f"unknown board {text!r}; known forms are\n{forms}")
    form, make = BOARDS[kind]
    if len(words) != form.count(":"):
        raise ValueError(f"board {text!r} must be written as {form}")
    try:
        return make(words)
    except ValueError as error:
        raise ValueError(f"board {text!r}: {error}; it is written as {form}") from error


def _chessboard(words: list[str]) -> Board:
    return Chessboard(*_counts(words[0]), _metres(words[1]))


def _charuco(words: list[str]) -> Board:
    return Charuco(*_counts(words[0]), _metres(words[1]), _metres(words[2]), words[3])


def _circles(words: list[str]) -> Board:
    return CircleGrid(*_counts(words[0]), _metres(words[1]))


def _staggered(words: list[str]) -> Board:
    return CircleGrid(*_counts(words[0]), _metres(words[1]), staggered=True)


def _counts(word: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", word)
    if match is None:
        raise ValueError(f"expected columns x rows such as 9x6, got {word!r}")
    columns, rows = (int(count) for count in match.groups())
    return columns, rows


def _metres(word: str) -> float:
    match = re.fullmatch(r"([0-9.]+)(mm|cm|m)", word)
    if match is None:
        raise ValueError(f"expected a length with its unit such as 25mm, got {word!r}")
    number, unit = match.groups()
    try:
        length = float(number) * METRES[unit]
    except ValueError as error:
        raise ValueError(f"expected a length such as 25mm, got {word!r}") from error
    if not SMALLEST_M <= length <= LARGEST_M:
        raise ValueError(f"{word} is no length of a board's part; is the unit right (m, cm, mm)?")
    return length


BOARDS: dict[str, tuple[str, Callable[[list[str]], Board]]] = {
    "chessboard": ("chessboard:9x6:25mm (inner corners, side of a square)", _chessboard),
    "charuco": (
        "charuco:31x16:49.33mm:38.46mm:DICT_4X4_1000 (squares, their side, side of a marker)",
        _charuco,
    ),
    "circles": ("circles:7x6:20mm (circles, distance of centres)", _circles),
    "staggered-circles": (
        "staggered-circles:4x11:20mm (circles in a row, rows, distance of the columns)",
        _staggered,
    ),
}
