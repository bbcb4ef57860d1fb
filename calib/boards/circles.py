"""Grids of circles, for lenses that blur corners."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calib.boards.protocol import Array, Corners, grey, grid, seen_from_the_front
from calib.pair import Image

__all__ = ["CircleGrid"]

FEWEST = 3


@dataclass(frozen=True)
class CircleGrid:
    """Dark circles on a bright ground; its points are their centres.

    Attributes:
        columns: circles along a row.
        rows: circles along a column.
        spacing_m: distance of neighbouring centres in a row; of a staggered grid half of it, the
            distance of neighbouring columns.
        staggered: every second row is shifted by half the distance ("asymmetric" in OpenCV).
    """

    columns: int
    rows: int
    spacing_m: float
    staggered: bool = False

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < FEWEST:
            raise ValueError(
                f"a grid must have at least {FEWEST} x {FEWEST} circles, "
                f"got {self.columns} x {self.rows}"
            )

    @property
    def points(self) -> Array:
        """See `Board`."""
        if not self.staggered:
            return grid(self.columns, self.rows, self.spacing_m)
        row, column = np.mgrid[: self.rows, : self.columns].reshape(2, -1)
        x = 2 * column + row % 2
        return np.column_stack([x, row, np.zeros_like(x)]) * self.spacing_m

    @property
    def turns_into_itself(self) -> bool:
        """See `Board`."""
        return not self.staggered or self.rows % 2 == 0

    @property
    def name(self) -> str:
        """See `Board`."""
        kind = "staggered grid" if self.staggered else "grid"
        return f"{kind} of {self.columns} x {self.rows} circles, {self.spacing_m * 1000:g} mm apart"

    def find(self, image: Image) -> Corners | None:
        """See `Board`; the whole grid must be seen."""
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.staggered else cv2.CALIB_CB_SYMMETRIC_GRID
        found, pixels = cv2.findCirclesGrid(
            grey(image), (self.columns, self.rows), flags=kind | cv2.CALIB_CB_CLUSTERING
        )
        if not found:
            return None
        ordered = seen_from_the_front(np.asarray(pixels, np.float64), (self.columns, self.rows))
        return Corners(np.arange(len(ordered)), ordered)
