"""A ChArUco board: a chessboard whose white squares hold markers, so that a part is enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from calib.boards.protocol import Array, Corners, grey, grid
from calib.pair import Image

__all__ = ["Charuco", "dictionaries"]

FEWEST_CORNERS = 6


def dictionaries() -> tuple[str, ...]:
    """Return the names of the dictionaries of markers."""
    return tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))


@dataclass(frozen=True)
class Charuco:
    """Black and white squares with markers in the white ones; its points are the inner corners.

    Attributes:
        columns: squares along a row.
        rows: squares along a column.
        square_m: side of a square.
        marker_m: side of a marker.
        dictionary: name of the markers, such as DICT_4X4_1000.

    Raises:
        ValueError: if a value cannot be; the message says which and why.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 2:
            raise ValueError(
                f"a ChArUco board has at least 2 x 2 squares, got {self.columns} x {self.rows}"
            )
        if not self.marker_m < self.square_m:
            raise ValueError(
                f"markers ({self.marker_m * 1000:g} mm) must be smaller than the squares "
                f"({self.square_m * 1000:g} mm); were the two mixed up?"
            )
        if self.dictionary not in dictionaries():
            raise ValueError(
                f"there is no dictionary {self.dictionary}; known ones are "
                f"{', '.join(dictionaries())}"
            )
        needed, there = self.columns * self.rows // 2, len(_dictionary(self.dictionary).bytesList)
        if needed > there:
            raise ValueError(
                f"{self.dictionary} has {there} markers, but {self.columns} x {self.rows} squares "
                f"need {needed}"
            )

    @property
    def points(self) -> Array:
        """See `Board`."""
        corner = np.array([self.square_m, self.square_m, 0.0])
        points: Array = grid(self.columns - 1, self.rows - 1, self.square_m) + corner
        return points

    @property
    def turns_into_itself(self) -> bool:
        """See `Board`."""
        return False

    @property
    def name(self) -> str:
        """See `Board`."""
        return (
            f"ChArUco board of {self.columns} x {self.rows} squares of {self.square_m * 1000:g} mm "
            f"with {self.marker_m * 1000:g} mm markers of {self.dictionary}"
        )

    def find(self, image: Image) -> Corners | None:
        """See `Board`; a part of the board is enough.

        Boards printed before OpenCV 4.6 begin with a marker in the first corner where the number of
        rows is even. Both patterns are tried, and the one that explains more corners is taken.
        """
        picture = grey(image)
        outlines, numbers, _ = self._markers.detectMarkers(picture)
        if numbers is None or len(numbers) == 0:
            return None
        found = [
            _found_by(detector, picture, outlines, np.asarray(numbers, np.int32))
            for detector in self._detectors
        ]
        best = max(found, key=len)
        return best if len(best) >= FEWEST_CORNERS else None

    @cached_property
    def pattern(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV knows it, which also draws it."""
        size = (self.columns, self.rows)
        markers = _dictionary(self.dictionary)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, markers)

    @cached_property
    def _markers(self) -> cv2.aruco.ArucoDetector:
        return cv2.aruco.ArucoDetector(_dictionary(self.dictionary))

    @cached_property
    def _detectors(self) -> tuple[cv2.aruco.CharucoDetector, ...]:
        markers = _dictionary(self.dictionary)
        size = (self.columns, self.rows)
        old = cv2.aruco.CharucoBoard(size, self.square_m, self.marker_m, markers)
        old.setLegacyPattern(True)
        return tuple(cv2.aruco.CharucoDetector(board) for board in (self.pattern, old))


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def _found_by(
    detector: cv2.aruco.CharucoDetector,
    picture: Image,
    outlines: Sequence[npt.NDArray[Any]],
    numbers: npt.NDArray[np.int32],
) -> Corners:
    """Return the corners between markers that were found already."""
    pixels, ids, _, _ = detector.detectBoard(picture, markerCorners=outlines, markerIds=numbers)
    if ids is None or len(ids) == 0:
        return Corners(np.zeros(0, np.int64), np.zeros((0, 2)))
    return Corners(np.asarray(ids, np.int64), np.asarray(pixels, np.float64).reshape(-1, 2))
