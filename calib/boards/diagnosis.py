"""Why a board is not found: what the photographs show instead."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from calib.boards.charuco import Charuco
from calib.boards.chessboard import Chessboard
from calib.boards.protocol import Board, grey
from calib.pair import Image

__all__ = ["why_not_found"]

OTHER_COUNTS = range(3, 15)
COMMON_MISTAKES = ((-1, -1), (1, 1), (-1, 0), (0, -1), (1, 0), (0, 1))
"""What is added to columns and rows when squares are counted for corners, or one is forgotten."""
FEWEST_MARKERS = 4
OTHER_DICTIONARIES = (
    *("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000"),
    *("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_36h11"),
)
MOST_PIXELS = 1_000_000


def why_not_found(board: Board, images: Sequence[Image]) -> str:
    """Return what some photographs show in place of a board, as a sentence, or "".

    Args:
        board: that was not found in them.
        images: (H, W, 3) uint8 RGB, a few.
    """
    for image in map(_small, images):
        if isinstance(board, Chessboard) and (other := _other_chessboard(board, image)):
            return other
        if isinstance(board, Charuco) and (other := _other_markers(board, image)):
            return other
    return ""


def _small(image: Image) -> Image:
    """Return an image of a megapixel at most: this is about what there is, not where."""
    factor = float(np.sqrt(MOST_PIXELS / (image.shape[0] * image.shape[1])))
    if factor >= 1:
        return image
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def _other_chessboard(board: Chessboard, image: Image) -> str:
    likely = [(board.columns + x, board.rows + y) for x, y in COMMON_MISTAKES]
    rest = [(x, y) for x in OTHER_COUNTS for y in OTHER_COUNTS if x >= y]
    rest.sort(key=lambda size: -size[0] * size[1])  # a part of a board looks like a smaller one
    for columns, rows in dict.fromkeys([*likely, *rest]):
        if {columns, rows} == {board.columns, board.rows} or min(columns, rows) < OTHER_COUNTS[0]:
            continue
        if Chessboard(columns, rows, board.square_m).quickly_found(image):
            return (
                f"they show a chessboard with {columns} x {rows} inner corners, not "
                f"{board.columns} x {board.rows}; inner corners are counted, not squares"
            )
    return ""


def _other_markers(board: Charuco, image: Image) -> str:
    picture = grey(image)
    seen = _markers(board.dictionary, picture)
    if len(seen) >= FEWEST_MARKERS:
        most = board.columns * board.rows // 2
        return (
            f"they show {len(seen)} markers of {board.dictionary}, numbered {min(seen)} to "
            f"{max(seen)}, but not arranged as on a board of {board.columns} x {board.rows} "
            f"squares, whose markers are numbered 0 to {most - 1}; are the counts right?"
        )
    mirrored = np.ascontiguousarray(picture[:, ::-1])
    if len(_markers(board.dictionary, mirrored)) >= FEWEST_MARKERS:
        return "their markers can be read in a mirror only; are the photographs mirrored?"
    for other in OTHER_DICTIONARIES:
        seen = _markers(other, picture)
        if other != board.dictionary and len(seen) >= FEWEST_MARKERS:
            return f"they show {len(seen)} markers of {other}, not of {board.dictionary}"
    return ""


def _markers(dictionary: str, picture: Image) -> list[int]:
    """Return the numbers of the markers in a grey photograph."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    _, numbers, _ = cv2.aruco.ArucoDetector(known).detectMarkers(picture)
    return [] if numbers is None else [int(number) for number in np.asarray(numbers).ravel()]
