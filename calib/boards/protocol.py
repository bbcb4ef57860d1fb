"""What a calibration board offers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from calib.pair import Image

__all__ = ["Array", "Board", "Corners", "grey", "grid", "seen_from_the_front"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Corners:
    """The points of a board that were found in a photograph.

    Attributes:
        ids: (n,) int, which points of `Board.points` they are; each at most once.
        pixels: (n, 2) float64, (x, y); (0, 0) is the centre of a pixel.

    Raises:
        ValueError: if the shapes do not agree.
    """

    ids: npt.NDArray[np.int64]
    pixels: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "ids", np.array(self.ids, dtype=np.int64).reshape(-1))
        object.__setattr__(self, "pixels", np.array(self.pixels, dtype=np.float64))
        if self.pixels.shape != (len(self.ids), 2):
            raise ValueError(
                f"corners must be (n, 2) for n ids, got {self.pixels.shape} for {len(self.ids)}"
            )

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, kept: npt.NDArray[np.bool_]) -> Corners:
        """Return the corners of a (n,) mask."""
        return Corners(self.ids[kept], self.pixels[kept])


class Board(Protocol):
    """A flat thing with points whose places on it are known."""

    @property
    def points(self) -> Array:
        """(N, 3) metres in the frame of the board: z = 0, x along its rows, y down."""
        ...

    @property
    def name(self) -> str:
        """What it is, in words."""
        ...

    @property
    def turns_into_itself(self) -> bool:
        """Whether nothing tells the board from itself turned by half a turn."""
        ...

    def find(self, image: Image) -> Corners | None:
        """Return the points that a photograph shows, None if it shows no such board.

        Args:
            image: (H, W, 3) uint8 RGB.
        """
        ...


def grid(columns: int, rows: int, spacing_m: float) -> Array:
    """Return the (rows x columns, 3) points of a grid, row by row."""
    y, x = np.mgrid[:rows, :columns].reshape(2, -1)
    return np.column_stack([x, y, np.zeros_like(x)]) * spacing_m


def grey(image: Image) -> Image:
    """Return (H, W) uint8."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def seen_from_the_front(pixels: Array, size: tuple[int, int]) -> Array:
    """Return the points of a whole grid row by row, such that the board's z axis points away.

    A detector may begin at any corner. A board is seen from its printed side, so in the image its
    columns lie clockwise of its rows.

    Args:
        pixels: (rows x columns, 2).
        size: columns and rows.
    """
    points = pixels.reshape(size[1], size[0], 2)
    along = points[:, -1] - points[:, 0]
    down = points[-1, :] - points[0, :]
    (ax, ay), (dx, dy) = along.sum(0), down.sum(0)
    if ax * dy - ay * dx < 0:
        points = points[:, ::-1]
    return np.ascontiguousarray(points.reshape(-1, 2))
