"""Cost curves of single pixels: kept while volumes pass by, chosen once the result is known."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from recon.types import Array, CostVolume, DisparityMap, PixelStatus
from recon.viewer.thinning import as_numpy

__all__ = ["Curve", "CurveSamples", "Probe", "choose_probes", "lattice"]

LATTICE_POINTS = 4000
"""About how many pixels of a pair have their curves kept: 4 MB a stage for 256 disparities."""

WINDOW_PX = 9
NEIGHBOURHOOD_PX = 5
APART_PX = 2
OUT_OF_SIGHT = (PixelStatus.OCCLUDED, PixelStatus.FILLED_OCCLUSION)


class Curve(NamedTuple):
    """The costs of one pixel.

    Attributes:
        disparities: (D,) candidates in pixels.
        costs: (D,) float32; +inf where a candidate has none.
    """

    disparities: Array
    costs: Array


class Probe(NamedTuple):
    """A pixel of the left view whose costs are shown.

    Attributes:
        name: what kind of pixel it is, in words that are a path too.
        x: its column.
        y: its row.
        why: how it was chosen.
    """

    name: str
    x: int
    y: int
    why: str


@dataclass(frozen=True, eq=False)
class CurveSamples:
    """The curves of some rows and columns of a volume, which is freed meanwhile.

    Attributes:
        rows: (R,) of the view, ascending.
        columns: (C,) of the view, ascending.
        disparities: the candidates, pixels.
        cost: (R, C, D) float32.
    """

    rows: Array
    columns: Array
    disparities: range
    cost: Array

    @classmethod
    def of(cls, volume: CostVolume, rows: Array, columns: Array) -> CurveSamples:
        """Copy the curves at the crossings of rows and columns, as far as the volume has them.

        Args:
            volume: of a view, or of a strip or tile of it.
            rows: of the view, ascending.
            columns: of the view, ascending.
        """
        (top, left), (height, width, _) = volume.origin, volume.cost.shape
        rows = rows[(rows >= top) & (rows < top + height)]
        columns = columns[(columns >= left) & (columns < left + width)]
        part = volume.cost[rows - top][:, columns - left]
        return cls(rows, columns, volume.disparities, as_numpy(part).astype(np.float32))

    def at(self, x: int, y: int) -> Curve | None:
        """Return the curve of a pixel of the view, None if it was not kept."""
        row, column = np.flatnonzero(self.rows == y), np.flatnonzero(self.columns == x)
        if not (row.size and column.size):
            return None
        return Curve(np.array(self.disparities), self.cost[row[0], column[0]])


def lattice(width: int, height: int) -> tuple[Array, Array]:
    """Return the rows and columns at whose crossings curves are kept.

    Args:
        width: of the view, pixels.
        height: of the view, pixels.
    """
    step = max(1, math.ceil(math.sqrt(width * height / LATTICE_POINTS)))
    return np.arange(step // 2, height, step), np.arange(step // 2, width, step)


def choose_probes(
    image: Array, disparity: DisparityMap[Array], samples: Sequence[CurveSamples]
) -> list[Probe]:
    """Choose pixels that show what makes matching easy and hard, among those with a curve.

    Args:
        image: (H, W, 3) uint8, the left view.
        disparity: (H, W), the result.
        samples: curves of the matching cost.

    Returns:
        At most one pixel of each kind, in a fixed order; a kind that the pair lacks is left out.
    """
    rows, columns, ambiguity = _ambiguities(samples)
    if not rows.size:
        return []
    texture = _texture(image)[rows, columns]
    jump = _jumps(disparity)[rows, columns]
    status = disparity.status[rows, columns]
    hidden = _hidden(disparity.status)[rows, columns]

    matched = status == PixelStatus.MATCHED
    in_sight = ~np.isin(status, (*OUT_OF_SIGHT, PixelStatus.OUTSIDE))
    smooth = matched & (jump < 1)
    with_texture = smooth & (texture >= np.median(texture))
    share = np.where(with_texture, texture, 0) / max(float(texture.max()), 1.0)
    kinds = (
        ("textured", with_texture, share - ambiguity, "much texture, one minimum"),
        ("textureless", in_sight & (jump < 1), -texture, "least texture"),
        ("depth_edge", matched & (jump > 2), jump, "largest step of the disparity beside it"),
        ("occluded", np.isin(status, OUT_OF_SIGHT) & (hidden > 0.5), hidden,
         "deepest within what only the left camera sees"),
        ("repeated", with_texture, ambiguity,
         "two minima of the matching cost that are nearly as low"),
    )  # fmt: skip
    return [
        Probe(name, int(columns[best]), int(rows[best]), why)
        for name, among, score, why in kinds
        if (best := _best(score, among)) is not None
    ]


def _best(score: Array, among: Array) -> int | None:
    """Return the place of the highest score among some, None if there are none."""
    return int(np.argmax(np.where(among, score, -np.inf))) if among.any() else None


def _ambiguities(samples: Iterable[CurveSamples]) -> tuple[Array, Array, Array]:
    """Return row, column and ambiguity of every curve that was kept, a pixel at most once."""
    rows, columns, values = [], [], []
    for part in samples:
        grid = np.meshgrid(part.rows, part.columns, indexing="ij")
        rows.append(grid[0].ravel())
        columns.append(grid[1].ravel())
        values.append(_ambiguity(part.cost).ravel())
    if not rows:
        return (np.zeros(0, np.intp),) * 3
    y, x, ambiguity = (np.concatenate(parts) for parts in (rows, columns, values))
    _, first = np.unique(np.stack([y, x]), axis=1, return_index=True)
    return y[first], x[first], ambiguity[first]


def _ambiguity(cost: Array) -> Array:
    """Return how nearly the second minimum of a curve is as low as the first.

    With b the lowest cost, s the lowest of the other local minima more than `APART_PX` away and m
    the median, the ambiguity is 1 - (s - b) / (m - b): 1 if both are equally low.

    Args:
        cost: (..., D); +inf where there is no candidate.

    Returns:
        (...); 0 where there is no second minimum, or nearly no curve.
    """
    count = cost.shape[-1]
    finite = np.isfinite(cost)
    enough = finite.sum(axis=-1) >= 4 * APART_PX
    known = np.where(finite, cost, cost[finite].max(initial=0.0))
    padded = np.pad(known, [(0, 0)] * (cost.ndim - 1) + [(1, 1)], constant_values=np.inf)
    lowest_here = (known <= padded[..., :-2]) & (known <= padded[..., 2:]) & finite
    best = known.argmin(axis=-1)
    apart = np.abs(np.arange(count) - best[..., None]) > APART_PX
    second = np.where(lowest_here & apart, known, np.inf).min(axis=-1)
    first, median = known.min(axis=-1), np.median(known, axis=-1)
    depth = np.maximum(median - first, 1e-6)
    return np.where(enough & np.isfinite(second), 1 - np.clip((second - first) / depth, 0, 1), 0.0)


def _texture(image: Array) -> Array:
    """Return the standard deviation of the grey values around every pixel, (H, W)."""
    grey = image.astype(np.float32).mean(axis=2)
    window = (WINDOW_PX, WINDOW_PX)
    variance = cv2.blur(grey**2, window) - cv2.blur(grey, window) ** 2
    deviation: Array = np.sqrt(np.maximum(variance, 0))
    return deviation


def _jumps(disparity: DisparityMap[Array]) -> Array:
    """Return the largest difference of disparities around every pixel, (H, W)."""
    kernel = np.ones((NEIGHBOURHOOD_PX, NEIGHBOURHOOD_PX), np.uint8)
    low, high = (
        np.where(disparity.valid, disparity.values, fill).astype(np.float32)
        for fill in (np.float32(1e9), np.float32(-1e9))
    )
    jumps: Array = np.maximum(cv2.dilate(high, kernel) - cv2.erode(low, kernel), 0)
    return jumps


def _hidden(status: Array) -> Array:
    """Return the share of occluded pixels around every pixel, (H, W); 0 at the left border."""
    occluded = np.isin(status, OUT_OF_SIGHT)
    border = np.logical_and.accumulate(occluded | (status == PixelStatus.OUTSIDE), axis=1)
    return cv2.blur((occluded & ~border).astype(np.float32), (WINDOW_PX, WINDOW_PX))
