"""Boards found in photographs, several at a time."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calib.boards import Board, Corners
from calib.boards.diagnosis import why_not_found
from calib.estimation import BoardView
from calib.pair import Image
from recon.calibration.photographs import PhotographPair
from recon.files import read_image, read_side_by_side
from recon.observer import Observer, ignore

__all__ = ["Detected", "LookedAt", "Thumbnail", "detect", "read_photographs"]

THUMBNAIL_WIDTH = 360
ENOUGH_TO_JUDGE = 2
LOOKED_AT_AGAIN = 3


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """A small copy of a photograph; `scale` is its width over that of the photograph."""

    image: Image
    scale: float


@dataclass(frozen=True)
class LookedAt:
    """How many pairs were looked at so far, and how many there are."""

    done: int
    total: int


@dataclass(frozen=True, eq=False)
class Detected:
    """What all photographs show.

    Attributes:
        size: (width, height) of every photograph.
        views: what was found, in the order of the pairs.
        thumbnails: of each pair, left and right.
    """

    size: tuple[int, int]
    views: tuple[BoardView, ...]
    thumbnails: tuple[tuple[Thumbnail, Thumbnail], ...]


def detect(
    pairs: Sequence[PhotographPair], board: Board, *, observe: Observer = ignore
) -> Detected:
    """Find a board in the photographs of many pairs.

    Args:
        pairs: where they are.
        board: what to look for.
        observe: told ("board", LookedAt) after each pair.

    Raises:
        ValueError: if a picture cannot be read, sizes differ, or hardly a photograph shows the
            board; the message says what they show instead, if that can be seen.
    """
    found = []
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # OpenCV lets other threads run
        for result in threads.map(lambda pair: _looked_at(pair, board), pairs):
            found.append(result)
            observe("board", LookedAt(len(found), len(pairs)))
    sizes = [size for size, _, _ in found]
    for pair, size in zip(pairs, sizes, strict=True):
        if size != sizes[0]:
            raise ValueError(
                f"{pair.left} is {size[0]} x {size[1]} but {pairs[0].left} is "
                f"{sizes[0][0]} x {sizes[0][1]}; all photographs of a rig have one size"
            )
    views = tuple(view for _, view, _ in found)
    seen = sum(view.left is not None or view.right is not None for view in views)
    if seen <= ENOUGH_TO_JUDGE:
        raise ValueError(_not_found(pairs, board, seen))
    return Detected(sizes[0], views, tuple(small for _, _, small in found))


def _looked_at(
    pair: PhotographPair, board: Board
) -> tuple[tuple[int, int], BoardView, tuple[Thumbnail, Thumbnail]]:
    """Return size, corners and thumbnails of one pair."""
    left, right = read_photographs(pair)
    if left.shape != right.shape:
        raise ValueError(
            f"{pair.left} is {left.shape[1]} x {left.shape[0]} but {pair.right} is "
            f"{right.shape[1]} x {right.shape[0]}; both cameras must have one size"
        )
    corners: list[Corners | None] = [board.find(image) for image in (left, right)]
    small = _thumbnail(left), _thumbnail(right)
    return (left.shape[1], left.shape[0]), BoardView(pair.name, *corners), small


def read_photographs(pair: PhotographPair) -> tuple[Image, Image]:
    """Return left and right (H, W, 3) uint8 RGB."""
    if pair.right is None:
        return read_side_by_side(pair.left)
    return read_image(pair.left), read_image(pair.right)


def _thumbnail(image: Image) -> Thumbnail:
    scale = min(1.0, THUMBNAIL_WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return Thumbnail(np.asarray(small, np.uint8), scale)


def _not_found(pairs: Sequence[PhotographPair], board: Board, seen: int) -> str:
    chosen = pairs[:: max(1, len(pairs) // LOOKED_AT_AGAIN)][:LOOKED_AT_AGAIN]
    instead = why_not_found(board, [image for pair in chosen for image in read_photographs(pair)])
    where = f"of {len(pairs)} pairs, beginning with {Path(pairs[0].left).name}"
    reason = instead or (
        "is the whole board in the photographs, sharp, evenly lit, with a white border, and is its "
        "form right?"
    )
    return f"no {board.name} was found in {len(pairs) - seen} {where}; {reason}"
