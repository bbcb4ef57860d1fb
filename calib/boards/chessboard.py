"""A chessboard, the board that everybody has."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.boards.protocol import Array, Corners, grey, grid, seen_from_the_front
from calib.pair import Image

__all__ = ["Chessboard"]

FLAGS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
QUICK_FLAGS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
WINDOW_SHARE = 0.35
"""Half of the window of a sub-pixel corner, as a share of the distance to the next one."""
SMALLEST_WINDOW, LARGEST_WINDOW = 2, 11
PRECISE = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
FEWEST = 3


@dataclass(frozen=True)
class Chessboard:
    """Black and white squares; its points are the inner corners.

    Attributes:
        columns: inner corners along a row, one less than there are squares.
        rows: inner corners along a column.
        square_m: side of a square.
    """

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < FEWEST:
            raise ValueError(
                f"a chessboard must have at least {FEWEST} x {FEWEST} inner corners, "
                f"got {self.columns} x {self.rows}"
            )

    @property
    def points(self) -> Array:
        """See `Board`."""
        return grid(self.columns, self.rows, self.square_m)

    @property
    def turns_into_itself(self) -> bool:
        """See `Board`; the colours tell the two ends of most boards apart."""
        return (self.columns + self.rows) % 2 == 0

    @property
    def name(self) -> str:
        """See `Board`."""
        return (
            f"chessboard of {self.columns} x {self.rows} inner corners, "
            f"{self.square_m * 1000:g} mm apart"
        )

    def find(self, image: Image) -> Corners | None:
        """See `Board`; the whole board must be seen.

        Found by the sector-based detector of Duda & Frese, Accurate Detection and Localization of
        Checkerboard Corners for Calibration, BMVC 2018, or by OpenCV's older one where that fails;
        then moved to where the edges cross (Förstner & Gülch, 1987), which leaves a third of the
        noise on generated photographs.
        """
        picture = grey(image)
        size = (self.columns, self.rows)
        found, pixels = cv2.findChessboardCornersSB(picture, size, flags=FLAGS)
        if not found:
            found, pixels = cv2.findChessboardCorners(picture, size, flags=QUICK_FLAGS)
            if not found:
                return None
        pixels = _refined(picture, np.asarray(pixels, np.float32), size)
        ordered = seen_from_the_front(np.asarray(pixels, dtype=np.float64), size)
        if not self.turns_into_itself and _begins_white(picture, ordered, size):
            ordered = ordered[::-1]
        return Corners(np.arange(len(ordered)), ordered)

    def quickly_found(self, image: Image) -> bool:
        """Return whether a photograph shows this board, at first sight."""
        size = (self.columns, self.rows)
        found, _ = cv2.findChessboardCorners(grey(image), size, flags=QUICK_FLAGS)
        return bool(found)


def _refined(
    picture: Image, pixels: npt.NDArray[np.float32], size: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Move corners to where the edges cross, in windows that hold no other corner.

    One that would leave the middle of its window has found something else and stays.
    """
    points = pixels.reshape(size[1], size[0], 2)
    nearest = min(
        float(np.linalg.norm(np.diff(points, axis=axis), axis=-1).min()) for axis in (0, 1)
    )
    half = int(np.clip(WINDOW_SHARE * nearest, SMALLEST_WINDOW, LARGEST_WINDOW))
    refined = cv2.cornerSubPix(picture, pixels.copy(), (half, half), (-1, -1), PRECISE)
    moved = np.abs(refined - pixels).max(axis=-1, keepdims=True)
    return np.where(moved <= half / 2, refined, pixels).astype(np.float32)


def _begins_white(picture: Image, pixels: Array, size: tuple[int, int]) -> bool:
    """Return whether the square after the first corner is brighter than its neighbours.

    Args:
        picture: (H, W).
        pixels: (rows x columns, 2) corners row by row.
        size: columns and rows.
    """
    corners = pixels.reshape(size[1], size[0], 2)
    middles = (corners[:-1, :-1] + corners[1:, :-1] + corners[:-1, 1:] + corners[1:, 1:]) / 4
    x, y = np.rint(middles).astype(int).reshape(-1, 2).T
    height, width = picture.shape
    brightness = picture[y.clip(0, height - 1), x.clip(0, width - 1)].astype(np.float64)
    row, column = np.mgrid[: size[1] - 1, : size[0] - 1].reshape(2, -1)
    like_first = (row + column) % 2 == 0
    return bool(brightness[like_first].mean() > brightness[~like_first].mean())
