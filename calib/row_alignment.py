"""A smooth vertical shift of the right view that makes the rows of a pair agree."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from calib.epipolar import LEAST_MATCHES, Matches, match_views
from calib.pair import Image, RectifiedPair

__all__ = ["RowAlignment"]

Array = npt.NDArray[np.float64]

EXPONENTS = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2))
"""Of x and y in the terms of the shift."""
TERMS = (3, 6)
"""How many of them each model has: a plane, then a bent one."""
LEAST_MATCHES_A_TERM = 15
HUBER_PX = 0.3  # matches of rectified photographs scatter by some tenths
STEPS = 15


@dataclass(frozen=True)
class RowAlignment:
    """Shift the rows of the right view by fractions of a pixel, to where those of the left are.

    What a rectification leaves (a drifted lens, a thermal bend, a distortion that the camera model
    lacks) is smooth, so a polynomial s(x, y) of degree one or two takes most of it. Columns stay,
    and so do disparities and the geometry: unlike `RowCorrection`, which turns the cameras, this
    says nothing of where they are, and takes bends, too. Which degree helps, and whether any does,
    is decided on matches that were not used; a pair that is good already stays as it is.

    Matching along rows wants this: a tenth of a pixel between them is a tenth of the steepness of
    every slanted edge in error.

    Attributes:
        least_gain: share of the mean absolute residual that must go; raising it leaves more pairs
            as they are.
        largest_shift_px: pairs that ask for more anywhere stay as they are: that is no remainder
            of a rectification but a wrong one.

    Raises:
        ValueError: if a setting is out of range.
    """

    least_gain: float = 0.15
    largest_shift_px: float = 3.0

    def __post_init__(self) -> None:
        if not 0 <= self.least_gain < 1:
            raise ValueError(f"least_gain must be in [0, 1), got {self.least_gain}")
        if not self.largest_shift_px > 0:
            raise ValueError(f"largest_shift_px must be positive, got {self.largest_shift_px}")

    def __call__(self, pair: RectifiedPair) -> RectifiedPair:
        """Return the pair with the right view shifted, or the same pair.

        Args:
            pair: rectified, (H, W, 3) each.
        """
        shift = self.shift(match_views(pair.left, pair.right), pair.geometry.size)
        if not shift.any():
            return pair
        return RectifiedPair(pair.left, _moved_down(pair.right, shift), pair.geometry)

    def shift(self, matches: Matches, size: tuple[int, int]) -> Array:
        """Return how far down each pixel of the right view belongs.

        Args:
            matches: of both views.
            size: (width, height) in pixels.

        Returns:
            (H, W) float64 px; 0 everywhere if nothing is to be gained or too much is asked for.
        """
        width, height = size
        nothing = np.zeros((height, width))
        if len(matches) < LEAST_MATCHES:
            return nothing
        near = np.abs(matches.offsets - np.median(matches.offsets)) < self.largest_shift_px
        offsets, terms = matches.offsets[near], _terms(matches.right[near], size)
        best = self._degree(terms, offsets)
        pixels = np.stack(np.meshgrid(range(width), range(height)), axis=-1).reshape(-1, 2)
        coefficients = _fitted(terms[:, :best], offsets)
        shift = (_terms(pixels, size)[:, :best] @ coefficients).reshape(height, width)
        return shift if np.abs(shift).max() <= self.largest_shift_px else nothing

    def _degree(self, terms: Array, offsets: Array) -> int:
        """Return how many of the terms are worth it, perhaps none."""
        reached, best = float(np.abs(offsets).mean()), 0
        for count in TERMS:
            if len(offsets) < 2 * LEAST_MATCHES_A_TERM * count:
                break
            unseen = _unseen(terms[:, :count], offsets)
            if unseen < (1 - self.least_gain) * reached:
                reached, best = unseen, count
        return best


def _terms(places: Array, size: tuple[int, int]) -> Array:
    """Return the terms (N, 6) of the polynomial at places (N, 2), with x and y about [-1, 1]."""
    across, down = (2 * places / np.array(size) - 1).T
    return np.stack([across**i * down**j for i, j in EXPONENTS], axis=1)


def _fitted(terms: Array, offsets: Array) -> Array:
    """Minimise the sum of Huber's function of the residuals, by least squares with weights.

    Source: Huber, Annals of Mathematical Statistics 1964.

    Args:
        terms: (N, K).
        offsets: (N,) px.

    Returns:
        (K,) coefficients.
    """
    weights = np.ones(len(offsets))
    found: Array = np.zeros(terms.shape[1])
    for _ in range(STEPS):
        root = np.sqrt(weights)
        solved = np.linalg.lstsq(terms * root[:, None], offsets * root, rcond=None)
        found = np.asarray(solved[0], np.float64)
        residual = np.abs(offsets - terms @ found)
        weights = HUBER_PX / np.maximum(residual, HUBER_PX)
    return found


def _unseen(terms: Array, offsets: Array) -> float:
    """Return the mean absolute residual of each half of the matches under the fit to the other."""
    first = np.arange(len(offsets)) % 2 == 0
    total = 0.0
    for seen in (first, ~first):
        found = _fitted(terms[seen], offsets[seen])
        total += float(np.abs(offsets[~seen] - terms[~seen] @ found).sum())
    return total / len(offsets)


def _moved_down(image: Image, shift: Array) -> Image:
    """Return the image with each pixel moved down by its shift, in pixels."""
    height, width = shift.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    source = (y - shift).astype(np.float32)
    moved = cv2.remap(image, x, source, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
    return moved.astype(np.uint8, copy=False)
